"""MMDeploy's detectors: ``dets`` [1, N, 5] and ``labels`` [1, N], the answers themselves, none doubled."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.detectors.formats.candidates import Candidates, select_corners
from blurnoise_eval.detectors.formats.signature import BAKED, Layout, Signature

NAME = "mmdeploy"
UNKNOWN = BAKED
SEVERAL_CLASSES = False  # one a box is all that the graph tells


def describe(signature: Signature) -> Layout | None:
    """``dets`` [batch, N, 5] with ``labels`` [batch, N]."""
    found = signature.named(("dets", "labels"))
    if signature.size_px is None or found is None:
        return None
    dets, labels = (output.shape for output in found)
    return Layout.by_name(found) if len(dets) == 3 and dets[2] == 5 and len(labels) == 2 else None


def decode(outputs: Sequence[NDArray[np.float32]], size_px: tuple[int, int], min_score: float) -> Candidates:
    """Rows of left, top, right, bottom in px and score; class numbers beside them, below 0 where empty."""
    rows, labels = outputs[0][0], outputs[1][0]
    real = labels >= 0
    return select_corners(rows[real, :4], rows[real, 4], labels[real].astype(np.int64), min_score)
