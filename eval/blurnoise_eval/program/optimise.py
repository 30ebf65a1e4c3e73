"""The optimal exposure program: solved, put into few stages, and compared with what else a camera may do.

Domain: lux, s, dB; values in the criterion's unit, means over the scenario's lights.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.answers import uncertainty
from blurnoise_eval.answers.criterion import Criterion
from blurnoise_eval.answers.recommendation import best_exposure
from blurnoise_eval.grid.axes import milliseconds
from blurnoise_eval.program.limits import STEPS_PER_STOP, Limits
from blurnoise_eval.program.metering import Metering
from blurnoise_eval.program.response import Response
from blurnoise_eval.program.stages import STOCK, Staged, Stages, best_stages

Array = NDArray[np.float64]
ENOUGH = 0.002
"""That few stages may lose against many."""
GAIN_COSTS = ENOUGH / 6.0
"""What a decibel of gain has to earn, so that of exposures that do alike the longer one, with less gain, is used."""
EARLY_GAIN_DB = 36.0
"""The most gain while a longer exposure is allowed: 16 of the sensor, the most in the modes that libcamera has for
its cameras, times 4, the most that it adds digitally (``AgcChannel::prepare``)."""


class Schedule(NamedTuple):
    """Exposures and gains over the scenario's lights, (L,) each; lacks_gain: whether the gain's limit is reached;
    values: the objective, None where it was not tested. value: their mean; worst_speed: the least mean of a speed
    over the lights; worst_light: the least of a light."""

    exposures_s: tuple[float, ...]
    gains_db: tuple[float, ...]
    lacks_gain: tuple[bool, ...]
    values: tuple[float | None, ...]
    value: float | None
    worst_speed: float | None
    worst_light: float | None


class Baseline(NamedTuple):
    """What else a camera may do; without a schedule, why not."""

    name: str
    schedule: Schedule | None
    reason: str = ""


@dataclass(frozen=True)
class Problem:
    """What a program is made for: a model's response over a scenario, the camera's metering, and limits."""

    model: str
    criterion: Criterion
    response: Response
    metering: Metering
    limits: Limits

    @property
    def lights_lux(self) -> tuple[float, ...]:
        """The scenario's, (L,)."""
        return self.response.scenario.lights_lux

    @cached_property
    def times_s(self) -> tuple[float, ...]:
        """Allowed exposures that were tested at some light, rising, (S,)."""
        return self.limits.candidates(*self.response.exposures_s)

    def objective(self, times_s: Sequence[float]) -> Array:
        """(L, S) of these exposures, NaN where it was not tested or the gain is not allowed."""
        shape = len(self.lights_lux), len(times_s)
        values = self.response.at(np.repeat(self.lights_lux, shape[1]), np.tile(times_s, shape[0])).objective
        allowed = self.gains_db(times_s) <= self.limits.most_gain_db + 1e-9
        return np.where(allowed, values.reshape(shape), np.nan)

    def gains_db(self, times_s: Sequence[float]) -> Array:
        """(L, S)."""
        return np.array(
            [[self.metering.gain_db(light, time) for time in times_s] for light in self.lights_lux]
        )

    def metered_s(self, stages: Stages, light_lux: float) -> float:
        """The exposure that stages give at a light."""
        return stages.divided(self.metering.total_s(light_lux))[0]

    def taken_s(self, stages: Stages, light_lux: float) -> float:
        """:meth:`metered_s` in whole periods and lines, if so limited."""
        return self.limits.settled(self.metered_s(stages, light_lux))

    def schedule(self, exposures_s: Sequence[float]) -> Schedule:
        """What these exposures do, one at each light, with the camera's gain."""
        scenario = self.response.scenario
        cases, values = self.response.at(self.lights_lux, exposures_s)
        known = bool(np.isfinite(values).all())
        of_speeds = [
            np.average(
                [cases[k].mean() for k, (each, _) in enumerate(scenario.cases) if each == speed],
                weights=list(scenario.targets.values()),
            )
            for speed in scenario.speeds_px_s
        ]
        pairs = list(zip(self.lights_lux, exposures_s, strict=True))
        return Schedule(
            exposures_s=tuple(float(exposure) for exposure in exposures_s),
            gains_db=tuple(self.metering.gain_db(*pair) for pair in pairs),
            lacks_gain=tuple(self.metering.lacks_gain(*pair) for pair in pairs),
            values=tuple(float(value) if np.isfinite(value) else None for value in values),
            value=float(values.mean()) if known else None,
            worst_speed=float(min(of_speeds)) if known else None,
            worst_light=float(values.min()) if known else None,
        )


