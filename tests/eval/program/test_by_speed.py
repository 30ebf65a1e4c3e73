"""Programs of runs in which lux times seconds is not one axis: rolling shutters, kinds of light, ego-motion."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from blurnoise_eval.plan.plan import SweepPlan
from blurnoise_eval.plan.question import Question
from blurnoise_eval.program.by_speed import BySpeed, places_at, speeds_of
from blurnoise_eval.program.metering_by_light import MeteringByLight
from blurnoise_eval.program.optimise import optimise
from blurnoise_eval.program.problem import Problem, inputs_of
from blurnoise_eval.program.scenario import ExposureLimits, Metering
from blurnoise_eval.run.evaluation import evaluate
from blurnoise_eval.run.surface import Predicted, Trend
from blurnoise_eval.scoring.uncertainty import ratio_of_sums
from signs_in_memory import CAMERA, matched_detector, picture, picture_set, sign

from blurnoise import Camera

SKEWING = CAMERA.with_figures(row_time_s=5e-5, shutter="rolling")
SPEEDS = (0.0, 300.0)
TIMES_S = tuple(np.geomspace(0.002, 0.032, 9).tolist())


def speckled(index):
    return (sign().astype(np.int64) * (12 + index) // 24).astype(np.uint8)


TEN = picture_set(*(picture(f"{index}.png", partial(speckled, index)) for index in range(10)))


def run_of(folder, camera, settings, pictures=TEN):
    plan = replace(SweepPlan.of(settings), examples=False)
    question = Question(threshold=0.5)
    return evaluate(matched_detector(folder), pictures, camera, plan, question, folder, strategy="grid")


@pytest.fixture(scope="module")
def skewed(tmp_path_factory):
    """A sweep with a rolling shutter, moving and at rest."""
    times = ",".join(f"{1e3 * time:g}" for time in TIMES_S)
    settings = {"exposure_ms": times, "lux": "5,20", "dx": "0,300"}
    return run_of(tmp_path_factory.mktemp("skewed"), SKEWING, settings)


def program_of(run, **more):
    inputs = inputs_of(run)
    own = inputs.scenario
    return optimise(Problem(inputs, replace(own, **more) if more else own, ExposureLimits()))


def test_a_rolling_shutter_has_a_program(skewed):
    found = inputs_of(skewed)
    assert all(
        isinstance(plane, BySpeed) and tuple(plane.surfaces) == SPEEDS for plane in found.planes.values()
    )
    alone, between = found.notes
    assert "rolling shutter depends on the exposure time alone" in alone
    assert between.startswith("between 5 and 20 lux (no third of their kind) nothing was measured")
    program = program_of(skewed)
    assert program.low <= program.schedule.value <= program.high
    assert program.schedule.value >= max(each.value or 0.0 for each in program.baselines.values()) - 0.002


def test_a_run_that_was_stopped_is_said_to_be_unfinished(skewed, monkeypatch):
    monkeypatch.setattr(type(skewed.setup), "missing_cells", lambda setup, store: 3)
    assert inputs_of(skewed).notes[0].startswith("The run is not finished: 3 cells missing.")


def test_a_part_of_a_grid_is_completed_by_a_sweep(skewed):
    inputs = replace(inputs_of(skewed), search="run")
    problem = Problem(inputs, inputs.scenario, ExposureLimits())
    said = r"too few conditions of its grid .* at 5 lux; 'blurnoise sweep' .* -o run"
    with pytest.raises(ValueError, match=said):
        raise problem.nothing_left([5.0])


def test_a_run_in_which_next_to_nothing_was_found_has_no_program(skewed, monkeypatch):
    nothing = [replace(table, sums=0.04 * table.counts) for table in skewed.score_tables()]
    monkeypatch.setattr(skewed, "score_tables", lambda: nothing)
    with pytest.raises(
        ValueError, match=r"next to nothing was found at any exposure \(.* at most 0.040\), so that none"
    ):
        inputs_of(skewed)


def test_tested_conditions_have_their_scores(skewed):
    """But for the surface's nugget, what a condition departs by from its neighbours."""
    problem = Problem(inputs_of(skewed), inputs_of(skewed).scenario, ExposureLimits())
    (target,) = problem.scenario.targets
    (table,) = [each for each in skewed.score_tables() if each.group == target]
    for number, speed in enumerate(SPEEDS):
        own = table.take(speeds_of(table) == speed)
        cases, _ = problem.at(own.conditions["illuminance_lux"], own.conditions["exposure_s"])
        assert cases[number] == pytest.approx(own.mean, abs=0.02)


