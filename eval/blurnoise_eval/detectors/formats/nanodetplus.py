"""NanoDet-Plus: [1, A, nc + 32], class scores in [0, 1] and side distributions, with stride 64 too."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.detectors.formats.candidates import Candidates
from blurnoise_eval.detectors.formats.grids import STRIDES_64, grid, layout_by_cells
from blurnoise_eval.detectors.formats.nanodet import SIDES, candidates
from blurnoise_eval.detectors.formats.signature import Layout, Signature

NAME = "nanodetplus"
UNKNOWN = ""
SEVERAL_CLASSES = True  # multiclass_nms


def describe(signature: Signature) -> Layout | None:
    """[batch, A, nc + 32], A over strides 8 to 64."""
    if len(signature.outputs) != 1:
        return None
    return layout_by_cells(signature, columns=SIDES, strides=(STRIDES_64,))


def decode(outputs: Sequence[NDArray[np.float32]], size_px: tuple[int, int], min_score: float) -> Candidates:
    """A cell's centre is its (column, row) · stride, without the half pixel of its predecessor."""
    rows = outputs[0][0]
    column_row, stride = grid(size_px, STRIDES_64)
    scores, sides = rows[:, :-SIDES], rows[:, -SIDES:]
    return candidates(scores, sides, column_row * stride, stride, size_px, min_score)
