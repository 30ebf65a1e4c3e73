"""The questions in SQL of the whole package, but for those of the store itself; and its tables as CSV.

Rows come as the store gives them: a dictionary each, keyed by column, one at a time unless a list is said.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from blurnoise_eval.detectors.records import Answers, Detections
from blurnoise_eval.grid.axes import AUTOMATIC, CHOICES, SETTING, VELOCITY, setting_of, velocity_of
from blurnoise_eval.store.schema import CONDITIONS, ROWS, SORTED
from blurnoise_eval.store.store import Store, unpack, unpack_all
from blurnoise_eval.system.files import write_whole
from blurnoise_eval.system.tables import csv_text

Row = dict[str, Any]
_SHARED = ", ".join(CONDITIONS)
_HERE = " AND ".join(f"{name} IS ?" for name in CONDITIONS)  # IS: original pictures have NULLs


def _mean(column: str) -> str:
    """Of values that may all be the same; then that value, to the bit."""
    return f"CASE WHEN MIN({column}) = MAX({column}) THEN MIN({column}) ELSE AVG({column}) END AS {column}"


def _values(store: Store, query: str, *values: object) -> list[Any]:
    """The only column of all rows."""
    return [row[0] for rows in store.tuples(query, *values) for row in rows]


def as_set(store: Store, rows: Iterable[Row]) -> Iterator[Row]:
    """The rows; where the camera has set the exposures, with their mean over the pictures, s, in its setting."""
    where = ", ".join(SETTING)
    query = f"SELECT {where}, {_mean('applied_exposure_s')} FROM cells WHERE exposure_s = ? GROUP BY {where}"
    means = {setting_of(row): row["applied_exposure_s"] for row in store.rows(query, AUTOMATIC)}
    for row in rows:
        if row["exposure_s"] == AUTOMATIC:
            row = {**row, "exposure_s": means[setting_of(row)]}
        yield row


def condition_counts(store: Store, model: str) -> list[Row]:
    """Per condition of a model, original pictures first: numbers of pictures, errors and targets, and means of
    blur, gain, signal to noise, brightness, saturated and invented shares."""
    names = ("applied_gain_db", "snr_db", "brightness", "saturated", "invented_share")
    means = ", ".join(f"AVG({name}) AS {name}" for name in names)
    query = f"""
      SELECT model, {_SHARED}, {_mean("blur_px")}, COUNT(*) AS n_images, COUNT(error) AS errors, {means},
        NULLIF(SUM(n_targets), 0) AS n_targets
      FROM cells WHERE model = ? GROUP BY {_SHARED} ORDER BY {SORTED}
    """
    return list(store.rows(query, model))


def target_sums(store: Store, model: str) -> Iterator[Row]:
    """Per condition of a model: the sum of its targets' confidences, and how many these are."""
    sums = "TOTAL(confidence) AS target_confidence, COUNT(confidence) AS n_target_confidence"
    return store.rows(f"SELECT {_SHARED}, {sums} FROM targets WHERE model = ? GROUP BY {_SHARED}", model)


def pictures_seen(store: Store) -> list[str]:
    """The pictures that any cell is of, by name."""
    return _values(store, "SELECT DISTINCT image FROM cells ORDER BY image")


def models_seen(store: Store) -> list[str]:
    """The models that any cell is of, by name."""
    return _values(store, "SELECT DISTINCT model FROM cells ORDER BY model")


def cells_with(store: Store, **columns: Any) -> Iterator[Row]:
    """The rows of cells that hold these values in these columns."""
    where = " AND ".join(f"{name} IS ?" for name in columns)
    return store.rows(f"SELECT * FROM cells WHERE {where} ORDER BY {ROWS}", *columns.values())


def _packed_at(store: Store, model: str, at: Mapping[str, Any]) -> list[tuple[str, int, bytes]]:
    """(picture, repeat, packed detections) of the cells under a condition, by repeat and picture."""
    query = f"SELECT image, repeat, detections FROM cells WHERE model = ? AND {_HERE}"
    found = [row for some in store.tuples(query, model, *(at[name] for name in CONDITIONS)) for row in some]
    return sorted(found, key=lambda row: row[:2])


