"""The mean over the plane of light and motion: whatever the grid, each experiment once."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
import pytest
from blurnoise_eval.answers.plane import STILL_PX, plane_weights
from blurnoise_eval.grid.axes import blur_px
from plans import OWN

Grid = tuple[Any, Any, Any]
DEFAULT: Grid = (np.array([1, 2, 5, 10, 15, 20, 30, 45, 60, 90]) / 1e3, (0.5, 50, 5000), (0, 200, 500, 1000))
EVEN: Grid = (np.geomspace(0.001, 0.09, 8), np.geomspace(0.5, 5000, 5), (0, 250, 1000))
LONG: Grid = (np.array([1, 30, 40, 50, 60, 70, 80, 90]) / 1e3, (0.5, 5, 50, 500, 5000), (0, 100, 1000))


def rows(grid: Grid, **fields: float) -> list[dict[str, float]]:
    return [
        {**OWN, "exposure_s": s, "illuminance_lux": lux, "velocity_x_px_s": v, "velocity_y_px_s": 0.0}
        | fields
        for s, lux, v in product(*map(tuple, grid))
    ]


def mean_over_plane(table: list[dict[str, float]], value_of: Any) -> float | None:
    weights = plane_weights(table)
    return None if weights is None else float(weights @ [value_of(row) for row in table])


def law(row: Any) -> float:
    """A detector that needs 0.05 lux s, is dazzled from 15 on and stands 12 px of motion."""
    light = row["exposure_s"] * row["illuminance_lux"]
    return float(
        0.95 / (1 + (0.05 / light) ** 1.6) / (1 + (light / 15) ** 2) / (1 + (blur_px(row) / 12) ** 2.2)
    )


def test_three_grids_over_the_same_ranges_agree() -> None:
    """Where the plain means of the same rows are 0.1 apart."""
    means = [mean_over_plane(rows(grid), law) for grid in (DEFAULT, EVEN, LONG)]
    fine = mean_over_plane(
        rows((np.geomspace(0.001, 0.09, 25), np.geomspace(0.5, 5000, 25), (0, *np.geomspace(1, 1000, 25)))),
        law,
    )
    assert means == pytest.approx([fine] * 3, abs=0.01)
    plain = [np.mean([law(row) for row in rows(grid)]) for grid in (DEFAULT, EVEN, LONG)]
    assert max(plain) - min(plain) > 0.08


def test_an_experiment_counts_once_however_often_it_is_tested() -> None:
    """5 ms under 100 lux and 10 ms under 50 lux at half the speed are one; so are the directions of one speed."""
    grid = rows(DEFAULT)
    again = [
        {**row, "exposure_s": row["exposure_s"] / 2, "illuminance_lux": 2 * row["illuminance_lux"]}
        | {"velocity_x_px_s": 0.0, "velocity_y_px_s": -2 * row["velocity_x_px_s"]}
        for row in grid[:60]
    ]
    assert mean_over_plane(grid + again, law) == pytest.approx(mean_over_plane(grid, law), abs=1e-9)


def test_a_plane_s_mean_by_hand() -> None:
    """A value linear in log2 H and log2 L over a grid whose hull has its centre of area in the middle."""
    grid = rows(((1.0,), (1.0, 2.0, 16.0), (STILL_PX, 4.0)))
    assert mean_over_plane(
        grid, lambda row: np.log2(row["illuminance_lux"]) + 10 * np.log2(row["velocity_x_px_s"])
    ) == pytest.approx(2 + 10 * 0.5)


def test_one_axis_alone_is_a_line_and_one_condition_a_point() -> None:
    line = rows(((0.01,), (1.0, 2.0, 16.0), (0.0,)))
    values = {1.0: 0.0, 2.0: 0.4, 16.0: 0.8}
    mean = mean_over_plane(line, lambda row: values[row["illuminance_lux"]])
    assert mean == pytest.approx((0.2 * 1 + 0.6 * 3) / 4)  # one stop and three
    assert mean_over_plane(line[:1], lambda row: 0.7) == pytest.approx(0.7)
    assert mean_over_plane([], law) is None


def test_further_axes_are_means_over_their_ranges() -> None:
    """Temperatures 0, 10 and 50 °C: straight between them, each pair by its distance."""
    table = [row for t in (0.0, 10.0, 50.0) for row in rows(DEFAULT, temperature_c=t)]
    mean = mean_over_plane(table, lambda row: row["temperature_c"])
    assert mean == pytest.approx((5 * 10 + 30 * 40) / 50)
