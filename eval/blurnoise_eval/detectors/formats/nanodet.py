"""NanoDet and NanoDet-Plus: class scores in [0, 1] and distributions of the four sides' distances, cell by cell."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from blurnoise_eval.detectors.class_names import COCO80
from blurnoise_eval.detectors.contract import Contract
from blurnoise_eval.detectors.formats.candidates import Candidates, best_class, select_corners
from blurnoise_eval.detectors.formats.family import Family
from blurnoise_eval.detectors.formats.grids import STRIDES, STRIDES_64, cells, grid, layout_by_cells
from blurnoise_eval.detectors.formats.signature import Layout, Signature
from blurnoise_eval.detectors.records import FloatArray

_BINS = 8  # of a side's distance, 0 to 7 strides
_SIDES = 4 * _BINS
_VALUES: dict[str, Any] = {
    "colour": "bgr",
    "value_range": "0-255",
    "mean": (103.53, 116.28, 123.675),
    "std": (57.375, 57.12, 58.395),
    "input_size_px": (320, 320),
    "nms_iou": 0.6,
}


def _describe(signature: Signature) -> Layout | None:
    """Two outputs for each stride, of as many rows as it has cells: [n, nc] and [n, 32], or with a batch.

    Of NanoDet before "Plus". Their names can be swapped, so widths decide; with 32 classes nothing does.
    """
    if signature.size_px is None or len(signature.outputs) != 2 * len(STRIDES):
        return None
    by_shape = {output.shape[-2:]: output for output in signature.outputs if len(output.shape) in (2, 3)}
    widths = {shape[1] for shape in by_shape}
    others = [width for width in widths if width != _SIDES]
    if len(widths) != 2 or len(others) != 1 or not isinstance(others[0], int):
        return None
    counts = [cells(signature.size_px, (stride,)) for stride in STRIDES]
    if set(by_shape) != {(count, width) for count in counts for width in (others[0], _SIDES)}:
        return None
    ordered = [by_shape[count, width] for count in counts for width in (others[0], _SIDES)]
    return Layout.by_name(ordered, others[0])


def _decode(outputs: Sequence[FloatArray], size_px: tuple[int, int], min_score: float) -> Candidates:
    """A cell's centre is (column, row) · stride + (stride - 1) / 2 px."""
    flat = [output.reshape(-1, output.shape[-1]) for output in outputs]
    column_row, stride = grid(size_px)
    centres = np.add(column_row * stride, (stride - 1) / 2, dtype=np.float32)
    scores, sides = np.concatenate(flat[::2]), np.concatenate(flat[1::2])
    return _candidates(scores, sides, centres, stride, size_px, min_score)


def _describe_plus(signature: Signature) -> Layout | None:
    """[batch, A, nc + 32], A over strides 8 to 64."""
    if len(signature.outputs) != 1:
        return None
    return layout_by_cells(signature, columns=_SIDES, strides=(STRIDES_64,))


def _decode_plus(outputs: Sequence[FloatArray], size_px: tuple[int, int], min_score: float) -> Candidates:
    """A cell's centre is its (column, row) · stride, without the half pixel of its predecessor."""
    rows = outputs[0][0]
    column_row, stride = grid(size_px, STRIDES_64)
    scores, sides = rows[:, :-_SIDES], rows[:, -_SIDES:]
    return _candidates(scores, sides, column_row * stride, stride, size_px, min_score)


def _candidates(
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
    logits = sides[kept].reshape(-1, 4, _BINS)
    powers = np.exp(logits - logits.max(axis=2, keepdims=True))
    mean = powers @ np.arange(_BINS, dtype=np.float32) / powers.sum(axis=2)
    reach = (mean * stride_px[kept]).astype(np.float32)
    centres = centres_px[kept]
    corners = np.concatenate([centres - reach[:, :2], centres + reach[:, 2:]], axis=1)
    edge = np.array([size_px[1], size_px[0]] * 2, np.float32)
    return select_corners(
        np.clip(corners, 0, edge), scores[kept], class_ids[kept], min_score, class_scores[kept]
    )


# Both: multiclass_nms.
NANODET = Family(
    Contract("nanodet", COCO80, resize="letterbox", pad_value=0, **_VALUES),
    _describe,
    _decode,
    several_classes=True,
)
NANODETPLUS = Family(
    Contract("nanodetplus", COCO80, resize="stretch", **_VALUES),
    _describe_plus,
    _decode_plus,
    several_classes=True,
)
