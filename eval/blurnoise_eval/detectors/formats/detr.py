"""DETR: ``logits`` [1, Q, C + 1] and ``pred_boxes`` [1, Q, 4], none doubled.

So transformers exports it; its own code calls the first ``pred_logits``.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.detectors.formats.candidates import Candidates, best_class, select
from blurnoise_eval.detectors.formats.signature import Layout, Signature

NAME = "detr"
UNKNOWN = ""
SEVERAL_CLASSES = False  # PostProcess: max over the classes


def describe(signature: Signature) -> Layout | None:
    """These two outputs; the last logit stands for no object."""
    found = signature.named(("logits", "pred_boxes")) or signature.named(("pred_logits", "pred_boxes"))
    if signature.size_px is None or found is None:
        return None
    logits, boxes = (output.shape for output in found)
    fits = len(logits) == len(boxes) == 3 and boxes[2] == 4
    if not fits or not isinstance(logits[2], int) or logits[2] < 2:
        return None
    return Layout.by_name(found, logits[2] - 1)


def decode(outputs: Sequence[NDArray[np.float32]], size_px: tuple[int, int], min_score: float) -> Candidates:
    """Score = largest softmax but the last; (centre x, y, width, height) as shares of the input."""
    logits, boxes = (output[0] for output in outputs)
    powers = np.exp(logits - logits.max(axis=1, keepdims=True))
    class_scores = powers[:, :-1] / powers.sum(axis=1, keepdims=True)
    input_whwh = np.array([size_px[1], size_px[0]] * 2, np.float32)
    return select(boxes * input_whwh, *best_class(class_scores), min_score, class_scores)
