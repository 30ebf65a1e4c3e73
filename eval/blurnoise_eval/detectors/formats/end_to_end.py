"""Families whose graph gives the answers themselves, none doubled, and transformers with a row of logits for each
query. The former differ in names, columns and units: an answer is a box, a score and the number of its class, spread
over columns of one output or several.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from blurnoise_eval.detectors.class_names import COCO80, COCO91
from blurnoise_eval.detectors.contract import IMAGENET, IMAGENET_255, Contract
from blurnoise_eval.detectors.formats.candidates import Candidates, best_class, select, sigmoid
from blurnoise_eval.detectors.formats.signature import Family, Layout, Signature
from blurnoise_eval.detectors.model import TensorInfo
from blurnoise_eval.detectors.records import FloatArray

Describe = Callable[[Signature], Layout | None]
_SIZE_640: dict[str, Any] = {"input_size_px": (640, 640), "nms_iou": None}
_E2E_NAMES = ("num_dets", "det_boxes", "det_scores", "det_classes")
_PLUGIN_NAMES = ("num_detections", "detection_boxes", "detection_scores", "detection_classes")

BAKED = "the score threshold and the overlap that are baked into the graph: weaker answers never leave it"
"""What families that suppress double answers themselves leave unsaid."""
BACKGROUND_FIRST = (
    f"{BAKED}; whether 'classes' begins with a name for 0, which its numbers keep for the background"
)
"""The same of those that count classes from 1."""
_QUERIES: dict[str, Any] = {"mean": IMAGENET[0], "std": IMAGENET[1], "resize": "stretch", "nms_iou": None}


def decode(
    outputs: Sequence[FloatArray],
    size_px: tuple[int, int],
    min_score: float,
    *,
    columns: Sequence[str],
    shares: bool = False,
) -> Candidates:
    """Candidates from what ``columns`` says of each output.

    A letter a column: x, y, X, Y: left, top, right, bottom; s: score; c: class; i: picture in the batch; n, of an
    output of its own: how many answers count. shares: boxes are shares of the input, else px of it. Answers of
    other pictures than the first, and those whose class is no number >= 0, are left out.
    """
    batched = max(output.ndim for output in outputs) == 3
    count = None
    values: dict[str, FloatArray] = {}
    for letters, output in zip(columns, outputs, strict=True):
        if letters == "n":
            count = int(output.flat[0])
            continue
        rows = output[0] if batched else output
        values |= zip(letters, rows.reshape(len(rows), len(letters)).T, strict=True)
    values = {letter: column[:count] for letter, column in values.items()}
    real = np.isfinite(values["c"]) & (values["c"] >= 0) & (values.get("i", 0) == 0)
    boxes = np.stack([values[letter][real] for letter in "xyXY"], axis=1)
    if shares:
        boxes = boxes * _whwh(size_px)
    class_ids = values["c"][real].astype(np.int64)
    return select(boxes, values["s"][real], class_ids, min_score, corners=True)


def _alone(signature: Signature, rank: int, width: int) -> Layout | None:
    """One output of rows as wide as this, with a batch (rank 3) or without."""
    output = signature.outputs[0]
    fits = len(signature.outputs) == 1 and len(output.shape) == rank and output.shape[-1] == width
    return Layout.of(output, f"rows of {width}") if fits else None


def _ppyoloe(signature: Signature) -> Layout | None:
    """[N, 6], the answers of the whole batch, and [batch], how many each picture has; asks for scale_factor."""
    asked = "scale_factor" in [entry.name for entry in signature.inputs]
    return Layout.of_form(signature.outputs, (2, 1), "60") if asked else None


def _rtdetr(signature: Signature) -> Layout | None:
    """These three outputs; ``orig_target_sizes`` is fed the input's own size.

    Some exports of DEIMv2 have no batch axis, as torchvision's have none: then by their ranks and types where sizes
    are asked for, else by their names.
    """
    found = signature.named(("labels", "boxes", "scores"))
    alone = signature.of_one_picture()
    takes_one = signature.inputs[0].axes == "chw"
    if alone and (signature.asks_for_size or (found and not takes_one)):
        boxes, labels, scores = alone
        return Layout.by_name([labels, boxes, scores])
    return Layout.of_form(found, (2, 3, 2), "040")


def _torchvision(signature: Signature) -> Layout | None:
    """One [N, 4], one [N] of integers and one [N] of floats: the order differs between its models."""
    found = None if signature.asks_for_size else signature.of_one_picture()
    return None if found is None else Layout.by_name(found)


def _tfod(signature: Signature) -> Layout | None:
    """The API's own output names, the count [batch]; else of four outputs of its shapes those called class, score."""
    found = signature.named(_PLUGIN_NAMES) or _by_shape(signature.outputs)
    return Layout.of_form(found, (1, 3, 2, 2), "0400")


def _by_shape(outputs: Sequence[TensorInfo]) -> list[TensorInfo] | None:
    """[batch], [batch, N, 4] and twice [batch, N], whose names then have to tell scores from classes."""
    count = [output for output in outputs if len(output.shape) == 1]
    boxes = [output for output in outputs if len(output.shape) == 3]
    flat = [output for output in outputs if len(output.shape) == 2]
    scores, classes = ([o for o in flat if word in o.name.lower()] for word in ("score", "class"))
    if len(outputs) != 4 or any(len(group) != 1 for group in (count, boxes, scores, classes)):
        return None
    return [*count, *boxes, *scores, *classes]


def _family(
    preset: Contract,
    describe: Describe,
    *columns: str,
    unknown: str = BAKED,
    shares: bool = False,
    **further: Any,
) -> Family:
    return Family(preset, describe, partial(decode, columns=columns, shares=shares), unknown, **further)


