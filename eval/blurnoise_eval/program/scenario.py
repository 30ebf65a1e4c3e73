"""The scenario of an exposure program (lights, speeds and targets), the limits of its exposures, and the camera's
metering.

Domain: lux, px/s, s, dB; shares that add up to 1. The value of a program is the mean over the lights; at one light,
the mean over the cases by their shares, where a case is a speed with a kind of target. Mains light flickers at twice
its frequency; an exposure of whole periods, 1/100 or 1/120 s, does not see it. Lamps and signs of LEDs pulse at 90 Hz
or more, so that they look steady (Deegan, Electronic Imaging 2018, AVM-146): an exposure of 1/90 s has a whole pulse.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise, product
from typing import Annotated, Any, Literal, TypeVar, get_args

import numpy as np
from annotated_types import Ge, Le
from numpy.typing import NDArray

from blurnoise._core.checks import in_range, limited, one_of
from blurnoise._core.fields import Figure
from blurnoise.camera import Camera
from blurnoise.camera.spectra import Curve
from blurnoise.light.lights import Light, each_light
from blurnoise.scene.metering import USUAL, AutoExposure
from blurnoise_eval.run.search_space import exposures_on

Objective = Literal["expected", "worst", "tail"]
Array = NDArray[np.float64]
T = TypeVar("T", float, str)
LIGHTS_PER_STOP = 2
LED_S = 1 / 90
PREGIUS_LEAST_S = 20e-6
"""Shortest exposure of Sony's first Pregius sensors: a line and 13.73 us, 18.8 to 20 us with an IMX250 (Teledyne
DALSA, Genie Nano manual, M2450)."""
STEPS_PER_STOP = 8
_NO_FRAME_RATE = AutoExposure(USUAL.target, frame_rate_hz=1 / 3600)
_AT_LIMIT_DB = 0.01  # nearer to a limit of the gain, the gain does not show the picture's light
_ROUNDING = 1e-9  # of quotients of times that are meant to be whole
_SAME = 1e-3  # of a time in whole periods: files have 66.666 ms for 8 periods of 60 Hz mains


@dataclass(frozen=True)
class Scenario:
    """Lights in increasing order, shares of speeds and of targets, and the objective at each light.

    Shares are scaled to add up to 1. objective: "expected", the mean over the cases; "worst", the lowest of them;
    "tail", the mean over the worst share ``tail`` of them (conditional value at risk). speed_unit: px/s, or km/h of a
    camera that drives. Raises ``ValueError`` naming the field.

    >>> Scenario((1.0, 2.0), {0.0: 3, 200.0: 1}, {"car": 1}).speeds_px_s
    {0.0: 0.75, 200.0: 0.25}
    """

    lights_lux: tuple[float, ...]
    speeds_px_s: Mapping[float, float]
    targets: Mapping[str, float]
    objective: Objective = "expected"
    tail: float = 0.2
    speed_unit: str = "px/s"

    def __post_init__(self) -> None:
        one_of("objective", self.objective, get_args(Objective))
        in_range("tail", self.tail, 0.0, 1.0, above=True)
        lights = tuple(limited("illuminance_lux", light) for light in self.lights_lux)
        if not lights or lights[0] <= 0 or any(a >= b for a, b in pairwise(lights)):
            raise ValueError(f"lights_lux = {self.lights_lux!r}: must be above 0 and rise")
        for speed in self.speeds_px_s:
            limited("speeds", speed, "speed_px_s")
        for field, name in (("speeds_px_s", "speeds"), ("targets", "targets")):
            weights = getattr(self, field)
            total = sum(weights.values())
            if any(not 0 <= weight < math.inf for weight in weights.values()) or not 0 < total < math.inf:
                raise ValueError(f"{name} = {dict(weights)!r}: shares must be 0 or more, and one above 0")
            shares = {key: weight / total for key, weight in weights.items() if weight > 0}
            object.__setattr__(self, field, shares)

    @property
    def cases(self) -> list[tuple[float, str]]:
        """Speeds and targets, K pairs."""
        return list(product(self.speeds_px_s, self.targets))

    @property
    def shares(self) -> Array:
        """Shares of the cases, (K,)."""
        return np.outer(list(self.speeds_px_s.values()), list(self.targets.values())).ravel()

    def weights(self, values: Array) -> Array:
        """Weights (K, ...) of the cases' values (K, ...) in the objective, which add up to 1 over the cases.

        NaN where the value of any case is. The lowest values get weight, each up to its share, until the objective's
        share of the cases is used up.
        """
        counted = {"expected": 1.0, "worst": float(self.shares.min()), "tail": self.tail}[self.objective]
        # The worst cases first: they fill the share that counts.
        order = np.argsort(values, axis=0, kind="stable")
        sorted_shares = self.shares[order]
        before = np.cumsum(sorted_shares, axis=0) - sorted_shares
        weights = np.empty_like(sorted_shares)
        used = np.clip(counted - before, 0.0, sorted_shares) / counted
        np.put_along_axis(weights, order, used, axis=0)
        return np.where(np.isnan(values).any(axis=0), np.nan, weights)

    @property
    def text(self) -> str:
        """'0 px/s (0.3), 200 px/s (0.7); large (0.5); medium (0.5); expected'."""
        unit = self.speed_unit
        speeds = ", ".join(f"{speed:.4g} {unit} ({share:.2g})" for speed, share in self.speeds_px_s.items())
        targets = "; ".join(f"{target} ({share:.2g})" for target, share in self.targets.items())
        words = {"worst": "the worst of them", "tail": f"the worst {self.tail:g} of them on average"}
        return f"{speeds}; {targets}; {words.get(self.objective, 'expected')}"


def half_stops(low_lux: float, high_lux: float) -> tuple[float, ...]:
    """Lights from low to high, both included, at most half a stop apart. Raises ``ValueError``.

    >>> [round(lux, 2) for lux in half_stops(1.0, 4.0)]
    [1.0, 1.41, 2.0, 2.83, 4.0]
    """
    if not 0 < limited("illuminance_lux", low_lux) <= limited("illuminance_lux", high_lux):
        raise ValueError(f"lux = {low_lux:g}:{high_lux:g}: must be above 0 and rise")
    return tuple(exposures_on((low_lux, high_lux), LIGHTS_PER_STOP).tolist())


def between_lights(names: str, illuminant: str | Curve, of_run: Sequence[Light] = ()) -> tuple[float, ...]:
    """Lights from the darkest to the brightest of named lights, which are of this spectrum or among the run's.

    Raises ``ValueError``.

    >>> between_lights("street,lit-street", "led-4000")[0]
    1.0
    """
    lights = each_light(names)
    for light in lights:
        if of_run and light not in of_run:
            raise ValueError(f"light = {light.name}: the run has {', '.join(each.name for each in of_run)}")
        if not of_run and light.illuminant != illuminant:
            own = illuminant if isinstance(illuminant, str) else "a spectrum of its own"
            raise ValueError(f"light = {light.name}: has {light.illuminant}; the run has {own}")
    return half_stops(min(light.lux for light in lights), max(light.lux for light in lights))


def speed_shares(text: str) -> dict[float, float]:
    """Shares by speed, px/s; without shares they are equal. Raises ``ValueError``.

    >>> speed_shares("0:0.3,200:0.7"), speed_shares("0,200")
    ({0.0: 0.3, 200.0: 0.7}, {0.0: 1.0, 200.0: 1.0})
    """
    return _shares("speeds", text, lambda word: _number("speeds", word))


def target_shares(text: str, groups: Sequence[str]) -> dict[str, float]:
    """Shares of groups of targets, of which any part of the name is enough.

    Raises ``ValueError`` for a word that is part of no name, or of several.

    >>> target_shares("large:2,small:1", ["car, large", "car, small"])
    {'car, large': 2.0, 'car, small': 1.0}
    """

    def group_of(word: str) -> str:
        matching = [group for group in groups if group == word] or [g for g in groups if word in g]
        if len(matching) != 1:
            raise ValueError(f"targets = {word!r}: must be part of the name of one of: {'; '.join(groups)}")
        return matching[0]

    return _shares("targets", text, group_of)


def _shares(name: str, text: str, key: Callable[[str], T]) -> dict[T, float]:
    parts = [part.strip().partition(":") for part in text.split(",")]
    if len({colon for _, colon, _ in parts}) > 1:
        raise ValueError(f"{name} = {text!r}: must have a share for every entry, or for none")
    shares = {key(word): _number(name, share or "1") for word, _, share in parts}
    if len(shares) < len(parts):
        raise ValueError(f"{name} = {text!r}: must have each entry once, with its whole share")
    return shares


def _number(name: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise ValueError(f"{name} = {text!r}: must be as 0:0.3,200:0.7, or without shares") from None


def _whole(least: float, unit: float) -> float:
    """The smallest multiple of ``unit`` that is ``least`` or more; ``least`` where the unit is 0."""
    return math.ceil(least / unit - _ROUNDING) * unit if unit else least


@dataclass(frozen=True)
class ExposureLimits(AutoExposure):
    """The limits of a program's exposures: those of automatic exposure, of lamps and of the sensor.

    led: exposures of at least 1/90 s. least_exposure_s: the sensor's shortest. In light so bright that the lamps'
    shortest exposure saturates, exposures are shorter: it is daylight, or the lamps flicker whatever one does.
    Raises ``ValueError`` naming the field, or the limits that leave no exposure.

    >>> ExposureLimits(mains_hz=50.0).settled(0.025)
    0.02
    """

    led: bool = False
    least_exposure_s: Annotated[Figure, Ge(1e-7), Le(1)] = PREGIUS_LEAST_S

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.shortest_s > self.limit_s * (1 + _ROUNDING):
            raise ValueError(
                f"{', '.join(self.words)}: leave no exposure at any light: it must be "
                f"{1e3 * self.shortest_s:.4g} ms or more, and the frame leaves {1e3 * self.limit_s:.4g} ms"
            )

    @property
    def _period_s(self) -> float:
        return 1 / (2 * self.mains_hz) if self.mains_hz else 0.0

    @cached_property
    def shortest_s(self) -> float:
        """The shortest exposure that the lamps allow."""
        lamps_s = max(self._period_s, LED_S if self.led else 0.0)
        return _whole(max(lamps_s, self.first_s), self._period_s or self.row_time_s)

    @cached_property
    def first_s(self) -> float:
        """The shortest exposure of the sensor, for light so bright that the lamps' shortest one saturates."""
        return _whole(max(self.row_time_s, self.least_exposure_s), self.row_time_s)

    def settled(self, exposure_s: float) -> float:
        """The longest exposure up to ``exposure_s`` that is in whole periods; below one period it stays, from the
        sensor's shortest on."""
        return self.allowed_s(max(exposure_s, self.first_s))

    def steady(self, exposure_s: float) -> bool:
        """Whether lamps look steady at this exposure: none flickers, and none is without a pulse.

        >>> ExposureLimits(mains_hz=50.0).steady(0.02), ExposureLimits(mains_hz=50.0).steady(0.005)
        (True, False)
        """
        # whole lines of the sensor make whole periods a little shorter
        rounding_s = self.row_time_s + _SAME * exposure_s
        if exposure_s < self.shortest_s - rounding_s:
            return False
        period_s = self._period_s
        return not period_s or abs(exposure_s - round(exposure_s / period_s) * period_s) <= rounding_s

    def avoidable(self, exposure_s: float, total_s: float) -> bool:
        """Whether lamps flicker at this exposure although a longer one would not saturate, in light that asks for
        ``total_s``.

        >>> limits = ExposureLimits(mains_hz=50.0)
        >>> limits.avoidable(0.001, total_s=0.05), limits.avoidable(0.001, total_s=0.001)
        (True, False)
        """
        return total_s >= self.shortest_s * (1 - _ROUNDING) and not self.steady(exposure_s)

    def candidates(self, low_s: float, high_s: float) -> tuple[float, ...]:
        """Allowed exposures from low to high in increasing order, 1/8 stop apart or in whole periods."""
        longest, first = min(high_s, self.limit_s), max(low_s, self.first_s)
        if first > longest * (1 + _ROUNDING):
            return ()
        steps = math.ceil(STEPS_PER_STOP * math.log2(longest / first) - _ROUNDING) if longest > first else 0
        asked = [min(longest, first * 2 ** (k / STEPS_PER_STOP)) for k in range(steps + 1)]
        if period_s := self._period_s:
            asked += [n * period_s for n in range(1, math.floor(longest / period_s + _ROUNDING) + 1)]
        times = sorted(set(map(self.settled, asked)))
        return tuple(time for time in times if low_s * (1 - _ROUNDING) <= time <= longest * (1 + _ROUNDING))

    @property
    def words(self) -> list[str]:
        """The limits that are set, in words."""
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
    """Metering as in :mod:`blurnoise.scene.metering`, for a camera and pictures of a ``mean_light``, a share of
    white.

    >>> metering = Metering(Camera.preset("imx250"), mean_light=0.18)
    >>> round(metering.total_s(100.0) / metering.total_s(200.0), 3)  # half the light asks for twice the time
    2.0
    """

    camera: Camera
    mean_light: float
    temperature_c: float = 25.0
    illuminant: str | Curve = "D55"

    @property
    def _picture(self) -> dict[str, Any]:
        lit = {"mean_light": self.mean_light, "illuminant": self.illuminant}
        return {**lit, "temperature_c": self.temperature_c}

    def total_s(self, illuminance_lux: float) -> float:
        """Exposure times gain that the meter asks for, which is the exposure without gain; at most an hour."""
        return _NO_FRAME_RATE.setting(
            self.camera, illuminance_lux=illuminance_lux, **self._picture
        ).exposure_s

    def lux_at(self, exposure_s: float) -> float:
        """The light at which this exposure needs no gain."""
        return self.total_s(1.0) / exposure_s

    @property
    def pictures(self) -> str:
        """'the pictures have 21.7 % of white on average'."""
        return f"the pictures have {100 * self.mean_light:.1f} % of white on average"

    def gain_db(self, illuminance_lux: float, exposure_s: float) -> float:
        """The gain that the camera sets, from 0 dB to its limit."""
        at: Any = {"illuminance_lux": illuminance_lux, "exposure_s": exposure_s}
        return USUAL.setting(self.camera, **at, **self._picture).gain_db


