"""Programs made from planes that have a closed form: good, within limits, refused beyond what was tested."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise, product

import numpy as np
import pytest
from blurnoise_eval.answers.recommendation import NEAR
from blurnoise_eval.deciding.surface import Predicted
from blurnoise_eval.program.optimise import (
    EARLY_GAIN_DB,
    ENOUGH,
    STOCK,
    Program,
    Stages,
    best_stages,
    interval_of,
    optimise,
    regret_of,
)
from blurnoise_eval.program.report import sentence
from blurnoise_eval.program.scenario import Limits
from made_planes import METERING, SPEEDS, made_planes, made_problem
from made_tables import on_plane

LIMITS = Limits(readout_s=0.003)


@pytest.fixture(scope="module")
def program() -> Program:
    return optimise(made_problem(LIMITS))


def number(value: float | None) -> float:
    assert value is not None
    return value


def value(found: Program, name: str) -> float:
    (rival,) = [schedule for each, schedule in found.baselines.items() if each.startswith(name)]
    return number(rival.value)


def test_never_longer_in_more_light(program: Program) -> None:
    for way in (program.schedule, program.best):
        assert all(a >= b * (1 - 1e-9) for a, b in pairwise(way.exposures_s))
        assert max(way.exposures_s) <= LIMITS.limit_s
    assert program.schedule.exposures_s[0] > 4 * program.schedule.exposures_s[-1]


def test_better_than_what_else_a_camera_may_do(program: Program) -> None:
    ours = number(program.schedule.value)
    assert ours <= number(program.best.value) < ours + ENOUGH
    for name in ("best fixed time", *(f"{name}, to 30.3 ms" for name in STOCK)):
        assert value(program, name) < ours - 0.005, name


def test_few_stages_lose_little_where_the_gain_is_at_its_limit() -> None:
    """Held against stages that keep to the same limits of gain, not against exposures that keep to none."""
    found = optimise(made_problem(LIMITS, lights_lux=(0.4, 1.6, 6.4), speeds_px_s={0.0: 0.1, 1500.0: 0.9}))
    assert max(found.schedule.gains_db) > EARLY_GAIN_DB
    assert number(found.best.value) < number(found.schedule.value) + ENOUGH


def test_its_sentence(program: Program) -> None:
    found = sentence(program)
    assert found.startswith(f"From 2 to 300 lux this program keeps {program.schedule.value:.3f} (")
    assert (
        f") of its confidence. Another could gain at most {program.regret_95:.3f} (95 %, 24 pictures)."
        in found
    )


def test_the_fixed_time_is_the_best(program: Program) -> None:
    problem = made_problem(LIMITS)
    for time_s in np.geomspace(0.001, 0.029, 12):
        tried = problem.schedule([time_s] * len(problem.scenario.lights_lux))
        assert tried.value is None or tried.value <= value(program, "best fixed time") + NEAR + 2e-3


def test_the_value_is_the_mean_of_what_the_planes_say(program: Program) -> None:
    """By hand at one light: by shares of speeds, targets alike."""
    problem, planes = made_problem(), made_planes()
    place, light = 7, problem.scenario.lights_lux[7]
    time_s = program.schedule.exposures_s[place]
    expected = 0.0
    for speed, share in ((0.0, 0.3), (200.0, 0.5), (800.0, 0.2)):
        for plane in planes.values():
            sums, counts = plane.on([(np.log2(light * time_s), np.log2(max(speed * time_s, 0.5)))])
            expected += share / 2 * float(sums.sum() / counts.sum())
    assert program.schedule.values[place] == pytest.approx(expected, abs=1e-9)


def test_the_report_s_exposure_answers_the_report_s_question_alone(program: Program) -> None:
    """And where the limits allow it; else the fixed time is found by the report's rule."""
    alike = {"speeds_px_s": dict.fromkeys(SPEEDS, 1.0)}
    assert optimise(made_problem(LIMITS, **alike)).best_fixed_s == 0.005
    assert optimise(made_problem(Limits(mains_hz=50.0), **alike)).best_fixed_s == pytest.approx(0.01)
    assert program.best_fixed_s != 0.005


@pytest.mark.slow
def test_uncertainty(program: Program) -> None:
    assert number(program.low) < number(program.schedule.value) < number(program.high)
    assert 0 < number(program.regret_95) < 0.1
    few = optimise(made_problem(LIMITS, pictures=6))
    assert (few.low, few.high, few.regret_95) == (None, None, None)


