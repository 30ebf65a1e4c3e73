"""RF-DETR: ``dets`` [1, Q, 4] and ``labels`` [1, Q, C], told apart by name: with C = 4 both are 4 wide."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.detectors.formats.candidates import Candidates, best_class, select
from blurnoise_eval.detectors.formats.signature import Layout, Signature

NAME = "rfdetr"
UNKNOWN = "whether one of the class slots, and which, stands for the background"
SEVERAL_CLASSES = True  # PostProcess: the best of all queries and classes


def describe(signature: Signature) -> Layout | None:
    """``dets`` [batch, Q, 4] with ``labels`` [batch, Q, C], a slot for the background included."""
    found = signature.named(("dets", "labels"))
    if signature.size_px is None or found is None:
        return None
    dets, labels = (output.shape for output in found)
    fits = len(dets) == len(labels) == 3 and dets[:2] == labels[:2] and dets[2] == 4
    return Layout.by_name(found, labels[2]) if fits and isinstance(labels[2], int) else None


def decode(outputs: Sequence[NDArray[np.float32]], size_px: tuple[int, int], min_score: float) -> Candidates:
    """Score = sigmoid of the largest logit; (centre x, y, width, height) as shares of the input."""
    boxes, logits = outputs[0][0], outputs[1][0]
    class_scores = 0.5 * (1 + np.tanh(logits / 2))  # the sigmoid, without overflow
    _, class_ids = best_class(logits)  # large ones all give 1
    scores = class_scores[np.arange(len(class_ids)), class_ids]
    input_whwh = np.array([size_px[1], size_px[0]] * 2, np.float32)
    return select(boxes * input_whwh, scores, class_ids, min_score, class_scores)
