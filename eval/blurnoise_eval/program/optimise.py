"""The optimal exposure program: solved, put into few stages, and compared with alternatives.

Domain: lux, s; gain in dB, of stages as a factor, 1 and more; values in the criterion's unit, means over the
scenario's lights. Stages are libcamera's: from the first time and gain on, as more total exposure (time x gain) is
asked for, time rises to the next stage's at the present gain, then gain to the next stage's at that time; beyond the
last stage nothing rises, and in front of the first nothing falls. Last, a time of one or more periods of the mains is
cut to whole ones and gain makes up for it; a shorter one stays (libcamera 0.7.1, ``AgcChannel::divideUpExposure``).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.answers.recommendation import best_exposure
from blurnoise_eval.plan.axes import milliseconds
from blurnoise_eval.program.problem import Problem, Schedule
from blurnoise_eval.program.scenario import STEPS_PER_STOP
from blurnoise_eval.run.search_space import exposures_on
from blurnoise_eval.scoring import uncertainty
from blurnoise_eval.system.tables import finite

Array = NDArray[np.float64]
Places = NDArray[np.int64]
ENOUGH = 0.002
"""So much may few stages lose against any number of them, the cost of gain included."""
GAIN_COSTS = ENOUGH / 6.0
"""The cost of a decibel of gain, so that of equally good exposures the longer one, with less gain, is used."""
EARLY_GAIN_DB = 36.0
"""The most gain while a longer exposure is allowed: 16 of the sensor, the most in the modes that libcamera has for
its cameras, times 4, the most that it adds digitally (``AgcChannel::prepare``)."""


@dataclass(frozen=True)
class Stages:
    """Times and gains, two or more, neither ever falling; the first is where the least light ends."""

    times_s: tuple[float, ...]
    gains: tuple[float, ...]

    def divided(self, total_s: float) -> tuple[float, float]:
        """Time and gain for a total exposure, as libcamera divides it up."""
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
    """Stages and their schedule over the scenario's lights; tested_s: the shortest exposure that was tested, below
    which the first stage is extrapolated; best: the schedule of as many stages as gain anything. baselines: what else
    a camera may do, by its name. low, high: the 95 % interval of the schedule's value; regret_95: what it loses at
    most at 95 % against any other exposures; None from few pictures."""

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
        """Whether an exposure is shorter than what was tested."""
        return exposure_s < self.tested_s * (1 - 1e-9)


def optimise(problem: Problem) -> Program:
    """The program, in the fewest stages that lose less than ``ENOUGH`` against any number of them.

    Raises ``ValueError`` that names the lights at which no exposure is left.
    """
    limits, lights, times = problem.limits, problem.scenario.lights_lux, problem.times_s
    objective = problem.objective(times)
    for light, row in zip(lights, objective, strict=True):
        if not np.isfinite(row).any():
            raise problem.nothing_left([light])
    totals = [problem.inputs.metering.total_s(light) for light in lights]
    tested_s = np.array(times)[np.isfinite(objective).any(axis=0)].tolist()
    ways = _staged(problem, totals, tested_s[0], tested_s[-1])

    def schedule(stages: Stages) -> Schedule:
        return problem.schedule([limits.settled(stages.divided(total)[0]) for total in totals])

    (most, reached), enough = ways[-1], ENOUGH * len(lights)
    tested = next(stages for stages, worth in ways if worth >= reached - enough)
    # more light than was tested is met by shorter exposures, also than the lamps need: no camera goes below its first
    # stage
    found = replace(tested, times_s=(min(limits.first_s, tested.times_s[0]), *tested.times_s[1:]))
    ours = schedule(found)
    if None in ours.values:
        raise problem.nothing_left([lights[ours.values.index(None)]])
    baselines, fixed_s = {}, problem.inputs.recommended_s
    asked_else = problem.scenario != problem.inputs.scenario
    if asked_else or fixed_s is None or not np.isclose(limits.settled(fixed_s), fixed_s, rtol=1e-9):
        place = best_exposure(times, np.mean(objective, axis=0))
        fixed_s = None if place is None else times[place]
    if fixed_s is not None:
        baselines[f"best fixed time, {milliseconds(fixed_s)} ms"] = problem.schedule([fixed_s] * len(lights))
    for name, stock in STOCK.items():
        limited = replace(stock, times_s=tuple(min(time, limits.limit_s) for time in stock.times_s))
        within = "" if limited == stock else f", to {milliseconds(limits.limit_s)} ms"
        taken = [limited.divided(total)[0] for total in totals]
        if limits.mains_hz and not np.allclose(list(map(limits.settled, taken)), taken, rtol=0.02):
            within += ", flickers"
        baselines[name + within] = problem.schedule(taken)
    return Program(
        problem, found, tested.times_s[0], ours, schedule(most), fixed_s, baselines,
        *interval_of(problem, ours), regret_of(problem, ours, times, objective),
    )  # fmt: skip


def _staged(
    problem: Problem, totals_s: Sequence[float], low_s: float, high_s: float
) -> list[tuple[Stages, float]]:
    """The best programs of each number of stages, with times between two, and their sums of worth."""
    limits, metering = problem.limits, problem.inputs.metering
    lattice = exposures_on((low_s, high_s), STEPS_PER_STOP).tolist()
    worth = problem.objective([limits.settled(min(time, high_s)) for time in lattice])
    worth -= GAIN_COSTS * problem.gains_db(lattice)
    most_db = min(limits.gain_max_db, metering.camera.gain_max_db)
    ways = best_stages(worth, totals_s, lattice, 10 ** (most_db / 20), 10 ** (EARLY_GAIN_DB / 20))
    if not ways:
        raise problem.nothing_left(problem.scenario.lights_lux[:: len(totals_s) - 1 or 1])
    return ways


def interval_of(problem: Problem, ours: Schedule) -> tuple[float | None, float | None]:
    """95 % of a schedule's value; None from few pictures."""
    objective, influence, cov = problem.uncertain(problem.scenario.lights_lux, ours.exposures_s)
    sigma = np.sqrt(max(float(cov.mean()), 0.0))
    low, high = uncertainty.of_level(objective.mean(), influence.mean(axis=1), problem.most, sigma)
    return finite(float(low)), finite(float(high))