# YOLOv10, YOLO26 and Ultralytics exports with nms=True: [1, N, 6]; rows of zeros are padding.
YOLOV10 = _family(Contract("yolov10", COCO80, **_SIZE_640), partial(_alone, rank=3, width=6), "xyXYsc")
# YOLOv7 exported with --end2end: [N, 7], the answers of the whole batch. With --grid it has YOLOv5's layout.
YOLOV7 = _family(Contract("yolov7", COCO80, **_SIZE_640), partial(_alone, rank=2, width=7), "ixyXYcs")
# YOLOv6 and others exported end to end; some call the outputs as TensorRT's plugin does, with the names of
# TensorFlow's API, whose count has no second axis.
YOLOV6E2E = _family(
    Contract("yolov6e2e", COCO80, **_SIZE_640),
    lambda signature: Layout.of_form(
        signature.named(_E2E_NAMES) or signature.named(_PLUGIN_NAMES), (2, 3, 2, 2), "0400"
    ),
    "n", "xyXY", "s", "c",
)  # fmt: skip
# PP-YOLOE and PicoDet; class -1 is no answer.
PPYOLOE = _family(Contract("ppyoloe", COCO80, resize="stretch", **_SIZE_640), _ppyoloe, "csxyXY", "n")
# MMDeploy's detectors, class numbers below 0 where empty.
MMDEPLOY = _family(
    Contract(
        "mmdeploy", COCO80, value_range="0-255", mean=IMAGENET_255[0], std=IMAGENET_255[1],
        resize="letterbox-top-left", pad_value=0, input_size_px=(800, 1344), nms_iou=None,
    ),
    lambda signature: Layout.of_form(signature.named(("dets", "labels")), (3, 2), "50"),
    "xyXYs", "c",
)  # fmt: skip
# RT-DETR, D-FINE and DEIM.
RTDETR = _family(
    Contract("rtdetr", COCO80, resize="stretch", **_SIZE_640),
    _rtdetr,
    "c", "xyXY", "s",
    unknown="whether it takes mean and std of ImageNet, as DEIMv2 does where its backbone is DINOv3",
)  # fmt: skip
# torchvision's detectors, of one picture [3, H, W]; px of the picture that was fed, numbers from 1 on.
TORCHVISION = _family(
    Contract("torchvision", COCO91, resize="none", nms_iou=None), _torchvision, "xyXY", "c", "s",
    unknown=BACKGROUND_FIRST,
)  # fmt: skip
# TensorFlow's Object Detection API (SSD-MobileNet and others). Class numbers are kept: 1 is the first class, so names
# begin with one for 0, as "coco91" does. The graph squeezes pictures itself.
TFOD = _family(
    Contract("tfod", COCO91, value_range="0-255", resize="none", nms_iou=None), _tfod, "n", "yxYX", "s", "c",
    unknown=BACKGROUND_FIRST, shares=True, fixed_resize="stretch",
)  # fmt: skip


def _describe_detr(signature: Signature) -> Layout | None:
    """``logits`` [1, Q, C + 1] and ``pred_boxes`` [1, Q, 4]; the last logit stands for no object.

    So transformers exports it; its own code calls the first ``pred_logits``.
    """
    found = signature.named(("logits", "pred_boxes")) or signature.named(("pred_logits", "pred_boxes"))
    width = found[0].shape[-1] if found else None
    return Layout.of_form(found, (3, 3), "04", width - 1) if isinstance(width, int) and width > 1 else None


def _decode_detr(outputs: Sequence[FloatArray], size_px: tuple[int, int], min_score: float) -> Candidates:
    """Score = largest softmax but the last; (centre x, y, width, height)."""
    logits, boxes = (output[0] for output in outputs)
    powers = np.exp(logits - logits.max(axis=1, keepdims=True))
    class_scores = powers[:, :-1] / powers.sum(axis=1, keepdims=True)
    return select(boxes * _whwh(size_px), *best_class(class_scores), min_score, class_scores)


def _describe_rfdetr(signature: Signature) -> Layout | None:
    """``dets`` [batch, Q, 4] with ``labels`` [batch, Q, C], a slot for the background included.

    They are told apart by name: with C = 4 both are 4 wide.
    """
    found = signature.named(("dets", "labels"))
    width = found[1].shape[-1] if found else None
    return Layout.of_form(found, (3, 3), "40", width) if isinstance(width, int) else None


def _decode_rfdetr(outputs: Sequence[FloatArray], size_px: tuple[int, int], min_score: float) -> Candidates:
    """Score = sigmoid of the largest logit; (centre x, y, width, height)."""
    boxes, logits = outputs[0][0], outputs[1][0]
    class_scores = sigmoid(logits)
    _, class_ids = best_class(logits)  # large ones all give 1
    scores = class_scores[np.arange(len(class_ids)), class_ids]
    return select(boxes * _whwh(size_px), scores, class_ids, min_score, class_scores)


def _whwh(size_px: tuple[int, int]) -> FloatArray:
    return np.array([size_px[1], size_px[0]] * 2, np.float32)


# Its PostProcess: max over the classes.
DETR = Family(Contract("detr", COCO91, input_size_px=(800, 800), **_QUERIES), _describe_detr, _decode_detr)
# Its PostProcess: the best of all queries and classes.
RFDETR = Family(
    Contract("rfdetr", COCO91, input_size_px=(560, 560), **_QUERIES),
    _describe_rfdetr,
    _decode_rfdetr,
    unknown="whether one of the class slots, and which, stands for the background",
    several_classes=True,
)
