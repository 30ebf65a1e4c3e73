"""What is asked of a run's tables; all the package's questions in SQL stand here and in the store itself.

Rows come as the store gives them: a dictionary each, keyed by column, one at a time unless a list is said.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from blurnoise_eval.detectors.records import Answers, Detections
from blurnoise_eval.grid.axes import AUTOMATIC, SETTING, VELOCITY, setting_of, velocity_of
from blurnoise_eval.store.schema import CONDITIONS, ROWS, SORTED
from blurnoise_eval.store.store import Store, unpack, unpack_all

Row = dict[str, Any]
_SHARED = ", ".join(CONDITIONS)
_HERE = " AND ".join(f"{name} IS ?" for name in CONDITIONS)  # IS: untouched pictures have NULLs


_ORDER = ", ".join(f"c.{name.strip()}" for name in ROWS.split(","))
_IN_ORDER = {  # an index has the cells of a picture together: sorted picture by picture, in little memory
    "cells": ("cells AS c", _ORDER),
    "targets": (
        "cells AS c CROSS JOIN targets AS t ON t.cell_id = c.cell_id AND t.model = c.model",
        f"{_ORDER}, t.target_id",
    ),
}
OF = {"cells": "c", "targets": "t"}
"""By what the columns of a table are called in questions to :func:`every_row`."""


def _mean(column: str) -> str:
    """Of values that may all be the same; then that value, to the bit."""
    return f"CASE WHEN MIN({column}) = MAX({column}) THEN MIN({column}) ELSE AVG({column}) END AS {column}"


def as_set(store: Store, rows: Iterable[Row]) -> Iterator[Row]:
    """The rows; where the camera has set the exposure of each picture, with the mean over the pictures, s, in its
    setting."""
    where = ", ".join(SETTING)
    query = f"SELECT {where}, {_mean('applied_exposure_s')} FROM cells WHERE exposure_s = ? GROUP BY {where}"
    means = {setting_of(row): row["applied_exposure_s"] for row in store.rows(query, AUTOMATIC)}
    for row in rows:
        if row["exposure_s"] == AUTOMATIC:
            row = {**row, "exposure_s": means[setting_of(row)]}
        yield row


def condition_counts(store: Store, model: str) -> list[Row]:
    """Per condition of a model, untouched first: numbers of pictures, errors and targets, mean gain, dB, signal to
    noise, dB, brightness, saturated share of the pictures, and invented share of what is seen behind targets."""
    query = f"""
      SELECT model, {_SHARED}, {_mean("blur_px")}, COUNT(*) AS n_images, COUNT(error) AS errors,
        AVG(applied_gain_db) AS applied_gain_db, AVG(snr_db) AS snr_db, AVG(brightness) AS brightness,
        AVG(saturated) AS saturated, AVG(invented_share) AS invented_share, NULLIF(SUM(n_targets), 0) AS n_targets
      FROM cells WHERE model = ? GROUP BY {_SHARED} ORDER BY {SORTED}
    """
    return list(store.rows(query, model))


def target_sums(store: Store, model: str, found_score: float) -> Iterator[Row]:
    """Per condition and picture of a model: sums over its targets and readings, and how many each is of.

    Columns NAME and n_NAME, NULL and 0 where there is none. found_score: the confidence from which a target
    counts as found.
    """
    of = {
        "target_confidence": "confidence",
        "detection_rate": f"confidence >= {found_score}",
        "target_confidence_swept": "confidence_swept",
        "detection_rate_swept": f"confidence_swept >= {found_score}",
        "read_confidence": "read_confidence",
        "exact_match": "text = truth",
        "character_error_rate": "character_error_rate",
    }
    sums = ", ".join(f"TOTAL({value}) AS {name}, COUNT({value}) AS n_{name}" for name, value in of.items())
    return store.rows(
        f"SELECT {_SHARED}, image, {sums} FROM targets WHERE model = ? GROUP BY {_SHARED}, image", model
    )


def pictures_seen(store: Store) -> list[str]:
    """The pictures that any cell is of, by name."""
    return [row["image"] for row in store.rows("SELECT DISTINCT image FROM cells ORDER BY image")]


def cells_with(store: Store, **columns: Any) -> Iterator[Row]:
    """The rows of cells that hold these values in these columns."""
    where = " AND ".join(f"{name} IS ?" for name in columns)
    return store.rows(f"SELECT * FROM cells WHERE {where} ORDER BY {ROWS}", *columns.values())


def conditions(store: Store, model: str) -> list[Row]:
    """Every condition and repeat of a model: the columns ``CONDITIONS`` and ``repeat``, in their order."""
    shared = f"{_SHARED}, repeat"
    return list(store.rows(f"SELECT DISTINCT {shared} FROM cells WHERE model = ? ORDER BY {shared}", model))


def detections_at(
    store: Store, model: str, at: Mapping[str, Any], repeat: int | None = None
) -> Iterator[tuple[str, int, Detections]]:
    """(picture, repeat, detections) of the cells under the condition that the row ``at`` names; of one repeat."""
    query = f"SELECT image, repeat, detections FROM cells WHERE model = ? AND {_HERE}"
    values = [at[name] for name in CONDITIONS]
    if repeat is None:
        rows = store.rows(query, model, *values)
    else:
        rows = store.rows(f"{query} AND repeat = ? ORDER BY image", model, *values, repeat)
    for row in rows:
        yield row["image"], row["repeat"], unpack(row["detections"])


def answers_at(store: Store, model: str, at: Mapping[str, Any]) -> Answers:
    """All detections under the condition that the row ``at`` names, by repeat and picture."""
    query = f"SELECT image, repeat, detections FROM cells WHERE model = ? AND {_HERE}"
    rows = [row for some in store.tuples(query, model, *(at[name] for name in CONDITIONS)) for row in some]
    rows.sort(key=lambda row: row[:2])
    names, repeats, packed = zip(*rows, strict=True) if rows else ((), (), ())
    return unpack_all(names, repeats, packed)


def exposed_targets(store: Store) -> Iterator[Row]:
    """Rows of targets in exposed pictures, with the ``saturated`` share of the picture's values and their mean, its
    ``brightness``; those of a model, group and setting of further axes together."""
    order = ", ".join(f"targets.{name}" for name in SETTING)
    return as_set(
        store,
        store.rows(
            "SELECT targets.*, cells.saturated, cells.brightness FROM targets JOIN cells USING (cell_id, model)"
            f' WHERE targets.clean = 0 ORDER BY targets.model, "group", {order}'
        ),
    )


def found_when_clean(store: Store, model: str) -> Iterator[Row]:
    """Image, label and box of each target in a model's untouched pictures."""
    query = "SELECT image, label, x0, y0, width_px, height_px FROM targets WHERE model = ? AND clean = 1"
    return store.rows(query, model)


