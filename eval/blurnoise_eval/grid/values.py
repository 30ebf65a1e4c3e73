"""Numbers as options and files of settings state them: lists, steps, ranges, "auto"."""

from __future__ import annotations

import math
from typing import NamedTuple

AUTOMATIC = math.inf
"""The value of an axis that the camera sets itself, for each picture; "auto" in tables."""
FORMS = "1,5,10, start:stop:step (stop included), or low:high for both and 1, 3, 10, 30 ... between"
_MOST = 100_000


class Range(NamedTuple):
    """From low to high."""

    low: float
    high: float

    def __repr__(self) -> str:
        """As it is typed."""
        return f"{self.low:g}:{self.high:g}"


def numbers(text: str, *, automatic: bool = False) -> tuple[float, ...]:
    """Parse "1,5,10", "start:stop:step" or "low:high"; "auto" where that is allowed. Raises ``ValueError``.

    low:high: both ends and what of 1, 3, 10, 30 ... lies between, from two decades below the high end where the low
    one is 0.
    """
    try:
        if ":" not in text:
            return tuple(number(part, automatic=automatic) for part in text.split(","))
        if text.count(":") == 1:
            return _between(*bounds(text))
        start, stop, step = (float(part) for part in text.split(":"))
        count = math.floor((stop - start) / step + 1e-9) + 1
        if step == 0 or count < 1 or count > _MOST:
            raise ValueError
        return tuple(start + step * index for index in range(count))
    except (ValueError, ZeroDivisionError, OverflowError):
        also = ", or auto" if automatic else ""
        raise ValueError(f"must be numbers as {FORMS}{also}") from None


def _between(low: float, high: float) -> tuple[float, ...]:
    if not 0 <= low < high < math.inf:
        raise ValueError
    least = low or high / 100
    powers = range(math.floor(math.log10(least)), math.ceil(math.log10(high)) + 1)
    between = (float(f"{digit}e{power}") for power in powers for digit in (1, 3))
    inner = (value for value in between if max(low, least * (1 - 1e-9)) <= value < high and value != low)
    return (low, *inner, high)


def number(text: str | float, *, automatic: bool = True) -> float:
    """A number, or "auto" as ``AUTOMATIC``, which no number says, however large. Raises ``ValueError``."""
    if automatic and isinstance(text, str) and text.strip() == "auto":
        return AUTOMATIC
    try:
        value = float(text)
    except ValueError:
        value = math.inf
    if math.isinf(value):
        raise ValueError(f"must be a number{', or auto' if automatic else ''}")
    return value


def bounds(text: str | Range) -> Range:
    """Parse "low:high", or one number for both. Raises ``ValueError``."""
    try:
        low, high = str(text).split(":") if ":" in str(text) else (str(text),) * 2
        return Range(float(low), float(high))
    except ValueError:
        raise ValueError(f"{str(text)!r}: must be low:high or a number") from None
