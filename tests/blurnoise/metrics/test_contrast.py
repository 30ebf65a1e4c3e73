"""Contrast and its detection probability: IEEE P2020's form against samples, coverage, limits, bad patches."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from blurnoise.metrics.contrast import (
    detection_probability,
    gaussian_detection_probability,
    michelson,
    patch_contrast,
)

WEBER = {"nominal": 1.0, "tolerance": 0.5, "kind": "weber"}
MICHELSON = {"nominal": 1 / 3, "tolerance": 0.2, "kind": "michelson"}


def normal(mean: float, std: float, *shape: int, seed: int = 1) -> Tensor:
    g = torch.Generator().manual_seed(seed)
    return mean + std * torch.randn(*shape, generator=g, dtype=torch.float64)


def closed(mean_a: float, std_a: float, mean_b: float, std_b: float, **how: object) -> float:
    numbers = (torch.tensor(v, dtype=torch.float64) for v in (mean_a, std_a**2, mean_b, std_b**2))
    return float(gaussian_detection_probability(*numbers, **how))


def test_anchors() -> None:
    assert round(closed(120, 9, 60, 6, **WEBER), 4) == 0.9476
    assert round(closed(120, 9, 60, 6, **MICHELSON), 4) == 0.7687


def test_weber_and_michelson_say_the_same_of_the_same_ratios() -> None:
    """Weber 0.8 to 1.2 is A/B from 1.8 to 2.2; as Michelson's (r - 1)/(r + 1) that is 2/7 to 3/8."""
    low, high = 2 / 7, 3 / 8
    nominal, tolerance = (low + high) / 2, (high - low) / (high + low)
    weber = closed(120, 9, 60, 6, nominal=1.0, tolerance=0.2, kind="weber")
    assert closed(120, 9, 60, 6, nominal=nominal, tolerance=tolerance, kind="michelson") == pytest.approx(
        weber
    )


def test_limits() -> None:
    assert closed(100, 5, 100, 5, **WEBER) < 1e-7  # equal patches show no contrast of 1
    assert closed(120, 0, 60, 0, **WEBER) == 1  # no noise, right contrast
    assert closed(100, 0, 60, 0, nominal=1.0, tolerance=0.2, kind="weber") == 0  # no noise, wrong contrast
    assert closed(90, 0, 60, 0, **WEBER) == 0.5  # on the bound
    assert closed(1200, 9, 600, 6, **WEBER) > closed(120, 9, 60, 6, **WEBER)
    assert closed(0, 0, 0, 0, **WEBER) == 0  # both black


def test_darker_target_has_a_negative_contrast() -> None:
    got = closed(30, 2, 60, 3, nominal=-0.5, tolerance=0.3, kind="weber")  # A/B from 0.35 to 0.65
    pairs = normal(30, 2, 10**6) / normal(60, 3, 10**6, seed=2)
    share = float(((pairs >= 0.35) & (pairs <= 0.65)).double().mean())
    assert abs(got - share) < 5 * math.sqrt(share * (1 - share) / 1e6)


@pytest.mark.parametrize("how", [WEBER, MICHELSON])
def test_all_pairs_are_counted(how: dict[str, float]) -> None:
    a, b = normal(120, 9, 2, 13, 17).round(), normal(60, 6, 2, 11, 9, seed=2).round()  # with ties at bounds
    got = detection_probability(a, b, **how)
    x, y = a.flatten(1)[:, :, None], b.flatten(1)[:, None, :]
    contrast = x / y - 1 if how["kind"] == "weber" else (x - y) / (x + y)
    low, high = (how["nominal"] * (1 + s * how["tolerance"]) for s in (-1, 1))
    share = ((contrast >= low) & (contrast <= high)).double().mean((1, 2))
    ties = 1e-3 if how["kind"] == "michelson" else 1e-12  # bounds there are no round numbers
    assert torch.allclose(got.probability, share, atol=ties)


@pytest.mark.parametrize("how", [WEBER, MICHELSON])
def test_interval_holds_the_truth_as_often_as_it_says(how: dict[str, float]) -> None:
    got = detection_probability(normal(120, 9, 1500, 15, 16), normal(60, 6, 1500, 14, 13, seed=2), **how)
    truth = closed(120, 9, 60, 6, **how)
    covered = float(((got.low < truth) & (got.high > truth)).double().mean())
    assert 0.93 <= covered <= 0.97  # binomial, p 0.95, n 1500: -+ 3.5 sigma
    spread = float(got.probability.std())
    assert abs(float(got.probability.mean()) - truth) < 5 * spread / math.sqrt(1500)
    assert float((got.high - got.low).mean()) == pytest.approx(2 * 1.96 * spread, rel=0.1)


def test_interval_is_the_bootstrap_s() -> None:
    a, b = normal(120, 9, 20, 20), normal(60, 6, 20, 20, seed=2)
    g = torch.Generator().manual_seed(3)
    drawn_a, drawn_b = (
        x.flatten()[torch.randint(400, (2000, 400), generator=g)].reshape(2000, 20, 20) for x in (a, b)
    )
    drawn = detection_probability(drawn_a, drawn_b, **MICHELSON).probability
    low, high = torch.quantile(drawn, torch.tensor([0.025, 0.975], dtype=torch.float64)).tolist()
    got = detection_probability(a, b, **MICHELSON)
    assert float(got.low) == pytest.approx(low, abs=0.004)
    assert float(got.high) == pytest.approx(high, abs=0.004)


