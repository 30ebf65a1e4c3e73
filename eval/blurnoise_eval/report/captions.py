"""Captions of example pictures: what was found or read in them."""

from __future__ import annotations

from typing import Any

import numpy as np

from blurnoise_eval.drawing.annotate import OTHER_SCORE


def outcome_text(example: dict[str, Any], threshold: float) -> str:
    """How many of the example's targets were found, and their mean confidence; or what was read in them."""
    if example["error"] is not None:
        return f"the model failed: {example['error']}"
    targets = example["targets"]
    confidences = [target["confidence"] for target in targets]
    if not targets:
        count = sum(detection["score"] >= OTHER_SCORE for detection in example["detections"])
        return f"no target in the picture, {count} detections"
    if any(target["text"] is not None for target in targets):
        return "; ".join(map(_reading_text, targets))
    found = sum(confidence >= threshold for confidence in confidences)
    if len(confidences) == 1:
        return f"{'found' if found else 'missed'}, confidence {confidences[0]:.2f}"
    return f"{found} of {len(confidences)} found, mean confidence {np.mean(confidences):.2f}"


def missed(example: dict[str, Any], threshold: float) -> bool:
    """Whether any of the example's targets was missed, or read wrongly."""
    return any(
        target["confidence"] <= 0 if target["text"] is not None else target["confidence"] < threshold
        for target in example["targets"]
    )


def _reading_text(target: dict[str, Any]) -> str:
    right = target["confidence"] > 0
    verdict = f"confidence {target['confidence']:.2f}" if right else "wrong"
    return f"read “{target['text']}”, {verdict}" if target["text"] else "read nothing"
