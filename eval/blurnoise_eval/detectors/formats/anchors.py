"""Heads with anchors, as the contract's ``head`` describes them: raw YOLOv3, v4 and v5, and their heirs.

For each level, cell and anchor: x, y, width, height, objectness and class scores, in any of these forms. An output
for each level: [1, anchors · (5 + nc), h, w], the same with channels last, [1, anchors, h, w, 5 + nc] or [1, h, w,
anchors, 5 + nc]. One output for all: [1, rows, 5 + nc], a box in each row, or a cell in each. Where a cell has one
class vector for all its anchors, it holds boxes · anchors, objectness · anchors, classes. Nor need there be a batch.

YOLO-FastestV2 is one with known anchors: for each cell of strides 16 and 32 the boxes of three anchors, their
objectness, one class vector, [A, 15 + nc] with or without a batch, or an output [1, h, w, 15 + nc] for each stride;
sigmoids and softmax applied.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.detectors.anchor_head import YOLO_FASTEST_V2, AnchorHead
from blurnoise_eval.detectors.class_names import COCO80
from blurnoise_eval.detectors.contract import Contract
from blurnoise_eval.detectors.formats.candidates import Candidates, best_class, select
from blurnoise_eval.detectors.formats.family import Family
from blurnoise_eval.detectors.formats.grids import cells, grid
from blurnoise_eval.detectors.formats.signature import Layout, Signature
from blurnoise_eval.detectors.model import Shape
from blurnoise_eval.detectors.records import FloatArray

_SHARED = 5 * YOLO_FASTEST_V2.per_cell  # columns before the classes of YOLO-FastestV2
_OWN_COCO = YOLO_FASTEST_V2.per_cell * (5 + 80)  # of heads with classes for each anchor, as YOLOv3-tiny's


def with_head(family: Family, head: AnchorHead, classes: int) -> Family:
    """The family with a head's anchors and so many classes."""
    return replace(
        family,
        describe=partial(_describe, head=head, classes=classes),
        decode=partial(_decode, head=head, classes=classes),
    )


def _describe(signature: Signature, head: AnchorHead, classes: int) -> Layout | None:
    """Outputs in one of the forms; those of levels in the order of the strides."""
    if signature.size_px is None:
        return None
    shapes = [output.shape for output in signature.outputs]
    places = _places(shapes, signature.size_px, head, classes)
    if places is None:
        return None
    return Layout.by_name([signature.outputs[place] for place in places], classes)


