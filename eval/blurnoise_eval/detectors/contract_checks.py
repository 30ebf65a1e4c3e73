"""Checks of a detector's answer to a picture: what in it suggests that its contract, or its export, is wrong.

Another colour order is suspected where it gives markedly higher scores. For a value range these prove nothing: values
255 times too large make a network certain of more than there is, values 255 times too small leave it next to blind.
So one that sees with 0-1 takes 0-1, and one that is blind with it takes 0-255, unless that overdrives it. What an
exporter's code fixes, as its metadata say, is not doubted.
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

from blurnoise_eval.detectors.contract import EXPORTER, Contract, ModelError
from blurnoise_eval.detectors.detector import Detector

COUNTED_SCORE = 0.25  # answers from here on are summed: one picture's worth of confidence
_MARKEDLY, _AT_LEAST = 1.5, 0.5  # another reading must give that many times the sum, and that much more
_CERTAIN_SCORE, _CERTAIN_ANSWERS = (
    0.99,
    5,
)  # an overdriven network is certain of many things, or of most it finds
_BLIND = 5.0  # with the wrong range a network sees less than this part of what it could
Scores = NDArray[np.float32]
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
        own = detector.decode(outputs, placement, min_score=COUNTED_SCORE).leading.scores
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


def _better_readings(detector: Detector, image: NDArray[np.uint8], own: Scores) -> list[str]:
    found = []
    contract = detector.contract
    others = {"colour": replace(contract, colour=_OTHER[contract.colour])}
    if not detector.takes_bytes:
        others["value_range"] = replace(contract, value_range=_OTHER[contract.value_range])
    for name, changed in others.items():
        if EXPORTER in contract.sources[name]:
            continue
        stated, other = getattr(contract, name), _scores(detector, image, changed)
        if name == "colour":
            better = _higher(other, own) and _certain(other) < _CERTAIN_ANSWERS
        elif stated == "0-1":
            better = other.sum() > max(_BLIND * own.sum(), _AT_LEAST) and not _overdriven(other)
        else:
            worse = _overdriven(own) or _certain(own) > _certain(other) == 0 or _higher(other, own)
            better = worse and other.sum() >= _AT_LEAST and not _overdriven(other)
        if better:
            found.append(
                f"{name} = {stated!r} ({contract.sources[name]}): with {_OTHER[stated]!r} the same "
                f"picture has {len(other)} answers from {COUNTED_SCORE} on, scores in all {other.sum():.2f}, "
                f"instead of {len(own)}, in all {own.sum():.2f}"
            )
    return found


def _higher(scores: Scores, than: Scores) -> bool:
    return bool(scores.sum() > max(than.sum() * _MARKEDLY, than.sum() + _AT_LEAST))


def _overdriven(scores: Scores) -> bool:
    return _certain(scores) >= _CERTAIN_ANSWERS or 2 * _certain(scores) > len(scores)


def _certain(scores: Scores) -> int:
    return int((scores >= _CERTAIN_SCORE).sum())


def _scores(detector: Detector, image: NDArray[np.uint8], contract: Contract) -> Scores:
    """The scores with another contract; none where it makes the outputs impossible."""
    blob, placement = detector.prepare(image, contract=contract)
    outputs = detector.run(blob)
    try:
        if all(np.isfinite(output).all() for output in outputs):
            return detector.decode(outputs, placement, min_score=COUNTED_SCORE).leading.scores
    except ModelError:
        pass
    return np.zeros(0, np.float32)
