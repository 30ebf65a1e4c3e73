"""YOLOv10, YOLO26 and Ultralytics exports with nms=True: [1, N, 6], the answers themselves, none doubled."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.formats.candidates import Candidates, select_corners
from blurnoise_eval.formats.signature import Signature, cells

NAME = "yolov10"
OUTPUTS: tuple[str, ...] = ()
LOOKALIKES = ""


def class_count(signature: Signature) -> int | None:
    """0 for [batch, N, 6], unless N counts the cells of a one-class YOLOv5 or YOLOX."""
    shape = signature.outputs[0].shape
    if signature.size_px is None or len(signature.outputs) != 1 or len(shape) != 3 or shape[2] != 6:
        return None
    grids = [cells(signature.size_px, strides) for strides in ((8, 16, 32), (8, 16, 32, 64))]
    return None if shape[1] in (*grids, *(3 * count for count in grids)) else 0


def decode(outputs: Sequence[NDArray[np.float32]], size_px: tuple[int, int], min_score: float) -> Candidates:
    """Rows of left, top, right, bottom in px, score, class; rows of zeros are padding."""
    rows = outputs[0][0]
    rows = rows[np.isfinite(rows[:, 5])]
    return select_corners(rows[:, :4], rows[:, 4], rows[:, 5].astype(np.int64), min_score)
