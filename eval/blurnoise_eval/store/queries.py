"""The SQL queries of the package, but for those of the store itself; its tables as CSV, and as columns.

The targets of a model are available as arrays, about 100 bytes a row, which are kept while the store is open and its
rows do not change.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.detectors.records import Answers, Detections
from blurnoise_eval.plan.axes import CHOICES, NAMES, SETTING, VELOCITY, setting_of
from blurnoise_eval.plan.typed import AUTOMATIC
from blurnoise_eval.store.columns import CONDITIONS, AxisValues, TableColumn, columns_of
from blurnoise_eval.store.rows import MEANS, CellRow, ScoreRow, TargetRow
from blurnoise_eval.store.schema import ROWS, SORTED
from blurnoise_eval.store.store import Store, unpack, unpack_all
from blurnoise_eval.system.files import write_whole
from blurnoise_eval.system.tables import csv_text

_SHARED = ", ".join(CONDITIONS)
_MISSED = "missed_pulse"
_AT = " AND ".join(f"{name} IS ?" for name in CONDITIONS)  # IS: original pictures have NULLs


def _mean(column: str) -> str:
    """The mean; of values that are all the same that value, without rounding."""
    return f"CASE WHEN MIN({column}) = MAX({column}) THEN MIN({column}) ELSE AVG({column}) END"


def _in_order(columns: Iterable[str], where: str) -> str:
    """Rows of cells in an order of their own: the last digit of SQLite's AVG depends on that of its rows, which is
    otherwise that in which threads or parts of a run have computed them."""
    return f"(SELECT {', '.join(columns)} FROM cells WHERE {where} ORDER BY {SORTED}, image, repeat, model)"


def _values(store: Store, query: str, *values: object) -> list[Any]:
    """The only column of all rows."""
    return [value for (value,) in store.rows(query, *values)]


def _condition(at: AxisValues) -> tuple[Any, ...]:
    """The values of ``CONDITIONS``."""
    return at.original, *at.numbers


def as_set(store: Store, conditions: Iterable[AxisValues]) -> list[AxisValues]:
    """The conditions; where the camera sets the exposure, with the mean exposure of that setting's pictures, s."""
    where = ", ".join(SETTING)
    rows = _in_order((*SETTING, "applied_exposure_s"), "exposure_s = ?")
    query = f"SELECT {where}, {_mean('applied_exposure_s')} FROM {rows} GROUP BY {where}"
    means = {tuple(setting): mean for *setting, mean in store.rows(query, AUTOMATIC)}
    return [
        at.but(exposure_s=means[setting_of(at)]) if at["exposure_s"] == AUTOMATIC else at for at in conditions
    ]


def condition_counts(store: Store, model: str) -> list[ScoreRow]:
    """Rows without scores of every condition of a model, original pictures first."""
    means = ", ".join(f"AVG({name})" for name in MEANS)
    missed = (_MISSED,) * bool(store.lamp_columns())
    lamps = "".join(f", AVG({name})" for name in missed)
    columns = ("model", *CONDITIONS, "blur_px", "n_targets", "error", *MEANS, *missed)
    query = f"""
      SELECT model, {_SHARED}, {_mean("blur_px")}, COUNT(*), NULLIF(SUM(n_targets), 0), COUNT(error), {means}{lamps}
      FROM {_in_order(columns, "model = ?")} GROUP BY {_SHARED} ORDER BY {SORTED}
    """
    return list(map(ScoreRow.read, store.rows(query, model)))


def pictures_seen(store: Store) -> list[str]:
    """The names of the pictures that have cells."""
    return _values(store, "SELECT DISTINCT image FROM cells ORDER BY image")


def models_seen(store: Store) -> list[str]:
    """The names of the models that have cells."""
    return _values(store, "SELECT DISTINCT model FROM cells ORDER BY model")


def cells_with(store: Store, **columns: Any) -> Iterator[CellRow]:
    """The rows of cells with these values in these columns."""
    where = " AND ".join(f"{name} IS ?" for name in columns)
    return store.cells(where, *columns.values())


