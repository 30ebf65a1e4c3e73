"""Patches: SNR, contrast and its detection probability: closed forms, coverage of the intervals, bad patches."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from blurnoise import Camera, charts, simulate
from blurnoise.metrics.patches import (
    detection_probability,
    patch_contrast,
    patch_snr,
)

WEBER = {"nominal": 1.0, "tolerance": 0.5}
NARROW = {"nominal": 1.0, "tolerance": 0.23}


def normal(mean: float, std: float, *shape: int, seed: int = 1) -> Tensor:
    g = torch.Generator().manual_seed(seed)
    return mean + std * torch.randn(*shape, generator=g, dtype=torch.float64)


def closed(
    mean_a: float, std_a: float, mean_b: float, std_b: float, nominal: float, tolerance: float
) -> float:
    """Detection probability of Gaussian patches (Geese, Seger, Paolillo 2018), exact while B stays above black."""
    low, high = sorted((1 + nominal * (1 - tolerance), 1 + nominal * (1 + tolerance)))

    def above(ratio: float) -> float:
        """Probability that A is larger than ``ratio`` times B; 1/2 at the very bound without noise."""
        distance, spread = mean_a - ratio * mean_b, math.hypot(std_a, ratio * std_b)
        return 0.5 * (1 + math.erf(distance / max(spread, 1e-300) / math.sqrt(2)))

    return above(low) - above(high)


def test_anchors() -> None:
    assert round(closed(120, 9, 60, 6, **WEBER), 4) == 0.9476


def test_limits() -> None:
    assert closed(100, 5, 100, 5, **WEBER) < 1e-7  # equal patches show no contrast of 1
    assert closed(120, 0, 60, 0, **WEBER) == 1  # no noise, right contrast
    assert closed(100, 0, 60, 0, **NARROW) == 0  # no noise, wrong contrast
    assert closed(90, 0, 60, 0, **WEBER) == 0.5  # on the bound
    assert closed(1200, 9, 600, 6, **WEBER) > closed(120, 9, 60, 6, **WEBER)
    assert closed(0, 0, 0, 0, **WEBER) == 0  # both black


def test_darker_target_has_a_negative_contrast() -> None:
    got = closed(30, 2, 60, 3, nominal=-0.5, tolerance=0.3)  # A/B from 0.35 to 0.65
    pairs = normal(30, 2, 10**6) / normal(60, 3, 10**6, seed=2)
    share = float(((pairs >= 0.35) & (pairs <= 0.65)).double().mean())
    assert abs(got - share) < 5 * math.sqrt(share * (1 - share) / 1e6)


@pytest.mark.parametrize("how", [WEBER, NARROW])
def test_all_pairs_are_counted(how: dict[str, float]) -> None:
    a, b = normal(120, 9, 2, 13, 17).round(), normal(60, 6, 2, 11, 9, seed=2).round()  # with ties at bounds
    got = detection_probability(a, b, **how)
    x, y = a.flatten(1)[:, :, None], b.flatten(1)[:, None, :]
    contrast = x / y - 1
    low, high = (how["nominal"] * (1 + s * how["tolerance"]) for s in (-1, 1))
    share = ((contrast >= low) & (contrast <= high)).double().mean((1, 2))
    assert torch.allclose(got.value, share, atol=1e-12)


@pytest.mark.parametrize("how", [WEBER, NARROW])
def test_interval_holds_the_truth_as_often_as_it_says(how: dict[str, float]) -> None:
    got = detection_probability(normal(120, 9, 1500, 15, 16), normal(60, 6, 1500, 14, 13, seed=2), **how)
    truth = closed(120, 9, 60, 6, **how)
    covered = float(((got.low < truth) & (got.high > truth)).double().mean())
    assert 0.93 <= covered <= 0.97  # binomial, p 0.95, n 1500: -+ 3.5 sigma
    spread = float(got.value.std())
    assert abs(float(got.value.mean()) - truth) < 5 * spread / math.sqrt(1500)
    assert float((got.high - got.low).mean()) == pytest.approx(2 * 1.96 * spread, rel=0.1)


def test_interval_is_the_bootstrap_s() -> None:
    a, b = normal(120, 9, 20, 20), normal(60, 6, 20, 20, seed=2)
    g = torch.Generator().manual_seed(3)
    drawn_a, drawn_b = (
        x.flatten()[torch.randint(400, (2000, 400), generator=g)].reshape(2000, 20, 20) for x in (a, b)
    )
    drawn = detection_probability(drawn_a, drawn_b, **NARROW).value
    low, high = torch.quantile(drawn, torch.tensor([0.025, 0.975], dtype=torch.float64)).tolist()
    got = detection_probability(a, b, **NARROW)
    assert float(got.low) == pytest.approx(low, abs=0.004)
    assert float(got.high) == pytest.approx(high, abs=0.004)


def test_heavy_tails_are_seen_by_the_samples_alone() -> None:
    a = normal(120, 3, 60, 60)
    a[:3] = 600  # 5 % hot pixels: variance grows a hundredfold, one pixel in twenty fails
    got = detection_probability(a, normal(60, 2, 60, 60, seed=2), **WEBER)
    assert float(got.value) == pytest.approx(0.95, abs=0.002)
    assert closed(float(a.mean()), float(a.std()), 60, 2, **WEBER) < 0.5


def test_saturated_and_black_patches() -> None:
    full = torch.full((20, 20), 255, dtype=torch.uint8)
    got = detection_probability(full, full, **WEBER)
    assert bool(got.flags["noiseless"])
    assert float(got.value) == closed(255, 0, 255, 0, **WEBER) == 0
    assert float(got.low) < 1e-15
    assert float(got.high) == pytest.approx(1.96**2 / (400 + 1.96**2), rel=1e-3)  # 400 that agree: no proof
    black = detection_probability(0 * full, 0 * full, **WEBER)
    assert float(black.value) == 0
    below = detection_probability(-normal(120, 9, 20, 20), -normal(60, 6, 20, 20), **WEBER)
    assert float(below.value) == 0  # the ratio would be right


def test_flags_of_one_item_leave_the_others_alone() -> None:
    a, b = normal(120, 9, 3, 4, 6), normal(60, 6, 3, 9, 9, seed=2)
    a[1, 0, 0] = math.nan
    got = detection_probability(a, b, **WEBER)
    assert got.flags["not_finite"].tolist() == [False, True, False]
    assert torch.isnan(got.value).tolist() == [False, True, False]
    assert torch.isnan(got.low).tolist() == [False, True, False]
    assert got.flags["too_few_pixels"].all()
    both = patch_contrast(a, b)
    assert both.cnr.flags["not_finite"].tolist() == [False, True, False]
    assert (
        torch.isnan(both.cnr.value).tolist()
        == torch.isnan(both.michelson.high).tolist()
        == [False, True, False]
    )


def test_sixteen_bit_patches_are_their_numbers() -> None:
    a, b = normal(1200, 90, 20, 20).round(), normal(600, 60, 20, 20, seed=2).round()
    as_float = detection_probability(a, b, **WEBER)
    as_int = detection_probability(a.int().to(torch.uint16), b.int().to(torch.uint16), **WEBER)
    assert float(as_float.value) == float(as_int.value)


def test_contrasts_of_known_patches() -> None:
    bright, dark = torch.tensor([[11.0, 13.0], [11.0, 13.0]]), torch.tensor([[3.0, 5.0]])
    got = patch_contrast(bright, dark)
    assert float(got.michelson.value) == pytest.approx(0.5)
    assert float(got.cnr.value) == pytest.approx(8 / math.sqrt((4 / 3 + 2) / 2))


def test_intervals_of_contrasts_hold_the_truth() -> None:
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
def test_rounding_is_no_noise(black: float) -> None:
    """Constant patches less a black level: their variance is 0 or 1e-33, CNR was 4e15 without a flag."""
    bright, dark = (torch.full((40, 50), level, dtype=torch.float64) - black for level in (0.8, 0.18))
    got = patch_contrast(bright, dark).cnr
    assert bool(got.flags["noiseless"])
    assert float(got.value) == math.inf
    assert bool(detection_probability(bright, dark, **WEBER).flags["noiseless"])


@pytest.mark.parametrize("value", [0.0, 0.1, 255.0])
def test_constant_patches(value: float) -> None:
    got = patch_contrast(torch.full((7, 9), value), torch.full((5, 5), value))
    assert bool(got.cnr.flags["noiseless"])
    assert math.isnan(float(got.cnr.value))
    assert bool(got.michelson.flags["near_black"]) == math.isnan(float(got.michelson.value)) == (value == 0)
    step = patch_contrast(torch.full((7, 9), value + 1), torch.full((5, 5), value))
    assert float(step.cnr.value) == math.inf
    assert math.isnan(float(step.cnr.low))


def test_patch_in_the_dark_is_flagged() -> None:
    assert bool(
        patch_contrast(normal(20, 9, 10, 10), normal(0.5, 9, 10, 10, seed=2)).michelson.flags["near_black"]
    )


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"tolerance": 0.0}, ValueError, "tolerance"),
        ({"nominal": 0.0}, ValueError, "must differ"),
        ({"nominal": -0.8}, ValueError, "above -1"),
        ({"nominal": math.nan}, ValueError, "nominal"),
        ({"patch_a": torch.ones(1, 1)}, ValueError, "patch_a: must be two pixels"),
        ({"patch_b": torch.ones(3, 4, 4)}, ValueError, "patch_b"),
        ({"patch_b": torch.ones(0, 4)}, ValueError, "patch_b"),
        ({"patch_b": 3.0}, TypeError, "patch_b"),
    ],
)
def test_wrong_arguments_are_named(change: dict[str, object], error: type[Exception], message: str) -> None:
    right = {"patch_a": torch.ones(4, 4), "patch_b": torch.ones(4, 4), **WEBER}
    detection_probability(**right)
    with pytest.raises(error, match=message):
        detection_probability(**{**right, **change})


# --- SNR ---


def test_snr_of_two_values_by_hand() -> None:
    patch = torch.tensor([[9.0, 11.0], [11.0, 9.0]]).repeat(10, 10)
    got = patch_snr(patch)
    assert float(got.value) == pytest.approx(
        10 / math.sqrt(400 / 394), rel=1e-3
    )  # the surface takes next to nothing


@pytest.mark.parametrize("side_px", [10, 30])
def test_intervals_hold_the_truth_as_often_as_they_say(side_px: int) -> None:
    patches = 200 + 10 * normal(0, 1, 2000, side_px, side_px)
    got = patch_snr(patches)
    covered = float(((got.low < 20) & (got.high > 20)).double().mean())
    assert 0.935 <= covered <= 0.965  # binomial, p 0.95, n 2000: -+ 3 sigma
    # mean of 1/std is 1/sigma (1 + 3/(4v)); its own standard error is 1/sqrt(2 v n)
    freedom = side_px**2 - 6
    assert abs(float(got.value.mean()) / 20 - 1 - 3 / (4 * freedom)) < 5 / math.sqrt(2 * freedom * 2000)
    assert float(got.flags["non_uniform"].double().mean()) < 0.002


def test_shading_is_no_noise_but_is_flagged() -> None:
    y, x = torch.meshgrid(torch.linspace(-1, 1, 60), torch.linspace(-1, 1, 80), indexing="ij")
    shading = 30 * x - 20 * y + 15 * x * y - 25 * x**2 + 10 * y**2
    flat = 500 + 5 * normal(0, 1, 60, 80)
    even, shaded = patch_snr(flat), patch_snr(flat + shading)
    std = float(flat.mean() / even.value)
    assert float((flat + shading).mean() / shaded.value) == pytest.approx(std, rel=1e-6)
    assert not bool(even.flags["non_uniform"])
    assert bool(shaded.flags["non_uniform"])
    assert float((flat + shading).std()) > 3 * std


def test_edge_and_vignette_are_not_even() -> None:
    edge = charts.slanted_edge(60, 80)[0, 0].double() * 1000 + 5 * normal(0, 1, 60, 80)
    assert bool(patch_snr(edge).flags["non_uniform"])


def test_leading_axes_are_apart() -> None:
    image = 100 + normal(0, 1, 2, 3, 20, 30)
    image[1, 2, 10, 15] = math.nan
    together = patch_snr(image)
    assert together.value.shape == (2, 3)
    assert float(together.value[0, 1]) == pytest.approx(float(patch_snr(image[0, 1]).value), rel=1e-12)
    assert together.flags["not_finite"].tolist() == [[False, False, False], [False, False, True]]
    for number in (together.value, together.low, together.high):
        assert torch.isnan(number).tolist() == together.flags["not_finite"].tolist()


@pytest.mark.parametrize("value", [0.0, 0.1, 4095.0, -3.7])
def test_constant_patch_has_no_noise_and_no_interval(value: float) -> None:
    got = patch_snr(torch.full((33, 31), value))
    assert bool(got.flags["noiseless"])
    assert not bool(got.flags["non_uniform"])
    assert math.isnan(float(got.low))
    assert math.isnan(float(got.high))
    assert not math.isfinite(float(got.value))


@pytest.mark.parametrize(("dtype", "top"), [(torch.uint8, 255), (torch.uint16, 4095)])
def test_integer_pictures_and_clipping(dtype: torch.dtype, top: int) -> None:
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


def test_snr_of_a_simulated_patch_is_the_camera_s() -> None:
    camera = replace(Camera.preset("imx250"), prnu=0.0, dsnu_e=0.0)
    picture = charts.flat_patch(120, 131, reflectance=0.5)[:, :1]
    light = {"exposure_s": 0.01, "illuminance_lux": 50.0, "encoding": "linear"}
    dn = simulate(picture, camera, **light, generator=[3]) - camera.black_level_dn
    mean = simulate(picture, camera, **light, noise=False, quantised=False)
    signal = float(mean[0, 0, 0, 0]) - camera.black_level_dn
    variance = camera.system_gain_dn_per_e * signal + camera.dark_variance_dn2()
    got = patch_snr(dn)
    assert float(got.low) < signal / math.sqrt(variance) < float(got.high)
    assert float(got.high) < 1.05 * float(got.low)


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda: patch_snr([[1.0]]), TypeError, "patch: must be a torch"),
        (lambda: patch_snr(torch.ones(3, 0)), ValueError, "patch"),
        (lambda: patch_snr(torch.ones(9)), ValueError, "2 or more dimensions"),
        (lambda: patch_snr(torch.ones(9, 9, dtype=torch.bool)), TypeError, "real numbers"),
        (lambda: patch_snr(torch.ones(9, 9), limits_dn=(5.0, 5.0)), ValueError, "limits_dn"),
    ],
)
def test_wrong_arguments_of_snr_are_named(call, error, message) -> None:
    with pytest.raises(error, match=message):
        call()


def test_single_row_and_single_pixel() -> None:
    assert bool(patch_snr(100 + normal(0, 1, 1, 400)).value > 50)
    one = patch_snr(torch.ones(1, 1))
    assert math.isnan(float(one.value))
    assert bool(one.flags["too_few_pixels"])
