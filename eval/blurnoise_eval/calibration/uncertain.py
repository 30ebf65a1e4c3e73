"""Uncertain values: a value with its standard deviation, and the 95 % interval that follows."""

from __future__ import annotations

import math
from typing import NamedTuple

from blurnoise.metrics.values import Estimate

Z = 1.959964  # of a normal number, two-sided 95 %


class Uncertain(NamedTuple):
    """A value and its standard deviation.

    >>> Uncertain(2.0, 0.5).interval(least=1.2)
    Estimate(value=2.0, low=1.2, high=2.979982, flags=frozenset())
    """

    value: float
    error: float

    def interval(self, least: float = -math.inf) -> Estimate:
        """The value with its interval, whose lower end is at least ``least``."""
        return Estimate(self.value, max(least, self.value - Z * self.error), self.value + Z * self.error)

    def root(self) -> Estimate:
        """The root of the value, which is a square, at least 0."""
        square = self.interval()
        value, low, high = (math.sqrt(max(0.0, end)) for end in (square.value, square.low, square.high))
        return Estimate(value, low, high)

    def term(self) -> Estimate:
        """As :meth:`root`, but 0 if the interval includes 0: a camera need not have this term.

        >>> Uncertain(4.0, 3.0).root().value, Uncertain(4.0, 3.0).term().value
        (2.0, 0.0)
        """
        root = self.root()
        return root if root.low > 0 else Estimate(0.0, root.low, root.high)


def interval_texts(estimate: Estimate) -> tuple[str, str]:
    """Both ends of an interval, with enough digits to distinguish them.

    >>> interval_texts(Estimate(1.0, 0.9999, 1.0001))
    ('0.9999', '1.0001')
    """
    size, width = max(abs(estimate.low), abs(estimate.high)), estimate.high - estimate.low
    digits = 3 if width <= 0 else max(3, math.ceil(math.log10(size / width)) + 2)
    return f"{estimate.low:.{digits}g}", f"{estimate.high:.{digits}g}"
