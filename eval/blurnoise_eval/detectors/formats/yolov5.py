"""YOLOv5: [1, 3A, 5 + nc], boxes decoded to px, objectness and classes already in [0, 1]."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.detectors.formats.candidates import Candidates, best_class, select
from blurnoise_eval.detectors.formats.grids import STRIDES, STRIDES_64, layout_by_cells
from blurnoise_eval.detectors.formats.signature import Layout, Signature

NAME = "yolov5"
UNKNOWN = ""  # YOLOv7 exported with --grid has the same layout and the same pre-processing
SEVERAL_CLASSES = True  # val.py: multi_label


def describe(signature: Signature) -> Layout | None:
    """[batch, 3A, 5 + nc], with strides up to 32 or 64; old exports add the raw 5-D heads."""
    if any(len(extra.shape) != 5 for extra in signature.outputs[1:]):
        return None
    return layout_by_cells(signature, columns=5, strides=(STRIDES, STRIDES_64), anchors=3)


def decode(outputs: Sequence[NDArray[np.float32]], size_px: tuple[int, int], min_score: float) -> Candidates:
    """Score = objectness · class; (centre x, y, width, height) in px."""
    rows = outputs[0][0]
    rows = rows[rows[:, 4] >= min_score]
    class_scores = rows[:, 5:] * rows[:, 4:5]
    return select(rows[:, :4], *best_class(class_scores), min_score, class_scores)
