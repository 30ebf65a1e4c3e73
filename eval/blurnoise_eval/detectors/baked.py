"""Limits baked into a graph that drops answers itself, measured from those it gives: what nobody can see of it."""

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
    """Of ``pictures``: the lowest score and the largest number of boxes."""

    pictures: int
    lowest_score: float | None
    most_boxes: int


def baked(detector: Detector, images: Iterable[NDArray[np.uint8]]) -> Baked | None:
    """Measure a detector's limits on RGB pictures (h, w, 3); None where the graph drops no answers itself.

    A limit is at least as strict as what is measured only if the pictures reach it, so that lively ones tell more.
    A picture on which the detector fails tells nothing.
    """
    if detector.contract.nms_iou is not None:
        return None
    scores: list[NDArray[np.float32]] = []
    for image in images:
        with suppress(ModelError):
            found = detector.detect(image, min_score=_ANY_SCORE, max_detections=_ANY_NUMBER)
            scores.append(found.leading.scores)
    lowest = min((float(each.min()) for each in scores if len(each)), default=None)
    return Baked(pictures=len(scores), lowest_score=lowest, most_boxes=max(map(len, scores), default=0))


def baked_text(limits: Baked) -> str:
    """The limits as one line."""
    if limits["lowest_score"] is None:
        return f"no answers in {limits['pictures']} pictures"
    text = f"in {limits['pictures']} pictures no score below {limits['lowest_score']:.3g}, "
    return f"{text}at most {limits['most_boxes']} boxes: what is weaker or more never leaves the graph"
