"""The making of an exposure program: solved, put into few stages, and compared with what else a camera may do.

Domain: lux, s, dB; values in the criterion's unit, means over the scenario's lights.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.grid.axes import milliseconds
from blurnoise_eval.program.limits import STEPS_PER_STOP, Limits
from blurnoise_eval.program.metering import Metering
from blurnoise_eval.program.response import Response
from blurnoise_eval.program.solving import solve
from blurnoise_eval.program.stages import STOCK, Staged, Stages, best_stages
from blurnoise_eval.scoring import certainty
from blurnoise_eval.scoring.recommendation import best_exposure

Array = NDArray[np.float64]
ENOUGH = 0.002
"""That few stages may lose against many."""
GAIN_COSTS = ENOUGH / 6.0
"""What a decibel of gain has to earn, so that of exposures that do alike the longer one, with less gain, is used."""
EARLY_GAIN_DB = 36.0
"""The most gain while a longer exposure is allowed: 16 of the sensor, the most in the modes that libcamera has for
its cameras, times 4, the most that it adds digitally (``AgcChannel::prepare``)."""


class Course(NamedTuple):
    """What a program does over the scenario's lights, (L,) each: exposure, gain, whether the gain's limit is reached,
    the objective there, None where it was not tested; the least mean of a speed over the lights, and of a light."""

    exposures_s: tuple[float, ...]
    gains_db: tuple[float, ...]
    lacks_gain: tuple[bool, ...]
    values: tuple[float | None, ...]
    value: float | None
    worst_speed: float | None
    worst_light: float | None


class Rival(NamedTuple):
    """What else a camera may do; without a course, why not."""

    name: str
    course: Course | None
    reason: str = ""


@dataclass(frozen=True)
class Program:
    """Stages and their course over the scenario's lights; tested_s: the shortest exposure that was tested, below
    which the first stage is extrapolated; best: the course without stages. low, high: the 95 %
    interval of its value; regret_95: what it loses at most at 95 % against any other exposures; None from few
    pictures."""

    stages: Stages
    tested_s: float
    course: Course
    best: Course
    best_fixed_s: float | None
    rivals: tuple[Rival, ...]
    low: float | None
    high: float | None
    regret_95: float | None
    pictures: int

    def extrapolates(self, exposure_s: float) -> bool:
        """Whether an exposure is shorter than what was tested."""
        return exposure_s < self.tested_s * (1 - 1e-9)


def make(
    response: Response,
    metering: Metering,
    limits: Limits,
    stages: int | None = None,
    fixed_s: float | None = None,
) -> Program:
    """The program. stages: their number; None: as few as lose less than ``ENOUGH``.

    fixed_s: the best fixed time; where it is None or not allowed, it is found by the rule of
    :mod:`~blurnoise_eval.scoring.recommendation`.

    Raises ``ValueError`` that names the rule and the light, or the speed and what was tested, where nothing is left.
    """
    lights = response.scenario.lights_lux
    times = _candidates(response, limits)
    table = _table(response, metering, limits, times)
    _check_tested(response, limits, times)
    _check_left(response, metering, limits, times, table)
    chosen = solve(table)
    if chosen is None:
        raise ValueError(
            "lux: at less light only shorter exposures are left than at more; a program must not be longer in more "
            "light"
        )
    best = course(response, metering, [times[place] for place in chosen])
    tested_s = [time for time, column in zip(times, table.T, strict=True) if np.isfinite(column).any()]
    tested = _staged(response, metering, limits, (tested_s[0], tested_s[-1]), stages, best.value or 0.0)
    found = tested.starting_at(limits.shortest_s)
    taken = [_taken(found, metering, limits, light) for light in lights]
    ours = course(response, metering, taken)
    _check_known(response, ours)
    low, high = _interval(response, ours)
    if fixed_s is None or not np.isclose(limits.settled(fixed_s), fixed_s, rtol=1e-9):
        place = best_exposure(times, np.mean(table, axis=0))
        fixed_s = None if place is None else times[place]
    return Program(
        stages=found,
        tested_s=tested.times_s[0],
        course=ours,
        best=best,
        best_fixed_s=fixed_s,
        rivals=tuple(_rivals(response, metering, limits, fixed_s)),
        low=low,
        high=high,
        regret_95=_regret(response, ours, times, table),
        pictures=len(response.clusters),
    )


def course(response: Response, metering: Metering, exposures_s: Sequence[float]) -> Course:
    """What these exposures do, one at each light of the scenario, with the camera's gain."""
    lights = response.scenario.lights_lux
    cases, values = response.at(lights, exposures_s)
    told = bool(np.isfinite(values).all())
    of_speeds = [
        np.average(
            [cases[k].mean() for k, (each, _) in enumerate(response.scenario.cases) if each == speed],
            weights=list(response.scenario.targets.values()),
        )
        for speed in response.scenario.speeds_px_s
    ]
    return Course(
        exposures_s=tuple(float(exposure) for exposure in exposures_s),
        gains_db=tuple(metering.gain_db(*at) for at in zip(lights, exposures_s, strict=True)),
        lacks_gain=tuple(metering.lacks_gain(*at) for at in zip(lights, exposures_s, strict=True)),
        values=tuple(float(value) if np.isfinite(value) else None for value in values),
        value=float(values.mean()) if told else None,
        worst_speed=float(min(of_speeds)) if told else None,
        worst_light=float(values.min()) if told else None,
    )


