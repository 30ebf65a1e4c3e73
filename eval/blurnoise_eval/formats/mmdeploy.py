"""MMDeploy's detectors: ``dets`` [1, N, 5] and ``labels`` [1, N], the answers themselves, none doubled."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.formats.candidates import Candidates, select_corners
from blurnoise_eval.formats.signature import Signature

NAME = "mmdeploy"
OUTPUTS: tuple[str, ...] = ("dets", "labels")
LOOKALIKES = ""


def class_count(signature: Signature) -> int | None:
    """0 for ``dets`` [batch, N, 5] with ``labels`` [batch, N]."""
    shapes = signature.named(OUTPUTS)
    if signature.size_px is None or shapes is None:
        return None
    dets, labels = shapes
    return 0 if len(dets) == 3 and dets[2] == 5 and len(labels) == 2 else None


def decode(outputs: Sequence[NDArray[np.float32]], size_px: tuple[int, int], min_score: float) -> Candidates:
    """Rows of left, top, right, bottom in px and score; class numbers beside them, below 0 where empty."""
    rows, labels = outputs[0][0], outputs[1][0]
    real = labels >= 0
    return select_corners(rows[real, :4], rows[real, 4], labels[real].astype(np.int64), min_score)
