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
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter
from scipy.optimize import least_squares
from scipy.stats import chi2

from blurnoise_eval.calibration.levels import Level, columns
from blurnoise_eval.calibration.rounding import PLAIN_DN2, rounded, spatial_variance

Floats = NDArray[np.float64]
F = TypeVar("F", float, Floats)
SURELY = 5.0
"""Standard deviations from which on something is there."""
SUSPICIOUS = 0.01
"""Probability of the scatter about a line below which its errors are widened to the scatter."""
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

    @property
    def fixed_dn2(self) -> float:
        """The variance without temporal noise."""
        return self.variance_dn2 - self.noise_dn2


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


@dataclass(frozen=True)
class Transfer:
    """The fit, in DN and DN^2. covariance: of (gain, read_dn2, spread_dn2). rounding: it rules in the dark.

    dark: the dark mean over the exposure. expected_dn2: the model's variance at each level that was fitted.
    widened: the variances scatter beyond chance, and the covariance was widened for that.
    """

    gain: float
    read_dn2: float
    spread_dn2: float
    covariance: Floats
    dark: Line
    expected_dn2: Floats
    widened: bool
    rounding: bool

    def error(self, *gradient: float) -> float:
        """Standard deviation of what has this gradient with respect to (gain, read_dn2, spread_dn2)."""
        along = np.array([*gradient, *[0.0] * (3 - len(gradient))])
        return math.sqrt(max(0.0, float(along @ self.covariance @ along)))


@dataclass(frozen=True)
class _Data:
    """Means and variances of the levels to fit, ``dark`` of them first, and the dark pattern.

    relative: error of a variance over it; counted: variance of one pixel that is off by one.
    """

    dark: int
    exposure_s: Floats
    mean: Floats
    mean_error: Floats
    seen: Floats
    error: Floats
    relative: Floats
    counted: Floats
    pattern: Pattern
    line: Line

    def weighted(self, expected: Floats) -> _Data:
        """With errors by the expected variance; at least the measured ones where rounding rules."""
        error = np.hypot(self.relative * expected, self.counted)
        low = expected < PLAIN_DN2
        return replace(self, error=np.where(low, np.maximum(error, self.error), error))

    def model(self, values: Floats) -> tuple[Floats, float, Floats]:
        """Variance at each level, variance over pixels of the dark mean, mean at each dark level.

        values: gain, read_dn2, spread_dn2, and where rounding rules the dark line's offset and slope.
        """
        gain, read_dn2, spread_dn2 = values[:3]
        if len(values) == 3:
            variance = read_dn2 + 1 / 12 + gain * (self.mean - self.line.offset)
            return variance, spread_dn2, self.mean[: self.dark]
        offset, slope = values[3], values[4] if len(values) > 4 else 0.0
        means = np.concatenate([offset + slope * self.exposure_s[: self.dark], self.mean[self.dark :]])
        before = np.maximum(read_dn2 + gain * (means - offset), 0.0)
        after = rounded(means, before, math.sqrt(max(spread_dn2, 0.0)))
        return after.variance_dn2, spatial_variance(after.pixel_dn[: self.dark]), after.mean_dn[: self.dark]

    def residuals(self, values: Floats) -> Floats:
        """Of the variances, of the pattern, and where rounding rules of the dark means; over their errors."""
        variance, spread, dark = self.model(values)
        pattern = self.pattern
        parts = [
            (self.seen - variance) / self.error,
            np.array([(pattern.fixed_dn2 - spread) / max(pattern.error_dn2, 1e-9)]),
        ]
        if len(values) > 3:
            parts.append((self.mean[: self.dark] - dark) / self.mean_error[: self.dark])
        return np.concatenate(parts)


