"""YOLOX: [1, A, 5 + nc], boxes relative to their grid cell, objectness and classes already in [0, 1]."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.detectors.formats.candidates import Candidates, best_class, from_centres
from blurnoise_eval.detectors.formats.grids import STRIDES, grid, layout_by_cells
from blurnoise_eval.detectors.formats.signature import Layout, Signature

NAME = "yolox"
UNKNOWN = "whether it is YOLOX 0.1.0, which shows the same but takes rgb, 0-1, mean and std of ImageNet"
SEVERAL_CLASSES = False  # postprocess: torch.max over the classes


def describe(signature: Signature) -> Layout | None:
    """[batch, A, 5 + nc]."""
    if len(signature.outputs) != 1:
        return None
    return layout_by_cells(signature, columns=5, strides=(STRIDES,))


def decode(outputs: Sequence[NDArray[np.float32]], size_px: tuple[int, int], min_score: float) -> Candidates:
    """Score = objectness · class; centre = (offset + cell) · stride, size = exp(offset) · stride, px.

    Source: Ge et al., YOLOX (2021), as in the reference code's ``demo_postprocess``.
    """
    rows = outputs[0][0]
    kept = np.flatnonzero(rows[:, 4] >= min_score)
    class_scores = rows[kept, 5:]
    class_scores *= rows[kept, 4:5]
    scores, class_ids = best_class(class_scores)
    strong = np.flatnonzero(scores >= min_score)  # before anything is computed of the boxes
    kept = kept[strong]
    column_row, stride = (values[kept] for values in grid(size_px))
    boxes = rows[kept, :4]
    boxes[:, :2] += column_row
    with np.errstate(over="ignore"):  # an overflow gives an infinite box, which is dropped
        np.exp(boxes[:, 2:], out=boxes[:, 2:])
        boxes *= stride
    return from_centres(boxes, scores[strong], class_ids[strong], class_scores[strong])
