"""The optimal exposure program in few stages, compared with other programs.

Domain: lux, s; gain in dB, that of stages as a factor >= 1; values in the criterion's unit, means over the scenario's
lights. Stages are libcamera's. With the total exposure (time x gain) that the meter asks for, the time rises to that
of the next stage at the present gain, then the gain rises to that of the next stage at this time. Before the first
stage and beyond the last both are constant. Where the mains flicker, the time is then cut to whole periods and the
gain makes up for it; a time below one period stays (libcamera 0.7.1, ``AgcChannel::divideUpExposure``).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.answers.choosing import best_exposure
from blurnoise_eval.plan.axes import milliseconds
from blurnoise_eval.program.problem import Problem, Schedule
from blurnoise_eval.program.scenario import STEPS_PER_STOP, ExposureLimits
from blurnoise_eval.run.search_space import exposures_on
from blurnoise_eval.scoring import uncertainty
from blurnoise_eval.system.tables import finite

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
MOST_LOSS = 0.002
"""The most that few stages may lose against any number of them, the cost of gain included."""
COST_PER_DB = MOST_LOSS / 6.0
"""The cost of gain: of equally good exposures the longest, with the least gain, is best."""
EARLY_GAIN_DB = 36.0
"""The most gain while the exposure can still rise: 16 of the sensor, the most in libcamera's modes, times 4, the most
that it adds digitally (``AgcChannel::prepare``)."""
EARLY_GAIN = 10 ** (EARLY_GAIN_DB / 20)


@dataclass(frozen=True)
class Stages:
    """Two or more times and gains, neither of which ever falls; the brightest light gets the first.

    >>> Stages((0.001, 0.01, 0.03), (1.0, 1.0, 4.0)).divided(0.06)
    (0.03, 2.0)
    """

    times_s: tuple[float, ...]
    gains: tuple[float, ...]

    def divided(self, total_s: float) -> tuple[float, float]:
        """Time and gain for a total exposure (time x gain), as libcamera divides it up."""
        time, gain = self.times_s[0], self.gains[0]
        for next_time, next_gain in zip(self.times_s[1:], self.gains[1:], strict=True):
            if time * gain >= total_s:
                break
            time = min(next_time, total_s / gain)
            gain = min(next_gain, max(gain, total_s / time))
        return time, gain


STOCK = {
    "libcamera imx296 normal": Stages((100e-6, 30e-3, 45e-3, 60e-3, 66.666e-3), (1.0, 1.0, 2.0, 4.0, 16.0)),
    "libcamera imx296 short": Stages((100e-6, 5e-3, 10e-3, 20e-3, 66.666e-3), (1.0, 2.0, 4.0, 8.0, 16.0)),
}
"""Exposure modes of Raspberry Pi's global shutter camera: libcamera, src/ipa/rpi/vc4/data/imx296.json."""


@dataclass(frozen=True)
class Program:
    """Stages and their schedule over the scenario's lights.

    tested_s: the shortest tested exposure; shorter ones are extrapolated. best: the schedule without a limit on the
    number of stages. best_fixed_s: the best exposure for all lights. baselines: other programs, by name. low, high:
    95 % interval of the schedule's value. regret_95: 95 % bound of the loss against the best exposure at each light.
    The last three are None from few pictures.
    """

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

    def extrapolates(self, exposure_s: float) -> bool:
        """Whether an exposure is shorter than any that was tested."""
        return exposure_s < self.tested_s * (1 - 1e-9)


