"""Limits of an exposure program: what frame rate, mains, lamps and gain leave of exposure times.

Domain: seconds, dB. Mains light flickers at twice its frequency; an exposure of whole periods, 1/100 or 1/120 s, sees
none of it. A lamp or sign of LEDs looks steady when it pulses at 90 Hz or more (Deegan, Electronic Imaging 2018,
AVM-146), so an exposure of 1/90 s always holds one of its pulses.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

from blurnoise._core.checks import in_range
from blurnoise.optics.camera import Camera
from blurnoise.scene.metering import AutoExposure

LED_S = 1 / 90
PREGIUS_LEAST_S = 20e-6
"""Shortest exposure of Sony's first Pregius sensors: a line and 13.73 us, 18.8 to 20 us with an IMX250 (Teledyne
DALSA, Genie Nano manual, M2450)."""
STEPS_PER_STOP = 8
_STEP = 1e-9


def least_exposure_s(camera: Camera) -> float:
    """A camera's shortest exposure: one line where lines follow each other, else :data:`PREGIUS_LEAST_S`."""
    return camera.row_time_s or PREGIUS_LEAST_S


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
        longest_s = self.rule.limit_s  # which looks at the fields
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

    @cached_property
    def shortest_s(self) -> float:
        """The shortest exposure that the rules allow; 0: any."""
        period_s = 1 / (2 * self.mains_hz) if self.mains_hz else 0.0
        least = max(0.0 if self.banding else period_s, LED_S if self.led else 0.0)
        least = max(least, self.line_time_s, self.least_exposure_s)
        if period_s and least >= period_s:
            return math.ceil(least / period_s - _STEP) * period_s
        if self.line_time_s:
            return math.ceil(least / self.line_time_s - _STEP) * self.line_time_s
        return least

    def settled(self, exposure_s: float) -> float:
        """The longest allowed exposure that is not longer; the shortest there is, if all are."""
        return self.rule.allowed_s(max(exposure_s, self.shortest_s))

    def candidates(self, low_s: float, high_s: float) -> tuple[float, ...]:
        """Allowed exposures from low to high, 1/8 stop apart or as far as the rules put them; rising."""
        longest = min(high_s, self.rule.limit_s)
        first = max(low_s, self.shortest_s)
        if first > longest * (1 + _STEP):
            return ()
        steps = math.ceil(STEPS_PER_STOP * math.log2(longest / first) - _STEP) if longest > first else 0
        times = {self.settled(min(longest, first * 2 ** (k / STEPS_PER_STOP))) for k in range(steps + 1)}
        if self.mains_hz:
            period_s = 1 / (2 * self.mains_hz)
            times |= {
                self.settled(n * period_s) for n in range(1, math.floor(longest / period_s + _STEP) + 1)
            }
        return tuple(sorted(time for time in times if low_s * (1 - _STEP) <= time <= longest * (1 + _STEP)))

    @property
    def words(self) -> list[str]:
        """The limits in words, those that hold."""
        said = [f"{self.fps:g} frames/s" + (f" less {1e3 * self.readout_s:g} ms" if self.readout_s else "")]
        if self.mains_hz:
            below = ", banding below one period" if self.banding else ""
            said.append(f"whole periods of {self.mains_hz:g} Hz mains{below}")
        if self.led:
            said.append("LEDs: 1/90 s or more")
        if self.most_gain_db < 120:
            said.append(f"gain up to {self.most_gain_db:g} dB")
        if self.least_exposure_s > self.line_time_s:
            said.append(f"exposures from {1e6 * self.least_exposure_s:.4g} us on")
        if self.line_time_s:
            said.append(f"whole lines of {1e6 * self.line_time_s:g} us")
        return said

    @property
    def _why_long(self) -> str:
        if self.mains_hz and not self.banding:
            return f"anti-flicker {self.mains_hz:g} Hz" + (" and led" if self.led else "")
        if self.led:
            return "led"
        return "line time" if self.line_time_s >= self.least_exposure_s else "least exposure"
