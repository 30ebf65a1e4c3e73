"""Families whose graph gives the answers themselves, none doubled, and transformers with a row of logits for each
query. The former differ in names, columns and units: an answer is a box, a score and the number of its class, spread
over columns of one output or several.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from scipy.special import softmax

from blurnoise_eval.detectors.contract import COCO80, COCO91, IMAGENET, IMAGENET_255, Contract
from blurnoise_eval.detectors.formats.boxes import Candidates, select, sigmoid
from blurnoise_eval.detectors.formats.family import Decode, Family
from blurnoise_eval.detectors.records import FloatArray

BAKED = "the score threshold and the overlap inside the graph; weaker detections are removed there"
"""The unknowns of families that suppress duplicates themselves."""
BACKGROUND_FIRST = (
    f"{BAKED}; whether 'classes' begins with a name for 0, which its numbers keep for the background"
)
"""The same of those that count classes from 1."""


def _decode(
    outputs: Sequence[FloatArray],
    size_px: tuple[int, int],
    min_score: float,
    *,
    columns: str,
    shares: bool = False,
) -> Candidates:
    """Candidates from what ``columns`` says of each output, in turn.

    A letter a column: x, y, X, Y: left, top, right, bottom; s: score; c: class; i: picture in the batch; n, of an
    output of its own: how many answers count. shares: boxes are shares of the input, else px of it. Answers of
    other pictures than the first, and those whose class is no number >= 0, are left out.
    """
    batched = max(output.ndim for output in outputs) == 3
    count = None
    values: dict[str, FloatArray] = {}
    for letters, output in zip(columns.split(), outputs, strict=True):
        if letters == "n":
            count = int(output.flat[0])
            continue
        rows = output[0] if batched else output
        values |= zip(letters, rows.reshape(len(rows), len(letters)).T, strict=True)
    values = {letter: column[:count] for letter, column in values.items()}
    real = np.isfinite(values["c"]) & (values["c"] >= 0) & (values.get("i", 0) == 0)
    boxes = np.stack([values[letter][real] for letter in "xyXY"], axis=1)
    boxes = boxes * _whwh(size_px) if shares else boxes
    return select(boxes, values["s"][real], values["c"][real].astype(np.int64), min_score, corners=True)


def _decode_queries(
    outputs: Sequence[FloatArray], size_px: tuple[int, int], min_score: float, *, nothing_last: bool
) -> Candidates:
    """Score = sigmoid of the largest logit; where the last stands for no object, the largest other softmax.

    Boxes: (centre x, y, width, height), shares of the input.
    """
    logits, boxes = (output[0] for output in outputs)
    class_scores = softmax(logits, axis=1)[:, :-1] if nothing_last else sigmoid(logits)
    class_ids = (class_scores if nothing_last else logits).argmax(
        axis=1
    )  # large logits all give a sigmoid of 1
    scores = class_scores[np.arange(len(class_ids)), class_ids]
    return select(boxes * _whwh(size_px), scores, class_ids, min_score, class_scores)


def _whwh(size_px: tuple[int, int]) -> FloatArray:
    return np.array([size_px[1], size_px[0]] * 2, np.float32)


def _family(
    name: str, classes: tuple[str, ...], how: str | Decode, *layouts: str, preset: Any, **further: Any
) -> Family:
    """One that suppresses double answers itself. ``how``: columns, or what decodes them."""
    decode = partial(_decode, columns=how) if isinstance(how, str) else how
    contract = Contract(name, classes, **{"input_size_px": (640, 640), "nms_iou": None, **preset})
    return Family(contract, layouts, decode, **{"unknown": BAKED, **further})


# YOLOv10, YOLO26 and Ultralytics exports with nms=True; rows of zeros are padding.
YOLOV10 = _family("yolov10", COCO80, "xyXYsc", "b n 6", preset={})
# YOLOv7 exported with --end2end, the answers of the whole batch. With --grid it has YOLOv5's layout.
YOLOV7 = _family("yolov7", COCO80, "ixyXYcs", "n 7", preset={})
# YOLOv6 and others exported end to end; some call the outputs as TensorRT's plugin does, with the names of
# TensorFlow's API, whose count has no second axis.
YOLOV6E2E = _family(
    "yolov6e2e",
    COCO80,
    "n xyXY s c",
    "num_dets: b n, det_boxes: b n 4, det_scores: b n, det_classes: b n",
    "num_detections: b n, detection_boxes: b n 4, detection_scores: b n, detection_classes: b n",
    preset={},
)
# PP-YOLOE and PicoDet: the answers of the whole batch, and how many each picture has; class -1 is no answer.
PPYOLOE = _family("ppyoloe", COCO80, "csxyXY n", "with scale_factor, n 6, n", preset={"resize": "stretch"})
# MMDeploy's detectors, class numbers below 0 where empty.
MMDEPLOY = _family(
    "mmdeploy", COCO80, "xyXYs c", "dets: b n 5, labels: b n",
    preset={
        "value_range": "0-255", "mean": IMAGENET_255[0], "std": IMAGENET_255[1], "resize": "letterbox-top-left",
        "pad_value": 0, "input_size_px": (800, 1344),
    },
)  # fmt: skip
# RT-DETR, D-FINE and DEIM. Some exports of DEIMv2 have no batch axis, as torchvision's have none.
RTDETR = _family(
    "rtdetr",
    COCO80,
    "c xyXY s",
    "labels: b n, boxes: b n 4, scores: b n",
    "with orig_target_sizes, n int, n 4, n float, ...",
    "without chw, labels: n int, boxes: n 4, scores: n float",
    preset={"resize": "stretch"},
    unknown="whether it takes mean and std of ImageNet, as DEIMv2 does where its backbone is DINOv3",
)
_AS_IT_IS: dict[str, Any] = {"resize": "none", "input_size_px": None}
# torchvision's detectors, of one picture [3, H, W]; px of the picture that was fed, numbers from 1 on. The outputs'
# order differs between its models.
TORCHVISION = _family(
    "torchvision",
    COCO91,
    "xyXY c s",
    "without orig_target_sizes, n 4, n int, n float, ...",
    preset=_AS_IT_IS,
    unknown=BACKGROUND_FIRST,
)
# TensorFlow's Object Detection API (SSD-MobileNet and others). Class numbers are kept: 1 is the first class, so names
# begin with one for 0, as "coco91" does. The graph squeezes pictures itself.
TFOD = _family(
    "tfod",
    COCO91,
    partial(_decode, columns="n yxYX s c", shares=True),
    "num_detections: b, detection_boxes: b n 4, detection_scores: b n, detection_classes: b n",
    "b, b n 4, *score*: b n, *class*: b n",
    preset={"value_range": "0-255", **_AS_IT_IS},
    unknown=BACKGROUND_FIRST,
    fixed_resize="stretch",
)
_QUERIES: dict[str, Any] = {"mean": IMAGENET[0], "std": IMAGENET[1], "resize": "stretch"}
# As transformers exports it, and as its own code does. Its PostProcess: max over the classes.
DETR = _family(
    "detr",
    COCO91,
    partial(_decode_queries, nothing_last=True),
    "logits: b n C+1, pred_boxes: b n 4",
    "pred_logits: b n C+1, pred_boxes: b n 4",
    preset={"input_size_px": (800, 800), **_QUERIES},
    unknown="",
)
# By name: with four classes both are 4 wide. Its PostProcess: the best of all queries and classes.
RFDETR = _family(
    "rfdetr",
    COCO91,
    partial(_decode_queries, nothing_last=False),
    "labels: b n C, dets: b n 4",
    preset={"input_size_px": (560, 560), **_QUERIES},
    unknown="whether one of the class slots, and which, stands for the background",
    several_classes=True,
)
