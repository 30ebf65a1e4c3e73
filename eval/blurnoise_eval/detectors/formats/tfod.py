"""TensorFlow's Object Detection API (SSD-MobileNet and others): boxes, classes, scores and how many there are."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.detectors.formats.candidates import Candidates, counted
from blurnoise_eval.detectors.formats.signature import BACKGROUND_FIRST, Layout, Signature, TensorInfo

NAME = "tfod"
UNKNOWN = BACKGROUND_FIRST
SEVERAL_CLASSES = False  # one a box is all that the graph tells
_NAMES = ("num_detections", "detection_boxes", "detection_scores", "detection_classes")


def describe(signature: Signature) -> Layout | None:
    """The API's own output names, the count [batch]; else of four outputs of its shapes those called class, score."""
    found = signature.named(_NAMES) or _by_shape(signature.outputs)
    if signature.size_px is None or found is None:
        return None
    count, boxes, scores, classes = (output.shape for output in found)
    fits = len(count) == 1 and len(boxes) == 3 and boxes[2] == 4 and len(scores) == len(classes) == 2
    return Layout.by_name(found) if fits else None


def _by_shape(outputs: Sequence[TensorInfo]) -> list[TensorInfo] | None:
    """[batch], [batch, N, 4] and twice [batch, N], whose names then have to tell scores from classes."""
    count = [output for output in outputs if len(output.shape) == 1]
    boxes = [output for output in outputs if len(output.shape) == 3]
    flat = [output for output in outputs if len(output.shape) == 2]
    scores, classes = ([o for o in flat if word in o.name.lower()] for word in ("score", "class"))
    if len(outputs) != 4 or any(len(group) != 1 for group in (count, boxes, scores, classes)):
        return None
    return [*count, *boxes, *scores, *classes]


def decode(outputs: Sequence[NDArray[np.float32]], size_px: tuple[int, int], min_score: float) -> Candidates:
    """How many answers count; top, left, bottom, right as shares of the input; scores; numbers from 1 on.

    The numbers are kept: 1 is the first class, so names begin with one for 0, as "coco91" does.
    """
    count, boxes, scores, classes = outputs
    px = boxes[0][:, [1, 0, 3, 2]] * np.array([size_px[1], size_px[0]] * 2, np.float32)
    return counted(count, px, scores[0], classes[0], min_score)