def held_back(run, axis):
    """Which scores of every other exposure or light lie within the interval that their neighbours predict: that of
    the surface alone, as its pictures are those of the scores."""
    within = []
    for table in run.score_tables():
        if table.reference_too_low:
            continue
        known = table.take(np.isin(table.conditions[axis], run.plan.values(axis)[::2]))
        held = table.take(np.isin(table.conditions[axis], run.plan.values(axis)[1::2]))
        known = BySpeed.of(known, Trend.of(run.camera))
        for speed, surface in known.surfaces.items():
            own = held.take(speeds_of(held) == speed)
            places = known.places(own.conditions["exposure_s"], own.conditions["illuminance_lux"], speed)
            error = ratio_of_sums(*surface.on(places)) - own.mean
            sigma = np.sqrt(np.diag(known.covariance(speed, places)))
            within += (abs(error) <= 1.96 * sigma + 1e-9).tolist()
    return within


def test_held_back_exposures_lie_within_the_interval(skewed):
    within = held_back(skewed, "exposure_s")
    assert len(within) == 16
    assert sum(within) >= 14  # of 16 at 95 %: fewer in 4 %


@pytest.mark.slow
@pytest.mark.parametrize("camera", ["imx477", "imx219", "ar0132c"])
def test_held_back_scores_of_cameras_lie_within_the_interval(tmp_path, camera):
    """The built-in detector on 20 rendered pictures; the exposures that stay are a stop apart, the lights 3.3."""
    times = "0.25,0.354,0.5,0.707,1,1.41,2,2.83,4,5.66,8,11.3,16,22.6,32"
    settings = {"exposure_ms": times, "lux": "1,3.16,10,31.6,100,316,1000", "dx": "0,1000"}
    plan = replace(SweepPlan.of(settings), examples=False)
    run = evaluate(plan=plan, camera=camera, output=tmp_path, strategy="grid", progress=False)
    for axis in ("exposure_s", "illuminance_lux"):
        assert np.mean(held_back(run, axis)) >= 0.93, axis


def test_short_exposures_of_a_speed_have_places_of_their_own():
    """On the plane both lie on its floor, with pictures at rest."""
    short, shorter = places_at([1e-4, 1e-5], [10.0, 100.0], 300.0)
    assert short[1] - shorter[1] == pytest.approx(np.log2(10.0))


def test_a_plateau_is_surer_than_a_cliff(skewed):
    """Scores alike around a place make it surer than scores that differ, at the same distance from the nodes."""
    (table,) = [each for each in skewed.score_tables() if not each.reference_too_low]
    steps = np.where(table.conditions["exposure_s"] < 0.006, 0.1, 0.9)
    stepped = replace(table, sums=steps * table.counts)
    known = BySpeed.of(stepped, Trend.of(SKEWING))
    middles = np.sqrt(np.array(TIMES_S[:-1]) * TIMES_S[1:])
    places = known.places(middles, 5.0, 0.0)
    sigma = np.sqrt(np.diag(known.covariance(0.0, places)))
    assert sigma.argmax() == np.searchsorted(TIMES_S, 0.006) - 1
    assert sigma.max() > 2 * sigma[-2]


def test_other_speeds_are_refused_with_those_tested(skewed):
    with pytest.raises(ValueError, match=r"speeds = 200: was not tested; must be one of 0, 300"):
        program_of(skewed, speeds_px_s={200.0: 1.0})


def test_untested_light_is_refused_with_lights_and_exposures(skewed):
    with pytest.raises(ValueError, match=r"at 0.01 lux, no exposure.*exposures 2 to 32 ms"):
        program_of(skewed, lights_lux=(0.01, 5.0))


