"""How well detections answer for targets. Boxes are (x0, y0, x1, y1) px."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.records import Detections

MATCH_IOU = 0.5


def iou(boxes_xyxy: NDArray[np.float32], box_xyxy: Sequence[float]) -> NDArray[np.float32]:
    """Intersection over union of each of ``boxes_xyxy`` (N, 4) with one box, (N,)."""
    x0, y0, x1, y1 = box_xyxy
    width = np.minimum(boxes_xyxy[:, 2], x1) - np.maximum(boxes_xyxy[:, 0], x0)
    height = np.minimum(boxes_xyxy[:, 3], y1) - np.maximum(boxes_xyxy[:, 1], y0)
    overlap = np.maximum(width, 0) * np.maximum(height, 0)
    areas = (boxes_xyxy[:, 2] - boxes_xyxy[:, 0]) * (boxes_xyxy[:, 3] - boxes_xyxy[:, 1])
    union = areas + (x1 - x0) * (y1 - y0) - overlap
    return np.asarray(overlap / np.maximum(union, np.finfo(np.float32).tiny), np.float32)


def target_confidence(detections: Detections, box_xyxy: Sequence[float], class_id: int) -> float:
    """Highest score of the right class with an IoU of at least 0.5 with the target's box, else 0."""
    right = detections.class_ids == class_id
    matched = right & (iou(detections.boxes_xyxy, box_xyxy) >= MATCH_IOU)
    return float(detections.scores[matched].max(initial=0.0))
