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
from typing import Any

import numpy as np

from blurnoise._core.checks import in_range
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
class Limits:
    """What a program may use.

    fps, readout_s: at most 1 / fps - readout_s. mains_hz: 50 or 60: whole periods of its light; banding: below one
    period any exposure all the same. led: at least 1/90 s. most_gain_db: in place of the camera's own, if less.
    line_time_s: exposures are whole lines. least_exposure_s: the sensor's shortest.
    Raises ``ValueError`` naming the field, or the rules that leave nothing.
    """

    fps: float = 30.0
    readout_s: float = 0.0
    mains_hz: float = 0.0
    banding: bool = False
    led: bool = False
    most_gain_db: float = 120.0
    line_time_s: float = 0.0
    least_exposure_s: float = PREGIUS_LEAST_S

    def __post_init__(self) -> None:
        if self.banding and not self.mains_hz:
            raise ValueError("banding: says what --anti-flicker may do, and so must stand with it")
        in_range("least_exposure_s", self.least_exposure_s, 1e-7, 1.0)
        longest_s = self.rule.limit_s  # which checks the fields
        if self.shortest_s > longest_s * (1 + _STEP):
            raise ValueError(
                f"{self._why_long}: leaves no exposure at any light: it must be {1e3 * self.shortest_s:.4g} ms or "
                f"more, and {self.fps:g} frames/s less {1e3 * self.readout_s:g} ms of read-out leave "
                f"{1e3 * longest_s:.4g} ms"
            )

    @cached_property
    def rule(self) -> AutoExposure:
        """The camera's own rule under these limits."""
        return AutoExposure(
            frame_rate_hz=self.fps,
            readout_s=self.readout_s,
            mains_hz=self.mains_hz,
            row_time_s=self.line_time_s,
            gain_max_db=self.most_gain_db,
        )

    @property
    def _period_s(self) -> float:
        return 1 / (2 * self.mains_hz) if self.mains_hz else 0.0

    @cached_property
    def shortest_s(self) -> float:
        """The shortest exposure that the rules allow; 0: any."""
        period_s = self._period_s
        least = max(0.0 if self.banding else period_s, LED_S if self.led else 0.0)
        least = max(least, self.line_time_s, self.least_exposure_s)
        unit_s = period_s if period_s and least >= period_s else self.line_time_s
        return math.ceil(least / unit_s - _STEP) * unit_s if unit_s else least

    def settled(self, exposure_s: float) -> float:
        """The longest allowed exposure that is not longer; the shortest there is, if all are."""
        return self.rule.allowed_s(max(exposure_s, self.shortest_s))

    def candidates(self, low_s: float, high_s: float) -> tuple[float, ...]:
        """Allowed exposures from low to high, 1/8 stop apart or as far as the rules put them; rising."""
        longest, first = min(high_s, self.rule.limit_s), max(low_s, self.shortest_s)
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
        below = ", banding below one period" if self.banding else ""
        holding = {
            f"{self.fps:g} frames/s{less}": True,
            f"whole periods of {self.mains_hz:g} Hz mains{below}": self.mains_hz > 0,
            "LEDs: 1/90 s or more": self.led,
            f"gain up to {self.most_gain_db:g} dB": self.most_gain_db < 120,
            f"exposures from {1e6 * self.least_exposure_s:.4g} us on": self.least_exposure_s
            > self.line_time_s,
            f"whole lines of {1e6 * self.line_time_s:g} us": self.line_time_s > 0,
        }
        return [words for words, holds in holding.items() if holds]

    @property
    def _why_long(self) -> str:
        if self.mains_hz and not self.banding:
            return f"anti-flicker {self.mains_hz:g} Hz" + (" and led" if self.led else "")
        if self.led:
            return "led"
        return "line time" if self.line_time_s >= self.least_exposure_s else "least exposure"


@dataclass(frozen=True)
class Metering:
    """The rule of :mod:`blurnoise.scene.metering` for one camera and pictures of one ``mean_light``, a share of
    white."""

    camera: Camera
    mean_light: float
    temperature_c: float = 25.0

    def _setting(self, rule: AutoExposure, lux: float, exposure_s: float | None = None) -> Setting:
        return rule.setting(
            self.camera,
            mean_light=self.mean_light,
            illuminance_lux=lux,
            exposure_s=exposure_s,
            temperature_c=self.temperature_c,
        )

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
