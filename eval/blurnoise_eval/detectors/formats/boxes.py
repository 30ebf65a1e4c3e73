"""Boxes and pictures in px of the network's input: candidates, non-maximum suppression, and the way in and back."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
import onnxruntime as ort
from numpy.typing import NDArray
from onnx import parser
from PIL import Image

from blurnoise_eval.detectors.contract import Contract
from blurnoise_eval.detectors.records import FloatArray


@dataclass(frozen=True, eq=False)
class Candidates:
    """Boxes (N, 4) = (left, top, right, bottom) px of the network's input, scores (N,), class ids (N,).

    class_scores: (N, classes), of each box with every class, where the graph tells; ``scores`` and ``class_ids`` are
    then those of the class that leads. leads: (N,) whether the class does, None: all do.

    >>> boxes, scores = np.zeros((1, 4), np.float32), np.array([[0.9, 0.4]], np.float32)
    >>> one = Candidates(boxes, scores[:, 0], np.array([0]), scores)
    >>> one.with_classes(0.3).class_ids.tolist()  # the box counts with both classes
    [0, 1]
    """

    boxes_xyxy: FloatArray
    scores: FloatArray
    class_ids: NDArray[np.int64]
    class_scores: FloatArray | None = None
    leads: NDArray[np.bool_] | None = None

    def __len__(self) -> int:
        return len(self.scores)

    def __getitem__(self, index: NDArray[np.int64] | NDArray[np.bool_] | slice) -> Candidates:
        class_scores = None if self.class_scores is None else self.class_scores[index]
        leads = None if self.leads is None else self.leads[index]
        return Candidates(
            self.boxes_xyxy[index], self.scores[index], self.class_ids[index], class_scores, leads
        )

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
        classes = column if class_ids is None else class_ids[column]
        return Candidates(
            self.boxes_xyxy[box], scores[box, column], classes, leads=classes == self.class_ids[box]
        )


def best_class(class_scores: FloatArray) -> tuple[FloatArray, NDArray[np.int64]]:
    """Return the highest score of each row of (N, classes) and its column; a row with a NaN gives NaN.

    >>> best_class(np.array([[0.1, 0.7], [0.5, 0.2]], np.float32))
    (array([0.7, 0.5], dtype=float32), array([1, 0]))
    """
    if class_scores.shape[1] == 1:
        return class_scores[:, 0], np.zeros(len(class_scores), np.int64)
    class_ids = class_scores.argmax(axis=1)
    return class_scores[np.arange(len(class_ids)), class_ids], class_ids


def sigmoid(logits: FloatArray) -> FloatArray:
    """Return 1 / (1 + exp(-x)), without overflow.

    >>> sigmoid(np.array([-1000.0, 0.0], np.float32))
    array([0. , 0.5], dtype=float32)
    """
    # The same function: tanh stays finite where exp(-x) overflows.
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

    >>> boxes = np.array([[10, 10, 4, 6], [0, 0, np.inf, 1]], np.float32)  # centre and size
    >>> select(boxes, np.array([0.9, 0.8], np.float32), np.array([0, 0]), 0.5).boxes_xyxy.tolist()
    [[8.0, 7.0, 12.0, 13.0]]
    """
    candidates = Candidates(boxes, scores, class_ids, class_scores)
    strong = scores >= min_score
    candidates = candidates if strong.all() else candidates[np.flatnonzero(strong)]
    if not corners:
        centres, half = candidates.boxes_xyxy[:, :2], candidates.boxes_xyxy[:, 2:] / 2
        with np.errstate(invalid="ignore"):  # boxes that are not finite are left out below
            candidates = replace(
                candidates, boxes_xyxy=np.concatenate([centres - half, centres + half], axis=1)
            )
    finite = np.isfinite(candidates.boxes_xyxy).all(axis=1)
    return candidates if finite.all() else candidates[np.flatnonzero(finite)]


def suppress(
    candidates: Candidates, nms_iou: float | None, max_detections: int, *, per_class: int | None = None
) -> Candidates:
    """Greedy non-maximum suppression within each class: at most ``max_detections``, highest score first.

    A box is dropped where a kept box of its class with a higher score overlaps it by more than ``nms_iou``; none
    where that is None. ``per_class``: at most so many of one class, by default all. Runs onnxruntime's own
    NonMaxSuppression on the strongest first: weaker ones cannot change what these leave.

    >>> boxes = np.array([[0, 0, 10, 10], [1, 0, 11, 10], [50, 50, 60, 60]], np.float32)
    >>> scores = np.array([0.9, 0.8, 0.7], np.float32)
    >>> suppress(Candidates(boxes, scores, np.zeros(3, np.int64)), 0.5, 100).scores
    array([0.9, 0.7], dtype=float32)
    """
    order = np.argsort(-candidates.scores, kind="stable")
    if nms_iou is None or len(order) <= 1:
        return candidates[order[:max_detections]]
    # Most candidates are weak: the strongest few give all the detections there may be in nearly every picture.
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


Blob = NDArray[Any]  # float32, or uint8 for the graphs that take bytes


@dataclass(frozen=True)
class Placement:
    """Where a picture of ``width_px`` x ``height_px`` lies in the network's input.

    Convention: input x = picture x · scale_x + left_px, edges at integers; y likewise.

    >>> half = Placement(1280, 720, scale_x=0.5, scale_y=0.5, left_px=0, top_px=140)
    >>> half.to_picture(np.array([[100, 240, 200, 340]], np.float32))
    array([[200., 200., 400., 400.]], dtype=float32)
    """

    width_px: int
    height_px: int
    scale_x: float
    scale_y: float
    left_px: int
    top_px: int

    def to_picture(self, boxes_xyxy: FloatArray) -> FloatArray:
        """Return boxes (N, 4), px of the input, in px of the picture, clipped to it."""
        boxes = boxes_xyxy - np.array([self.left_px, self.top_px] * 2, np.float32)
        boxes /= np.array([self.scale_x, self.scale_y] * 2, np.float32)
        np.maximum(boxes, 0, out=boxes)
        np.minimum(boxes, np.array([self.width_px, self.height_px] * 2, np.float32), out=boxes)
        return boxes