def _candidates(response: Response, limits: Limits) -> tuple[float, ...]:
    """Allowed exposures that were tested at some light. Raises ``ValueError`` where there is none."""
    low_s, high_s = response.exposures_s
    times = limits.candidates(low_s, high_s)
    if not times:
        raise ValueError(
            f"{', '.join(limits.words)}: leave no exposure at any light that was tested; "
            f"the run tells of {response.range_text}"
        )
    return times


def _table(response: Response, metering: Metering, limits: Limits, times_s: Sequence[float]) -> Array:
    """(L, S) of the objective, NaN where it was not tested or the gain is not allowed."""
    lights = response.scenario.lights_lux
    at_lights, at_times = np.repeat(lights, len(times_s)), np.tile(times_s, len(lights))
    values = response.at(at_lights, at_times).objective.reshape(len(lights), len(times_s))
    return np.where(_gain_allowed(metering, limits, lights, times_s), values, np.nan)


def _gain_allowed(
    metering: Metering, limits: Limits, lights_lux: Sequence[float], times_s: Sequence[float]
) -> NDArray[np.bool_]:
    most = limits.most_gain_db + 1e-9
    return np.array([[metering.gain_db(light, time) <= most for time in times_s] for light in lights_lux])


def _check_tested(response: Response, limits: Limits, times_s: Sequence[float]) -> None:
    """Refuse what the run has not tested."""
    scenario = response.scenario
    for light in scenario.lights_lux:
        tested = response.tested(np.full(len(times_s), light), times_s)
        for (speed, target), ever in zip(scenario.cases, tested, strict=True):
            if not ever.any():
                raise ValueError(
                    f"lux = {light:g} at {speed:g} px/s ({target}): no allowed exposure was tested there; "
                    f"the run tells of {response.range_text}"
                )
        if not tested.all(axis=0).any():
            raise ValueError(
                f"lux = {light:g}: no allowed exposure was tested at all the speeds; "
                f"the run tells of {response.range_text}"
            )


def _check_left(
    response: Response, metering: Metering, limits: Limits, times_s: Sequence[float], table: Array
) -> None:
    """Refuse rules that leave no exposure at a light."""
    for light, row in zip(response.scenario.lights_lux, table, strict=True):
        if np.isnan(row).all():
            longest = times_s[-1]
            raise ValueError(
                f"most_gain_db = {limits.most_gain_db:g}: leaves no exposure at {light:g} lux: "
                f"the longest allowed, {1e3 * longest:.4g} ms, needs {metering.gain_db(light, longest):.1f} dB"
            )


def _check_known(response: Response, ours: Course) -> None:
    """Refuse lights so bright that the exposures for them are shorter than what the run knows about."""
    known = [value is not None for value in ours.values]
    if not all(known):
        lights, place = response.scenario.lights_lux, known.index(False)
        raise ValueError(
            f"lux = {lights[place]:g}: the exposure there, {milliseconds(ours.exposures_s[place])} ms, is shorter "
            f"than what was tested; the run tells of {response.range_text}"
        )


