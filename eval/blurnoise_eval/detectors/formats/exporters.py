"""Families whose outputs are columns, one row of a table for each exporter: what it writes, and how it is fed.

A row holds the name of its preset, classes, outputs as :mod:`blurnoise_eval.detectors.outputs` has them, the layouts
that show it (:mod:`blurnoise_eval.detectors.formats.family`) in the order of these outputs, and what differs.
"""

from __future__ import annotations

from typing import Any

from blurnoise_eval.detectors.contract import COCO80, COCO91, IMAGENET, IMAGENET_255, Contract
from blurnoise_eval.detectors.formats.family import STRIDES, STRIDES_64, Family

BAKED = "the score threshold and the overlap inside the graph; weaker detections are removed there"
"""The unknowns of families that suppress duplicates themselves."""
BACKGROUND_FIRST = (
    f"{BAKED}; whether 'classes' begins with a name for 0, which its numbers keep for the background"
)
"""The same of those that count classes from 1."""
_STRETCHED = {"resize": "stretch"}
# Their code resizes with PIL, or with torchvision, which antialiases by default since 0.17.
_ANTIALIASED: dict[str, Any] = {"resize": "stretch", "resize_filter": "antialiased"}
_NORMALISED: dict[str, Any] = {"mean": IMAGENET[0], "std": IMAGENET[1], "resize": "stretch"}
_AS_IT_IS: dict[str, Any] = {"resize": "none", "input_size_px": None}


def _family(
    name: str, classes: tuple[str, ...], outputs: str, *layouts: str, preset: Any = None, **further: Any
) -> Family:
    """One that suppresses double answers itself, if the preset says nothing else."""
    fields = {"input_size_px": (640, 640), "nms_iou": None, "outputs": outputs, **(preset or {})}
    baked = BAKED if fields["nms_iou"] is None and "scores" not in outputs else ""
    return Family(Contract(name, classes, **fields), layouts, **{"unknown": baked, **further})


def _dense(name: str, outputs: str, *layouts: str, preset: Any, **further: Any) -> Family:
    """One with a row for each cell of its grids, that evaluates every class of a box."""
    return _family(name, COCO80, outputs, *layouts, preset=preset, **{"several_classes": True, **further})


# --- a row, or a column, for each cell of the grids ---

# YOLOv7 exported with --grid has the same layout and the same pre-processing; old exports add the raw heads. Its
# val.py: multi_label.
YOLOV5 = _dense(
    "yolov5", "cxcywh, objectness, scores", "b 3A 5+C, ...",
    preset={"nms_iou": 0.6}, strides=(STRIDES, STRIDES_64),
)  # fmt: skip
# The objectness column is always 1. YOLOX exported with its boxes decoded reads the same, with YOLOX's
# pre-processing. Its Evaler: multi_label.
YOLOV6 = _dense(
    "yolov6", "cxcywh, objectness, scores", "b A 5+C", preset={"nms_iou": 0.65}, strides=(STRIDES, STRIDES_64)
)
# Stride 8 alone is the built-in detector's. DetectionValidator: multi_label.
YOLOV8 = _dense(
    "yolov8", "cxcywh, scores", "b 4+C A", "b A 4+C",
    preset={"nms_iou": 0.7}, strides=((8,), STRIDES, STRIDES_64),
)  # fmt: skip
# Its demo: RGB, padded with 0 to the right and below; scores are the first output. Its postprocess: multiclass_nms.
DAMOYOLO = _dense(
    "damoyolo", "scores; xyxy", "ordered, b A C, b A 4",
    preset={"value_range": "0-255", "resize": "letterbox-top-left", "pad_value": 0, "nms_iou": 0.7},
    by_shape=True,
)  # fmt: skip
# YOLO-NAS exported with convert_to_onnx, or without postprocessing; boxes are the first output.
YOLONAS_RAW = _dense(
    "yolonasraw", "xyxy; scores", "ordered, b A 4, b A C", preset={"nms_iou": 0.7}, by_shape=True
)
# YOLOv4 of PyTorch (pytorch-YOLOv4): three anchors a cell.
YOLOV4 = _dense(
    "yolov4", "boxes: xyxy in shares; confs: scores", "boxes: b n 1 4, confs: b n C",
    preset={"nms_iou": 0.6, "input_size_px": (416, 416), **_STRETCHED}, several_classes=False,
)  # fmt: skip

