"""Boxes before non-maximum suppression, in px of the network's input, and the suppression itself."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import onnxruntime as ort
from numpy.typing import NDArray
from onnx import TensorProto, helper

from blurnoise_eval.detectors.records import FloatArray, all_finite


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


def select(
    boxes_cxcywh: FloatArray,
    scores: FloatArray,
    class_ids: NDArray[np.int64],
    min_score: float,
    class_scores: FloatArray | None = None,
) -> Candidates:
    """Keep finite boxes whose score reaches ``min_score`` (NaN does not), as corners.

    boxes_cxcywh: (N, 4) = centre x, y, width, height, px. class_scores: (N, classes), if the graph tells them.
    """
    strong = np.flatnonzero(scores >= min_score)
    each = None if class_scores is None else class_scores[strong]
    return from_centres(boxes_cxcywh[strong], scores[strong], class_ids[strong], each)


def from_centres(
    boxes_cxcywh: FloatArray,
    scores: FloatArray,
    class_ids: NDArray[np.int64],
    class_scores: FloatArray | None = None,
) -> Candidates:
    """Those whose box (centre x, y, width, height) is finite, as corners."""
    half = boxes_cxcywh[:, 2:] / 2
    corners = np.empty(boxes_cxcywh.shape, np.float32)
    np.subtract(boxes_cxcywh[:, :2], half, out=corners[:, :2])
    np.add(boxes_cxcywh[:, :2], half, out=corners[:, 2:])
    return finite(Candidates(corners, scores, class_ids, class_scores))


def select_corners(
    boxes_xyxy: FloatArray,
    scores: FloatArray,
    class_ids: NDArray[np.int64],
    min_score: float,
    class_scores: FloatArray | None = None,
) -> Candidates:
    """Keep finite boxes (N, 4) = (left, top, right, bottom), px, whose score reaches ``min_score``."""
    every = Candidates(boxes_xyxy, scores, class_ids, class_scores)
    return finite(every[np.flatnonzero(scores >= min_score)])


def finite(candidates: Candidates) -> Candidates:
    """Those whose box is finite."""
    boxes = candidates.boxes_xyxy
    return candidates if all_finite(boxes) else candidates[np.flatnonzero(np.isfinite(boxes).all(axis=1))]


def counted(
    count: FloatArray, boxes_xyxy: FloatArray, scores: FloatArray, class_numbers: FloatArray, min_score: float
) -> Candidates:
    """As :func:`select_corners`, of the first ``count`` answers, those whose class is no number left out."""
    real = np.flatnonzero(class_numbers[: int(count.flat[0])] >= 0)  # NaN is not
    return select_corners(boxes_xyxy[real], scores[real], class_numbers[real].astype(np.int64), min_score)


def best(candidates: Candidates, max_detections: int) -> Candidates:
    """At most ``max_detections``, highest score first: all there is to do where the graph suppresses itself."""
    return candidates[np.argsort(-candidates.scores, kind="stable")[:max_detections]]


def suppress(
    candidates: Candidates, nms_iou: float, max_detections: int, *, per_class: int | None = None
) -> Candidates:
    """Greedy non-maximum suppression within each class: at most ``max_detections``, highest score first.

    A box is dropped where a kept box of its class with a higher score overlaps it by more than ``nms_iou``.
    ``per_class``: at most so many of one class, by default all. Runs onnxruntime's own NonMaxSuppression on the
    strongest first: weaker ones cannot change what these leave.
    """
    if len(candidates) <= 1:
        return candidates
    most = 4 * max_detections
    while True:
        order = _strongest(candidates.scores, most)
        kept = _suppressed(candidates[order], nms_iou, per_class or max_detections)[:max_detections]
        if len(kept) >= max_detections or len(order) == len(candidates):
            return kept
        most *= 4


def _strongest(scores: FloatArray, most: int) -> NDArray[np.int64]:
    """Places of the ``most`` highest scores, and of those that equal the last: highest first, equals in order."""
    if len(scores) <= most:
        return np.argsort(-scores, kind="stable")
    strong = np.flatnonzero(scores >= np.partition(scores, -most)[-most])
    return strong[np.argsort(-scores[strong], kind="stable")]


def _suppressed(ordered: Candidates, nms_iou: float, per_class: int) -> Candidates:
    """Of candidates with the highest score first, at most ``per_class`` of one class."""
    count = len(ordered)
    present = np.bincount(ordered.class_ids) > 0
    rows = (np.cumsum(present) - 1)[ordered.class_ids]
    # Ranks stand in for scores: equal scores keep their order, and none is 0, which means "no box".
    ranks = np.zeros((1, rows.max() + 1, count), np.float32)
    ranks[0, rows, np.arange(count)] = np.arange(count, 0, -1)
    feed = {
        "boxes": ordered.boxes_xyxy[None],
        "scores": ranks,
        "most": np.array([per_class], np.int64),
        "iou": np.array([nms_iou], np.float32),
        "least": np.zeros(1, np.float32),
    }
    return ordered[np.sort(_suppression().run(None, feed)[0][:, 2])]


@lru_cache(maxsize=1)
def _suppression() -> ort.InferenceSession:
    """The operator as a graph of its own: box corners and scores per class in, indices of kept boxes out."""
    value, floats, ints = helper.make_tensor_value_info, TensorProto.FLOAT, TensorProto.INT64
    names = ["boxes", "scores", "most", "iou", "least"]
    shapes: list[tuple[int, list[object]]] = [
        (floats, [1, "n", 4]),
        (floats, [1, "c", "n"]),
        (ints, [1]),
        (floats, [1]),
        (floats, [1]),
    ]
    graph = helper.make_graph(
        [helper.make_node("NonMaxSuppression", names, ["kept"])],
        "suppress",
        [value(name, kind, shape) for name, (kind, shape) in zip(names, shapes, strict=True)],
        [value("kept", ints, ["k", 3])],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)], ir_version=8)
    options = ort.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    return ort.InferenceSession(model.SerializeToString(), options, providers=["CPUExecutionProvider"])
