"""YOLOv7 exported with --end2end: [N, 7], the answers of the whole batch, none doubled.

Exported with --grid it has YOLOv5's layout.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.detectors.formats.candidates import Candidates, select_corners
from blurnoise_eval.detectors.formats.signature import BAKED, Layout, Signature

NAME = "yolov7"
UNKNOWN = BAKED
SEVERAL_CLASSES = False  # one a box is all that the graph tells


def describe(signature: Signature) -> Layout | None:
    """One output [N, 7]."""
    output = signature.outputs[0]
    fits = signature.size_px is not None and len(signature.outputs) == 1
    if not fits or len(output.shape) != 2 or output.shape[1] != 7:
        return None
    return Layout.of(output, "rows of 7")


def decode(outputs: Sequence[NDArray[np.float32]], size_px: tuple[int, int], min_score: float) -> Candidates:
    """Rows of picture in the batch, left, top, right, bottom in px, class, score; the first picture's."""
    rows = outputs[0]
    rows = rows[(rows[:, 0] == 0) & np.isfinite(rows[:, 5])]
    return select_corners(rows[:, 1:5], rows[:, 6], rows[:, 5].astype(np.int64), min_score)
