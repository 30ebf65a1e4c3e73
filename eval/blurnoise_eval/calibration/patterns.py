"""Fixed patterns: the variance over pixels of mean frames (H, W), without temporal noise and outlying pixels."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

from blurnoise_eval.calibration.levels import Floats, Level

_SMOOTH_PX = (
    7  # side of the square whose mean is taken off for PRNU, as EMVA 1288 release 4 does against shading
)
_OUTLYING = 6.0  # deviations: of a normal pattern one pixel in 5 10^8 is


@dataclass(frozen=True)
class Pattern:
    """Variance over pixels of a mean frame, DN^2; fixed: without temporal noise; error: one deviation.

    outliers: pixels beyond ``_OUTLYING`` deviations, which do not count; with them the variance is outlying_dn2 more.
    """

    variance_dn2: float
    fixed_dn2: float
    error_dn2: float
    pixels: int
    outliers: int
    outlying_dn2: float


def dark_pattern(mean: Floats, levels: Sequence[Level]) -> Pattern:
    """Of ``mean`` (H, W), the mean of the dark levels' mean frames: each of the four planes of a mosaic apart."""
    return _pattern([plane - np.median(plane) for plane in _planes(mean)], noise_of_mean(levels), 1.0)


def response_pattern(mean: Floats, noise_dn2: float) -> Pattern:
    """Of ``mean`` (H, W), flat frames' less dark ones': each plane of a mosaic without its smooth part.

    The mean of 7 x 7 pixels is taken off, which takes 1/49 of the variance of a pattern without structure.
    """
    return _pattern([without_shading(mean)], noise_dn2, 1 - 1 / _SMOOTH_PX**2)


def without_shading(mean: Floats) -> Floats:
    """The values (N,) of the four planes of ``mean`` (H, W), less the mean of the 7 x 7 around each."""
    edge = _SMOOTH_PX // 2
    inner = [
        (plane - uniform_filter(plane, _SMOOTH_PX, mode="reflect"))[edge:-edge, edge:-edge].ravel()
        for plane in _planes(mean)
    ]
    return np.concatenate(inner)


def outlying(values: Floats, least: float = 0.0) -> NDArray[np.bool_]:
    """Which values about 0 lie beyond ``_OUTLYING`` deviations, by their median, and beyond ``least``."""
    deviation = 1.4826 * float(np.median(np.abs(values)))
    return np.asarray(np.abs(values) > max(_OUTLYING * deviation, least))


def noise_of_mean(levels: Sequence[Level]) -> float:
    """Temporal variance of the mean of the levels' mean frames."""
    return sum(level.variance_dn2 / level.frames for level in levels) / len(levels) ** 2


def _planes(mean: Floats) -> list[Floats]:
    return [mean[row::2, column::2] for row in (0, 1) for column in (0, 1)]


def _pattern(planes: Sequence[Floats], noise_dn2: float, kept: float) -> Pattern:
    """kept: of the variance. Below 1 the planes are about 0, else about the mean of what does not lie out."""
    # a mean of whole numbers that is one off may not lie out
    inside = [plane[~outlying(plane, 1.0)] for plane in planes]
    freedom = sum(values.size for values in inside)
    if kept == 1:
        inside = [values - values.mean() for values in inside]
        freedom -= len(planes)
    squares = np.concatenate(inside) ** 2 / kept
    variance = float(squares.sum()) / freedom
    pixels = sum(plane.size for plane in planes)
    with_outliers = sum(float((plane**2).sum()) for plane in planes) / pixels / kept
    return Pattern(
        variance_dn2=variance,
        fixed_dn2=variance - noise_dn2,
        error_dn2=float(squares.std()) / math.sqrt(freedom),
        pixels=pixels,
        outliers=pixels - squares.size,
        outlying_dn2=max(0.0, with_outliers - variance),
    )
