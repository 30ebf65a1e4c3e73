"""YOLO-FastestV2: for each cell of strides 16 and 32 the boxes of three anchors, their objectness, one class vector.

[A, 15 + nc] with or without a batch, or an output [1, h, w, 15 + nc] for each stride; sigmoids and softmax applied.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.detectors.anchor_head import YOLO_FASTEST_V2
from blurnoise_eval.detectors.formats.anchors import SEVERAL_CLASSES, WithAnchors
from blurnoise_eval.detectors.formats.candidates import Candidates
from blurnoise_eval.detectors.formats.signature import Layout, Signature

__all__ = ["NAME", "SEVERAL_CLASSES", "UNKNOWN", "decode", "describe"]

NAME = "yolofastestv2"
UNKNOWN = "whether it was trained with anchors of its own, which the contract's head then states"
_SHARED = 5 * YOLO_FASTEST_V2.per_cell  # columns before the classes
_OWN_COCO = YOLO_FASTEST_V2.per_cell * (5 + 80)  # of heads with classes for each anchor, as YOLOv3-tiny's


def describe(signature: Signature) -> Layout | None:
    """Rows, or planes with the channels last."""
    width = signature.outputs[0].shape[-1]
    if not isinstance(width, int) or width <= _SHARED or width == _OWN_COCO:
        return None
    return _family(width - _SHARED).describe(signature)


def decode(outputs: Sequence[NDArray[np.float32]], size_px: tuple[int, int], min_score: float) -> Candidates:
    """With COCO's anchors."""
    return _family(outputs[0].shape[-1] - _SHARED).decode(outputs, size_px, min_score)


def _family(classes: int) -> WithAnchors:
    return WithAnchors(NAME, YOLO_FASTEST_V2, classes)
