"""The SQL queries of the package, but for those of the store itself; its tables as CSV, and as columns.

A row is a dictionary by column. Most functions yield one row at a time. The targets of a model are also available as
columns, about 100 bytes a row, which are kept while the store is open and its rows do not change.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.detectors.records import Answers, Detections
from blurnoise_eval.plan.axes import AUTOMATIC, CHOICES, SETTING, VELOCITY, setting_of, velocity_of
from blurnoise_eval.store.schema import CONDITIONS, ROWS, SORTED
from blurnoise_eval.store.store import Store, unpack, unpack_all
from blurnoise_eval.system.files import write_whole
from blurnoise_eval.system.tables import csv_text

Row = dict[str, Any]
_SHARED = ", ".join(CONDITIONS)
_MISSED = "missed_pulse"
_HERE = " AND ".join(f"{name} IS ?" for name in CONDITIONS)  # IS: original pictures have NULLs


def _mean(column: str) -> str:
    """The mean; of values that are all the same that value, without rounding."""
    return f"CASE WHEN MIN({column}) = MAX({column}) THEN MIN({column}) ELSE AVG({column}) END AS {column}"


def _values(store: Store, query: str, *values: object) -> list[Any]:
    """The only column of all rows."""
    return [row[0] for rows in store.tuples(query, *values) for row in rows]


def as_set(store: Store, rows: Iterable[Row]) -> Iterator[Row]:
    """The rows; where the camera sets the exposure, with the mean exposure of the pictures of that setting, s."""
    where = ", ".join(SETTING)
    query = f"SELECT {where}, {_mean('applied_exposure_s')} FROM cells WHERE exposure_s = ? GROUP BY {where}"
    means = {setting_of(row): row["applied_exposure_s"] for row in store.rows(query, AUTOMATIC)}
    for row in rows:
        if row["exposure_s"] == AUTOMATIC:
            row = {**row, "exposure_s": means[setting_of(row)]}
        yield row


def condition_counts(store: Store, model: str) -> list[Row]:
    """Per condition of a model, original pictures first: numbers of pictures, errors and targets, and means of
    blur, gain, signal to noise, brightness, saturated and inpainted shares; with a pulsed lamp, of missed pulses."""
    names = ("applied_gain_db", "snr_db", "brightness", "saturated_share", "inpainted_share")
    means = ", ".join(f"AVG({name}) AS {name}" for name in names)
    if _MISSED in store.columns("cells"):
        means += f", AVG({_MISSED}) AS {_MISSED}_share"
    query = f"""
      SELECT model, {_SHARED}, {_mean("blur_px")}, COUNT(*) AS n_pictures, COUNT(error) AS errors, {means},
        NULLIF(SUM(n_targets), 0) AS n_targets
      FROM cells WHERE model = ? GROUP BY {_SHARED} ORDER BY {SORTED}
    """
    return list(store.rows(query, model))


def target_sums(store: Store, model: str) -> Iterator[Row]:
    """Per condition of a model: the sum of its targets' confidences, and how many these are."""
    sums = "TOTAL(confidence) AS target_confidence, COUNT(confidence) AS n_target_confidence"
    return store.rows(f"SELECT {_SHARED}, {sums} FROM targets WHERE model = ? GROUP BY {_SHARED}", model)


def pictures_seen(store: Store) -> list[str]:
    """The names of the pictures that have cells."""
    return _values(store, "SELECT DISTINCT image FROM cells ORDER BY image")


def models_seen(store: Store) -> list[str]:
    """The names of the models that have cells."""
    return _values(store, "SELECT DISTINCT model FROM cells ORDER BY model")


def cells_with(store: Store, **columns: Any) -> Iterator[Row]:
    """The rows of cells with these values in these columns."""
    where = " AND ".join(f"{name} IS ?" for name in columns)
    return store.rows(f"SELECT * FROM cells WHERE {where} ORDER BY {ROWS}", *columns.values())


def detections_of(store: Store, model: str) -> Iterator[tuple[str, str, Detections]]:
    """(cell's id, picture, detections) of a model's cells."""
    for rows in store.tuples("SELECT cell_id, image, detections FROM cells WHERE model = ?", model):
        for cell_id, image, packed in rows:
            yield cell_id, image, unpack(packed)


def answers_at(store: Store, model: str, at: Mapping[str, Any]) -> Answers:
    """All detections under the condition of the row ``at``, by repeat and picture."""
    query = f"SELECT image, repeat, detections FROM cells WHERE model = ? AND {_HERE}"
    found = [row for some in store.tuples(query, model, *(at[name] for name in CONDITIONS)) for row in some]
    rows = sorted(found, key=lambda row: row[:2])
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
    """The number of cells, each once for all models, of pictures that are not skipped."""
    query = "SELECT COUNT(DISTINCT cell_id) FROM cells"
    skipped = f"{query} WHERE image IN (SELECT image FROM skipped)"
    return int(_values(store, f"SELECT ({query}) - ({skipped})")[0])


def has_answers(store: Store) -> bool:
    """Whether any cell was computed without an error."""
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
    """The errors of models with their numbers of cells, the most frequent first."""
    query = "SELECT model, error, COUNT(*) AS cells FROM cells NOT INDEXED WHERE error IS NOT NULL"
    return list(store.rows(f"{query} GROUP BY model, error ORDER BY cells DESC"))


