"""Detection transformers with a row of logits for each query: DETR and RF-DETR; boxes are shares of the input."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from blurnoise_eval.detectors.class_names import COCO91
from blurnoise_eval.detectors.contract import IMAGENET, Contract
from blurnoise_eval.detectors.formats.candidates import Candidates, best_class, select
from blurnoise_eval.detectors.formats.family import Family
from blurnoise_eval.detectors.formats.signature import Layout, Signature
from blurnoise_eval.detectors.records import FloatArray

_PRESET: dict[str, Any] = {"mean": IMAGENET[0], "std": IMAGENET[1], "resize": "stretch", "nms_iou": None}


def _describe_detr(signature: Signature) -> Layout | None:
    """``logits`` [1, Q, C + 1] and ``pred_boxes`` [1, Q, 4]; the last logit stands for no object.

    So transformers exports it; its own code calls the first ``pred_logits``.
    """
    found = signature.named(("logits", "pred_boxes")) or signature.named(("pred_logits", "pred_boxes"))
    if signature.size_px is None or found is None:
        return None
    logits, boxes = (output.shape for output in found)
    fits = len(logits) == len(boxes) == 3 and boxes[2] == 4
    if not fits or not isinstance(logits[2], int) or logits[2] < 2:
        return None
    return Layout.by_name(found, logits[2] - 1)


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
    if signature.size_px is None or found is None:
        return None
    dets, labels = (output.shape for output in found)
    fits = len(dets) == len(labels) == 3 and dets[:2] == labels[:2] and dets[2] == 4
    return Layout.by_name(found, labels[2]) if fits and isinstance(labels[2], int) else None


def _decode_rfdetr(outputs: Sequence[FloatArray], size_px: tuple[int, int], min_score: float) -> Candidates:
    """Score = sigmoid of the largest logit; (centre x, y, width, height)."""
    boxes, logits = outputs[0][0], outputs[1][0]
    class_scores = 0.5 * (1 + np.tanh(logits / 2))  # the sigmoid, without overflow
    _, class_ids = best_class(logits)  # large ones all give 1
    scores = class_scores[np.arange(len(class_ids)), class_ids]
    return select(boxes * _whwh(size_px), scores, class_ids, min_score, class_scores)


def _whwh(size_px: tuple[int, int]) -> FloatArray:
    return np.array([size_px[1], size_px[0]] * 2, np.float32)


# Its PostProcess: max over the classes.
DETR = Family(Contract("detr", COCO91, input_size_px=(800, 800), **_PRESET), _describe_detr, _decode_detr)
# Its PostProcess: the best of all queries and classes.
RFDETR = Family(
    Contract("rfdetr", COCO91, input_size_px=(560, 560), **_PRESET),
    _describe_rfdetr,
    _decode_rfdetr,
    unknown="whether one of the class slots, and which, stands for the background",
    several_classes=True,
)
