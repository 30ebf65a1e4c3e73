"""YOLOv10, YOLO26 and Ultralytics exports with nms=True: [1, N, 6], the answers themselves, none doubled."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.detectors.formats.candidates import Candidates, select_corners
from blurnoise_eval.detectors.formats.signature import BAKED, Layout, Signature

NAME = "yolov10"
UNKNOWN = BAKED
SEVERAL_CLASSES = False  # one a box is all that the graph tells


def describe(signature: Signature) -> Layout | None:
    """One output [batch, N, 6]."""
    output = signature.outputs[0]
    fits = signature.size_px is not None and len(signature.outputs) == 1
    if not fits or len(output.shape) != 3 or output.shape[2] != 6:
        return None
    return Layout.of(output, "rows of 6")


def decode(outputs: Sequence[NDArray[np.float32]], size_px: tuple[int, int], min_score: float) -> Candidates:
    """Rows of left, top, right, bottom in px, score, class; rows of zeros are padding."""
    rows = outputs[0][0]
    rows = rows[np.isfinite(rows[:, 5])]
    return select_corners(rows[:, :4], rows[:, 4], rows[:, 5].astype(np.int64), min_score)
