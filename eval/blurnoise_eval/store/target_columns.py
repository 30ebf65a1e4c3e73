"""Targets of a model as columns: what scores and surfaces are made of, where a dictionary for each row is too much.

About 100 bytes a row, kept while the store is open and its rows stay. NaN where the store has nothing. Rows are
ordered by condition, picture, repeat and target, so that what is added up does not depend on who computed first.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.store.schema import CONDITIONS
from blurnoise_eval.store.store import Store

Array = NDArray[np.float64]
Places = NDArray[np.int32]
_OF_TARGET = ("confidence", "confidence_swept", "read_confidence", "character_error_rate")
_OF_PICTURE = ("saturated", "brightness")
_KEYS: tuple[Callable[[Any], Any], ...] = (
    lambda at: tuple(-1.0 if value is None else value for value in at),
    str,
    str,
)
"""By what conditions, pictures and groups are sorted."""
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


class _Held(NamedTuple):
    """What was read of a model, at which revision of the store, up to which rowids of cells and targets."""

    revision: int
    rowids: tuple[int, int]
    columns: TargetColumns


_KEPT: WeakKeyDictionary[Store, dict[str, _Held]] = WeakKeyDictionary()
"""By store and model."""


def target_columns(store: Store, model: str) -> TargetColumns:
    """All targets of a model. They are kept, and of a store that has grown the new rows alone are read."""
    kept = _KEPT.setdefault(store, {})
    held = kept.pop(model, None)
    if held is None or held.revision != store.revision:
        before = held
        held = _read(store, model, before)
        rows = store.tuples("SELECT COUNT(*) FROM targets WHERE model = ?", model)
        if before is not None and next(rows) != [(len(held.columns.condition),)]:  # some were replaced
            held = _read(store, model, None)
    if sum(len(each.columns.condition) for each in (held, *kept.values())) <= _MOST_KEPT:
        kept[model] = held
    return held.columns


def _read(store: Store, model: str, before: _Held | None) -> _Held:
    """What came after ``before``, with it; each table as it lies on the disk, in place of a join: that would look up
    every cell on its own."""
    last_cell, last_target = (0, 0) if before is None else before.rowids
    conditions, pictures, groups = seen = dict[Any, int](), dict[Any, int](), dict[Any, int]()
    place_of: dict[str, int] = {}
    of_cells = [[np.zeros(0, np.int32)] * 3 + [np.zeros(0)] * len(_OF_PICTURE)]
    asked = ", ".join(("rowid", "cell_id", "image", "repeat", *_OF_PICTURE, *CONDITIONS))
    query = f"SELECT {asked} FROM cells NOT INDEXED WHERE rowid > ? AND model = ? ORDER BY rowid"
    for rows in store.tuples(query, last_cell, model):
        (*_, last_cell), ids, images, repeats, *measured = list(zip(*rows, strict=True))[: -len(CONDITIONS)]
        place_of.update(zip(ids, range(len(place_of), len(place_of) + len(ids)), strict=True))
        codes = (
            [conditions.setdefault(row[-len(CONDITIONS) :], len(conditions)) for row in rows],
            [pictures.setdefault(name, len(pictures)) for name in images],
            repeats,
        )
        of_cells.append([*_whole(*codes), *(np.array(each, float) for each in measured)])
    condition, picture, repeat, *pictured = _joined(of_cells)
    of_targets = [[np.zeros(0, np.int32)] * 3 + [np.zeros(0)] * (1 + len(_OF_TARGET))]
    exact = "CASE WHEN truth IS NULL THEN NULL ELSE text IS truth END"
    asked = ", ".join(("rowid", "cell_id", '"group"', "target_id", exact, *_OF_TARGET))
    query = f"SELECT {asked} FROM targets NOT INDEXED WHERE rowid > ? AND model = ? ORDER BY rowid"
    for rows in store.tuples(query, last_target, model):
        (*_, last_target), ids, named, target_ids, *numbers = zip(*rows, strict=True)
        if missing := set(ids).difference(place_of):
            raise store.damaged("targets.cell_id", f"{min(missing)!r} is none of the cells")
        codes = (
            [place_of[each] for each in ids],
            [groups.setdefault(name, len(groups)) for name in named],
            target_ids,
        )
        of_targets.append([*_whole(*codes), *(np.array(each, float) for each in numbers)])
    place_of.clear()
    cell, group, target_id, *of_target = _joined(of_targets)
    joined = [condition[cell], picture[cell], group, repeat[cell], target_id, *of_target]
    joined += [column[cell] for column in pictured]
    parts: list[Any] = [(list(map(list, seen)), joined)]
    if before is not None:
        parts.append((list(before.columns[:3]), list(before.columns[3:])))
    return _Held(store.revision, (last_cell, last_target), _in_order(parts))


def _in_order(parts: Sequence[tuple[Sequence[Sequence[Any]], Sequence[NDArray[Any]]]]) -> TargetColumns:
    """The rows of all parts: of each the names, and columns of which the first three are places in them."""
    columns: list[NDArray[Any]] = [
        np.concatenate(each) for each in zip(*(own for _, own in parts), strict=True)
    ]
    names: list[Any] = []
    for place in range(3):
        used = [
            [of[place][code] for code in np.unique(own[place])] for of, own in parts
        ]  # some have no target
        ordered = sorted({name for each in used for name in each}, key=_KEYS[place])
        number = {name: rank for rank, name in enumerate(ordered)}
        ranks = [np.array([number.get(name, -1) for name in of[place]], np.int32) for of, _ in parts]
        columns[place] = np.concatenate(
            [rank[own[place]] for rank, (_, own) in zip(ranks, parts, strict=True)]
        ).astype(np.int32)
        names.append(ordered)
    order = np.lexsort((columns[4], columns[3], columns[1], columns[0]))
    every: list[Any] = [*names, *(column[order] for column in columns)]
    return TargetColumns(*every)


def _whole(*columns: Sequence[int]) -> list[NDArray[Any]]:
    return [np.array(each, np.int32) for each in columns]


def _joined(parts: list[list[NDArray[Any]]]) -> list[NDArray[Any]]:
    """The columns of all parts, which are let go."""
    joined = [np.concatenate(column) for column in zip(*parts, strict=True)]
    parts.clear()
    return joined
