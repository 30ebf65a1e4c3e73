"""Errors of reading: how far a text is from the truth."""

from __future__ import annotations

from rapidfuzz.distance import Levenshtein


def character_error_rate(read: str, truth: str) -> float:
    """Return the insertions, deletions and substitutions that turn ``read`` into ``truth``, per character of it.

    0 is exact; more than 1 is possible where more was read than is there. Upper and lower case differ.
    Convention: where there is no text, reading none is 0, and reading any is 1.
    """
    if not truth:
        return float(bool(read))
    return Levenshtein.distance(read, truth) / len(truth)