def test_another_exposure_gains_no_more_than_is_open_of_the_difference() -> None:
    """Beside the program's exposure the surface is off as there: half a percent away nothing can be gained."""
    problem, times = made_problem(lights_lux=(30.0,)), [0.004, 0.00402]
    _, _, cov = problem.uncertain([30.0, 30.0], times)
    regret = regret_of(problem, problem.schedule(times[:1]), times, np.zeros((1, 2)))
    assert number(regret) < 0.25 * float(np.sqrt(cov[1, 1]))


def test_the_interval_stays_within_what_can_be_kept() -> None:
    """Pictures that all keep all: a picture nobody has seen may not, and none keeps more."""
    problem = made_problem(lights_lux=(30.0, 100.0))
    planes = {}
    for name, plane in problem.inputs.planes.items():
        all_kept = np.ones((24, len(plane.places)))
        planes[name] = Predicted(on_plane(plane.places, all_kept, all_kept))
    problem = replace(problem, inputs=replace(problem.inputs, planes=planes))
    low, high = interval_of(problem, problem.schedule([0.004, 0.002]))
    assert high == 1
    assert 0.7 < number(low) < 0.97


def test_departures_are_those_of_pictures_drawn_again() -> None:
    """Standard error by departures beside the bootstrap of the planes' own pictures, at the same nodes."""
    problem = made_problem()
    lights, times = [10.0, 50.0], [0.004, 0.002]
    _, influence, _ = problem.uncertain(lights, times)
    error = influence.std(axis=0, ddof=1) / np.sqrt(len(influence))
    generator = np.random.default_rng(0)
    drawn = []
    cases = problem.predicted(lights, times)
    for _ in range(400):
        weight = generator.multinomial(24, np.full(24, 1 / 24))[:, None]
        ratios = np.array([(sums * weight).sum(0) / (counts * weight).sum(0) for sums, counts in cases])
        drawn.append((problem.scenario.shares[:, None] * ratios).sum(0))
    # standard deviation of 400 draws is known to 1/sqrt(800) = 3.5 %; the jackknife exceeds the bootstrap by n/(n-1)
    assert error == pytest.approx(np.std(drawn, axis=0), rel=0.15)


@pytest.mark.slow
@pytest.mark.parametrize("objective", ["worst", "tail"])
def test_the_worst_is_better_served_by_its_own_program(program: Program, objective: str) -> None:
    careful = optimise(made_problem(LIMITS, objective=objective))
    assert number(careful.schedule.worst_speed) > number(program.schedule.worst_speed)
    assert number(careful.schedule.value) < number(program.schedule.value)


def test_whole_periods_at_every_light() -> None:
    made = optimise(made_problem(Limits(mains_hz=50.0)))
    periods = np.array(made.schedule.exposures_s) / 0.01
    assert np.abs(periods - periods.round()).max() < 1e-9
    stock = [name for name in made.baselines if name.startswith("libcamera")]
    assert stock
    assert all(name.endswith(", flickers") for name in stock)  # at times between whole periods


def test_reached_gain_is_shown() -> None:
    dark = optimise(made_problem(Limits(frame_rate_hz=200.0), lights_lux=(0.25, 0.5, 1.0, 8.0)))
    assert dark.schedule.lacks_gain[0]
    assert not dark.schedule.lacks_gain[-1]
    assert dark.schedule.gains_db[0] == METERING.camera.gain_max_db


def test_a_gain_limit_that_leaves_nothing_is_named_with_the_light() -> None:
    with pytest.raises(ValueError, match=r"lux = 2: no exposure is left.*30 frames/s.*gain up to 6 dB"):
        optimise(made_problem(Limits(gain_max_db=6.0)))


@pytest.mark.slow
def test_a_gain_limit_holds(program: Program) -> None:
    made = optimise(made_problem(Limits(gain_max_db=28.0)))
    assert max(made.schedule.gains_db) <= 28.01
    assert max(program.schedule.gains_db) > 30


@pytest.mark.slow
@pytest.mark.parametrize(
    ("more", "named"),
    [
        ({"lights_lux": (10.0, 2e6)}, r"lux = 2e\+06.*the run covers light x exposure 0.000488 to 8 lux s"),
        ({"lights_lux": (0.01, 10.0)}, r"lux = 0.01.*light x exposure"),
        ({"speeds_px_s": {0.0: 0.5, 1e7: 0.5}}, r"at 0, 1e\+07 px/s.*motion 0.5 to 64 px"),
    ],
)
def test_what_was_not_tested_is_refused_with_the_range(more: dict[str, object], named: str) -> None:
    with pytest.raises(ValueError, match=named):
        optimise(made_problem(Limits(frame_rate_hz=100.0), **more))  # type: ignore[arg-type]