@pytest.mark.parametrize("camera", ["imx477", "imx219"])
def test_at_rest_a_rolling_shutter_is_on_the_plane(tmp_path, camera):
    run = run_of(tmp_path, Camera.preset(camera), {"exposure_ms": "4,16", "lux": "2,8", "dx": "0"})
    found = inputs_of(run)
    assert all(isinstance(plane, Predicted) for plane in found.planes.values())
    assert found.notes[0].startswith(
        "scores are read off lux x seconds and motion in px: in 1 pair of equal ones"
    )


def test_named_lights_have_a_program_that_says_where_it_interpolates(tmp_path):
    settings = {"exposure_ms": "0.1,1,10,30", "light": "street,lit-street,daylight", "dx": "0,300"}
    run = run_of(tmp_path, CAMERA, settings)
    found = inputs_of(run)
    assert isinstance(found.metering, MeteringByLight)
    between = next(note for note in found.notes if note.startswith("between"))
    assert "between 20 and 20000 lux (lit-street, daylight, of other spectrum or headlamps)" in between
    assert "(street, lit-street, no third of their kind) nothing was measured" not in between
    program = program_of(run)
    assert program.schedule.exposures_s[-1] < program.schedule.exposures_s[0]
    assert None not in program.schedule.values


def test_speeds_of_a_vehicle_are_in_km_h(tmp_path):
    settings = {"exposure_ms": "2,8,32", "lux": "2,8", "ego_kmh": "0,36"}
    run = run_of(tmp_path, CAMERA, settings)
    scenario = inputs_of(run).scenario
    assert (scenario.speeds_px_s, scenario.speed_unit) == ({0.0: 0.5, 36.0: 0.5}, "km/h")
    assert program_of(run).problem.scenario.text.startswith("0 km/h (0.5), 36 km/h (0.5)")


@pytest.mark.parametrize(
    ("settings", "reason"),
    [
        ({"f_number": "2,4"}, "f-number has several values"),
        ({"exposure_ms": "8"}, "there is one exposure"),
        ({"exposure_ms": "auto"}, "the camera sets the exposure itself"),
    ],
)
def test_runs_without_a_program_are_named(tmp_path, settings, reason):
    run = run_of(tmp_path, CAMERA, {"exposure_ms": "4,16", "lux": "2,8", "dx": "0"} | settings)
    with pytest.raises(ValueError, match=f"(?i)cannot give a program: {reason}"):
        inputs_of(run)


def test_brighter_pictures_of_a_light_ask_for_less():
    """Headlamps treble what 1 lux gives; the gains show it."""
    base = Metering(CAMERA, 0.18)
    rows = []
    for lux, mean in ((1.0, 0.6), (100.0, 0.2)):
        time_s = 0.2 / lux  # leaves some gain, and not the most
        rows += [("a", lux, time_s, Metering(CAMERA, mean).gain_db(lux, time_s))]
    metering = MeteringByLight.of(rows, base)
    for lux, mean in ((1.0, 0.6), (10.0, (0.6 * 0.2) ** 0.5), (100.0, 0.2), (1000.0, 0.2)):
        assert metering.total_s(lux) == pytest.approx(Metering(CAMERA, mean).total_s(lux), rel=1e-3)
    assert metering.lux_at(1e-4) == pytest.approx(Metering(CAMERA, 0.2).lux_at(1e-4), rel=1e-3)


def test_motion_in_several_directions_is_a_mean(tmp_path):
    settings = {"exposure_ms": "4,16", "lux": "2,8", "dx": "0,300", "dy": "0,300"}
    run = run_of(tmp_path, CAMERA, settings)
    (known,) = inputs_of(run).planes.values()
    assert tuple(known.surfaces) == pytest.approx((0.0, 300.0, 300 * 2**0.5))
    (table,) = [each for each in run.score_tables() if not each.reference_too_low]
    fast = table.take(speeds_of(table) == 300.0)
    place = known.places([0.004], [2.0], 300.0)
    same = (fast.conditions["exposure_s"] == 0.004) & (fast.conditions["illuminance_lux"] == 2.0)
    assert same.sum() == 2
    assert ratio_of_sums(*known.surface(300.0).on(place))[0] == pytest.approx(
        fast.mean[same].mean(), abs=0.02
    )