def test_heavy_tails_are_seen_by_the_samples_alone() -> None:
    a = normal(120, 3, 60, 60)
    a[:3] = 600  # 5 % hot pixels: variance grows a hundredfold, one pixel in twenty fails
    got = detection_probability(a, normal(60, 2, 60, 60, seed=2), **WEBER)
    assert float(got.probability) == pytest.approx(0.95, abs=0.002)
    assert float(got.gaussian) < 0.5


def test_saturated_and_black_patches() -> None:
    full = torch.full((20, 20), 255, dtype=torch.uint8)
    got = detection_probability(full, full, **WEBER)
    assert bool(got.noiseless)
    assert float(got.probability) == float(got.gaussian) == 0
    assert float(got.low) < 1e-15
    assert float(got.high) == pytest.approx(1.96**2 / (400 + 1.96**2), rel=1e-3)  # 400 that agree: no proof
    black = detection_probability(0 * full, 0 * full, **WEBER)
    assert float(black.probability) == 0
    below = detection_probability(-normal(120, 9, 20, 20), -normal(60, 6, 20, 20), **WEBER)
    assert float(below.probability) == 0  # the ratio would be right


def test_flags_of_one_item_leave_the_others_alone() -> None:
    a, b = normal(120, 9, 3, 4, 6), normal(60, 6, 3, 9, 9, seed=2)
    a[1, 0, 0] = math.nan
    got = detection_probability(a, b, **WEBER)
    assert got.not_finite.tolist() == [False, True, False]
    assert torch.isnan(got.probability).tolist() == [False, True, False]
    assert torch.isnan(got.low).tolist() == [False, True, False]
    assert torch.isnan(got.gaussian).tolist() == [False, True, False]
    assert got.too_few_pixels.all()
    both = patch_contrast(a, b)
    assert both.not_finite.tolist() == [False, True, False]
    assert torch.isnan(both.cnr).tolist() == torch.isnan(both.michelson_high).tolist() == [False, True, False]


def test_sixteen_bit_patches_are_their_numbers() -> None:
    a, b = normal(1200, 90, 20, 20).round(), normal(600, 60, 20, 20, seed=2).round()
    as_float = detection_probability(a, b, **WEBER)
    as_int = detection_probability(a.int().to(torch.uint16), b.int().to(torch.uint16), **WEBER)
    assert float(as_float.probability) == float(as_int.probability)


def test_contrasts_of_known_patches() -> None:
    assert float(michelson(torch.tensor(3.0), torch.tensor(1.0))) == 0.5
    assert math.isnan(float(michelson(torch.tensor(0.0), torch.tensor(0.0))))
    bright, dark = torch.tensor([[11.0, 13.0], [11.0, 13.0]]), torch.tensor([[3.0, 5.0]])
    got = patch_contrast(bright, dark)
    assert float(got.michelson) == pytest.approx(0.5)
    assert float(got.cnr) == pytest.approx(8 / math.sqrt((4 / 3 + 2) / 2))


def test_intervals_of_contrasts_hold_the_truth() -> None:
    got = patch_contrast(normal(120, 9, 2000, 12, 15), normal(60, 6, 2000, 20, 5, seed=2))
    truth = 60 / math.sqrt((81 + 36) / 2)
    for low, high, exact in (
        (got.michelson_low, got.michelson_high, 1 / 3),
        (got.cnr_low, got.cnr_high, truth),
    ):
        covered = float(((low < exact) & (high > exact)).double().mean())
        assert 0.93 <= covered <= 0.965
    assert not bool(got.near_black.any())


@pytest.mark.parametrize("value", [0.0, 0.1, 255.0])
def test_constant_patches(value: float) -> None:
    got = patch_contrast(torch.full((7, 9), value), torch.full((5, 5), value))
    assert bool(got.noiseless)
    assert math.isnan(float(got.cnr))
    assert bool(got.near_black) == (value == 0)
    step = patch_contrast(torch.full((7, 9), value + 1), torch.full((5, 5), value))
    assert float(step.cnr) == math.inf
    assert math.isnan(float(step.cnr_low))


def test_patch_in_the_dark_is_flagged() -> None:
    assert bool(patch_contrast(normal(20, 9, 10, 10), normal(0.5, 9, 10, 10, seed=2)).near_black)


def test_closed_form_is_differentiable() -> None:
    inputs = tuple(
        torch.tensor(v, dtype=torch.float64, requires_grad=True) for v in (120.0, 81.0, 60.0, 36.0)
    )
    assert torch.autograd.gradcheck(
        lambda *x: gaussian_detection_probability(*x, **WEBER),
        inputs,
    )


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"kind": "rms"}, ValueError, "kind = 'rms'"),
        ({"tolerance": 0.0}, ValueError, "tolerance"),
        ({"nominal": 0.0}, ValueError, "must differ"),
        ({"nominal": -0.8}, ValueError, "between -1"),
        ({"nominal": 0.9, "kind": "michelson"}, ValueError, "between -1 and 1"),
        ({"nominal": math.nan}, ValueError, "nominal"),
        ({"level": 2.0}, ValueError, "level"),
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


def test_negative_variance_is_named() -> None:
    one = torch.ones(())
    with pytest.raises(ValueError, match="variance_b: must be >= 0"):
        gaussian_detection_probability(one, one, one, -one, **WEBER)
