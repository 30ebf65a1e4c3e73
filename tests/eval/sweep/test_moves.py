"""What moves in a sweep: all, the targets before what is still, or the background of targets that are tracked."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from blurnoise_eval import evaluate
from blurnoise_eval.datasets import PictureSet, rendered_signs
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.grid.axes import MOVES
from blurnoise_eval.grid.conditions import Cell, Conditions, SweepPlan
from blurnoise_eval.grid.objects import Objects
from blurnoise_eval.scoring.movers import box_mover, box_sweeper
from blurnoise_eval.store.store import Store
from blurnoise_models.detector import STOP_SIGN
from plans import plan as swept
from signs_in_memory import CAMERA, everything, matched_detector, picture, picture_set

from blurnoise.scene.scene import Exposure

AT: Any = {"exposures_s": (0.01,), "lights_lux": (100.0,), "right_px_s": (0.0, 1600.0)}


@pytest.fixture(scope="module")
def detector(tmp_path_factory: pytest.TempPathFactory) -> Detector:
    return matched_detector(tmp_path_factory.mktemp("model"))


def run(folder: Path, detector: Detector, plan: SweepPlan, pictures: PictureSet, **how: Any) -> list[Any]:
    evaluate([detector], pictures, CAMERA, plan, folder, **{"threads": 1, **how})
    with Store(folder) as store:
        return everything(store)


def labelled() -> PictureSet:
    return picture_set(picture("a"), picture("b"))


def test_not_stated_it_is_all_with_the_same_ids_and_bits(tmp_path: Path, detector: Detector) -> None:
    at = Conditions(exposure_s=0.01, illuminance_lux=100.0, velocity_x_px_s=1600.0)
    assert Cell("a", 0, at, 1).cell_id == "535e6891d330e313632b"  # as of runs before there was a choice
    assert SweepPlan({"exposure_s": (0.01,), "illuminance_lux": (1.0,)}).to_dict().keys() == {
        "grid", "repeats", "seed", "examples"
    }  # fmt: skip
    assert at.exposure(CAMERA).moves == "all"
    plain = run(tmp_path / "plain", detector, swept(**AT), labelled())
    stated = run(tmp_path / "stated", detector, swept(**AT, moves=("all",)), labelled())
    assert plain[2] == stated[2]  # detections, to the bit
    for one, other in zip(plain[0] + plain[1], stated[0] + stated[1], strict=True):
        assert {**one, "cell_id": None, "example": None} == {**other, "cell_id": None, "example": None}


@pytest.mark.parametrize("speed", [0.0, 0.3])
def test_rows_have_the_blur_of_their_class(tmp_path: Path, detector: Detector, speed: float) -> None:
    plan = SweepPlan(swept(**AT, moves=("targets",)).grid, objects=Objects(speeds={"stop sign": speed}))
    _, targets, *_ = run(tmp_path, detector, plan, labelled())
    rows = [row for row in targets if not row["clean"]]
    assert {row["velocity_x_px_s"] for row in rows} > {0.0}
    for row in rows:
        own_px = speed * row["velocity_x_px_s"] * row["exposure_s"]
        assert row["blur_px"] == pytest.approx(own_px)


def test_what_stands_is_seen_as_at_rest(tmp_path: Path, detector: Detector) -> None:
    plan = SweepPlan(swept(**AT, moves=("targets",)).grid, objects=Objects(speeds={"stop sign": 0.0}))
    _, targets, *_ = run(tmp_path, detector, plan, labelled())
    still, moved = (
        [row["confidence"] for row in targets if row["velocity_x_px_s"] == speed] for speed in (0.0, 1600.0)
    )
    assert moved == still
    assert min(still) > 0.5


# --- boxes ------------------------------------------------------------------

BOX = np.array([[10.0, 20.0, 30.0, 60.0], [40.0, 40.0, 80.0, 80.0]])
SIZES = np.full((2, 2), 100.0)


def taken(moves: str, right_px_s: float = 3000.0) -> Exposure:
    return Exposure(CAMERA, 0.01, 50.0, (right_px_s, 0.0), moves=moves)


def test_boxes_follow_what_their_class_does() -> None:
    objects = Objects(speeds={"slow": 0.5})
    for moves, grown in (("all", (15, 15)), ("targets", (15, 7.5)), ("background", (0, 7.5))):
        found = box_sweeper(taken(moves), objects)(BOX, SIZES, ["fast", "slow"])
        by = np.array([[-each, 0, each, 0] for each in grown])
        np.testing.assert_allclose(found, BOX + by)


def test_the_truth_is_the_box_that_is_asked_for() -> None:
    assert box_mover(taken("targets"), Objects()) is None
    swept_boxes = box_mover(taken("targets"), Objects(boxes="swept"))
    assert swept_boxes is not None
    np.testing.assert_allclose(
        swept_boxes(BOX, SIZES, ["a", "a"]), (BOX + np.array([-15, 0, 15, 0])).clip(0, 100)
    )
    half = box_mover(taken("targets", 5000.0), Objects(boxes="half"))  # 50 px: more than twice the first's 20
    assert half is not None
    np.testing.assert_allclose(half(BOX, SIZES, ["a", "a"]), [[20, 40, 20, 40], BOX[1]])
    tracked = box_mover(taken("background", 5000.0), Objects(boxes="half"))
    assert tracked is not None
    np.testing.assert_allclose(tracked(BOX, SIZES, ["a", "a"]), BOX)


# --- what it does to a detector ---------------------------------------------


@pytest.mark.slow
def test_signs_of_the_package_are_cut_from_what_is_truly_behind_them(tmp_path: Path) -> None:
    """Nothing of rendered signs is invented, and tracked they are found however fast it goes."""
    plan = swept((0.02,), (500.0,), (0.0, 2400.0), moves=MOVES.choices)
    done = evaluate(STOP_SIGN, rendered_signs((50,), count=8), CAMERA, plan, tmp_path, threads=2)
    assert {row["invented_share"] for row in done.cells} == {None, 0.0}
    rate = {(row["moves"], row["velocity_x_px_s"]): row["detection_rate"] for row in done.scores}
    assert rate["background", 2400.0] == rate["background", 0.0] == 1.0
    assert max(rate["all", 2400.0], rate["targets", 2400.0]) < 0.9