def cells_at(store: Store, model: str, at: AxisValues, image: str, repeat: int) -> list[CellRow]:
    """A model's cell of a picture under a condition, none where it was not computed."""
    where = f"model = ? AND image = ? AND repeat = ? AND {_AT}"
    return list(store.cells(where, model, image, repeat, *_condition(at)))


def detections_of(store: Store, model: str) -> Iterator[tuple[str, str, Detections]]:
    """(cell's id, picture, detections) of a model's cells."""
    rows = store.rows("SELECT cell_id, image, detections FROM cells WHERE model = ?", model)
    return ((cell_id, image, unpack(packed)) for cell_id, image, packed in rows)


def answers_at(store: Store, model: str, at: AxisValues) -> Answers:
    """All detections under a condition, by repeat and picture."""
    query = f"SELECT image, repeat, detections FROM cells WHERE model = ? AND {_AT}"
    rows = sorted(store.rows(query, model, *_condition(at)), key=lambda row: row[:2])
    names, repeats, packed = zip(*rows, strict=True) if rows else ((), (), ())
    return unpack_all(names, repeats, packed)


def targets_when_clean(store: Store, model: str) -> Iterator[TargetRow]:
    """The targets in a model's original pictures."""
    return store.targets("model = ? AND clean = 1", model, order="rowid")


def labels(store: Store) -> list[str]:
    """The classes of the run's targets."""
    return [str(label) for (label,) in store.rows("SELECT DISTINCT label FROM targets ORDER BY label")]


def labels_when_clean(store: Store) -> dict[str, dict[str, int]]:
    """How many targets of each label a model has in its original pictures, the most frequent first."""
    query = "SELECT model, label, COUNT(*) AS n FROM targets WHERE clean = 1 GROUP BY model, label"
    counts: dict[str, dict[str, int]] = {}
    for model, label, count in store.rows(f"{query} ORDER BY n DESC, label"):
        counts.setdefault(model, {})[label] = count
    return counts


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


def counts(store: Store) -> dict[str, int]:
    """n_cells, each once for all models, and n_target_rows."""
    asked = {"n_cells": "COUNT(DISTINCT cell_id) FROM cells", "n_target_rows": "COUNT(*) FROM targets"}
    return {name: _values(store, f"SELECT {query}")[0] for name, query in asked.items()}


def complete_picture(store: Store, model: str, cells: int) -> str | None:
    """A picture with targets of which so many cells are there; None without."""
    query = (
        "SELECT image FROM cells WHERE model = ? GROUP BY image "
        "HAVING COUNT(*) >= ? AND MAX(target_confidence) IS NOT NULL ORDER BY image LIMIT 1"
    )
    return next((image for (image,) in store.rows(query, model, cells)), None)


def mean_confidences(store: Store, model: str, image: str) -> Iterator[tuple[float, float, float]]:
    """Of each light and exposure of a picture its mean confidence over all other conditions.

    Lux by lux, the highest mean first, of equal ones the shortest exposure.
    """
    query = (
        "SELECT illuminance_lux, exposure_s, AVG(target_confidence) AS mean FROM cells "
        "WHERE model = ? AND image = ? AND NOT clean AND target_confidence IS NOT NULL "
        "GROUP BY 1, 2 ORDER BY 1, mean DESC, 2"
    )
    yield from store.rows(query, model, image)


def non_finite_values(store: Store) -> dict[str, int]:
    """By model, how many NaN and infinite values were among its outputs."""
    query = "SELECT model, TOTAL(non_finite_values) FROM cells NOT INDEXED GROUP BY model"
    return {model: int(count) for model, count in store.rows(query)}


def errors(store: Store) -> list[dict[str, Any]]:
    """The errors of models with their numbers of cells, the most frequent first."""
    # NOT INDEXED: all rows are read anyway, which is faster in the order of the file.
    query = "SELECT model, error, COUNT(*) AS cells FROM cells NOT INDEXED WHERE error IS NOT NULL"
    rows = store.rows(f"{query} GROUP BY model, error ORDER BY cells DESC")
    return [{"model": model, "error": error, "cells": count} for model, error, count in rows]


