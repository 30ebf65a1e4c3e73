"""Scenarios: lights, shares, limits of exposures, metering, and what a run offers a program."""

import numpy as np
import pytest
from blurnoise_eval.plan.plan import SweepPlan
from blurnoise_eval.plan.question import Question
from blurnoise_eval.plan.typed import AUTOMATIC
from blurnoise_eval.program.problem import inputs_of
from blurnoise_eval.program.scenario import ExposureLimits, Metering, Scenario, between_lights, mean_light
from blurnoise_eval.run.evaluation import evaluate
from signs_in_memory import CAMERA, TWO, matched_detector

from blurnoise import photoelectrons
from blurnoise.scene.metering import USUAL


def scenario(**more):
    of = {"lights_lux": (1.0, 2.0), "speeds_px_s": {0.0: 3.0, 200.0: 5.0, 800.0: 2.0}, "targets": {"a": 1.0}}
    return Scenario(**{**of, **more})


def test_shares_add_up_to_one():
    two = scenario(targets={"a": 1.0, "b": 3.0})
    assert two.speeds_px_s == {0.0: 0.3, 200.0: 0.5, 800.0: 0.2}
    assert dict(zip(two.cases, two.shares, strict=True))[200.0, "b"] == pytest.approx(0.375)


@pytest.mark.parametrize(
    ("objective", "tail", "expected"),
    [
        ("expected", 0.2, 0.3 * 0.9 + 0.5 * 0.6 + 0.2 * 0.1),
        ("worst", 0.2, 0.1),
        ("tail", 0.1, 0.1),
        ("tail", 0.4, (0.2 * 0.1 + 0.2 * 0.6) / 0.4),
        ("tail", 1.0, 0.3 * 0.9 + 0.5 * 0.6 + 0.2 * 0.1),
    ],
)
def test_what_counts(objective, tail, expected):
    values = np.array([[0.9], [0.6], [0.1]])
    weights = scenario(objective=objective, tail=tail).weights(values)
    assert weights.sum() == pytest.approx(1.0)
    assert (weights * values).sum() == pytest.approx(expected)


@pytest.mark.parametrize(
    ("rules", "expected"),
    [
        ({"mains_hz": 50.0}, [10, 20, 30]),
        ({"mains_hz": 60.0}, [8.3333, 16.6667, 25, 33.3333]),
        ({"led": True, "mains_hz": 50.0}, [20, 30]),
    ],
)
def test_whole_periods(rules, expected):
    limits = ExposureLimits(**rules)
    times = limits.candidates(1e-4, 1.0)
    assert [round(1e3 * time, 4) for time in times if time >= limits.shortest_s] == expected
    assert min(times) == 1e-4  # for light in which a period is too bright


def test_lamps_that_flicker_whatever_one_does():
    """In light that asks for less than a period, and only there, shorter exposures are allowed."""
    limits = ExposureLimits(mains_hz=50.0)
    assert limits.avoidable(0.005, total_s=0.011)
    assert not limits.avoidable(0.005, total_s=0.009)
    assert limits.avoidable(0.015, total_s=0.2)
    assert not limits.avoidable(0.02, total_s=0.2)


def test_frames_leds_and_whole_lines():
    times = ExposureLimits(frame_rate_hz=50.0, readout_s=0.004).candidates(1e-3, 1.0)
    assert times[0] == 1e-3
    assert times[-1] == pytest.approx(0.016)
    assert np.diff(np.log2(times)).max() <= 1 / 8 + 1e-9
    line_s = 14.8e-6
    limits = ExposureLimits(row_time_s=line_s, led=True)
    lines = np.array(limits.candidates(1e-4, 1.0)) / line_s
    assert np.abs(lines - lines.round()).max() < 1e-6
    assert 1 / 90 <= limits.shortest_s < 1 / 90 + line_s


