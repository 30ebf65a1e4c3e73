"""Levels, statistics of the frames of one exposure and one light, and the fixed patterns of their means; DN.

The temporal variance is that of each pixel over the frames, averaged over the pixels: fixed patterns and shading
leave it alone. Before it is formed the frames of a level are brought to the first one's light, so that a lamp that
drifts does not count as noise.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter
from scipy.stats import chi2

from blurnoise_eval.calibration.frames import Floats, Frame, Kind, Plane

_SMOOTH_PX = 7  # the mean of this square is taken off for PRNU, as in EMVA 1288 release 4
_PLACES = tuple((slice(row, None, 2), slice(column, None, 2)) for row in (0, 1) for column in (0, 1))
_INNER = (slice(_SMOOTH_PX - 1, 1 - _SMOOTH_PX),) * 2  # what has whole squares of its place around it
_OUTLYING = 6.0  # deviations: of a normal pattern one pixel in 5 10^8 is


@dataclass(frozen=True, eq=False)
class Level:
    """Statistics of the frames of one exposure and light; ``*_error`` are standard deviations.

    pixels: of a frame. means_dn: of each frame, in the order taken. lamp_spread: largest less least of the frames'
    means, over the signal (0 in the dark). row_share: part of the temporal variance that whole rows have
    in common. correlation: of the temporal noise of neighbours, along rows or columns, whichever is more. counts
    (65536,): how many pixels hold each number.
    """

    kind: Kind
    exposure_s: float
    photons_per_px: float | None
    frames: int
    pixels: int
    mean_dn: float
    mean_error_dn: float
    variance_dn2: float
    variance_error_dn2: float
    means_dn: tuple[float, ...]
    lamp_spread: float
    row_share: float
    correlation: float
    counts: NDArray[np.int64]
    gain_db: float = 0.0
    illuminance_lux: float | None = None
    wavelength_nm: float | None = None
    temperature_c: float | None = None

    def __str__(self) -> str:
        """As messages name it."""
        parts = [
            f"{value:g} {unit}"
            for value, unit in (
                (self.photons_per_px, "photons/px"),
                (self.illuminance_lux, "lx"),
                (self.wavelength_nm, "nm"),
                (self.gain_db or None, "dB"),
            )
            if value is not None
        ]
        return ", ".join([f"{self.kind} {self.exposure_s * 1e3:g} ms", *parts])

    @property
    def drift_dn(self) -> float:
        """Mean of the last frame less that of the first."""
        return self.means_dn[-1] - self.means_dn[0]

    @property
    def highest_dn(self) -> int:
        """The largest number that a pixel holds."""
        return int(np.flatnonzero(self.counts)[-1])

    def share(self, dn: int) -> float:
        """Of the pixels that hold this number."""
        return float(self.counts[dn] / self.counts.sum()) if dn >= 0 else 0.0


def level_of(planes: Iterable[Plane], first: Frame, dark_dn: float = 0.0) -> tuple[Level, Floats]:
    """The level of ``planes`` (two or more, (H, W), of one size), taken as ``first`` was, and their mean (H, W).

    dark_dn: mean in the dark, above which the lamp is brought to the first frame's. The variance of n frames and P
    pixels has the error of the mean of P variances, which holds for any distribution and grows by shading alone.
    """
    lit = first.kind == "flat"
    counts = np.zeros(1 << 16, np.int64)
    means: list[float] = []
    for plane in planes:
        counts += np.bincount(plane.ravel(), minlength=1 << 16)
        values = plane.astype(np.float64)
        means.append(float(values.mean()))
        if len(means) == 1:
            start, total, squares = values, np.zeros_like(values), np.zeros_like(values)
            continue
        light, reference = means[-1] - dark_dn, means[0] - dark_dn
        if lit and light > 0 and reference > 0:
            values = dark_dn + (values - dark_dn) * (reference / light)
        else:
            values += means[0] - means[-1]
        values -= start
        total += values
        squares += values * values
        if len(means) == 2:
            pair = values
    frames, pixels = len(means), start.size
    each = (squares - total * total / frames) / (frames - 1)
    signals = np.array(means) - dark_dn
    if lit and (signals > 0).all():  # shot noise of the first one's light, to that of the mean
        each *= signals.mean() / (signals[0] ** 2 * (1 / signals).mean())
    variance, signal = float(each.mean()) * pixels / (pixels - 1), float(signals.mean())
    rows = float(pair.mean(1).var(ddof=1)) / 2 - variance / start.shape[1]
    power = float((pair * pair).mean())
    neighbours = max(float((pair[:, 1:] * pair[:, :-1]).mean()), float((pair[1:] * pair[:-1]).mean()))
    level = Level(
        kind=first.kind,
        exposure_s=first.exposure_s,
        photons_per_px=first.photons_per_px,
        frames=frames,
        pixels=pixels,
        mean_dn=float(np.mean(means)),
        mean_error_dn=math.sqrt(variance / (frames * pixels)),
        variance_dn2=variance,
        variance_error_dn2=float(each.std()) / math.sqrt(pixels),
        means_dn=tuple(means),
        lamp_spread=(max(means) - min(means)) / signal if lit and signal > 0 else 0.0,
        row_share=rows / variance if variance else 0.0,
        correlation=neighbours / power if power else 0.0,
        counts=counts,
        gain_db=first.gain_db,
        illuminance_lux=first.illuminance_lux,
        wavelength_nm=first.wavelength_nm,
        temperature_c=first.temperature_c,
    )
    return level, start + total / frames


def columns(levels: Sequence[Level], *names: str) -> list[Floats]:
    """An array (N,) of each field over N levels."""
    return [np.array([getattr(level, name) for level in levels], float) for name in names]


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


def frame_scatter(levels: Sequence[Level]) -> float:
    """By how much the means of frames of one level scatter, DN rms, pooled over the levels."""
    freedom = sum(level.frames - 1 for level in levels)
    return math.sqrt(
        sum((level.frames - 1) * float(np.var(level.means_dn, ddof=1)) for level in levels) / freedom
    )


def black_wander(dark: Sequence[Level]) -> float:
    """By how much the black level differs from frame to frame, DN rms, beyond noise; 0 where it may be chance."""
    freedom = sum(level.frames - 1 for level in dark)
    scatter, noise = (
        frame_scatter(dark) ** 2,
        float(np.mean([level.variance_dn2 / level.pixels for level in dark])),
    )
    return math.sqrt(scatter - noise) if scatter * freedom > chi2.ppf(0.999, freedom) * noise else 0.0


def with_wander(dark: Sequence[Level]) -> list[Level]:
    """The dark levels, the errors of whose means hold that the black level wanders."""
    wander = black_wander(dark)
    return [
        replace(level, mean_error_dn=math.hypot(level.mean_error_dn, wander / math.sqrt(level.frames)))
        for level in dark
    ]


def hot_pixels(mean: Floats) -> NDArray[np.bool_]:
    """Which pixels of ``mean`` (H, W), of dark levels, lie far from the others of their place in a mosaic."""
    hot = np.zeros(mean.shape, bool)
    for place in _PLACES:
        # a mean of whole numbers that is one off may not lie out
        hot[place] = outlying(mean[place] - np.median(mean[place]), 1.0)
    return hot


def dark_pattern(mean: Floats, levels: Sequence[Level]) -> Pattern:
    """Of ``mean`` (H, W), the mean of the dark levels' mean frames: each of the four planes of a mosaic apart."""
    hot = hot_pixels(mean)
    planes = [(mean[place] - np.median(mean[place])).ravel() for place in _PLACES]
    inside = [mean[place][~hot[place]] for place in _PLACES]
    inside = [values - values.mean() for values in inside]
    return _pattern(np.concatenate(planes), np.concatenate(inside), noise_of_mean(levels), means=4)