def optimise(problem: Problem) -> Program:
    """The program with the fewest stages that lose at most ``MOST_LOSS`` against any number of them.

    Raises ``ValueError`` that names the lights at which no exposure is left.
    """
    limits, lights, times = problem.limits, problem.scenario.lights_lux, problem.times_s
    objective = problem.objective(times)
    for light, row in zip(lights, objective, strict=True):
        if not np.isfinite(row).any():
            raise problem.nothing_left([light])
    # What the meter asks for depends on the light alone; how it is divided is the program.
    totals_s = problem.totals_s
    tested_s = np.array(times)[np.isfinite(objective).any(axis=0)].tolist()
    programs = _staged(problem, totals_s, tested_s[0], tested_s[-1])

    def scheduled(stages: Stages) -> Schedule:
        return problem.schedule([limits.settled(stages.divided(total_s)[0]) for total_s in totals_s])

    # No camera goes below its first stage, and the sun is brighter than any tested light: there exposures must be
    # shorter than tested, and shorter than a period of the lamps. Nor has it more gain than the last stage, and half
    # of the pictures are darker than the mean: the run has metered each of them up to the camera's gain.
    def extended(stages: Stages) -> Stages:
        late = stages.times_s[-1] >= tested_s[-1] * (1 - 1e-9)
        gain = problem.most_gain if late else min(problem.most_gain, EARLY_GAIN)
        return Stages(
            (min(limits.first_s, stages.times_s[0]), *stages.times_s[1:]),
            (*stages.gains[:-1], max(stages.gains[-1], gain)),
        )

    most_worth = programs[-1][1]
    fewest = next(stages for stages, worth in programs if worth >= most_worth - MOST_LOSS * len(lights))
    schedule = scheduled(extended(fewest))
    if without := [light for light, value in zip(lights, schedule.values, strict=True) if value is None]:
        raise problem.nothing_left([without[0], without[-1]])
    fixed_s = _best_fixed_s(problem, objective)
    low, high = interval_of(problem, schedule)
    # The steps of the lattice, and the cost of gain, can make fewer stages worth a little more than any number.
    every = [scheduled(extended(stages)) for stages, _ in programs]
    best = max((one for one in every if one.value is not None), key=lambda one: one.value or 0.0)
    return Program(
        problem=problem,
        stages=extended(fewest),
        tested_s=fewest.times_s[0],
        schedule=schedule,
        best=best,
        best_fixed_s=fixed_s,
        baselines=_baselines(problem, fixed_s),
        low=low,
        high=high,
        regret_95=None if low is None else regret_of(problem, schedule, times, objective),
    )


def _best_fixed_s(problem: Problem, objective: Array) -> float | None:
    """The best exposure for all lights: that of the run's report if it answers the same question, else that of this
    objective (L, S); None where every one was left out at some light."""
    recommended_s = problem.inputs.recommended_s if problem.scenario == problem.inputs.scenario else None
    if recommended_s is not None and math.isclose(problem.limits.settled(recommended_s), recommended_s):
        flickers = any(problem.limits.avoidable(recommended_s, total_s) for total_s in problem.totals_s)
        if not ((problem.limits.mains_hz or problem.limits.led) and flickers):
            return recommended_s
    index = best_exposure(problem.times_s, np.mean(objective, axis=0))
    return None if index is None else problem.times_s[index]


def _baselines(problem: Problem, fixed_s: float | None) -> dict[str, Schedule]:
    """Other programs by name: the best fixed exposure, and libcamera's modes as far as the frame rate allows."""
    baselines, limits = dict[str, Schedule](), problem.limits
    if fixed_s is not None:
        n_lights = len(problem.scenario.lights_lux)
        baselines[f"best fixed time, {milliseconds(fixed_s)} ms"] = problem.schedule([fixed_s] * n_lights)
    for name, stock in STOCK.items():
        limited = replace(stock, times_s=tuple(min(time, limits.limit_s) for time in stock.times_s))
        remark = "" if limited == stock else f", to {milliseconds(limits.limit_s)} ms"
        exposures_s = [limited.divided(total_s)[0] for total_s in problem.totals_s]
        if limits.mains_hz and any(map(limits.avoidable, exposures_s, problem.totals_s)):
            remark += ", flickers"
        baselines[name + remark] = problem.schedule(exposures_s)
    return baselines


def _staged(
    problem: Problem, totals_s: Sequence[float], low_s: float, high_s: float
) -> list[tuple[Stages, float]]:
    """The best stages of each number, with times from low to high, and the sum of their worth over the lights."""
    limits = problem.limits
    lattice, steady = _lattice(limits, low_s, high_s)
    worth = problem.objective([min(limits.settled(time), high_s) for time in lattice])
    worth -= COST_PER_DB * problem.gains_db(lattice)
    programs = best_stages(worth, totals_s, lattice, problem.most_gain, EARLY_GAIN, steady)
    if not programs:
        raise problem.nothing_left(problem.scenario.lights_lux[:: len(totals_s) - 1 or 1])
    return programs


