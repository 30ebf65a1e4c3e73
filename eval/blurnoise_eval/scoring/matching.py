"""Which detections match which targets, by COCO's rule, of many pictures at once.

Domain: boxes px. Detections and targets meet in pairs, of one picture and class: in each the detections with the
highest score first, in each of these the targets in their order.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from blurnoise_eval.detectors.records import Detections
from blurnoise_eval.scoring.boxes import Array, Flags, overlaps, xywh

MATCH_IOU = 0.5
FOUND_SCORE = 0.25
"""From this score on a detection is one that somebody would act upon."""
Places = NDArray[np.int64]
_PAIRS = 1 << 13  # of boxes and targets held against each other at a time: few enough for a core's cache


class Targets(NamedTuple):
    """T targets, picture by picture. picture: (T,) the place of each one's; category: (T,) of ``categories``."""

    picture: Places
    boxes_xywh: Array
    area_px2: Array
    crowd: Flags
    category: Places
    categories: Sequence[Any]

    @classmethod
    def of(cls, pictures: Sequence[Sequence[Mapping[str, Any]]]) -> Targets:
        """COCO's annotations of each picture."""
        every = [each for own in pictures for each in own]
        places = {
            category: place
            for place, category in enumerate(dict.fromkeys(each["category_id"] for each in every))
        }
        return cls(
            np.repeat(np.arange(len(pictures)), np.array([len(own) for own in pictures], np.int64)),
            np.array([each["bbox"] for each in every], float).reshape(-1, 4),
            np.array([each["area"] for each in every], float),
            np.array([bool(each.get("iscrowd")) for each in every], bool),
            np.array([places[each["category_id"]] for each in every], np.int64),
            list(places),
        )

    def at(self, boxes_xywh: Array) -> Targets:
        """The same elsewhere."""
        return self._replace(boxes_xywh=boxes_xywh)

    def of_pictures(self, places: Places, count: int) -> Targets:
        """Those of these pictures, out of ``count``, in this order; a picture may be there more than once."""
        numbers = np.bincount(self.picture, minlength=count)
        index = spans(numbers[places], (np.cumsum(numbers) - numbers)[places])
        return Targets(
            np.repeat(np.arange(len(places)), numbers[places]),
            self.boxes_xywh[index],
            self.area_px2[index],
            self.crowd[index],
            self.category[index],
            self.categories,
        )


