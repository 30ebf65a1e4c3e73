"""Intervals in gaps between lights and exposures that are wider than what was held back, of made-up scores."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from blurnoise_eval.datasets.coco_labels import coco
from blurnoise_eval.plan.plan import SweepPlan
from blurnoise_eval.program.by_speed import BySpeed
from blurnoise_eval.program.grounds import unmeasured
from blurnoise_eval.program.held_back import spread_around
from blurnoise_eval.program.limit import best_limit
from blurnoise_eval.program.optimise import optimise
from blurnoise_eval.program.problem import Problem
from blurnoise_eval.program.scenario import Scenario, half_stops
from blurnoise_eval.run.evaluation import evaluate
from blurnoise_eval.run.surface import Trend
from blurnoise_eval.scoring.uncertainty import ratio_of_sums
from made_planes import made_problem
from made_tables import table

REAL = Path(__file__).parents[4] / "shared" / "real"
TIMES_S = 0.001 * 2.0 ** np.arange(-2.0, 6.0)
FEW = "fewer than 19 scores could be held back over so wide a gap"


def scores_of(generator):
    """Of 30 pictures, each lost in the dark, in motion and when washed out, at places of its own; in the dark it goes
    up and down with light and time. A function of exposures (N,), lights (N,) and a speed, (30, N)."""
    dark, blur = (
        generator.normal(generator.uniform(-8, -3), 0.8, (30, 1)),
        generator.normal(generator.uniform(1, 5), 0.7, (30, 1)),
    )
    full, steep = generator.normal(generator.uniform(2, 8), 0.5, (30, 1)), generator.uniform(1, 4)
    height, light_stops, time_stops, phase = generator.uniform((0.2, 3, 3, 0), (1, 12, 12, 6))

    def scores(times_s, lights, speed):
        wave = np.sin(2 * np.pi * (np.log2(lights) / light_stops + np.log2(times_s) / time_stops) + phase)
        light = np.log2(times_s * lights) + height * wave
        moved = 1 + 4.0 ** (np.log2(times_s * max(speed, 1e-3)) - blur)
        return 1 / (1 + np.exp(-steep * (light - dark))) / moved / (1 + np.exp(2 * (light - full)))

    return scores


def known_of(scores, times_s, lights, speeds=(0.0, 600.0), kinds=None):
    """Of every exposure under each light at each speed. kinds: spectra by number, of each light."""
    speed, lux, time = (each.ravel() for each in np.meshgrid(speeds, lights, times_s, indexing="ij"))
    sums = np.concatenate([scores(time[speed == each], lux[speed == each], each) for each in speeds], axis=1)
    made = table(sums[:, :, None], np.ones(len(time)))
    spectrum = np.repeat(kinds, len(times_s)) if kinds else np.zeros(len(lights) * len(times_s))
    made.conditions["illuminant"][:] = np.tile(spectrum, len(speeds))
    made.conditions["exposure_s"][:], made.conditions["illuminance_lux"][:] = time, lux
    made.conditions["velocity_x_px_s"][:] = speed
    return BySpeed.of(made, Trend())


def within(known, scores, times_s, lights, speed):
    """Which of these lie within 1.96 sigma, but for what three decimals do not show, (N,)."""
    places = known.places(times_s, lights, speed)
    sigma = np.sqrt(np.diag(known.covariance(speed, places)))
    error = ratio_of_sums(*known.surface(speed).on(places)) - scores(times_s, lights, speed).mean(axis=0)
    return np.abs(error) <= 1.96 * sigma + 1e-3


def around(known, times_s, lights, speed):
    """The spread of the scores around."""
    places, surface = known.places(times_s, lights, speed), known.surface(speed)
    return spread_around(surface.surface, places, ratio_of_sums(*surface.on(places)))


@pytest.fixture(scope="module")
def uneven():
    return known_of(scores_of(np.random.default_rng(1)), TIMES_S, (11.7, 21.0, 38.0, 2352.0))


def test_a_gap_of_lights_wider_than_any_that_was_held_back_is_unknown(uneven):
    assert uneven.unknown == [(38.0, 2352.0)]
    assert unmeasured([uneven], ()) == [
        f"between 38 and 2352 lux ({FEW}) nothing was measured: exposures, gains and scores go from one light to the "
        "other, and intervals are as wide as the scores around differ"
    ]


def test_there_the_interval_is_as_wide_as_the_scores_around_differ(uneven):
    times_s, lights = np.full(3, 0.0013), np.array([30.0, 100.0, 1000.0])
    sigma = np.sqrt(np.diag(uneven.covariance(600.0, uneven.places(times_s, lights, 600.0))))
    narrow, *wide = sigma / around(uneven, times_s, lights, 600.0)
    assert wide == pytest.approx([1.0, 1.0])
    assert narrow < 0.8


def test_a_gap_of_exposures_wider_than_any_that_was_held_back_is_unknown():
    times_s = (*TIMES_S[:5], 0.064)
    known = known_of(scores_of(np.random.default_rng(1)), times_s, (1.0, 10.0, 100.0, 1000.0))
    assert known.unknown_s == [pytest.approx((0.004, 0.064))] * len(known.unknown_s) != []
    (note,) = unmeasured([known], ())
    assert note.startswith(f"between 4 and 64 ms ({FEW}) nothing was measured: scores go from one exposure")
    shares = known.held_back.shares_at(known.places([0.003, 0.01], 10.0, 0.0), known.surface(0.0).places)
    assert shares[0] < shares[1] == 1.0


def test_of_one_light_and_four_exposures_every_gap_is_said_to_be_unknown():
    known = known_of(scores_of(np.random.default_rng(1)), TIMES_S[2:6], (50.0,))
    (note,) = unmeasured([known], ())
    assert note.startswith(f"between 1 and 8 ms ({FEW}) nothing was measured")


def test_nearly_equal_lights_exposures_and_speeds_count_once():
    scores = scores_of(np.random.default_rng(1))
    lights = (100.0, 100.0001, 100.001, 100.01, 1000.0)
    known = known_of(scores, (*TIMES_S[:3], *(1.001 * TIMES_S[:3])), lights, (600.0, 600.01))
    assert [*known.kinds] == [100.0, 1000.0]
    assert known.unknown == [(100.0, 1000.0)]
    assert len(known.surface(600.0).places) == 2 * 3
    assert len(known.held_back.exposures.stops) == 2


def test_nearly_equal_lights_of_two_spectra_are_two():
    known = known_of(
        scores_of(np.random.default_rng(1)), TIMES_S[:3], (100.0, 101.0, 200.0), kinds=(0.0, 1.0, 1.0)
    )
    assert [*known.kinds] == [100.0, 101.0, 200.0]


def test_between_lights_of_several_kinds_a_score_may_be_any_of_those_around():
    scores, lights = scores_of(np.random.default_rng(1)), (1.0, 4.0, 20.0, 100.0, 1000.0)
    known = known_of(scores, TIMES_S, lights, kinds=(0.0, 0.0, 0.0, 0.0, 1.0))
    assert known.unknown == [(100.0, 1000.0)]
    between = np.array([4.0, 10.0, 100.0, 300.0, 1000.0])
    times_s = np.full(5, 0.0013)
    sigma = np.sqrt(np.diag(known.covariance(600.0, known.places(times_s, between, 600.0))))
    shares = sigma / around(known, times_s, between, 600.0)
    assert shares[3] == pytest.approx(1.0)
    assert max(shares[[0, 1, 2, 4]]) < 0.9


@pytest.mark.parametrize("compute", [optimise, best_limit])
def test_where_the_metering_wants_shorter_exposures_than_tested_the_brightest_light_is_named(compute):
    lights = (100.0, 1000.0, 10000.0)
    known = known_of(scores_of(np.random.default_rng(1)), TIMES_S[3:6], lights, (0.0,))
    scenario = Scenario(half_stops(100.0, 10000.0), {0.0: 1.0}, {"sign": 1.0})
    problem = made_problem()
    inputs = replace(problem.inputs, planes={"sign": known}, scenario=scenario, exposures_s=(0.002, 0.008))
    with pytest.raises(ValueError, match=r"^lux: test shorter exposures: at 10000 lux .* 0.14 ms, .* 2 ms$"):
        compute(Problem(inputs, scenario, problem.limits))


@pytest.mark.slow
@pytest.mark.parametrize("even", [True, False])
def test_of_made_up_scores_95_percent_lie_within_the_interval(even):
    """On 60 grids of 4 to 6 lights and 5 to 12 exposures: in even steps, or in the last of random ones, which is
    eight times as wide."""
    inside = []
    for seed in range(60):
        generator = np.random.default_rng(seed)
        scores, axes, ends = scores_of(generator), [], []
        for low, stops, number in (
            (1.0, 11.5, generator.integers(4, 7)),
            (1e-4, 8.3, generator.integers(5, 13)),
        ):
            steps = np.ones(number - 1) if even else generator.uniform(0.5, 1.0, number - 1)
            steps[-1] *= 1 if even else 8
            axes.append(low * 2.0 ** np.append(0.0, stops * np.cumsum(steps) / steps.sum()))
            ends.append(np.log(axes[-1][[0 if even else -2, -1]]))
        known = known_of(scores, axes[1], axes[0])
        for speed in known.surfaces:
            lights, times_s = (np.exp(generator.uniform(*end, 30)) for end in ends)
            inside += within(known, scores, times_s, lights, speed).tolist()
    assert np.mean(inside) >= 0.94


def halves(table):
    """A table at every other exposure and light, and what of the rest lies between these."""
    times_s, lights = (np.unique(table.conditions[name]) for name in ("exposure_s", "illuminance_lux"))
    at_time = np.isin(table.conditions["exposure_s"], times_s[::2])
    kept = at_time & np.isin(table.conditions["illuminance_lux"], lights[::2])
    return table.take(kept), table.take(~kept & (table.conditions["exposure_s"] <= times_s[::2].max()))


def covered(table, trend):
    """Which of the scores that are held back lie within the interval, but for what three decimals do not show."""
    known, unseen = halves(table)
    surfaces = BySpeed.of(known, trend)
    for speed in np.unique(unseen.speeds_px_s):
        here = unseen.take(unseen.speeds_px_s == speed)
        places = surfaces.places(here.conditions["exposure_s"], here.conditions["illuminance_lux"], speed)
        sigma = np.sqrt(np.diag(surfaces.covariance(speed, places)))
        error = ratio_of_sums(*surfaces.surface(speed).on(places)) - here.mean
        yield from (np.abs(error) <= 1.96 * sigma + 1e-3).tolist()


@pytest.mark.slow
@pytest.mark.skipif(not (REAL / "models").is_dir(), reason="the shared photographs are absent")
@pytest.mark.parametrize("camera", ["imx477", "imx219", "ar0132c"])
def test_of_photographs_nine_in_ten_lie_within_the_interval(camera, tmp_path):
    """16 photographs, two real detectors, rolling shutters; exposures half a stop and lights 1.7 stops apart."""
    conditions = {
        "exposure_ms": [float(f"{0.25 * 2 ** (k / 2):.4g}") for k in range(15)],
        "lux": [1, 3.16, 10, 31.6, 100, 316, 1000],
        "dx": [0, 600],
    }
    models = [REAL / "models" / f"{name}.onnx" for name in ("yolox_nano", "fastestdet_upstream")]
    every, plan = coco(REAL / "photos" / "instances.json"), SweepPlan.of(conditions)
    photographs = replace(every, pictures=every.pictures[:16])
    run = evaluate(models, photographs, camera, plan, output=tmp_path / "run", strategy="grid")
    for model in run.setup.models:
        tables = [table for table in run.tables_with_answers() if table.model == model]
        inside = [each for table in tables for each in covered(table, Trend.of(run.camera))]
        print(f"{camera}, {model}: {np.mean(inside):.3f} of {len(inside)}")
        assert np.mean(inside) >= 0.9
