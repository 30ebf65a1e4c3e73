"""PP-YOLOE and PicoDet: [N, 6], the answers of the whole batch, and [batch], how many each picture has."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.formats.candidates import Candidates, select_corners
from blurnoise_eval.formats.signature import Signature

NAME = "ppyoloe"
OUTPUTS: tuple[str, ...] = ()
LOOKALIKES = ""


def class_count(signature: Signature) -> int | None:
    """0 for [N, 6] beside [batch], where ``scale_factor`` is asked for."""
    if signature.size_px is None or "scale_factor" not in [entry.name for entry in signature.inputs]:
        return None
    shapes = [output.shape for output in signature.outputs]
    return (
        0 if len(shapes) == 2 and len(shapes[0]) == 2 and shapes[0][1] == 6 and len(shapes[1]) == 1 else None
    )


def decode(outputs: Sequence[NDArray[np.float32]], size_px: tuple[int, int], min_score: float) -> Candidates:
    """Rows of class, score, left, top, right, bottom in px; class -1 is no answer."""
    rows = outputs[0][: int(outputs[1][0])]
    rows = rows[rows[:, 0] >= 0]  # not NaN either
    return select_corners(rows[:, 2:], rows[:, 1], rows[:, 0].astype(np.int64), min_score)
