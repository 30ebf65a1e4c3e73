"""Photon transfer: gain, read noise, dark current, black level and fixed patterns from few frames.

Model (EMVA 1288 release 4, linear): a level of mean m has the temporal variance V = V_r + K (m - b) + rounding, flat
or dark, with b the mean in the dark at no exposure and V_r = (K read)^2; the dark mean is b + K d T. Shot noise of
light and of dark charge lie on one line, so dark frames need not have the flat ones' exposures.
Rounding adds 1/12 DN^2, and where noise is lower what :mod:`~blurnoise_eval.calibration.rounding` says.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter
from scipy.optimize import least_squares
from scipy.stats import chi2

from blurnoise.metrics.estimate import Estimate
from blurnoise_eval.calibration.levels import Level
from blurnoise_eval.calibration.rounding import PLAIN_DN2, rounded, spatial_variance

Floats = NDArray[np.float64]
Z = 1.959964
"""Of a normal number, two-sided 95 %."""
SURELY = 5.0
"""Standard deviations from which on something is there."""
SUSPICIOUS = 0.01
"""Probability of the scatter about a line below which its errors are widened to what is seen."""
_SMOOTH_PX = (
    7  # side of the square whose mean is taken off for PRNU, as EMVA 1288 release 4 does against shading
)


_OUTLYING = 6.0  # deviations: of a normal pattern one pixel in 5 10^8 is


@dataclass(frozen=True)
class Pattern:
    """Variance over pixels of a mean frame, DN^2, of which temporal noise is ``noise_dn2``; error: one deviation.

    outliers: pixels beyond ``_OUTLYING`` deviations, which do not count; with them the variance is outlying_dn2 more.
    """

    variance_dn2: float
    error_dn2: float
    noise_dn2: float
    pixels: int
    outliers: int
    outlying_dn2: float


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

    def at(self, x: float) -> float:
        """Its value; the offset where there is no slope."""
        return self.offset + (0.0 if math.isnan(self.slope) else self.slope) * x


@dataclass(frozen=True)
class Transfer:
    """The fit, in DN and DN^2. covariance: of (gain, read_dn2, spread_dn2). rounding: it rules in the dark.

    dark: the dark mean over the exposure. expected_dn2: the model's variance at each level that was fitted.
    """

    gain: float
    read_dn2: float
    spread_dn2: float
    covariance: Floats
    dark: Line
    expected_dn2: Floats
    chi_square: float
    freedom: int
    rounding: bool

    def error(self, gradient: Sequence[float]) -> float:
        """Standard deviation of what has this gradient with respect to (gain, read_dn2, spread_dn2)."""
        along = np.asarray(gradient)
        return math.sqrt(max(0.0, float(along @ self.covariance @ along)))


def fit(dark: Sequence[Level], flat: Sequence[Level], pattern: Pattern) -> Transfer:
    """Weighted least squares over all levels. pattern: of the dark frames' mean.

    Each variance counts with its own error, relative to the model's variance rather than to its own, since what
    happens to be low would count more. Errors are widened where the scatter is beyond chance. Where rounding rules,
    the dark line is fitted along, because means tell then what variances do, and variances where the means lie.
    """
    data = _Data.of(dark, flat, pattern)
    line = dark_line(dark, data.mean[: data.dark])
    lowest = float(data.seen[: data.dark].min())
    rounding = lowest - 1 / 12 < PLAIN_DN2
    rough = straight(data.mean - line.offset, data.seen, data.error)
    gain = max(rough.slope, 1e-6 * float(data.seen.max() / data.mean.max()))
    fixed = max(pattern.variance_dn2 - pattern.noise_dn2, 1e-4)
    start = np.array([gain, max(lowest - 1 / 12, 1e-3), fixed])
    scale = np.array([gain, max(lowest, 0.05), max(pattern.variance_dn2, 0.05)])
    if rounding:
        slope = 0.0 if math.isnan(line.slope) else line.slope
        start = _best_start(data, np.array([*start, line.offset, slope]))
        scale = np.array([*scale, 1.0, 1 / max(float(data.exposure_s.max()), 1e-9)])
        if math.isnan(line.slope):
            start, scale = start[:4], scale[:4]
    low = np.array([1e-3, 0, 0, -np.inf, -np.inf][: len(start)])
    for _ in range(3):
        found = least_squares(
            lambda unknown, of: _residuals(unknown * scale, of, line), np.maximum(start / scale, low),
            bounds=(low, np.inf), x_scale="jac", args=(data,),
        )  # fmt: skip
        start = found.x * scale
        data = data.weighted(_model(start, data, line)[0])
    residuals = _residuals(start, data, line)
    covariance = np.linalg.pinv(found.jac.T @ found.jac) * np.outer(scale, scale)
    levels = (
        slice(None) if rounding else slice(len(data.seen))
    )  # not what the pattern adds, which always fits
    freedom = len(residuals[levels]) - (len(start) if rounding else 2)
    chi_square = float((residuals[levels] ** 2).sum())
    covariance *= widened(chi_square, freedom)
    if rounding:
        errors = np.sqrt(np.diag(covariance))
        line = (
            Line(start[3], start[4], errors[3], errors[4])
            if len(start) == 5
            else Line(start[3], math.nan, errors[3], math.nan)
        )
    return Transfer(
        float(start[0]), float(start[1]), float(start[2]), covariance[:3, :3], line,
        _model(start, data, line)[0], chi_square, freedom, rounding,
    )  # fmt: skip


@dataclass(frozen=True)
class _Data:
    """What is fitted: means and variances of the levels, ``dark`` of them first, and the dark pattern."""

    dark: int
    exposure_s: Floats
    mean: Floats
    mean_error: Floats
    seen: Floats
    error: Floats
    relative: Floats
    counted: Floats
    pattern: Pattern

    @classmethod
    def of(cls, dark: Sequence[Level], flat: Sequence[Level], pattern: Pattern) -> _Data:
        levels = [*dark, *flat]
        exposure, mean, mean_error, seen, noise, pixels = np.array(
            [
                (
                    level.exposure_s, level.mean_dn, level.mean_error_dn, level.variance_dn2,
                    level.variance_error_dn2, level.pixels,
                )
                for level in levels
            ]
        ).T  # fmt: skip
        counted = 1.5 / pixels  # variance of one pixel that is off by one
        relative = np.maximum(noise / np.maximum(seen, 1e-9), 1e-6)
        # Rounding acts on the pixels that there are, whose means are a sample of the pattern.
        mean_error = np.hypot(mean_error, np.sqrt(pattern.variance_dn2 / pixels) + counted)
        return cls(
            len(dark), exposure, mean, mean_error, seen, np.hypot(noise, counted), relative, counted, pattern
        )

    def weighted(self, expected: Floats) -> _Data:
        """With errors by the expected variance; not below what is seen where rounding makes it no constant share."""
        error = np.hypot(self.relative * expected, self.counted)
        low = expected < PLAIN_DN2
        return replace(self, error=np.where(low, np.maximum(error, self.error), error))


def _best_start(data: _Data, start: Floats) -> Floats:
    """Of starts over read noise and the phase of the black level the best: there are several minima."""
    tries = [
        np.array([start[0], (0.04 * 1.5**step) ** 2, start[2], start[3] + phase, start[4]])
        for step in range(8)
        for phase in (-0.4, -0.2, 0.0, 0.2, 0.4)
    ]
    line = Line(0.0, 0.0, 0.0, 0.0)
    return min([start, *tries], key=lambda each: float((_residuals(each, data, line) ** 2).sum()))


def hidden_charge(dark: Sequence[Level], fit: Transfer) -> tuple[float, float]:
    """Dark variance that grows with exposure beyond what the dark mean says, DN^2/s, and its standard deviation.

    A camera that takes the mean of shielded pixels off hides dark charge from the mean, not from the variance.
    """
    if fit.rounding or math.isnan(fit.dark.slope):
        return 0.0, math.inf
    exposure, seen, error = np.array(
        [(level.exposure_s, level.variance_dn2, level.variance_error_dn2) for level in dark]
    ).T
    line = straight(exposure, seen, np.maximum(error, 1e-9))
    return line.slope - fit.gain * fit.dark.slope, line.slope_error


def widened(chi_square: float, freedom: int) -> float:
    """By how much a variance grows for scatter beyond chance: chi-square per degree of freedom, or 1."""
    if freedom < 1 or chi2.sf(chi_square, freedom) > SUSPICIOUS:
        return 1.0
    return max(1.0, chi_square / freedom)


def dark_line(dark: Sequence[Level], mean_dn: Floats) -> Line:
    """The dark mean over the exposure in seconds, from ``mean_dn`` of the levels, which are by rising exposure.

    Where the levels drift, dark current is taken to change evenly from one level to the next.
    """
    exposure = np.array([level.exposure_s for level in dark])
    error = np.array([level.mean_error_dn for level in dark])
    # a mean of whole numbers that hardly vary is known no better than one pixel tells
    error = np.hypot(error, 1e-6 + 1 / np.array([level.frames * level.pixels for level in dark]))
    rate, rate_error = drift(dark)
    if abs(rate) < SURELY * rate_error or len(np.unique(exposure)) < 4:
        return straight(exposure, mean_dn, error)
    place = np.arange(len(dark)) - (len(dark) - 1) / 2
    design = np.stack([np.ones(len(dark)), exposure, exposure * place], 1) / error[:, None]
    (offset, slope, change), *_ = np.linalg.lstsq(design, mean_dn / error, rcond=None)
    chi_square = float(((design @ (offset, slope, change) - mean_dn / error) ** 2).sum())
    covariance = np.linalg.inv(design.T @ design) * widened(chi_square, len(dark) - 3)
    offset_error, slope_error, _ = np.sqrt(np.diag(covariance)).tolist()
    return Line(float(offset), float(slope), offset_error, slope_error, float(change) * len(dark))


def drift(dark: Sequence[Level]) -> tuple[float, float]:
    """How dark current changes within a level, DN/s from its first frame to its last, and its standard deviation."""
    exposure, change, error = np.array(
        [
            (level.exposure_s, level.drift_dn, math.sqrt(2 * level.variance_dn2 / level.pixels + 1e-12))
            for level in dark
        ]
    ).T
    weight = exposure / error**2
    rate = float(weight @ change / (weight @ exposure))
    scatter = float((((change - rate * exposure) / error) ** 2).sum())
    return rate, math.sqrt(widened(scatter, len(dark) - 1) / float(weight @ exposure))


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
    """Which values about 0 lie beyond ``_OUTLYING`` deviations, as the median tells them, and beyond ``least``."""
    deviation = 1.4826 * float(np.median(np.abs(values)))
    found: NDArray[np.bool_] = np.abs(values) > max(_OUTLYING * deviation, least)
    return found


def _planes(mean: Floats) -> list[Floats]:
    return [mean[row::2, column::2] for row in (0, 1) for column in (0, 1)]


def _pattern(planes: Sequence[Floats], noise_dn2: float, kept: float) -> Pattern:
    out = [
        outlying(plane.ravel(), 1.0) for plane in planes
    ]  # of whole numbers one that is one off may be none
    inside = [plane.ravel()[~far] for plane, far in zip(planes, out, strict=True)]
    if kept == 1:
        inside = [values - values.mean() for values in inside]
    squares = np.concatenate(inside) ** 2 / kept
    every = sum(float((plane**2).sum()) for plane in planes) / sum(plane.size for plane in planes) / kept
    freedom = squares.size - (len(planes) if kept == 1 else 0)
    variance, outliers = float(squares.sum()) / freedom, int(sum(far.sum() for far in out))
    return Pattern(
        variance, float(squares.std()) / math.sqrt(freedom), noise_dn2, squares.size + outliers, outliers,
        max(0.0, every - variance),
    )  # fmt: skip


def noise_of_mean(levels: Sequence[Level]) -> float:
    """Temporal variance of the mean of the levels' mean frames."""
    return sum(level.variance_dn2 / level.frames for level in levels) / len(levels) ** 2


