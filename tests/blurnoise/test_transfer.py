"""Transfer functions: published anchors, their own point spreads, bounds that hold."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
import torch
from blurs import optical_blur
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq
from torch import Tensor

from blurnoise.blur import convolution
from blurnoise.optics import transfer
from blurnoise.optics.transfer import Optics


def crossing(curve: Callable[[Tensor], Tensor], level: float, high: float) -> float:
    def above(f: float) -> float:
        return float(curve(torch.tensor([[f]], dtype=torch.float64))) - level

    return float(brentq(above, 1e-6, high))


def box(length_px: float) -> Callable[[Tensor], Tensor]:
    displacement = torch.tensor([length_px, 0.0], dtype=torch.float64)
    return lambda f: transfer.motion(f, torch.zeros_like(f), displacement)


@pytest.mark.parametrize(
    ("curve", "level", "expected"),
    [
        (box(7.0), 0.5, 0.603355 / 7),
        (box(7.0), 0.2, 0.826250 / 7),
        (box(7.0), 0.1, 0.907929 / 7),
        (lambda f: transfer.disc(f, 3.0), 0.5, 0.352542 / 3),
        (lambda f: transfer.disc(f, 3.0), 0.0, 0.609835 / 3),
        (lambda f: transfer.gaussian(f, 1.5), 0.5, 0.187391 / 1.5),
        (lambda f: transfer.diffraction(f, 4.0), 0.5, 0.403973 / 4),
        (lambda f: transfer.pixel(f, torch.zeros_like(f)) * box(1.0)(f), 0.5, 0.44295),
        (lambda f: transfer.pixel(f, torch.zeros_like(f)) * box(3.0)(f), 0.5, 0.19321),
        (lambda f: transfer.pixel(f, torch.zeros_like(f)) * box(30.0)(f), 0.5, 0.02010),
    ],
)
def test_published_crossings(curve: Callable[[Tensor], Tensor], level: float, expected: float) -> None:
    """The digits of the table in the field's terms: MTF50, MTF20, MTF10, first zero, in cycles/px."""
    high = 1.01 * expected if level == 0 else 1.4 * expected
    assert crossing(curve, level, high) == pytest.approx(expected, rel=2e-4 if expected < 0.5 else 2e-5)


def test_motion_takes_the_product_of_vectors() -> None:
    """Motion along a diagonal leaves a grating across it alone; a sinc per axis would not."""
    f = torch.tensor([[0.2]])
    across = transfer.motion(f, -f, torch.tensor([9.0, 9.0]))
    along = transfer.motion(f, f, torch.tensor([9.0, 9.0]))
    assert float(across) == pytest.approx(1.0)
    assert float(along) == pytest.approx(math.sin(3.6 * math.pi) / (3.6 * math.pi), abs=1e-6)


def test_fast_sinc_is_torchs() -> None:
    x = torch.cat([torch.linspace(-300, 300, 10_007), torch.tensor([0.0, 1e-30, -1e-12])])
    torch.testing.assert_close(transfer.sinc(x.double()), torch.sinc(x.double()), atol=1e-14, rtol=0)
    torch.testing.assert_close(transfer.sinc(x), torch.sinc(x), atol=1e-6, rtol=0)


def test_gradient_at_rest_is_zero_and_curvature_right() -> None:
    """sinc(f d) = 1 - (pi f d)^2 / 6: flat at rest."""
    still = torch.zeros(2, dtype=torch.float64, requires_grad=True)
    f = torch.tensor([[0.3]], dtype=torch.float64)
    (gradient,) = torch.autograd.grad(transfer.motion(f, f, still).sum(), still)
    assert torch.equal(gradient, torch.zeros(2, dtype=torch.float64))


def test_disc_is_the_transform_of_its_pixel_areas() -> None:
    """Exact areas have the disc's response times the pixel's, up to aliases that fall as f^-3/2 and faster."""
    kernel = convolution.disc(6.0)
    half = kernel.shape[0] // 2
    f = np.linspace(0, 0.12, 25)
    offsets = np.arange(-half, half + 1)
    response = (kernel.sum(axis=0) * np.cos(2 * np.pi * f[:, None] * offsets)).sum(axis=1)
    fx = torch.tensor(f)
    closed = transfer.disc(fx, 6.0) * transfer.pixel(fx, torch.zeros_like(fx))
    np.testing.assert_allclose(response, closed.numpy(), atol=2e-3)


def test_optical_blur_counts_the_pixel_once() -> None:
    """R = 1: MTF50 0.3122 cycles/px over pixel and disc, not 0.2682 with the pixel counted twice."""
    width = 512
    x = torch.arange(width, dtype=torch.float64)
    f = round(0.3122 * width) / width
    wave = torch.cos(2 * math.pi * f * x).expand(1, 1, 4, width)
    blurred = optical_blur(wave, Optics(defocus_radius_px=1.0), border="circular")
    amplitude = float((blurred[0, 0, 0] * wave[0, 0, 0]).mean() * 2)
    pixel = math.sin(math.pi * f) / (math.pi * f)
    assert amplitude * pixel == pytest.approx(0.5, abs=0.002)


@settings(max_examples=30, deadline=None)
@given(st.floats(0, 0.05), st.floats(0, 0.05), st.floats(0, 0.05))
def test_predicted_error_bounds_the_worst_picture(radius: float, sigma: float, lambda_n: float) -> None:
    """White noise of black and white, the worst picture, changes by no more than ``Optics.error`` says."""
    optics = Optics(radius, sigma, lambda_n)
    picture = (torch.rand(1, 1, 64, 64, generator=torch.Generator().manual_seed(2)).double() > 0.5).double()
    blurred = optical_blur(picture, optics, border="circular")
    changed = float((blurred - picture).square().mean().sqrt())
    assert changed <= 1.1 * optics.error + 1e-12


@pytest.mark.parametrize("name", ["defocus_radius_px", "gaussian_sigma_px", "diffraction_lambda_n_px"])
def test_a_negative_cause_is_named(name: str) -> None:
    with pytest.raises(ValueError, match=name):
        Optics(**{name: -0.1})
