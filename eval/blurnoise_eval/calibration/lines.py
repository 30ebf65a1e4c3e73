"""Weighted least squares whose errors grow where the scatter is beyond chance, and the line of dark means."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from scipy.stats import chi2

from blurnoise_eval.calibration.levels import Floats, Level, columns

F = TypeVar("F", float, Floats)
SURELY = 5.0
"""Standard deviations from which on something is there."""
SUSPICIOUS = 0.01
"""Probability of the scatter about a line below which its errors are widened to the scatter."""


@dataclass(frozen=True)
class Line:
    """offset + slope x, with standard deviations; slope NaN where there is one x only.

    change: of the slope over all levels, about the slope, where that was fitted.
    """

    offset: float
    slope: float
    offset_error: float
    slope_error: float
    change: float = 0.0

    def at(self, x: F) -> F:
        """Its value; the offset where there is no slope."""
        return self.offset + (0.0 if math.isnan(self.slope) else self.slope) * x


def dark_line(dark: Sequence[Level]) -> Line:
    """The dark mean over the exposure in seconds, of levels by rising exposure.

    Where the levels drift, dark current is taken to change evenly from one level to the next.
    """
    exposure, mean, error, frames, pixels = columns(
        dark, "exposure_s", "mean_dn", "mean_error_dn", "frames", "pixels"
    )
    # a mean of whole numbers that hardly vary is known no better than to one pixel
    error = np.hypot(error, 1e-6 + 1 / (frames * pixels))
    rate, rate_error = drift(dark)
    if abs(rate) < SURELY * rate_error or len(np.unique(exposure)) < 4:
        return straight(exposure, mean, error)
    place = np.arange(len(dark)) - (len(dark) - 1) / 2
    (offset, slope, change), errors = weighted_fit(
        [np.ones(len(dark)), exposure, exposure * place], mean, error
    )
    return Line(offset, slope, errors[0], errors[1], change * len(dark))


def drift(dark: Sequence[Level]) -> tuple[float, float]:
    """How dark current changes within a level, DN/s from its first frame to its last, and its standard deviation."""
    exposure, change, variance, pixels = columns(dark, "exposure_s", "drift_dn", "variance_dn2", "pixels")
    (rate,), (error,) = weighted_fit([exposure], change, np.sqrt(2 * variance / pixels + 1e-12))
    return rate, error


def straight(x: Floats, y: Floats, error: Floats) -> Line:
    """Weighted straight line through (x, y)."""
    if len(np.unique(x)) < 2:
        (height,), (height_error,) = weighted_fit([np.ones(len(x))], y, error)
        return Line(height, math.nan, height_error, math.nan)
    values, errors = weighted_fit([np.ones(len(x)), x], y, error)
    return Line(*values, *errors)


def weighted_fit(design: Sequence[Floats], y: Floats, error: Floats) -> tuple[list[float], list[float]]:
    """Factors (k,) of the k columns (n,) whose sum is next to y (n,), and their standard deviations.

    Least squares of what is off over ``error``; deviations are widened where the scatter is beyond chance.
    """
    scaled, of = np.stack(design, 1) / error[:, None], y / error
    values, *_ = np.linalg.lstsq(scaled, of)
    factor = widened(float(((scaled @ values - of) ** 2).sum()), len(y) - len(values))
    covariance = factor * np.linalg.inv(scaled.T @ scaled)
    return values.tolist(), np.sqrt(np.diag(covariance)).tolist()


def widened(chi_square: float, freedom: int) -> float:
    """By how much a variance grows for scatter beyond chance: chi-square per degree of freedom, or 1."""
    if freedom < 1 or chi2.sf(chi_square, freedom) > SUSPICIOUS:
        return 1.0
    return max(1.0, chi_square / freedom)
