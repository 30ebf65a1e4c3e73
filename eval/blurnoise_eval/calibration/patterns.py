"""Fixed patterns: variances of pixels, rows and columns that frames have in common, DN^2 or relative.

EMVA 1288 release 4: where rows, columns and pixels of a frame of H x W vary independently with the variances r, c
and p, the means of its rows vary by r + p/W, those of its columns by c + p/H, and the rest by p (with the degrees of
freedom of both means removed). The standard subtracts temporal noise from the variances of a mean frame. Here every
other frame is averaged in one mean, the rest in another, and their covariance is the fixed pattern: temporal noise,
also that of rows and columns, is independent in both.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

from blurnoise_eval.calibration.frames import Floats
from blurnoise_eval.calibration.uncertain import Uncertain, Z

SMOOTH_PX = 7  # the mean of this square is subtracted for PRNU, as in EMVA 1288 release 4
Halves = tuple[Floats, Floats]
"""Means (H, W) of every other frame, and of the frames in between."""
Mask = NDArray[np.bool_]
_SITES = tuple((slice(row, None, 2), slice(column, None, 2)) for row in (0, 1) for column in (0, 1))
"""The four sites of a mosaic, whose pixels may have different filters."""
_INNER = (slice(SMOOTH_PX - 1, 1 - SMOOTH_PX),) * 2  # where the smoothing squares of a site are complete
_OUTLYING = 6.0  # deviations: one pixel in 5 10^8 of a normal pattern
_CORRELATED = (
    1.29  # sum of squared autocorrelations of white noise minus its mean of 7: widens a variance's error
)


@dataclass(frozen=True)
class LineVariances:
    """Variances of rows, columns and pixels.

    >>> LineVariances(Uncertain(4.0, 1.0), Uncertain(1.0, 1.0), Uncertain(9.0, 0.1)).lines.value  # of sure ones
    4.0
    """

    row: Uncertain
    column: Uncertain
    pixel: Uncertain

    def of_mean(self, shape: tuple[int, ...]) -> float:
        """Variance of the mean of a picture of this height and width.

        >>> LineVariances(Uncertain(4.0, 0.0), Uncertain(-1.0, 1.0), Uncertain(9.0, 0.1)).of_mean((10, 9))
        0.5
        """
        height, width = shape
        parts = (self.row.value / height, self.column.value / width, self.pixel.value / (height * width))
        return sum(max(0.0, part) for part in parts)

    @property
    def lines(self) -> Uncertain:
        """The sum for rows and columns, without those whose interval includes 0."""
        sure = [line for line in (self.row, self.column) if line.value > Z * line.error]
        return Uncertain(sum(line.value for line in sure), math.hypot(*(line.error for line in sure)))


@dataclass(frozen=True)
class DarkPattern:
    """Variance over pixels of a dark mean frame, DN^2; fixed: without temporal noise, with its standard deviation.

    outliers: number of pixels beyond ``_OUTLYING`` deviations, which are left out; they would add outlying_dn2.
    """

    variance_dn2: float
    fixed: Uncertain
    pixels: int
    outliers: int
    outlying_dn2: float


def dark_pattern(halves: Halves) -> DarkPattern:
    """The pattern of dark frames. Each site of a mosaic varies about its own mean.

    Hot pixels are left out, because their temporal noise is far larger than that of the others.

    >>> drawn = np.random.default_rng(0)
    >>> pattern = drawn.normal(0.0, 3.0, (64, 64))
    >>> halves = tuple(100 + pattern + drawn.normal(0.0, 1.0, (64, 64)) for _ in range(2))
    >>> round(dark_pattern(halves).fixed.value)  # the square of 3, whatever the noise of the halves
    9
    """
    mean = (halves[0] + halves[1]) / 2
    hot = hot_pixels(mean)
    every, fixed, squares = [], [], []
    for site in _SITES:
        used = ~hot[site]
        one, other = (half[site][used] - half[site][used].mean() for half in halves)
        every.append((mean[site] - np.median(mean[site])).ravel())
        # Temporal noise is independent in both halves, so that it is 0 in the mean of their product.
        fixed.append(one * other)
        squares.append(((one + other) / 2) ** 2)
    products, freedom = np.concatenate(fixed), hot.size - int(hot.sum()) - len(_SITES)
    variance = float(np.concatenate(squares).sum()) / freedom
    return DarkPattern(
        variance_dn2=variance,
        fixed=Uncertain(float(products.sum()) / freedom, float(products.std()) / math.sqrt(freedom)),
        pixels=hot.size,
        outliers=int(hot.sum()),
        outlying_dn2=max(0.0, float((np.concatenate(every) ** 2).mean()) - variance),
    )


def dark_lines(dark: Halves) -> LineVariances:
    """Rows, columns and pixels of the offset, DN^2. Each site of a mosaic varies about its own median."""
    one, other = (_centred(half) for half in dark)
    return common_variances(one, other, outlying((one + other) / 2, 1.0))


def light_lines(light: Halves, dark: Halves, hot: Mask) -> LineVariances:
    """Rows, columns and pixels of the response, relative, without its smooth part; ``hot`` pixels are left out.

    The standard includes the smooth part, which turns the shading of lamp and lens into a pattern of rows. Each site
    of a mosaic is divided by its own means of 7 x 7.
    """
    signals = [lit - unlit for lit, unlit in zip(light, dark, strict=True)]
    means = [smooth(signal, hot) for signal in signals]
    level = sum(means) / 2
    one, other = (((a - b) / level)[_INNER] for a, b in zip(signals, means, strict=True))
    return common_variances(one, other, hot[_INNER] | outlying((one + other) / 2), 1 - 1 / SMOOTH_PX)


def common_variances(
    one: Floats, other: Floats, left_out: Mask | bool = False, remaining: float = 1.0
) -> LineVariances:
    """Variances that ``one`` and ``other`` (H, W), both of mean 0, have in common.

    remaining: share of the variance of rows and columns that a filter has left.

    >>> rows = np.array([[1.0], [-1.0], [1.0], [-1.0]]) * np.ones((4, 6))
    >>> common_variances(rows, rows).row.value  # of 4 values, 3 degrees of freedom
    1.333...
    """
    halves = [np.where(left_out, 0.0, half) for half in (one, other)]
    lines: list[Uncertain] = []
    for axis in (1, 0):
        means = [half.mean(axis, keepdims=True) - half.mean() for half in halves]
        halves = [half - mean for half, mean in zip(halves, means, strict=True)]
        products = means[0] * means[1]
        widened = 1.0 if remaining == 1 else _CORRELATED
        error = float(products.std()) * math.sqrt(widened / products.size)
        lines.append(Uncertain(float(products.sum()) / (products.size - 1), error))
    rest = halves[0] * halves[1]
    total = float(rest.mean()) + lines[0].value + lines[1].value
    error = float(rest.std()) / math.sqrt(rest.size)
    return separate(lines[0], lines[1], Uncertain(total, error), one.shape, remaining)


def separate(
    rows: Uncertain, columns: Uncertain, total: Uncertain, shape: tuple[int, ...], remaining: float = 1.0
) -> LineVariances:
    """Variances of rows, columns and pixels from those of row means, of column means and of all values (``total``).

    Row and column means also contain noise of their pixels. A filter that leaves the share ``remaining`` of the
    variance of rows leaves 1 - (1 - remaining)^2 of that of pixels.

    >>> of_rows, of_columns, total = Uncertain(5.0, 0.0), Uncertain(1.0, 0.0), Uncertain(106.0, 0.0)
    >>> variances = separate(of_rows, of_columns, total, shape=(100, 100))
    >>> round(variances.pixel.value), round(variances.row.value), abs(round(variances.column.value))  # 5 - 100 / 100
    (102, 4, 0)
    """
    height, width = shape
    left = 1 - (1 - remaining) ** 2 - remaining / height - remaining / width
    pixel = (total.value - rows.value - columns.value) / left
    return LineVariances(
        Uncertain(rows.value / remaining - pixel / width, rows.error / remaining),
        Uncertain(columns.value / remaining - pixel / height, columns.error / remaining),
        Uncertain(pixel, total.error / left),
    )


def hot_pixels(mean: Floats) -> Mask:
    """Pixels of a dark mean frame (H, W) that lie far from the others of their site in a mosaic.

    >>> mean = np.random.default_rng(0).normal(10.0, 0.1, (20, 20))
    >>> mean[3, 4] = 50.0
    >>> np.argwhere(hot_pixels(mean)).tolist()
    [[3, 4]]
    """
    hot = np.zeros(mean.shape, bool)
    for site in _SITES:
        # one step of the converter is no outlier, however little the others vary
        hot[site] = outlying(mean[site] - np.median(mean[site]), 1.0)
    return hot


def outlying(values: Floats, least: float = 0.0) -> Mask:
    """Values, of mean 0, beyond ``_OUTLYING`` deviations (estimated by the median) and beyond ``least``.

    >>> outlying(np.array([-1.0, 1.0, -1.0, 1.0, 20.0])).tolist()
    [False, False, False, False, True]
    """
    # 1 / Phi^-1(3/4): of a normal distribution the median of magnitudes times this is the deviation.
    deviation = 1.4826 * float(np.median(np.abs(values)))
    return np.asarray(np.abs(values) > max(_OUTLYING * deviation, least))


def without_shading(mean: Floats) -> Floats:
    """``mean`` (H, W) minus its smooth part, without the border."""
    return (mean - smooth(mean, np.zeros(mean.shape, bool)))[_INNER]


def smooth(mean: Floats, left_out: Mask) -> Floats:
    """Mean of the 7 x 7 pixels of the same site around each pixel of ``mean`` (H, W), without those left out.

    >>> float(smooth(np.full((16, 16), 7.0), np.zeros((16, 16), bool)).mean())
    7.0
    """
    smoothed = np.empty_like(mean)
    for site in _SITES:
        used, level = (~left_out[site]).astype(np.float64), np.median(mean[site])
        total, share = (
            uniform_filter(values, SMOOTH_PX, mode="reflect")
            for values in (used * (mean[site] - level), used)
        )
        smoothed[site] = level + total / np.maximum(share, 0.5 / SMOOTH_PX**2)
    return smoothed


def _centred(values: Floats) -> Floats:
    """``values`` (H, W) minus the median of each site of a mosaic."""
    centred = values.copy()
    for site in _SITES:
        centred[site] -= np.median(values[site])
    return centred