def groups(store: Store) -> list[Row]:
    """Per model and group of targets: how many rows, mean confidence when clean, highest confidence."""
    query = """
      SELECT model, "group", COUNT(*) AS n_targets, AVG(CASE WHEN clean THEN confidence END) AS clean_confidence,
        MAX(confidence) AS highest_confidence
      FROM targets GROUP BY model, "group"
    """
    return list(store.rows(query))


def labels_when_clean(store: Store) -> dict[str, dict[str, int]]:
    """How many targets of each label a model has in its original pictures, the most frequent first."""
    query = """
      SELECT model, label, COUNT(*) AS n FROM targets WHERE clean = 1 GROUP BY model, label ORDER BY n DESC, label
    """
    found: dict[str, dict[str, int]] = {}
    for row in store.rows(query):
        found.setdefault(row["model"], {})[row["label"]] = row["n"]
    return found


def models_seen(store: Store) -> list[str]:
    """The models that any cell is of, by name."""
    return [row["model"] for row in store.rows("SELECT DISTINCT model FROM cells ORDER BY model")]


def every_row(store: Store, table: str, asked: Sequence[str]) -> Iterator[list[tuple[Any, ...]]]:
    """What is ``asked`` of every row of "cells" or "targets", in the order of pictures and conditions."""
    tables, order = _IN_ORDER[table]
    return store.tuples(f"SELECT {', '.join(asked)} FROM {tables} ORDER BY {order}")


