"""Flicker: lamps dimmed by pulses (PWM), of which an exposure catches a share that depends on when it falls.

Domain: Hz, s; duty D is the share of a period 1/f in which the lamp is on; phase in periods, [0, 1): how far into its
period, which begins with the pulse, the lamp is when the first capture begins. The light factor of an exposure is
s / D, s being the share of the exposure in which the lamp is on: over random phase its mean is 1 for any exposure, so
that illuminance stays the average. Probabilities are over random phase. IEEE Std 2020 has metrics of such flicker.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Annotated

import torch
from annotated_types import Ge, Gt, Le
from torch import Tensor

from blurnoise._core import rng
from blurnoise._core.checks import an_instance, batch_shaped, in_range, integer, real_tensor
from blurnoise._core.limits import limited, within
from blurnoise._core.validation import Figure, check_fields


@dataclass(frozen=True)
class Pwm:
    """A lamp's pulses. Raises ``TypeError`` or ``ValueError`` naming the field and what is allowed."""

    frequency_hz: Annotated[Figure, within("frequency_hz")]
    duty: Annotated[Figure, Gt(0), Le(1)]
    phase: Annotated[Figure, Ge(0), Le(1)] = 0.0

    def __post_init__(self) -> None:
        check_fields(self)

    @property
    def pulse_s(self) -> float:
        """Of one period, the time for which it is on."""
        return self.duty / self.frequency_hz

    def with_phase_of(self, seed: int) -> Pwm:
        """The same lamp at a phase drawn uniformly, by a stream of its own: it moves no other draw."""
        integer("seed", seed, 0, rng.LAST_SEED)
        return replace(self, phase=rng.derived(seed, "pwm phase") / 2.0**63)

    def on_share(self, exposure_s: float, start_s: Tensor | float = 0.0) -> Tensor:
        """Of exposures that begin at ``start_s`` (any shape), the share in which it is on; float64."""
        exposure = in_range("exposure_s", exposure_s, 0.0, 3600.0)
        first = self.phase + self.frequency_hz * real_tensor("start_s", start_s).double()
        if self.duty == 1:
            return torch.ones_like(first)
        periods = self.frequency_hz * exposure
        if periods < 1e-9:  # a moment
            return (first % 1 < self.duty).double()
        return (self._on_periods(first + periods) - self._on_periods(first)) / periods

    def factor(self, exposure_s: float, start_s: Tensor | float = 0.0) -> Tensor:
        """What its light is multiplied by in such exposures: :meth:`on_share` / duty, mean 1."""
        return self.on_share(exposure_s, start_s) / self.duty

    def extremes(self, exposure_s: float) -> tuple[float, float]:
        """The least and the largest light factor that an exposure can have."""
        whole, rest_s = self._divided(exposure_s)
        if whole + rest_s == 0:
            return (0.0 if self.duty < 1 else 1.0), 1 / self.duty
        off_s = 1 / self.frequency_hz - self.pulse_s
        parts = (max(0.0, rest_s - off_s), min(rest_s, self.pulse_s))
        least, most = ((whole * self.pulse_s + part) / (exposure_s * self.duty) for part in parts)
        return least, most

    def dark_probability(self, exposure_s: float) -> float:
        """That an exposure receives nothing: max(0, 1 - f T - D)."""
        exposure = in_range("exposure_s", exposure_s, 0.0, 3600.0)
        return max(0.0, 1 - self.frequency_hz * exposure - self.duty)

    def _divided(self, exposure_s: float) -> tuple[int, float]:
        """Whole periods in an exposure, and what is left."""
        exposure = in_range("exposure_s", exposure_s, 0.0, 3600.0)
        whole = math.floor(self.frequency_hz * exposure + 1e-9)
        return whole, max(0.0, exposure - whole / self.frequency_hz)

    def _on_periods(self, periods: Tensor) -> Tensor:
        """Of so many periods since a pulse began, those in which it was on."""
        whole = periods.floor()
        return whole * self.duty + (periods - whole).clamp(max=self.duty)


def lit(
    light: Tensor,
    pwm: Pwm,
    mask: Tensor | None = None,
    *,
    exposure_s: float,
    start_s: float = 0.0,
    row_time_s: float = 0.0,
) -> Tensor:
    """Light (B, C, H, W) of a scene that the lamp lights, or is, where ``mask`` (H, W) says: 0 not at all, 1 alone.

    None: everywhere. start_s: of the exposure, counted from where the lamp's phase is. row_time_s: by which each row
    begins after the one above it. A lamp that is always on returns ``light`` itself. Raises ``TypeError`` or
    ``ValueError`` naming the argument.
    """
    batch_shaped("light", light)
    an_instance("pwm", pwm, Pwm)
    height, width = light.shape[-2:]
    if mask is not None:
        mask = real_tensor("mask", mask)
        if mask.shape != (height, width):
            raise ValueError(f"mask: shape is {tuple(mask.shape)}; must be the picture's, {(height, width)}")
        if not bool(((mask >= 0) & (mask <= 1)).all()):
            raise ValueError("mask: must lie within [0, 1]")
    begins = limited("start_s", start_s) + limited("row_time_s", row_time_s) * torch.arange(height).double()
    factors = pwm.factor(exposure_s, begins)[:, None].to(light)
    if pwm.duty == 1:
        return light
    return light * (factors if mask is None else 1 + mask.to(light) * (factors - 1))
