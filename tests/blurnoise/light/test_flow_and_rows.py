"""A flow before a camera that reads row by row: against what each sees in its own window of time."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch

from blurnoise import Camera, simulate
from blurnoise.light.conditions import Conditions
from blurnoise.light.effects import through
from blurnoise.motion.ego import Vehicle, View

VIEW = View(95, 71, 70.0, "rectilinear")
MOUNT = Vehicle(1.4, pitch_deg=50.0)
SPEED_M_S, EXPOSURE_S, ROW_S = 14.0, 0.01, 3e-4
"""1 to 9 px of blur; 21 ms from the first row to the last, up to 9 px either way."""
GLOBAL = replace(Camera.preset("imx250"), prnu=0.0)
PER_ROW = ROW_S * GLOBAL.field.per_sensor_px((71, 95))
ROLLING = replace(GLOBAL, row_time_s=PER_ROW, shutter="rolling")


def road(time_s: np.ndarray) -> np.ndarray:
    """The light of the road at every pixel, (H, W), at a time for each row (H,)."""
    rays = VIEW.rays(VIEW.pixels())
    points = rays * MOUNT.road_m(rays) + (MOUNT.ahead * SPEED_M_S)[:, None, None] * time_s[:, None]
    along = np.tensordot(np.cross(MOUNT.down, [1.0, 0.0, 0.0]), points, 1)
    return np.asarray(0.5 + 0.2 * np.sin(14 * points[0] + 1) + 0.25 * np.sin(12 * along + 5 * points[0]))


def exposed(camera: Camera, light: torch.Tensor, flow: Any) -> torch.Tensor:
    at = Conditions.of(
        light,
        camera,
        exposure_s=EXPOSURE_S,
        illuminance_lux=100.0,
        velocity_px_s=flow,
        temperature_c=25.0,
        illuminant="D55",
    )
    return through(light, at)


def flow() -> torch.Tensor:
    pixels = VIEW.pixels()
    found = VIEW.flow_px_s(pixels, MOUNT.road_m(VIEW.rays(pixels)), MOUNT.driving(SPEED_M_S))
    return torch.from_numpy(found)


def truth(row_s: float) -> np.ndarray:
    times = ((np.arange(128) + 0.5) / 128 - 0.5) * EXPOSURE_S
    tau = (np.arange(71) - 35) * row_s
    return np.mean([road(tau + time) for time in times], 0)


def inside(dn: np.ndarray) -> float:
    """RMS, 8-bit numbers of linear light, of the pixels that see nothing from beyond the picture."""
    return float(255 * np.sqrt((dn[12:-12, 12:-12] ** 2).mean()))


@pytest.mark.parametrize("kind", [torch.float32, torch.float64])
def test_a_road_is_seen_row_by_row(kind: torch.dtype) -> None:
    light = torch.from_numpy(road(np.zeros(71)))[None, None].to(kind)
    found = exposed(ROLLING, light, flow())[0, 0].double().numpy()
    assert inside(found - truth(ROW_S)) < 1.0
    assert inside(exposed(GLOBAL, light, flow())[0, 0].double().numpy() - truth(0.0)) < 1.0
    assert inside(truth(ROW_S) - truth(0.0)) > 20
    upwards = exposed(replace(ROLLING, scan="up"), light, flow())[0, 0].double().numpy()
    assert inside(upwards - truth(-ROW_S)) < 1.0


def test_a_constant_flow_is_rolled_as_the_uniform_motion() -> None:
    light = torch.from_numpy(road(np.zeros(71)))[None, None].float()
    same = torch.tensor([300.0, -200.0])[:, None, None].expand(2, 71, 95)
    found, uniform = (exposed(ROLLING, light, each)[0, 0].numpy() for each in (same, (300.0, -200.0)))
    assert inside(found - uniform) < 1.0  # linear between values half a pixel apart, twice


def test_gradients_reach_the_flow_and_the_plan_knows_the_rows() -> None:
    light = torch.from_numpy(road(np.zeros(71)))[None, None].float()
    given: dict[str, Any] = {"exposure_s": EXPOSURE_S, "illuminance_lux": 100.0, "encoding": "linear"}
    asked = flow().float().requires_grad_()
    simulate(light, ROLLING, velocity_px_s=asked, generator=1, **given).square().mean().backward()
    assert asked.grad is not None
    assert float(asked.grad.abs().sum()) > 0
    clean = {**given, "noise": False, "quantised": False, "velocity_px_s": flow()}
    auto, full = (simulate(light, ROLLING, fidelity=each, **clean) for each in ("auto", "full"))  # type: ignore[arg-type]
    assert (auto - full).square().mean().sqrt() < 0.1
    assert (auto - simulate(light, GLOBAL, **clean)).abs().max() > 100
