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
_NUMBERS = (
    "confidence",
    "confidence_swept",
    "read_confidence",
    "character_error_rate",
    "saturated",
    "brightness",
)
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
    numbers = [f"{'c' if name in ('saturated', 'brightness') else 't'}.{name}" for name in _NUMBERS]
    asked = [f"t.{name}" for name in CONDITIONS] + ["t.image", 't."group"', "t.repeat", "t.target_id"]
    asked += ["CASE WHEN t.truth IS NULL THEN NULL ELSE t.text IS t.truth END", *numbers]
    query = f"SELECT {', '.join(asked)} FROM targets AS t JOIN cells AS c USING (cell_id, model) WHERE t.model = ?"
    count = len(CONDITIONS)
    seen: list[dict[Any, int]] = [{}, {}, {}]
    parts: list[list[NDArray[Any]]] = []
    for rows in store.tuples(query, model):
        conditions, pictures, groups = seen
        columns = list(zip(*rows, strict=True))
        codes = [
            [conditions.setdefault(row[:count], len(conditions)) for row in rows],
            [pictures.setdefault(name, len(pictures)) for name in columns[count]],
            [groups.setdefault(name, len(groups)) for name in columns[count + 1]],
        ]
        whole = [np.array(each, np.int32) for each in (*codes, *columns[count + 2 : count + 4])]
        parts.append([*whole, *(np.array(each, float) for each in columns[count + 4 :])])
    if not parts:
        parts.append([np.zeros(0, np.int32)] * 5 + [np.zeros(0)] * (1 + len(_NUMBERS)))
    joined = [np.concatenate(column) for column in zip(*parts, strict=True)]
    parts.clear()
    names: list[Any] = []
    for place, codes_of in enumerate(seen):
        ordered = (
            sorted(codes_of, key=lambda each: tuple(-1.0 if v is None else v for v in each))
            if not place
            else sorted(codes_of)
        )
        rank = np.empty(len(ordered), np.int32)
        rank[[codes_of[each] for each in ordered]] = np.arange(len(ordered))
        joined[place] = rank[joined[place]]
        names.append(ordered)
    order = np.lexsort((joined[4], joined[3], joined[1], joined[0]))
    every: list[Any] = [*names, *(column[order] for column in joined)]
    return TargetColumns(*every)
