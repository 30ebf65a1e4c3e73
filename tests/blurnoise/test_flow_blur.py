"""Blur by a flow: against exact sub-exposures of a road, a closed form of an approach, and the uniform blur."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from blurs import flow_blur
from projection import projected
from torch import Tensor

from blurnoise import motion_blur
from blurnoise._core.borders import BORDERS, Border
from blurnoise.blur import resampling
from blurnoise.motion.ego import EgoMotion, Vehicle, View, range_of_depth_m
from blurnoise.optics.colour import srgb_from_linear

VIEW = View(321, 241, 60.0, "rectilinear")  # f = 278 px: displacements half of those at 640 px


def scene(height: int = 241, width: int = 321, seed: int = 0) -> Tensor:
    """Texture of a 1/f spectrum in [0, 1] behind a lens, a Gaussian of 0.6 px, (1, 3, H, W)."""
    random = torch.Generator().manual_seed(seed)
    noise = torch.randn(1, 3, height, width, generator=random)
    f = torch.hypot(torch.fft.fftfreq(height)[:, None], torch.fft.rfftfreq(width))
    shaped = torch.exp(-2 * (torch.pi * 0.6 * f) ** 2) / (f + 0.5 / width)
    smooth = torch.fft.irfft2(torch.fft.rfft2(noise) * shaped, s=(height, width))
    return (0.4 + 0.2 * smooth / smooth.std()).clamp(0, 1)


def uniform(x: float, y: float, image: Tensor) -> Tensor:
    return torch.tensor([x, y])[:, None, None].expand(2, *image.shape[-2:])


def dn(first: Tensor, second: Tensor) -> float:
    """RMS difference as 8-bit sRGB pictures show it."""
    a, b = (255 * srgb_from_linear(each.clamp(0, 1)) for each in (first, second))
    return float((a - b).square().mean().sqrt())


@pytest.mark.slow
def test_a_road_by_exact_sub_exposures() -> None:
    """128 exact paths of the road, seen through splines, are met to 1.5 DN; no blur and one blur are far off."""
    image, mount = scene(), Vehicle(1.4)
    motion, exposure_s = mount.driving(100 / 3.6), 0.01
    pixels = VIEW.pixels()
    rays = VIEW.rays(pixels)
    range_m = mount.road_m(rays)
    flow = VIEW.flow_px_s(pixels, range_m, motion) * exposure_s
    velocity = np.array(motion.velocity_m_s)[:, None, None]
    truth = torch.zeros_like(image)
    points = rays * np.where(np.isfinite(range_m), range_m, 1e9)
    for place in range(128):
        time_s = ((place + 0.5) / 128 - 0.5) * exposure_s
        x, y = projected(
            VIEW, points + velocity * time_s
        )  # what stands there now, where it is at mid-exposure
        truth += resampling.sampled(image, x, y, "reflect") / 128
    blurred = flow_blur(image, torch.from_numpy(flow))
    middle = torch.from_numpy((flow.max((1, 2)) + flow.min((1, 2))) / 2)
    assert dn(blurred, truth) < 1.5
    assert dn(image, truth) > 5 * dn(blurred, truth)
    assert dn(motion_blur(image, middle), truth) > 5 * dn(blurred, truth)
    assert dn(flow_blur(image, -2 * torch.from_numpy(flow)), truth) > 2 * dn(blurred, truth)


def test_an_approach() -> None:
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


def test_rings_around_the_axis_stay_as_a_camera_rolls() -> None:
    """And spokes do not."""
    view = View(161, 121, 60.0, "rectilinear")
    pixels = view.pixels()
    sky = np.full(pixels.shape[1:], np.inf)
    flow = torch.from_numpy(view.flow_px_s(pixels, sky, EgoMotion(rotation_deg_s=(0, 0, 400.0))) * 0.01)
    x, y = pixels[0] - 80, pixels[1] - 60
    rings = torch.from_numpy(0.5 + 0.4 * np.cos(2 * np.pi * np.hypot(x, y) / 8))[None, None].float()
    spokes = torch.from_numpy(0.5 + 0.4 * np.cos(40 * np.arctan2(y, x)))[None, None].float()
    inside = (..., slice(20, -20), slice(20, -20))
    # straight paths of 4 degrees leave a ring by r theta^2 / 8 < 0.05 px
    assert float((flow_blur(rings, flow.float()) - rings)[inside].abs().max()) < 0.03
    assert (
        float((flow_blur(spokes, flow.float()) - spokes)[inside].abs().max()) > 0.1
    )  # of 0.4, 1 - sinc(4 degrees of 40 waves)


@pytest.mark.parametrize("border", BORDERS)
@pytest.mark.parametrize("displacement_px", [(9.0, 0.0), (-6.0, 14.0), (300.0, 3.0)])
def test_a_constant_flow_is_the_uniform_blur(border: Border, displacement_px: tuple[float, float]) -> None:
    """To what linear interpolation and the spacing leave."""
    image = scene(99, 131)
    found = flow_blur(image, uniform(*displacement_px, image), border=border)
    expected = motion_blur(image, displacement_px, border=border)
    assert dn(found, expected) < 1.2
    assert dn(found, expected) < 0.2 * dn(image, expected)


@pytest.mark.parametrize("border", BORDERS)
def test_both_routes(border: Border) -> None:
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


def test_gradients() -> None:
    image = scene(9, 8)[:, :1].double().requires_grad_()
    flow = (
        torch.rand(2, 9, 8, dtype=torch.float64, generator=torch.Generator().manual_seed(2)) + 1.3
    ).requires_grad_()
    assert torch.autograd.gradcheck(flow_blur, (image, flow))


def test_invariants() -> None:
    """A constant stays, as does what does not move; neither the batch nor the number of channels matters."""
    flow = 30 * torch.rand(2, 2, 70, 41, generator=torch.Generator().manual_seed(3))
    flat = torch.full((2, 1, 70, 41), 0.3)
    assert (flow_blur(flat, flow) - flat).abs().max() < 1e-6
    assert torch.equal(
        flow_blur(flat * 0, flow), flat * 0
    )  # others differ by the rounding of sums over moments
    pictures = torch.cat([scene(70, 41, 1), scene(70, 41, 2)])
    assert flow_blur(pictures, torch.zeros(2, 70, 41)) is pictures
    both = flow_blur(pictures, flow)
    assert torch.equal(both[1:], flow_blur(pictures[1:], flow[1:]))
    five = torch.cat([pictures[:1], pictures[1:, :2]], 1)
    # beyond four channels OpenCV samples at 1/32 of a value
    assert (flow_blur(five, flow[:1])[:, :3] - both[:1]).abs().max() < 3e-3
    assert (flow_blur(pictures[:, :1], flow) - both[:, :1]).abs().max() < 1e-6
    half = flow.clone()
    half[..., 20:] = 0
    assert (flow_blur(pictures, half)[..., 20:] - pictures[..., 20:]).abs().max() < 1e-6


@pytest.mark.parametrize("length_px", [0.05, 0.4, 2.0])
def test_short_paths_blur_as_much_as_they_should(length_px: float) -> None:
    """By the variance of the exposure's times: to 2 %, where a mean of two even times would lose a quarter.

    Half of that loss is 12 %; linear interpolation between half-pixels adds up to 1/16 px^2 of its own, compared here
    along a direction in which nothing varies faster than 0.05 cycles/px.
    """
    f = 0.05
    x = torch.arange(200, dtype=torch.float64)
    wave = (0.5 + 0.4 * torch.cos(2 * torch.pi * f * x)).expand(1, 1, 40, 200)
    seen = flow_blur(wave, uniform(length_px, 0, wave))[0, 0, 20, 20:180]
    kept = (seen - 0.5).abs().max() / 0.4
    lost = (math.pi * f * length_px) ** 2 / 6 + 2 * math.pi**2 * f**2 / 24  # the latter: interpolation's mean
    assert float(1 - kept) <= 1.1 * lost + 1e-6
    if length_px == 2.0:
        assert float(1 - kept) >= 0.98 * (math.pi * f * length_px) ** 2 / 6


def test_mid_exposure_and_the_way() -> None:
    """A dot moving right by 8 px is a streak about its place; one that leaves the picture's left half leaves none."""
    image = torch.zeros(1, 1, 21, 41)
    image[..., 10, 20] = 1
    seen = flow_blur(image, uniform(8, 0, image))[0, 0]
    place = (seen.sum(0) * torch.arange(41)).sum() / seen.sum()
    assert float(place) == pytest.approx(20, abs=1e-5)
    assert float(seen.sum()) == pytest.approx(1, abs=1e-5)
    only_right = uniform(8, 0, image).clone()
    only_right[..., :20] = 0
    assert flow_blur(image, only_right)[0, 0, 10, :20].sum() == 0


