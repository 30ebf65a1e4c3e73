"""Plans are checked where they are made, and choose examples from end to end."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from blurnoise_eval.grid.conditions import Plan

PLAN = Plan((0.002, 0.03), (3.0, 333.3), (0.0, 333.3), (0.0, -77.1), repeats=2)


def test_plan_sorts_and_drops_doubles() -> None:
    plan = Plan((0.02, 0.01, 0.02), (5, 1))
    assert plan.exposures_s == (0.01, 0.02)
    assert plan.illuminances_lux == (1.0, 5.0)
    assert len(plan.conditions()) == 4


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"exposures_s": (0.0,)}, "exposure_s"),
        ({"exposures_s": (-1.0,)}, "exposure_s"),
        ({"exposures_s": (float("nan"),)}, "exposure_s"),
        ({"exposures_s": ()}, "exposures_s"),
        ({"illuminances_lux": (-1.0,)}, "illuminance_lux"),
        ({"velocities_x_px_s": (float("inf"),)}, "velocity"),
        ({"velocities_y_px_s": (float("nan"),)}, "velocity"),
        ({"repeats": 0}, "repeats"),
        ({"seed": -1}, "seed"),
        ({"temperature_c": float("nan")}, "temperature_c"),
    ],
)
def test_bad_plans_are_refused(changes: dict[str, Any], named: str) -> None:
    with pytest.raises(ValueError, match=named):
        replace(PLAN, **changes)


def test_examples_reach_from_end_to_end() -> None:
    plan = Plan(tuple(0.001 * n for n in range(1, 11)), (1, 2, 3), (-500, 0, 200))
    chosen = plan.example_conditions()
    assert {at.exposure_s for at in chosen} >= {plan.exposures_s[0], plan.exposures_s[-1]}
    assert {at.velocity_x_px_s for at in chosen} == {-500, 0, 200}
    assert {at.illuminance_lux for at in chosen} == {2}
    assert chosen <= set(plan.conditions())
