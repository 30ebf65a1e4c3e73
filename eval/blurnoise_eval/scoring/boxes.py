"""Boxes as corners and as sides, and how far two overlap.

Domain: px. xyxy: left, top, right, bottom; xywh: left, top, width, height, as COCO holds them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
MoveBoxes = Callable[[Array, Array, Sequence[str]], Array]
"""From boxes (N, 4) of objects of N classes, in scenes of sizes (N, 2), width and height (NaN: the sensor's), to
others in pictures of these: at mid-exposure, or swept by the motion."""


def xywh(boxes_xyxy: ArrayLike) -> Array:
    """Sides of corners (N, 4), in double precision.

    >>> xywh([[10.0, 20.0, 30.0, 50.0]]).tolist()
    [[10.0, 20.0, 20.0, 30.0]]
    """
    boxes = np.asarray(boxes_xyxy, np.float64).reshape(-1, 4)
    return np.concatenate([boxes[:, :2], boxes[:, 2:] - boxes[:, :2]], axis=1)


def xyxy(boxes_xywh: ArrayLike) -> Array:
    """Corners of sides (N, 4), in double precision.

    >>> xyxy([[10.0, 20.0, 20.0, 30.0]]).tolist()
    [[10.0, 20.0, 30.0, 50.0]]
    """
    boxes = np.asarray(boxes_xywh, np.float64).reshape(-1, 4)
    return np.concatenate([boxes[:, :2], boxes[:, :2] + boxes[:, 2:]], axis=1)


def overlaps(boxes_xywh: Array, targets_xywh: Array, crowd: Flags | None = None) -> Array:
    """COCO's overlaps of boxes and targets (..., 4), by broadcasting: intersection over union, with a crowd over the
    box's own area.

    >>> box, crowd = np.array([0.0, 0.0, 10.0, 10.0]), np.array([0.0, 0.0, 20.0, 10.0])
    >>> float(overlaps(box, crowd)), float(overlaps(box, crowd, np.array(True)))
    (0.5, 1.0)
    """
    x, y, width, height = np.moveaxis(boxes_xywh, -1, 0)
    target_x, target_y, target_width, target_height = np.moveaxis(targets_xywh, -1, 0)
    across = np.minimum(x + width, target_x + target_width) - np.maximum(x, target_x)
    down = np.minimum(y + height, target_y + target_height) - np.maximum(y, target_y)
    shared = np.maximum(across, 0) * np.maximum(down, 0)
    area = width * height
    # COCO's rule: a crowd holds any number of objects, so that a box within it overlaps it fully.
    union = area + target_width * target_height - shared
    iou = np.divide(shared, union, out=np.zeros_like(shared), where=union > 0)
    return np.asarray(iou if crowd is None else np.where(crowd, shared / np.maximum(area, 1e-12), iou))


def iou(boxes_xyxy: ArrayLike, targets_xyxy: ArrayLike) -> Array:
    """Intersection over union of each of the boxes (N, 4) with each of the targets (M, 4), (N, M).

    >>> iou([[0, 0, 10, 10]], [[0, 0, 10, 10], [5, 0, 15, 10]]).round(3).tolist()  # 50 / 150
    [[1.0, 0.333]]
    """
    return overlaps(xywh(boxes_xyxy)[:, None], xywh(targets_xyxy)[None])


def swept_within(swept_xyxy: ArrayLike, moved_xyxy: ArrayLike, size_px: ArrayLike) -> Array:
    """What motion sweeps, boxes (N, 4), not beyond the border of pictures of ``size_px``, (width, height) or (N, 2).

    What of the boxes at mid-exposure, ``moved_xyxy``, lies beyond it stays.

    >>> swept_within([[-5, 10, 45, 20]], [[0, 10, 40, 20]], (43, 30)).tolist()
    [[0.0, 10.0, 43.0, 20.0]]
    """
    swept, moved = (np.asarray(each, np.float64).reshape(-1, 4) for each in (swept_xyxy, moved_xyxy))
    low = np.maximum(swept[:, :2], np.minimum(moved[:, :2], 0.0))
    high = np.minimum(swept[:, 2:], np.maximum(moved[:, 2:], np.asarray(size_px, np.float64)))
    return np.concatenate([low, high], axis=1)
