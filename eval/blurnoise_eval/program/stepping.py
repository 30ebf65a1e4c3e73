"""A camera's own metering, stepped through an exposure program or under a cap: what it reaches at each light.

Domain: s, lux; gains as factors >= 1; differences in stops. Source: libcamera 0.7.1 of Raspberry Pi, src/ipa/rpi/
controller/rpi/agc_channel.cpp, ``AgcChannel::divideUpExposure``. Under a cap every driver does the same with two
stages: the time rises to the cap, then the gain (sources in :mod:`blurnoise_eval.program.drivers`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from blurnoise.light.lights import each_light
from blurnoise_eval.plan.axes import milliseconds
from blurnoise_eval.program.problem import Problem, Schedule
from blurnoise_eval.program.words import lux_text

_DAYLIGHT_LUX = each_light("daylight")[0].lux
_STEP = 1e-9  # of a count of periods: a time that is whole but for rounding stays whole
_APART_STOPS = 0.1  # that are worth a sentence
_SAME_STOPS = 0.05  # a difference that no picture shows, and the rounding of files to whole us


@dataclass(frozen=True)
class Division:
    """Stages over which metering divides time x gain up, as libcamera's "exposure_modes": shutter in us, gain, and
    the period of the lamps that it avoids, in us, 0 without flicker avoidance.

    Raises ``ValueError`` for what libcamera refuses: lists of different lengths, or of fewer than two entries
    (``AgcExposureMode::read``).

    >>> division = Division((20, 30000), (1.0, 8.0), period_us=10000)
    >>> division.divided(0.005), division.divided(0.025)  # above a period the gain makes up for the rest
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
    def read(
        cls,
        mode: Mapping[str, Sequence[float]],
        mains_hz: float = 0.0,
        gain_limits: tuple[float, float] = (1.0, math.inf),
    ) -> Division:
        """That of an entry {"shutter": [...], "gain": [...]}. mains_hz: 0, 50 or 60. gain_limits: the least and the
        most gain that the camera has, the digital one included (``AgcChannel::limitGain``).

        >>> Division.read({"shutter": [20, 33000], "gain": [1.0, 8.0]}, mains_hz=50.0, gain_limits=(1.0, 4.0))
        Division(shutter_us=(20, 33000), gains=(1.0, 4.0), period_us=10000.0)
        """
        least, most = gain_limits
        gains = tuple(min(max(gain, least), most) for gain in mode["gain"])
        return cls(tuple(mode["shutter"]), gains, period_us(mains_hz))

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


def period_us(mains_hz: float) -> float:
    """The period at which lamps flicker: a whole number of us, as drivers take it, 8333 for 60 Hz; 0 for 0."""
    return float(round(1e6 / (2 * mains_hz))) if mains_hz else 0.0


def stepped(problem: Problem, division: Division) -> Schedule:
    """What metering reaches at each of the scenario's lights, as the problem's meter asks for."""
    return problem.schedule([division.divided(total_s)[0] for total_s in problem.totals_s])


class Reached(NamedTuple):
    """What metering reaches at a light, beside what was promised. stops: of time x gain, above 0 too bright."""

    illuminance_lux: float
    exposure_s: float
    gain: float
    promised_s: float
    stops: float

    @property
    def time_stops(self) -> float:
        """How much longer the time is than the promised one, in stops."""
        return math.log2(self.exposure_s / self.promised_s)


def reached(problem: Problem, division: Division, promised: Callable[[float], float]) -> tuple[Reached, ...]:
    """What metering reaches at each of the scenario's lights and in daylight.

    promised: from the time x gain that the meter asks for to the time, both in s; the gain is the camera's.
    """
    metering, rows = problem.inputs.metering, []
    for lux in dict.fromkeys((*problem.scenario.lights_lux, _brightest_lux(problem))):
        total_s = metering.total_s(lux)
        promised_s = promised(total_s)
        exposure_s, gain = division.divided(total_s)
        gain_db = metering.gain_db(lux, promised_s)
        stops = math.log2(exposure_s / promised_s) + math.log2(gain) - gain_db / (20 * math.log10(2))
        rows.append(Reached(lux, exposure_s, gain, promised_s, stops))
    return tuple(rows)


def apart(rows: Sequence[Reached]) -> str:
    """'6.3 stops too bright at 20000 lux', where brightness, and time beside it, are furthest from what was promised;
    empty within a tenth of a stop."""
    said = []
    row = max(rows, key=lambda row: abs(row.stops))
    if abs(row.stops) >= _APART_STOPS:
        too, gain = "bright" if row.stops > 0 else "dark", ""
        if row.stops < 0:
            gain = f" (gain {20 * math.log10(row.gain):.1f} dB)"
        said.append(f"{abs(row.stops):.1f} stops too {too} at {lux_text(row.illuminance_lux)} lux{gain}")
    # Where the brightness is right, the time may still be wrong: lamps flicker.
    alike = [row for row in rows if abs(row.stops) < _APART_STOPS]
    late = max(alike, key=lambda row: abs(row.time_stops), default=None)
    if late is not None and abs(late.time_stops) >= _APART_STOPS:
        times = f"{milliseconds(late.exposure_s)} ms in place of {milliseconds(late.promised_s)} ms"
        said.append(f"{times} at {lux_text(late.illuminance_lux)} lux")
    return ", and ".join(said)


def beside_promised(drivers: Mapping[str, Sequence[Reached]]) -> str:
    """Where drivers, by name, do not reach what was promised, and how near the others are."""
    alike: dict[str, list[str]] = {}
    most = 0.0
    for name, rows in drivers.items():
        alike.setdefault(how := apart(rows), []).append(name)
        if not how:
            most = max(most, *(abs(stops) for row in rows for stops in (row.stops, row.time_stops)))
    near = f"as promised within {max(most, 0.01):.2f} stops"
    said = "; ".join(f"{', '.join(names)} {how or near}" for how, names in sorted(alike.items()))
    return f"Stepped through light by light, up to daylight: {said}."


def daylight(problem: Problem, shortest_s: float, at: str) -> str:
    """A warning where daylight, or the brightest of the lights, saturates at the shortest time, s; else empty.

    at: what that time is, in words, and where else it counts.
    """
    lux = _brightest_lux(problem)
    stops = math.log2(lux / problem.inputs.metering.lux_at(shortest_s))
    if stops < _SAME_STOPS:
        return ""
    return (
        f"Daylight saturates: {lux_text(lux)} lux are {stops:.1f} stops too bright at {at}. A shorter "
        "least_exposure_us, a smaller aperture or a grey filter mends it."
    )


def _brightest_lux(problem: Problem) -> float:
    return max(_DAYLIGHT_LUX, problem.scenario.lights_lux[-1])