# --- a row for each query of a transformer ---

# transformers' RT-DETR, RT-DETRv2, D-FINE: RTDetrImageProcessor. Its post-processing: the best of all queries and
# classes.
HF_RTDETR = _family(
    "hfrtdetr", COCO80, "logits: scores by sigmoid; pred_boxes: cxcywh in shares", "logits: b n C, pred_boxes: b n 4",
    preset=_ANTIALIASED, several_classes=True,
)  # fmt: skip
# transformers' Deformable, Conditional and DAB DETR.
HF_DEFORMABLE = _family(
    "deformabledetr", COCO91, "logits: scores by sigmoid; pred_boxes: cxcywh in shares",
    "logits: b n C, pred_boxes: b n 4",
    preset={"input_size_px": (800, 800), **_NORMALISED, **_ANTIALIASED}, several_classes=True,
)  # fmt: skip
# transformers' DETR, YOLOS and Table Transformer, and DETR's own code. Its PostProcess: max over the classes.
DETR = _family(
    "detr", COCO91, "*logits: scores by softmax, background; pred_boxes: cxcywh in shares",
    "*logits: b n C+1, pred_boxes: b n 4, ...",
    preset={"input_size_px": (800, 800), **_NORMALISED, **_ANTIALIASED},
)  # fmt: skip
# By name: with four classes both are 4 wide. Its PostProcess: the best of all queries and classes. Of own classes it
# has one column more, the background; the 91 of COCO are its numbers, of which 0 is none.
RFDETR = _family(
    "rfdetr", COCO91, "labels: scores by sigmoid; dets: cxcywh in shares", "labels: b n C, dets: b n 4",
    preset={"input_size_px": (560, 560), **_NORMALISED, **_ANTIALIASED},
    several_classes=True, background_last=True,
)  # fmt: skip
# RT-DETR of Ultralytics up to 8.3, and from 8.4 on. RTDETRPredictor: scale_fill; of a box the best class.
RTDETR_V83 = _family(
    "ultralyticsrtdetr", COCO80, "cxcywh in shares, scores", "b n 4+C", preset=_STRETCHED, by_shape=True
)
RTDETR_V84 = _family(
    "ultralyticsrtdetr84", COCO80, "cxcywh in shares, score, class", "b n 6", preset=_STRETCHED, unknown="",
    by_shape=True,
)  # fmt: skip

# --- the answers themselves ---