def _lattice(limits: ExposureLimits, low_s: float, high_s: float) -> tuple[list[float], list[bool]]:
    """Times from low to high, an eighth of a stop apart, and whether a stage may end at each.

    Where lamps flicker the times contain the lamps' shortest one and whole periods, and stages end only there.
    """
    shortest_s = limits.shortest_s
    if not (limits.mains_hz or limits.led) or not low_s < shortest_s <= high_s * (1 + 1e-9):
        times = exposures_on((low_s, high_s), STEPS_PER_STOP).tolist()
        return times, [limits.steady(time) or not limits.mains_hz for time in times]
    times = exposures_on((shortest_s, max(high_s, shortest_s)), STEPS_PER_STOP).tolist()
    step = math.log2(times[1] / times[0]) if len(times) > 1 else 1 / STEPS_PER_STOP
    below = math.floor(math.log2(shortest_s / low_s) / step + 1e-9)
    times = [shortest_s * 2 ** (-k * step) for k in range(below, 0, -1)] + times
    steady = [limits.steady(time) for time in times]
    if limits.mains_hz:
        # A whole period takes the place of the time that is nearest to it.
        period_s = 1 / (2 * limits.mains_hz)
        for n in range(
            round(shortest_s / period_s), math.floor((high_s + limits.row_time_s) / period_s + 1e-9) + 1
        ):
            k = below + round(math.log2(n * period_s / shortest_s) / step)
            times[k], steady[k] = n * period_s, True
    return times, steady


def interval_of(problem: Problem, schedule: Schedule) -> tuple[float | None, float | None]:
    """95 % interval of a schedule's value; None from few pictures."""
    at = problem.scenario.lights_lux, schedule.exposures_s
    objective, influence, cov = problem.uncertain(*at)
    sigma, clusters = np.sqrt(max(float(cov.mean()), 0.0)), problem.effective(*at)
    low, high = uncertainty.of_level(objective.mean(), influence.mean(axis=1), problem.most, sigma, clusters)
    return finite(float(low)), finite(float(high))


def regret_of(
    problem: Problem, schedule: Schedule, times_s: Sequence[float], objective: Array
) -> float | None:
    """95 % bound of a schedule's loss, its mean over the lights. At each light the schedule is compared with every
    other exposure on the same pictures. objective: (L, S)."""
    bounds = []
    for light, exposure, row in zip(
        problem.scenario.lights_lux, schedule.exposures_s, objective, strict=True
    ):
        others = [time for time, value in zip(times_s, row, strict=True) if np.isfinite(value)]
        value, influence, cov = problem.uncertain([light] * (1 + len(others)), [exposure, *others])
        differences, sigma = (
            influence[:, 1:] - influence[:, [0]],
            uncertainty.sigma_of_differences(cov, 0)[1:],
        )
        bounds.append(float(uncertainty.regret_bound(differences, value[1:] - value[0], sigma=sigma)))
    return finite(float(np.mean(bounds)))


