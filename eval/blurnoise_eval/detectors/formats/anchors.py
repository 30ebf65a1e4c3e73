"""Heads with anchors, as the contract's ``head`` describes them: raw YOLOv3, v4 and v5, and their heirs.

For each level, cell and anchor: x, y, width, height, objectness and class scores, in any of these forms. An output
for each level: [1, anchors · (5 + nc), h, w], the same with channels last, [1, anchors, h, w, 5 + nc] or [1, h, w,
anchors, 5 + nc]. One output for all: [1, rows, 5 + nc], a box in each row, or a cell in each. Where a cell has one
class vector for all its anchors, it holds boxes · anchors, objectness · anchors, classes. Nor need there be a batch.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.detectors.anchor_head import AnchorHead
from blurnoise_eval.detectors.formats.candidates import Candidates, FloatArray, best_class, select
from blurnoise_eval.detectors.formats.grids import cells, grid
from blurnoise_eval.detectors.formats.signature import Layout, Shape, Signature

NAME = "anchors"
UNKNOWN = ""
SEVERAL_CLASSES = (
    True  # YOLOv5's val.py, darknet's validation and Yolo-FastestV2's: every class that reaches it
)


def describe(signature: Signature) -> Layout | None:
    """None: nothing in a graph shows its anchors."""
    return None


def decode(outputs: Sequence[NDArray[np.float32]], size_px: tuple[int, int], min_score: float) -> Candidates:
    """Not without a head: :class:`WithAnchors` decodes."""
    raise ValueError("head: must be stated in the contract of family anchors")


@dataclass(eq=False)  # a Family's fields are no read-only ones
class WithAnchors:
    """The family with a head's anchors and so many classes."""

    NAME: str
    head: AnchorHead
    classes: int
    UNKNOWN: str = ""
    SEVERAL_CLASSES: bool = SEVERAL_CLASSES

    def describe(self, signature: Signature) -> Layout | None:
        """Outputs in one of the forms; those of levels in the order of the strides."""
        if signature.size_px is None:
            return None
        shapes = [output.shape for output in signature.outputs]
        places = _places(shapes, signature.size_px, self.head, self.classes)
        if places is None:
            return None
        return Layout.by_name([signature.outputs[place] for place in places], self.classes)

    def decode(
        self, outputs: Sequence[NDArray[np.float32]], size_px: tuple[int, int], min_score: float
    ) -> Candidates:
        """Score = objectness · class. Sources: Redmon & Farhadi, YOLOv3 (2018); YOLOv4's scale_x_y; YOLOv5's head."""
        head = self.head
        parts = [
            _canonical(each, rows, head, self.classes)
            for each, rows in zip(*_by_level(outputs, size_px, head), strict=True)
        ]
        fields = np.concatenate([boxes.reshape(-1, 5) for boxes, _ in parts])
        class_rows = np.concatenate([scores.reshape(-1, self.classes) for _, scores in parts])
        objectness = fields[:, 4] if head.activated else _sigmoid(fields[:, 4])
        kept = np.flatnonzero(objectness >= min_score)
        # A class vector of all of a cell's anchors stands there once.
        shared = len(class_rows) != len(fields)
        class_scores = class_rows[kept // head.per_cell if shared else kept]
        class_scores = (class_scores if head.activated else _sigmoid(class_scores)) * objectness[kept, None]
        boxes = self._boxes(fields[kept, :4], kept, size_px)
        return select(boxes, *best_class(class_scores), min_score, class_scores)

    def _boxes(self, fields: FloatArray, kept: NDArray[np.int64], size_px: tuple[int, int]) -> FloatArray:
        """Centre x, y, width, height, px; ``kept``: which of all, cell by cell, anchor by anchor."""
        head, per_cell = self.head, self.head.per_cell
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
