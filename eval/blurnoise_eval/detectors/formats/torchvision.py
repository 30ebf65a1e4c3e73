"""torchvision's detectors: boxes [N, 4], labels [N] and scores [N] of one picture [3, H, W], none doubled."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.detectors.formats.candidates import Candidates, select_corners
from blurnoise_eval.detectors.formats.signature import BAKED, Layout, Signature

NAME = "torchvision"
UNKNOWN = BAKED


def describe(signature: Signature) -> Layout | None:
    """One [N, 4], one [N] of integers and one [N] of floats: the order differs between its models."""
    if signature.size_px is None:
        return None
    boxes = [o for o in signature.outputs if len(o.shape) == 2 and o.shape[1] == 4]
    flat = [o for o in signature.outputs if len(o.shape) == 1]
    labels = [o for o in flat if o.type in ("tensor(int64)", "tensor(int32)")]
    scores = [o for o in flat if o not in labels]
    if not len(boxes) == len(labels) == len(scores) == 1:
        return None
    return Layout.by_name([*boxes, *labels, *scores])


def decode(outputs: Sequence[NDArray[np.float32]], size_px: tuple[int, int], min_score: float) -> Candidates:
    """Left, top, right, bottom in px of the picture that was fed; numbers from 1 on, 0 is the background."""
    boxes, labels, scores = outputs
    return select_corners(boxes, scores, labels.astype(np.int64), min_score)