def regret_of(problem: Problem, ours: Schedule, times_s: Sequence[float], objective: Array) -> float | None:
    """Mean over the lights of what the schedule loses at most, each against the best exposure there, paired."""
    bounds = []
    for light, exposure, row in zip(problem.scenario.lights_lux, ours.exposures_s, objective, strict=True):
        others = [time for time, value in zip(times_s, row, strict=True) if np.isfinite(value)]
        value, influence, cov = problem.uncertain([light] * (1 + len(others)), [exposure, *others])
        away, sigma = influence[:, 1:] - influence[:, [0]], uncertainty.sigma_of_differences(cov, 0)[1:]
        bounds.append(float(uncertainty.regret_bound(away, value[1:] - value[0], sigma=sigma)))
    return finite(float(np.mean(bounds)))


def best_stages(
    worth: Array,
    totals_s: Sequence[float],
    times_s: Sequence[float],
    most_gain: float,
    early_gain: float = math.inf,
) -> list[tuple[Stages, float]]:
    """The best programs of at most 1, 2 ... stages, with their sums of worth, as long as another stage may gain
    anything; none where none is allowed.

    worth: (L, I) of each light at each of ``times_s`` (I,), equally many stops apart and rising, NaN where it is not
    allowed; totals_s: (L,) what each light asks for, times gain; early_gain: the most gain at any time but the
    longest. Gains have the times' steps. Of programs on that lattice these are the best: dynamic programming over
    paths that rise by one step of time (i) or of gain (j) from the first time and gain on. A path of a stage rises
    in time, then in gain; it meets a light that asks for i + j steps.
    """
    n_times = len(times_s)
    step = math.log2(times_s[1] / times_s[0]) if n_times > 1 else 0.125
    asked = np.maximum(np.rint(np.log2(np.asarray(totals_s) / times_s[0]) / step), 0).astype(int)
    gains, early = (
        math.floor(math.log2(each) / step + 1e-9) for each in (most_gain, min(most_gain, early_gain))
    )
    reach = max(1, min(int(asked.max()), n_times - 1 + gains))
    of_steps = np.zeros((reach + 2, n_times))  # worth of all lights that ask for so many steps
    np.add.at(of_steps, np.minimum(asked, reach), np.where(np.isnan(worth), -np.inf, worth))
    of_more = np.cumsum(of_steps[::-1], axis=0)[::-1]
    i, j = np.indices((n_times, gains + 1))
    steps = np.minimum(i + j, reach)
    allowed = (i + j <= reach) & ((j <= early) | (i == n_times - 1))
    met = np.where(allowed, of_steps[steps, i], -np.inf)
    # the darkest light is reached, or the most gain, at which all darker lights stay
    may_end = allowed & (i + j > 0) & ((i + j == reach) | (j == gains))
    darker = np.where(may_end, of_more[steps + 1, i], -np.inf)

    best = np.full(met.shape, -np.inf)
    best[0, 0] = met[0, 0]
    risen: list[tuple[Places, Places]] = []
    found: list[tuple[Stages, float]] = []
    before: Array | None = None
    while before is None or not np.array_equal(best, before):
        before = best
        best, from_time = _rising(best, met, early=True)
        transposed, from_gain = _rising(best.T, met.T, early=False)
        best = transposed.T
        risen.append((from_time, from_gain.T))
        total = best + darker
        ends = np.argwhere(total == total.max())
        end = ends[np.lexsort((ends[:, 0], ends.sum(axis=1)))[0]]
        if np.isfinite(total.max()):
            corners = _corners(risen, int(end[0]), int(end[1]))
            times = tuple(float(times_s[time]) for time, _ in corners)
            stages = Stages(times, tuple(float(2 ** (gain * step)) for _, gain in corners))
            found.append((stages, float(total.max())))
    return found


def _rising(best: Array, met: Array, early: bool) -> tuple[Array, Places]:
    """Sums after any number of steps along the first axis, and the place there from which they rise.

    Of equal ways the one that begins to rise ``early``, or the one that does late.
    """
    sums = best.copy()
    begun = np.repeat(np.arange(len(best))[:, None], best.shape[1], axis=1)
    for k in range(1, len(best)):
        rising = sums[k - 1] + met[k]
        better = rising >= sums[k] if early else rising > sums[k]
        sums[k] = np.where(better, rising, sums[k])
        begun[k] = np.where(better, begun[k - 1], begun[k])
    return sums, begun


def _corners(risen: Sequence[tuple[Places, Places]], i: int, j: int) -> list[tuple[int, int]]:
    """Steps of time and gain where each stage of the path to (i, j) ends, the start first; each once."""
    corners = [(i, j)]
    for from_time, from_gain in reversed(risen):
        j = int(from_gain[i, j])
        i = int(from_time[i, j])
        if (i, j) != corners[-1]:
            corners.append((i, j))
    return corners[::-1]
