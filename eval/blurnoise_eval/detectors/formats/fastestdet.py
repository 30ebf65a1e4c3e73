"""FastestDet: [1, 5 + nc, h, w], one box per cell of a single stride-16 grid."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from blurnoise_eval.detectors.class_names import COCO80
from blurnoise_eval.detectors.contract import Contract
from blurnoise_eval.detectors.formats.candidates import Candidates, best_class, from_centres
from blurnoise_eval.detectors.formats.family import Family
from blurnoise_eval.detectors.formats.signature import Layout, Signature
from blurnoise_eval.detectors.records import FloatArray

_STRIDE = 16


def _describe(signature: Signature) -> Layout | None:
    """[batch, 5 + nc, ceil(H/16), ceil(W/16)]."""
    output = signature.outputs[0]
    if signature.size_px is None or len(signature.outputs) != 1 or len(output.shape) != 4:
        return None
    channels = output.shape[1]
    grid = tuple(-(-size // _STRIDE) for size in signature.size_px)
    if output.shape[2:] != grid or not isinstance(channels, int) or channels < 6:
        return None
    return Layout.of(output, f"the cells of stride 16; 5 + {channels - 5} channels", channels - 5)


def _decode(outputs: Sequence[FloatArray], size_px: tuple[int, int], min_score: float) -> Candidates:
    """Score = objectness^0.6 · class^0.4; centre = (tanh(offset) + cell) / grid, size = sigmoid(offset).

    Both are shares of the input. Source: the reference code's ``handle_preds``.
    """
    grid = outputs[0][0]
    height, width = grid.shape[1:]
    columns = grid.reshape(len(grid), -1)
    # Class scores are at most 1, so no score exceeds objectness^0.6.
    kept = np.flatnonzero(columns[0] >= min_score ** (1 / 0.6))
    rows = columns[:, kept].T
    class_scores, class_ids = best_class(rows[:, 5:])
    scores = rows[:, 0] ** 0.6 * class_scores**0.4
    strong = np.flatnonzero(scores >= min_score)  # before anything is computed of the boxes
    kept, rows = kept[strong], rows[strong]
    input_wh = np.array([size_px[1], size_px[0]], np.float32)
    cell_xy = np.stack([kept % width, kept // width], axis=1).astype(np.float32)
    boxes = np.empty((len(kept), 4), np.float32)
    boxes[:, :2] = (np.tanh(rows[:, 1:3]) + cell_xy) * (input_wh / np.array([width, height], np.float32))
    boxes[:, 2:] = 0.5 * (1 + np.tanh(rows[:, 3:5] / 2)) * input_wh  # the sigmoid, without overflow
    each = np.maximum(rows[:, 5:], 0) ** 0.4
    each *= rows[:, :1] ** 0.6
    return from_centres(boxes, scores[strong], class_ids[strong], each)


# Its handle_preds: argmax over the classes.
FASTESTDET = Family(
    Contract("fastestdet", COCO80, colour="bgr", resize="stretch", input_size_px=(352, 352), nms_iou=0.45),
    _describe,
    _decode,
)
