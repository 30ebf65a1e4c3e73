"""A run opened again: its plan is the one that it was computed by."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from blurnoise_eval.grid.conditions import SweepPlan
from blurnoise_eval.grid.objects import Crossing, Objects
from blurnoise_eval.store.store import Store, StoreError
from blurnoise_eval.sweep.open import Batch, Run, ask
from blurnoise_eval.sweep.run_folder import open_run
from plans import plan as swept
from signs_in_memory import CAMERA, TWO, matched_detector

from blurnoise.motion.ego import Vehicle
from blurnoise.scene.metering import AutoExposure

PLAN = swept((0.01, 0.02), (50.0,), (0.0, 300.0))
MOVED = swept((0.01,), (50.0,), (0.0, 300.0), gain_db=("auto",), moves=(0.0, 1.0))
DRIVEN = swept((0.01,), (50.0,), ego_speed_m_s=(20.0,))
LOG = "time_s,x_px,y_px\n-1,0,0\n0,3,1\n1,5,2\n"
NODES = SweepPlan({"gain_db": (6.0,)}, repeats=2, direction=(0.6, 0.8))


@pytest.mark.parametrize(
    "plan",
    [
        PLAN,
        replace(PLAN, repeats=3, seed=7, grey_anchor="mean", examples=False, trajectory="shake:6"),
        replace(MOVED, auto_exposure=AutoExposure(target=0.3), objects=Objects(speeds={"stop sign": 0.5})),
        replace(MOVED, objects=Objects(crossings={"stop sign": Crossing(30.0, width_m=0.9)})),
        replace(DRIVEN, ego=Vehicle(height_m=2.0)),
        replace(PLAN, picture_tone=((0.0, 0.0), (0.2, 0.5), (1.0, 1.0))),
        NODES,
    ],
)
def test_a_plan_is_read_back(plan: SweepPlan, tmp_path: Path) -> None:
    with Store(tmp_path, create=True) as store:
        open_run(store, [matched_detector(tmp_path)], CAMERA, TWO, plan, {})
        assert Run(store).plan == plan
        assert Run(store).camera == CAMERA


def test_a_trajectory_of_a_file_is_read_back_without_the_file(tmp_path: Path) -> None:
    log = tmp_path / "log.csv"
    log.write_text(LOG)
    plan = replace(PLAN, trajectory=str(log))
    log.unlink()
    with Store(tmp_path / "run", create=True) as store:
        open_run(store, [matched_detector(tmp_path)], CAMERA, TWO, plan, {})
        assert Run(store).plan == plan


def test_what_is_missing_is_counted(tmp_path: Path) -> None:
    """Of a grid with the exposures that were asked for beside it; of a search for the pictures that it took."""
    (extra,) = swept((0.015,), (50.0,)).conditions()
    for plan, n_pictures, expected in ((PLAN, len(TWO), 2 * (1 + 4 + 1)), (NODES, 1, 1 * (1 + 2 * 1))):
        with Store(tmp_path / str(n_pictures), create=True) as store:
            open_run(store, [matched_detector(tmp_path)], CAMERA, TWO, plan, {})
            ask(store, Batch(n_pictures, (), (extra,)))
            assert Run(store).missing_cells() == expected
            store.skip(TWO.pictures[0].name, "cannot be read")
            assert Run(store).missing_cells() == expected // n_pictures * (n_pictures - 1)


def test_a_folder_without_a_run_is_refused(tmp_path: Path) -> None:
    with pytest.raises(StoreError, match=r"holds no results.sqlite"), Run.open(tmp_path):
        pass
    with Store(tmp_path, create=True) as store, pytest.raises(StoreError, match="no sweep has begun here"):
        Run(store)
