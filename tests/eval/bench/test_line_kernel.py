"""Kernels of motion: moments against the line itself, and pictures against the transfer function."""

from __future__ import annotations

import math

import kornia
import numpy as np
import pytest
import torch
from blurnoise_eval.bench.line_kernel import line_kernel
from hypothesis import given, settings
from hypothesis import strategies as st

from blurnoise import motion_blur

LENGTHS = st.floats(0.0, 80.0)
ANGLES = st.floats(-180.0, 180.0)


def line(length: float, angle_deg: float) -> tuple[np.ndarray, np.ndarray]:
    direction = np.array([math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))])
    displacement = length * direction
    return line_kernel(torch.tensor(displacement[None], dtype=torch.float64))[0].numpy(), displacement


def moments(kernel: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    height, width = kernel.shape
    y, x = np.mgrid[:height, :width] - np.array([height // 2, width // 2])[:, None, None]
    points = np.stack([x, y])
    mean = np.einsum("hw,khw->k", kernel, points)
    second = np.einsum("hw,khw,lhw->kl", kernel, points, points)
    return float(kernel.sum()), mean, second


@settings(max_examples=60, deadline=None)
@given(LENGTHS, ANGLES)
def test_line_has_unit_sum_centroid_and_the_lines_own_covariance(length: float, angle_deg: float) -> None:
    """A uniform line of displacement d has covariance d d^T / 12: the length is exact at any angle."""
    kernel, displacement = line(length, angle_deg)
    total, mean, second = moments(kernel)
    assert total == pytest.approx(1, abs=1e-12)
    np.testing.assert_allclose(mean, 0, atol=1e-9)
    np.testing.assert_allclose(second, np.outer(displacement, displacement) / 12, atol=1e-9 * (1 + length**2))


def test_a_kernel_ten_percent_longer_would_be_noticed() -> None:
    kernel, _ = line(11.0, 17.0)
    _, displacement = line(10.0, 17.0)
    assert not np.allclose(moments(kernel)[2], np.outer(displacement, displacement) / 12, rtol=0.1)


def test_no_motion_is_one_tap() -> None:
    assert line_kernel(torch.zeros(2, 2)).shape == (2, 1, 1)
    assert torch.equal(line_kernel(torch.zeros(1, 2)), torch.ones(1, 1, 1))


def test_axis_motion_needs_one_line_of_taps() -> None:
    assert line_kernel(torch.tensor([[6.5, 0.0]])).shape[1] == 1
    assert line_kernel(torch.tensor([[0.0, 6.5]])).shape[2] == 1


@settings(max_examples=30, deadline=None)
@given(LENGTHS, ANGLES)
def test_turning_motion_turns_the_kernel(length: float, angle_deg: float) -> None:
    """(x, y) -> (y, -x) is a quarter turn; the mirrored motion has the same kernel."""
    direction = math.radians(angle_deg)
    x, y = length * math.cos(direction), length * math.sin(direction)
    kernel = line_kernel(torch.tensor([[x, y]], dtype=torch.float64))[0]
    turned = line_kernel(torch.tensor([[y, -x]], dtype=torch.float64))[0]
    torch.testing.assert_close(torch.rot90(kernel, 1, (0, 1)), turned, atol=1e-12, rtol=0)
    mirrored = line_kernel(torch.tensor([[-x, -y]], dtype=torch.float64))[0]
    torch.testing.assert_close(kernel, mirrored, atol=1e-12, rtol=0)


@pytest.mark.parametrize("length", [1.5, 6.0, 10.4, 25.0, 60.0])
def test_line_transfer_function_is_the_sinc_where_it_matters(length: float) -> None:
    """Up to the first zero of the sinc, or 0.12 cycles/px, the response is within 0.01 of it.

    Cubic convolution departs from the ideal interpolator as f^3: 0.8 % at 0.12 cycles/px.
    """
    kernel, _ = line(length, 0.0)
    taps = np.arange(kernel.shape[1]) - kernel.shape[1] // 2
    f = np.linspace(0, min(0.12, 1 / length), 40)
    response = (kernel[0] * np.cos(2 * np.pi * f[:, None] * taps)).sum(axis=1)
    np.testing.assert_allclose(response, np.sinc(length * f), atol=0.01)


def test_batch_equals_one_by_one() -> None:
    motions = torch.tensor([[3.0, 1.0], [0.0, 0.0], [-20.5, 7.25]], dtype=torch.float64)
    together = line_kernel(motions)
    for index in range(3):
        alone = line_kernel(motions[index : index + 1])[0]
        rows = (together.shape[1] - alone.shape[0]) // 2
        columns = (together.shape[2] - alone.shape[1]) // 2
        padded = torch.nn.functional.pad(alone, (columns, columns, rows, rows))
        # The longest motion sets the number of nodes, so weights agree to the quadrature's own accuracy.
        torch.testing.assert_close(together[index], padded, atol=2e-3, rtol=0)


@pytest.mark.parametrize("displacement", [(0.0, 0.0), (0.7, 0.0), (3.0, -2.0)])
def test_gradient_is_finite_and_right(displacement: tuple[float, float]) -> None:
    motion = torch.tensor([displacement], dtype=torch.float64, requires_grad=True)
    kernel = line_kernel(motion + torch.tensor([[1e-9, 1e-9]], dtype=torch.float64))
    (
        kernel * torch.linspace(0, 1, kernel.numel(), dtype=torch.float64).reshape(kernel.shape) ** 2
    ).sum().backward()
    assert torch.isfinite(motion.grad).all()
    if displacement == (0.0, 0.0):  # even in the motion, so flat at rest
        torch.testing.assert_close(motion.grad, torch.zeros_like(motion), atol=1e-6, rtol=0)


@pytest.mark.parametrize("motion", [(7.3, 0.0), (0.0, 7.3), (11.0, -6.4), (0.5, 0.2)])
def test_on_a_smooth_picture_it_is_the_transfer_function(motion: tuple[float, float]) -> None:
    rough = torch.rand(1, 2, 200, 160, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    smooth = kornia.filters.gaussian_blur2d(rough, (21, 21), (2.5, 2.5))
    kernel = line_kernel(torch.tensor([motion], dtype=torch.float64))
    by_kernel = kornia.filters.filter2d(smooth, kernel, border_type="reflect")
    expected = motion_blur(smooth, motion, method="transfer")
    inside = (..., slice(12, -12), slice(12, -12))
    torch.testing.assert_close(by_kernel[inside], expected[inside], atol=1e-3, rtol=0)
