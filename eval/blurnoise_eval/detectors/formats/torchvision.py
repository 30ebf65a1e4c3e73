"""torchvision's detectors: boxes [N, 4], labels [N] and scores [N] of one picture [3, H, W], none doubled."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.detectors.formats.candidates import Candidates, select_corners
from blurnoise_eval.detectors.formats.signature import BACKGROUND_FIRST, Layout, Signature

NAME = "torchvision"
UNKNOWN = BACKGROUND_FIRST
SEVERAL_CLASSES = False  # one a box is all that the graph tells


def describe(signature: Signature) -> Layout | None:
    """One [N, 4], one [N] of integers and one [N] of floats: the order differs between its models."""
    found = None if signature.size_px is None or signature.asks_for_size else signature.of_one_picture()
    return None if found is None else Layout.by_name(found)


def decode(outputs: Sequence[NDArray[np.float32]], size_px: tuple[int, int], min_score: float) -> Candidates:
    """Left, top, right, bottom in px of the picture that was fed; numbers from 1 on, 0 is the background."""
    boxes, labels, scores = outputs
    return select_corners(boxes, scores, labels.astype(np.int64), min_score)
