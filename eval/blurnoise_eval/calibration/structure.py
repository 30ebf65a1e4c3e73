"""Rows, columns and pixels: what noise in time and fixed patterns have in common along each.

EMVA 1288 release 4: where rows, columns and pixels of a frame of H x W vary independently with the variances r, c
and p, the means of its rows vary by r + p/W, those of its columns by c + p/H, and what is left by p (less the degrees
of freedom that both means took). The standard takes temporal noise off the variances of a mean frame; here every
other frame goes to one mean, the rest to another, and what both share is fixed: temporal noise of rows and columns
is in neither product, either.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from blurnoise.metrics.values import Estimate
from blurnoise_eval.calibration.frames import Floats, Plane
from blurnoise_eval.calibration.levels import SMOOTH_PX, Level, outlying, smooth

_ALIKE = (
    1.29  # sum of the squared correlations of values less the mean of 7: by it their variance is less certain
)
Z = 1.959964  # of a normal number, two-sided 95 %
Uncertain = tuple[float, float]
"""A value and its standard deviation."""
Halves = tuple[Floats, Floats]


@dataclass(frozen=True)
class Split:
    """Variances of rows, columns and pixels."""

    row: Uncertain
    column: Uncertain
    pixel: Uncertain

    @property
    def lines(self) -> Uncertain:
        """Rows and columns together; one whose interval includes 0 counts as 0."""
        sure = [(value, error) for value, error in (self.row, self.column) if value > Z * error]
        return sum(value for value, _ in sure), math.hypot(*(error for _, error in sure))


class Stack:
    """All frames of one kind and gain, by level: two means, of every other frame, and means of rows and columns.

    levels: of each level the means of its frames' rows (L, H) and columns (L, W).
    """

    def __init__(self) -> None:
        self.levels: list[tuple[Floats, Floats]] = []
        self._sums: list[Floats] = [np.zeros(()), np.zeros(())]
        self._counts = [0, 0]

    def passing(self, planes: Iterable[Plane]) -> Iterator[Plane]:
        """The frames of one level, one after the other, counted on the way."""
        rows, columns = [], []
        for plane in planes:
            half = self._counts[0] > self._counts[1]
            self._sums[half] = self._sums[half] + plane
            self._counts[half] += 1
            rows.append(plane.mean(1))
            columns.append(plane.mean(0))
            yield plane
        self.levels.append((np.array(rows), np.array(columns)))

    @property
    def halves(self) -> Halves:
        """Mean of every other frame, and of those between."""
        one, other = (total / count for total, count in zip(self._sums, self._counts, strict=True))
        return one, other

    @property
    def shape(self) -> tuple[int, int]:
        """Of a frame, (H, W)."""
        rows, columns = self.levels[0]
        return rows.shape[1], columns.shape[1]

    @property
    def freedom(self) -> int:
        """Frames less levels."""
        return sum(len(rows) - 1 for rows, _ in self.levels)

    def temporal(self, levels: Sequence[Level]) -> Split:
        """Of the noise in time of these, its levels."""
        variance_dn2 = sum(level.variance_dn2 * (level.frames - 1) for level in levels) / self.freedom
        found: list[Uncertain] = []
        for axis, size in enumerate(self.shape):
            freedom = self.freedom * (size - 1)
            square = sum(_squares(level[axis]) for level in self.levels) / freedom
            found.append((square, square * math.sqrt(2 / freedom)))
        return _split(found[0], found[1], variance_dn2, 0.0, self.shape)

    def drift(self, levels: Sequence[Level], noise: Split) -> tuple[Estimate, float]:
        """RMS of the offset of whole frames beyond what pixels, rows and columns give, and the means' variance.

        About the straight line of the means over the exposure, by which dark current shifts them.
        """
        (height, width), means = self.shape, np.concatenate([level.means_dn for level in levels])
        exposure_s = np.repeat([level.exposure_s for level in levels], [level.frames for level in levels])
        design = np.stack([np.ones(len(means)), exposure_s], 1)[:, : len(np.unique(exposure_s))]
        line, *_ = np.linalg.lstsq(design, means)
        freedom = len(means) - design.shape[1]
        variance = float(((means - design @ line) ** 2).sum()) / freedom
        every = (
            noise.pixel[0] / (height * width)
            + max(0.0, noise.row[0]) / height
            + max(0.0, noise.column[0]) / width
        )
        chances = chi2.ppf([0.975, 0.025], freedom) / freedom
        low, high = (math.sqrt(max(0.0, variance / each - every)) for each in chances)
        value = math.sqrt(max(0.0, variance - every)) if low else 0.0
        return Estimate(value, low, high), variance


def _squares(means: Floats) -> float:
    """Sum of squares of means (frames, places) less those of their frame and their place."""
    own = means - means.mean(0) - means.mean(1, keepdims=True) + means.mean()
    return float((own * own).sum())


def _split(
    rows: Uncertain, columns: Uncertain, every: float, error: float, shape: tuple[int, int], kept: float = 1.0
) -> Split:
    """By the variances of the means of rows and of columns and of all values, which have both in them.

    kept: share of the variance of rows that a filter leaves, which leaves 1 - (1 - kept)^2 of that of pixels.
    """
    height, width = shape
    left = 1 - (1 - kept) ** 2 - kept / height - kept / width
    pixel = (every - rows[0] - columns[0]) / left
    return Split(
        (rows[0] / kept - pixel / width, rows[1] / kept),
        (columns[0] / kept - pixel / height, columns[1] / kept),
        (pixel, error / left),
    )


def dark_pattern(dark: Halves) -> Split:
    """Of the offset, DN^2: what both halves share. The four planes of a mosaic vary about their own medians."""
    one, other = (half - _by_plane(half, np.median) for half in dark)
    return fixed(one, other, outlying((one + other) / 2, 1.0))


def light_pattern(light: Halves, dark: Halves, hot: NDArray[np.bool_]) -> Split:
    """Of the response, relative: what both halves of flat frames less dark ones share beside their smooth part.

    The standard leaves that in, which makes rows of a lamp's and a lens's shading. Each plane of a mosaic is taken
    relative to its own means of 7 x 7; ``hot`` pixels (H, W) are in neither.
    """
    edge = slice(SMOOTH_PX - 1, 1 - SMOOTH_PX)  # means there are of fewer
    signals = [lit - unlit for lit, unlit in zip(light, dark, strict=True)]
    means = [smooth(signal, hot) for signal in signals]
    level = sum(means) / 2
    one, other = (((a - b) / level)[edge, edge] for a, b in zip(signals, means, strict=True))
    return fixed(one, other, hot[edge, edge] | outlying((one + other) / 2), 1 - 1 / SMOOTH_PX)


def fixed(one: Floats, other: Floats, out: NDArray[np.bool_] | bool = False, kept: float = 1.0) -> Split:
    """What ``one`` and ``other`` (H, W), about 0, share; where ``out`` they do not count. kept: as of ``_split``."""
    halves = [np.where(out, 0.0, each) for each in (one, other)]
    found: list[Uncertain] = []
    for axis in (1, 0):
        means = [each.mean(axis, keepdims=True) - each.mean() for each in halves]
        halves = [each - mean for each, mean in zip(halves, means, strict=True)]
        shared = means[0] * means[1]
        error = float(shared.std()) * math.sqrt((1.0 if kept == 1 else _ALIKE) / shared.size)
        found.append((float(shared.sum()) / (shared.size - 1), error))
    rest = halves[0] * halves[1]
    every = float(rest.mean()) + found[0][0] + found[1][0]
    return _split(found[0], found[1], every, float(rest.std()) / math.sqrt(rest.size), one.shape, kept)


def _by_plane(values: Floats, mean: Callable[[Floats], Any]) -> Floats:
    """The mean, one number or an array, of each of the four planes of a mosaic, in its place (H, W)."""
    found = np.empty_like(values)
    for row, column in product((0, 1), (0, 1)):
        found[row::2, column::2] = mean(values[row::2, column::2])
    return found
