"""Classes that cross the view at a road speed: px/s by width or distance, pictures, boxes, rows, refusals."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from blurnoise_eval import evaluate
from blurnoise_eval.cli import given, main
from blurnoise_eval.grid.conditions import SweepPlan
from blurnoise_eval.grid.objects import Crossing, Objects
from blurnoise_eval.store.store import Store
from blurnoise_eval.sweep.exposing import Scene, box_mover, box_sweeper
from plans import plan as swept
from signs_in_memory import BOX, CAMERA, matched_detector, picture, picture_set, sign

from blurnoise.scene.scene import Exposure

SIZE = (80, 120)
BOXES = np.array([[10.0, 20.0, 30.0, 60.0], [40.0, 40.0, 80.0, 80.0]])
SIZES = np.full((2, 2), 100.0)
CAR = {"car": Crossing(36.0, width_m=4.0)}
SIGN = {"stop sign": Crossing(108.0, width_m=0.9)}
SIGN_PX_S = 30.0 * (BOX[2] - BOX[0]) / 0.9


def taken(moves: str, right_px_s: float = 0.0) -> Exposure:
    return Exposure(CAMERA, 0.01, 300.0, (right_px_s, 0.0), moves=moves)


@pytest.mark.parametrize("kmh", [36.0, -36.0, 0.0])
def test_px_by_width_and_by_distance(kmh: float) -> None:
    """v w / W whatever the lens; f v / Z on the axis of either, and anywhere before a pinhole."""
    middle, side = (50.0, 30.0, 70.0, 50.0), (90.0, 60.0, 110.0, 76.0)
    speed = kmh / 3.6
    assert Crossing(kmh, width_m=4.0).velocity_px_s(side, CAMERA, SIZE) == (speed * 20 / 4, 0.0)
    focal_px = {"rectilinear": 60 / math.tan(math.radians(30)), "f-theta": 60 / math.radians(30)}
    for lens, boxes in (("rectilinear", (middle, side)), ("f-theta", (middle,))):
        crossing = Crossing(kmh, away_m=8.0, hfov_deg=60.0, lens=lens)  # type: ignore[arg-type]
        for box in boxes:
            found = crossing.velocity_px_s(box, CAMERA, SIZE)
            assert found == pytest.approx((focal_px[lens] * speed / 8.0, 0.0), abs=1e-9)


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
    evaluate([detector], picture_set(picture("a")), CAMERA, plan, tmp_path / "run", threads=1)
    with Store(tmp_path / "run") as store:
        rows = {row["moves"]: row for row in store.targets()}
        about = store.about("manifest")["crossings"]
    assert rows[1.0]["blur_px"] == pytest.approx(SIGN_PX_S * 0.01)
    assert rows[0.0]["blur_px"] == 0
    assert rows[1.0]["confidence"] < rows[0.0]["confidence"] - 0.02
    assert rows[1.0]["invented_share"] > 0.05
    assert about == "stop sign 108 km/h, 0.9 m wide; blur_px of such a target is its own"


def test_options_are_by_class() -> None:
    found = given.objects(
        "auto", None, ["bus=0.5"], "object", kmh=["car=50, stop sign=-5", "dog=9"], width_m=["car=4.5"],
        away_m=["stop sign=20,dog=8"], hfov_deg=60.0, lens="rectilinear",
    )  # fmt: skip
    seen_by: Any = {"hfov_deg": 60.0, "lens": "rectilinear"}
    crossings = {
        "car": Crossing(50.0, width_m=4.5),
        "stop sign": Crossing(-5.0, away_m=20.0, **seen_by),
        "dog": Crossing(9.0, away_m=8.0, **seen_by),
    }
    assert found == Objects(speeds={"bus": 0.5}, crossings=crossings)


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (["--object-kmh", "car"], "object-kmh = 'car': must be CLASS=KMH"),
        (["--object-kmh", "car=50"], "object-kmh: car: needs --object-m"),
        (["--object-kmh", "car=50", "--object-m", "dog=5"], "dog: go with --object-kmh"),
        (["--object-kmh", "car=500", "--object-m", "car=5"], "object-kmh = 500"),
        (["--object-kmh", "car=5,dog=6", "--object-width-m", "car=5,dog=0"], "object-kmh: dog: object-width-m = 0"),
        (["--object-kmh", "car=5", "--object-width-m", "car=5"], "object-kmh: car: no target is one"),
        (["--object-kmh", "a=5", "--object-width-m", "a=5", "--object-speed", "a=2"], "object-speed: a: has an"),
        (["--object-kmh", "car=5,car=6", "--object-m", "car=5"], "--object-kmh: car: stated twice"),
        (["--object-kmh", "a=5", "--object-m", "a=5", "--object-m", "a=6"], "--object-m: a: stated twice"),
        (["--object-kmh", "stop sign=360", "--object-width-m", "stop sign=1e-6"],
         "--object-kmh: stop sign: object-kmh = 360 with --object-width-m = 1e-06:"),
        (["--object-kmh", "stop sign=360", "--object-width-m", "stop sign=0.002", "--exposure-ms", "1000"],
         "--object-kmh: stop sign: object-kmh = 360 with --object-width-m = 0.002: displacement_px"),
        (["--object-kmh", "a=5", "--object-m", "a=5", "--hfov-deg", "0", "--lens", "rectilinear"], "hfov_deg = 0"),
    ],
)  # fmt: skip
def test_refused(options: list[str], told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["sweep", "--moves", "targets", *options, "-o", str(tmp_path / "run")]) == 2
    assert told in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "run").exists()


def test_nothing_crosses_where_all_moves() -> None:
    with pytest.raises(ValueError, match="crossings: of what moves for itself; goes with moves targets"):
        SweepPlan(swept((0.01,), (300.0,)).grid, objects=Objects(crossings=SIGN))
