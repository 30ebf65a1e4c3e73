"""Blur by a flow: a closed form of an approach, the uniform blur, its bound, and what simulate makes of it."""

from typing import Any

import numpy as np
import pytest
import torch
from brute_force import photograph

from blurnoise import Camera, Exposure, Scene, motion_blur, plan, simulate
from blurnoise._core.borders import BORDERS
from blurnoise.blur.sub_exposures import exposed, flowing
from blurnoise.camera import transfer
from blurnoise.camera.colour import srgb_from_linear
from blurnoise.motion.ego import EgoMotion, Vehicle, View, range_of_depth_m

CAMERA = Camera.preset("imx250")
VIEW = View(61, 47, 60.0, "rectilinear")
FLOW = torch.from_numpy(
    VIEW.flow_px_s(VIEW.pixels(), Vehicle().road_m(VIEW.rays(VIEW.pixels())), Vehicle().driving(14.0, 10.0))
)
GIVEN: dict[str, Any] = {"exposure_s": 0.05, "illuminance_lux": 300.0, "encoding": "linear"}


def flow_blur(image, displacement_px, *, border="reflect"):
    """Pictures (B, C, H, W) of which each pixel averages from d/2 before it to d/2 behind, d (2, H, W) or
    (B, 2, H, W), px."""
    sheets = flowing(image, displacement_px, border)
    if all(sheet.moves.still for sheet in sheets):
        return image
    return torch.stack([exposed(sheet) for sheet in sheets])


def scene(height, width, seed=0):
    return torch.from_numpy(photograph(height, width, seed, 3)).float()


def uniform(x, y, image):
    return torch.tensor([x, y])[:, None, None].expand(2, *image.shape[-2:])


def dn(first, second):
    """RMS difference as 8-bit sRGB pictures show it."""
    a, b = (255 * srgb_from_linear(each.clamp(0, 1)) for each in (first, second))
    return float((a - b).square().mean().sqrt())


def test_an_approach():
    """A disc of r0 = 200 px before a plane nearing by 5 %: I(r) = 1/2 - (Z/(V T))(1 - r0/r)."""
    view = View(481, 481, 60.0, "rectilinear")
    pixels = view.pixels()
    x, y = pixels - 240.0
    disc = torch.from_numpy((200.5 - np.hypot(x, y)).clip(0, 1))[None, None]  # its edge of 1 px is at 200 px
    flow = view.flow_px_s(pixels, range_of_depth_m(view.rays(pixels), 10.0), EgoMotion((0, 0, 10.0))) * 0.05
    seen = flow_blur(disc, torch.from_numpy(flow))[0, 0, 240]
    assert float(seen[240 + 196]) == pytest.approx(0.90816, abs=5e-3)
    assert float(seen[240 + 202]) == pytest.approx(0.30198, abs=5e-3)
    assert seen[240 - 196] == pytest.approx(float(seen[240 + 196]), abs=1e-9)


@pytest.mark.parametrize("border", BORDERS)
@pytest.mark.parametrize("displacement_px", [(9.0, 0.0), (-6.0, 14.0), (300.0, 3.0)])
def test_a_constant_flow_is_the_uniform_blur(border, displacement_px):
    """To what linear interpolation and the spacing leave."""
    image = scene(99, 131)
    found = flow_blur(image, uniform(*displacement_px, image), border=border)
    expected = motion_blur(image, displacement_px, border=border)
    assert dn(found, expected) < 1.2
    assert dn(found, expected) < 0.2 * dn(image, expected)


@pytest.mark.parametrize("border", BORDERS)
def test_both_routes(border):
    """OpenCV's and PyTorch's, in single precision; the double one is PyTorch's."""
    image = scene(70, 83)
    random = torch.Generator().manual_seed(1)
    flow = 40 * torch.rand(2, 70, 83, generator=random) - 15
    fast = flow_blur(image, flow, border=border)
    slow = flow_blur(image.double(), flow.double(), border=border)
    assert fast.dtype == torch.float32
    assert (fast - slow).abs().max() < 2e-4
    assert torch.equal(
        flow_blur(image.requires_grad_(), flow, border=border).detach(),
        flow_blur(image, flow, border=border).detach(),
    )


def test_gradients():
    image = scene(9, 8)[:, :1].double().requires_grad_()
    flow = (
        torch.rand(2, 9, 8, dtype=torch.float64, generator=torch.Generator().manual_seed(2)) + 1.3
    ).requires_grad_()
    assert torch.autograd.gradcheck(flow_blur, (image, flow))


def test_invariants():
    """A constant stays, as does what does not move; neither the batch nor the number of channels matters."""
    flow = 30 * torch.rand(2, 2, 70, 41, generator=torch.Generator().manual_seed(3))
    flat = torch.full((2, 1, 70, 41), 0.3)
    assert (flow_blur(flat, flow) - flat).abs().max() < 1e-6
    pictures = torch.cat([scene(70, 41, 1), scene(70, 41, 2)])
    assert flow_blur(pictures, torch.zeros(2, 70, 41)) is pictures
    both = flow_blur(pictures, flow)
    assert torch.equal(both[1:], flow_blur(pictures[1:], flow[1:]))
    five = torch.cat([pictures[:1], pictures[1:, :2]], 1)
    # beyond four channels OpenCV samples at 1/32 of a value
    assert (flow_blur(five, flow[:1])[:, :3] - both[:1]).abs().max() < 3e-3
    half = flow.clone()
    half[..., 20:] = 0
    assert (flow_blur(pictures, half)[..., 20:] - pictures[..., 20:]).abs().max() < 1e-6


