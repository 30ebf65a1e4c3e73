"""Patch SNR and noise power spectra: known distributions, coverage of the intervals, and bad patches."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from blurnoise import Camera, charts, simulate
from blurnoise.metrics.noise import normal_quantile, patch_snr


def noise(*shape: int, seed: int = 1) -> Tensor:
    return torch.randn(*shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


def test_snr_of_two_values_by_hand() -> None:
    patch = torch.tensor([[9.0, 11.0], [11.0, 9.0]]).repeat(10, 10)
    got = patch_snr(patch, roi=1.0, detrend=False)
    assert float(got.std_dn) == pytest.approx(math.sqrt(400 / 399), rel=1e-12)
    assert float(got.snr) == pytest.approx(10 / math.sqrt(400 / 399), rel=1e-12)
    assert float(got.snr_db) == pytest.approx(20 * math.log10(float(got.snr)), rel=1e-12)


@pytest.mark.parametrize("side_px", [10, 30])
def test_intervals_hold_the_truth_as_often_as_they_say(side_px: int) -> None:
    patches = 200 + 10 * noise(2000, side_px, side_px)
    got = patch_snr(patches, roi=1.0)
    covered = float(((got.low < 20) & (got.high > 20)).double().mean())
    assert 0.935 <= covered <= 0.965  # binomial, p 0.95, n 2000: -+ 3 sigma
    narrow = patch_snr(patches, roi=1.0, level=0.8)
    assert 0.77 <= float(((narrow.low < 20) & (narrow.high > 20)).double().mean()) <= 0.83
    # mean of 1/std is 1/sigma (1 + 3/(4v)); its own standard error is 1/sqrt(2 v n)
    freedom = side_px**2 - 6
    assert abs(float(got.snr.mean()) / 20 - 1 - 3 / (4 * freedom)) < 5 / math.sqrt(2 * freedom * 2000)
    assert float(got.non_uniform.double().mean()) < 0.002


def test_shading_is_no_noise_but_is_flagged() -> None:
    y, x = torch.meshgrid(torch.linspace(-1, 1, 60), torch.linspace(-1, 1, 80), indexing="ij")
    shading = 30 * x - 20 * y + 15 * x * y - 25 * x**2 + 10 * y**2
    flat = 500 + 5 * noise(60, 80)
    even, shaded = patch_snr(flat, roi=1.0), patch_snr(flat + shading, roi=1.0)
    assert float(shaded.std_dn) == pytest.approx(float(even.std_dn), rel=1e-6)
    assert not bool(even.non_uniform)
    assert bool(shaded.non_uniform)
    raw = patch_snr(flat + shading, roi=1.0, detrend=False)
    assert bool(raw.non_uniform)
    assert float(raw.std_dn) > 3 * float(even.std_dn)


def test_edge_and_vignette_are_not_even() -> None:
    edge = charts.slanted_edge(60, 80)[0, 0].double() * 1000 + 5 * noise(60, 80)
    assert bool(patch_snr(edge).non_uniform)


def test_region_is_where_it_is_said_to_be() -> None:
    image = noise(3, 40, 50) + torch.arange(3.0)[:, None, None] * 100 + 50
    image[:, 5:17, 30:44] += 1000
    by_box = patch_snr(image, roi=(30, 5, 14, 12))
    assert torch.allclose(by_box.mean_dn, torch.tensor([1050.0, 1150, 1250], dtype=torch.float64), atol=0.5)
    centre = patch_snr(image, roi=0.2)  # 10 x 8 px in the middle: columns 20 to 29
    assert torch.equal(centre.mean_dn, patch_snr(image, roi=(20, 16, 10, 8)).mean_dn)
    assert centre.too_few_pixels.all()
    assert not by_box.too_few_pixels.any()


def test_leading_axes_are_apart() -> None:
    image = 100 + noise(2, 3, 20, 30)
    image[1, 2, 10, 15] = math.nan
    together = patch_snr(image)
    assert together.snr.shape == (2, 3)
    assert float(together.snr[0, 1]) == pytest.approx(float(patch_snr(image[0, 1]).snr), rel=1e-12)
    assert together.not_finite.tolist() == [[False, False, False], [False, False, True]]
    for number in (together.snr, together.low, together.high, together.mean_dn, together.std_dn):
        assert torch.isnan(number).tolist() == together.not_finite.tolist()


@pytest.mark.parametrize("value", [0.0, 0.1, 4095.0, -3.7])
def test_constant_patch_has_no_noise_and_no_interval(value: float) -> None:
    got = patch_snr(torch.full((33, 31), value))
    assert bool(got.noiseless)
    assert not bool(got.non_uniform)
    assert float(got.std_dn) == 0
    assert math.isnan(float(got.low))
    assert math.isnan(float(got.high))
    assert not math.isfinite(float(got.snr))


@pytest.mark.parametrize(("dtype", "top"), [(torch.uint8, 255), (torch.uint16, 4095)])
def test_integer_pictures_and_clipping(dtype: torch.dtype, top: int) -> None:
    values = (top - 16 + 8 * noise(60, 60)).round()
    clear, cut = (values - 30).to(torch.int32).to(dtype), values.clamp(max=top).to(torch.int32).to(dtype)
    limits = (0.0, float(top))
    assert not bool(patch_snr(clear, limits_dn=limits).clipped)
    assert bool(patch_snr(cut, limits_dn=limits).clipped)  # Phi(-2): 2.3 % at the top
    assert bool(patch_snr(cut).clipped) == (dtype == torch.uint8)
    dark = patch_snr((3 * noise(60, 60)).round().clamp(min=-5), limits_dn=(-5.0, 100.0))
    assert bool(dark.clipped)
    saturated = patch_snr(torch.full((60, 60), top, dtype=torch.int32).to(dtype), limits_dn=limits)
    assert bool(saturated.clipped)
    assert bool(saturated.noiseless)


def test_snr_of_a_simulated_patch_is_the_camera_s() -> None:
    camera = replace(Camera.preset("imx250"), prnu=0.0, dsnu_e=0.0)
    picture = charts.flat_patch(120, 131, reflectance=0.5)[:, :1]
    light = {"exposure_s": 0.01, "illuminance_lux": 50.0, "encoding": "linear"}
    dn = simulate(picture, camera, **light, generator=[3]) - camera.black_level_dn
    mean = simulate(picture, camera, **light, noise=False, quantised=False)
    signal = float(mean[0, 0, 0, 0]) - camera.black_level_dn
    variance = camera.system_gain_dn_per_e * signal + camera.dark_variance_dn2()
    got = patch_snr(dn, roi=1.0, level=0.999)
    assert float(got.low) < signal / math.sqrt(variance) < float(got.high)
    assert float(got.high) < 1.05 * float(got.low)


def test_normal_quantile() -> None:
    assert normal_quantile(0.95) == pytest.approx(1.959963984540054, rel=1e-12)


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda: patch_snr([[1.0]]), TypeError, "image: must be a torch"),
        (lambda: patch_snr(torch.ones(3, 0)), ValueError, "image"),
        (lambda: patch_snr(torch.ones(9)), ValueError, "2 or more dimensions"),
        (lambda: patch_snr(torch.ones(9, 9, dtype=torch.bool)), TypeError, "real numbers"),
        (lambda: patch_snr(torch.ones(9, 9), roi=(5, 0, 5, 5)), ValueError, "inside the picture, 9 x 9"),
        (lambda: patch_snr(torch.ones(9, 9), roi=(0, 0, 0, 5)), ValueError, "roi"),
        (lambda: patch_snr(torch.ones(9, 9), roi=1.5), ValueError, "roi"),
        (lambda: patch_snr(torch.ones(9, 9), roi=0.0), ValueError, "roi"),
        (lambda: patch_snr(torch.ones(9, 9), roi=(0, 0, 5)), TypeError, "roi"),
        (lambda: patch_snr(torch.ones(9, 9), limits_dn=(5.0, 5.0)), ValueError, "limits_dn"),
        (lambda: patch_snr(torch.ones(9, 9), level=1.0), ValueError, "level"),
    ],
)
def test_wrong_arguments_are_named(call, error, message) -> None:
    with pytest.raises(error, match=message):
        call()


def test_single_row_and_single_pixel() -> None:
    assert bool(patch_snr(100 + noise(1, 400), roi=1.0).snr > 50)
    one = patch_snr(torch.ones(1, 1))
    assert math.isnan(float(one.snr))
    assert bool(one.too_few_pixels)