def mean_light(
    gains: Iterable[tuple[str, float, float, float]], camera: Camera, illuminant: str | Curve = "D55"
) -> float | None:
    """The mean light of a run's pictures, which follows from the gains that the camera set for them; None where all
    gains are at a limit.

    gains: (picture, illuminance in lux, exposure in s, gain in dB). Dark charge is neglected.

    >>> camera = Camera.preset("imx250")
    >>> metering = Metering(camera, mean_light=0.25)
    >>> round(mean_light([("a.png", 10.0, 0.01, metering.gain_db(10.0, 0.01))], camera), 3)
    0.25
    """
    white_lux_s = Metering(camera, 1.0, illuminant=illuminant).total_s(1.0)
    logs_by_image: dict[str, list[float]] = {}
    for image, illuminance_lux, exposure_s, gain_db in gains:
        if _AT_LIMIT_DB < gain_db < camera.sensor.gain_max_db - _AT_LIMIT_DB:
            total = illuminance_lux * exposure_s * 10 ** (gain_db / 20)
            logs_by_image.setdefault(image, []).append(math.log(white_lux_s / total))
    # the median, as other conditions of a picture may saturate or be mostly dark charge
    means = [math.exp(float(np.median(logs))) for logs in logs_by_image.values()]
    return float(np.mean(means)) if means else None
