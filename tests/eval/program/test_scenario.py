"""Scenarios: lights, shares, what counts of what can happen; limits of exposures; and metering."""

from __future__ import annotations

import numpy as np
import pytest
from blurnoise_eval.program.scenario import (
    Limits,
    Metering,
    Scenario,
    half_stops,
    mean_light,
    speed_shares,
    target_shares,
)

from blurnoise.optics.camera import PRESETS
from blurnoise.scene.metering import USUAL

CAMERA = PRESETS["imx250"]


def scenario(**more: object) -> Scenario:
    of = {"lights_lux": (1.0, 2.0), "speeds_px_s": {0.0: 3.0, 200.0: 5.0, 800.0: 2.0}, "targets": {"a": 1.0}}
    return Scenario(**{**of, **more})  # type: ignore[arg-type]


def test_lights_are_half_a_stop_apart() -> None:
    lights = half_stops(1.0, 1450.0)
    assert len(lights) == 23
    assert (lights[0], lights[-1]) == (1.0, 1450.0)
    assert np.diff(np.log2(lights)) == pytest.approx(np.log2(1450.0) / 22)
    assert half_stops(1.0, 4.0) == pytest.approx([2 ** (step / 2) for step in range(5)])
    assert half_stops(2.0, 2.1) == (2.0, 2.1)
    assert half_stops(3.0, 3.0) == (3.0,)


def test_shares_add_up_to_one() -> None:
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
def test_what_counts(objective: str, tail: float, expected: float) -> None:
    values = np.array([[0.9], [0.6], [0.1]])
    weights = scenario(objective=objective, tail=tail).weights(values)
    assert weights.sum() == pytest.approx(1.0)
    assert (weights * values).sum() == pytest.approx(expected)


def test_what_is_not_known_in_one_case_is_not_known() -> None:
    assert np.isnan(scenario().weights(np.array([[0.9], [np.nan], [0.1]]))).all()


GROUPS = ["objects, large (> 96 px)", "objects, medium (32-96 px)"]


def test_shares_are_read() -> None:
    assert speed_shares("0:0.3, 200:0.5,800:0.2") == {0.0: 0.3, 200.0: 0.5, 800.0: 0.2}
    assert speed_shares("0,200") == {0.0: 1.0, 200.0: 1.0}
    assert target_shares("large:3,medium:1", GROUPS) == {GROUPS[0]: 3.0, GROUPS[1]: 1.0}


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("0:0.3,200", "a share for every entry, or for none"),
        ("0:0.3,200:0.2,200:0.5", "speeds = .*each entry once"),
        ("0:x", r"speeds = .*must be as 0:0.3,200:0.7"),
        ("fast", r"speeds = .*must be as 0:0.3,200:0.7"),
    ],
)
def test_shares_that_cannot_be_read_are_refused(text: str, named: str) -> None:
    with pytest.raises(ValueError, match=named):
        speed_shares(text)


@pytest.mark.parametrize(
    ("text", "named"),
    [("large,> 96", "targets = .*each entry once"), ("tiny", "'tiny'.*large"), ("px", "'px'.*large")],
)
def test_targets_are_named_by_part_of_their_name(text: str, named: str) -> None:
    with pytest.raises(ValueError, match=named):
        target_shares(text, GROUPS)


@pytest.mark.parametrize(
    "wrong",
    [
        {"lights_lux": ()},
        {"lights_lux": (2.0, 1.0)},
        {"speeds_px_s": {0.0: -1.0}},
        {"speeds_px_s": {0.0: 0.0}},
        {"tail": 0.0},
        {"objective": "best"},
    ],
)
def test_nonsense_is_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ValueError, match=next(iter(wrong)).partition("_")[0]):
        scenario(**wrong)


@pytest.mark.parametrize(
    ("rules", "expected"),
    [
        ({"mains_hz": 50.0}, [10, 20, 30]),
        ({"mains_hz": 60.0}, [8.3333, 16.6667, 25, 33.3333]),
        ({"led": True, "mains_hz": 50.0}, [20, 30]),
    ],
)
def test_whole_periods(rules: dict[str, float], expected: list[float]) -> None:
    assert [round(1e3 * time, 4) for time in Limits(**rules).candidates(1e-4, 1.0)] == expected


def test_frames_leds_and_whole_lines() -> None:
    times = Limits(frame_rate_hz=50.0, readout_s=0.004).candidates(1e-3, 1.0)
    assert times[0] == 1e-3
    assert times[-1] == pytest.approx(0.016)
    assert np.diff(np.log2(times)).max() <= 1 / 8 + 1e-9
    line_s = 14.8e-6
    lines = np.array(Limits(row_time_s=line_s, led=True).candidates(1e-4, 1.0)) / line_s
    assert np.abs(lines - lines.round()).max() < 1e-6
    assert 1 / 90 <= lines.min() * line_s < 1 / 90 + line_s


def test_settles_on_what_is_allowed_and_not_longer() -> None:
    limits = Limits(mains_hz=50.0)
    assert limits.settled(0.029) == pytest.approx(0.02)
    assert limits.settled(0.003) == pytest.approx(0.01)  # the shortest there is
    assert limits.settled(0.2) == pytest.approx(0.03)


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
def test_rules_that_leave_nothing_are_named(rules: dict[str, float], named: str) -> None:
    with pytest.raises(ValueError, match=named):
        Limits(**rules)


def test_time_and_gain_make_the_total() -> None:
    metering = Metering(CAMERA, 0.217)
    total_s = metering.total_s(10.0)
    for time_s in (0.001, 0.01, 0.1):
        gain = 10 ** (metering.gain_db(10.0, time_s) / 20)
        assert gain * time_s == pytest.approx(total_s, rel=2e-3)  # dark charge
    assert metering.gain_db(10.0, 10.0) == 0.0
    assert metering.gain_db(10.0, 1e-6) == CAMERA.gain_max_db


def test_mean_light_follows_from_gains() -> None:
    rows = []
    for image, light in {"a": 0.1, "b": 0.3}.items():
        for lux in (0.01, 10.0, 50.0, 1e5):  # at the first gain is at its most, at the last at none
            at = {"illuminance_lux": lux, "exposure_s": 0.005}
            gain_db = USUAL.setting(CAMERA, mean_light=light, **at).gain_db
            rows.append({"image": image, "applied_gain_db": gain_db, **at})
    assert mean_light(rows, CAMERA) == pytest.approx(0.2, rel=1e-3)
    assert mean_light([row for row in rows if row["illuminance_lux"] in (0.01, 1e5)], CAMERA) is None