@pytest.mark.parametrize(
    ("flow", "named"),
    [
        (torch.zeros(2), r"displacement_px: shape must be \(2, 5, 7\) or \(3, 2, 5, 7\), got \(2,\)"),
        (torch.zeros(2, 2, 5, 7), "shape must be"),
        (torch.full((2, 5, 7), math.nan), "displacement_px: contains NaN"),
        (torch.full((2, 5, 7), 1e6), "displacement_px = .* must be finite and >= -100000"),
    ],
)  # fmt: skip
def test_bad_input_is_named(flow: Tensor, named: str) -> None:
    with pytest.raises(ValueError, match=named):
        flow_blur(torch.zeros(3, 1, 5, 7), flow)
    with pytest.raises(ValueError, match="border"):
        flow_blur(torch.zeros(3, 1, 5, 7), torch.zeros(2, 5, 7), border="mirror")  # type: ignore[arg-type]


@pytest.mark.parametrize("kind", [torch.float32, torch.float64])
@pytest.mark.parametrize("along", [(1.0, 0.0), (0.0, 1.0)])
def test_black_beyond_the_border_begins_alike_on_all_sides(
    along: tuple[float, float], kind: torch.dtype
) -> None:
    """Between the first pixel and the black before it there are values, too; else that side is darker by 0.14."""
    flow = torch.tensor(along, dtype=kind)[:, None, None].expand(2, 9, 12)
    seen = flow_blur(torch.ones(1, 1, 9, 12, dtype=kind), flow, border="constant")
    assert float((seen - seen.flip(-1, -2)).abs().max()) < 1e-6
    exact = motion_blur(torch.ones(1, 1, 9, 12, dtype=kind), along, method="transfer", border="constant")
    assert float((seen - exact).abs().max()) < 0.08