def response_pattern(mean: Floats, noise_dn2: float, hot: NDArray[np.bool_]) -> Pattern:
    """Of ``mean`` (H, W), flat frames' less dark ones': each plane of a mosaic without its smooth part.

    The mean of 7 x 7 pixels is taken off, which takes 1/49 of the variance of a pattern without structure; ``hot``
    (H, W) and outlying pixels are in neither.
    """
    left_out = hot.copy()
    left_out[_INNER] |= outlying(without_shading(mean, left_out), 1.0)
    values = without_shading(mean, left_out)
    inside = values[~(left_out[_INNER] | outlying(values, 1.0))]
    return _pattern(values.ravel(), inside, noise_dn2, kept=1 - 1 / _SMOOTH_PX**2)


def _pattern(every: Floats, inside: Floats, noise_dn2: float, means: int = 0, kept: float = 1.0) -> Pattern:
    """inside: values about 0 without outliers, less ``means`` means. kept: share of the variance that they have."""
    squares, freedom = inside**2 / kept, inside.size - means
    variance = float(squares.sum()) / freedom
    return Pattern(
        variance_dn2=variance,
        fixed_dn2=variance - noise_dn2,
        error_dn2=float(squares.std()) / math.sqrt(freedom),
        pixels=every.size,
        outliers=every.size - inside.size,
        outlying_dn2=max(0.0, float((every**2).mean()) / kept - variance),
    )


def without_shading(mean: Floats, left_out: NDArray[np.bool_] | None = None) -> Floats:
    """``mean`` (H, W) without its rim, less the mean of the 7 x 7 around each pixel of its place in a mosaic.

    left_out (H, W): pixels that those means do without.
    """
    rest = np.empty_like(mean)
    for place in _PLACES:
        plane = mean[place]
        if left_out is None:
            smooth = uniform_filter(plane, _SMOOTH_PX, mode="reflect")
        else:
            counted = (~left_out[place]).astype(np.float64)
            share = uniform_filter(counted, _SMOOTH_PX, mode="reflect")
            level = np.median(plane)
            smooth = uniform_filter((plane - level) * counted, _SMOOTH_PX, mode="reflect")
            smooth = level + smooth / np.maximum(share, 0.5 / _SMOOTH_PX**2)
        rest[place] = plane - smooth
    return rest[_INNER]


def outlying(values: Floats, least: float = 0.0) -> NDArray[np.bool_]:
    """Which values about 0 lie beyond ``_OUTLYING`` deviations, by their median, and beyond ``least``."""
    deviation = 1.4826 * float(np.median(np.abs(values)))
    return np.asarray(np.abs(values) > max(_OUTLYING * deviation, least))


def noise_of_mean(levels: Sequence[Level]) -> float:
    """Temporal variance of the mean of the levels' mean frames."""
    return sum(level.variance_dn2 / level.frames for level in levels) / len(levels) ** 2
