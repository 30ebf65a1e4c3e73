"""YOLOX: [1, A, 5 + nc], boxes relative to their grid cell, objectness and classes already in [0, 1]."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.formats.candidates import Candidates, best_class, select
from blurnoise_eval.formats.signature import Signature, cells

NAME = "yolox"
OUTPUTS: tuple[str, ...] = ()
LOOKALIKES = "YOLOX 0.1.0 (rgb, 0-1, mean and std of ImageNet) and YOLOv6 show the same shapes"
STRIDES = (8, 16, 32)


def class_count(signature: Signature) -> int | None:
    """Classes of [batch, A, 5 + nc]."""
    shape = signature.outputs[0].shape
    if signature.size_px is None or len(shape) != 3 or not isinstance(shape[2], int) or shape[2] < 6:
        return None
    return shape[2] - 5 if len(signature.outputs) == 1 and shape[1] == cells(signature.size_px) else None


def decode(outputs: Sequence[NDArray[np.float32]], size_px: tuple[int, int], min_score: float) -> Candidates:
    """Score = objectness · class; centre = (offset + cell) · stride, size = exp(offset) · stride, px.

    Source: Ge et al., YOLOX (2021), as in the reference code's ``demo_postprocess``.
    """
    rows = outputs[0][0]
    kept = np.flatnonzero(rows[:, 4] >= min_score)
    rows = rows[kept]
    column_row, stride = _grid(size_px)
    centres = (rows[:, :2] + column_row[kept]) * stride[kept]
    with np.errstate(over="ignore"):  # an overflow gives an infinite box, which is dropped
        sizes = np.exp(rows[:, 2:4]) * stride[kept]
    class_scores, class_ids = best_class(rows[:, 5:])
    boxes = np.concatenate([centres, sizes], axis=1)
    return select(boxes, rows[:, 4] * class_scores, class_ids, min_score)


@cache
def _grid(size_px: tuple[int, int]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return (column, row) of every cell, (A, 2), and its stride, (A, 1), px, stride after stride."""
    column_row, stride = [], []
    for s in STRIDES:
        rows, columns = np.indices((-(-size_px[0] // s), -(-size_px[1] // s)), dtype=np.float32)
        column_row.append(np.stack([columns.ravel(), rows.ravel()], axis=1))
        stride.append(np.full((rows.size, 1), s, np.float32))
    return np.concatenate(column_row), np.concatenate(stride)
