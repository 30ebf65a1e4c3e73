"""Companding: long ranges in few bits, by the pixel (skimming) or behind the converter (piecewise linear).

Domain: electrons for :class:`Skimming`, linear levels and codes for :class:`PiecewiseLinear`. Skimming resets the
pixel at t_1 of an exposure T down to a level q that it may have passed: x = min(Phi t_1, q) + Phi (T - t_1), Phi in
electrons per time.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated

import torch
from annotated_types import Gt, Lt
from torch import Tensor

from blurnoise._core.checks import real_tensor, shown
from blurnoise._core.limits import within
from blurnoise._core.validation import Figure, check_fields


@dataclass(frozen=True)
class Skimming:
    """knee_e: q. first_share: t_1 / T. Raises ``TypeError`` or ``ValueError`` naming the field."""

    knee_e: Annotated[Figure, within("full_well_e")]
    first_share: Annotated[Figure, Gt(0), Lt(1)]

    def __post_init__(self) -> None:
        check_fields(self)

    @property
    def slope_ratio(self) -> float:
        """Slope of the response below the knee over that above it, T / (T - t_1)."""
        return 1 / (1 - self.first_share)

    def companded(self, signal_e: Tensor) -> Tensor:
        """What the pixel holds at the end, of what it would have collected, Phi T."""
        return (signal_e * self.first_share).clamp(max=self.knee_e) + signal_e * (1 - self.first_share)

    def expanded(self, held_e: Tensor) -> Tensor:
        """The inverse."""
        return torch.where(
            held_e <= self.knee_e / self.first_share, held_e, (held_e - self.knee_e) * self.slope_ratio
        )

    def variance_e2(self, signal_e: Tensor) -> Tensor:
        """Of shot noise in what the pixel holds: above the knee only of what came after the reset."""
        return torch.where(
            signal_e * self.first_share <= self.knee_e, signal_e, signal_e * (1 - self.first_share)
        )


@dataclass(frozen=True)
class PiecewiseLinear:
    """Points (level, code), from (0, 0) on, both increasing; whole codes, rounded.

    A 20-bit level in 12 bits: ``PiecewiseLinear(((0, 0), (1024, 1024), (65536, 2560), (1048576, 4095)))``.
    Raises ``TypeError`` or ``ValueError``.
    """

    points: tuple[tuple[float, float], ...]

    def __post_init__(self) -> None:
        found = real_tensor("points", self.points)
        if found.ndim != 2 or found.shape[1] != 2 or len(found) < 2 or not bool(torch.isfinite(found).all()):
            raise ValueError(f"points = {shown(self.points)}: must be (level, code), at least two")
        if any(value != 0 for value in self.points[0]) or not bool((found.diff(dim=0) > 0).all()):
            raise ValueError(f"points = {shown(self.points)}: must increase, both, from (0, 0)")

    def companded(self, levels: Tensor) -> Tensor:
        """Codes, of levels within the range; beyond it its ends."""
        return self._along(levels, 0).round()

    def expanded(self, codes: Tensor) -> Tensor:
        """Levels of codes."""
        return self._along(codes, 1)

    def rounding_variance(self, levels: Tensor) -> Tensor:
        """Of rounding to codes, in levels: slope^2 / 12 of the segment, slope in levels per code."""
        slopes = levels.new_tensor([(b[0] - a[0]) / (b[1] - a[1]) for a, b in pairwise(self.points)])
        return slopes[self._segment(levels, 0)] ** 2 / 12

    def _segment(self, values: Tensor, column: int) -> Tensor:
        inner = values.new_tensor([point[column] for point in self.points[1:-1]])
        return torch.searchsorted(inner, values.contiguous(), right=True)

    def _along(self, values: Tensor, column: int) -> Tensor:
        known, sought = values.new_tensor(self.points).T[[column, 1 - column]]
        values = values.clamp(known[0], known[-1])
        at = self._segment(values, column)
        along: Tensor = sought[at] + (sought.diff() / known.diff())[at] * (values - known[at])
        return along