@dataclass(frozen=True)
class Program:
    """Stages and their schedule over the scenario's lights; tested_s: the shortest exposure that was tested, below
    which the first stage is extrapolated; best: the schedule without stages. low, high: the 95 % interval of the
    schedule's value; regret_95: what it loses at most at 95 % against any other exposures; None from few pictures."""

    problem: Problem
    stages: Stages
    tested_s: float
    schedule: Schedule
    best: Schedule
    best_fixed_s: float | None
    baselines: tuple[Baseline, ...]
    low: float | None
    high: float | None
    regret_95: float | None

    @property
    def pictures(self) -> int:
        """How many, or how many clusters of them, it rests on."""
        return len(self.problem.response.clusters)

    def extrapolates(self, exposure_s: float) -> bool:
        """Whether an exposure is shorter than what was tested."""
        return exposure_s < self.tested_s * (1 - 1e-9)


def optimise(problem: Problem, stages: int | None = None, fixed_s: float | None = None) -> Program:
    """The program. stages: their number; None: as few as lose less than ``ENOUGH``.

    fixed_s: the best fixed time; where it is None or not allowed, it is found by the rule of
    :mod:`~blurnoise_eval.answers.recommendation`.

    Raises ``ValueError`` that names the rule and the light, or the speed and what was tested, where nothing is left.
    """
    limits, times = problem.limits, problem.times_s
    if not times:
        raise ValueError(
            f"{', '.join(limits.words)}: leave no exposure at any light that was tested; "
            f"the run tells of {problem.response.range_text}"
        )
    objective = problem.objective(times)
    _check_possible(problem, objective)
    chosen = solve(objective)
    if chosen is None:
        raise ValueError(
            "lux: at less light only shorter exposures are left than at more; a program must not be longer in more "
            "light"
        )
    best = problem.schedule([times[place] for place in chosen])
    tested_s = [time for time, column in zip(times, objective.T, strict=True) if np.isfinite(column).any()]
    tested = _staged(problem, (tested_s[0], tested_s[-1]), stages, best.value or 0.0)
    found = tested.starting_at(limits.shortest_s)
    ours = problem.schedule([problem.taken_s(found, light) for light in problem.lights_lux])
    if None in ours.values:
        place = ours.values.index(None)
        raise ValueError(
            f"lux = {problem.lights_lux[place]:g}: the exposure there, {milliseconds(ours.exposures_s[place])} ms, "
            f"is shorter than what was tested; the run tells of {problem.response.range_text}"
        )
    low, high = _interval(problem, ours)
    if fixed_s is None or not np.isclose(limits.settled(fixed_s), fixed_s, rtol=1e-9):
        place_of_best = best_exposure(times, np.mean(objective, axis=0))
        fixed_s = None if place_of_best is None else times[place_of_best]
    return Program(
        problem=problem,
        stages=found,
        tested_s=tested.times_s[0],
        schedule=ours,
        best=best,
        best_fixed_s=fixed_s,
        baselines=tuple(_baselines(problem, fixed_s)),
        low=low,
        high=high,
        regret_95=_regret(problem, ours, times, objective),
    )


def solve(worth: Array) -> tuple[int, ...] | None:
    """Of each light's exposures the one by which the sum of ``worth`` (L, S) is largest, none longer than that of
    less light; of equals the shortest. None where nothing is allowed.

    Lights and exposures rise; NaN: not allowed, or not known. More light with a longer exposure would let a control
    loop swing. Dynamic programming, O(L S).
    """
    allowed = np.where(np.isnan(worth), -np.inf, worth)
    best = allowed[0]
    came_from = []
    for row in allowed[1:]:
        source = np.empty(len(best), int)
        top = len(best) - 1
        for place in range(len(best) - 1, -1, -1):
            if best[place] >= best[top]:
                top = place
            source[place] = top
        came_from.append(source)
        best = row + best[source]
    last = int(np.argmax(best))
    if not np.isfinite(best[last]):
        return None
    chosen = [last]
    for source in reversed(came_from):
        chosen.append(int(source[chosen[-1]]))
    return tuple(reversed(chosen))


def _check_possible(problem: Problem, objective: Array) -> None:
    """Refuse what the run has not tested, and rules that leave no exposure at a light."""
    response, limits, times = problem.response, problem.limits, problem.times_s
    tells = f"the run tells of {response.range_text}"
    for light, row in zip(problem.lights_lux, objective, strict=True):
        tested = response.tested(np.full(len(times), light), times)
        for (speed, target), ever in zip(response.scenario.cases, tested, strict=True):
            if not ever.any():
                raise ValueError(
                    f"lux = {light:g} at {speed:g} px/s ({target}): no allowed exposure was tested there; {tells}"
                )
        if not tested.all(axis=0).any():
            raise ValueError(f"lux = {light:g}: no allowed exposure was tested at all the speeds; {tells}")
        if np.isnan(row).all():
            needed = problem.metering.gain_db(light, times[-1])
            raise ValueError(
                f"most_gain_db = {limits.most_gain_db:g}: leaves no exposure at {light:g} lux: "
                f"the longest allowed, {1e3 * times[-1]:.4g} ms, needs {needed:.1f} dB"
            )


