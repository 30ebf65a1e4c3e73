"""Lamps of a plan's pictures: targets that emit light, and pulsed lamps (PWM).

Light is a multiple of the picture's; frequencies are in Hz; phases in periods, 0 to 1 (:mod:`blurnoise.light.lamp`).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import BeforeValidator

from blurnoise_eval.plan.settings import Settings, Text, setting
from blurnoise_eval.plan.typed import numbers

if TYPE_CHECKING:
    from blurnoise.light.lamp import Pwm

TARGETS = "targets"
"""The lamps are the targets of every picture; a scene has a mask's file here."""
RANDOM = "random"


def phases_of(given: Any) -> tuple[float, ...]:
    """Phases from "random" (none), or from numbers as axes have them. Raises ``ValueError``."""
    if isinstance(given, str) and given == RANDOM:
        return ()
    try:
        parts = given if isinstance(given, list | tuple) else [given]
        return tuple(value for part in parts for value in numbers(str(part)))
    except ValueError as error:
        raise ValueError(f"{error}, or {RANDOM}") from None


Phases = Annotated[tuple[float, ...], BeforeValidator(phases_of)]


@dataclass(frozen=True)
class Lamps(Settings):
    """Lamps of every picture. Raises ``ValueError`` naming the setting.

    emitters: "targets:FACTOR", so many times brighter. pwm: "HZ,DUTY[,PHASE]". pwm_mask: "targets" for a pulsed lamp
    that lights only these; None: it lights the whole scene. pwm_phase: the phase of the lamp when an exposure begins,
    for each repeat in turn; none: drawn with the seed of the cell.

    >>> lamps = Lamps(pwm="90,0.1", pwm_phase=(0.0, 0.5))
    >>> lamps.pulses(repeat=3, seed=0)
    Pwm(frequency_hz=90.0, duty=0.1, phase=0.5)
    """

    emitters: Text | None = setting(
        None,
        "targets:FACTOR: the targets are lamps, FACTOR times brighter than in the picture",
        "targets:FACTOR",
    )
    pwm: Text | None = setting(None, "a pulsed lamp: frequency in Hz, and duty cycle", "HZ,DUTY")
    pwm_mask: Text | None = setting(
        None, "targets: only the targets are pulsed lamps (default: they light the whole scene)", "targets"
    )
    pwm_phase: Phases = setting(
        (),
        "phase of the lamp when an exposure begins, 0 to 1: random for each picture and repeat (default), or "
        "values for all pictures, over which scores are averaged",
        "random|LIST",
    )

    def __post_init__(self) -> None:
        from blurnoise._core.checks import in_range

        super().__post_init__()
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
        """How many times brighter targets are than in the picture."""
        return 1.0 if self.emitters is None else emitters_of(self.emitters)[1]

    @cached_property
    def phases(self) -> tuple[float, ...]:
        """The phases of the repeats in turn; none where they are random."""
        if self.pwm is None:
            return ()
        lamp, has_phase = pwm_of(self.pwm)
        if has_phase and self.pwm_phase:
            raise ValueError(f"pwm = {self.pwm!r}: has a phase; must not be combined with pwm_phase")
        return (lamp.phase,) if has_phase else self.pwm_phase

    @property
    def on_targets(self) -> bool:
        """Whether the pictures need labelled targets."""
        return TARGETS in (self.pwm_mask, *(self.emitters or "").split(":"))

    def pulses(self, repeat: int, seed: int) -> Pwm | None:
        """The pulsed lamp of a cell; None without one."""
        if self.pwm is None:
            return None
        from blurnoise.light.lamp import Pwm

        lamp, _ = pwm_of(self.pwm)
        if not self.phases:
            return lamp.with_phase_of(seed)
        return Pwm(lamp.frequency_hz, lamp.duty, self.phases[repeat % len(self.phases)])


def pwm_of(text: str) -> tuple[Pwm, bool]:
    """The lamp of "HZ,DUTY[,PHASE]", and whether the text has a phase. Raises ``ValueError``."""
    from blurnoise.light.lamp import Pwm

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
    """The lamps (targets, or a mask's file) and the factor of "WHERE:FACTOR". Raises ``ValueError``."""
    from blurnoise._core.checks import in_range

    where, _, factor = text.rpartition(":")
    try:
        times = float(factor)
    except ValueError:
        where = ""
    if not where:
        raise ValueError(f"emitters = {text!r}: must be MASK.png:FACTOR, of a plan {TARGETS}:FACTOR")
    return where, in_range("emitters: factor", times, 0.0, 1e6)