def picture_size(image: NDArray[np.uint8]) -> tuple[int, int]:
    """Return (height, width). Raises ``TypeError`` or ``ValueError`` for anything but RGB (H, W, 3), uint8.

    >>> picture_size(np.zeros((480, 640, 3), np.uint8))
    (480, 640)
    """
    if not isinstance(image, np.ndarray) or image.dtype != np.uint8:
        kind = getattr(image, "dtype", type(image).__name__)
        raise TypeError(f"image: must be a NumPy array of uint8, shape (H, W, 3); got {kind}")
    if image.ndim != 3 or image.shape[2] != 3 or 0 in image.shape:
        raise ValueError(f"image: shape must be (H, W, 3), not empty; got {image.shape}")
    return image.shape[0], image.shape[1]


def blob_shape(axes: str, size_px: tuple[int, int], channels: int = 3) -> tuple[int, ...]:
    """The shape of an input "nchw", "nhwc" or "chw" of (height, width) px that holds one picture.

    >>> blob_shape("nchw", (320, 640)), blob_shape("chw", (320, 640))
    ((1, 3, 320, 640), (3, 320, 640))
    """
    if axes == "chw":
        return (channels, *size_px)
    return (1, *size_px, channels) if axes == "nhwc" else (1, channels, *size_px)


def lay_in(
    image: NDArray[np.uint8],
    contract: Contract,
    size_px: tuple[int, int],
    out: Blob | None = None,
    *,
    axes: str = "nchw",
    dtype: type[np.generic] = np.float32,
) -> tuple[Blob, Placement]:
    """Return the network's input for an RGB picture (h, w, 3), and where the picture lies in it.

    ``size_px``: the input's (H, W), which ``resize`` "none" replaces by the picture's. ``out``: a buffer to
    fill, if its shape is right, instead of a new one. ``axes``: "nchw" (1, 3, H, W), "nhwc" or "chw".
    ``dtype``: float32, or uint8 where the contract leaves values as they are.
    Raises ``TypeError`` for anything but uint8, ``ValueError`` for a wrong shape.

    >>> from blurnoise_eval import STOP_SIGN, Detector
    >>> contract = Detector(STOP_SIGN).contract  # letterboxed to 320 x 320 px
    >>> blob, placement = lay_in(np.zeros((480, 640, 3), np.uint8), contract, (320, 320))
    >>> blob.shape, placement.scale_x, placement.top_px
    ((1, 3, 320, 320), 0.5, 40)
    """
    height, width = picture_size(image)
    size_px = (height, width) if contract.resize == "none" else size_px
    if contract.resize.startswith("letterbox"):
        # One scale for both sides keeps the picture's shape; what is left over is padded.
        scale = min(size_px[0] / height, size_px[1] / width)
        new_height, new_width = max(1, round(height * scale)), max(1, round(width * scale))
    else:
        new_height, new_width = size_px
    centred = contract.resize == "letterbox"
    top, left = ((size_px[0] - new_height) // 2, (size_px[1] - new_width) // 2) if centred else (0, 0)
    if (new_height, new_width) != (height, width):
        image = resized(image, (new_width, new_height), contract.resize_filter)

    grey = contract.colour == "grey"
    image = np.ascontiguousarray(image)
    planes = (cv2.cvtColor(image, cv2.COLOR_RGB2GRAY),) if grey else cv2.split(image)
    planes = planes[::-1] if contract.colour == "bgr" else planes
    shape = blob_shape(axes, size_px, len(planes))
    blob = np.empty(shape, dtype) if out is None or out.shape != shape else out
    channels = blob if axes == "chw" else blob[0].transpose(2, 0, 1) if axes == "nhwc" else blob[0]
    full_scale = 255.0 if contract.value_range == "0-1" else 1.0
    for channel, plane, index in zip(channels, planes, range(len(planes)), strict=True):
        mean = contract.mean[index] if contract.mean else 0.0
        std = contract.std[index] if contract.std else 1.0
        gain = np.float32(1 / (full_scale * std))
        window = channel[top : top + new_height, left : left + new_width]
        if window.size < channel.size:
            # Padding goes through the same normalisation as the picture.
            channel[...] = (contract.pad_value / full_scale - mean) / std
        np.copyto(window, plane)  # converts faster than a multiplication that has to
        if gain != 1:
            np.multiply(window, gain, out=window)
        if mean:
            window -= np.float32(mean / std)
    return blob, Placement(width, height, new_width / width, new_height / height, left, top)


def resized(image: NDArray[np.uint8], size_px: tuple[int, int], resize_filter: str) -> NDArray[np.uint8]:
    """An RGB picture (h, w, 3) at another size (width, height), by a filter of ``Contract.resize_filter``.

    In a smaller picture, "bilinear" takes four pixels of the larger one for each of its own, however many there are.
    "area" and "antialiased" average them all, and with them the noise.
    """
    if resize_filter == "antialiased":
        return np.asarray(Image.fromarray(image).resize(size_px, Image.Resampling.BILINEAR))
    shrinks = size_px[0] <= image.shape[1] and size_px[1] <= image.shape[0]
    method = cv2.INTER_AREA if resize_filter == "area" and shrinks else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(image, size_px, interpolation=method), np.uint8)
