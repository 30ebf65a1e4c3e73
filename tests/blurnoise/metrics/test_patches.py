"""Patches: SNR, contrast, detection probability, coverage of intervals; PSNR and SSIM; bad patches."""

import math

import pytest
import torch

from blurnoise import Camera, charts, simulate
from blurnoise.metrics.patches import contrast_transfer_accuracy, patch_contrast, patch_snr, psnr, ssim

WEBER = {"nominal": 1.0, "tolerance": 0.5}
NARROW = {"nominal": 1.0, "tolerance": 0.23}


def normal(mean, std, *shape, seed=1):
    g = torch.Generator().manual_seed(seed)
    return mean + std * torch.randn(*shape, generator=g, dtype=torch.float64)


def closed(mean_a, std_a, mean_b, std_b, nominal, tolerance):
    """Detection probability of Gaussian patches (Geese, Seger, Paolillo 2018), exact while B stays above black."""
    low, high = sorted((1 + nominal * (1 - tolerance), 1 + nominal * (1 + tolerance)))

    def above(ratio):
        """Probability that A is larger than ``ratio`` times B; 1/2 at the very bound without noise."""
        distance, spread = mean_a - ratio * mean_b, math.hypot(std_a, ratio * std_b)
        return 0.5 * (1 + math.erf(distance / max(spread, 1e-300) / math.sqrt(2)))

    return above(low) - above(high)


@pytest.mark.parametrize("how", [WEBER, NARROW])
def test_all_pairs_are_counted(how):
    a, b = normal(120, 9, 2, 13, 17).round(), normal(60, 6, 2, 11, 9, seed=2).round()  # with ties at bounds
    got = contrast_transfer_accuracy(a, b, **how)
    x, y = a.flatten(1)[:, :, None], b.flatten(1)[:, None, :]
    contrast = x / y - 1
    low, high = (how["nominal"] * (1 + s * how["tolerance"]) for s in (-1, 1))
    share = ((contrast >= low) & (contrast <= high)).double().mean((1, 2))
    assert torch.allclose(got.value, share, atol=1e-12)


@pytest.mark.parametrize("how", [WEBER, NARROW])
def test_interval_holds_the_truth_as_often_as_it_says(how):
    got = contrast_transfer_accuracy(normal(120, 9, 1500, 15, 16), normal(60, 6, 1500, 14, 13, seed=2), **how)
    truth = closed(120, 9, 60, 6, **how)
    covered = float(((got.low < truth) & (got.high > truth)).double().mean())
    assert 0.93 <= covered <= 0.97  # binomial, p 0.95, n 1500: -+ 3.5 sigma
    spread = float(got.value.std())
    assert abs(float(got.value.mean()) - truth) < 5 * spread / math.sqrt(1500)
    assert float((got.high - got.low).mean()) == pytest.approx(2 * 1.96 * spread, rel=0.1)


def test_saturated_and_black_patches():
    full = torch.full((20, 20), 255, dtype=torch.uint8)
    got = contrast_transfer_accuracy(full, full, **WEBER)
    assert bool(got.flags["noiseless"])
    assert float(got.value) == 0
    assert float(got.high) == pytest.approx(1.96**2 / (400 + 1.96**2), rel=1e-3)  # 400 that agree: no proof
    assert float(contrast_transfer_accuracy(0 * full, 0 * full, **WEBER).value) == 0
    below = contrast_transfer_accuracy(-normal(120, 9, 20, 20), -normal(60, 6, 20, 20), **WEBER)
    assert float(below.value) == 0  # the ratio would be right


def test_flags_of_one_item_leave_the_others_alone():
    a, b, marked = normal(120, 9, 3, 4, 6), normal(60, 6, 3, 9, 9, seed=2), [False, True, False]
    a[1, 0, 0] = math.nan
    both = patch_contrast(a, b)
    for got in (contrast_transfer_accuracy(a, b, **WEBER), both.cnr, both.michelson, patch_snr(a)):
        assert got.flags["not_finite"].tolist() == marked
        for number in (got.value, got.low, got.high):
            assert torch.isnan(number).tolist() == marked
    assert contrast_transfer_accuracy(a, b, **WEBER).flags["too_few_pixels"].all()
    alone = patch_snr(a[0])
    assert float(patch_snr(a).value[0]) == pytest.approx(float(alone.value), rel=1e-12)


