"""Numbers as they are typed in options and files: one, a list, or a range."""

from __future__ import annotations

import math

AUTOMATIC = math.inf
"""The value of an axis that the camera sets itself, for each picture; "auto" in tables."""


def number(text: str | float, *, automatic: bool = False) -> float:
    """A finite number, or ``AUTOMATIC`` for "auto" where that is allowed. Raises ``ValueError``.

    >>> number("12.5"), number("auto", automatic=True) == AUTOMATIC
    (12.5, True)
    """
    if automatic and isinstance(text, str) and text.strip() == "auto":
        return AUTOMATIC
    try:
        value = math.inf if isinstance(text, bool) else float(text)
    except (OverflowError, TypeError, ValueError):
        value = math.inf
    if math.isinf(value):
        raise ValueError(f"must be a number{', or auto' if automatic else ''}")
    return value


def bounds(text: str) -> tuple[float, float]:
    """The numbers of "low:high", or one number for both. Raises ``ValueError``.

    >>> bounds("2:50"), bounds("5")
    ((2.0, 50.0), (5.0, 5.0))
    """
    low, colon, high = str(text).partition(":")
    try:
        return float(low), float(high if colon else low)
    except ValueError:
        raise ValueError("must be low:high or a number") from None


def numbers(text: str, *, automatic: bool = False) -> tuple[float, ...]:
    """Parse "1,5,10", "start:stop:step" or "low:high"; "auto" where that is allowed. Raises ``ValueError``.

    low:high gives both ends, and those of 1, 3, 10, 30 ... that lie between. Where the low end is 0, these begin two
    decades below the high end.

    >>> numbers("1:10:3"), numbers("2:50")
    ((1.0, 4.0, 7.0, 10.0), (2.0, 3.0, 10.0, 30.0, 50.0))
    """
    try:
        if ":" not in text:
            return tuple(number(part, automatic=automatic) for part in text.split(","))
        if text.count(":") == 2:
            start, stop, step = map(float, text.split(":"))
            count = math.floor((stop - start) / step + 1e-9) + 1  # 0:1:0.1 ends at 1, in spite of rounding
            if not 0 < count <= 10**5:
                raise ValueError
            return tuple(start + step * index for index in range(count))
        low, high = bounds(text)
        if not 0 <= low < high < math.inf:
            raise ValueError
    except (ValueError, ZeroDivisionError, OverflowError):
        must = (
            "must be numbers such as 1,5,10, or start:stop:step, or low:high (with 1, 3, 10, 30 ... between)"
        )
        raise ValueError(f"{must}{', or auto' if automatic else ''}") from None
    # Two decades below the high end, since 0 has no logarithm.
    least = low or high / 100
    powers = range(math.floor(math.log10(least)), math.ceil(math.log10(high)) + 1)
    between = (float(f"{digit}e{power}") for power in powers for digit in (1, 3))
    inner = (value for value in between if max(low, least * (1 - 1e-9)) <= value < high and value != low)
    return (low, *inner, high)
