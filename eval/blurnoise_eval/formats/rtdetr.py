"""RT-DETR, D-FINE and DEIM: ``labels`` [1, Q], ``boxes`` [1, Q, 4], ``scores`` [1, Q], none doubled."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.formats.candidates import Candidates, select_corners
from blurnoise_eval.formats.signature import Signature

NAME = "rtdetr"
OUTPUTS: tuple[str, ...] = ("labels", "boxes", "scores")
LOOKALIKES = ""


def class_count(signature: Signature) -> int | None:
    """0 for these three outputs; ``orig_target_sizes`` is fed the input's own size."""
    shapes = signature.named(OUTPUTS)
    if signature.size_px is None or shapes is None:
        return None
    labels, boxes, scores = shapes
    return 0 if len(labels) == len(scores) == 2 and len(boxes) == 3 and boxes[2] == 4 else None


def decode(outputs: Sequence[NDArray[np.float32]], size_px: tuple[int, int], min_score: float) -> Candidates:
    """Class numbers; left, top, right, bottom in px; scores."""
    labels, boxes, scores = (output[0] for output in outputs)
    return select_corners(boxes, scores, labels.astype(np.int64), min_score)
