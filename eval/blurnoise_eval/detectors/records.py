"""Detections of one picture and of many, validated when they are made."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Detections:
    """What a detector found in one picture, highest score first.

    boxes_xyxy: (N, 4) px in the picture's own coordinates, x right, y down, corners (left, top, right,
    bottom). scores: (N,) in [0, 1]. class_ids: (N,) index into the contract's classes. leads: (N,) whether the class
    is the first of its box, where a box may have several; None: all are.
    Raises ``ValueError`` when shapes disagree or a value is not finite.

    >>> found = Detections([[0, 0, 10, 10], [5, 5, 20, 20]], [0.4, 0.9], [0, 2])
    >>> found.scores, found.class_ids
    (array([0.9, 0.4], dtype=float32), array([2, 0]))
    """

    boxes_xyxy: NDArray[np.float32]
    scores: NDArray[np.float32]
    class_ids: NDArray[np.int64]
    leads: NDArray[np.bool_] | None = None

    def __post_init__(self) -> None:
        values: dict[str, Any] = {
            "boxes_xyxy": np.array(self.boxes_xyxy, np.float32).reshape(-1, 4),
            "scores": np.array(self.scores, np.float32).reshape(-1),
            "class_ids": np.array(self.class_ids, np.int64).reshape(-1),
        }
        if self.leads is not None:
            values["leads"] = np.array(self.leads, bool).reshape(-1)
        counts = [len(array) for array in values.values()]
        if len(set(counts)) != 1:
            raise ValueError(f"detections: {counts} boxes, scores and classes; the numbers must be equal")
        if not (np.isfinite(values["boxes_xyxy"]).all() and np.isfinite(values["scores"]).all()):
            raise ValueError("detections: boxes and scores must be finite")
        # Stable, so that ties have the order of the graph's outputs on every machine.
        order = np.argsort(-values["scores"], kind="stable")
        for name, array in values.items():
            object.__setattr__(self, name, array[order])

    @property
    def leading(self) -> Detections:
        """The detections with the highest-scoring class of each box, as shown to a user."""
        return self if self.leads is None else self[self.leads]

    @property
    def boxes(self) -> int:
        """How many boxes there are, each counted once."""
        return len(self) if self.leads is None else int(np.count_nonzero(self.leads))

    def __len__(self) -> int:
        return len(self.scores)

    def __getitem__(self, index: NDArray[np.bool_] | slice) -> Detections:
        leads = None if self.leads is None else self.leads[index]
        return Detections(self.boxes_xyxy[index], self.scores[index], self.class_ids[index], leads)


@dataclass(frozen=True, eq=False)
class Answers:
    """What was found in P pictures, one after the other, as arrays: pictures by ``names`` and ``repeats``.

    counts: (P,) detections of each. boxes_xyxy, scores, class_ids, leads: of all N of them, as of
    :class:`Detections`, of each picture the highest score first.

    >>> first = Detections([[0, 0, 10, 10], [0, 0, 5, 5]], [0.9, 0.4], [0, 0])
    >>> answers = Answers.of([("a.png", 0, first), ("b.png", 0, first[:0])])
    >>> answers.counts.tolist(), answers.picture.tolist()
    ([2, 0], [0, 0])
    """

    names: Sequence[str]
    repeats: Sequence[int]
    counts: NDArray[np.int64]
    boxes_xyxy: NDArray[np.float32]
    scores: NDArray[np.float32]
    class_ids: NDArray[np.int64]
    leads: NDArray[np.bool_]

    @classmethod
    def of(cls, pictures: Sequence[tuple[str, int, Detections]]) -> Answers:
        """Of each picture's name, repeat and detections."""
        detections = [one for *_, one in pictures]
        leads = [np.ones(len(one), bool) if one.leads is None else one.leads for one in detections]
        return cls(
            [name for name, *_ in pictures],
            [repeat for _, repeat, _ in pictures],
            np.array([len(one) for one in detections], np.int64),
            np.concatenate([np.zeros((0, 4), np.float32), *(one.boxes_xyxy for one in detections)]),
            np.concatenate([np.zeros(0, np.float32), *(one.scores for one in detections)]),
            np.concatenate([np.zeros(0, np.int64), *(one.class_ids for one in detections)]),
            np.concatenate([np.zeros(0, bool), *leads]),
        )

    @property
    def picture(self) -> NDArray[np.int64]:
        """(N,) the place of each detection's picture."""
        return np.repeat(np.arange(len(self.counts)), self.counts)

    def in_order(self, order: NDArray[np.int64]) -> Answers:
        """The same of pictures in another order."""
        # In order already, as a sweep writes them: nothing to copy.
        if (np.diff(order) == 1).all():
            return self
        counts = self.counts[order]
        starts = (np.cumsum(self.counts) - self.counts)[order]
        index = np.arange(counts.sum()) + np.repeat(starts - (np.cumsum(counts) - counts), counts)
        return Answers(
            [self.names[picture] for picture in order.tolist()],
            [self.repeats[picture] for picture in order.tolist()],
            counts,
            *(array[index] for array in (self.boxes_xyxy, self.scores, self.class_ids, self.leads)),
        )
