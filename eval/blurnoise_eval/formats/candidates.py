"""Boxes before non-maximum suppression, in px of the network's input, and the suppression itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Candidates:
    """Boxes (N, 4) = (left, top, right, bottom) px of the network's input, scores (N,), class ids (N,)."""

    boxes_xyxy: FloatArray
    scores: FloatArray
    class_ids: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.scores)

    def __getitem__(self, index: NDArray[np.int64] | NDArray[np.bool_] | slice) -> Candidates:
        return Candidates(self.boxes_xyxy[index], self.scores[index], self.class_ids[index])


def best_class(class_scores: FloatArray) -> tuple[FloatArray, NDArray[np.int64]]:
    """Return the highest score of each row of (N, classes) and its column; a row with a NaN gives NaN."""
    class_ids = class_scores.argmax(axis=1)
    return class_scores[np.arange(len(class_ids)), class_ids], class_ids


def select(
    boxes_cxcywh: FloatArray, scores: FloatArray, class_ids: NDArray[np.int64], min_score: float
) -> Candidates:
    """Keep finite boxes whose score reaches ``min_score`` (NaN does not), as corners.

    boxes_cxcywh: (N, 4) = centre x, y, width, height, px.
    """
    keep = (scores >= min_score) & np.isfinite(boxes_cxcywh).all(axis=1)
    boxes = boxes_cxcywh[keep]
    half = boxes[:, 2:] / 2
    corners = np.concatenate([boxes[:, :2] - half, boxes[:, :2] + half], axis=1)
    return Candidates(corners, scores[keep], class_ids[keep])


def suppress(candidates: Candidates, nms_iou: float, max_detections: int) -> Candidates:
    """Greedy non-maximum suppression within each class: at most ``max_detections``, highest score first.

    A box is dropped where a kept box of its class with a higher score overlaps it by more than ``nms_iou``.
    """
    order = np.lexsort((-candidates.scores, candidates.class_ids))
    boxes = candidates.boxes_xyxy[order].astype(np.float64)
    boxes[:, 2:] -= boxes[:, :2]
    rows = boxes.tolist()
    kept: list[int] = []
    edges = np.flatnonzero(np.diff(candidates.class_ids[order])) + 1
    for start, stop in pairwise([0, *edges.tolist(), len(rows)]):
        kept += [start + i for i in _suppress_class(rows[start:stop], nms_iou, max_detections)]
    best = order[kept]
    return candidates[best[np.argsort(-candidates.scores[best], kind="stable")[:max_detections]]]


def _suppress_class(boxes_xywh: list[list[float]], nms_iou: float, max_detections: int) -> Sequence[int]:
    """Return the indices kept of one class's boxes (left, top, width, height), given best first."""
    if len(boxes_xywh) <= 1:
        return range(len(boxes_xywh))
    # Ranks stand in for scores: OpenCV sorts by them, and drops scores of 0.
    prefix = 2 * max_detections
    kept = cv2.dnn.NMSBoxes(boxes_xywh[:prefix], range(len(boxes_xywh[:prefix]), 0, -1), 0.0, nms_iou)
    # What is kept among the first n does not depend on the rest, so the prefix usually settles it.
    if len(kept) < max_detections and prefix < len(boxes_xywh):
        kept = cv2.dnn.NMSBoxes(boxes_xywh, range(len(boxes_xywh), 0, -1), 0.0, nms_iou)
    return kept
