"""Classes that cross the view at a road speed: px/s by width, pictures, boxes, rows, refusals."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from blurnoise_eval import evaluate
from blurnoise_eval.grid.conditions import SweepPlan
from blurnoise_eval.grid.objects import Crossing, Objects
from blurnoise_eval.report.findings import run_facts
from blurnoise_eval.scoring.movers import box_mover, box_sweeper
from blurnoise_eval.sweep.exposing import Scene
from commands import main, stated
from plans import plan as swept
from signs_in_memory import BOX, CAMERA, matched_detector, picture, picture_set, sign

from blurnoise.scene.scene import Exposure

BOXES = np.array([[10.0, 20.0, 30.0, 60.0], [40.0, 40.0, 80.0, 80.0]])
SIZES = np.full((2, 2), 100.0)
CAR = {"car": Crossing(36.0, width_m=4.0)}
SIGN = {"stop sign": Crossing(108.0, width_m=0.9)}
SIGN_PX_S = 30.0 * (BOX[2] - BOX[0]) / 0.9


def taken(moves: str, right_px_s: float = 0.0) -> Exposure:
    return Exposure(CAMERA, 0.01, 300.0, (right_px_s, 0.0), moves=moves)


@pytest.mark.parametrize("kmh", [36.0, -36.0, 0.0])
def test_px_by_width(kmh: float) -> None:
    """v w / W whatever the lens."""
    found = Crossing(kmh, width_m=4.0).velocity_px_s((90.0, 60.0, 110.0, 76.0))
    assert found == pytest.approx((kmh / 3.6 * 20 / 4, 0.0))


def test_boxes_sweep_what_their_own_class_and_size_do() -> None:
    """The wider box of a class is nearer, and faster in px; the others have the exposure's velocity."""
    objects = Objects(crossings=CAR)
    for labels, moves, right_px_s, lengths in (
        (("car", "car"), "targets", 3000.0, (0.5, 1.0)),  # 10 m/s of 20 and 40 px that are 4 m, in 10 ms
        (("car", "dog"), "targets", 3000.0, (0.5, 30.0)),
        (("car", "dog"), "background", 3000.0, (30.5, 0.0)),  # it passes what the camera's turn moves
        (("car", "dog"), "all", 3000.0, (30.0, 30.0)),
    ):
        grown = box_sweeper(taken(moves, right_px_s), objects)(BOXES, SIZES, labels)
        by = np.array([[-length / 2, 0, length / 2, 0] for length in lengths])
        np.testing.assert_allclose(grown, BOXES + by, err_msg=str(labels))
    truth = box_mover(taken("targets"), Objects(crossings=CAR, boxes="swept"))
    assert truth is not None
    np.testing.assert_allclose(truth(BOXES, SIZES, ["car", "dog"])[:, 0], [9.75, 40.0])


def test_pictures_are_those_of_a_velocity_that_does_the_same() -> None:
    crossing, plain = (
        Scene(sign(), picture=picture("a"), objects=Objects(crossings=given)) for given in (SIGN, {})
    )

    def seen(scene: Scene, at: Exposure) -> Any:
        return next(iter(scene.frames([at]))).picture

    known = seen(plain, taken("targets", SIGN_PX_S))
    assert np.array_equal(seen(crossing, taken("targets")), known)
    assert np.array_equal(seen(crossing, taken("targets", 900.0)), known)  # whatever --dx
    assert np.array_equal(seen(crossing, taken("all")), seen(plain, taken("all")))
    assert not np.array_equal(seen(crossing, taken("all")), known)
    assert crossing.invented(taken("targets")) == plain.invented(taken("targets", SIGN_PX_S))


def test_rows_say_each_targets_own_blur_and_the_plan_its_speed(tmp_path: Path) -> None:
    detector = matched_detector(tmp_path)
    grid = swept((0.01,), (300.0,), moves=(0.0, 1.0)).grid
    plan = SweepPlan(grid, objects=Objects(crossings=SIGN))
    assert SweepPlan(**json.loads(json.dumps(plan.to_dict()))) == plan
    found = evaluate([detector], picture_set(picture("a")), CAMERA, plan, tmp_path / "run", threads=1)
    rows = {row["moves"]: row for row in found.targets}
    assert rows["targets"]["blur_px"] == pytest.approx(SIGN_PX_S * 0.01)
    assert rows["all"]["blur_px"] == 0
    assert rows["targets"]["confidence"] < rows["all"]["confidence"] - 0.02
    assert rows["targets"]["invented_share"] > 0.05
    assert (
        run_facts(found.data)["crossings"]
        == "stop sign 108 km/h, 0.9 m wide; blur_px of such a target is its own"
    )


@pytest.mark.parametrize(
    ("objects", "told"),
    [
        ({"crossings": {"car": {"kmh": 50}}}, "objects.crossings: car: must be {kmh: ..., width_m: ...}"),
        ({"crossings": {"car": {"kmh": 500, "width_m": 5}}}, "objects.crossings: car: kmh = 500"),
        ({"crossings": {"dog": {"kmh": 6, "width_m": 0}}}, "objects.crossings: dog: width_m = 0"),
        ({"crossings": {"dog": {"speed": 6}}}, "objects.crossings: dog: "),
        ({"crossings": {"car": {"kmh": 5, "width_m": 5}}}, "crossings: car: no target is one"),
        (
            {"crossings": {"a": {"kmh": 5, "width_m": 5}}, "speeds": {"a": 2}},
            "speeds: a: is one of crossings, too",
        ),
        (
            {"crossings": {"stop sign": {"kmh": 360, "width_m": 1e-6}}},
            "stop sign: kmh = 360 with width_m = 1e-06:",
        ),
        ({"speeds": {"car": 2}}, "speeds: car: no target is one"),
    ],
)
def test_refused(objects: Any, told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plan = stated(tmp_path, objects=objects, moves="targets")
    assert main(["sweep", "--plan", plan, "-o", str(tmp_path / "run")]) == 2
    assert told in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "run").exists()