def test_contrasts_of_known_patches():
    bright, dark = torch.tensor([[11.0, 13.0], [11.0, 13.0]]), torch.tensor([[3.0, 5.0]])
    got = patch_contrast(bright, dark)
    assert float(got.michelson.value) == pytest.approx(0.5)
    assert float(got.cnr.value) == pytest.approx(8 / math.sqrt((4 / 3 + 2) / 2))


def test_intervals_of_contrasts_hold_the_truth():
    got = patch_contrast(normal(120, 9, 2000, 12, 15), normal(60, 6, 2000, 20, 5, seed=2))
    truth = 60 / math.sqrt((81 + 36) / 2)
    for low, high, exact in (
        (got.michelson.low, got.michelson.high, 1 / 3),
        (got.cnr.low, got.cnr.high, truth),
    ):
        covered = float(((low < exact) & (high > exact)).double().mean())
        assert 0.93 <= covered <= 0.965
    assert not bool(got.michelson.flags["near_black"].any())


@pytest.mark.parametrize("black", [0.07, 0.1, 1 / 3])
def test_rounding_is_no_noise(black):
    """Constant patches less a black level: their variance is 0 or 1e-33, CNR was 4e15 without a flag."""
    bright, dark = (torch.full((40, 50), level, dtype=torch.float64) - black for level in (0.8, 0.18))
    got = patch_contrast(bright, dark).cnr
    assert bool(got.flags["noiseless"])
    assert float(got.value) == math.inf
    assert bool(contrast_transfer_accuracy(bright, dark, **WEBER).flags["noiseless"])


@pytest.mark.parametrize("side_px", [10, 30])
def test_intervals_hold_the_truth_as_often_as_they_say(side_px):
    patches = 200 + 10 * normal(0, 1, 2000, side_px, side_px)
    got = patch_snr(patches)
    covered = float(((got.low < 20) & (got.high > 20)).double().mean())
    assert 0.935 <= covered <= 0.965  # binomial, p 0.95, n 2000: -+ 3 sigma
    # mean of 1/std is 1/sigma (1 + 3/(4v)); its own standard error is 1/sqrt(2 v n)
    freedom = side_px**2 - 6
    assert abs(float(got.value.mean()) / 20 - 1 - 3 / (4 * freedom)) < 5 / math.sqrt(2 * freedom * 2000)
    assert float(got.flags["non_uniform"].double().mean()) < 0.002


def test_shading_is_no_noise_but_is_flagged():
    y, x = torch.meshgrid(torch.linspace(-1, 1, 60), torch.linspace(-1, 1, 80), indexing="ij")
    shading = 30 * x - 20 * y + 15 * x * y - 25 * x**2 + 10 * y**2
    flat = 500 + 5 * normal(0, 1, 60, 80)
    even, shaded = patch_snr(flat), patch_snr(flat + shading)
    std = float(flat.mean() / even.value)
    assert float((flat + shading).mean() / shaded.value) == pytest.approx(std, rel=1e-6)
    assert not bool(even.flags["non_uniform"])
    assert bool(shaded.flags["non_uniform"])
    assert float((flat + shading).std()) > 3 * std


@pytest.mark.parametrize(("dtype", "top"), [(torch.uint8, 255), (torch.uint16, 4095)])
def test_integer_pictures_and_clipping(dtype, top):
    values = (top - 16 + 8 * normal(0, 1, 60, 60)).round()
    clear, cut = (values - 30).to(torch.int32).to(dtype), values.clamp(max=top).to(torch.int32).to(dtype)
    limits = (0.0, float(top))
    assert not bool(patch_snr(clear, limits_dn=limits).flags["clipped"])
    assert bool(patch_snr(cut, limits_dn=limits).flags["clipped"])  # Phi(-2): 2.3 % at the top
    assert bool(patch_snr(cut).flags["clipped"]) == (dtype == torch.uint8)
    dark = patch_snr((3 * normal(0, 1, 60, 60)).round().clamp(min=-5), limits_dn=(-5.0, 100.0))
    assert bool(dark.flags["clipped"])
    saturated = patch_snr(torch.full((60, 60), top, dtype=torch.int32).to(dtype), limits_dn=limits)
    assert bool(saturated.flags["clipped"])
    assert bool(saturated.flags["noiseless"])