def _staged(
    response: Response,
    metering: Metering,
    limits: Limits,
    between_s: tuple[float, float],
    wanted: int | None,
    best: float,
) -> Stages:
    """As many stages as wanted, or as few as lose less than ``ENOUGH``, with times between two."""
    lights = response.scenario.lights_lux
    low, high = between_s
    lattice = np.geomspace(low, high, 1 + int(np.ceil(STEPS_PER_STOP * np.log2(high / low) - 1e-9)))
    worth = _table(response, metering, limits, [limits.settled(min(time, high)) for time in lattice])
    totals = [metering.total_s(light) for light in lights]
    most_db = min(limits.most_gain_db, metering.camera.gain_max_db)
    worth -= GAIN_COSTS * np.array([[metering.gain_db(light, time) for time in lattice] for light in lights])
    found: list[Staged] = best_stages(
        worth, totals, lattice.tolist(), 10 ** (most_db / 20), 10 ** (EARLY_GAIN_DB / 20)
    )
    if not found:
        raise ValueError(
            "stages: none stays within what the run tested and the limits allow; "
            f"the run tells of {response.range_text}"
        )
    if wanted is not None:
        return found[min(wanted, len(found)) - 1].stages
    least = min(best * len(lights), found[-1].worth) - ENOUGH * len(lights)
    return next(each.stages for each in found if each.worth >= least)


def _taken(stages: Stages, metering: Metering, limits: Limits, light_lux: float) -> float:
    """The exposure that a camera with these stages takes, whole periods and lines if so limited."""
    return limits.settled(_divided_s(stages, metering, light_lux))


def _interval(response: Response, ours: Course) -> tuple[float | None, float | None]:
    there = response.uncertain(response.scenario.lights_lux, ours.exposures_s)
    if not np.isfinite(there.objective).all():
        return None, None
    mean = there.objective.mean()
    away = there.departures.mean(axis=1)
    highest = min(response.most, max(1.0, float(mean + away.max())))  # as the best that was seen, or all
    ends = certainty.interval(mean, away, within=(0.0, highest))
    open_ = certainty.NORMAL * np.sqrt(max(float(there.open.mean()), 0.0))
    low, high = mean - np.hypot(mean - ends.low, open_), mean + np.hypot(ends.high - mean, open_)
    known = np.isfinite(low) and np.isfinite(high)
    return (max(float(low), 0.0), min(float(high), highest)) if known else (None, None)


def _regret(response: Response, ours: Course, times_s: Sequence[float], table: Array) -> float | None:
    """Mean over the lights of what the course loses at most, each against the best exposure there, paired."""
    if None in ours.values:
        return None
    lights = response.scenario.lights_lux
    asked = [
        (light, [exposure, *(time for time, value in zip(times_s, row, strict=True) if np.isfinite(value))])
        for light, exposure, row in zip(lights, ours.exposures_s, table, strict=True)
    ]
    bounds = []
    for light, times in asked:
        there = response.uncertain([light] * len(times), times)
        gain = there.objective[1:] - there.objective[0]
        away = there.departures[:, 1:] - there.departures[:, [0]]
        sigma = certainty.sigma_of_differences(there.open, 0)[1:]
        bounds.append(float(certainty.regret_bound(away, gain, sigma=sigma)))
    bound = float(np.mean(bounds))
    return bound if np.isfinite(bound) else None


def _rivals(response: Response, metering: Metering, limits: Limits, fixed_s: float | None) -> list[Rival]:
    lights = response.scenario.lights_lux

    def held(name: str, exposure_at: Callable[[float], float]) -> Rival:
        found = course(response, metering, [exposure_at(light) for light in lights])
        if found.value is not None:
            return Rival(name, found)
        return Rival(name, found, "its exposures lie outside what was tested")

    rivals = []
    if fixed_s is None:
        rivals.append(Rival("best fixed time", None, "none was tested at every light"))
    else:
        rivals.append(held("best fixed time", lambda light: fixed_s))
    longest_s = limits.rule.limit_s
    for name, stages in STOCK.items():
        within = name if stages.times_s[-1] <= longest_s else f"{name}, to {milliseconds(longest_s)} ms"
        rivals.append(held(within, partial(_divided_s, stages.no_longer(longest_s), metering)))
    rivals.append(_flicker(response, metering, limits))
    return rivals


def _divided_s(stages: Stages, metering: Metering, light_lux: float) -> float:
    return stages.divided(metering.total_s(light_lux))[0]


def _flicker(response: Response, metering: Metering, limits: Limits) -> Rival:
    """The best exposures with the rule against flicker, or without it where the program obeys it."""
    if limits.mains_hz:
        name, other = "without anti-flicker", replace(limits, mains_hz=0.0, banding=False)
    else:
        name = "whole periods of 50 Hz mains"
        try:
            other = replace(limits, mains_hz=50.0)
        except ValueError:
            return Rival(name, None, "no period fits between the limits")
    times = other.candidates(*response.exposures_s)
    chosen = solve(_table(response, metering, other, times)) if times else None
    if chosen is None:
        return Rival(name, None, "it leaves no exposure that was tested at some light")
    return Rival(name, course(response, metering, [times[place] for place in chosen]))
