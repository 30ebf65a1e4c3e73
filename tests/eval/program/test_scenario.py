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


def test_targets_are_found_by_part_of_their_name() -> None:
    groups = ["objects, large (> 96 px)", "objects, medium (32-96 px)"]
    assert target_shares("large:3,medium:1", groups)[0] == {groups[0]: 3.0, groups[1]: 1.0}
    with pytest.raises(ValueError, match=r"targets: objects, large.* is given twice"):
        target_shares("large,> 96", groups)
    assert target_shares(None, groups) == (dict.fromkeys(groups, 1.0), [])
    for word in ("tiny", "px"):
        with pytest.raises(ValueError, match=f"targets = '{word}'.*large"):
            target_shares(word, groups)


def test_shares_are_read() -> None:
    assert speed_shares("0:0.3, 200:0.5,800:0.2", ()) == ({0.0: 0.3, 200.0: 0.5, 800.0: 0.2}, [])
    assert speed_shares("0,200", ()) == ({0.0: 1.0, 200.0: 1.0}, [])
    assert speed_shares(None, (0.0, 5.0)) == ({0.0: 1.0, 5.0: 1.0}, [])
    with pytest.raises(ValueError, match="a share for every entry, or for none"):
        speed_shares("0:0.3,200", ())
    with pytest.raises(ValueError, match=r"speeds: 200\.0 is given twice"):
        speed_shares("0:0.3,200:0.2,200:0.5", ())
    for wrong in ("0:x", "fast"):
        with pytest.raises(ValueError, match=r"speeds = .*must be as 0:0.3,200:0.7"):
            speed_shares(wrong, ())


def test_shares_that_are_scaled_are_named() -> None:
    _, notes = speed_shares("0:3,200:5,800:2", ())
    assert notes == ["speeds: shares add up to 10; each was divided by that"]


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