def fit(dark: Sequence[Level], flat: Sequence[Level], pattern: Pattern) -> Transfer:
    """Weighted least squares over all levels. pattern: of the dark frames' mean.

    Each variance counts with its own error, relative to the model's variance rather than to its own, since what
    happens to be low would count more. Errors are widened where the scatter is beyond chance. Where rounding rules,
    the dark line is fitted along, because means and variances there depend on one another.
    """
    data = _data(dark, flat, pattern)
    line = data.line
    lowest = float(data.seen[: data.dark].min())
    rounding = lowest - 1 / 12 < PLAIN_DN2
    gain = max(
        straight(data.mean - line.offset, data.seen, data.error).slope,
        1e-6 * float(data.seen.max() / data.mean.max()),
    )
    start = np.array([gain, max(lowest - 1 / 12, 1e-3), max(pattern.fixed_dn2, 1e-4)])
    scale = np.array([gain, max(lowest, 0.05), max(pattern.variance_dn2, 0.05)])
    if rounding:
        sloped = not math.isnan(line.slope)
        start = _best_start(data, np.array([*start, line.offset, line.slope if sloped else 0.0]))
        scale = np.array([*scale, 1.0, 1 / max(float(data.exposure_s.max()), 1e-9)])
        start, scale = start[: 4 + sloped], scale[: 4 + sloped]
    low = np.array([1e-3, 0, 0, -np.inf, -np.inf][: len(start)])
    for _ in range(3):
        found = least_squares(
            lambda unknown, of: of.residuals(unknown * scale),
            np.maximum(start / scale, low),
            bounds=(low, np.inf),
            x_scale="jac",
            args=(data,),
        )
        start = found.x * scale
        data = data.weighted(data.model(start)[0])
    residuals = data.residuals(start)
    if not rounding:
        residuals = residuals[: len(data.seen)]  # the pattern always fits
    chi_square = float((residuals**2).sum())
    factor = widened(chi_square, len(residuals) - (len(start) if rounding else 2))
    covariance = factor * np.linalg.pinv(found.jac.T @ found.jac) * np.outer(scale, scale)
    if rounding:
        values, errors = ([*each[3:], math.nan][:2] for each in (start, np.sqrt(np.diag(covariance))))
        line = Line(*values, *errors)
    gain, read_dn2, spread_dn2 = start[:3].tolist()
    expected, _, _ = data.model(start)
    return Transfer(
        gain, read_dn2, spread_dn2, covariance[:3, :3], line, expected, widened=factor > 1, rounding=rounding
    )


def _data(dark: Sequence[Level], flat: Sequence[Level], pattern: Pattern) -> _Data:
    exposure, mean, mean_error, seen, noise, pixels = columns(
        [*dark, *flat],
        "exposure_s",
        "mean_dn",
        "mean_error_dn",
        "variance_dn2",
        "variance_error_dn2",
        "pixels",
    )
    counted = 1.5 / pixels
    return _Data(
        dark=len(dark),
        exposure_s=exposure,
        mean=mean,
        # Rounding acts on the pixels that there are, whose means are a sample of the pattern.
        mean_error=np.hypot(mean_error, np.sqrt(pattern.variance_dn2 / pixels) + counted),
        seen=seen,
        error=np.hypot(noise, counted),
        relative=np.maximum(noise / np.maximum(seen, 1e-9), 1e-6),
        counted=counted,
        pattern=pattern,
        line=dark_line(dark),
    )


def _best_start(data: _Data, start: Floats) -> Floats:
    """Of starts over read noise and the phase of the black level the best: there are several minima."""
    tries = [
        np.array([start[0], (0.04 * 1.5**step) ** 2, start[2], start[3] + phase, start[4]])
        for step in range(8)
        for phase in (-0.4, -0.2, 0.0, 0.2, 0.4)
    ]
    return min([start, *tries], key=lambda each: float((data.residuals(each) ** 2).sum()))


def hidden_charge(dark: Sequence[Level], fit: Transfer) -> tuple[float, float]:
    """Dark variance that grows with exposure beyond the dark mean's growth, DN^2/s, and its standard deviation.

    A camera that takes the mean of shielded pixels off hides dark charge from the mean, not from the variance.
    """
    if fit.rounding or math.isnan(fit.dark.slope):
        return 0.0, math.inf
    exposure, seen, error = columns(dark, "exposure_s", "variance_dn2", "variance_error_dn2")
    line = straight(exposure, seen, np.maximum(error, 1e-9))
    return line.slope - fit.gain * fit.dark.slope, line.slope_error


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
    design = np.stack([np.ones(len(dark)), exposure, exposure * place], 1)
    (offset, slope, change), errors = weighted_fit(design, mean, error)
    return Line(offset, slope, errors[0], errors[1], change * len(dark))