def _staged(problem: Problem, between_s: tuple[float, float], wanted: int | None, best: float) -> Stages:
    """As many stages as wanted, or as few as lose less than ``ENOUGH``, with times between two."""
    limits, lights = problem.limits, problem.lights_lux
    low, high = between_s
    lattice = np.geomspace(low, high, 1 + int(np.ceil(STEPS_PER_STOP * np.log2(high / low) - 1e-9))).tolist()
    worth = problem.objective([limits.settled(min(time, high)) for time in lattice])
    worth -= GAIN_COSTS * problem.gains_db(lattice)
    totals = [problem.metering.total_s(light) for light in lights]
    most_db = min(limits.most_gain_db, problem.metering.camera.gain_max_db)
    found: list[Staged] = best_stages(
        worth, totals, lattice, 10 ** (most_db / 20), 10 ** (EARLY_GAIN_DB / 20)
    )
    if not found:
        raise ValueError(
            "stages: none stays within what the run tested and the limits allow; "
            f"the run tells of {problem.response.range_text}"
        )
    if wanted is not None:
        return found[min(wanted, len(found)) - 1].stages
    least = min(best * len(lights), found[-1].worth) - ENOUGH * len(lights)
    return next(each.stages for each in found if each.worth >= least)


def _interval(problem: Problem, ours: Schedule) -> tuple[float | None, float | None]:
    """95 % of the schedule's value."""
    response = problem.response
    there = response.uncertain(problem.lights_lux, ours.exposures_s)
    if not np.isfinite(there.objective).all():
        return None, None
    mean = there.objective.mean()
    away = there.departures.mean(axis=1)
    sigma = np.sqrt(max(float(there.open.mean()), 0.0))
    low, high = (float(end) for end in uncertainty.of_level(mean, away, response.most, sigma))
    return (low, high) if np.isfinite(low) else (None, None)


def _regret(problem: Problem, ours: Schedule, times_s: Sequence[float], objective: Array) -> float | None:
    """Mean over the lights of what the schedule loses at most, each against the best exposure there, paired."""
    if None in ours.values:
        return None
    bounds = []
    for light, exposure, row in zip(problem.lights_lux, ours.exposures_s, objective, strict=True):
        others = [time for time, value in zip(times_s, row, strict=True) if np.isfinite(value)]
        there = problem.response.uncertain([light] * (1 + len(others)), [exposure, *others])
        gain = there.objective[1:] - there.objective[0]
        away = there.departures[:, 1:] - there.departures[:, [0]]
        sigma = uncertainty.sigma_of_differences(there.open, 0)[1:]
        bounds.append(float(uncertainty.regret_bound(away, gain, sigma=sigma)))
    bound = float(np.mean(bounds))
    return bound if np.isfinite(bound) else None


def _baselines(problem: Problem, fixed_s: float | None) -> list[Baseline]:
    """The best fixed time, stock programs, and the other rule against flicker."""

    def held(name: str, exposure_at: Callable[[float], float]) -> Baseline:
        found = problem.schedule([exposure_at(light) for light in problem.lights_lux])
        outside = "" if found.value is not None else "its exposures lie outside what was tested"
        return Baseline(name, found, outside)

    found = [
        Baseline("best fixed time", None, "none was tested at every light")
        if fixed_s is None
        else held("best fixed time", lambda light: fixed_s)
    ]
    longest_s = problem.limits.rule.limit_s
    for name, stages in STOCK.items():
        limited = stages.no_longer(longest_s)
        within = name if limited == stages else f"{name}, to {milliseconds(longest_s)} ms"
        found.append(held(within, partial(problem.metered_s, limited)))
    return [*found, _flicker(problem)]


def _flicker(problem: Problem) -> Baseline:
    """The best exposures with the rule against flicker, or without it where the program obeys it."""
    if problem.limits.mains_hz:
        name, limits = "without anti-flicker", replace(problem.limits, mains_hz=0.0, banding=False)
    else:
        name = "whole periods of 50 Hz mains"
        try:
            limits = replace(problem.limits, mains_hz=50.0)
        except ValueError:
            return Baseline(name, None, "no period fits between the limits")
    other = replace(problem, limits=limits)
    chosen = solve(other.objective(other.times_s)) if other.times_s else None
    if chosen is None:
        return Baseline(name, None, "it leaves no exposure that was tested at some light")
    return Baseline(name, problem.schedule([other.times_s[place] for place in chosen]))
