"""An estimate: one number, the interval it lies in, and what speaks against it."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Estimate:
    """A number between ``low`` and ``high`` at 95 %, and the names of what speaks against it.

    NaN in value: it cannot be told, and the flags say why. NaN in low and high: no interval. Results of a whole
    batch (:mod:`~blurnoise.metrics.noise`, :mod:`~blurnoise.metrics.contrast`) hold the same four as tensors.
    """

    value: float
    low: float = math.nan
    high: float = math.nan
    flags: frozenset[str] = frozenset()

    @property
    def told(self) -> bool:
        """Whether there is a number."""
        return math.isfinite(self.value)
