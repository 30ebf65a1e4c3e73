"""Which detections match which targets, by COCO's rule, of many pictures at once.

Domain: boxes px. Detections and targets meet in pairs, of one picture and class: in each the detections with the
highest score first, in each of these the targets in their order.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from blurnoise_eval.detectors.records import Detections
from blurnoise_eval.scoring.boxes import Array, Flags, overlaps, xywh

MATCH_IOU = 0.5
FOUND_SCORE = 0.25
"""From this score on a detection is one that somebody would act upon."""
Places = NDArray[np.int64]
_SIDES: tuple[Literal["left", "right"], ...] = ("left", "right")
_PAIRS = 1 << 13  # of boxes and targets held against each other at a time: few enough for a core's cache


class Targets(NamedTuple):
    """T targets, picture by picture. picture: (T,) the place of each one's; category: (T,) of ``categories``.

    >>> of_picture = [{"category_id": 3, "bbox": [0, 0, 10, 10], "area": 100.0}]
    >>> targets = Targets.of([of_picture, []])
    >>> targets.picture.tolist(), targets.categories
    ([0], [3])
    """

    picture: Places
    boxes_xywh: Array
    area_px2: Array
    crowd: Flags
    category: Places
    categories: Sequence[Any]

    @classmethod
    def of(cls, pictures: Sequence[Sequence[Mapping[str, Any]]]) -> Targets:
        """COCO's annotations of each picture."""
        every = [each for some in pictures for each in some]
        categories = sorted({each["category_id"] for each in every})
        places = {category: index for index, category in enumerate(categories)}
        return cls(
            np.repeat(np.arange(len(pictures)), np.array([len(some) for some in pictures], np.int64)),
            np.array([each["bbox"] for each in every], float).reshape(-1, 4),
            np.array([each["area"] for each in every], float),
            np.array([bool(each.get("iscrowd")) for each in every], bool),
            np.array([places[each["category_id"]] for each in every], np.int64),
            categories,
        )

    def of_pictures(self, places: Places, count: int) -> Targets:
        """Those of these pictures, out of ``count``, in this order; a picture may be there more than once."""
        numbers = np.bincount(self.picture, minlength=count)
        index = _spans(numbers[places], (np.cumsum(numbers) - numbers)[places])
        return Targets(
            np.repeat(np.arange(len(places)), numbers[places]),
            self.boxes_xywh[index],
            self.area_px2[index],
            self.crowd[index],
            self.category[index],
            self.categories,
        )

    def category_of_class(self, category_of: Mapping[int, int], class_ids: Places) -> tuple[Places, int]:
        """Of each class's number the place of its category, -1 of none, (N,); and how many categories there are, with
        those that have no target. category_of: ids of categories."""
        places = {category: index for index, category in enumerate(self.categories)}
        of_class = np.full(max(category_of, default=0) + 2, -1)
        for number, category in category_of.items():
            of_class[number] = places.setdefault(category, len(places))
        return of_class[np.minimum(class_ids, len(of_class) - 1)], len(places)


