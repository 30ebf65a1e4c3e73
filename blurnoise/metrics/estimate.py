"""Estimates: a number, or one per item of a batch, its interval, and the names of what may be wrong with it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from torch import Tensor


@dataclass(frozen=True)
class Estimate:
    """A number between ``low`` and ``high`` at 95 %, NaN without interval; flags say why it is NaN, or doubtful."""

    value: float
    low: float = math.nan
    high: float = math.nan
    flags: frozenset[str] = frozenset()

    @property
    def told(self) -> bool:
        """Whether there is a number."""
        return math.isfinite(self.value)


@dataclass(frozen=True)
class BatchEstimate:
    """A number per item of a batch, its interval and its flags by name, as tensors of one shape."""

    value: Tensor
    low: Tensor
    high: Tensor
    flags: Mapping[str, Tensor]