def test_nothing_is_said_outside_the_range() -> None:
    _, objective = made_problem(lights_lux=(1e4,)).at([1e4], [0.01])
    assert np.isnan(objective).all()


SHORT = STOCK["libcamera imx296 short"]


@pytest.mark.parametrize(
    ("total_s", "time_s", "gain"),
    [
        (50e-6, 100e-6, 1.0),  # below the first stage nothing is shorter
        (3e-3, 3e-3, 1.0),  # time first
        (5e-3, 5e-3, 1.0),
        (8e-3, 5e-3, 1.6),  # then gain
        (10e-3, 5e-3, 2.0),
        (16e-3, 8e-3, 2.0),  # the next stage's time, at the present gain
        (30e-3, 10e-3, 3.0),
        (0.5, 62.5e-3, 8.0),
        (0.8, 66.666e-3, 0.8 / 66.666e-3),
        (5.0, 66.666e-3, 16.0),  # beyond the last nothing rises
    ],
)
def test_a_total_is_divided_up_in_stages(total_s: float, time_s: float, gain: float) -> None:
    assert SHORT.divided(total_s) == pytest.approx((time_s, gain), rel=1e-12)


def staged_ways(n_times: int, n_gains: int, most: int) -> dict[int, list[Stages]]:
    """Every way on the lattice by its number of stages; steps of one stop."""
    found: dict[int, list[Stages]] = {}
    for n in range(1, most + 1):
        for times in product(range(n_times), repeat=n):
            for gains in product(range(n_gains), repeat=n):
                if all(np.diff(times) >= 0) and all(np.diff(gains) >= 0):
                    way = (0, *times), (0, *gains)
                    stages = Stages(tuple(2.0**k for k in way[0]), tuple(2.0**k for k in way[1]))
                    found.setdefault(n, []).append(stages)
    return found


@pytest.mark.parametrize("seed", range(12))
def test_stages_equal_brute_force(seed: int) -> None:
    """4 times, gains 1 to 4, lights that ask for 1 to 64 times the first time: some reach the most gain."""
    generator = np.random.default_rng(seed)
    totals = [2.0**k for k in (6, 5, 4, 3, 2, 1, 0)]
    times = [1.0, 2.0, 4.0, 8.0]
    worth = generator.normal(size=(len(totals), len(times)))
    ways = staged_ways(len(times), 3, 3)
    found = best_stages(worth, totals, times, 4.0)
    for n in (1, 2, 3):
        of_stages = [
            sum(worth[k, times.index(way.divided(total)[0])] for k, total in enumerate(totals))
            for way in (way for m in range(1, n + 1) for way in ways[m])
            if all(way.divided(total)[0] in times for total in totals)
            and (way.divided(totals[0])[0] * way.divided(totals[0])[1] == totals[0] or way.gains[-1] == 4.0)
        ]
        got = found[min(n, len(found)) - 1][1]
        assert got == pytest.approx(max(of_stages), abs=1e-12), n


def test_worth_of_stages_is_what_they_do() -> None:
    generator = np.random.default_rng(3)
    totals = [2.0 ** (-k / 2) for k in range(22)]
    times = (2.0 ** (np.arange(-60, 1) / 8)).tolist()
    u = np.log2(totals)[:, None]
    worth = -((np.log2(times)[None] - 0.4 * u + 2) ** 2) + 0.01 * generator.normal(size=(22, 61))
    found = best_stages(worth, totals, times, 2.0**10)
    assert found[-1][1] == pytest.approx(best_path(worth, totals, times), abs=1e-9)
    assert all(a[1] <= b[1] + 1e-12 for a, b in pairwise(found))
    for n, (stages, reached) in enumerate(found, start=1):
        assert len(stages.gains) <= n + 1
        places = [
            int(np.argmin(np.abs(np.log2(stages.divided(total)[0] / np.array(times))))) for total in totals
        ]
        assert sum(worth[k, place] for k, place in enumerate(places)) == pytest.approx(reached, abs=1e-9)


def best_path(worth: np.ndarray, totals: list[float], times: list[float]) -> float:
    """With any number of stages, by another way: step by step of the total, each time or gain."""
    asked = np.maximum(np.rint(8 * np.log2(np.array(totals) / times[0])), 0).astype(int)
    best = {0: 0.0}  # by steps of time
    for step in range(max(asked) + 1):
        here = np.flatnonzero(asked == step)
        best = {i: total + worth[here, i].sum() for i, total in best.items()}
        if step < max(asked):
            risen = {i + 1: total for i, total in best.items() if i + 1 < len(times)}
            best = {i: max(best.get(i, -np.inf), risen.get(i, -np.inf)) for i in {*best, *risen}}
    return max(best.values())