def median_simulate_ms(store: Store) -> float | None:
    """Median time of the exposed cells; None without any."""
    query = "SELECT simulate_ms FROM cells NOT INDEXED WHERE clean = 0 AND simulate_ms IS NOT NULL"
    found = sorted(_values(store, query))
    return float(found[len(found) // 2]) if found else None


def saturated_shares(store: Store) -> dict[tuple[float, ...], float]:
    """Mean share of saturated values over pictures, by the values of ``SETTING``, velocity and exposure."""
    query = f"SELECT {_SHARED}, AVG(saturated_share) AS share FROM cells WHERE clean = 0 GROUP BY {_SHARED}"
    rows = (row for row in store.rows(query) if row["share"] is not None)
    return {(*setting_of(row), *velocity_of(row), row["exposure_s"]): row["share"] for row in rows}


def example_files(store: Store) -> list[str]:
    """The pictures that were kept, by their paths in the run's folder."""
    return _values(store, "SELECT DISTINCT example FROM cells WHERE example IS NOT NULL")


def examples(store: Store) -> list[Row]:
    """Cells whose picture was kept, their detections unpacked: by picture, exposure, speed, then the rest."""
    order = ", ".join(("image", "clean DESC", "exposure_s", *VELOCITY, *SETTING))
    found = store.rows(f"SELECT * FROM cells WHERE example IS NOT NULL ORDER BY {order}")
    return [{**cell, "detections": unpack(cell["detections"])} for cell in as_set(store, found)]


def targets_of(store: Store, cell_id: str, model: str) -> Iterator[Row]:
    """The targets of a cell, as a model found them."""
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

    Rows are in the order of pictures and conditions. Choices have their names, values that the camera sets are
    "auto", unknown values are empty. folder: by default the run's. Raises ``OSError``.
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


Array = NDArray[np.float64]
Places = NDArray[np.int32]
_OF_PICTURE = ("saturated_share", "brightness")
_EXACT = "CASE WHEN truth IS NULL THEN NULL ELSE text IS truth END"
_OF_TARGET = (_EXACT, "confidence", "confidence_swept", "read_confidence", "character_error_rate")
_MOST_KEPT = 5_000_000
"""Rows of a model, about 100 bytes each."""


class TargetColumns(NamedTuple):
    """N rows of targets.

    conditions: values of ``CONDITIONS``, sorted; pictures, groups: names, sorted; the columns ``condition``,
    ``picture`` and ``group`` hold places in them. exact: whether the text was read, NaN where there is none.
    """

    conditions: Sequence[tuple[Any, ...]]
    pictures: Sequence[str]
    groups: Sequence[str]
    condition: Places
    picture: Places
    group: Places
    repeat: Places
    target_id: Places
    exact: Array
    confidence: Array
    confidence_swept: Array
    read_confidence: Array
    character_error_rate: Array
    saturated: Array
    brightness: Array
    missed_pulse: Array

    def rows(self, of: NDArray[Any]) -> TargetColumns:
        """Some of the rows, by places or flags."""
        return TargetColumns(*self[:3], *(column[of] for column in self[3:]))


def target_columns(store: Store, model: str) -> TargetColumns:
    """All targets of a model. They are kept until the store grows."""
    columns: TargetColumns = store.memory.get(model) or _read(store, model)
    if len(columns.condition) <= _MOST_KEPT:
        store.memory[model] = columns
    return columns


def _read(store: Store, model: str) -> TargetColumns:
    missed = _MISSED if _MISSED in store.columns("cells") else f"NULL AS {_MISSED}"
    names = ("image", '"group"', "repeat", "target_id", *_OF_TARGET, *_OF_PICTURE, _MISSED)
    of_picture = ", ".join((*_OF_PICTURE, missed))
    query = f"""
      SELECT {", ".join(f"targets.{name}" for name in CONDITIONS)}, {", ".join(names)}
      FROM targets JOIN (SELECT cell_id, model, {of_picture} FROM cells) USING (cell_id, model)
      WHERE model = ?
    """
    start = len(CONDITIONS)
    conditions, pictures, groups = dict[Any, int](), dict[str, int](), dict[str, int]()
    blocks = [np.empty((0, 1 + len(names)))]
    for rows in store.tuples(query, model):
        coded = [
            (
                conditions.setdefault(row[:start], len(conditions)),
                pictures.setdefault(row[start], len(pictures)),
                groups.setdefault(row[start + 1], len(groups)),
                *row[start + 2 :],
            )
            for row in rows
        ]
        blocks.append(np.array(coded, float))  # NaN for None
    table = np.concatenate(blocks)
    codes = table[:, :5].astype(np.int32).T
    named = [_sorted(*each) for each in zip((conditions, pictures, groups), codes, strict=False)]
    columns = [*(ranks for _, ranks in named), *codes[3:], *table[:, 5:].T]
    order = np.lexsort((columns[4], columns[3], columns[1], columns[0]))
    every: list[Any] = [*(names for names, _ in named), *(column[order] for column in columns)]
    return TargetColumns(*every)


def _sorted(codes: dict[Any, int], column: Places) -> tuple[list[Any], Places]:
    """Names, sorted, conditions with None first; and the column of codes as places in that."""

    def key(name: Any) -> Any:
        return name if isinstance(name, str) else tuple(-1.0 if value is None else value for value in name)

    names = sorted(codes, key=key)
    rank = np.empty(len(codes), np.int32)
    rank[[codes[name] for name in names]] = np.arange(len(codes))
    return names, rank[column]
