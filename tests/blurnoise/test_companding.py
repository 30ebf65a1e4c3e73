"""Companding: knees, slopes, and the noise that each part of the range has."""

from __future__ import annotations

import math

import pytest
import torch

from blurnoise.companding import PiecewiseLinear, Skimming

SKIMMING = Skimming(knee_e=6000.0, first_share=0.9)
TWENTY_BITS = PiecewiseLinear(((0, 0), (1024, 1024), (65536, 2560), (1 << 20, 4095)))


def test_skimming_bends_at_the_knee_and_comes_back() -> None:
    signal = torch.linspace(0, 90_000, 1001, dtype=torch.float64)
    held = SKIMMING.companded(signal)
    torch.testing.assert_close(SKIMMING.expanded(held), signal)
    torch.testing.assert_close(held[signal < 6000 / 0.9], signal[signal < 6000 / 0.9])
    assert SKIMMING.slope_ratio == pytest.approx(10.0)
    assert float(held[-1]) == pytest.approx(6000 + 9000)


@pytest.mark.parametrize("signal_e", [3000.0, 30_000.0])
def test_noise_above_the_knee_is_that_of_the_second_part(signal_e: float) -> None:
    """Against counts of both parts, of which the first is cut at the knee."""
    draw, n = torch.Generator().manual_seed(2), 200_000
    first = torch.poisson(torch.full((n,), 0.9 * signal_e), generator=draw).clamp(max=6000.0)
    held = first + torch.poisson(torch.full((n,), 0.1 * signal_e), generator=draw)
    signal = torch.tensor(signal_e)
    variance = float(SKIMMING.variance_e2(signal))
    assert float(held.mean()) == pytest.approx(
        float(SKIMMING.companded(signal)), abs=5 * math.sqrt(variance / n)
    )
    assert float(held.var()) == pytest.approx(variance, rel=5 * math.sqrt(2 / n))


def test_incremental_snr_falls_at_the_reset() -> None:
    below, above = torch.tensor([6600.0, 6700.0])
    snr = [
        float(signal) / slope / math.sqrt(float(SKIMMING.variance_e2(signal)))
        for signal, slope in ((below, 1.0), (above, SKIMMING.slope_ratio))
    ]
    assert snr[0] / snr[1] == pytest.approx(math.sqrt(10), rel=0.02)


def test_twenty_bits_in_twelve() -> None:
    levels = torch.arange(0, 1 << 20, 7).double()
    codes = TWENTY_BITS.companded(levels)
    assert float(codes.max()) <= 4095
    assert bool((codes.diff() >= 0).all())
    torch.testing.assert_close(codes[levels <= 1024], levels[levels <= 1024], rtol=0, atol=0)
    assert float(TWENTY_BITS.companded(torch.tensor(2.0**21))) == 4095


@pytest.mark.parametrize(("low", "high"), [(1024, 65536), (65536, 1 << 20)])
def test_rounding_variance_is_slope_squared_over_12(low: int, high: int) -> None:
    levels = low + (high - low) * torch.rand(200_000, generator=torch.Generator().manual_seed(3)).double()
    error = TWENTY_BITS.expanded(TWENTY_BITS.companded(levels)) - levels
    expected = float(TWENTY_BITS.rounding_variance(levels[:1]))
    assert float(error.var()) == pytest.approx(
        expected, rel=0.02
    )  # whole codes of a segment; its ends count less
    assert len(TWENTY_BITS.rounding_variance(levels).unique()) == 1


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (((0, 0),), "at least two"),
        (((0, 1), (2, 3)), "from \\(0, 0\\)"),
        (((0, 0), (2, 3), (2, 4)), "must increase"),
        (((0, 0), (float("nan"), 4)), "must be"),
    ],
)
def test_bad_points(points: tuple[tuple[float, float], ...], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        PiecewiseLinear(points)


def test_bad_knee() -> None:
    with pytest.raises(ValueError, match=r"first_share = 1\.0: must be"):
        Skimming(6000.0, 1.0)
