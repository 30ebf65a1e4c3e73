"""Flicker: lamps dimmed by pulses (PWM), whose light in an exposure depends on the phase.

Domain: Hz, s; duty D is the share of a period 1/f in which the lamp is on; phase in periods, [0, 1): how far into its
period, which begins with the pulse, the lamp is when the first capture begins. The light factor of an exposure is
s / D, s being the share of the exposure in which the lamp is on: over random phase its mean is 1 for any exposure, so
that illuminance stays the average. Probabilities are over random phase. IEEE Std 2020 has metrics of such flicker.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

import torch
from annotated_types import Ge, Gt, Le
from torch import Tensor

from blurnoise._core import rng
from blurnoise._core.checks import (
    Figure,
    check_fields,
    integer,
    limited,
    limited_per_image,
    real_tensor,
    within,
)

_MOMENT = 1e-9  # of a period: a shorter exposure is at once


@dataclass(frozen=True)
class Pwm:
    """A lamp's pulses. Raises ``TypeError`` or ``ValueError`` naming the field and what is allowed."""

    frequency_hz: Annotated[Figure, within("frequency_hz")]
    duty: Annotated[Figure, Gt(0), Le(1)]
    phase: Annotated[Figure, Ge(0), Le(1)] = 0.0

    def __post_init__(self) -> None:
        check_fields(self)

    def with_phase_of(self, seed: int) -> Pwm:
        """The lamp at a random phase, from a random stream of its own."""
        integer("seed", seed, 0, rng.LAST_SEED)
        return replace(self, phase=rng.derived(seed, "pwm phase") / 2.0**63)

    def factor(self, exposure_s: Tensor | float, start_s: Tensor | float = 0.0) -> Tensor:
        """Factors on the lamp's light in exposures that begin at ``start_s``; float64, mean 1.

        Both of any shapes that broadcast. Raises ``TypeError`` or ``ValueError`` naming the argument.
        """
        given = exposure_s if isinstance(exposure_s, Tensor) else limited("exposure_s", exposure_s)
        starts, lasting = real_tensor("start_s", start_s), real_tensor("exposure_s", given)
        like = starts.new_empty(0, dtype=torch.float64)
        exposure = limited_per_image("exposure_s", lasting.flatten(), lasting.numel(), like)
        first = self.phase + self.frequency_hz * starts.double()
        periods = self.frequency_hz * exposure.view(lasting.shape)
        if self.duty == 1:
            return torch.ones_like(first + periods)
        at_once = (first % 1 < self.duty).double() / self.duty
        lit = self._on_periods(first + periods) - self._on_periods(first)
        return torch.where(periods < _MOMENT, at_once, lit / periods.clamp_min(_MOMENT) / self.duty)

    def extremes(self, exposure_s: float) -> tuple[float, float]:
        """Smallest and largest light factor of an exposure: it begins at the end of a pulse, or at its start."""
        least, most = (float(replace(self, phase=phase).factor(exposure_s)) for phase in (self.duty, 0.0))
        return least, most

    def dark_probability(self, exposure_s: float) -> float:
        """Probability that an exposure receives no light: max(0, 1 - f T - D)."""
        exposure = limited("exposure_s", exposure_s)
        return max(0.0, 1 - self.frequency_hz * exposure - self.duty)

    def _on_periods(self, periods: Tensor) -> Tensor:
        """Lit periods within the given number of periods since a pulse began."""
        whole = periods.floor()
        return whole * self.duty + (periods - whole).clamp(max=self.duty)


@dataclass(frozen=True)
class Flicker:
    """A pulsed lamp that lights the scene, or is part of it, within ``mask`` (H, W).

    mask: share of the light that comes from the lamp, 0 to 1; None: all of it.
    """

    pwm: Pwm
    mask: Tensor | None = None

    def factors(
        self, size: tuple[int, int], exposure_s: Tensor | float, start_s: Tensor | float = 0.0
    ) -> Tensor:
        """Factors (H, W) or (H, 1) on the light of a picture (H, W), whose exposure starts ``start_s`` after phase.

        exposure_s, start_s: one for all or one for each row, (H,). Raises ``TypeError`` or ``ValueError`` naming the
        argument.
        """
        rows = self.pwm.factor(exposure_s, start_s).expand(size[0])[:, None]
        if self.mask is None:
            return rows
        mask = real_tensor("mask", self.mask)
        if mask.shape != size:
            raise ValueError(f"mask: shape is {tuple(mask.shape)}; must be the picture's, {size}")
        if not bool(((mask >= 0) & (mask <= 1)).all()):
            raise ValueError("mask: must lie within [0, 1]")
        return 1 + mask * (rows.to(mask) - 1)
