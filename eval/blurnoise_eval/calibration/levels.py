"""Levels: statistics of the frames of one exposure and one light, DN.

The temporal variance is the variance of each pixel over the frames, averaged over the pixels, so that fixed patterns
and shading do not count. Before that, all frames of a level are scaled to the light of the first one, so that a lamp
that drifts does not count as noise.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from operator import attrgetter

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.calibration.counts import step_of
from blurnoise_eval.calibration.frames import Floats, Plane
from blurnoise_eval.calibration.listing import FrameFile

_FINE = 0.4  # of a step: noise above which rounding adds a known variance


@dataclass(frozen=True, eq=False)
class Level:
    """Statistics of the frames of one exposure and light; ``*_error`` are standard deviations.

    taken: how its first frame was taken. pixels: of a frame. means_dn: of each frame, in order. lamp_spread: range
    of the means of the frames, relative to the signal (0 in the dark). row_share, column_share: shares of the
    temporal variance that whole rows and whole columns have in common. row_peak: share of the power of the row
    means in their three strongest frequencies; small where rows are independent. correlation: of the temporal noise
    of neighbours, along rows or columns, whichever is larger. counts (65536,): number of pixels with each digital
    number. step_dn: how far numbers are apart, as a table or a digital gain stores them; 1 else. The variance is
    without what rounding to them adds to that of a converter.

    >>> from pathlib import Path
    >>> taken = FrameFile(file=Path("dark.npy"), kind="dark", exposure_s=0.01)
    >>> planes = [np.full((2, 2), 10, np.uint16), np.full((2, 2), 12, np.uint16)]
    >>> level, _ = level_of(planes, taken)
    >>> level.drift_dn, level.highest_dn, level.share(10)
    (2.0, 12, 0.5)
    """

    taken: FrameFile
    frames: int
    pixels: int
    mean_dn: float
    mean_error_dn: float
    variance_dn2: float
    variance_error_dn2: float
    means_dn: tuple[float, ...]
    lamp_spread: float
    row_share: float
    column_share: float
    correlation: float
    row_peak: float
    counts: NDArray[np.int64]
    step_dn: float = 1.0

    def __str__(self) -> str:
        """The name of the level in messages."""
        return self.taken.level_name

    @property
    def exposure_s(self) -> float:
        """Exposure time."""
        return self.taken.exposure_s

    @property
    def coarse(self) -> bool:
        """Whether numbers are so far apart that nobody knows what their rounding adds to the variance.

        With a noise of 0.4 steps it adds step^2/12 within 4 e^(-2 pi^2 0.4^2) of the noise's variance.
        """
        return self.step_dn > 1 and self.variance_dn2 - 1 / 12 < (_FINE * self.step_dn) ** 2

    @property
    def drift_dn(self) -> float:
        """Mean of the last frame minus that of the first."""
        return self.means_dn[-1] - self.means_dn[0]

    @property
    def highest_dn(self) -> int:
        """The largest digital number of the pixels."""
        return int(np.flatnonzero(self.counts)[-1])

    def share(self, dn: int) -> float:
        """Share of the pixels with this digital number."""
        return float(self.counts[dn] / self.counts.sum()) if dn >= 0 else 0.0


def level_of(planes: Iterable[Plane], taken: FrameFile, dark_dn: float = 0.0) -> tuple[Level, Floats]:
    """The level of ``planes`` (two or more, (H, W), of one size), and their mean frame (H, W).

    dark_dn: mean in the dark, above which frames are scaled to the light of the first. The error of the variance is
    that of a mean of the variances of all pixels, which holds for any distribution; shading makes it larger.

    >>> from pathlib import Path
    >>> taken = FrameFile(file=Path("dark.npy"), kind="dark", exposure_s=0.01)
    >>> planes = [np.array([[9, 11], [11, 9]], np.uint16), np.array([[11, 9], [9, 11]], np.uint16)]
    >>> level, mean = level_of(planes, taken)
    >>> str(level), level.mean_dn, round(level.variance_dn2, 3), mean.tolist()
    ('dark 10 ms', 10.0, 2.667, [[10.0, 10.0], [10.0, 10.0]])
    """
    lit = taken.kind == "flat"
    counts = np.zeros(1 << 16, np.int64)
    means: list[float] = []
    for plane in planes:
        counts += np.bincount(plane.ravel(), minlength=1 << 16)
        values = plane.astype(np.float64)
        means.append(float(values.mean()))
        if len(means) == 1:
            first, total, squares = values, np.zeros_like(values), np.zeros_like(values)
            continue
        light, reference = means[-1] - dark_dn, means[0] - dark_dn
        if lit and light > 0 and reference > 0:
            values = dark_dn + (values - dark_dn) * (reference / light)
        else:
            values += means[0] - means[-1]
        # The fixed pattern cancels with it, too, which leaves temporal noise alone.
        values -= first  # differences keep the precision of the sums
        total += values
        squares += values * values
        if len(means) == 2:
            pair = values
    frames, pixels = len(means), first.size
    variances = (squares - total * total / frames) / (frames - 1)
    signals = np.array(means) - dark_dn
    if lit and (signals > 0).all():  # from the shot noise of the first frame's light to that of the mean
        variances *= signals.mean() / (signals[0] ** 2 * (1 / signals).mean())
    variance, signal = float(variances.mean()) * pixels / (pixels - 1), float(signals.mean())
    step_dn = step_of(counts)
    variance = max(variance - (step_dn**2 - 1) / 12, min(variance, 1 / 12))
    rows, lines = (float(pair.mean(axis).var(ddof=1)) / 2 - variance / first.shape[axis] for axis in (1, 0))
    spectrum = np.sort(np.abs(np.fft.rfft(pair.mean(1) - pair.mean())) ** 2)
    power = float((pair * pair).mean())
    neighbours = max(float((pair[:, 1:] * pair[:, :-1]).mean()), float((pair[1:] * pair[:-1]).mean()))
    level = Level(
        taken=taken,
        frames=frames,
        pixels=pixels,
        mean_dn=float(np.mean(means)),
        mean_error_dn=math.sqrt(variance / (frames * pixels)),
        variance_dn2=variance,
        variance_error_dn2=float(variances.std()) / math.sqrt(pixels),
        means_dn=tuple(means),
        lamp_spread=(max(means) - min(means)) / signal if lit and signal > 0 else 0.0,
        row_share=rows / variance if variance else 0.0,
        column_share=lines / variance if variance else 0.0,
        correlation=neighbours / power if power else 0.0,
        row_peak=float(spectrum[-3:].sum() / max(spectrum.sum(), 1e-300)),
        counts=counts,
        step_dn=step_dn,
    )
    return level, first + total / frames


def columns(levels: Sequence[Level], *names: str) -> list[Floats]:
    """An array (N,) of each field over N levels; names: such as "mean_dn", "taken.photons_per_px".

    >>> from pathlib import Path
    >>> taken = FrameFile(file=Path("dark.npy"), kind="dark", exposure_s=0.01)
    >>> level, _ = level_of([np.full((2, 2), 10, np.uint16)] * 2, taken)
    >>> [column.tolist() for column in columns([level], "exposure_s", "mean_dn")]
    [[0.01], [10.0]]
    """
    return [np.array([*map(attrgetter(name), levels)], float) for name in names]


def frame_scatter(levels: Sequence[Level]) -> float:
    """Standard deviation of the means of frames within their levels, DN.

    >>> from pathlib import Path
    >>> taken = FrameFile(file=Path("dark.npy"), kind="dark", exposure_s=0.01)
    >>> level, _ = level_of([np.full((2, 2), 10, np.uint16), np.full((2, 2), 12, np.uint16)], taken)
    >>> round(frame_scatter([level]), 3)  # of 10 and 12: the root of 2
    1.414
    """
    squares = sum(level.frames * float(np.var(level.means_dn)) for level in levels)
    return math.sqrt(squares / sum(level.frames - 1 for level in levels))


def noise_of_mean(levels: Sequence[Level]) -> float:
    """Temporal variance of the mean of the mean frames of the levels."""
    return sum(level.variance_dn2 / level.frames for level in levels) / len(levels) ** 2
