"""The optimal exposure program: solved, put into few stages, and compared with what else a camera may do.

Domain: lux, s, dB; values in the criterion's unit, means over the scenario's lights.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

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


@dataclass(frozen=True)
class Program:
    """Stages and their schedule over the scenario's lights; tested_s: the shortest exposure that was tested, below
    which the first stage is extrapolated; best: the schedule without stages. baselines: what else a camera may do, by
    its name. low, high: the 95 % interval of the schedule's value; regret_95: what it loses at most at 95 % against
    any other exposures; None from few pictures."""

    problem: Problem
    stages: Stages
    tested_s: float
    schedule: Schedule
    best: Schedule
    best_fixed_s: float | None
    baselines: Mapping[str, Schedule]
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


def optimise(problem: Problem, stages: int | None = None) -> Program:
    """The program. stages: their number at most; None: as few as lose less than ``ENOUGH``.

    Raises ``ValueError`` that names the lights at which no exposure is left.
    """
    limits, lights, times = problem.limits, problem.lights_lux, problem.times_s
    objective = problem.objective(times)
    for light, row in zip(lights, objective, strict=True):
        if not np.isfinite(row).any():
            raise problem.nothing_left([light])
    chosen = solve(objective)
    if chosen is None:
        raise problem.nothing_left((lights[0], lights[-1]))
    best = problem.schedule([times[place] for place in chosen])
    tested_s = np.array(times)[np.isfinite(objective).any(axis=0)].tolist()
    tested = _staged(problem, tested_s[0], tested_s[-1], stages, best.value or 0.0)
    found = tested.starting_at(limits.shortest_s)
    metering = problem.inputs.metering
    totals = [metering.total_s(light) for light in lights]
    ours = problem.schedule([limits.settled(found.divided(total)[0]) for total in totals])
    if None in ours.values:
        raise problem.nothing_left([lights[ours.values.index(None)]])
    baselines = {}
    place = best_exposure(times, np.mean(objective, axis=0))
    fixed_s = None if place is None else times[place]
    if fixed_s is not None:
        baselines[f"best fixed time, {milliseconds(fixed_s)} ms"] = problem.schedule([fixed_s] * len(lights))
    for name, stock in STOCK.items():
        limited = stock.no_longer(limits.limit_s)
        within = "" if limited == stock else f", to {milliseconds(limits.limit_s)} ms"
        baselines[name + within] = problem.schedule([limited.divided(total)[0] for total in totals])
    low, high = interval_of(problem, ours)
    regret_95 = regret_of(problem, ours, times, objective)
    return Program(problem, found, tested.times_s[0], ours, best, fixed_s, baselines, low, high, regret_95)


def solve(worth: Array) -> tuple[int, ...] | None:
    """Of each light's exposures the one by which the sum of ``worth`` (L, S) is largest, none longer than that of
    less light; of equals the shortest. None where nothing is allowed.

    Lights and exposures rise; NaN: not allowed, or not known. More light with a longer exposure would let a control
    loop swing. Dynamic programming, O(L S).
    """
    first, *others = np.where(np.isnan(worth), -np.inf, worth)
    sums = [first]
    for row in others:
        sums.append(row + np.maximum.accumulate(sums[-1][::-1])[::-1])
    if not np.isfinite(sums[-1].max()):
        return None
    chosen = [0]
    for row in reversed(sums):
        chosen.append(chosen[-1] + int(np.argmax(row[chosen[-1] :])))
    return tuple(reversed(chosen[1:]))


def _staged(problem: Problem, low_s: float, high_s: float, wanted: int | None, best: float) -> Stages:
    """As many stages as wanted, or as few as lose less than ``ENOUGH``, with times between two."""
    limits, lights, metering = problem.limits, problem.lights_lux, problem.inputs.metering
    steps = int(np.ceil(STEPS_PER_STOP * np.log2(high_s / low_s) - 1e-9))
    lattice = np.geomspace(low_s, high_s, 1 + steps).tolist()
    worth = problem.objective([limits.settled(min(time, high_s)) for time in lattice])
    worth -= GAIN_COSTS * problem.gains_db(lattice)
    most_db = min(limits.gain_max_db, metering.camera.gain_max_db)
    totals = [metering.total_s(light) for light in lights]
    found = best_stages(worth, totals, lattice, 10 ** (most_db / 20), 10 ** (EARLY_GAIN_DB / 20))
    if not found:
        raise problem.nothing_left((lights[0], lights[-1]))
    if wanted is not None:
        return found[wanted - 1].stages
    least = min(best * len(lights), found[-1].worth) - ENOUGH * len(lights)
    return next(each.stages for each in found if each.worth >= least)


def interval_of(problem: Problem, ours: Schedule) -> tuple[float | None, float | None]:
    """95 % of a schedule's value; None from few pictures, or where it was not tested."""
    there = problem.uncertain(problem.lights_lux, ours.exposures_s)
    sigma = np.sqrt(max(float(there.prediction_cov.mean()), 0.0))
    mean, away = there.objective.mean(), there.influence.mean(axis=1)
    low, high = uncertainty.of_level(mean, away, problem.most, sigma)
    return (finite(float(low)), finite(float(high))) if np.isfinite(mean) else (None, None)


def regret_of(problem: Problem, ours: Schedule, times_s: Sequence[float], objective: Array) -> float | None:
    """Mean over the lights of what the schedule loses at most, each against the best exposure there, paired."""
    bounds = []
    for light, exposure, row in zip(problem.lights_lux, ours.exposures_s, objective, strict=True):
        others = [time for time, value in zip(times_s, row, strict=True) if np.isfinite(value)]
        there = problem.uncertain([light] * (1 + len(others)), [exposure, *others])
        gain = there.objective[1:] - there.objective[0]
        away = there.influence[:, 1:] - there.influence[:, [0]]
        sigma = uncertainty.sigma_of_differences(there.prediction_cov, 0)[1:]
        bounds.append(float(uncertainty.regret_bound(away, gain, sigma=sigma)))
    return finite(float(np.mean(bounds)))