def root(square: float, error: float) -> Estimate:
    """The root of a square that is known with a normal error, at least 0."""
    low, middle, high = (
        math.sqrt(max(0.0, value)) for value in (square - Z * error, square, square + Z * error)
    )
    return Estimate(middle, low, high)


def _residuals(values: Floats, data: _Data, line: Line) -> Floats:
    variance, spread, dark = _model(values, data, line)
    pattern = data.pattern
    parts: list[Floats] = [
        (data.seen - variance) / data.error,
        np.array([(pattern.variance_dn2 - pattern.noise_dn2 - spread) / max(pattern.error_dn2, 1e-9)]),
    ]
    if len(values) > 3:
        parts.append((data.mean[: data.dark] - dark) / data.mean_error[: data.dark])
    return np.concatenate(parts)


def _model(values: Floats, data: _Data, line: Line) -> tuple[Floats, float, Floats]:
    """Variance at each level, variance over pixels of the dark mean, mean at each dark level.

    values: gain, read_dn2, spread_dn2, and where rounding rules the dark line's offset and slope, else ``line``.
    """
    gain, read_dn2, spread_dn2 = values[:3]
    if len(values) == 3:
        return read_dn2 + 1 / 12 + gain * (data.mean - line.offset), spread_dn2, data.mean[: data.dark]
    offset, slope = values[3], values[4] if len(values) > 4 else 0.0
    means = np.concatenate([offset + slope * data.exposure_s[: data.dark], data.mean[data.dark :]])
    told = rounded(
        means, np.maximum(read_dn2 + gain * (means - offset), 0.0), math.sqrt(max(spread_dn2, 0.0))
    )
    return told.variance_dn2, spatial_variance(told.pixel_dn[: data.dark]), told.mean_dn[: data.dark]


def straight(x: Floats, y: Floats, error: Floats) -> Line:
    """Weighted straight line through (x, y); errors widened where the scatter is beyond chance."""
    weight = 1 / error**2
    centre = float((weight * x).sum() / weight.sum())
    spread = float((weight * (x - centre) ** 2).sum())
    height = float((weight * y).sum() / weight.sum())
    if len(np.unique(x)) < 2:
        factor = widened(float((weight * (y - height) ** 2).sum()), len(x) - 1)
        return Line(height, math.nan, math.sqrt(factor / weight.sum()), math.nan)
    slope = float((weight * (x - centre) * y).sum() / spread)
    offset = height - slope * centre
    factor = widened(float((weight * (y - offset - slope * x) ** 2).sum()), len(x) - 2)
    return Line(
        offset,
        slope,
        math.sqrt(factor * (1 / weight.sum() + centre**2 / spread)),
        math.sqrt(factor / spread),
    )
