"""Checks of a detector's answer to a picture: what in it suggests that its contract, or its export, is wrong.

Measured with the right contracts of two real detectors on 35 photographs: no alarm. With red and blue swapped
a picture raises one in five times, so ask for several; with the wrong value range nearly always.
"""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.detectors.contract import Contract, ModelError
from blurnoise_eval.detectors.detector import Detector

COUNTED_SCORE = 0.25  # answers from here on are summed: one picture's worth of confidence
_MARKEDLY, _AT_LEAST = 1.5, 0.5  # another reading must give that many times the sum, and that much more
_SATURATED_SCORE, _SATURATED_ANSWERS = 0.99, 5  # an overdriven network is certain of many things
_OTHER: dict[str, Any] = {"rgb": "bgr", "bgr": "rgb", "0-1": "0-255", "0-255": "0-1"}


def suspicions(detector: Detector, image: NDArray[np.uint8]) -> list[str]:
    """Return a sentence for each suspicion that an RGB picture (h, w, 3) raises; best a clean, lively one.

    NaN or infinite outputs, scores that are all exactly 0 or above 1, and another colour order or value range
    that gives markedly higher scores. Costs three inferences.
    """
    blob, placement = detector.prepare(image)
    outputs = detector.run(blob)
    if count := sum(int(output.size - np.isfinite(output).sum()) for output in outputs):
        return [f"the outputs hold {count} values that are NaN or infinite"]
    # Graphs that suppress double answers themselves pad with zeros, or answer nothing.
    if detector.contract.nms_iou is not None and detector.top_score(outputs) == 0:
        zero = "every score is exactly 0: is it an int8 export whose one output scale rounds all scores away?"
        return [zero, *_better_readings(detector, image, np.zeros(0, np.float32))]
    try:
        own = detector.decode(outputs, placement, min_score=COUNTED_SCORE).scores
    except ModelError as error:
        return [str(error)]
    return _better_readings(detector, image, own)


def common_suspicions(detector: Detector, images: Iterable[NDArray[np.uint8]]) -> list[str]:
    """Return the suspicions that at least half of the pictures raise, each in the words of the first.

    A picture on which the detector fails raises none here.
    """
    raised: dict[str, list[str]] = {}
    count = 0
    for image in images:
        count += 1
        with suppress(ModelError):
            for text in suspicions(detector, image):
                raised.setdefault(text.split()[0], []).append(
                    text
                )  # a field's name, or how the sentence begins
    return [
        f"{len(texts)} of {count} pictures: {texts[0]}"
        for texts in raised.values()
        if 2 * len(texts) >= count
    ]


def _better_readings(detector: Detector, image: NDArray[np.uint8], own: NDArray[np.float32]) -> list[str]:
    found = []
    contract = detector.contract
    others = {"colour": replace(contract, colour=_OTHER[contract.colour])}
    if not detector.takes_bytes:
        others["value_range"] = replace(contract, value_range=_OTHER[contract.value_range])
    for name, changed in others.items():
        stated, other = getattr(contract, name), _scores(detector, image, changed)
        higher = other.sum() > max(own.sum() * _MARKEDLY, own.sum() + _AT_LEAST)
        calmer = name == "value_range" and _saturated(own) and other.sum() >= _AT_LEAST
        if (higher or calmer) and not _saturated(other):
            found.append(
                f"{name} = {stated!r} ({contract.sources[name]}): with {_OTHER[stated]!r} the same "
                f"picture has {len(other)} answers from {COUNTED_SCORE} on, scores in all {other.sum():.2f}, "
                f"instead of {len(own)}, in all {own.sum():.2f}"
            )
    return found


def _scores(detector: Detector, image: NDArray[np.uint8], contract: Contract) -> NDArray[np.float32]:
    """The scores with another contract; none where it makes the outputs impossible."""
    blob, placement = detector.prepare(image, contract=contract)
    outputs = detector.run(blob)
    try:
        if all(np.isfinite(output).all() for output in outputs):
            return detector.decode(outputs, placement, min_score=COUNTED_SCORE).scores
    except ModelError:
        pass
    return np.zeros(0, np.float32)


def _saturated(scores: NDArray[np.float32]) -> bool:
    return int((scores >= _SATURATED_SCORE).sum()) >= _SATURATED_ANSWERS
