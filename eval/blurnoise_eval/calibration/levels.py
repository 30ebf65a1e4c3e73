"""Levels, statistics of the frames of one exposure and one light, and the fixed patterns of their means; DN.

The temporal variance is that of each pixel over the frames, averaged over the pixels: fixed patterns and shading
leave it alone. Before it is formed the frames of a level are brought to the first one's light, so that a lamp that
drifts does not count as noise.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

from blurnoise_eval.calibration.frames import Floats, Frame, Kind, Plane

_SMOOTH_PX = 7  # the mean of this square is taken off for PRNU, as in EMVA 1288 release 4
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


def dark_pattern(mean: Floats, levels: Sequence[Level]) -> Pattern:
    """Of ``mean`` (H, W), the mean of the dark levels' mean frames: each of the four planes of a mosaic apart."""
    planes = [(plane - np.median(plane)).ravel() for plane in _planes(mean)]
    # a mean of whole numbers that is one off may not lie out
    inside = [values[~outlying(values, 1.0)] for values in planes]
    inside = [values - values.mean() for values in inside]
    return _pattern(np.concatenate(planes), np.concatenate(inside), noise_of_mean(levels), means=4)


def response_pattern(mean: Floats, noise_dn2: float) -> Pattern:
    """Of ``mean`` (H, W), flat frames' less dark ones': each plane of a mosaic without its smooth part.

    The mean of 7 x 7 pixels is taken off, which takes 1/49 of the variance of a pattern without structure.
    """
    values = without_shading(mean)
    return _pattern(values, values[~outlying(values, 1.0)], noise_dn2, kept=1 - 1 / _SMOOTH_PX**2)


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


def without_shading(mean: Floats) -> Floats:
    """The values (N,) of the four planes of ``mean`` (H, W), less the mean of the 7 x 7 around each."""
    inner = slice(_SMOOTH_PX // 2, -(_SMOOTH_PX // 2))
    smooth = [plane - uniform_filter(plane, _SMOOTH_PX, mode="reflect") for plane in _planes(mean)]
    return np.concatenate([plane[inner, inner].ravel() for plane in smooth])


def outlying(values: Floats, least: float = 0.0) -> NDArray[np.bool_]:
    """Which values about 0 lie beyond ``_OUTLYING`` deviations, by their median, and beyond ``least``."""
    deviation = 1.4826 * float(np.median(np.abs(values)))
    return np.asarray(np.abs(values) > max(_OUTLYING * deviation, least))


def noise_of_mean(levels: Sequence[Level]) -> float:
    """Temporal variance of the mean of the levels' mean frames."""
    return sum(level.variance_dn2 / level.frames for level in levels) / len(levels) ** 2


def _planes(mean: Floats) -> list[Floats]:
    return [mean[row::2, column::2] for row in (0, 1) for column in (0, 1)]
