"""Pulsed lamps (PWM), whose light in an exposure depends on the phase: flicker.

Domain: Hz, s; duty D is the share of a period 1/f in which the lamp is on; phase in periods, [0, 1): how far into its
period, which begins with the pulse, the lamp is when the first capture begins. The light factor of an exposure is
s / D, s being the share of the exposure in which the lamp is on: over random phase its mean is 1 for any exposure, so
that illuminance stays the average. Probabilities are over random phase. IEEE Std 2020 has metrics of such flicker.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import torch
from annotated_types import Ge, Gt, Le
from torch import Tensor

from blurnoise._core import rng
from blurnoise._core.checks import integer, limited, limited_per_image, real_tensor, shown
from blurnoise._core.fields import Figure, check_fields, within

_MOMENT = 1e-9  # of a period: a shorter exposure is at once


@dataclass(frozen=True)
class Pwm:
    """A lamp's pulses. Raises ``TypeError`` or ``ValueError`` naming the field and what is allowed.

    >>> from blurnoise import Pwm
    >>> sign = Pwm(frequency_hz=90.0, duty=0.1, phase=0.5)
    >>> sign.factor(0.001).item(), round(sign.dark_probability(0.001), 2)  # dark now, and in 81 % of exposures
    (0.0, 0.81)
    """

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

        >>> Pwm(90.0, 0.1).factor(0.001).item()  # lit throughout: ten times its mean light
        10.0
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
        """Smallest and largest light factor of an exposure: it begins at the end of a pulse, or at its start.

        >>> Pwm(90.0, 0.25).extremes(0.0)  # an instant is dark, or has four times the mean light
        (0.0, 4.0)
        """
        periods = self.frequency_hz * exposure_s
        if periods < _MOMENT:
            return float(self.duty == 1), 1 / self.duty
        whole = (
            math.floor(periods) * self.duty
        )  # lit periods among whole ones; the rest may lie in a pulse or beside
        rest = periods % 1
        lit = max(0.0, rest - (1 - self.duty)), min(rest, self.duty)
        least, most = ((whole + periods_lit) / periods / self.duty for periods_lit in lit)
        return least, most

    def dark_probability(self, exposure_s: float) -> float:
        """Probability that an exposure receives no light: max(0, 1 - f T - D).

        >>> round(Pwm(90.0, 0.1).dark_probability(0.005), 2)
        0.45
        """
        exposure = limited("exposure_s", exposure_s)
        return max(0.0, 1 - self.frequency_hz * exposure - self.duty)

    def _on_periods(self, periods: Tensor) -> Tensor:
        """Lit periods within the given number of periods since a pulse began."""
        whole = periods.floor()
        return whole * self.duty + (periods - whole).clamp(max=self.duty)


def per_picture(lamp: Pwm | Sequence[Pwm | None] | None, batch: int) -> tuple[Pwm | None, ...]:
    """A lamp or None for each picture of a batch; () if all are None. Raises ``TypeError`` or ``ValueError``.

    >>> per_picture([Pwm(90.0, 0.1), None], 2)[1] is None, per_picture(None, 2)
    (True, ())
    """
    if lamp is None:
        return ()
    lamps = (lamp,) * batch if isinstance(lamp, Pwm) else lamp
    if not isinstance(lamps, Sequence) or not all(isinstance(one, Pwm | None) for one in lamps):
        raise TypeError(f"lamp = {shown(lamp)}: must be a Pwm, or a sequence of one or None for each picture")
    if len(lamps) != batch:
        raise ValueError(f"lamp: got {len(lamps)} for a batch of {batch}; must be one per picture")
    return tuple(lamps) if any(lamps) else ()
