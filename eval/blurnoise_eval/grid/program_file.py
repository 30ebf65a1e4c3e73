"""What an exposure program is told: a file, of which the command's options override the parts they name."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

from blurnoise_eval.grid.plan_file import Enough
from blurnoise_eval.grid.settings import setting
from blurnoise_eval.grid.values import bounds

WHAT, LIMITS = "What it is for", "Limits"


@dataclass(frozen=True)
class ProgramFile(Enough):
    """An exposure program: what it is for, what is enough, and the camera's limits."""

    KIND: ClassVar[str] = "exposure program (blurnoise program --plan FILE)"

    model: str | None = setting(None, "of the run's models (default: its only one)", "NAME", panel=WHAT)
    lux: str | None = setting(
        None,
        "lights, half a stop apart (default: what the run was asked)",
        "LOW:HIGH",
        panel=WHAT,
        check=bounds,
    )
    speeds: str | None = setting(
        None,
        "speeds, px/s, and how often each is met (default: the run's, alike); 'blurnoise motion' gives px/s of km/h",
        "V:SHARE,...",
        panel=WHAT,
    )
    targets: str | None = setting(
        None, "WORD:SHARE,...: kinds of target, by part of their name (default: all, alike)"
    )
    objective: Literal["expected", "worst", "tail"] = setting(
        "expected",
        "over speeds and targets: their mean (expected), the worst, or the mean of the worst share (tail)",
        "expected|worst|tail",
        panel=WHAT,
    )
    tail: float = setting(0.2, "share of the cases, for the objective tail")
    fps: float = setting(
        30.0, "frames a second: an exposure ends before the next frame (default: 30)", "N", panel=LIMITS
    )
    readout_ms: float = setting(
        0.0, "that each frame's read-out takes of it (default: 0)", "MS", panel=LIMITS
    )
    anti_flicker: Literal["50", "60"] | None = setting(
        None, "Hz of the mains: whole periods of its light alone", "50|60", panel=LIMITS
    )
    led: bool = setting(False, "1/90 s or more, so that no pulse of an LED is missed")
    most_gain_db: float = setting(120.0, "largest gain, where that is less than the camera's")
    line_time_us: float = setting(0.0, "exposures are whole lines of the sensor")
    least_exposure_us: float | None = setting(
        None, "the sensor's shortest exposure (default: its line time; global shutters 20)"
    )
