"""Rounding of normal noise against draws, and against the range that the standard's users know."""

from __future__ import annotations

import numpy as np
import pytest
from blurnoise_eval.calibration.transfer import rounded, spatial_variance


@pytest.mark.parametrize(
    ("sigma", "place", "spread"), [(0.3, 7.2, 0.0), (0.2, 7.45, 0.1), (0.5, 7.0, 0.3), (0.9, 7.4, 2.0)]
)
def test_moments_are_those_of_draws(sigma: float, place: float, spread: float) -> None:
    """20 000 pixels of 50 draws: a mean to sigma/1000, a variance to sqrt(2/10^6), patterns to sqrt(2/20 000)."""
    random = np.random.default_rng(1)
    pixels = place + spread * random.standard_normal(20_000)
    drawn = np.round(pixels + sigma * random.standard_normal((50, 20_000)))
    mean, variance, by_pixel = rounded(np.array([place]), np.array([sigma**2]), spread)
    assert mean[0] == pytest.approx(drawn.mean(), abs=5 * (0.001 + spread / 141))
    assert variance[0] == pytest.approx(drawn.var(0, ddof=1).mean(), abs=0.01 * (sigma**2 + 0.08))
    seen = drawn.mean(0).var() - drawn.var(0, ddof=1).mean() / 50
    assert spatial_variance(by_pixel) == pytest.approx(seen, rel=0.06, abs=1e-4)


def test_what_rounding_adds_at_a_quarter_step_depends_on_the_place() -> None:
    added = rounded(np.linspace(0, 1, 101), np.full(101, 0.0625), 0.0)[1] - 0.0625
    assert added.min() == pytest.approx(-0.017, abs=0.001)
    assert added.max() == pytest.approx(0.188, abs=0.001)


def test_the_law_of_a_twelfth_joins_on() -> None:
    low, high = (rounded(np.array([0.25]), np.array([v]), 0.0)[1][0] - v for v in (0.4899, 0.4901))
    assert low == pytest.approx(high, abs=2e-4)
    assert high == pytest.approx(1 / 12)
