"""The optimal exposure program: solved, put into few stages, and compared with what else a camera may do.

Domain: lux, s, dB; values in the criterion's unit, means over the scenario's lights.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.answers import uncertainty
from blurnoise_eval.answers.recommendation import best_exposure
from blurnoise_eval.grid.axes import milliseconds
from blurnoise_eval.program.limits import STEPS_PER_STOP
from blurnoise_eval.program.problem import Problem, Schedule
from blurnoise_eval.program.stages import STOCK, Stages, best_stages
from blurnoise_eval.system.tables import finite

Array = NDArray[np.float64]
ENOUGH = 0.002
"""That few stages may lose against many."""
GAIN_COSTS = ENOUGH / 6.0
"""What a decibel of gain has to earn, so that of exposures that do alike the longer one, with less gain, is used."""
EARLY_GAIN_DB = 36.0
"""The most gain while a longer exposure is allowed: 16 of the sensor, the most in the modes that libcamera has for
its cameras, times 4, the most that it adds digitally (``AgcChannel::prepare``)."""


class Baseline(NamedTuple):
    """What else a camera may do; without a value, why not."""

    name: str
    schedule: Schedule | None
    reason: str = ""


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
        return len(self.problem.clusters)

    def extrapolates(self, exposure_s: float) -> bool:
        """Whether an exposure is shorter than what was tested."""
        return exposure_s < self.tested_s * (1 - 1e-9)


def optimise(problem: Problem, stages: int | None = None, fixed_s: float | None = None) -> Program:
    """The program. stages: their number; None: as few as lose less than ``ENOUGH``.

    fixed_s: the best fixed time; where it is None or not allowed, it is found by the rule of
    :mod:`~blurnoise_eval.answers.recommendation`.

    Raises ``ValueError`` that names the rule and the light, or the speed and what was tested, where nothing is left.
    """
    limits, times, tells = problem.limits, problem.times_s, problem.range_text
    if not times:
        rules = ", ".join(limits.words)
        raise ValueError(f"{rules}: leave no exposure at any light that was tested; {tells}")
    objective = problem.objective(times)
    _check_possible(problem, objective)
    chosen = solve(objective)
    if chosen is None:
        raise ValueError(
            "lux: at less light only shorter exposures are left than at more; a program must not be longer in more "
            "light"
        )
    best = problem.schedule([times[place] for place in chosen])
    tested_s = np.array(times)[np.isfinite(objective).any(axis=0)].tolist()
    tested = _staged(problem, (tested_s[0], tested_s[-1]), stages, best.value or 0.0)
    found = tested.starting_at(limits.shortest_s)
    ours = problem.schedule([problem.taken_s(found, light) for light in problem.lights_lux])
    if None in ours.values:
        place = ours.values.index(None)
        raise ValueError(
            f"lux = {problem.lights_lux[place]:g}: the exposure there, {milliseconds(ours.exposures_s[place])} ms, "
            f"is shorter than what was tested; {tells}"
        )
    low, high = interval_of(problem, ours)
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
        regret_95=regret_of(problem, ours, times, objective),
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
    limits, times, tells = problem.limits, problem.times_s, problem.range_text
    for light, row in zip(problem.lights_lux, objective, strict=True):
        tested = problem.tested(np.full(len(times), light), times)
        for (speed, target), ever in zip(problem.scenario.cases, tested, strict=True):
            if not ever.any():
                raise ValueError(
                    f"lux = {light:g} at {speed:g} px/s ({target}): no allowed exposure was tested there; {tells}"
                )
        if not tested.all(axis=0).any():
            raise ValueError(f"lux = {light:g}: no allowed exposure was tested at all the speeds; {tells}")
        if np.isnan(row).all():
            needed = problem.inputs.metering.gain_db(light, times[-1])
            raise ValueError(
                f"most_gain_db = {limits.most_gain_db:g}: leaves no exposure at {light:g} lux: "
                f"the longest allowed, {1e3 * times[-1]:.4g} ms, needs {needed:.1f} dB"
            )


def _staged(problem: Problem, between_s: tuple[float, float], wanted: int | None, best: float) -> Stages:
    """As many stages as wanted, or as few as lose less than ``ENOUGH``, with times between two."""
    limits, count = problem.limits, len(problem.lights_lux)
    low, high = between_s
    lattice = np.geomspace(low, high, 1 + int(np.ceil(STEPS_PER_STOP * np.log2(high / low) - 1e-9))).tolist()
    worth = problem.objective([limits.settled(min(time, high)) for time in lattice])
    worth -= GAIN_COSTS * problem.gains_db(lattice)
    totals = [problem.inputs.metering.total_s(light) for light in problem.lights_lux]
    most_db = min(limits.most_gain_db, problem.inputs.metering.camera.gain_max_db)
    found = best_stages(worth, totals, lattice, 10 ** (most_db / 20), 10 ** (EARLY_GAIN_DB / 20))
    if not found:
        tells = problem.range_text
        raise ValueError(f"stages: none stays within what the run tested and the limits allow; {tells}")
    if wanted is not None:
        return found[min(wanted, len(found)) - 1].stages
    least = min(best * count, found[-1].worth) - ENOUGH * count
    return next(each.stages for each in found if each.worth >= least)


def interval_of(problem: Problem, ours: Schedule) -> tuple[float | None, float | None]:
    """95 % of a schedule's value; None from few pictures, or where it was not tested."""
    there = problem.uncertain(problem.lights_lux, ours.exposures_s)
    sigma = np.sqrt(max(float(there.prediction_cov.mean()), 0.0))
    mean, away = there.objective.mean(), there.influence.mean(axis=1)
    ends = uncertainty.of_level(mean, away, problem.most, sigma)
    low, high = (finite(float(end)) for end in ends)
    return (low, high) if np.isfinite(mean) else (None, None)


