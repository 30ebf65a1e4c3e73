"""Vehicles: the flow of their pictures, whole and at places, and what they refuse."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest
from projection import projected

from blurnoise import Camera
from blurnoise.motion.ego import Vehicle
from blurnoise.optics.lens import Distortion, Lens

CAMERA = Camera.preset("imx250")
SIZE = (47, 61)


def test_the_road_before_a_level_pinhole() -> None:
    """y below the axis at V from h: down y² V / (h f), across x y V / (h f); nothing above the horizon."""
    vehicle = Vehicle(height_m=1.2, hfov_deg=70.0, lens="rectilinear")
    flow = vehicle.flow_px_s(CAMERA, SIZE, 9.0).double().numpy()
    focal_px = 61 / 2 / math.tan(math.radians(35))
    x, y = np.arange(61) - 30.0, np.arange(47)[:, None] - 23.0
    below = np.maximum(y, 0.0) * 9.0 / (1.2 * focal_px)
    np.testing.assert_allclose(flow, np.stack([x * below, (y + 0 * x) * below]), rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("plane_m", [None, 8.0])
def test_places_are_those_of_the_whole_flow(plane_m: float | None) -> None:
    vehicle = Vehicle(pitch_deg=2.0, heading_deg=-4.0, plane_m=plane_m, yaw_deg_s=5.0, pitch_deg_s=-3.0)
    whole = vehicle.flow_px_s(CAMERA, SIZE, 13.0).numpy()
    places = np.array([[3.0, 60.0, 31.0], [40.0, 46.0, 2.0]])
    own = vehicle.flow_at(places, CAMERA, SIZE, 13.0)
    np.testing.assert_allclose(own, whole[:, [40, 46, 2], [3, 60, 31]], rtol=1e-5, atol=1e-5)
    slower = replace(vehicle, pitch_deg_s=0.0).flow_at(places, CAMERA, SIZE, 13.0)
    assert np.abs(own - slower)[1].min() > 1


@pytest.mark.parametrize("scale", [1, 2])
def test_a_calibrated_camera_drives_with_its_own_lens(scale: int) -> None:
    """The road by OpenCV: a pixel's point, seen again from where the camera is a moment later and earlier."""
    coefficients, focal_px, centre_px = (-0.2, 0.04, 0.001, -0.0005, 0.002), (400.0, 410.0), (330.0, 235.0)
    lens = Lens(distortion=Distortion("opencv", coefficients, focal_px, centre_px))
    camera = replace(CAMERA, width_px=640, height_px=480, lens=lens)
    matrix = np.array([[focal_px[0], 0, centre_px[0]], [0, focal_px[1], centre_px[1]], [0, 0, 1]])
    pixels = np.array([[20.0, 610.0, 333.0], [460.0, 300.0, 236.5]])
    rays = cv2.undistortPoints(pixels.T[:, None], matrix, np.array(coefficients), None, None, None,
                               (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-12))[:, 0]  # fmt: skip
    road = np.column_stack([rays, np.ones(3)]) * (1.5 / rays[:, 1:])
    step_s = 1e-4
    seen = [
        cv2.projectPoints(road - [0, 0, ahead_m], np.zeros(3), np.zeros(3), matrix, np.array(coefficients))[0]
        for ahead_m in (20 * step_s, -20 * step_s)
    ]
    expected = (seen[0] - seen[1])[:, 0].T / (2 * step_s) / scale
    size = (480 // scale, 640 // scale)
    own = Vehicle().flow_at((pixels + 0.5) / scale - 0.5, camera, size, 20.0)
    np.testing.assert_allclose(own, expected, rtol=1e-5, atol=1e-4)
    assert np.abs(Vehicle(lens="rectilinear").flow_at(pixels, camera, (480, 640), 20.0) - own).max() > 20


@pytest.mark.parametrize("points_m", [(0.5, 0.3, 4.0), (-2.0, 1.0, 3.0)])
def test_a_calibrated_view_projects_where_its_pixels_look(points_m: tuple[float, float, float]) -> None:
    lens = Lens(distortion=Distortion("fisheye", (0.02, -0.01, 0.0, 0.0), (1500.0, 1500.0)))
    view = Vehicle().view(replace(CAMERA, lens=lens), SIZE)
    point = np.array(points_m)
    np.testing.assert_allclose(view.rays(projected(view, point)), point / np.linalg.norm(point), atol=1e-9)


@pytest.mark.parametrize(
    "wrong",
    [
        {"height_m": 0.0},
        {"hfov_deg": 200.0, "lens": "rectilinear"},
        {"lens": "fish"},
        {"plane_m": -1.0},
        {"yaw_deg_s": math.nan},
    ],
)
def test_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=next(iter(wrong))):
        Vehicle(**wrong)