@pytest.mark.parametrize(
    ("rules", "named"),
    [
        (
            {"frame_rate_hz": 100.0, "readout_s": 0.002, "mains_hz": 50.0},
            r"50 Hz.*any light.*10 ms.*leaves 8 ms",
        ),
        ({"frame_rate_hz": 100.0, "led": True}, r"LEDs.*any light.*11.11 ms.*leaves 10 ms"),
        ({"frame_rate_hz": 60.0, "led": True, "mains_hz": 50.0}, r"50 Hz mains, LEDs.*20 ms"),
        ({"least_exposure_s": 0.0}, "least_exposure_s = 0"),
        ({"mains_hz": 55.0}, "mains_hz = 55"),
    ],
)
def test_rules_that_leave_nothing_are_named(rules, named):
    with pytest.raises(ValueError, match=named):
        ExposureLimits(**rules)


def test_time_and_gain_make_the_total():
    metering = Metering(CAMERA, 0.217)
    total_s = metering.total_s(10.0)
    for time_s in (0.001, 0.01, 0.1):
        gain = 10 ** (metering.gain_db(10.0, time_s) / 20)
        assert gain * time_s == pytest.approx(total_s, rel=2e-3)  # dark charge
    assert metering.gain_db(10.0, 10.0) == 0.0
    assert metering.gain_db(10.0, 1e-6) == CAMERA.sensor.gain_max_db


def test_mean_light_follows_from_gains():
    rows = []
    for image, light in {"a": 0.1, "b": 0.3}.items():
        for lux in (0.01, 10.0, 50.0, 1e5):  # at the first gain is at its most, at the last at none
            at = {"illuminance_lux": lux, "exposure_s": 0.005}
            gain_db = USUAL.setting(CAMERA, mean_light=light, **at).gain_db
            rows.append((image, lux, 0.005, gain_db))
    assert mean_light(rows, CAMERA) == pytest.approx(0.2, rel=1e-3)
    assert mean_light([row for row in rows if row[1] in (0.01, 1e5)], CAMERA) is None


def test_a_sweep_has_planes_for_its_lights_above_zero(tmp_path):
    grid = {"exposure_s": (0.008, 0.032), "illuminance_lux": (0.0, 2.0, 5.0), "velocity_x_px_s": (0.0, 200.0)}
    plan = SweepPlan(grid | {"velocity_y_px_s": (0.0,), "gain_db": (AUTOMATIC,)})
    question = Question(threshold=0.5)
    done = evaluate(matched_detector(tmp_path), TWO, CAMERA, plan, question, tmp_path, strategy="grid")
    found = inputs_of(done)
    asked = found.scenario
    assert (asked.lights_lux[0], asked.lights_lux[-1], found.exposures_s) == (2.0, 5.0, (0.008, 0.032))
    assert asked.speeds_px_s == {0.0: 0.5, 200.0: 0.5}
    assert found.recommended_s in (0.008, 0.032)
    # two exposures under two lights, at rest and moving, all at different places
    assert [len(plane.places) for plane in found.planes.values()] == [8] * len(found.planes)
    assert 0.05 < found.metering.mean_light < 0.9


def test_named_lights_are_a_range_of_one_spectrum():
    lights = between_lights("lit-street,street", "led-4000")
    assert (lights[0], lights[-1]) == pytest.approx((1.0, 20.0))
    with pytest.raises(ValueError, match="light = dusk: has D65; the run has led-4000"):
        between_lights("street,dusk", "led-4000")


def test_the_meter_counts_electrons_of_the_spectrum():
    """At equal lux low-pressure sodium gives imx250 fewer electrons, so that the meter asks for more time."""
    day, sodium = (Metering(CAMERA, 0.18, illuminant=name) for name in ("D55", "low-pressure-sodium"))
    electrons = [photoelectrons(CAMERA, 1.0, 1.0, name) for name in ("D55", "low-pressure-sodium")]
    assert sodium.total_s(100.0) / day.total_s(100.0) == pytest.approx(electrons[0] / electrons[1])