@pytest.mark.parametrize("angle_deg", [0.0, 30.0])
@pytest.mark.parametrize("length_px", [0.05, 0.2, 0.5, 0.7, 1.5, 2.0])
def test_short_paths_are_worth_their_blur(length_px: float, angle_deg: float) -> None:
    """Of a picture whose power falls with the frequency as a photograph's, f^-2, against the transfer function."""
    f = torch.fft.fftfreq(128, dtype=torch.float64)
    noise = torch.fft.fft2(torch.randn(128, 128, generator=torch.Generator().manual_seed(3)).double())
    image = torch.fft.ifft2(noise / torch.hypot(f[:, None], f).clamp_min(1 / 128)).real
    image = ((image - image.min()) / (image.max() - image.min())).float()[None, None]
    along = length_px * math.cos(math.radians(angle_deg)), length_px * math.sin(math.radians(angle_deg))
    truth = motion_blur(image, along, border="circular", method="transfer")
    off = float((flow_blur(image, uniform(*along, image), border="circular") - truth).square().mean())
    assert off <= (0.8 if angle_deg else 0.3) ** 2 * float((image - truth).square().mean())


@pytest.mark.parametrize("longest_px", [0.0, 3.0, 9.0, 20.0])
@pytest.mark.parametrize("length_px", [0.1, 0.6, 1.3, 2.0, 5.3])
def test_a_spot_spreads_by_the_variance_of_its_path(length_px: float, longest_px: float) -> None:
    """L^2 / 12, also where others of its band move by more, and no more than 0.002 px^2 across it."""
    away = torch.arange(61, dtype=torch.float64) - 30
    spot = torch.exp(-(away[:, None] ** 2 + away**2) / 8)[None, None].float()
    flow = uniform(length_px, 0.0, spot).clone()
    flow[0, :, :2] = max(longest_px, length_px)
    for seen in (flow_blur(spot, flow), flow_blur(spot.double(), flow.double())):
        share = seen[0, 0].double() / seen.sum()
        assert float((share * away**2).sum()) - 4 == pytest.approx(length_px**2 / 12, abs=2e-3)
        assert float((share * away[:, None] ** 2).sum()) - 4 == pytest.approx(0.0, abs=2e-3)
