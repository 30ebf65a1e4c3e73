"""Greedy decoding of connectionist temporal classification (CTC): class probabilities to text; errors of texts.

Domain: (T, C) float32, a row per step along the text. Class 0 is the blank.
Source: Graves et al. (2006); dictionary and confidence as in PP-OCR.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rapidfuzz.distance import Levenshtein

from blurnoise_eval.detectors.records import FloatArray


@dataclass(frozen=True)
class Reading:
    """A text, and how sure its reader is: 0 to 1, the mean of its characters' probabilities; 0 for no text.

    Confidence stays high on wrong text: judge the text beside it.
    """

    text: str
    confidence: float


NOTHING = Reading("", 0.0)


def joined(readings: Sequence[Reading]) -> Reading:
    """Several texts with spaces between them, and the mean confidence of their characters."""
    found = [reading for reading in readings if reading.text]
    total = sum(reading.confidence * len(reading.text) for reading in found)
    count = max(sum(len(reading.text) for reading in found), 1)
    return Reading(" ".join(reading.text for reading in found), total / count)


def characters(lines: str) -> list[str]:
    """Return the characters by class: the blank (""), one for each line, and the space.

    Only a line feed ends a line: dictionaries hold characters that Unicode counts among the line ends.
    """
    return ["", *lines.removesuffix("\n").split("\n"), " "]


def decode(probabilities: FloatArray, classes: Sequence[str]) -> Reading:
    """Return the likeliest class of each step, repeats and then blanks left out.

    Convention: a class that comes again after a blank is a second character. The confidence is the mean of
    the probabilities at the first step of each character.
    """
    best = probabilities.argmax(axis=1)
    kept = best != 0
    kept[1:] &= best[1:] != best[:-1]
    if not kept.any():
        return NOTHING
    confidence = float(probabilities[kept, best[kept]].mean())
    return Reading("".join(classes[index] for index in best[kept]), min(confidence, 1.0))


def are_probabilities(rows: FloatArray) -> bool:
    """Whether no value is negative and each row sums to 1, within the rounding of half precision."""
    return bool(rows.min(initial=0.0) >= 0 and (abs(rows.sum(axis=-1) - 1) < 0.01).all())


def character_error_rate(read: str, truth: str) -> float:
    """Return the insertions, deletions and substitutions that turn ``read`` into ``truth``, per character of it.

    Upper and lower case differ. Convention: where there is no text, reading none is 0, and reading any is 1.
    """
    return Levenshtein.distance(read, truth) / len(truth) if truth else float(bool(read))
