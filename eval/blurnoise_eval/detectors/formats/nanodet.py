"""NanoDet before "Plus": for each stride class scores [n, nc] and side distributions [n, 32], six outputs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.detectors.formats.candidates import Candidates, FloatArray, best_class, select_corners
from blurnoise_eval.detectors.formats.grids import STRIDES, cells, grid
from blurnoise_eval.detectors.formats.signature import Layout, Signature

NAME = "nanodet"
UNKNOWN = ""
SEVERAL_CLASSES = True  # multiclass_nms
BINS = 8  # of a side's distance, 0 to 7 strides
SIDES = 4 * BINS


def describe(signature: Signature) -> Layout | None:
    """Two outputs for each stride, of as many rows as it has cells: [n, nc] and [n, 32], or with a batch.

    Their names can be swapped, so widths decide; with 32 classes nothing does.
    """
    if signature.size_px is None or len(signature.outputs) != 2 * len(STRIDES):
        return None
    by_shape = {output.shape[-2:]: output for output in signature.outputs if len(output.shape) in (2, 3)}
    widths = {shape[1] for shape in by_shape}
    others = [width for width in widths if width != SIDES]
    if len(widths) != 2 or len(others) != 1 or not isinstance(others[0], int):
        return None
    counts = [cells(signature.size_px, (stride,)) for stride in STRIDES]
    if set(by_shape) != {(count, width) for count in counts for width in (others[0], SIDES)}:
        return None
    ordered = [by_shape[count, width] for count in counts for width in (others[0], SIDES)]
    return Layout.by_name(ordered, others[0])


def decode(outputs: Sequence[NDArray[np.float32]], size_px: tuple[int, int], min_score: float) -> Candidates:
    """A cell's centre is (column, row) · stride + (stride - 1) / 2 px."""
    flat = [output.reshape(-1, output.shape[-1]) for output in outputs]
    column_row, stride = grid(size_px)
    centres = np.add(column_row * stride, (stride - 1) / 2, dtype=np.float32)
    scores, sides = np.concatenate(flat[::2]), np.concatenate(flat[1::2])
    return candidates(scores, sides, centres, stride, size_px, min_score)


def candidates(
    class_scores: FloatArray,
    sides: FloatArray,
    centres_px: FloatArray,
    stride_px: FloatArray,
    size_px: tuple[int, int],
    min_score: float,
) -> Candidates:
    """Boxes around ``centres_px``: a side lies the mean of its softmax over 0 to 7 strides away.

    class_scores: (A, nc). sides: (A, 32) logits of left, top, right, bottom. Boxes end at the input's edge.
    Source: Li et al., Generalized Focal Loss (2020).
    """
    scores, class_ids = best_class(class_scores)
    kept = np.flatnonzero(scores >= min_score)
    logits = sides[kept].reshape(-1, 4, BINS)
    powers = np.exp(logits - logits.max(axis=2, keepdims=True))
    mean = powers @ np.arange(BINS, dtype=np.float32) / powers.sum(axis=2)
    reach = (mean * stride_px[kept]).astype(np.float32)
    centres = centres_px[kept]
    corners = np.concatenate([centres - reach[:, :2], centres + reach[:, 2:]], axis=1)
    edge = np.array([size_px[1], size_px[0]] * 2, np.float32)
    return select_corners(
        np.clip(corners, 0, edge), scores[kept], class_ids[kept], min_score, class_scores[kept]
    )
