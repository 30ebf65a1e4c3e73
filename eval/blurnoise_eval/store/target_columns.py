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


_Kept = dict[tuple[str, int], TargetColumns]
_KEPT: WeakKeyDictionary[Store, _Kept] = WeakKeyDictionary()
"""By store; by model and revision."""


def target_columns(store: Store, model: str) -> TargetColumns:
    """All targets of a model, read once for scores and surfaces."""
    kept = {key: each for key, each in _KEPT.get(store, {}).items() if key[1] == store.revision}
    key = model, store.revision
    if key not in kept:
        found = _read(store, model)
        if sum(len(each.condition) for each in (found, *kept.values())) > _MOST_KEPT:
            return found
        kept[key] = found
    _KEPT[store] = kept
    return kept[key]


def _read(store: Store, model: str) -> TargetColumns:
    """Each table as it lies on the disk, in place of a join: that would look up every cell on its own."""
    conditions, pictures, groups = seen = dict[Any, int](), dict[Any, int](), dict[Any, int]()
    place_of: dict[str, int] = {}
    of_cells = [[np.zeros(0, np.int32)] * 3 + [np.zeros(0)] * len(_OF_PICTURE)]
    asked = ", ".join(("cell_id", "image", "repeat", *_OF_PICTURE, *CONDITIONS))
    for rows in store.tuples(f"SELECT {asked} FROM cells NOT INDEXED WHERE model = ?", model):
        ids, images, repeats, *measured = list(zip(*rows, strict=True))[: -len(CONDITIONS)]
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
    asked = ", ".join(("cell_id", '"group"', "target_id", exact, *_OF_TARGET))
    for rows in store.tuples(f"SELECT {asked} FROM targets NOT INDEXED WHERE model = ?", model):
        ids, named, target_ids, *numbers = zip(*rows, strict=True)
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
    names: list[Any] = []
    for place, codes_of in enumerate(seen):
        here = set(np.unique(joined[place]).tolist())  # some cells have no target
        ordered = sorted((each for each in codes_of if codes_of[each] in here), key=_KEYS[place])
        rank = np.zeros(len(codes_of), np.int32)
        rank[[codes_of[each] for each in ordered]] = np.arange(len(ordered))
        joined[place] = rank[joined[place]]
        names.append(ordered)
    order = np.lexsort((joined[4], joined[3], joined[1], joined[0]))
    every: list[Any] = [*names, *(column[order] for column in joined)]
    return TargetColumns(*every)


def _whole(*columns: Sequence[int]) -> list[NDArray[Any]]:
    return [np.array(each, np.int32) for each in columns]


def _joined(parts: list[list[NDArray[Any]]]) -> list[NDArray[Any]]:
    """The columns of all parts, which are let go."""
    joined = [np.concatenate(column) for column in zip(*parts, strict=True)]
    parts.clear()
    return joined
