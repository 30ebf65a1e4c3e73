"""Scenarios: lights, shares, and what counts of what can happen."""

from __future__ import annotations

import numpy as np
import pytest
from blurnoise_eval.program.scenario import (
    Scenario,
    chosen_targets,
    half_stops,
    named_shares,
    scaled_note,
)


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


def test_targets_are_found_by_part_of_their_name() -> None:
    groups = ["objects, large (> 96 px)", "objects, medium (32-96 px)"]
    assert chosen_targets("large:3,medium:1", groups) == {groups[0]: 3.0, groups[1]: 1.0}
    with pytest.raises(ValueError, match=r"targets: objects, large.* is given twice"):
        chosen_targets("large,> 96", groups)
    assert chosen_targets(None, groups) == dict.fromkeys(groups, 1.0)
    for word in ("tiny", "px"):
        with pytest.raises(ValueError, match=f"targets = '{word}'.*large"):
            chosen_targets(word, groups)


def test_shares_are_read() -> None:
    assert named_shares("speeds", "0:0.3, 200:0.5,800:1") == {"0": 0.3, "200": 0.5, "800": 1.0}
    assert named_shares("speeds", "0,200") == {"0": 1.0, "200": 1.0}
    with pytest.raises(ValueError, match="a share for every entry, or for none"):
        named_shares("speeds", "0:0.3,200")
    with pytest.raises(ValueError, match="speeds: 200 is given twice"):
        named_shares("speeds", "0:0.3,200:0.2,200:0.5")
    with pytest.raises(ValueError, match="speeds"):
        named_shares("speeds", "0:x")


def test_shares_that_are_scaled_are_named() -> None:
    assert scaled_note("speeds", "0:3,200:5,800:2") == [
        "speeds: shares add up to 10; each was divided by that"
    ]
    for text in (None, "0,200,800", "0:0.3,200:0.6,800:0.1"):
        assert scaled_note("speeds", text) == []


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