def target_confidences(
    detections: Detections, boxes_xyxy: ArrayLike, class_ids: ArrayLike
) -> NDArray[np.float32]:
    """Highest score of the right class with an IoU of at least 0.5 with each of N targets, else 0, (N,)."""
    ids, targets = np.asarray(class_ids, np.int64), xywh(boxes_xyxy)
    confidences = np.zeros(len(targets), np.float32)
    step = max(1, _PAIRS // max(1, len(targets)))
    for some in (slice(first, first + step) for first in range(0, len(detections), step)):
        right = ids[:, None] == detections.class_ids[some]
        right &= overlaps(targets[:, None], xywh(detections.boxes_xyxy[some])) >= MATCH_IOU
        whose, found = np.nonzero(right)
        np.maximum.at(confidences, whose, detections.scores[some][found])
    return confidences


def matched(
    keys: Places, boxes_xywh: Array, target_keys: Places, targets: Targets, aside: Flags, limits: Array
) -> tuple[Flags, Flags]:
    """Which of N detections match a target, and which of these one that is set aside, both (areas, IoUs, N).

    keys, target_keys: of picture and category, (N,) and (T,); in each key the highest score first. aside: (areas, T).
    limits: least overlaps, (IoUs,), increasing. A target takes one detection, a crowd any number; a detection takes,
    of the targets still free, the one that it overlaps most, those set aside last.
    """
    taken = np.zeros((len(aside), len(limits), len(keys)), bool)
    beside = np.zeros_like(taken)
    detection, target = pairs(keys, target_keys)
    crowd = targets.crowd
    shared = overlaps(boxes_xywh[detection], targets.boxes_xywh[target], crowd[target])
    near = shared >= limits[0]
    detection, target, shared = detection[near], target[near], shared[near]
    choice = with_a_choice(target_keys[target], detection)
    alone, only = detection[~choice], target[~choice]
    enough = shared[~choice, None] >= limits
    own = (enough & (crowd[only, None] | first_of(only, enough))).T
    taken[:, :, alone], beside[:, :, alone] = own, own & aside[:, None, only]
    for number in np.unique(target_keys[target[choice]]).tolist():
        rivals = np.flatnonzero(target_keys == number)
        rows = np.unique(detection[target_keys[target] == number])
        table = overlaps(boxes_xywh[rows, None], targets.boxes_xywh[rivals], crowd[rivals])
        taken[:, :, rows], beside[:, :, rows] = _greedy(table, crowd[rivals], aside[:, rivals], limits)
    return taken, beside


def pairs(detections: Places, targets: Places) -> tuple[Places, Places]:
    """Places of detections (N,) and targets (T,) with the same key, a pair each, by key, detection and target."""
    by_key = np.argsort(targets, kind="stable")
    held = targets[by_key]
    order = np.argsort(detections, kind="stable")
    low = np.searchsorted(held, detections[order], side="left")
    number = np.searchsorted(held, detections[order], side="right") - low
    return np.repeat(order, number), by_key[spans(number, low)]


def spans(lengths: Places, starts: Places) -> Places:
    """The places start, start + 1, ... of every span, one after the other."""
    before = np.cumsum(lengths) - lengths
    return np.asarray(np.arange(int(lengths.sum())) + np.repeat(starts - before, lengths), np.int64)


def with_a_choice(keys: Places, detections: Places) -> Flags:
    """Whether any detection of a pair's key has more than one pair, (n,); pairs as of :func:`pairs`."""
    if not len(keys):
        return np.zeros(0, bool)
    again = np.zeros(len(keys), bool)
    again[1:] = detections[1:] == detections[:-1]
    _, number = np.unique(keys, return_inverse=True)
    some: Flags = np.bincount(number, again) > 0
    return some[number]


def first_of(targets: Places, enough: Flags) -> Flags:
    """Of pairs, those that are the first of their target that is ``enough`` (n, ...), in their order."""
    order = np.argsort(targets, kind="stable")
    number = np.cumsum(enough[order], axis=0)
    starts = np.flatnonzero(np.diff(targets[order], prepend=-1))
    before = np.zeros_like(number[starts])
    before[1:] = number[starts[1:] - 1]
    lengths = np.diff(starts, append=len(order))
    found = np.empty_like(enough)
    found[order] = enough[order] & (number - np.repeat(before, lengths, axis=0) == 1)
    return found


def _greedy(shared: Array, crowd: Flags, aside: Flags, limits: Array) -> tuple[Flags, Flags]:
    """As :func:`matched`, of one picture and category, target by target.

    shared: overlaps (detections, targets), highest score first. aside: (areas, targets). limits: IoUs.
    """
    taken = np.zeros((len(aside), len(limits), len(shared)), bool)
    beside = np.zeros_like(taken)
    for area, of_area in enumerate(aside):
        order = np.argsort(of_area, kind="stable")
        table = shared[:, order].tolist()
        set_aside, many = of_area[order].tolist(), crowd[order].tolist()
        for place, limit in enumerate(limits.tolist()):
            free = [True] * len(order)
            for index, row in enumerate(table):
                best, chosen = limit, -1
                for target, value in enumerate(row):
                    if not free[target] and not many[target]:
                        continue
                    if chosen >= 0 and not set_aside[chosen] and set_aside[target]:
                        break  # one that counts goes before those set aside
                    if value >= best:
                        best, chosen = value, target
                if chosen >= 0:
                    free[chosen] = False
                    taken[area, place, index] = True
                    beside[area, place, index] = set_aside[chosen]
    return taken, beside
