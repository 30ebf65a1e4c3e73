"""Lamps of a plan's pictures: targets that are brighter than the picture has them, and pulsed lamps (PWM).

Domain: light as a multiple of the picture's; Hz; phases in periods, as :mod:`blurnoise.light.lamp` has them.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from blurnoise._core.checks import in_range
from blurnoise.light.lamp import Pwm
from blurnoise_eval.plan.axes import numbers

TARGETS = "targets"
"""The targets of every picture: the place of lamps, as scenes have a mask's file."""
RANDOM = "random"


@dataclass(frozen=True)
class Lamps:
    """Lamps of every picture, in the words of a plan's file. Raises ``ValueError`` naming the setting.

    emitters: "targets:FACTOR", so many times brighter. pwm: "HZ,DUTY[,PHASE]". pwm_mask: "targets" for pulses that
    light these alone; None: they light the whole scene. pwm_phase: where in its period the lamp is when an exposure
    begins, a value for each repeat in turn; none: at random, by the seed of the cell, as scenes have it.
    """

    emitters: str | None = None
    pwm: str | None = None
    pwm_mask: str | None = None
    pwm_phase: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "pwm_phase", tuple(self.pwm_phase))
        if self.emitters is not None and emitters_of(self.emitters)[0] != TARGETS:
            raise ValueError(f"emitters = {self.emitters!r}: must be {TARGETS}:FACTOR in a plan")
        if self.pwm_mask not in (None, TARGETS):
            raise ValueError(f"pwm_mask = {self.pwm_mask!r}: must be {TARGETS} in a plan, or left out")
        for phase in self.pwm_phase:
            in_range("pwm_phase", phase, 0.0, 1.0)
        if self.pwm is None and (self.pwm_mask or self.pwm_phase):
            raise ValueError(f"{'pwm_mask' if self.pwm_mask else 'pwm_phase'}: needs pwm")
        _ = self.phases

    @cached_property
    def factor(self) -> float:
        """By which targets are brighter than in the picture."""
        return 1.0 if self.emitters is None else emitters_of(self.emitters)[1]

    @cached_property
    def phases(self) -> tuple[float, ...]:
        """Those of the repeats in turn; none where they are random."""
        if self.pwm is None:
            return ()
        lamp, stated = pwm_of(self.pwm)
        if stated and self.pwm_phase:
            raise ValueError(f"pwm = {self.pwm!r}: has a phase; must not be combined with pwm_phase")
        return (lamp.phase,) if stated else self.pwm_phase

    @property
    def on_targets(self) -> bool:
        """Whether it needs to know where targets are."""
        return TARGETS in (self.pwm_mask, *(self.emitters or "").split(":"))

    def pulses(self, repeat: int, seed: int) -> Pwm | None:
        """The pulses of a cell; None without."""
        if self.pwm is None:
            return None
        lamp, _ = pwm_of(self.pwm)
        if not self.phases:
            return lamp.with_phase_of(seed)
        return Pwm(lamp.frequency_hz, lamp.duty, self.phases[repeat % len(self.phases)])


def pwm_of(text: str) -> tuple[Pwm, bool]:
    """The lamp of "HZ,DUTY[,PHASE]", and whether it has a phase. Raises ``ValueError`` for another text."""
    try:
        figures = [float(part) for part in text.split(",")]
    except ValueError:
        figures = []
    if len(figures) not in (2, 3):
        raise ValueError(f"pwm = {text!r}: must be HZ,DUTY or HZ,DUTY,PHASE, such as 90,0.1")
    try:
        return Pwm(*figures), len(figures) == 3
    except ValueError as error:
        raise ValueError(f"pwm = {text!r}: {error}") from None


def emitters_of(text: str) -> tuple[str, float]:
    """Place and factor of "WHERE:FACTOR". Raises ``ValueError`` for another text."""
    where, _, factor = text.rpartition(":")
    try:
        times = float(factor)
    except ValueError:
        where = ""
    if not where:
        raise ValueError(f"emitters = {text!r}: must be MASK.png:FACTOR, of a plan {TARGETS}:FACTOR")
    return where, in_range("emitters: factor", times, 0.0, 1e6)


def phases_of(text: object) -> tuple[float, ...]:
    """Phases of a file: "random", none, or numbers as axes have them. Raises ``ValueError``."""
    if text == RANDOM:
        return ()
    try:
        each = text if isinstance(text, list | tuple) else [text]
        return tuple(value for one in each for value in numbers(str(one)))
    except ValueError as error:
        raise ValueError(f"{error}, or {RANDOM}") from None
