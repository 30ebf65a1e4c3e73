"""Nodes: which conditions are one experiment, and the scores there."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from blurnoise_eval.maps.nodes import nodes_at, nodes_of
from blurnoise_eval.store.store import StoreError
from made_maps import plane, row
from made_tables import table
from plans import IMX250


def nodes(*rows: dict[str, Any], planned: tuple[str, ...] = (), **figures: float) -> int:
    return len(nodes_at(rows, replace(IMX250, **figures), planned))  # type: ignore[arg-type]


def test_equal_light_and_motion_are_one_experiment() -> None:
    found = nodes_at([row(0.01, 50.0, 300.0), row(0.02, 25.0, 150.0), row(0.02, 25.0)], IMX250, ())
    assert list(found.node_at.values()) == [0, 0, 1]
    assert found.places[:, 0] == pytest.approx([-1, -1])
    assert found.places[:, 1] == pytest.approx([np.log2(3), -1])  # at rest: half a pixel
    assert {name: values[0] for name, values in found.figures.items()} == pytest.approx(
        {"light_lux_s": 0.5, "blur_px": 3.0, "gain_db": 0.0}
    )


PAIR = row(0.01, 50.0), row(0.05, 10.0)


@pytest.mark.parametrize(
    ("rows", "expected"),
    [
        ((row(0.01, 50.0, 300.0), row(0.01, 50.0, -300.0), row(0.01, 50.0, -300.0, -0.0)), 1),
        ((row(0.01, 50.0, 300.0), row(0.01, 50.0, 0.0, 300.0)), 2),
        ((row(0.01, 50.0, 300.0, 40.0), row(0.01, 50.0, 300.0, -40.0)), 2),
        ((row(0.01, 50.0), row(0.02, 25.0, applied_gain_db=12.0)), 2),  # set by the camera, too
        ((row(0.01, 50.0, applied_gain_db=11.98), row(0.02, 25.0, applied_gain_db=12.01)), 1),
        ((row(0.01, 0.0),), 0),
        (PAIR, 1),
    ],
)
def test_conditions_and_their_nodes(rows: tuple[dict[str, Any], ...], expected: int) -> None:
    assert nodes(*rows) == expected


def test_dark_charge_that_counts_separates_exposures() -> None:
    assert nodes(*PAIR, dark_current_e_s=1000.0) == 2


def test_the_lens_is_the_cameras_unless_the_plan_has_another() -> None:
    """An f-number in the plan brings diffraction; the column has one in any case."""
    own = nodes_at([row(0.01, 50.0)], IMX250, ())
    assert own.conditions[0]["f_number"] is None
    assert nodes(row(0.01, 50.0, f_number=1.4), row(0.01, 50.0, f_number=4.0), planned=("f_number",)) == 2


def test_conditions_of_one_node_are_summed() -> None:
    """50 lux x 10 ms is 25 lux x 20 ms; picture c is only in the second light; nothing was measured at 1 ms."""
    at = nodes_at([row(0.01, 50.0), row(0.02, 25.0), row(0.04, 25.0), row(0.001, 25.0)], IMX250, ())
    sums = np.array([[[1.0], [0.0], [0.0]], [[0.2], [0.4], [0.9]], [[0.0], [0.6], [0.0]]])
    counts = np.array([[[2.0], [0.0], [0.0]], [[1.0], [1.0], [1.0]], [[0.0], [3.0], [0.0]]])
    of_lights = table(sums, [0.01, 0.02, 0.04], counts=counts, kept=True)
    of_lights.conditions["illuminance_lux"][1:] = 25.0
    assert at.group(of_lights).mean == pytest.approx([2.2 / 7, 0.9, np.nan], nan_ok=True)


@pytest.mark.parametrize(
    ("plan", "reason"),
    [
        ({"grid": {"moves": [0.0, 1.0]}}, "its targets or background move alone"),
        ({"grid": {"ego_speed_m_s": [10.0]}, "ego": {}}, "its camera drives"),
        ({"grid": {"f_number": [2.0]}, "trajectory": {"kind": "shake"}}, "its pictures follow a trajectory"),
        (None, "no sweep has begun here"),
    ],
)
def test_runs_whose_motion_no_chart_has_are_refused(plan: Any, reason: str) -> None:
    abouts = {"manifest": plan and {}, "identity": {"plan": plan}}
    store: Any = SimpleNamespace(folder="run", about=abouts.get)
    with pytest.raises(StoreError, match=reason):
        nodes_of(store)


def test_a_grid_has_a_place_for_each_condition() -> None:
    found = plane(exposures_s=(0.01, 0.002), lights_lux=(5.0, 50.0), speeds=(0.0, 300.0))
    assert len(found) == len(np.unique(found.places, axis=0)) == 8