@pytest.mark.parametrize("longest_px", [0.0, 9.0, 20.0])
@pytest.mark.parametrize("length_px", [0.1, 1.3, 5.3])
def test_a_spot_spreads_by_the_variance_of_its_path(length_px, longest_px):
    """L^2 / 12, also where others of its band move by more, and no more than 0.002 px^2 across it."""
    away = torch.arange(61, dtype=torch.float64) - 30
    spot = torch.exp(-(away[:, None] ** 2 + away**2) / 8)[None, None].float()
    flow = uniform(length_px, 0.0, spot).clone()
    flow[0, :, :2] = max(longest_px, length_px)
    for seen in (flow_blur(spot, flow), flow_blur(spot.double(), flow.double())):
        share = seen[0, 0].double() / seen.sum()
        assert float((share * away**2).sum()) - 4 == pytest.approx(length_px**2 / 12, abs=2e-3)
        assert float((share * away[:, None] ** 2).sum()) - 4 == pytest.approx(0.0, abs=2e-3)


def pictures(batch=1):
    return torch.rand(batch, 1, 47, 61, generator=torch.Generator().manual_seed(5)) * 0.8


def variation_planned(px):
    """The plan of motion of 5 px that differs by this in the two halves of a white picture."""
    flow = torch.zeros(1, 2, 8, 10, dtype=torch.float64)
    flow[:, 0] = 500.0
    flow[:, 0, :, :5] -= 100.0 * px
    flow[:, 0, :, 5:] += 100.0 * px
    exposure = Exposure(CAMERA, 0.01, 100.0, flow, seed=[0])
    stages = plan(exposure, Scene(torch.ones(1, 1, 8, 10, dtype=torch.float64))).stages
    return next(stage for stage in stages if stage.name == "motion variation")


@pytest.mark.parametrize(("length_px", "difference_px"), [(1.3, 0.2), (8.0, 0.5), (0.4, 1.0)])
def test_the_bound_holds_for_the_worst_picture(length_px, difference_px):
    """Black and white without correlation, and a checkerboard; one motion in the place of a longer or turned one."""
    noise = (torch.rand(1, 1, 256, 256, generator=torch.Generator().manual_seed(1)) > 0.5).double()
    noise[..., :128, :] = torch.arange(128)[:, None].add(torch.arange(256)) % 2
    seen = motion_blur(noise, (length_px, 0.0), border="circular")
    for other in ((length_px + difference_px, 0.0), (length_px, difference_px)):
        error = float(
            (motion_blur(noise, other, border="circular") - seen)[..., 32:96, :].square().mean().sqrt()
        )
        assert 0 < error <= transfer.motion_variation_error(difference_px)


def test_the_plan_says_when_one_motion_does():
    """White at 100 lux and 10 ms is so many DN that 0.484 of it per px is within 0.1 DN below some 1e-3 px."""
    none, little, much = map(variation_planned, (0.0, 1e-6, 1.0))
    assert (none.kept, little.kept, much.kept) == (False, False, True)
    assert none.contribution_dn == 0
    white_dn = 6905.94 * CAMERA.sensor.system_gain_dn_per_e  # at 100 lux in 10 ms
    assert much.contribution_dn == pytest.approx(0.4845 * white_dn, rel=1e-3)
    assert much.contribution_dn == pytest.approx(1e6 * little.contribution_dn, rel=1e-3)
    assert "each pixel's path" in much.how


def test_a_constant_flow_is_the_uniform_motion_to_the_bit():
    image = pictures(2)
    flow = torch.tensor([400.0, -90.0])[:, None, None].expand(2, 47, 61)
    found = simulate(image, CAMERA, velocity_px_s=flow, generator=[1, 2], **GIVEN)
    assert torch.equal(
        found, simulate(image, CAMERA, velocity_px_s=(400.0, -90.0), generator=[1, 2], **GIVEN)
    )


@pytest.mark.parametrize("row_time_s", [0.0, 2e-5])
def test_with_a_plan_a_flow_is_the_same_within_the_tolerance(row_time_s):
    camera = CAMERA.with_figures(row_time_s=row_time_s, shutter="rolling" if row_time_s else "global")
    clean = {"noise": False, "quantised": False, "velocity_px_s": FLOW, **GIVEN}
    auto, full = (simulate(pictures(), camera, **clean, fidelity=way) for way in ("auto", "full"))
    assert float((auto - full).square().mean().sqrt()) < 0.1
    assert (
        float((full - simulate(pictures(), camera, **clean | {"velocity_px_s": 0 * FLOW})).abs().max()) > 200
    )
