"""The grid cells of an input, stride after stride, row by row: where grid detectors put their answers."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np

from blurnoise_eval.detectors.formats.signature import Layout, Signature
from blurnoise_eval.detectors.records import FloatArray

STRIDES = (8, 16, 32)
STRIDES_64 = (8, 16, 32, 64)


def cells(size_px: tuple[int, int], strides: Sequence[int] = STRIDES) -> int:
    """A = Σ ceil(H/s) ceil(W/s): the number of grid cells of an input (height, width) px."""
    return sum(-(-size_px[0] // s) * -(-size_px[1] // s) for s in strides)


@cache
def grid(size_px: tuple[int, int], strides: tuple[int, ...] = STRIDES) -> tuple[FloatArray, FloatArray]:
    """Return (column, row) of every cell, (A, 2), and its stride, (A, 1), px."""
    column_row, stride = [], []
    for s in strides:
        rows, columns = np.indices((-(-size_px[0] // s), -(-size_px[1] // s)), dtype=np.float32)
        column_row.append(np.stack([columns.ravel(), rows.ravel()], axis=1))
        stride.append(np.full((rows.size, 1), s, np.float32))
    return np.concatenate(column_row), np.concatenate(stride)


def layout_by_cells(
    signature: Signature, *, columns: int, strides: Sequence[Sequence[int]], anchors: int = 1
) -> Layout | None:
    """The layout of one output [batch, anchors · A, columns + classes], A for one of ``strides``; else None."""
    output = signature.outputs[0]
    if signature.size_px is None or len(output.shape) != 3:
        return None
    _, rows, width = output.shape
    if not isinstance(width, int) or width <= columns:
        return None
    for each in strides:
        if rows == anchors * cells(signature.size_px, each):
            times = f"{anchors} x " if anchors > 1 else ""
            counted = f"{rows} = {times}the cells of strides {', '.join(map(str, each))}"
            return Layout.of(output, f"{counted}; {columns} + {width - columns} columns", width - columns)
    return None