def target_confidences(
    detections: Detections, boxes_xyxy: ArrayLike, class_ids: ArrayLike
) -> NDArray[np.float32]:
    """Highest score of the right class with an IoU of at least 0.5 with each of N targets, else 0, (N,).

    >>> from blurnoise_eval.detectors.records import Detections
    >>> boxes = np.array([[0.0, 0.0, 10.0, 10.0], [50.0, 0.0, 60.0, 10.0]])
    >>> found = Detections(boxes, np.array([0.75, 0.5]), np.array([0, 0]))
    >>> target_confidences(found, [[1.0, 0.0, 11.0, 10.0], [90.0, 0.0, 95.0, 5.0]], [0, 0]).tolist()
    [0.75, 0.0]
    """
    ids, targets = np.asarray(class_ids, np.int64), xywh(boxes_xyxy)
    confidences = np.zeros(len(targets), np.float32)
    step = max(1, _PAIRS // max(1, len(targets)))
    for some in (slice(first, first + step) for first in range(0, len(detections), step)):
        right = ids[:, None] == detections.class_ids[some]
        right &= overlaps(targets[:, None], xywh(detections.boxes_xyxy[some])) >= MATCH_IOU
        whose, which = np.nonzero(right)
        np.maximum.at(confidences, whose, detections.scores[some][which])
    return confidences


def matched(
    keys: Places, boxes_xywh: Array, target_keys: Places, targets: Targets, aside: Flags, limits: Array
) -> tuple[Flags, Flags]:
    """Which of N detections match a target, and which of these one that is ignored, both (areas, IoUs, N).

    keys, target_keys: of picture and category, (N,) and (T,); in each key the highest score first. aside: (areas, T)
    targets that are ignored, among them all crowds. limits: least overlaps, (IoUs,), increasing. A target takes one
    detection, a crowd any number; a detection takes, of the targets still free, the one that it overlaps most, of
    equals the last, and an ignored one only where there is no other.

    >>> of_picture = [{"category_id": 1, "bbox": [0, 0, 10, 10], "area": 100.0}]
    >>> targets, limits = Targets.of([of_picture]), np.array([0.5])
    >>> boxes_xywh = np.array([[0.0, 0.0, 10.0, 10.0], [0.0, 0.0, 10.0, 9.0]])  # two answers for one target
    >>> same = np.zeros(2, int), boxes_xywh, np.zeros(1, int)
    >>> matched(*same, targets, targets.crowd[None], limits)[0].tolist()
    [[[True, False]]]
    """
    taken = np.zeros((len(aside), len(limits), len(keys)), bool)
    beside = np.zeros_like(taken)
    free = np.ones((len(aside), len(limits), len(targets.crowd)), bool)
    detection, target = _pairs(keys, target_keys)
    overlap = overlaps(boxes_xywh[detection], targets.boxes_xywh[target], targets.crowd[target])
    # Pairs below the least IoU match at none, and most pairs are.
    near = overlap >= limits[0]
    detection, target, overlap = detection[near], target[near], overlap[near]
    by_preference = np.lexsort((target, overlap))
    preference = np.argsort(by_preference)
    first = np.flatnonzero(np.diff(detection, prepend=-1))
    turn = np.repeat(rank(keys[detection[first]]), np.diff(first, append=len(detection)))
    # The best detection of every picture and class at once, then the second best: they compete within these only.
    for pairs in (np.flatnonzero(turn == each) for each in range(turn.max(initial=-1) + 1)):
        who, what = detection[pairs], target[pairs]
        possible = (overlap[pairs] >= limits[:, None]) & (free[:, :, what] | targets.crowd[what])
        # Targets that count come before ignored ones, whatever the overlap.
        value = preference[pairs] + len(preference) * ~aside[:, None, what]
        starts = np.flatnonzero(np.diff(who, prepend=-1))
        best = np.maximum.reduceat(np.where(possible, value, -1), starts, axis=2)
        area, limit, index = np.nonzero(best >= 0)
        chosen = target[by_preference[best[area, limit, index] % len(preference)]]
        taken[area, limit, who[starts][index]] = True
        beside[area, limit, who[starts][index]] = aside[area, chosen]
        free[area, limit, chosen] = False
    return taken, beside


def _pairs(detections: Places, targets: Places) -> tuple[Places, Places]:
    """Places of detections (N,) and targets (T,) with the same key, a pair each, by key, detection and target."""
    by_key = np.argsort(targets, kind="stable")
    order = np.argsort(detections, kind="stable")
    low, high = (np.searchsorted(targets[by_key], detections[order], side=side) for side in _SIDES)
    return np.repeat(order, high - low), by_key[_spans(high - low, low)]


def _spans(lengths: Places, starts: Places) -> Places:
    """The places start, start + 1, ... of every span, one after the other."""
    before = np.cumsum(lengths) - lengths
    return np.asarray(np.arange(int(lengths.sum())) + np.repeat(starts - before, lengths), np.int64)


def rank(keys: Places) -> Places:
    """The place of each key among its equals, which stand together.

    >>> rank(np.array([4, 4, 4, 7, 7])).tolist()
    [0, 1, 2, 0, 1]
    """
    starts = np.flatnonzero(np.diff(keys, prepend=-2))
    return np.asarray(np.arange(len(keys)) - np.repeat(starts, np.diff(starts, append=len(keys))), np.int64)
