"""Limits baked into a graph that drops answers itself, measured from those it gives: what nobody can see of it.

Domain: scores in [0, 1], overlaps as intersection over union, of boxes as the graph gives them.
"""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from typing import TypedDict

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.detectors.contract import ModelError
from blurnoise_eval.detectors.detector import Detector

_ANY_SCORE, _ANY_NUMBER = 1e-9, 100_000
UNSEEN_SCORE = 0.005
"""From here on a lowest score is worth telling: it hides what confidence does below."""


class Baked(TypedDict):
    """Of ``pictures``: the lowest score, the largest number of boxes, the greatest overlap of two of one class."""

    pictures: int
    lowest_score: float | None
    most_boxes: int
    greatest_iou: float | None


def baked(detector: Detector, images: Iterable[NDArray[np.uint8]]) -> Baked | None:
    """Measure a detector's limits on RGB pictures (h, w, 3); None where the graph drops no answers itself.

    A limit is at least as strict as what is measured only if the pictures reach it, so that lively ones tell more.
    A picture on which the detector fails tells nothing.
    """
    if detector.contract.nms_iou is not None:
        return None
    lowest, overlaps, most, count = [], [], 0, 0
    for image in images:
        with suppress(ModelError):
            blob, placement = detector.prepare(image)
            outputs = detector.run(blob)
            found = detector.decode(
                outputs, placement, min_score=_ANY_SCORE, max_detections=_ANY_NUMBER
            ).leading
            count, most = count + 1, max(most, len(found))
            if len(found):
                lowest.append(float(found.scores.min()))
            for class_id in np.unique(found.class_ids):
                overlaps.append(_greatest_iou(found.boxes_xyxy[found.class_ids == class_id].astype(float)))
    return Baked(
        pictures=count,
        lowest_score=min(lowest, default=None),
        most_boxes=most,
        greatest_iou=max((each for each in overlaps if each is not None), default=None),
    )


def baked_text(limits: Baked) -> str:
    """The limits as one line."""
    if limits["lowest_score"] is None:
        return f"no answers in {limits['pictures']} pictures"
    text = f"in {limits['pictures']} pictures no score below {limits['lowest_score']:.3g}, "
    text += f"at most {limits['most_boxes']} boxes"
    if limits["greatest_iou"] is not None:
        text += f", those of one class overlap by at most {limits['greatest_iou']:.2f} (IoU)"
    return f"{text}: what is weaker, more or closer never leaves the graph"


def _greatest_iou(boxes_xyxy: NDArray[np.float64]) -> float | None:
    """Of two of the boxes (N, 4); None of fewer."""
    if len(boxes_xyxy) < 2:
        return None
    low = np.maximum(boxes_xyxy[:, None, :2], boxes_xyxy[None, :, :2])
    high = np.minimum(boxes_xyxy[:, None, 2:], boxes_xyxy[None, :, 2:])
    shared = np.clip(high - low, 0, None).prod(axis=-1)
    areas = (boxes_xyxy[:, 2:] - boxes_xyxy[:, :2]).prod(axis=-1)
    ious = shared / np.maximum(areas[:, None] + areas[None] - shared, 1e-12)
    np.fill_diagonal(ious, 0)
    return float(ious.max())
