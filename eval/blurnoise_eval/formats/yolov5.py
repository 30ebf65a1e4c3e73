"""YOLOv5: [1, 3A, 5 + nc], boxes decoded to px, objectness and classes already in [0, 1]."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.formats.candidates import Candidates, best_class, select
from blurnoise_eval.formats.signature import Signature, cells

NAME = "yolov5"
OUTPUTS: tuple[str, ...] = ()
LOOKALIKES = ""  # YOLOv7 exported with --grid has the same layout and the same pre-processing


def class_count(signature: Signature) -> int | None:
    """Classes of [batch, 3A, 5 + nc], with strides up to 32 or 64; old exports add the raw 5-D heads."""
    shape = signature.outputs[0].shape
    if signature.size_px is None or len(shape) != 3 or not isinstance(shape[2], int) or shape[2] < 6:
        return None
    if any(len(extra.shape) != 5 for extra in signature.outputs[1:]):
        return None
    counts = (3 * cells(signature.size_px), 3 * cells(signature.size_px, (8, 16, 32, 64)))
    return shape[2] - 5 if shape[1] in counts else None


def decode(outputs: Sequence[NDArray[np.float32]], size_px: tuple[int, int], min_score: float) -> Candidates:
    """Score = objectness · class; (centre x, y, width, height) in px."""
    rows = outputs[0][0]
    rows = rows[rows[:, 4] >= min_score]
    class_scores, class_ids = best_class(rows[:, 5:])
    return select(rows[:, :4], rows[:, 4] * class_scores, class_ids, min_score)