def detections_at(store: Store, model: str, at: Mapping[str, Any]) -> Iterator[tuple[str, int, Detections]]:
    """(picture, repeat, detections) of the cells under the condition that the row ``at`` names."""
    for image, repeat, packed in _packed_at(store, model, at):
        yield image, repeat, unpack(packed)


def answers_at(store: Store, model: str, at: Mapping[str, Any]) -> Answers:
    """All detections under the condition that the row ``at`` names, by repeat and picture."""
    rows = _packed_at(store, model, at)
    names, repeats, packed = zip(*rows, strict=True) if rows else ((), (), ())
    return unpack_all(names, repeats, packed)


def found_when_clean(store: Store, model: str) -> Iterator[Row]:
    """Image, label and box of each target in a model's original pictures."""
    return store.rows("SELECT * FROM targets WHERE model = ? AND clean = 1", model)


def labels_when_clean(store: Store) -> dict[str, dict[str, int]]:
    """How many targets of each label a model has in its original pictures, the most frequent first."""
    query = "SELECT model, label, COUNT(*) AS n FROM targets WHERE clean = 1 GROUP BY model, label"
    found: dict[str, dict[str, int]] = {}
    for row in store.rows(f"{query} ORDER BY n DESC, label"):
        found.setdefault(row["model"], {})[row["label"]] = row["n"]
    return found


def count_rows(store: Store) -> int:
    """Rows of cells: one per cell and model."""
    return int(_values(store, "SELECT COUNT(*) FROM cells")[0])


def count_cells_of_read(store: Store) -> int:
    """Cells, each once for all models, of the pictures that are not skipped."""
    query = "SELECT COUNT(DISTINCT cell_id) FROM cells"
    skipped = f"{query} WHERE image IN (SELECT image FROM skipped)"
    return int(_values(store, f"SELECT ({query}) - ({skipped})")[0])


def has_answers(store: Store) -> bool:
    """Whether any model has answered to any cell."""
    return bool(_values(store, "SELECT 1 FROM cells WHERE error IS NULL LIMIT 1"))


def has_begun(store: Store) -> bool:
    """Whether a cell is finished or a picture is skipped."""
    return bool(_values(store, "SELECT 1 FROM cells UNION ALL SELECT 1 FROM skipped LIMIT 1"))


def counts(store: Store) -> Row:
    """n_cells, each once for all models, and n_target_rows."""
    asked = {"n_cells": "COUNT(DISTINCT cell_id) FROM cells", "n_target_rows": "COUNT(*) FROM targets"}
    return {name: _values(store, f"SELECT {query}")[0] for name, query in asked.items()}


def exposed_conditions(store: Store) -> list[Row]:
    """Every condition but that of original pictures, with the mean gain of its pictures, dB."""
    query = f"SELECT {_SHARED}, AVG(applied_gain_db) AS applied_gain_db FROM cells WHERE clean = 0"
    return list(as_set(store, store.rows(f"{query} GROUP BY {_SHARED} ORDER BY {SORTED}")))


def non_finite_values(store: Store) -> dict[str, int]:
    """By model, how many NaN and infinite values were among its outputs."""
    query = "SELECT model, TOTAL(non_finite_values) AS n FROM cells NOT INDEXED GROUP BY model"
    return {row["model"]: int(row["n"]) for row in store.rows(query)}


def errors(store: Store) -> list[Row]:
    """What models failed on, and in how many cells, the most frequent first."""
    query = "SELECT model, error, COUNT(*) AS cells FROM cells NOT INDEXED WHERE error IS NOT NULL"
    return list(store.rows(f"{query} GROUP BY model, error ORDER BY cells DESC"))


