"""PP-YOLOE and PicoDet: [N, 6], the answers of the whole batch, and [batch], how many each picture has."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.detectors.formats.candidates import Candidates, select_corners
from blurnoise_eval.detectors.formats.signature import BAKED, Layout, Signature

NAME = "ppyoloe"
UNKNOWN = BAKED
SEVERAL_CLASSES = False  # one a box is all that the graph tells


def describe(signature: Signature) -> Layout | None:
    """[N, 6] beside [batch], where ``scale_factor`` is asked for."""
    if signature.size_px is None or "scale_factor" not in [entry.name for entry in signature.inputs]:
        return None
    ranks = [len(output.shape) for output in signature.outputs]
    if ranks != [2, 1] or signature.outputs[0].shape[1] != 6:
        return None
    return Layout.by_name(signature.outputs)


def decode(outputs: Sequence[NDArray[np.float32]], size_px: tuple[int, int], min_score: float) -> Candidates:
    """Rows of class, score, left, top, right, bottom in px; class -1 is no answer."""
    rows = outputs[0][: int(outputs[1][0])]
    rows = rows[rows[:, 0] >= 0]  # not NaN either
    return select_corners(rows[:, 2:], rows[:, 1], rows[:, 0].astype(np.int64), min_score)