def test_snr_of_a_simulated_patch_is_the_camera_s():
    camera = Camera.preset("imx250").with_figures(prnu=0.0, dsnu_e=0.0)
    picture = charts.flat_patch(120, 131, reflectance=0.5)[:, :1]
    light = {"exposure_s": 0.01, "illuminance_lux": 50.0, "encoding": "linear"}
    dn = simulate(picture, camera, **light, generator=[3]) - camera.sensor.black_level_dn
    mean = simulate(picture, camera, **light, noise=False, quantised=False)
    signal = float(mean[0, 0, 0, 0]) - camera.sensor.black_level_dn
    variance = camera.sensor.system_gain_dn_per_e * signal + camera.sensor.dark_variance_dn2()
    got = patch_snr(dn)
    assert float(got.low) < signal / math.sqrt(variance) < float(got.high)
    assert float(got.high) < 1.05 * float(got.low)


def picture(*shape, seed=1):
    return torch.rand(*shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


def test_constant_shift():
    a = picture(2, 3, 20, 24) * 0.5
    shift = torch.tensor([0.1, 0.01], dtype=torch.float64)[:, None, None, None]
    assert torch.allclose(psnr(a, a + shift, data_range=1.0), torch.tensor([20.0, 40.0], dtype=torch.float64))
    assert torch.allclose(
        psnr(a, a + shift, data_range=10.0), torch.tensor([40.0, 60.0], dtype=torch.float64)
    )


def test_ssim_of_one_window_by_hand():
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


def test_pictures_of_a_batch_are_apart():
    a, b = picture(3, 3, 14, 17), picture(3, 3, 14, 17, seed=2)
    b[1], b[2, 0, 0, 0] = a[1], math.nan
    for metric, equal in ((psnr, math.inf), (ssim, pytest.approx(1, abs=1e-12))):
        together = metric(a, b, data_range=1.0)
        assert float(together[0]) == pytest.approx(float(metric(b[:1], a[:1], data_range=1.0)), rel=1e-12)
        assert float(together[1]) == equal
        assert math.isnan(float(together[2]))


ONES = torch.ones(1, 1, 12, 12)


@pytest.mark.parametrize(
    ("call", "given", "message"),
    [
        (contrast_transfer_accuracy, {"tolerance": 0.0}, "tolerance"),
        (contrast_transfer_accuracy, {"nominal": 0.0}, "must differ"),
        (contrast_transfer_accuracy, {"nominal": -0.8}, "above -1"),
        (contrast_transfer_accuracy, {"patch_a": torch.ones(1, 1)}, "patch_a: must be two pixels"),
        (contrast_transfer_accuracy, {"patch_b": torch.ones(3, 4, 4)}, "patch_b"),
        (patch_snr, {"patch": torch.ones(9)}, "at least 2 dimensions"),
        (patch_snr, {"limits_dn": (5.0, 5.0)}, "limits_dn"),
        (psnr, {"picture": torch.ones(3, 12, 12)}, "at least 4"),
        (psnr, {"picture": torch.ones(1, 1, 12, 13)}, "must both be"),
        (ssim, {"picture": 255 * ONES - torch.arange(12)}, "span 11"),
        (ssim, {"picture": ONES[..., :10], "reference": ONES[..., :10]}, "11 px or more"),
    ],
)
def test_wrong_arguments_are_named(call, given, message):
    right = {
        contrast_transfer_accuracy: {"patch_a": torch.ones(4, 4), "patch_b": torch.ones(4, 4), **WEBER},
        patch_snr: {"patch": torch.ones(9, 9)},
    }.get(call, {"picture": ONES, "reference": ONES, "data_range": 1.0})
    with pytest.raises(ValueError, match=message):
        call(**{**right, **given})
