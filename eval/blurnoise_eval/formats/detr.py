"""DETR as transformers exports it: ``logits`` [1, Q, C + 1] and ``pred_boxes`` [1, Q, 4], none doubled."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.formats.candidates import Candidates, best_class, select
from blurnoise_eval.formats.signature import Signature

NAME = "detr"
OUTPUTS: tuple[str, ...] = ("logits", "pred_boxes")
LOOKALIKES = ""


def class_count(signature: Signature) -> int | None:
    """C; the last logit stands for no object."""
    shapes = signature.named(OUTPUTS)
    if signature.size_px is None or shapes is None:
        return None
    logits, boxes = shapes
    fits = len(logits) == len(boxes) == 3 and boxes[2] == 4
    return logits[2] - 1 if fits and isinstance(logits[2], int) and logits[2] > 1 else None


def decode(outputs: Sequence[NDArray[np.float32]], size_px: tuple[int, int], min_score: float) -> Candidates:
    """Score = largest softmax but the last; (centre x, y, width, height) as shares of the input."""
    logits, boxes = (output[0] for output in outputs)
    powers = np.exp(logits - logits.max(axis=1, keepdims=True))
    scores, class_ids = best_class(powers[:, :-1] / powers.sum(axis=1, keepdims=True))
    input_whwh = np.array([size_px[1], size_px[0]] * 2, np.float32)
    return select(boxes * input_whwh, scores, class_ids, min_score)
