"""Limits of an exposure program: what frame rate, mains, lamps and gain leave of exposure times; and the gain that
the camera sets, by the mean light of the run's pictures.

Domain: lux, seconds, dB. Mains light flickers at twice its frequency; an exposure of whole periods, 1/100 or 1/120 s,
sees none of it. A lamp or sign of LEDs looks steady when it pulses at 90 Hz or more (Deegan, Electronic Imaging 2018,
AVM-146), so an exposure of 1/90 s always holds one of its pulses.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any

import numpy as np
from annotated_types import Ge, Le

from blurnoise._core.checks import Figure
from blurnoise.optics.camera import Camera
from blurnoise.scene.metering import USUAL, AutoExposure, Setting

LED_S = 1 / 90
PREGIUS_LEAST_S = 20e-6
"""Shortest exposure of Sony's first Pregius sensors: a line and 13.73 us, 18.8 to 20 us with an IMX250 (Teledyne
DALSA, Genie Nano manual, M2450)."""
STEPS_PER_STOP = 8
_UNHURRIED = AutoExposure(USUAL.target, frame_rate_hz=1 / 3600)
_TOLD_DB = 0.01  # from a limit of the gain, from which on it depends on the picture's light
_STEP = 1e-9


@dataclass(frozen=True)
class Limits(AutoExposure):
    """What a program may use: the camera's own limits, and those of the lamps and the sensor.

    led: at least 1/90 s. least_exposure_s: the sensor's shortest. Raises ``ValueError`` naming the field, or the rules
    that leave nothing.
    """

    led: bool = False
    least_exposure_s: Annotated[Figure, Ge(1e-7), Le(1)] = PREGIUS_LEAST_S

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.shortest_s > self.limit_s * (1 + _STEP):
            raise ValueError(
                f"{', '.join(self.words)}: leave no exposure at any light: it must be "
                f"{1e3 * self.shortest_s:.4g} ms or more, and the frame leaves {1e3 * self.limit_s:.4g} ms"
            )

    @property
    def _period_s(self) -> float:
        return 1 / (2 * self.mains_hz) if self.mains_hz else 0.0

    @cached_property
    def shortest_s(self) -> float:
        """The shortest exposure that the rules allow."""
        least = max(self._period_s, LED_S if self.led else 0.0, self.row_time_s, self.least_exposure_s)
        unit_s = self._period_s or self.row_time_s
        return math.ceil(least / unit_s - _STEP) * unit_s if unit_s else least

    def settled(self, exposure_s: float) -> float:
        """The longest allowed exposure that is not longer; the shortest there is, if all are."""
        return self.allowed_s(max(exposure_s, self.shortest_s))

    def candidates(self, low_s: float, high_s: float) -> tuple[float, ...]:
        """Allowed exposures from low to high, 1/8 stop apart or as far as the rules put them; rising."""
        longest, first = min(high_s, self.limit_s), max(low_s, self.shortest_s)
        if first > longest * (1 + _STEP):
            return ()
        steps = math.ceil(STEPS_PER_STOP * math.log2(longest / first) - _STEP) if longest > first else 0
        asked = [min(longest, first * 2 ** (k / STEPS_PER_STOP)) for k in range(steps + 1)]
        if period_s := self._period_s:
            asked += [n * period_s for n in range(1, math.floor(longest / period_s + _STEP) + 1)]
        times = sorted(set(map(self.settled, asked)))
        return tuple(time for time in times if low_s * (1 - _STEP) <= time <= longest * (1 + _STEP))

    @property
    def words(self) -> list[str]:
        """The limits that hold, in words."""
        less = f" less {1e3 * self.readout_s:g} ms" if self.readout_s else ""
        from_us = 1e6 * self.least_exposure_s
        holding = {
            f"{self.frame_rate_hz:g} frames/s{less}": True,
            f"whole periods of {self.mains_hz:g} Hz mains": self.mains_hz > 0,
            "LEDs: 1/90 s or more": self.led,
            f"gain up to {self.gain_max_db:g} dB": self.gain_max_db < 120,
            f"exposures from {from_us:.4g} us on": self.least_exposure_s > self.row_time_s,
            f"whole lines of {1e6 * self.row_time_s:g} us": self.row_time_s > 0,
        }
        return [words for words, holds in holding.items() if holds]


@dataclass(frozen=True)
class Metering:
    """The rule of :mod:`blurnoise.scene.metering` for one camera and pictures of one ``mean_light``, a share of
    white."""

    camera: Camera
    mean_light: float
    temperature_c: float = 25.0

    def _setting(self, rule: AutoExposure, lux: float, exposure_s: float | None = None) -> Setting:
        at = {"mean_light": self.mean_light, "illuminance_lux": lux, "temperature_c": self.temperature_c}
        return rule.setting(self.camera, exposure_s=exposure_s, **at)

    def total_s(self, illuminance_lux: float) -> float:
        """Exposure times gain that the meter asks for: the exposure that needs no gain; an hour at most."""
        return self._setting(_UNHURRIED, illuminance_lux).exposure_s

    def gain_db(self, illuminance_lux: float, exposure_s: float) -> float:
        """As the camera sets it, from 0 dB to its most."""
        return self._setting(USUAL, illuminance_lux, exposure_s).gain_db

    def lacks_gain(self, illuminance_lux: float, exposure_s: float) -> bool:
        """Whether the picture is darker than the meter asks for, at the camera's most gain."""
        factor = 10 ** (self.camera.gain_max_db / 20)
        return self.total_s(illuminance_lux) > factor * exposure_s * (1 + 1e-9)


def mean_light(gains: Iterable[Mapping[str, Any]], camera: Camera) -> float | None:
    """Mean over pictures of their mean light, by their gains; None where all gains are at a limit.

    gains: rows of ``image``, ``illuminance_lux``, ``exposure_s`` and ``applied_gain_db``, set by the camera for each
    picture. Dark charge counts for none.
    """
    white = Metering(camera, 1.0).total_s(1.0)  # lux s
    of: dict[str, list[float]] = {}
    for row in gains:
        gain_db = row["applied_gain_db"]
        if _TOLD_DB < gain_db < camera.gain_max_db - _TOLD_DB:
            total = row["illuminance_lux"] * row["exposure_s"] * 10 ** (gain_db / 20)
            of.setdefault(row["image"], []).append(math.log(white / total))
    return float(np.mean([math.exp(float(np.median(logs))) for logs in of.values()])) if of else None