def count_rows(store: Store) -> int:
    """Rows of cells: one per cell and model."""
    (counted,) = store.rows("SELECT COUNT(*) AS cells FROM cells")
    return int(counted["cells"])


def count_cells_of_read(store: Store) -> int:
    """Cells, each once for all models, of the pictures that are not skipped."""
    skipped = "SELECT COUNT(DISTINCT cell_id) FROM cells WHERE image IN (SELECT image FROM skipped)"
    (counted,) = store.rows(f"SELECT (SELECT COUNT(DISTINCT cell_id) FROM cells) - ({skipped}) AS cells")
    return int(counted["cells"])


def has_answers(store: Store) -> bool:
    """Whether any model has answered to any cell."""
    return any(store.rows("SELECT 1 FROM cells WHERE error IS NULL LIMIT 1"))


def has_begun(store: Store) -> bool:
    """Whether a cell is finished or a picture is skipped."""
    return any(store.rows("SELECT 1 FROM cells UNION ALL SELECT 1 FROM skipped LIMIT 1"))


def counts(store: Store) -> Row:
    """n_cells, each once for all models, and n_target_rows."""
    (counted,) = store.rows(
        "SELECT (SELECT COUNT(DISTINCT cell_id) FROM cells) AS n_cells,"
        " (SELECT COUNT(*) FROM targets) AS n_target_rows"
    )
    return counted


def exposed_conditions(store: Store) -> list[Row]:
    """Every condition but the untouched one, with the mean gain of its pictures, dB."""
    query = f"SELECT {_SHARED}, AVG(applied_gain_db) AS applied_gain_db FROM cells WHERE clean = 0"
    return list(as_set(store, store.rows(f"{query} GROUP BY {_SHARED} ORDER BY {SORTED}")))


def errors(store: Store) -> list[Row]:
    """What models failed on, and in how many cells, the most frequent first."""
    query = "SELECT model, error, COUNT(*) AS cells FROM cells NOT INDEXED WHERE error IS NOT NULL"
    query += " GROUP BY model, error"
    return list(store.rows(f"{query} ORDER BY cells DESC"))


def median_simulate_ms(store: Store) -> float | None:
    """Of the exposed cells; None without any."""
    query = "SELECT simulate_ms FROM cells NOT INDEXED WHERE clean = 0 AND simulate_ms IS NOT NULL"
    found = sorted(row[0] for rows in store.tuples(query) for row in rows)
    return float(found[len(found) // 2]) if found else None


def saturated_shares(store: Store) -> dict[tuple[float, ...], float]:
    """Mean share of saturated values over pictures, by the values of ``SETTING``, velocity and exposure."""
    query = f"SELECT {_SHARED}, AVG(saturated) AS saturated FROM cells WHERE clean = 0 GROUP BY {_SHARED}"
    return {
        (*setting_of(row), *velocity_of(row), row["exposure_s"]): row["saturated"]
        for row in store.rows(query)
        if row["saturated"] is not None
    }


def example_files(store: Store) -> list[str]:
    """The pictures that were kept, by their paths in the run's folder."""
    return [
        row["example"] for row in store.rows("SELECT DISTINCT example FROM cells WHERE example IS NOT NULL")
    ]


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
    query = """SELECT COUNT(*) AS pictures, MIN(image) AS first FROM cells
      WHERE clean AND n_targets = 0 AND error IS NULL AND model = ?"""
    (counted,) = store.rows(query, model)
    return counted


def gains_set(store: Store, model: str) -> Iterator[Row]:
    """``image``, ``illuminance_lux``, ``exposure_s`` and ``applied_gain_db`` of a model's cells whose gain the camera
    has set itself."""
    return store.rows(
        "SELECT image, illuminance_lux, exposure_s, applied_gain_db FROM cells"
        " WHERE model = ? AND clean = 0 AND gain_db = ? AND applied_gain_db IS NOT NULL",
        model,
        AUTOMATIC,
    )
