"""Sweeps of a camera that drives: frames are simulate's, boxes go by their own flow, and a run is of one vehicle."""

from __future__ import annotations

import json
import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from blurnoise_eval import evaluate
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.grid.conditions import Cell, Conditions, SweepPlan
from blurnoise_eval.scoring.movers import box_mover
from blurnoise_eval.store.store import StoreError
from blurnoise_eval.sweep.exposing import Scene, frames
from plans import plan as swept
from signs_in_memory import CAMERA, TWO, matched_detector, noise

from blurnoise import Exposure, simulate
from blurnoise.motion.ego import Vehicle
from blurnoise.picture.develop import develop_8bit

SIZE = (103, 143)
VEHICLE = Vehicle(height_m=1.2, pitch_deg=3.0, hfov_deg=60.0, yaw_deg_s=6.0)
STILL = swept((0.004, 0.02), (100.0,), (0.0,), gain_db=(0.0,))
PLAN = swept((0.004, 0.02), (100.0,), (0.0,), gain_db=(0.0,), ego_speed_m_s=(0.0, 20.0))


def test_frames_are_simulates_of_the_vehicles_flow() -> None:
    picture = noise(*SIZE)
    cells = [
        Cell("a", 0, Conditions(exposure_s=0.02, illuminance_lux=lux, ego_speed_m_s=speed), 5)
        for speed in (0.0, 20.0, 10.0)
        for lux in (100.0, 200.0)
    ]
    for cell, frame in zip(cells, frames(Scene(picture), cells, CAMERA, ego=VEHICLE), strict=True):
        assert cell.conditions is not None
        at = cell.conditions.stated
        dn = simulate(
            torch.from_numpy(picture).permute(2, 0, 1)[None] / 255,
            CAMERA,
            exposure_s=0.02,
            illuminance_lux=at["illuminance_lux"],
            velocity_px_s=VEHICLE.flow_px_s(CAMERA, SIZE, at["ego_speed_m_s"]),
            generator=[5],
        )
        np.testing.assert_array_equal(frame.image, develop_8bit(dn, CAMERA)[0].permute(1, 2, 0).numpy())


def test_boxes_sweep_what_their_own_place_does() -> None:
    """Against the union of what every pixel in the box sweeps; one motion for the picture is far from it."""
    taken = Exposure(CAMERA, 0.03, 100.0, ego_speed_m_s=20.0, vehicle=VEHICLE)
    flow = VEHICLE.flow_px_s(CAMERA, SIZE, 20.0).double().numpy() * 0.03
    boxes = [(10, 70, 40, 100), (100, 60, 130, 90), (60, 10, 80, 25)]
    swept_boxes = taken.sweep_boxes(torch.tensor(boxes, dtype=torch.float64), SIZE).numpy()
    for (left, top, right, bottom), found in zip(boxes, swept_boxes, strict=True):
        half = np.abs(flow[:, top:bottom, left:right]) / 2
        y, x = np.mgrid[top:bottom, left:right] + 0.5
        pixels = ((x - half[0]).min(), (y - half[1]).min(), (x + half[0]).max(), (y + half[1]).max())
        np.testing.assert_allclose(found, pixels, atol=0.65)  # half a pixel, and the flow's change over that
    grown = swept_boxes - np.array(boxes)
    assert grown[0, 3] > 4 * grown[2, 3]  # below the horizon and above it
    own = taken.displacements_px(torch.tensor([[25.5, 85.5]]), SIZE)[0].numpy()
    np.testing.assert_allclose(own, flow[:, 85, 25], rtol=1e-5)
    mover = box_mover(taken)
    assert mover is None  # which are centred at mid-exposure


def test_rows_have_each_targets_own_blur_and_no_ego_leaves_ids_alone() -> None:
    stated = Conditions(exposure_s=0.02, illuminance_lux=100.0, ego_speed_m_s=20.0)
    plain = Conditions(exposure_s=0.02, illuminance_lux=100.0)
    assert "ego" not in repr(plain)
    assert Cell("a", 0, plain, 5).cell_id == "7e1537e4099df39d1864"  # as before there was the axis
    assert Cell("a", 0, stated, 5).cell_id != Cell("a", 0, plain, 5).cell_id
    assert "ego" not in STILL.to_dict()
    assert SweepPlan(**PLAN.to_dict()) == PLAN
    with_vehicle = replace(PLAN, ego=VEHICLE)
    assert SweepPlan(**json.loads(json.dumps(with_vehicle.to_dict()))).ego == VEHICLE
    taken = stated.exposure(CAMERA, vehicle=VEHICLE)
    assert pickle.loads(pickle.dumps(taken)) == taken
    assert hash(taken) == hash(stated.exposure(CAMERA, vehicle=VEHICLE))


@pytest.mark.slow
def test_a_run_is_of_one_vehicle_and_says_so(tmp_path: Path) -> None:
    detector: Detector = matched_detector(tmp_path)
    driven = replace(PLAN, ego=VEHICLE)
    first = evaluate(detector, TWO, CAMERA, driven, tmp_path / "run")
    with pytest.raises(StoreError, match="another plan"):
        evaluate(detector, TWO, CAMERA, replace(PLAN, ego=replace(VEHICLE, height_m=1.3)), tmp_path / "run")
    again = evaluate(detector, TWO, CAMERA, driven, tmp_path / "run")
    assert again.outcome is not None
    assert again.outcome.computed == 0
    moving = [row for row in first.targets if row["ego_speed_m_s"] == 20.0]
    assert {row["blur_px"] for row in first.cells if row["ego_speed_m_s"] == 20.0} == {0.0}
    for row in moving[:4]:
        middle = torch.tensor([[(row["x0"] + row["x1"]) / 2, (row["y0"] + row["y1"]) / 2]])
        taken = Exposure(CAMERA, row["exposure_s"], 100.0, ego_speed_m_s=20.0, vehicle=VEHICLE)
        picture = next(each for each in TWO.pictures if each.name == row["image"]).load()
        own = torch.linalg.vector_norm(taken.displacements_px(middle, picture.shape[:2]))
        assert row["blur_px"] == pytest.approx(float(own), rel=1e-5)
    page = first.report().read_text()
    assert "72 km/h" in page
    assert "height_m 1.2" in page