def regret_of(problem: Problem, ours: Schedule, times_s: Sequence[float], objective: Array) -> float | None:
    """Mean over the lights of what the schedule loses at most, each against the best exposure there, paired."""
    if None in ours.values:
        return None
    bounds = []
    for light, exposure, row in zip(problem.lights_lux, ours.exposures_s, objective, strict=True):
        others = [time for time, value in zip(times_s, row, strict=True) if np.isfinite(value)]
        there = problem.uncertain([light] * (1 + len(others)), [exposure, *others])
        gain = there.objective[1:] - there.objective[0]
        away = there.influence[:, 1:] - there.influence[:, [0]]
        sigma = uncertainty.sigma_of_differences(there.prediction_cov, 0)[1:]
        bounds.append(float(uncertainty.regret_bound(away, gain, sigma=sigma)))
    return finite(float(np.mean(bounds)))


def _baselines(problem: Problem, fixed_s: float | None) -> Iterator[Baseline]:
    """The best fixed time, stock programs, and the other rule against flicker."""
    lights, limits = problem.lights_lux, problem.limits

    def held(name: str, exposures_s: Sequence[float]) -> Baseline:
        found = problem.schedule(exposures_s)
        outside = "" if found.value is not None else "its exposures lie outside what was tested"
        return Baseline(name, found, outside)

    if fixed_s is None:
        yield Baseline("best fixed time", None, "none was tested at every light")
    else:
        yield held("best fixed time", [fixed_s] * len(lights))
    longest_s = limits.rule.limit_s
    for name, stages in STOCK.items():
        limited = stages.no_longer(longest_s)
        within = "" if limited == stages else f", to {milliseconds(longest_s)} ms"
        totals = map(problem.inputs.metering.total_s, lights)
        yield held(name + within, [limited.divided(total)[0] for total in totals])
    if limits.mains_hz:
        name, limits = "without anti-flicker", replace(limits, mains_hz=0.0, banding=False)
    else:
        name = "whole periods of 50 Hz mains"
        try:
            limits = replace(limits, mains_hz=50.0)
        except ValueError:
            yield Baseline(name, None, "no period fits between the limits")
            return
    other = replace(problem, limits=limits)
    chosen = solve(other.objective(other.times_s)) if other.times_s else None
    if chosen is None:
        yield Baseline(name, None, "it leaves no exposure that was tested at some light")
    else:
        yield Baseline(name, problem.schedule([other.times_s[place] for place in chosen]))
