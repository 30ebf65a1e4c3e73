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

from blurnoise_eval.detectors.class_names import COCO80
from blurnoise_eval.detectors.contract import AnchorHead, Contract
from blurnoise_eval.detectors.formats.candidates import Candidates, best_class, select, sigmoid
from blurnoise_eval.detectors.formats.family import Family, cells
from blurnoise_eval.detectors.formats.grids import grid
from blurnoise_eval.detectors.records import FloatArray

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
    outputs: Sequence[FloatArray],
    size_px: tuple[int, int],
    min_score: float,
    head: AnchorHead,
    classes: int,
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
    cell, place = np.divmod(kept, head.per_cell)
    column_row, stride = (values[cell] for values in grid(size_px, head.strides))
    level = np.repeat(np.arange(len(head.strides)), _counts(size_px, head))[cell]
    scale = np.asarray(head.scales, np.float32)[level, None]
    anchor = np.asarray(head.anchors, np.float32)[level, place]
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
    unknown="whether it was trained with anchors of its own, which the contract's head then states",
    several_classes=True,
    takes_head=True,
)  # fmt: skip
