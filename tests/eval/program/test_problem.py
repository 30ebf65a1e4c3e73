"""What a run offers a program: its planes, lights and exposures; and which runs have none."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from blurnoise_eval.evaluation import evaluate
from blurnoise_eval.grid.axes import AUTOMATIC
from blurnoise_eval.grid.conditions import SweepPlan
from blurnoise_eval.program.problem import Inputs, inputs_of
from blurnoise_eval.store.store import Store
from signs_in_memory import CAMERA, TWO, matched_detector

GRID = {
    "exposure_s": (0.008, 0.032),
    "illuminance_lux": (0.0, 2.0, 5.0),
    "velocity_x_px_s": (0.0, 200.0),
    "velocity_y_px_s": (0.0,),
    "gain_db": (AUTOMATIC,),
}


def inputs(folder: Path, grid: dict[str, tuple[float, ...]], **options: Any) -> Inputs:
    """Of a sweep."""
    plan = SweepPlan(GRID | grid, **options)
    done = evaluate(
        matched_detector(folder), TWO, CAMERA, plan, folder, threshold=0.5, refine=False, threads=1
    )
    with Store(folder) as store:
        return inputs_of(store, done.criterion)


def test_a_sweep_has_planes_for_its_lights_above_zero(tmp_path: Path) -> None:
    found = inputs(tmp_path, {})
    asked = found.scenario
    assert (asked.lights_lux[0], asked.lights_lux[-1], found.exposures_s) == (2.0, 5.0, (0.008, 0.032))
    assert asked.speeds_px_s == {0.0: 0.5, 200.0: 0.5}
    assert found.recommended_s in (0.008, 0.032)
    # two exposures under two lights, at rest and moving, all at different places
    assert [len(plane.places) for plane in found.planes.values()] == [8] * len(found.planes)
    assert 0.05 < found.metering.mean_light < 0.9


@pytest.mark.parametrize(
    ("grid", "options", "reason"),
    [
        ({}, {"trajectory": "shake:6"}, "along shake:6 another exposure"),
        ({"velocity_y_px_s": (0.0, 200.0)}, {}, "motion has 3 directions"),
        ({"gain_db": (6.0,)}, {}, "gain 6 dB; a program needs a run with --gain auto"),
    ],
)
def test_runs_without_a_program(tmp_path: Path, grid: Any, options: Any, reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        inputs(tmp_path, grid, **options)