def best_stages(
    worth: Array,
    totals_s: Sequence[float],
    times_s: Sequence[float],
    most_gain: float,
    early_gain: float = math.inf,
    steady: Sequence[bool] | None = None,
) -> list[tuple[Stages, float]]:
    """The best stages of at most 1, 2, ... in number, with the sum of their worth, until another gains nothing; an
    empty list where no program is allowed.

    worth: (L, I) of each light at each of ``times_s`` (I,), NaN where it is not allowed; the times rise by equal
    steps in stops. totals_s: (L,) exposure times gain that each light asks for. most_gain: at the longest time;
    early_gain: at any other. steady: (I,) whether a stage may end at a time, everywhere if None; a program may also
    end before the first of these.

    Gains have the same steps as times, so a program is a path on a lattice of time steps i and gain steps j that
    begins at (0, 0), and a stage is a rise in time followed by a rise in gain. A light that asks for n steps is met
    where the path has i + j = n. Dynamic programming finds the best path of each number of stages.

    >>> worth = np.array([[0.9, 0.5], [0.2, 0.8]])  # a bright light is best at 1 ms, a dark one at 2 ms
    >>> programs = best_stages(worth, totals_s=[0.001, 0.002], times_s=[0.001, 0.002], most_gain=1.0)
    >>> programs[-1][0].times_s, round(programs[-1][1], 3)
    ((0.001, 0.002), 1.7)
    """
    n_times = len(times_s)
    # An eighth of a stop, as exposures are spaced where there are several.
    step = math.log2(times_s[1] / times_s[0]) if n_times > 1 else 0.125
    asked = np.maximum(np.rint(np.log2(np.asarray(totals_s) / times_s[0]) / step), 0).astype(int)
    # a gain of exactly n steps has n steps, whatever the logarithm's rounding
    gains, early = (
        math.floor(math.log2(gain) / step + 1e-9) for gain in (most_gain, min(most_gain, early_gain))
    )
    reach = max(1, min(int(asked.max()), n_times - 1 + gains))
    of_steps = np.zeros((reach + 2, n_times))  # (n, i): worth at time i of all lights that ask for n steps
    # A light at which an exposure is not allowed makes every program that uses it there worthless.
    np.add.at(of_steps, np.minimum(asked, reach), np.where(np.isnan(worth), -np.inf, worth))
    of_more = np.cumsum(of_steps[::-1], axis=0)[::-1]  # of all that ask for n or more
    i, j = np.indices((n_times, gains + 1))
    steps = np.minimum(i + j, reach)
    allowed = (i + j <= reach) & ((j <= early) | (i == n_times - 1))
    met = np.where(allowed, of_steps[steps, i], -np.inf)
    # A path may end at the darkest light, or at the most gain: all darker lights then get the same exposure.
    may_end = allowed & (i + j > 0) & ((i + j == reach) | (j == gains))
    may_stop = np.ones(n_times, dtype=bool) if steady is None else np.array(steady, dtype=bool)
    # gain rises only where a stage may end
    gains_met = np.where(may_stop[:, None], met, -np.inf)
    may_end &= (may_stop | ~np.maximum.accumulate(may_stop))[:, None]
    darker = np.where(may_end, of_more[steps + 1, i], -np.inf)

    best = np.full(met.shape, -np.inf)
    best[0, 0] = met[0, 0]
    risen: list[tuple[Indices, Indices]] = []
    programs: list[tuple[Stages, float]] = []
    before: Array | None = None
    while before is None or not np.array_equal(best, before):
        before = best
        best, from_time = _rising(best, met, early=True)
        transposed, from_gain = _rising(best.T, gains_met.T, early=False)
        best = transposed.T
        risen.append((from_time, from_gain.T))
        total = best + darker
        ends = np.argwhere(total == total.max())  # of equal ends the darkest light's, with the most gain
        end = ends[np.lexsort((ends[:, 0], ends.sum(axis=1)))[0]]
        if np.isfinite(total.max()):
            corners = _corners(risen, int(end[0]), int(end[1]))
            times = tuple(float(times_s[time]) for time, _ in corners)
            stages = Stages(times, tuple(float(2 ** (gain * step)) for _, gain in corners))
            programs.append((stages, float(total.max())))
    return programs


def _rising(best: Array, met: Array, early: bool) -> tuple[Array, Indices]:
    """Best sums (I, J) after a rise along the first axis, and the index at which that rise begins.

    early: of equal rises the one that begins first is taken, else the one that begins last. So times rise early and
    gains late: equal programs use little gain.
    """
    sums = best.copy()
    begun = np.repeat(np.arange(len(best))[:, None], best.shape[1], axis=1)
    for k in range(1, len(best)):
        rising = sums[k - 1] + met[k]
        better = rising >= sums[k] if early else rising > sums[k]
        sums[k] = np.where(better, rising, sums[k])
        begun[k] = np.where(better, begun[k - 1], begun[k])
    return sums, begun


def _corners(risen: Sequence[tuple[Indices, Indices]], i: int, j: int) -> list[tuple[int, int]]:
    """Steps of time and gain at which the stages of the path to (i, j) end, the start first, without repeats."""
    corners = [(i, j)]
    for from_time, from_gain in reversed(risen):
        j = int(from_gain[i, j])
        i = int(from_time[i, j])
        if (i, j) != corners[-1]:
            corners.append((i, j))
    return corners[::-1]
