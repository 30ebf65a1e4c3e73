"""Pairs of detections and targets of many pictures at once, and who answers for whom.

Domain: boxes (left, top, width, height) px; overlaps as COCO computes them. Pairs stand together by picture and
class, in each the detections with the highest score first, in each of these the targets in their order.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Places = NDArray[np.int64]
Flags = NDArray[np.bool_]


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


def spans(lengths: Places, starts: Places) -> Places:
    """The places start, start + 1, ... of every span, one after the other."""
    before = np.cumsum(lengths) - lengths
    return np.asarray(np.arange(int(lengths.sum())) + np.repeat(starts - before, lengths), np.int64)


def pairs(detections: Places, targets: Places) -> tuple[Places, Places]:
    """Places of detections (N,) and targets (T,) with the same key, a pair each, by key, detection and target."""
    by_key = np.argsort(targets, kind="stable")
    held = targets[by_key]
    order = np.argsort(detections, kind="stable")
    low = np.searchsorted(held, detections[order], side="left")
    number = np.searchsorted(held, detections[order], side="right") - low
    return np.repeat(order, number), by_key[spans(number, low)]


def paired_overlaps(boxes_xywh: Array, targets_xywh: Array, crowd: Flags | None = None) -> Array:
    """Overlap of each of n boxes with a target of its own, (n,): intersection over union, with a crowd over the box's
    own area."""
    ends, target_ends = boxes_xywh[:, :2] + boxes_xywh[:, 2:], targets_xywh[:, :2] + targets_xywh[:, 2:]
    sides = np.minimum(ends, target_ends) - np.maximum(boxes_xywh[:, :2], targets_xywh[:, :2])
    sides = np.clip(sides, 0, None)
    shared = sides[:, 0] * sides[:, 1]
    own = boxes_xywh[:, 2] * boxes_xywh[:, 3]
    union = own + targets_xywh[:, 2] * targets_xywh[:, 3] - shared
    iou = np.divide(shared, union, out=np.zeros_like(shared), where=union > 0)
    return np.asarray(iou if crowd is None else np.where(crowd, shared / np.maximum(own, 1e-12), iou))


def xywh(boxes_xyxy: NDArray[Any]) -> Array:
    """Left, top, width, height of corners (N, 4)."""
    boxes = boxes_xyxy.astype(np.float64)
    return np.concatenate([boxes[:, :2], boxes[:, 2:] - boxes[:, :2]], axis=1)


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
