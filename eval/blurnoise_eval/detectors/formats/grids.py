"""Families whose outputs hold a row, or a column, for each cell of their grids, stride after stride, row by row.

YOLOX, FastestDet, NanoDet and NanoDet-Plus, which states the distances of a box's four
sides from a cell's centre, each as a distribution.

And heads with anchors, as the contract's ``head`` describes them: raw YOLOv3, v4 and v5, and their heirs. For each
level, cell and anchor: x, y, width, height, objectness and class scores, in any of these forms. An output for each
level: [1, anchors · (5 + nc), h, w], the same with channels last, [1, anchors, h, w, 5 + nc] or [1, h, w, anchors,
5 + nc]. One output for all: [1, rows, 5 + nc], a box in each row, or a cell in each. Where a cell has one vector of
classes, it holds boxes · anchors, objectness · anchors, classes. Nor need there be a batch. YOLO-FastestV2
is one with known anchors: [A, 15 + nc] of strides 16 and 32, or an output [1, h, w, 15 + nc] for each.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.detectors.contract import COCO80, AnchorHead, Contract
from blurnoise_eval.detectors.formats.boxes import Candidates, best_class, select, sigmoid
from blurnoise_eval.detectors.formats.family import STRIDES, STRIDES_64, Family, cells
from blurnoise_eval.detectors.records import FloatArray

_BINS = 8  # of a side's distance, 0 to 7 strides
_SIDES = 4 * _BINS


@cache
def grid(size_px: tuple[int, int], strides: tuple[int, ...] = STRIDES) -> tuple[FloatArray, FloatArray]:
    """Return (column, row) of every cell, (A, 2), and its stride, (A, 1), px."""
    column_row, stride = [], []
    for s in strides:
        rows, columns = np.indices((-(-size_px[0] // s), -(-size_px[1] // s)), dtype=np.float32)
        column_row.append(np.stack([columns.ravel(), rows.ravel()], axis=1))
        stride.append(np.full((rows.size, 1), s, np.float32))
    return np.concatenate(column_row), np.concatenate(stride)


def _decode_yolox(outputs: Sequence[FloatArray], size_px: tuple[int, int], min_score: float) -> Candidates:
    """Score = objectness · class; centre = (offset + cell) · stride, size = exp(offset) · stride, px.

    Source: Ge et al., YOLOX (2021), as in the reference code's ``demo_postprocess``.
    """
    rows = outputs[0][0]
    kept = np.flatnonzero(rows[:, 4] >= min_score)  # which NaN does not reach
    rows = rows[kept]
    # Before anything is computed of the boxes, or which class leads them; the product of the highest is the highest.
    strong = np.flatnonzero(rows[:, 5:].max(axis=1) * rows[:, 4] >= min_score)
    kept, rows = kept[strong], rows[strong]
    class_scores, boxes = rows[:, 5:], rows[:, :4]
    class_scores *= rows[:, 4:5]
    scores, class_ids = best_class(class_scores)
    column_row, stride = (values[kept] for values in grid(size_px))
    boxes[:, :2] += column_row
    with np.errstate(over="ignore"):  # an overflow gives an infinite box, which is dropped
        np.exp(boxes[:, 2:], out=boxes[:, 2:])
        boxes *= stride
    return select(boxes, scores, class_ids, min_score, class_scores)


def _decode_fastest(outputs: Sequence[FloatArray], size_px: tuple[int, int], min_score: float) -> Candidates:
    """Score = objectness^0.6 · class^0.4; centre = (tanh(offset) + cell) / grid, size = sigmoid(offset).

    Both are shares of the input. Source: the reference code's ``handle_preds``.
    """
    height, width = outputs[0].shape[2:]
    columns = outputs[0][0].reshape(-1, height * width)
    kept = np.flatnonzero(columns[0] >= min_score ** (1 / 0.6))  # class scores are at most 1
    rows = columns[:, kept].T
    class_scores, class_ids = best_class(rows[:, 5:])
    scores = rows[:, 0] ** 0.6 * class_scores**0.4
    input_wh = np.array([size_px[1], size_px[0]], np.float32)
    cell = input_wh / np.array([width, height], np.float32)
    boxes = np.empty((len(kept), 4), np.float32)
    boxes[:, :2] = (np.tanh(rows[:, 1:3]) + grid(size_px, (16,))[0][kept]) * cell
    boxes[:, 2:] = sigmoid(rows[:, 3:5]) * input_wh
    of_classes = np.maximum(rows[:, 5:], 0) ** 0.4 * rows[:, :1] ** 0.6
    return select(boxes, scores, class_ids, min_score, of_classes)


def _decode_nano(outputs: Sequence[FloatArray], size_px: tuple[int, int], min_score: float) -> Candidates:
    """A side lies the mean of its softmax over 0 to 7 strides from the cell's centre; boxes end at the input's edge.

    A cell's centre is (column, row) · stride + (stride - 1) / 2 px; of NanoDet-Plus, which has one output with class
    scores and sides in a row, without the half pixel. Source: Li et al., Generalized Focal Loss (2020).
    """
    flat = [output.reshape(-1, output.shape[-1]) for output in outputs]
    if plus := len(flat) == 1:
        class_scores, sides = flat[0][:, :-_SIDES], flat[0][:, -_SIDES:]
    else:
        class_scores, sides = np.concatenate(flat[::2]), np.concatenate(flat[1::2])
    column_row, stride = grid(size_px, STRIDES_64 if plus else STRIDES)
    scores, class_ids = best_class(class_scores)
    kept = np.flatnonzero(scores >= min_score)
    column_row, stride = column_row[kept], stride[kept]
    logits = sides[kept].reshape(-1, 4, _BINS)
    powers = np.exp(logits - logits.max(axis=2, keepdims=True))
    mean = powers @ np.arange(_BINS, dtype=np.float32) / powers.sum(axis=2)
    reach = (mean * stride).astype(np.float32)
    centres = column_row * stride + (0 if plus else (stride - 1) / 2)
    corners = np.concatenate([centres - reach[:, :2], centres + reach[:, 2:]], axis=1)
    inside = np.clip(corners, 0, np.array([size_px[1], size_px[0]] * 2, np.float32))
    return select(inside, scores[kept], class_ids[kept], min_score, class_scores[kept], corners=True)


# Its postprocess: torch.max over the classes.
YOLOX = Family(
    Contract(
        "yolox", COCO80, colour="bgr", value_range="0-255", resize="letterbox-top-left", input_size_px=(416, 416),
        nms_iou=0.65,
    ),
    ("b A 5+C",),
    _decode_yolox,
    unknown="whether it is YOLOX 0.1.0, whose graph is the same, but with rgb, 0-1, mean and std of ImageNet",
)  # fmt: skip
# Its handle_preds: argmax over the classes.
FASTESTDET = Family(
    Contract("fastestdet", COCO80, colour="bgr", resize="stretch", input_size_px=(352, 352), nms_iou=0.45),
    ("b 5+C H16 W16",),
    _decode_fastest,
)
_NANO: dict[str, Any] = {"colour": "bgr", "value_range": "0-255", "input_size_px": (320, 320), "nms_iou": 0.6}
_NANO |= {"mean": (103.53, 116.28, 123.675), "std": (57.375, 57.12, 58.395)}
# NanoDet before "Plus": names of scores and sides can be swapped, so widths decide; with 32 classes nothing does.
# Both: multiclass_nms.
NANODET = Family(
    Contract("nanodet", COCO80, resize="letterbox", pad_value=0, **_NANO),
    ("b A8 C, b A8 32, b A16 C, b A16 32, b A32 C, b A32 32", "A8 C, A8 32, A16 C, A16 32, A32 C, A32 32"),
    _decode_nano,
    several_classes=True,
)
NANODETPLUS = Family(
    Contract("nanodetplus", COCO80, resize="stretch", **_NANO),
    ("b A 32+C",),
    _decode_nano,
    strides=(STRIDES_64,),
    several_classes=True,
)


YOLO_FASTEST_V2 = AnchorHead(
    strides=(16, 32),
    anchors=(
        ((12.64, 19.39), (37.88, 51.48), (55.71, 138.31)),
        ((126.91, 78.23), (131.57, 214.55), (279.92, 258.87)),
    ),
    activated=True,
)
"""Of COCO at 352 px: the repository's data/coco.data."""