def median_simulate_ms(store: Store) -> float | None:
    """Median time of the exposed cells; None without any."""
    query = "SELECT simulate_ms FROM cells NOT INDEXED WHERE clean = 0 AND simulate_ms IS NOT NULL"
    # SQLite has no median.
    times_ms = sorted(_values(store, query))
    return float(times_ms[len(times_ms) // 2]) if times_ms else None


def saturated_shares(store: Store) -> dict[tuple[float, ...], float]:
    """Mean share of saturated values over pictures, by the values of ``SETTING``, velocity and exposure."""
    names = ", ".join((*SETTING, *VELOCITY, "exposure_s"))
    query = f"SELECT {names}, AVG(saturated_share) FROM cells WHERE clean = 0 GROUP BY {_SHARED}"
    return {tuple(at): share for *at, share in store.rows(query) if share is not None}


def example_files(store: Store) -> list[str]:
    """The pictures that were kept, by their paths in the run's folder."""
    return _values(store, "SELECT DISTINCT example FROM cells WHERE example IS NOT NULL")


def examples(store: Store) -> list[CellRow]:
    """Cells whose picture was kept: by picture, exposure, speed, then the rest."""
    order = ", ".join(("image", "clean DESC", "exposure_s", *VELOCITY, *SETTING))
    cells = list(store.cells("example IS NOT NULL", order=order))
    conditions = as_set(store, [cell.conditions for cell in cells])
    return [replace(cell, conditions=at) for cell, at in zip(cells, conditions, strict=True)]


def targets_of(store: Store, cell_id: str, model: str) -> Iterator[TargetRow]:
    """The targets of a cell, as a model found them."""
    return store.targets("cell_id = ? AND model = ?", cell_id, model, order="target_id")


def without_targets(store: Store, model: str) -> tuple[int, str | None]:
    """How many pictures have no target that the model knows, and the first of them."""
    query = (
        "SELECT COUNT(*), MIN(image) FROM cells WHERE clean AND n_targets = 0 AND error IS NULL AND model = ?"
    )
    ((count, first),) = store.rows(query, model)
    return count, first


def gains_set(store: Store, model: str) -> Iterator[tuple[str, float, float, float]]:
    """(picture, light, exposure, gain) of a model's cells whose gain the camera has set itself."""
    query = "SELECT image, illuminance_lux, exposure_s, applied_gain_db FROM cells"
    where = "WHERE model = ? AND clean = 0 AND gain_db = ? AND applied_gain_db IS NOT NULL"
    return store.rows(f"{query} {where}", model, AUTOMATIC)


def light_spread_ev(store: Store, gain_max_db: float) -> float | None:
    """The standard deviation of the pictures' mean light, EV, by the gains that the camera has set for them.

    It is read where the fewest gains are at a limit, and is None if these are more than a tenth, or fewer than five.
    A gain of 6.02 dB more is half of the light.
    """
    pictures = len(pictures_seen(store))
    within = (
        "applied_gain_db > 0.01 AND applied_gain_db < ?"  # nearer to a limit gains do not follow the light
    )
    rows = _in_order((*CONDITIONS, "repeat", "model", "applied_gain_db"), f"gain_db = ? AND {within}")
    query = f"""
      SELECT COUNT(*) AS n, AVG(applied_gain_db * applied_gain_db) - AVG(applied_gain_db) * AVG(applied_gain_db)
      FROM {rows} WHERE exposure_s <> ? GROUP BY {_SHARED}, repeat, model
      ORDER BY n DESC, illuminance_lux LIMIT 1
    """
    for count, variance_db2 in store.rows(query, AUTOMATIC, gain_max_db - 0.01, AUTOMATIC):
        if count >= max(5, 0.9 * pictures):
            return math.sqrt(max(0.0, variance_db2)) / (20 * math.log10(2))
    return None


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
    columns_in = {
        "cells": [*columns_of(CellRow, optional=bool(store.lamp_columns()))],
        "targets": columns_of(TargetRow),
    }
    for name, (table, rows_of) in _TABLES.items():
        columns = columns_in[table]
        asked = ", ".join(_as_text(table, column) for column in columns)
        path = (folder or store.folder) / f"{name}.csv"
        blocks = [[tuple(column.name for column in columns)]], store.blocks(f"SELECT {asked} FROM {rows_of}")
        write_whole(path, (csv_text(rows).encode("utf-8") for each in blocks for rows in each))
        written.append(path)
    return written


def _as_text(table: str, column: TableColumn) -> str:
    name, value = column.name, f'{table}."{column.name}"'
    if name in CHOICES:
        axis = CHOICES[name]
        places = " ".join(f"WHEN {place} THEN '{choice}'" for place, choice in enumerate(axis.choices))
        numbered = f"CASE WHEN {value} IS NOT NULL THEN '{axis.prefix}' || printf('%.15g', {value}) END"
        return f"CASE {value} {places} ELSE {numbered if axis.prefix else 'NULL'} END"
    if name == "clean":
        return f"CASE WHEN {value} THEN 'True' ELSE 'False' END"
    # 9e999 is SQLite's infinity, which stands for what the camera sets.
    return f"CASE WHEN {value} = 9e999 THEN 'auto' ELSE {value} END" if column.kind == "REAL" else value


Array = NDArray[np.float64]
Places = NDArray[np.int32]
_OF_PICTURE = ("saturated_share", "brightness")
_EXACT = "CASE WHEN truth IS NULL THEN NULL ELSE text IS truth END"
_OF_TARGET = (_EXACT, "confidence", "confidence_swept", "read_confidence", "character_error_rate")
_MOST_KEPT = 5_000_000
"""Rows of a model, about 100 bytes each."""


class TargetColumns(NamedTuple):
    """N rows of targets.

    conditions: sorted, the original pictures first; pictures, groups: names, sorted; the columns ``condition``,
    ``picture`` and ``group`` index them. exact: whether the text was read, NaN where there is none.
    """

    conditions: Sequence[AxisValues]
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
        """Some of the rows, by indices or flags."""
        return TargetColumns(*self[:3], *(column[of] for column in self[3:]))


def target_columns(store: Store, model: str) -> TargetColumns:
    """All targets of a model. They are kept until the store grows."""
    columns: TargetColumns = store.memory.get(model) or _read(store, model)
    if len(columns.condition) <= _MOST_KEPT:
        store.memory[model] = columns
    return columns


def _read(store: Store, model: str) -> TargetColumns:
    missed = _MISSED if store.lamp_columns() else f"NULL AS {_MISSED}"
    names = ("image", '"group"', "repeat", "target_id", *_OF_TARGET, *_OF_PICTURE, _MISSED)
    of_picture = ", ".join((*_OF_PICTURE, missed))
    query = f"""
      SELECT {", ".join(f"targets.{name}" for name in NAMES)}, {", ".join(names)}
      FROM targets JOIN (SELECT cell_id, model, {of_picture} FROM cells) USING (cell_id, model)
      WHERE model = ?
    """
    start = len(NAMES)
    conditions, pictures, groups = dict[tuple[float | None, ...], int](), dict[str, int](), dict[str, int]()
    blocks = [np.empty((0, 1 + len(names)))]
    for rows in store.blocks(query, model):
        # Codes in place of texts: a block of numbers is small, and Python's rows go as soon as it is made.
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
    of_names: list[dict[Any, int]] = [conditions, pictures, groups]
    named = [_sorted(*each) for each in zip(of_names, codes, strict=False)]
    columns = [*(ranks for _, ranks in named), *codes[3:], *table[:, 5:].T]
    # By condition, picture, repeat and target: rows come in the order in which threads have finished.
    order = np.lexsort((columns[4], columns[3], columns[1], columns[0]))
    tested, *others = (names for names, _ in named)
    every: list[Any] = [list(map(AxisValues, tested)), *others, *(column[order] for column in columns)]
    return TargetColumns(*every)


def _sorted(codes: dict[Any, int], column: Places) -> tuple[list[Any], Places]:
    """Keys, sorted, of numbers the original pictures first; and the column of codes as indices into these."""

    def order(key: Any) -> Any:
        if isinstance(key, str):
            return key
        return any(value is not None for value in key), tuple(value or 0.0 for value in key)

    keys = sorted(codes, key=order)
    rank = np.empty(len(codes), np.int32)
    rank[[codes[key] for key in keys]] = np.arange(len(codes))
    return keys, rank[column]
