"""Scenarios: lights, shares, and what counts of what can happen."""

from __future__ import annotations

import numpy as np
import pytest
from blurnoise_eval.program.scenario import Scenario, half_stops, speed_shares, target_shares


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
    assert speed_shares("0:0.3, 200:0.5,800:0.2", ()) == {0.0: 0.3, 200.0: 0.5, 800.0: 0.2}
    assert speed_shares("0,200", ()) == {0.0: 1.0, 200.0: 1.0}
    assert speed_shares(None, (0.0, 5.0)) == {0.0: 1.0, 5.0: 1.0}
    assert target_shares("large:3,medium:1", GROUPS) == {GROUPS[0]: 3.0, GROUPS[1]: 1.0}
    assert target_shares(None, GROUPS) == dict.fromkeys(GROUPS, 1.0)


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
        speed_shares(text, ())


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