# YOLOv10, YOLO26 and Ultralytics exports with nms=True; rows of zeros are padding.
YOLOV10 = _family("yolov10", COCO80, "xyxy, score, class", "b n 6", by_shape=True)
# YOLOv7 exported with --end2end, the answers of the whole batch. With --grid it has YOLOv5's layout.
YOLOV7 = _family("yolov7", COCO80, "picture, xyxy, class, score", "n 7", by_shape=True)
# YOLO-NAS, whose graph scales values itself: flat, and batch (scores and classes of -1 are padding).
YOLONAS_FLAT = _family("yolonasflat", COCO80, "picture, xyxy, score, class", "n 7", by_shape=True)
YOLONAS = _family(
    "yolonas", COCO80, "*num_predictions: count; *pred_boxes: xyxy; *pred_scores: score; *pred_classes: class",
    "*num_predictions: b n, *pred_boxes: b n 4, *pred_scores: b n, *pred_classes: b n",
)  # fmt: skip
# EfficientDet of Google's AutoML: px of the picture, which the graph resizes itself; numbers of COCO, 91 with 0.
EFFICIENTDET = _family(
    "efficientdet", COCO91, "picture, yxyx, score, class", "b n 7", "n 7",
    preset={"value_range": "0-255", **_AS_IT_IS},
    unknown=BACKGROUND_FIRST, fixed_resize="letterbox-top-left", by_shape=True,
)  # fmt: skip
# OpenVINO's and Caffe's DetectionOutput.
DETECTION_OUTPUT = _family(
    "detectionoutput", COCO91, "picture, class, score, xyxy in shares", "1 1 n 7",
    preset={"colour": "bgr", "value_range": "0-255", **_STRETCHED}, unknown=BACKGROUND_FIRST, by_shape=True,
)  # fmt: skip
# SSD of the ONNX zoo (ssd-12, MLPerf's ResNet-34): 80 classes, counted from 1.
SSD = _family(
    "ssd", COCO80, "bboxes: xyxy in shares; labels: class from 1; scores: score",
    "bboxes: b n 4, labels: b n, scores: b n",
    preset={"input_size_px": (1200, 1200), **_NORMALISED},
)  # fmt: skip
# YOLOv6 and others exported end to end; some call the outputs as TensorRT's plugin does, with the names of
# TensorFlow's API, whose count has no second axis.
YOLOV6E2E = _family(
    "yolov6e2e",
    COCO80,
    "num_det*: count; det*_boxes: xyxy; det*_scores: score; det*_classes: class",
    "num_dets: b n, det_boxes: b n 4, det_scores: b n, det_classes: b n",
    "num_detections: b n, detection_boxes: b n 4, detection_scores: b n, detection_classes: b n",
)
# PP-YOLOE and PicoDet: the answers of the whole batch, and how many each picture has; class -1 is no answer.
PPYOLOE = _family(
    "ppyoloe", COCO80, "class, score, xyxy; count", "with scale_factor, n 6, n", preset=_STRETCHED
)
# MMDeploy's detectors, class numbers below 0 where empty.
MMDEPLOY = _family(
    "mmdeploy", COCO80, "dets: xyxy, score; labels: class", "dets: b n 5, labels: b n",
    preset={
        "value_range": "0-255", "mean": IMAGENET_255[0], "std": IMAGENET_255[1], "resize": "letterbox-top-left",
        "pad_value": 0, "input_size_px": (800, 1344),
    },
)  # fmt: skip
# RT-DETR, D-FINE and DEIM of their own repositories. Some exports of DEIMv2 have no batch axis, as torchvision's have
# none.
RTDETR = _family(
    "rtdetr",
    COCO80,
    "class; xyxy; score",
    "labels: b n, boxes: b n 4, scores: b n",
    "with orig_target_sizes, n int, n 4, n float, ...",
    "without chw, labels: n int, boxes: n 4, scores: n float",
    preset=_ANTIALIASED,
    unknown="whether it takes mean and std of ImageNet, as DEIMv2 does where its backbone is DINOv3",
)
# torchvision's detectors, of one picture [3, H, W]; px of the picture that was fed, numbers from 1 on. The outputs'
# order differs between its models.
TORCHVISION = _family(
    "torchvision",
    COCO91,
    "xyxy; class; score",
    "without orig_target_sizes, n 4, n int, n float, ...",
    preset=_AS_IT_IS,
    unknown=BACKGROUND_FIRST,
)
# TensorFlow's Object Detection API (SSD-MobileNet and others). Class numbers are kept: 1 is the first class, so names
# begin with one for 0, as "coco91" does. The graph squeezes pictures itself.
TFOD = _family(
    "tfod",
    COCO91,
    "num*: count; *boxes: yxyx in shares; *score*: score; *class*: class",
    "num_detections: b, detection_boxes: b n 4, detection_scores: b n, detection_classes: b n",
    "b, b n 4, *score*: b n, *class*: b n",
    preset={"value_range": "0-255", **_AS_IT_IS},
    unknown=BACKGROUND_FIRST,
    fixed_resize="stretch",
)
# Outputs that a contract states, of no known exporter.
COLUMNS = Family(Contract("columns", COCO80, input_size_px=(640, 640)), (), by_shape=True)
