"""Vehicles: the flow of their pictures, whole and at places, and what they refuse."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from blurnoise import Camera
from blurnoise.driving import Vehicle

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
