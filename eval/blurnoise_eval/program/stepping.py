"""A camera's own metering, stepped through a file of an exposure program: what it reaches at each light.

Domain: s, lux; gains as factors >= 1. Source: libcamera 0.7.1 of Raspberry Pi, src/ipa/rpi/controller/rpi/
agc_channel.cpp, ``AgcChannel::divideUpExposure``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from blurnoise_eval.program.problem import Problem, Schedule

_STEP = 1e-9  # of a count of periods: a time that is whole but for rounding stays whole


@dataclass(frozen=True)
class LibcameraMode:
    """An entry of "exposure_modes" as libcamera uses it: shutter in us, gain, and the period of ``AeFlickerPeriod``
    in us, 0 without flicker avoidance.

    Raises ``ValueError`` for what libcamera refuses: lists of different lengths, or of fewer than two entries
    (``AgcExposureMode::read``).

    >>> mode = LibcameraMode((20, 30000), (1.0, 8.0), period_us=10000)
    >>> mode.divided(0.005), mode.divided(0.025)  # below one period a time stays; above, the gain makes up for it
    ((0.005, 1.0), (0.02, 1.25))
    """

    shutter_us: tuple[float, ...]
    gains: tuple[float, ...]
    period_us: float = 0.0

    def __post_init__(self) -> None:
        if len(self.shutter_us) != len(self.gains) or len(self.gains) < 2:
            raise ValueError(
                f"exposure mode: {len(self.shutter_us)} shutters and {len(self.gains)} gains: must be as many of "
                "both, two or more"
            )

    @classmethod
    def read(cls, mode: Mapping[str, Sequence[float]], mains_hz: float = 0.0) -> LibcameraMode:
        """The mode of an entry {"shutter": [...], "gain": [...]}. mains_hz: 0, 50 or 60.

        >>> LibcameraMode.read({"shutter": [20, 33000], "gain": [1.0, 8.0]}, mains_hz=50.0).period_us
        10000.0
        """
        # the control is a whole number of us: 8333 for 60 Hz
        period_us = float(round(1e6 / (2 * mains_hz))) if mains_hz else 0.0
        return cls(tuple(mode["shutter"]), tuple(mode["gain"]), period_us)

    def divided(self, total_s: float) -> tuple[float, float]:
        """Time, s, and gain for a total exposure (time x gain).

        It starts at the first shutter with the first gain and never goes below them. At each further stage the time
        rises first, then the gain; at the last stage both stay. Whole periods are cut last.
        """
        total_us = 1e6 * total_s
        time, gain = self.shutter_us[0], self.gains[0]
        for next_time, next_gain in zip(self.shutter_us[1:], self.gains[1:], strict=True):
            if time * gain >= total_us:
                break
            if next_time * gain >= total_us:
                time = total_us / gain
                break
            time = next_time
            if next_gain * time >= total_us:
                gain = total_us / time
                break
            gain = next_gain
        periods = int(time / self.period_us + _STEP) if self.period_us else 0
        if periods:
            gain *= time / (periods * self.period_us)
            time = periods * self.period_us
        return time / 1e6, gain


def stepped(problem: Problem, mode: Mapping[str, Any]) -> Schedule:
    """What libcamera reaches with this mode at each of the scenario's lights, as the problem's meter asks for."""
    read = LibcameraMode.read(mode, problem.limits.mains_hz)
    return problem.schedule([read.divided(total_s)[0] for total_s in problem.totals_s])
