"""An estimate: one number, its interval, and the names of what may be wrong with it."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Estimate:
    """A number between ``low`` and ``high`` at 95 %, with flags.

    NaN in value: not available, and the flags say why. NaN in low and high: no interval. Results of a batch
    (:mod:`~blurnoise.metrics.patches`) hold the same four as tensors.
    """

    value: float
    low: float = math.nan
    high: float = math.nan
    flags: frozenset[str] = frozenset()

    @property
    def told(self) -> bool:
        """Whether there is a number."""
        return math.isfinite(self.value)
