"""FastestDet: [1, 5 + nc, h, w], one box per cell of a single stride-16 grid."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.formats.candidates import Candidates, best_class, select
from blurnoise_eval.formats.signature import Signature

NAME = "fastestdet"
OUTPUTS: tuple[str, ...] = ()
LOOKALIKES = ""
STRIDE = 16


def class_count(signature: Signature) -> int | None:
    """Classes of [batch, 5 + nc, ceil(H/16), ceil(W/16)]."""
    shape = signature.outputs[0].shape
    if signature.size_px is None or len(shape) != 4 or not isinstance(shape[1], int) or shape[1] < 6:
        return None
    grid = tuple(-(-size // STRIDE) for size in signature.size_px)
    return shape[1] - 5 if len(signature.outputs) == 1 and shape[2:] == grid else None


def decode(outputs: Sequence[NDArray[np.float32]], size_px: tuple[int, int], min_score: float) -> Candidates:
    """Score = objectness^0.6 · class^0.4; centre = (tanh(offset) + cell) / grid, size = sigmoid(offset).

    Both are shares of the input. Source: the reference code's ``handle_preds``.
    """
    grid = outputs[0][0]
    height, width = grid.shape[1:]
    columns = grid.reshape(len(grid), -1)
    # Class scores are at most 1, so no score exceeds objectness^0.6.
    kept = np.flatnonzero(columns[0] >= min_score ** (1 / 0.6))
    rows = columns[:, kept].T
    input_wh = np.array([size_px[1], size_px[0]], np.float32)
    cell_xy = np.stack([kept % width, kept // width], axis=1).astype(np.float32)
    centres = (np.tanh(rows[:, 1:3]) + cell_xy) * (input_wh / np.array([width, height], np.float32))
    sizes = 0.5 * (1 + np.tanh(rows[:, 3:5] / 2)) * input_wh  # the sigmoid, without overflow
    class_scores, class_ids = best_class(rows[:, 5:])
    boxes = np.concatenate([centres, sizes], axis=1)
    return select(boxes, rows[:, 0] ** 0.6 * class_scores**0.4, class_ids, min_score)
