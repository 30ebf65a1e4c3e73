"""Motion that differs from pixel to pixel, in the chain: its bound, its plan, and what simulate makes of it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import torch
from blurs import flow_blur

from blurnoise import Camera, ExposedScene, motion_blur, plan, simulate
from blurnoise.motion.ego import Vehicle, View
from blurnoise.optics import transfer

CAMERA = Camera.preset("imx250")
VIEW = View(61, 47, 60.0, "rectilinear")
MOUNT = Vehicle(1.5)
PIXELS = VIEW.pixels()
FLOW = VIEW.flow_px_s(PIXELS, MOUNT.road_m(VIEW.rays(PIXELS)), MOUNT.driving(14.0, 10.0))
GIVEN: dict[str, Any] = {"exposure_s": 0.05, "illuminance_lux": 300.0, "encoding": "linear"}


def pictures(batch: int = 1) -> torch.Tensor:
    return torch.rand(batch, 1, 47, 61, generator=torch.Generator().manual_seed(5)) * 0.8


def stage(name: str, **conditions: Any) -> Any:
    needs = plan(CAMERA, exposure_s=0.01, illuminance_lux=100.0, **conditions)
    return next(each for each in needs.stages if each.name == name)


def test_the_steepest_slope_of_a_sinc() -> None:
    x = torch.linspace(0.5, 0.8, 300_001, dtype=torch.float64)
    slope = (torch.sinc(x + 1e-5) - torch.sinc(x - 1e-5)).abs() / 2e-5
    assert float(slope.max()) == pytest.approx(1.3703, abs=1e-4)
    assert float(x[slope.argmax()]) == pytest.approx(0.6626, abs=1e-3)
    assert transfer.motion_variation_error(1e-3) == pytest.approx(0.4845e-3, rel=2e-3)
    assert transfer.motion_variation_error(1e3) == pytest.approx(0.5 * 1.2173)


@pytest.mark.parametrize(("length_px", "difference_px"), [(1.3, 0.2), (8.0, 0.5), (0.4, 1.0)])
def test_the_bound_holds_for_the_worst_picture(length_px: float, difference_px: float) -> None:
    """Black and white without correlation, and a checkerboard; one motion in the place of a longer or turned one."""
    noise = (torch.rand(1, 1, 256, 256, generator=torch.Generator().manual_seed(1)) > 0.5).double()
    noise[..., :128, :] = torch.arange(128)[:, None].add(torch.arange(256)) % 2
    seen = motion_blur(noise, (length_px, 0.0), border="circular")
    for other in ((length_px + difference_px, 0.0), (length_px, difference_px)):
        error = float(
            (motion_blur(noise, other, border="circular") - seen)[..., 32:96, :].square().mean().sqrt()
        )
        assert 0 < error <= transfer.motion_variation_error(difference_px)


def test_the_plan_says_when_one_motion_does() -> None:
    """White at 100 lux and 10 ms is so many DN that 0.484 of it per px is within 0.1 DN below some 1e-3 px."""
    none, little, much = (
        stage("motion variation", displacement_px=(5.0, 0.0), variation_px=px) for px in (0.0, 1e-6, 1.0)
    )
    assert (none.kept, little.kept, much.kept) == (False, False, True)
    assert none.contribution_dn == 0
    white_dn = 6905.94 * CAMERA.system_gain_dn_per_e  # at 100 lux in 10 ms
    assert much.contribution_dn == pytest.approx(0.4845 * white_dn, rel=1e-3)
    assert much.contribution_dn == pytest.approx(1e6 * little.contribution_dn, rel=1e-3)
    assert "each pixel's path" in much.how
    assert stage("motion", displacement_px=(5.0, 0.0), variation_px=1.0).kept
    with pytest.raises(ValueError, match="variation_px = -1"):
        stage("motion", variation_px=-1.0)


def test_simulate_blurs_by_the_flow() -> None:
    """Without noise and rounding it is the mean frame of the picture that the flow blurs."""
    image = pictures()
    clean: dict[str, Any] = {**GIVEN, "noise": False, "quantised": False, "fidelity": "full"}
    found = simulate(image, CAMERA, velocity_px_s=torch.from_numpy(FLOW), **clean)
    blurred = flow_blur(image, torch.from_numpy(FLOW * 0.05).float())
    expected = simulate(blurred, CAMERA, **clean)
    assert (found - expected).abs().max() < 1e-3 * CAMERA.full_scale_dn
    planned = simulate(image, CAMERA, velocity_px_s=torch.from_numpy(FLOW), **{**clean, "fidelity": "auto"})
    assert (found - planned).abs().max() < 1e-2 * CAMERA.full_scale_dn
    still = simulate(image, CAMERA, **clean)
    assert (found - still).abs().max() > 0.05 * CAMERA.full_scale_dn


def test_a_constant_flow_is_the_uniform_motion_to_the_bit() -> None:
    image = pictures(2)
    flow = torch.tensor([400.0, -90.0])[:, None, None].expand(2, 47, 61)
    found = simulate(image, CAMERA, velocity_px_s=flow, generator=[1, 2], **GIVEN)
    assert torch.equal(
        found, simulate(image, CAMERA, velocity_px_s=(400.0, -90.0), generator=[1, 2], **GIVEN)
    )


def test_a_flow_of_its_own_for_every_picture() -> None:
    image, flow = pictures(2), torch.from_numpy(np.stack([FLOW, -0.3 * FLOW]))
    both = simulate(image, CAMERA, velocity_px_s=flow, generator=[1, 2], **GIVEN)
    for item in (0, 1):
        alone = simulate(image[[item]], CAMERA, velocity_px_s=flow[item], generator=[item + 1], **GIVEN)
        assert torch.equal(both[[item]], alone)
    mixed = torch.stack([torch.from_numpy(FLOW).float(), torch.zeros(2, 47, 61)])
    still = simulate(image, CAMERA, generator=[1, 2], **GIVEN)
    assert torch.equal(simulate(image, CAMERA, velocity_px_s=mixed, generator=[1, 2], **GIVEN)[1], still[1])


def test_half_the_exposure_is_half_the_blur() -> None:
    clean: dict[str, Any] = {"encoding": "linear", "noise": False, "quantised": False}
    first = simulate(pictures(), CAMERA, exposure_s=0.02, illuminance_lux=200.0, velocity_px_s=FLOW, **clean)
    half = simulate(
        pictures(), CAMERA, exposure_s=0.01, illuminance_lux=400.0, velocity_px_s=2 * FLOW, **clean
    )
    assert (first - half).abs().max() < 0.3  # the dark current differs


def test_gradients_reach_the_flow() -> None:
    flow = torch.from_numpy(FLOW).float().requires_grad_()
    simulate(pictures(), CAMERA, velocity_px_s=flow, generator=1, **GIVEN).square().mean().backward()
    assert flow.grad is not None
    assert float(flow.grad.abs().sum()) > 0


@pytest.mark.parametrize(
    ("flow", "named"),
    [
        (torch.zeros(2, 47, 60), r"velocity_px_s: shape must be \(2, 47, 61\) or \(1, 2, 47, 61\)"),
        (torch.full((2, 47, 61), math.nan), "velocity_px_s: contains NaN"),
        (torch.full((2, 47, 61), 1e9), "displacement_px: velocity times exposure"),
    ],
)  # fmt: skip
def test_bad_flows_are_named(flow: torch.Tensor, named: str) -> None:
    with pytest.raises(ValueError, match=named):
        ExposedScene(pictures()).expose(CAMERA, velocity_px_s=flow, exposure_s=0.01, illuminance_lux=1.0)