def median_simulate_ms(store: Store) -> float | None:
    """Of the exposed cells; None without any."""
    query = "SELECT simulate_ms FROM cells NOT INDEXED WHERE clean = 0 AND simulate_ms IS NOT NULL"
    found = sorted(_values(store, query))
    return float(found[len(found) // 2]) if found else None


def saturated_shares(store: Store) -> dict[tuple[float, ...], float]:
    """Mean share of saturated values over pictures, by the values of ``SETTING``, velocity and exposure."""
    query = f"SELECT {_SHARED}, AVG(saturated) AS saturated FROM cells WHERE clean = 0 GROUP BY {_SHARED}"
    rows = (row for row in store.rows(query) if row["saturated"] is not None)
    return {(*setting_of(row), *velocity_of(row), row["exposure_s"]): row["saturated"] for row in rows}


def example_files(store: Store) -> list[str]:
    """The pictures that were kept, by their paths in the run's folder."""
    return _values(store, "SELECT DISTINCT example FROM cells WHERE example IS NOT NULL")


def examples(store: Store) -> list[Row]:
    """Cells whose picture was kept, their detections unpacked: by picture, exposure, speed, then the rest."""
    order = ", ".join(("image", "clean DESC", "exposure_s", *VELOCITY, *SETTING))
    found = store.rows(f"SELECT * FROM cells WHERE example IS NOT NULL ORDER BY {order}")
    return [{**cell, "detections": unpack(cell["detections"])} for cell in as_set(store, found)]


def targets_of(store: Store, cell_id: str, model: str) -> Iterator[Row]:
    """A cell's targets before a model."""
    query = "SELECT * FROM targets WHERE cell_id = ? AND model = ? ORDER BY target_id"
    return store.rows(query, cell_id, model)


def without_targets(store: Store, model: str) -> Row:
    """``pictures``: how many have no target that the model knows; ``first``: one of them."""
    query = "SELECT COUNT(*) AS pictures, MIN(image) AS first FROM cells"
    return next(store.rows(f"{query} WHERE clean AND n_targets = 0 AND error IS NULL AND model = ?", model))


def gains_set(store: Store, model: str) -> Iterator[Row]:
    """Picture, light, exposure and gain of a model's cells whose gain the camera has set itself."""
    query = "SELECT image, illuminance_lux, exposure_s, applied_gain_db FROM cells"
    where = "WHERE model = ? AND clean = 0 AND gain_db = ? AND applied_gain_db IS NOT NULL"
    return store.rows(f"{query} {where}", model, AUTOMATIC)


_ORDER = ", ".join(f"cells.{name.strip()}" for name in ROWS.split(","))
_TABLES = {  # sorted by an index, picture by picture, in little memory
    "results": ("cells", f"cells ORDER BY {_ORDER}"),
    "targets": (
        "targets",
        "cells CROSS JOIN targets ON targets.cell_id = cells.cell_id AND targets.model = cells.model "
        f"ORDER BY {_ORDER}, targets.target_id",
    ),
}


def write_exports(store: Store, folder: Path | None = None) -> list[Path]:
    """Write results.csv (a row per cell and model) and targets.csv (a row per target of these).

    In the order of pictures and conditions, some thousands of rows at a time. Choices have their names, what the
    camera sets itself is "auto", what is not known is empty. folder: by default the run's. Raises ``OSError``.
    """
    written = []
    for name, (table, rows_of) in _TABLES.items():
        columns = store.columns(table)
        asked = ", ".join(_as_text(table, column, kind) for column, kind in columns.items())
        path = (folder or store.folder) / f"{name}.csv"
        blocks = [[tuple(columns)]], store.tuples(f"SELECT {asked} FROM {rows_of}")
        write_whole(path, (csv_text(rows).encode("utf-8") for each in blocks for rows in each))
        written.append(path)
    return written


def _as_text(table: str, name: str, kind: str) -> str:
    value = f'{table}."{name}"'
    if name in CHOICES:
        places = " ".join(f"WHEN {place} THEN '{choice}'" for place, choice in enumerate(CHOICES[name]))
        return f"CASE {value} {places} END"
    if name == "clean":
        return f"CASE WHEN {value} THEN 'True' ELSE 'False' END"
    return f"CASE WHEN {value} = 9e999 THEN 'auto' ELSE {value} END" if kind == "REAL" else value
