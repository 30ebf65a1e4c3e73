"""Resampling: positions, what waves keep, borders, both routes."""

from __future__ import annotations

import cmath
import math
from typing import Any

import cv2
import numpy as np
import pytest
import torch
from scipy.interpolate import BSpline

from blurnoise._core.borders import BORDERS, extended
from blurnoise.blur import resampling
from blurnoise.blur.resampling import sampled

H, W = 37, 53


def picture(kind: torch.dtype = torch.float64, planes: int = 2) -> torch.Tensor:
    return torch.rand(1, planes, H, W, generator=torch.Generator().manual_seed(1), dtype=torch.float64).to(
        kind
    )


def places(seed: int = 0, margin: float = 0.0) -> tuple[Any, Any]:
    rng = np.random.default_rng(seed)
    return rng.uniform(-margin, W - 1 + margin, (11, 17)), rng.uniform(-margin, H - 1 + margin, (11, 17))


def by_torch(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(resampling, "_remaps_exactly", lambda: False)


@pytest.mark.parametrize("kind", [torch.float32, torch.float64])
def test_pixels_are_what_they_were(kind: torch.dtype) -> None:
    image = picture(kind)
    y, x = np.mgrid[:H, :W].astype(float)
    tolerance = 1e-10 if kind == torch.float64 else 3e-4  # 6e-5 px, as single precision has positions
    assert float((sampled(image, x, y, "reflect") - image).abs().max()) < tolerance


def test_positions_are_exact() -> None:
    """A ramp is seen where it is, which OpenCV's cubic misses by 0.048 px."""
    ramp = torch.arange(W, dtype=torch.float64).expand(1, 1, H, W).contiguous()
    x = np.linspace(15, 35, 401)[None].repeat(3, 0)
    y = np.full_like(x, 18.3)
    assert float((sampled(ramp, x, y, "replicate") - torch.from_numpy(x)).abs().max()) < 1e-4
    single = sampled(ramp.float(), x, y, "replicate")
    assert float((single - torch.from_numpy(x)).abs().max()) < 2e-4
    cubic = cv2.remap(ramp[0, 0].float().numpy(), x.astype(np.float32), y.astype(np.float32), cv2.INTER_CUBIC)
    assert np.abs(cubic - x).max() > 0.04


def response(f: float, shift_px: float = 0.5) -> complex:
    """What a cardinal spline of the fifth degree keeps of a wave of f cycles/px, by SciPy's; 1 is no loss."""
    spline = BSpline.basis_element(np.arange(-3.0, 4.0), extrapolate=False)
    places = np.arange(-3, 4)
    seen = np.nan_to_num(spline(places - shift_px)) @ np.exp(2j * np.pi * f * (places - shift_px))
    return complex(seen / (np.nan_to_num(spline(places)) @ np.cos(2 * np.pi * f * places)))


@pytest.mark.parametrize(("f", "kept"), [(0.1, 0.99999), (0.25, 0.9971), (0.35, 0.9518), (0.4, 0.8377)])
def test_what_waves_keep_halfway_between_pixels(f: float, kept: float) -> None:
    assert abs(response(f)) == pytest.approx(kept, abs=5e-5)
    assert abs(response(f, 0.0)) == pytest.approx(1)


@pytest.mark.parametrize("shift", [0.5, 0.3])
def test_response_is_that_of_the_picture(shift: float) -> None:
    """A complex wave of a whole number of periods, seen ``shift`` away: what comes back at its own frequency."""
    n, periods = 40, 14
    f = periods / n
    wave = torch.exp(2j * torch.pi * f * torch.arange(n, dtype=torch.float64))
    both = torch.stack([wave.real, wave.imag])[None, :, None].expand(-1, -1, 6, -1).contiguous()
    x = np.arange(n)[None].repeat(2, 0) + shift
    seen = sampled(both, x, np.full_like(x, 2.0), "circular")[0, :, 0]
    at = sum(
        complex(*each) * cmath.exp(-2j * math.pi * f * (place + shift))
        for place, each in enumerate(seen.T.tolist())
    )
    assert at / n == pytest.approx(response(f, shift), abs=1e-6)


@pytest.mark.parametrize("border", BORDERS)
def test_outside_the_picture_its_border_goes_on(border: Any) -> None:
    image, (x, y) = picture(), places(margin=12.0)
    wide = extended(image, (80, 80), (H + 160, W + 160), border)
    expected = sampled(wide, x + 80, y + 80, "replicate")
    tolerance = (
        0.35 if border == "replicate" else 1e-6
    )  # a spline overshoots where its picture turns constant
    off = (sampled(image, x, y, border) - expected).abs()
    assert float(off.max()) < tolerance
    inside = torch.from_numpy((x > 6) & (x < W - 7) & (y > 6) & (y < H - 7))
    assert float(off[..., inside].max()) < 1e-6


def test_far_outside_black_is_black() -> None:
    seen = sampled(picture() + 1, np.array([[-40.0, 1e4]]), np.array([[5.0, -1e5]]), "constant")
    assert float(seen.abs().max()) < 1e-5


@pytest.mark.parametrize("border", BORDERS)
def test_both_routes_agree(border: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    image, (x, y) = picture(torch.float32, 3).expand(2, -1, -1, -1), places(margin=5.0)
    assert resampling._remaps_exactly()
    quick = sampled(image, x, y, border)
    by_torch(monkeypatch)
    assert float((sampled(image, x, y, border) - quick).abs().max()) < 3e-4
    assert float((sampled(image.double(), x, y, border) - quick).abs().max()) < 3e-4


def test_gradients() -> None:
    x, y = np.array([[1.3, 5.6, -2.0]]), np.array([[0.2, 3.9, 9.0]])
    image = torch.rand(1, 1, 6, 7, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda light: sampled(light, x, y, "reflect"), image)


@pytest.mark.parametrize("kind", [torch.float32, torch.float64])
@pytest.mark.parametrize("border", ["reflect", "replicate", "circular"])
def test_a_picture_of_one_pixel(border: Any, kind: torch.dtype) -> None:
    image = torch.full((2, 3, 1, 1), 0.7, dtype=kind)
    seen = sampled(image, np.array([[0.4, -3.0]]), np.array([[0.0, 0.0]]), border)
    torch.testing.assert_close(seen, torch.full((2, 3, 1, 2), 0.7, dtype=kind))


def test_bits_depend_on_neither_batch_nor_threads() -> None:
    image = torch.rand(3, 2, 300, 400)
    x, y = np.meshgrid(np.linspace(3, 390, 400), np.linspace(2, 290, 300))
    before = torch.get_num_threads()
    try:
        torch.set_num_threads(1)
        alone = torch.cat([sampled(each[None], x, y, "reflect") for each in image])
        torch.set_num_threads(2)
        assert torch.equal(sampled(image, x, y, "reflect"), alone)
    finally:
        torch.set_num_threads(before)
