"""Temporal noise of pixels, rows, columns and whole frames, and the mean frames of one kind and gain."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from scipy.stats import chi2

from blurnoise.metrics.values import Estimate
from blurnoise_eval.calibration.frames import Floats, Plane
from blurnoise_eval.calibration.levels import Level
from blurnoise_eval.calibration.patterns import Halves, LineVariances, separate
from blurnoise_eval.calibration.uncertain import Uncertain


class FrameMeans:
    """Means of all frames of one kind and gain: of every other frame, and of the rows and columns of each frame.

    lines: of each level the means of the rows (L, H) and columns (L, W) of its frames. parity: of each level half the
    differences of the means of even and odd columns in the rows (L, H).
    """

    def __init__(self) -> None:
        self.lines: list[tuple[Floats, Floats]] = []
        self.parity: list[Floats] = []
        self._sums: list[Floats] = [np.zeros(()), np.zeros(())]
        self._counts = [0, 0]

    def add(self, planes: Iterable[Plane]) -> Iterator[Plane]:
        """Pass on the frames of a level, one after the other, and add them to the means."""
        rows, columns, parity = [], [], []
        for plane in planes:
            half = self._counts[0] > self._counts[1]
            self._sums[half] = self._sums[half] + plane
            self._counts[half] += 1
            rows.append(plane.mean(1))
            columns.append(plane.mean(0))
            parity.append((plane[:, ::2].mean(1) - plane[:, 1::2].mean(1)) / 2)
            yield plane
        self.lines.append((np.array(rows), np.array(columns)))
        self.parity.append(np.array(parity))

    @property
    def halves(self) -> Halves:
        """Mean of every other frame, and of the frames in between."""
        one, other = (total / count for total, count in zip(self._sums, self._counts, strict=True))
        return one, other

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width of a frame."""
        rows, columns = self.lines[0]
        return rows.shape[1], columns.shape[1]

    def noise(self, levels: Sequence[Level]) -> LineVariances:
        """Temporal variances of pixels, rows and columns, pooled over these levels, all that were added."""
        freedom = sum(len(rows) - 1 for rows, _ in self.lines)
        total = sum(level.variance_dn2 * (level.frames - 1) for level in levels) / freedom
        lines: list[Uncertain] = []
        for axis, size in enumerate(self.shape):
            degrees = freedom * (size - 1)
            square = sum(_squares(level[axis]) for level in self.lines) / degrees
            lines.append(Uncertain(square, square * math.sqrt(2 / degrees)))
        return separate(lines[0], lines[1], Uncertain(total, 0.0), self.shape)

    def parity_noise(self, noise: LineVariances) -> Uncertain:
        """Temporal variance of offsets of even and odd columns in a row, beyond the ``noise`` of pixels."""
        height, width = self.shape
        degrees = (height - 1) * sum(len(rows) - 1 for rows in self.parity)
        square = sum(_squares(rows) for rows in self.parity) / degrees
        of_pixels = (
            noise.pixel.value * (1 / ((width + 1) // 2) + 1 / (width // 2)) / 4 if width > 1 else square
        )
        return Uncertain(square - of_pixels, square * math.sqrt(2 / degrees))

    def drift(self, levels: Sequence[Level], noise: LineVariances) -> tuple[Estimate, float]:
        """RMS offset of whole frames beyond the noise of pixels, rows and columns; and the variance of frame means.

        Deviations are from a straight line over the exposure, because dark current raises the means.
        """
        means = np.concatenate([level.means_dn for level in levels])
        exposure_s = np.repeat([level.exposure_s for level in levels], [level.frames for level in levels])
        design = np.stack([np.ones(len(means)), exposure_s], 1)[:, : len(np.unique(exposure_s))]
        line, *_ = np.linalg.lstsq(design, means)
        freedom = len(means) - design.shape[1]
        variance = float(((means - design @ line) ** 2).sum()) / freedom
        expected = noise.of_mean(self.shape)
        quantiles = chi2.ppf([0.975, 0.025], freedom) / freedom
        low, high = (math.sqrt(max(0.0, variance / quantile - expected)) for quantile in quantiles)
        value = math.sqrt(max(0.0, variance - expected)) if low else 0.0
        return Estimate(value, low, high), variance


def _squares(means: Floats) -> float:
    """Sum of squares of means (frames, lines), without the mean of each frame and of each line."""
    rest = means - means.mean(0) - means.mean(1, keepdims=True) + means.mean()
    return float((rest * rest).sum())
