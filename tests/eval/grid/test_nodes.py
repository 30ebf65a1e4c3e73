"""Plans of nodes: the conditions that a search has chosen, as a run takes them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from blurnoise_eval.grid.axes import AUTOMATIC
from blurnoise_eval.grid.conditions import Conditions, SweepPlan
from blurnoise_eval.sweep.work import blocks, cells_per_picture
from plans import plan as swept
from signs_in_memory import CAMERA, PLAN, TWO, matched_detector, rows_of

NODES = tuple(
    Conditions(exposure_s=s, illuminance_lux=lux, velocity_x_px_s=v)
    for s, lux, v in ((0.03, 3.0, 333.3), (0.002, 333.3, 0.0), (0.0123, 3.0, 333.3))
)


def searched(*nodes: Conditions, **further: Any) -> SweepPlan:
    return SweepPlan({}, only=nodes, direction=(1.0, 0.0), **further)


def test_its_rows_are_those_of_the_grid(tmp_path: Path) -> None:
    """Cell by cell, whatever else either computes; but for the pictures that are kept of them."""
    models = [matched_detector(tmp_path)]
    chosen = rows_of(tmp_path / "nodes", models, CAMERA, TWO, searched(*NODES, repeats=2, examples=False))
    grid = rows_of(tmp_path / "grid", models, CAMERA, TWO, swept(**_axes(PLAN), repeats=2, examples=False))
    ids = {cell["cell_id"] for cell in chosen[0]}
    assert len(ids) == 2 * (1 + 2 * len(NODES))
    assert chosen[0] == [cell for cell in grid[0] if cell["cell_id"] in ids]
    assert chosen[1] == [target for target in grid[1] if target["cell_id"] in ids]
    assert len(chosen[0]) < len(grid[0])


def test_each_node_is_computed_once_and_its_blurs_together() -> None:
    plan = searched(*NODES, NODES[0], repeats=2)
    assert sorted(plan.conditions(), key=repr) == sorted(NODES, key=repr)
    cells = [cell for block in blocks(TWO, plan) for cell in block.cells]
    assert len(cells) == len(set(cells)) == 2 * cells_per_picture(plan)
    shared = [at.blurs_as for at in plan.conditions()]
    assert shared == sorted(shared)


def test_what_makes_a_run_is_all_but_the_nodes() -> None:
    alike = searched(*NODES, examples=False), searched()
    assert alike[0].to_dict() == alike[1].to_dict()
    gain = {"gain_db": (AUTOMATIC,)}
    others: list[dict[str, Any]] = [{"repeats": 2}, {"seed": 1}, {"grid": gain}, {"direction": (0.0, 1.0)}]
    others.append({"grey_anchor": "mean"})
    assert all(replace(alike[1], **other).to_dict() != alike[0].to_dict() for other in others)


def _axes(plan: Any) -> dict[str, tuple[float, ...]]:
    names = {"exposures_s": "exposure_s", "lights_lux": "illuminance_lux"}
    names |= {"right_px_s": "velocity_x_px_s", "down_px_s": "velocity_y_px_s"}
    return {name: plan.values(axis) for name, axis in names.items()}
