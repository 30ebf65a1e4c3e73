"""Boxes before non-maximum suppression, in px of the network's input, and the suppression itself."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import onnxruntime as ort
from numpy.typing import NDArray
from onnx import parser

from blurnoise_eval.detectors.records import FloatArray


@dataclass(frozen=True, eq=False)
class Candidates:
    """Boxes (N, 4) = (left, top, right, bottom) px of the network's input, scores (N,), class ids (N,).

    class_scores: (N, classes), of each box with every class, where the graph tells; ``scores`` and ``class_ids`` are
    then those of the class that leads. leads: (N,) whether the class does, None: all do.
    """

    boxes_xyxy: FloatArray
    scores: FloatArray
    class_ids: NDArray[np.int64]
    class_scores: FloatArray | None = None
    leads: NDArray[np.bool_] | None = None

    def __len__(self) -> int:
        return len(self.scores)

    def __getitem__(self, index: NDArray[np.int64] | NDArray[np.bool_] | slice) -> Candidates:
        each = None if self.class_scores is None else self.class_scores[index]
        leads = None if self.leads is None else self.leads[index]
        return Candidates(self.boxes_xyxy[index], self.scores[index], self.class_ids[index], each, leads)

    def with_classes(
        self, min_score: float, class_ids: NDArray[np.int64] | None = None, above: FloatArray | None = None
    ) -> Candidates:
        """Every box once with each class whose own score reaches ``min_score``, of ``class_ids`` or of all.

        above: for each of these classes, what its scores must exceed. As they are where the graph tells one class a
        box.
        """
        if self.class_scores is None:
            return self
        if self.class_scores.shape[1] == 1 and class_ids is None and (self.scores >= min_score).all():
            return Candidates(self.boxes_xyxy, self.scores, self.class_ids)
        scores = self.class_scores if class_ids is None else self.class_scores[:, class_ids]
        enough = scores >= min_score
        if above is not None:
            enough &= scores > above
        box, column = np.nonzero(enough)
        own = column if class_ids is None else class_ids[column]
        return Candidates(self.boxes_xyxy[box], scores[box, column], own, leads=own == self.class_ids[box])


def best_class(class_scores: FloatArray) -> tuple[FloatArray, NDArray[np.int64]]:
    """Return the highest score of each row of (N, classes) and its column; a row with a NaN gives NaN."""
    if class_scores.shape[1] == 1:
        return class_scores[:, 0], np.zeros(len(class_scores), np.int64)
    class_ids = class_scores.argmax(axis=1)
    return class_scores[np.arange(len(class_ids)), class_ids], class_ids


def sigmoid(logits: FloatArray) -> FloatArray:
    """Return 1 / (1 + exp(-x)), without overflow."""
    return np.asarray(0.5 * (1 + np.tanh(logits / 2)), np.float32)


def select(
    boxes: FloatArray,
    scores: FloatArray,
    class_ids: NDArray[np.int64],
    min_score: float,
    class_scores: FloatArray | None = None,
    *,
    corners: bool = False,
) -> Candidates:
    """Those whose score reaches ``min_score``, which NaN does not, and whose box is finite.

    boxes: (N, 4) = centre x, y, width, height, px; with ``corners`` left, top, right, bottom. class_scores:
    (N, classes), if the graph tells them.
    """
    found = Candidates(boxes, scores, class_ids, class_scores)
    strong = scores >= min_score
    found = found if strong.all() else found[np.flatnonzero(strong)]
    if not corners:
        centres, half = found.boxes_xyxy[:, :2], found.boxes_xyxy[:, 2:] / 2
        with np.errstate(invalid="ignore"):  # boxes that are not finite are left out below
            found = replace(found, boxes_xyxy=np.concatenate([centres - half, centres + half], axis=1))
    finite = np.isfinite(found.boxes_xyxy).all(axis=1)
    return found if finite.all() else found[np.flatnonzero(finite)]


def suppress(
    candidates: Candidates, nms_iou: float | None, max_detections: int, *, per_class: int | None = None
) -> Candidates:
    """Greedy non-maximum suppression within each class: at most ``max_detections``, highest score first.

    A box is dropped where a kept box of its class with a higher score overlaps it by more than ``nms_iou``; none
    where that is None. ``per_class``: at most so many of one class, by default all. Runs onnxruntime's own
    NonMaxSuppression on the strongest first: weaker ones cannot change what these leave.
    """
    order = np.argsort(-candidates.scores, kind="stable")
    if nms_iou is None or len(order) <= 1:
        return candidates[order[:max_detections]]
    most = 4 * max_detections
    while True:
        kept = _suppressed(candidates[order[:most]], nms_iou, per_class or max_detections)[:max_detections]
        if len(kept) >= max_detections or most >= len(order):
            return kept
        most *= 4


def _suppressed(ordered: Candidates, nms_iou: float, per_class: int) -> Candidates:
    """Of candidates with the highest score first, at most ``per_class`` of one class."""
    count = len(ordered)
    rows = (np.cumsum(np.bincount(ordered.class_ids) > 0) - 1)[ordered.class_ids]
    # Ranks stand in for scores: equal scores keep their order, and none is 0, which means "no box".
    ranks = np.zeros((1, rows.max() + 1, count), np.float32)
    ranks[0, rows, np.arange(count)] = np.arange(count, 0, -1)
    limits = {"most": np.array([per_class]), "iou": np.array([nms_iou], np.float32)}
    feeds = {"boxes": ordered.boxes_xyxy[None], "scores": ranks, **limits, "least": np.zeros(1, np.float32)}
    return ordered[np.sort(_suppression().run(None, feeds)[0][:, 2])]


_SUPPRESSION = """<ir_version: 8, opset_import: ["" : 13]>
suppress (float[1, n, 4] boxes, float[1, c, n] scores, int64[1] most, float[1] iou, float[1] least)
    => (int64[k, 3] kept) { kept = NonMaxSuppression (boxes, scores, most, iou, least) }"""


@lru_cache(maxsize=1)
def _suppression() -> ort.InferenceSession:
    """The operator as a graph of its own: box corners and scores per class in, indices of kept boxes out."""
    options = ort.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    model = parser.parse_model(_SUPPRESSION).SerializeToString()
    return ort.InferenceSession(model, options, providers=["CPUExecutionProvider"])
