"""RT-DETR, D-FINE and DEIM: ``labels`` [1, Q], ``boxes`` [1, Q, 4], ``scores`` [1, Q], none doubled."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.detectors.formats.candidates import Candidates, select_corners
from blurnoise_eval.detectors.formats.signature import Layout, Signature

NAME = "rtdetr"
UNKNOWN = ""


def describe(signature: Signature) -> Layout | None:
    """These three outputs; ``orig_target_sizes`` is fed the input's own size."""
    found = signature.named(("labels", "boxes", "scores"))
    if signature.size_px is None or found is None:
        return None
    labels, boxes, scores = (output.shape for output in found)
    fits = len(labels) == len(scores) == 2 and len(boxes) == 3 and boxes[2] == 4
    return Layout.by_name(found) if fits else None


def decode(outputs: Sequence[NDArray[np.float32]], size_px: tuple[int, int], min_score: float) -> Candidates:
    """Class numbers; left, top, right, bottom in px; scores."""
    labels, boxes, scores = (output[0] for output in outputs)
    return select_corners(boxes, scores, labels.astype(np.int64), min_score)