def drift(dark: Sequence[Level]) -> tuple[float, float]:
    """How dark current changes within a level, DN/s from its first frame to its last, and its standard deviation."""
    exposure, change, variance, pixels = columns(dark, "exposure_s", "drift_dn", "variance_dn2", "pixels")
    (rate,), (error,) = weighted_fit(exposure[:, None], change, np.sqrt(2 * variance / pixels + 1e-12))
    return rate, error


def straight(x: Floats, y: Floats, error: Floats) -> Line:
    """Weighted straight line through (x, y)."""
    if len(np.unique(x)) < 2:
        (height,), (height_error,) = weighted_fit(np.ones((len(x), 1)), y, error)
        return Line(height, math.nan, height_error, math.nan)
    values, errors = weighted_fit(np.stack([np.ones(len(x)), x], 1), y, error)
    return Line(*values, *errors)


def weighted_fit(design: Floats, y: Floats, error: Floats) -> tuple[list[float], list[float]]:
    """Values (k,) for which design (n, k) times them is next to y (n,), and their standard deviations.

    Least squares of what is off over ``error``; deviations are widened where the scatter is beyond chance.
    """
    scaled, of = design / error[:, None], y / error
    values, *_ = np.linalg.lstsq(scaled, of)
    factor = widened(float(((scaled @ values - of) ** 2).sum()), len(y) - len(values))
    covariance = factor * np.linalg.inv(scaled.T @ scaled)
    return values.tolist(), np.sqrt(np.diag(covariance)).tolist()


def widened(chi_square: float, freedom: int) -> float:
    """By how much a variance grows for scatter beyond chance: chi-square per degree of freedom, or 1."""
    if freedom < 1 or chi2.sf(chi_square, freedom) > SUSPICIOUS:
        return 1.0
    return max(1.0, chi_square / freedom)


def dark_pattern(mean: Floats, levels: Sequence[Level]) -> Pattern:
    """Of ``mean`` (H, W), the mean of the dark levels' mean frames: each of the four planes of a mosaic apart."""
    return _pattern(
        [plane - np.median(plane) for plane in _planes(mean)], noise_of_mean(levels), smooth=False
    )


def response_pattern(mean: Floats, noise_dn2: float) -> Pattern:
    """Of ``mean`` (H, W), flat frames' less dark ones': each plane of a mosaic without its smooth part.

    The mean of 7 x 7 pixels is taken off, which takes 1/49 of the variance of a pattern without structure.
    """
    return _pattern([without_shading(mean)], noise_dn2, smooth=True)


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
    found: NDArray[np.bool_] = np.abs(values) > max(_OUTLYING * deviation, least)
    return found


def _planes(mean: Floats) -> list[Floats]:
    return [mean[row::2, column::2] for row in (0, 1) for column in (0, 1)]


def _pattern(planes: Sequence[Floats], noise_dn2: float, *, smooth: bool) -> Pattern:
    """smooth: the planes are without their smooth part, about 0; else about the mean of what does not lie out."""
    kept = 1 - 1 / _SMOOTH_PX**2 if smooth else 1.0
    # a mean of whole numbers that is one off may not lie out
    inside = [plane[~outlying(plane, 1.0)] for plane in planes]
    if not smooth:
        inside = [values - values.mean() for values in inside]
    squares = np.concatenate(inside) ** 2 / kept
    freedom = squares.size - (0 if smooth else len(planes))
    variance = float(squares.sum()) / freedom
    pixels = sum(plane.size for plane in planes)
    with_outliers = sum(float((plane**2).sum()) for plane in planes) / pixels / kept
    return Pattern(
        variance_dn2=variance,
        error_dn2=float(squares.std()) / math.sqrt(freedom),
        noise_dn2=noise_dn2,
        pixels=pixels,
        outliers=pixels - squares.size,
        outlying_dn2=max(0.0, with_outliers - variance),
    )


def noise_of_mean(levels: Sequence[Level]) -> float:
    """Temporal variance of the mean of the levels' mean frames."""
    return sum(level.variance_dn2 / level.frames for level in levels) / len(levels) ** 2
