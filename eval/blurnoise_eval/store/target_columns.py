"""Targets of a model as columns: what scores and surfaces are made of, where a dictionary for each row is too much.

About 100 bytes a row, kept while the store is open and its rows stay. NaN where the store has nothing. Rows are
ordered by condition, picture, repeat and target, so that what is added up does not depend on who computed first.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.store.schema import CONDITIONS
from blurnoise_eval.store.store import Store

Array = NDArray[np.float64]
Places = NDArray[np.int32]
_OF_PICTURE = ("saturated", "brightness")
_EXACT = "CASE WHEN truth IS NULL THEN NULL ELSE text IS truth END"
_OF_TARGET = (_EXACT, "confidence", "confidence_swept", "read_confidence", "character_error_rate")
_MOST_KEPT = 5_000_000
"""Rows of a store, of all models."""


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

    def rows(self, of: NDArray[Any]) -> TargetColumns:
        """Some of the rows, by places or flags."""
        return TargetColumns(*self[:3], *(column[of] for column in self[3:]))


_KEPT: WeakKeyDictionary[Store, dict[str, tuple[int, TargetColumns]]] = WeakKeyDictionary()
"""By store and model what was read, and at which revision."""


def target_columns(store: Store, model: str) -> TargetColumns:
    """All targets of a model. They are kept until the store grows."""
    kept = _KEPT.setdefault(store, {})
    revision, columns = kept.pop(model, (-1, None))
    if columns is None or revision != store.revision:
        columns = _read(store, model)
    if sum(len(each.condition) for each in (columns, *(held for _, held in kept.values()))) <= _MOST_KEPT:
        kept[model] = store.revision, columns
    return columns


def _read(store: Store, model: str) -> TargetColumns:
    """Each table as it lies on the disk, in place of a join: that would look up every cell on its own."""
    conditions, pictures, groups = dict[Any, int](), dict[str, int](), dict[str, int]()
    cell_of = dict[str, int]()
    asked = ", ".join(("cell_id", "image", "repeat", *_OF_PICTURE, *CONDITIONS))
    of_cells, start = [_columns(3, len(_OF_PICTURE), ())], 3 + len(_OF_PICTURE)
    for rows in store.tuples(f"SELECT {asked} FROM cells NOT INDEXED WHERE model = ?", model):
        cell_of.update((row[0], place) for place, row in enumerate(rows, start=len(cell_of)))
        at = [conditions.setdefault(row[start:], len(conditions)) for row in rows]
        of = [pictures.setdefault(row[1], len(pictures)) for row in rows]
        coded = [(*codes, *row[2:start]) for *codes, row in zip(at, of, rows, strict=True)]
        of_cells.append(_columns(3, len(_OF_PICTURE), coded))
    condition, picture, repeat, *of_picture = map(np.concatenate, zip(*of_cells, strict=True))
    of_targets = [_columns(3, len(_OF_TARGET), ())]
    asked = ", ".join(("cell_id", '"group"', "target_id", *_OF_TARGET))
    for rows in store.tuples(f"SELECT {asked} FROM targets NOT INDEXED WHERE model = ?", model):
        if missing := {row[0] for row in rows}.difference(cell_of):
            raise store.damaged("targets.cell_id", f"{min(missing)!r} is none of the cells")
        coded = [(cell_of[row[0]], groups.setdefault(row[1], len(groups)), *row[2:]) for row in rows]
        of_targets.append(_columns(3, len(_OF_TARGET), coded))
    cell, group, target_id, *of_target = map(np.concatenate, zip(*of_targets, strict=True))
    codes_of = (conditions, condition[cell]), (pictures, picture[cell]), (groups, group)
    names, ranks = zip(*(_sorted(*each) for each in codes_of), strict=True)
    columns = [*ranks, repeat[cell], target_id, *of_target, *(each[cell] for each in of_picture)]
    order = np.lexsort((columns[4], columns[3], columns[1], columns[0]))
    every: list[Any] = [*names, *(column[order] for column in columns)]
    return TargetColumns(*every)


def _columns(n_codes: int, n_values: int, rows: Sequence[Sequence[Any]]) -> list[NDArray[Any]]:
    """Rows as columns: the first whole numbers, the others NaN where there is none."""
    kinds = [np.int32] * n_codes + [np.float64] * n_values
    columns = zip(*rows, strict=True) if rows else [()] * len(kinds)
    return [np.array(column, kind) for column, kind in zip(columns, kinds, strict=True)]


def _sorted(codes: dict[Any, int], column: Places) -> tuple[list[Any], Places]:
    """The names that a column of codes uses, sorted, and their places in that; conditions with None first."""

    def key(name: Any) -> Any:
        return name if isinstance(name, str) else tuple(-1.0 if value is None else value for value in name)

    used = np.unique(column)
    names = np.empty(len(codes), object)
    names[:] = list(codes)
    ordered = sorted((names[code] for code in used), key=key)
    rank = np.zeros(len(codes), np.int32)
    for place, name in enumerate(ordered):
        rank[codes[name]] = place
    return ordered, rank[column]
