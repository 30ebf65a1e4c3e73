"""Programs made from planes that have a closed form: good, within limits, refused beyond what was tested."""

from itertools import pairwise, product

import numpy as np
import pytest
from blurnoise_eval.program.optimise import MOST_LOSS, STOCK, Stages, best_stages, optimise
from blurnoise_eval.program.scenario import ExposureLimits, half_stops
from made_planes import made_planes, made_problem

LIMITS = ExposureLimits(readout_s=0.003)


@pytest.fixture(scope="module")
def program():
    return optimise(made_problem(LIMITS))


def test_never_longer_in_more_light(program):
    for way in (program.schedule, program.best):
        assert all(a >= b * (1 - 1e-9) for a, b in pairwise(way.exposures_s))
        assert max(way.exposures_s) <= LIMITS.limit_s
    assert program.schedule.exposures_s[0] > 4 * program.schedule.exposures_s[-1]


def test_better_than_what_else_a_camera_may_do(program):
    ours = program.schedule.value
    assert ours <= program.best.value < ours + MOST_LOSS
    for name in ("best fixed time", *(f"{name}, to 30.3 ms" for name in STOCK)):
        (rival,) = [each for of, each in program.baselines.items() if of.startswith(name)]
        assert rival.value < ours - 0.005, name


def test_the_value_is_the_mean_of_what_the_planes_say(program):
    problem, planes = made_problem(), made_planes()
    place, light = 7, problem.scenario.lights_lux[7]
    time_s = program.schedule.exposures_s[place]
    expected = 0.0
    for speed, share in ((0.0, 0.3), (200.0, 0.5), (800.0, 0.2)):
        for plane in planes.values():
            sums, counts = plane.on([(np.log2(light * time_s), np.log2(max(speed * time_s, 0.5)))])
            expected += share / 2 * float(sums.sum() / counts.sum())
    assert program.schedule.values[place] == pytest.approx(expected, abs=1e-9)


def test_departures_are_those_of_pictures_drawn_again():
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


@pytest.mark.parametrize("how", [{"mains_hz": 50.0}, {"mains_hz": 60.0, "frame_rate_hz": 25.0}], ids=str)
def test_lamps_do_not_make_daylight_too_bright(how):
    """With whole periods at every light 20 000 lux got 10 ms, 6.3 stops too bright; lamps' light gets them."""
    limits = ExposureLimits(**how)
    found = optimise(
        made_problem(limits, lights_lux=half_stops(1.0, 20e3), speeds_px_s={0.0: 0.5, 800.0: 0.5})
    )
    for time_s, total_s in zip(found.schedule.exposures_s, found.problem.totals_s, strict=True):
        if total_s < limits.shortest_s:
            assert time_s == pytest.approx(total_s, rel=1e-6)
        else:
            assert limits.steady(time_s), total_s
    assert found.schedule.values[-1] > 0.9


def test_stages_end_at_whole_periods():
    """A stage that ended at 19.7 ms was printed as whole periods of 10 ms."""
    limits = ExposureLimits(mains_hz=50.0)
    for fast in (800.0, 200.0, 20.0):
        shares = {0.0: 0.5, fast: 0.5}
        found = optimise(made_problem(limits, lights_lux=half_stops(1.0, 20e3), speeds_px_s=shares))
        assert all(map(limits.steady, found.stages.times_s[1:])), found.stages
        assert found.stages.times_s[0] == limits.first_s


@pytest.mark.parametrize("fast", [50.0, 400.0, 1500.0])
@pytest.mark.parametrize("how", [{}, {"mains_hz": 50.0}, {"led": True}], ids=str)
def test_any_number_of_stages_is_never_worse(how, fast):
    found = optimise(made_problem(ExposureLimits(**how), speeds_px_s={0.0: 0.5, fast: 0.5}))
    assert found.best.value >= found.schedule.value


def test_a_gain_limit_that_leaves_nothing_is_named_with_the_light():
    with pytest.raises(ValueError, match=r"at 2 lux, no exposure.*30 frames/s.*gain up to 6 dB"):
        optimise(made_problem(ExposureLimits(gain_max_db=6.0)))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("more", "named"),
    [
        ({"lights_lux": (10.0, 2e6)}, r"at 2e\+06 lux.*the run covers light x exposure 0.000488 to 8 lux s"),
        ({"lights_lux": (0.01, 10.0)}, r"at 0.01 lux.*light x exposure"),
        ({"speeds_px_s": {0.0: 0.5, 1e7: 0.5}}, r"at 0, 1e\+07 px/s.*motion 0.5 to 64 px"),
    ],
)
def test_what_was_not_tested_is_refused_with_the_range(more, named):
    with pytest.raises(ValueError, match=named):
        optimise(made_problem(ExposureLimits(frame_rate_hz=100.0), **more))


def staged_ways(n_times, n_gains, most):
    """Every way on the lattice by its number of stages; steps of one stop."""
    found = {}
    for n in range(1, most + 1):
        for times in product(range(n_times), repeat=n):
            for gains in product(range(n_gains), repeat=n):
                if all(np.diff(times) >= 0) and all(np.diff(gains) >= 0):
                    way = (0, *times), (0, *gains)
                    stages = Stages(tuple(2.0**k for k in way[0]), tuple(2.0**k for k in way[1]))
                    found.setdefault(n, []).append(stages)
    return found


@pytest.mark.parametrize("seed", range(12))
def test_stages_equal_brute_force(seed):
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