def _decode(
    outputs: Sequence[FloatArray],
    size_px: tuple[int, int],
    min_score: float,
    head: AnchorHead,
    classes: int,
) -> Candidates:
    """Score = objectness · class. Sources: Redmon & Farhadi, YOLOv3 (2018); YOLOv4's scale_x_y; YOLOv5's head."""
    parts = [
        _canonical(each, rows, head, classes)
        for each, rows in zip(*_by_level(outputs, size_px, head), strict=True)
    ]
    fields = np.concatenate([boxes.reshape(-1, 5) for boxes, _ in parts])
    class_rows = np.concatenate([scores.reshape(-1, classes) for _, scores in parts])
    objectness = fields[:, 4] if head.activated else _sigmoid(fields[:, 4])
    kept = np.flatnonzero(objectness >= min_score)
    # A class vector of all of a cell's anchors stands there once.
    shared = len(class_rows) != len(fields)
    class_scores = class_rows[kept // head.per_cell if shared else kept]
    class_scores = (class_scores if head.activated else _sigmoid(class_scores)) * objectness[kept, None]
    boxes = _boxes(fields[kept, :4], kept, size_px, head)
    return select(boxes, *best_class(class_scores), min_score, class_scores)


def _boxes(
    fields: FloatArray, kept: NDArray[np.int64], size_px: tuple[int, int], head: AnchorHead
) -> FloatArray:
    """Centre x, y, width, height, px; ``kept``: which of all, cell by cell, anchor by anchor."""
    per_cell = head.per_cell
    column_row, stride = (values[kept // per_cell] for values in grid(size_px, head.strides))
    level = np.searchsorted(
        np.cumsum([cells(size_px, (s,)) for s in head.strides]), kept // per_cell, "right"
    )
    scale = np.asarray(head.scales, np.float32)[level, None]
    anchor = np.asarray(head.anchors, np.float32)[level, kept % per_cell]
    squared = head.boxes == "yolov5"
    share = fields if head.activated else _sigmoid(fields)
    boxes = np.empty_like(fields)
    boxes[:, :2] = (share[:, :2] * scale - (scale - 1) / 2 + column_row) * stride
    with np.errstate(over="ignore"):  # an overflow gives an infinite box, which is dropped
        boxes[:, 2:] = ((2 * share[:, 2:]) ** 2 if squared else np.exp(fields[:, 2:])) * anchor
    return boxes


def _sigmoid(logits: FloatArray) -> FloatArray:
    return np.asarray(0.5 * (1 + np.tanh(logits / 2)), np.float32)  # without overflow


def _grids(size_px: tuple[int, int], head: AnchorHead) -> list[tuple[int, int]]:
    return [(-(-size_px[0] // s), -(-size_px[1] // s)) for s in head.strides]


def _places(
    shapes: Sequence[Shape], size_px: tuple[int, int], head: AnchorHead, classes: int
) -> list[int] | None:
    """Which outputs hold the levels, in the order of the strides; that of all levels once; None if none do."""
    per_box, per_cell = 5 + classes, head.per_cell
    widths = (per_cell * per_box, 5 * per_cell + classes)
    number = cells(size_px, head.strides)
    for place, shape in enumerate(shapes):
        rows = shape[-2:] if len(shape) == 2 or (len(shape) == 3 and shape[0] == 1) else None
        if rows == (per_cell * number, per_box) or (rows and rows[0] == number and rows[1] in widths):
            return [place]
    found = []
    for height, width in _grids(size_px, head):
        forms = [(n, height, width) for n in widths] + [(height, width, n) for n in widths]
        forms += [(per_cell, height, width, per_box), (height, width, per_cell, per_box)]  # type: ignore[list-item]
        own = [place for place, shape in enumerate(shapes) if len(shape) >= 4 and shape[1:] in forms]
        if len(own) != 1:
            return None
        found += own
    return found


def _by_level(
    outputs: Sequence[FloatArray], size_px: tuple[int, int], head: AnchorHead
) -> tuple[list[FloatArray], list[tuple[int, int]]]:
    """A level's values each, without a batch, and its grid."""
    grids = _grids(size_px, head)
    if len(outputs) > 1 or outputs[0].ndim >= 4:
        return [output[0] for output in outputs], grids
    rows = outputs[0].reshape(-1, outputs[0].shape[-1])
    counts = np.array([height * width for height, width in grids])
    ends = np.cumsum(counts * (len(rows) // counts.sum()))
    return np.split(rows, ends[:-1]), grids


def _canonical(
    level: FloatArray, grid_size: tuple[int, int], head: AnchorHead, classes: int
) -> tuple[FloatArray, FloatArray]:
    """Boxes with objectness (cells, anchors, 5) and class scores (cells, anchors, classes), or (cells, classes)."""
    count, per_cell, per_box = grid_size[0] * grid_size[1], head.per_cell, 5 + classes
    if level.ndim == 4:  # an axis for the anchors: before the grid, or behind it
        level = np.moveaxis(level, 0, 2) if level.shape[:3] == (per_cell, *grid_size) else level
        level = level.reshape(count, per_cell * per_box)
    elif level.ndim == 3:  # channels before the grid, or behind it
        level = (np.moveaxis(level, 0, 2) if level.shape[1:] == grid_size else level).reshape(count, -1)
    elif len(level) != count:  # a box in each row
        if head.order == "anchor":
            level = level.reshape(per_cell, count, per_box).transpose(1, 0, 2)
        level = level.reshape(count, per_cell * per_box)
    if level.shape[1] == per_cell * per_box:
        boxes = level.reshape(count, per_cell, per_box)
        return boxes[..., :5], boxes[..., 5:]
    sides = level[:, : 4 * per_cell].reshape(count, per_cell, 4)
    return np.concatenate([sides, level[:, 4 * per_cell : 5 * per_cell, None]], axis=2), level[
        :, 5 * per_cell :
    ]


def _describe_fastest_v2(signature: Signature) -> Layout | None:
    """Rows, or planes with the channels last."""
    width = signature.outputs[0].shape[-1]
    if not isinstance(width, int) or width <= _SHARED or width == _OWN_COCO:
        return None
    return _describe(signature, YOLO_FASTEST_V2, width - _SHARED)


def _decode_fastest_v2(
    outputs: Sequence[FloatArray], size_px: tuple[int, int], min_score: float
) -> Candidates:
    """With COCO's anchors."""
    return _decode(outputs, size_px, min_score, YOLO_FASTEST_V2, outputs[0].shape[-1] - _SHARED)


def _no_head(outputs: Sequence[FloatArray], size_px: tuple[int, int], min_score: float) -> Candidates:
    raise ValueError("head: must be stated in the contract of family anchors")


# YOLOv5's val.py, darknet's validation and Yolo-FastestV2's: every class that reaches the threshold. Nothing in a
# graph shows its anchors.
ANCHORS = Family(
    Contract("anchors", COCO80, input_size_px=(640, 640), nms_iou=0.6),
    lambda signature: None,
    _no_head,
    several_classes=True,
    takes_head=True,
)
YOLOFASTESTV2 = Family(
    Contract(
        "yolofastestv2",
        COCO80,
        colour="bgr",
        resize="stretch",
        input_size_px=(352, 352),
        nms_iou=0.4,
        head=YOLO_FASTEST_V2,
    ),
    _describe_fastest_v2,
    _decode_fastest_v2,
    unknown="whether it was trained with anchors of its own, which the contract's head then states",
    several_classes=True,
    takes_head=True,
)
