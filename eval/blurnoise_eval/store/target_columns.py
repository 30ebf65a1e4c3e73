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
    names = ("image", '"group"', "repeat", "target_id", *_OF_TARGET, *_OF_PICTURE)
    query = f"""
      SELECT {", ".join(f"targets.{name}" for name in CONDITIONS)}, {", ".join(names)}
      FROM targets JOIN (SELECT cell_id, model, {", ".join(_OF_PICTURE)} FROM cells) USING (cell_id, model)
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
    rank = np.zeros(len(codes), np.int32)
    for place, name in enumerate(names):
        rank[codes[name]] = place
    return names, rank[column]