def with_head(family: Family, head: AnchorHead, classes: int) -> Family:
    """The family with a head's anchors and so many classes."""
    per_box, per_cell = 5 + classes, head.per_cell
    shared = 5 * per_cell + classes
    rows = [f"{per_cell}A {per_box}", f"A {per_cell * per_box}", f"A {shared}"]
    levels = [f"{per_cell} H W {per_box}", f"H W {per_cell} {per_box}"]
    levels += [form for n in (per_cell * per_box, shared) for form in (f"{n} H W", f"H W {n}")]
    return replace(
        family,
        layouts=_layouts(rows, levels, head),
        strides=(head.strides,),
        decode=partial(_decode, head=head, classes=classes),
    )


def _layouts(rows: Sequence[str], levels: Sequence[str], head: AnchorHead) -> tuple[str, ...]:
    """One output of rows, with a batch or without, or of each level one, in the order of the strides."""
    whole = [f"{batch}{form}, ..." for form in rows for batch in ("1 ", "")]
    by_level = [", ".join(_at_stride(form, s) for s in head.strides) + ", ..." for form in levels]
    return (*whole, *by_level)


def _at_stride(form: str, stride: int) -> str:
    return f"b {form}".replace("H", f"H{stride}").replace("W", f"W{stride}")


def _decode(
    outputs: Sequence[FloatArray], size_px: tuple[int, int], min_score: float, head: AnchorHead, classes: int
) -> Candidates:
    """Score = objectness · class. Sources: Redmon & Farhadi, YOLOv3 (2018); YOLOv4's scale_x_y; YOLOv5's head."""
    rows = _cell_rows(outputs, size_px, head)
    anchors, per_box = head.per_cell, 5 + classes
    shared = rows.shape[1] != anchors * per_box  # a class vector of all of a cell's anchors
    if shared:
        sides = rows[:, : 4 * anchors].reshape(-1, anchors, 4)
        fields = np.concatenate([sides, rows[:, 4 * anchors : 5 * anchors, None]], axis=2).reshape(-1, 5)
        class_rows = rows[:, 5 * anchors :]
    else:
        fields, class_rows = np.split(rows.reshape(-1, per_box), [5], axis=1)
    objectness = fields[:, 4] if head.activated else sigmoid(fields[:, 4])
    kept = np.flatnonzero(objectness >= min_score)
    class_scores = class_rows[kept // anchors if shared else kept]
    class_scores = (class_scores if head.activated else sigmoid(class_scores)) * objectness[kept, None]
    boxes = _boxes(fields[kept, :4], kept, size_px, head)
    return select(boxes, *best_class(class_scores), min_score, class_scores)


def _boxes(
    fields: FloatArray, kept: NDArray[np.int64], size_px: tuple[int, int], head: AnchorHead
) -> FloatArray:
    """Centre x, y, width, height, px; ``kept``: which of all, cell by cell, anchor by anchor."""
    cell, anchor_index = np.divmod(kept, head.per_cell)
    column_row, stride = (values[cell] for values in grid(size_px, head.strides))
    level = np.repeat(np.arange(len(head.strides)), _counts(size_px, head))[cell]
    scale = np.asarray(head.scales, np.float32)[level, None]
    anchor = np.asarray(head.anchors, np.float32)[level, anchor_index]
    share = fields if head.activated else sigmoid(fields)
    boxes = np.empty_like(fields)
    boxes[:, :2] = (share[:, :2] * scale - (scale - 1) / 2 + column_row) * stride
    with np.errstate(over="ignore"):  # an overflow gives an infinite box, which is dropped
        squared = head.boxes == "yolov5"
        boxes[:, 2:] = ((2 * share[:, 2:]) ** 2 if squared else np.exp(fields[:, 2:])) * anchor
    return boxes


def _counts(size_px: tuple[int, int], head: AnchorHead) -> list[int]:
    """Cells of each level."""
    return [cells(size_px, (stride,)) for stride in head.strides]


def _cell_rows(outputs: Sequence[FloatArray], size_px: tuple[int, int], head: AnchorHead) -> FloatArray:
    """A row for each cell, level by level, in whichever form the outputs hold them."""
    counts = _counts(size_px, head)
    if outputs[0].ndim >= 4:
        parts = []
        for (level, *_), stride, count in zip(outputs, head.strides, counts, strict=True):
            grid_size = -(-size_px[0] // stride), -(-size_px[1] // stride)
            first = (
                1 if level.shape[1:3] == grid_size else 0
            )  # channels or anchors before the grid, or behind it
            parts.append(np.moveaxis(level, (first, first + 1), (0, 1)).reshape(count, -1))
        return np.concatenate(parts)
    rows = outputs[0].reshape(-1, outputs[0].shape[-1])
    if len(rows) != sum(counts) and head.order == "anchor":  # a box in each row
        levels = np.split(rows, np.cumsum(counts)[:-1] * head.per_cell)
        rows = np.concatenate([np.concatenate(np.split(level, head.per_cell), axis=1) for level in levels])
    return rows.reshape(sum(counts), -1)


def _decode_fastest_v2(
    outputs: Sequence[FloatArray], size_px: tuple[int, int], min_score: float
) -> Candidates:
    """With COCO's anchors."""
    classes = outputs[0].shape[-1] - 5 * YOLO_FASTEST_V2.per_cell
    return _decode(outputs, size_px, min_score, YOLO_FASTEST_V2, classes)


# YOLOv5's val.py, darknet's validation and Yolo-FastestV2's: every class that reaches the threshold. Nothing in a
# graph shows its anchors.
ANCHORS = Family(
    Contract("anchors", COCO80, input_size_px=(640, 640), nms_iou=0.6),
    (),
    _decode_fastest_v2,
    several_classes=True,
    takes_head=True,
)
YOLOFASTESTV2 = Family(
    Contract(
        "yolofastestv2", COCO80, colour="bgr", resize="stretch", input_size_px=(352, 352), nms_iou=0.4,
        head=YOLO_FASTEST_V2,
    ),
    _layouts(["A 15+C"], ["H W 15+C"], YOLO_FASTEST_V2),
    _decode_fastest_v2,
    strides=(YOLO_FASTEST_V2.strides,),
    unknown="whether it was trained with other anchors; if so, set them as 'head' of the contract",
    several_classes=True,
    takes_head=True,
)  # fmt: skip

FAMILIES = (YOLOX, FASTESTDET, NANODET, NANODETPLUS, YOLOFASTESTV2)
