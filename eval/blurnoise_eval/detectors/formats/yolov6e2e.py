"""YOLOv6 and others exported end to end: ``num_dets``, ``det_boxes``, ``det_scores``, ``det_classes``.

Some call them as TensorRT's plugin does, with the names of TensorFlow's API, whose count has no second axis.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.detectors.formats.candidates import Candidates, counted
from blurnoise_eval.detectors.formats.signature import BAKED, Layout, Signature

NAME = "yolov6e2e"
UNKNOWN = BAKED
SEVERAL_CLASSES = False  # one a box is all that the graph tells
_NAMES = ("num_dets", "det_boxes", "det_scores", "det_classes")
_PLUGIN_NAMES = ("num_detections", "detection_boxes", "detection_scores", "detection_classes")


def describe(signature: Signature) -> Layout | None:
    """These four outputs: [batch, 1], [batch, N, 4], [batch, N], [batch, N]."""
    found = signature.named(_NAMES) or signature.named(_PLUGIN_NAMES)
    if signature.size_px is None or found is None:
        return None
    count, boxes, scores, classes = (output.shape for output in found)
    fits = len(boxes) == 3 and boxes[2] == 4 and len(count) == len(scores) == len(classes) == 2
    return Layout.by_name(found) if fits else None


def decode(outputs: Sequence[NDArray[np.float32]], size_px: tuple[int, int], min_score: float) -> Candidates:
    """How many answers count; left, top, right, bottom in px; scores; class numbers."""
    count, boxes, scores, classes = outputs
    return counted(count, boxes[0], scores[0], classes[0], min_score)
