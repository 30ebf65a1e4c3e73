"""MSE, PSNR and SSIM: closed forms, an own sum over one window, symmetry, batches and bad pictures."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from blurnoise.metrics.patches import psnr, ssim


def picture(*shape: int, seed: int = 1) -> Tensor:
    return torch.rand(*shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


def test_constant_shift() -> None:
    a = picture(2, 3, 20, 24) * 0.5
    shift = torch.tensor([0.1, 0.01], dtype=torch.float64)[:, None, None, None]
    assert torch.allclose(psnr(a, a + shift, data_range=1.0), torch.tensor([20.0, 40.0], dtype=torch.float64))
    assert torch.allclose(
        psnr(a, a + shift, data_range=10.0), torch.tensor([40.0, 60.0], dtype=torch.float64)
    )


@pytest.mark.parametrize(("a", "b", "data_range"), [(0.2, 0.6, 1.0), (10.0, 200.0, 255.0), (0.0, 1.0, 1.0)])
def test_ssim_of_two_constants(a: float, b: float, data_range: float) -> None:
    """Without structure only the means' term stays: (2ab + c1)/(a² + b² + c1)."""
    first, second = (torch.full((1, 1, 15, 13), v, dtype=torch.float64) for v in (a, b))
    c1 = (0.01 * data_range) ** 2
    expected = (2 * a * b + c1) / (a * a + b * b + c1)
    # rounding in the constants' variances, seen against c2
    assert float(ssim(first, second, data_range=data_range)) == pytest.approx(expected, rel=1e-9)


def test_ssim_of_one_window_by_hand() -> None:
    a, b = picture(1, 1, 11, 11), picture(1, 1, 11, 11, seed=2)
    taps = torch.exp(-((torch.arange(11, dtype=torch.float64) - 5) ** 2) / (2 * 1.5**2))
    weights = torch.outer(taps, taps) / taps.sum() ** 2
    mean_a, mean_b = (weights * a).sum(), (weights * b).sum()
    var_a, var_b = (weights * (a - mean_a) ** 2).sum(), (weights * (b - mean_b) ** 2).sum()
    covariance = (weights * (a - mean_a) * (b - mean_b)).sum()
    c1, c2 = 0.01**2, 0.03**2
    expected = (2 * mean_a * mean_b + c1) * (2 * covariance + c2)
    expected = expected / ((mean_a**2 + mean_b**2 + c1) * (var_a + var_b + c2))
    assert float(ssim(a, b, data_range=1.0)) == pytest.approx(float(expected), rel=1e-9)


def test_equal_pictures_and_symmetry() -> None:
    a, b = picture(2, 3, 16, 19), picture(2, 3, 16, 19, seed=2)
    assert torch.allclose(ssim(a, a, data_range=1.0), torch.ones(2, dtype=torch.float64), rtol=0, atol=1e-12)
    assert psnr(a, a, data_range=1.0).tolist() == [math.inf, math.inf]
    assert torch.allclose(ssim(a, b, data_range=1.0), ssim(b, a, data_range=1.0))
    assert bool((ssim(a, b, data_range=1.0) < 0.5).all())


def test_pictures_of_a_batch_are_apart() -> None:
    a, b = picture(3, 3, 14, 17), picture(3, 3, 14, 17, seed=2)
    b[1] = a[1]
    b[2, 0, 0, 0] = math.nan
    for metric in (lambda x, y: psnr(x, y, data_range=1.0), lambda x, y: ssim(x, y, data_range=1.0)):
        together = metric(a, b)
        assert float(together[0]) == pytest.approx(float(metric(a[:1], b[:1])), rel=1e-12)
        assert not math.isnan(float(together[1]))
        assert math.isnan(float(together[2]))


@pytest.mark.parametrize(("dtype", "top"), [(torch.uint8, 255), (torch.uint16, 65535)])
def test_integers_are_their_numbers_and_units_cancel(dtype: torch.dtype, top: int) -> None:
    a, b = ((picture(1, 3, 16, 19, seed=s) * top).round() for s in (1, 2))
    whole = (a.int().to(dtype), b.int().to(dtype))
    assert float(psnr(*whole, data_range=top)) == pytest.approx(float(psnr(a / top, b / top, data_range=1.0)))
    assert float(ssim(*whole, data_range=top)) == pytest.approx(float(ssim(a / top, b / top, data_range=1.0)))


def test_saturated_sixteen_bit_pictures_lose_no_digits() -> None:
    full = torch.full((1, 1, 20, 20), 65535, dtype=torch.int32).to(torch.uint16)
    assert float(ssim(full, full, data_range=65535)) == pytest.approx(1, abs=1e-9)
    assert float(psnr(full, full, data_range=65535)) == math.inf


def test_differentiable() -> None:
    a, b = picture(1, 1, 12, 12).requires_grad_(), picture(1, 1, 12, 12, seed=2)
    (ssim(a, b, data_range=1.0) + psnr(a, b, data_range=1.0)).sum().backward()
    assert a.grad is not None
    assert bool(torch.isfinite(a.grad).all())
    assert bool((a.grad != 0).all())


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"picture": torch.ones(3, 12, 12)}, ValueError, "4 or more"),
        ({"picture": torch.ones(1, 1, 12, 13)}, ValueError, "must both be"),
        ({"picture": torch.ones(0, 1, 12, 12)}, ValueError, "none of 0"),
        ({"picture": "a.png"}, TypeError, "picture: must be a torch"),
        ({"data_range": 0.0}, ValueError, "data_range"),
        ({"data_range": math.nan}, ValueError, "data_range"),
        ({"picture": torch.linspace(0, 255, 144).reshape(1, 1, 12, 12)}, ValueError, "span 255"),
    ],
)
def test_wrong_arguments_are_named(change: dict[str, object], error: type[Exception], message: str) -> None:
    right = {"picture": torch.ones(1, 1, 12, 12), "reference": torch.ones(1, 1, 12, 12), "data_range": 1.0}
    for metric in (psnr, ssim):
        metric(**right)
        with pytest.raises(error, match=message):
            metric(**{**right, **change})


def test_picture_smaller_than_the_window() -> None:
    with pytest.raises(ValueError, match="11 px or more"):
        ssim(torch.ones(1, 1, 10, 30), torch.ones(1, 1, 10, 30), data_range=1.0)
