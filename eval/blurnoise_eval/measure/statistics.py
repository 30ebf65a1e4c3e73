"""Statistics of the frames of one level, with their uncertainty by leaving out parts of the picture.

Domain: frames (N, H, W), DN. Temporal noise is the difference of two frames over the root of 2, the fixed pattern is
the mean frame without its smooth light. Each statistic is a function of sums over parts of the picture (blocks, or
bands of whole rows or columns); its standard error comes from leaving out one part at a time (jackknife).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.polynomial.legendre import legvander
from numpy.typing import NDArray
from scipy import stats

from blurnoise.metrics.values import Estimate
from blurnoise_eval.measure.comparison import Measure, MeasureComparison, compared

Floats = NDArray[np.float64]
_BLOCK_PX = 64  # of which 32 or less in small pictures, two or more along each side
_BANDS = 16
_OCTAVES = (0.5, 0.25, 0.125, 0.0625)  # upper ends, cycles/px
_ORDER = 5  # of the polynomial surface that the light of a flat frame follows


class FrameStack:
    """The frames (N, H, W) of a level: temporal noise (N // 2, H, W) and fixed pattern (H, W), both of mean 0.

    surface: smooth light over the picture, the mean of which is ``mean_dn``.

    >>> frames = np.random.default_rng(0).normal(100.0, 2.0, (4, 32, 32))
    >>> stack = FrameStack(frames)
    >>> round(stack.mean_dn), round(float(stack.noise.std()))
    (100, 2)
    """

    def __init__(self, frames: Floats) -> None:
        self.frames = frames
        pairs = frames[: len(frames) // 2 * 2]
        # A difference of two frames has no fixed pattern and twice the variance.
        noise = (pairs[0::2] - pairs[1::2]) / math.sqrt(2)
        self.noise = noise - noise.mean((1, 2), keepdims=True)
        self.mean, self.frame_means = frames.mean(0), frames.mean((1, 2))
        self.mean_dn = float(self.mean.mean())

    @cached_property
    def surface(self) -> Floats:
        """A polynomial surface for each of the four sites of a mosaic, fitted to the mean frame."""
        surface = np.empty_like(self.mean)
        down, across = np.array([(i, j) for i in range(_ORDER + 1) for j in range(_ORDER + 1 - i)]).T
        for site in np.ndindex(2, 2):
            part = self.mean[site[0] :: 2, site[1] :: 2]
            y, x = (legvander(np.linspace(-1, 1, side), _ORDER) for side in part.shape)
            y, x = y[:, down], x[:, across]  # a column per term
            # the terms are products, so the normal equations need no design matrix of all pixels
            wanted = np.einsum("ya,yx,xa->a", y, part, x, optimize=True)
            factors = np.linalg.solve((y.T @ y) * (x.T @ x), wanted)
            surface[site[0] :: 2, site[1] :: 2] = (y * factors) @ x.T
        return np.asarray(surface)

    @cached_property
    def pattern(self) -> Floats:
        """The mean frame without its smooth light."""
        return np.asarray(self.mean - self.surface)


def _blocks(planes: Floats) -> Floats:
    """Squares (N, G, side, side) of planes (N, H, W)."""
    height, width = planes.shape[1:]
    least = min(height, width)
    side = min(_BLOCK_PX // 2, 1 << ((least // 2).bit_length() - 1))
    if least >= 4 * _BLOCK_PX:
        side = _BLOCK_PX
    down, across = height // side, width // side
    cropped = planes[:, : down * side, : across * side].reshape(-1, down, side, across, side)
    return np.asarray(cropped.swapaxes(2, 3).reshape(len(planes), down * across, side, side))


def _means(stack: FrameStack) -> Floats:
    """Mean of each block; (blocks, 1)."""
    return np.asarray(_blocks(stack.mean[None]).mean((0, 2, 3))[:, None])


def _moments(stack: FrameStack) -> Floats:
    """Per block: mean square, mean fourth power, mean product of neighbours along rows and along columns."""
    noise = _blocks(stack.noise)
    squares = noise * noise
    along, across = noise[..., 1:] * noise[..., :-1], noise[..., 1:, :] * noise[..., :-1, :]
    return np.stack([part.mean((0, 2, 3)) for part in (squares, squares * squares, along, across)], 1)


def _bands(planes: Floats) -> Floats:
    """Per band of rows: squared means of rows, times the pixels of a row, and mean squares; (bands, 2).

    The means of columns are removed first, because every band shares them.
    """
    planes = planes - planes.mean(1, keepdims=True)
    over_white = (planes.mean(2) ** 2 * planes.shape[2]).mean(0)
    squares = (planes * planes).mean((0, 2))
    count = max(4, min(_BANDS, len(squares) // 4))
    bands = [np.array_split(rows, count) for rows in (over_white, squares)]
    return np.stack([[band.mean() for band in of] for of in bands], 1)


def _octaves(planes: Floats) -> Floats:
    """Per block: mean power, DN^2, in each octave of frequency, 0 where the block is too small for the octave.

    The means of whole rows and columns are removed (``_bands`` measures them): neighbouring blocks share them, so
    leaving out blocks would not show how uncertain their power is.
    """
    planes = planes - planes.mean(1, keepdims=True) - planes.mean(2, keepdims=True)
    blocks = _blocks(planes)
    side = blocks.shape[-1]
    # A block is no period of its noise: without a window, power of low frequencies leaks into high ones.
    window = np.hanning(side + 1)[:-1]
    window = np.outer(window, window)
    blocks = blocks - (blocks * window).sum((2, 3), keepdims=True) / window.sum()
    power = np.abs(np.fft.rfft2(blocks * window)) ** 2 / (window**2).sum()
    frequency = np.hypot(np.fft.fftfreq(side)[:, None], np.fft.rfftfreq(side))
    bands = [(frequency <= top) & (frequency > top / 2) for top in _OCTAVES]
    return np.stack([power[..., band].mean(0).sum(1) / max(1, np.count_nonzero(band)) for band in bands], 1)


@dataclass(frozen=True)
class Statistic(Measure):
    """A measure of a level. sums: of a stack, (parts, k); of: from the mean of these (..., k) to the number.

    octave: whether it is an octave of a spectrum.
    """

    sums: Callable[[FrameStack], Floats] = _means
    of: Callable[[Floats], Floats] = lambda sums: sums[..., 0]
    octave: bool = False


def _ratio(number: int, over: int = 0) -> Callable[[Floats], Floats]:
    return lambda sums: sums[..., number] / sums[..., over]


def _spectrum(name: str, title: str, sums: Callable[[FrameStack], Floats]) -> list[Statistic]:
    def octave(index: int, top: float) -> Statistic:
        about = (f"{name}_{top / 2:g}", f"{title} {top / 2:.2g}-{top:.2g}")
        return Statistic(*about, sums=sums, of=lambda sums: sums[..., index], octave=True)

    return [octave(index, top) for index, top in enumerate(_OCTAVES)]


def _whole_lines(name: str, title: str, planes: Callable[[FrameStack], Floats]) -> Statistic:
    """Variance of the means of rows of ``planes`` (N, H, W), over that of white noise."""
    return Statistic(name, title, sums=lambda stack: _bands(planes(stack)), of=_ratio(0, 1))


MEAN = Statistic("mean", "mean, DN")
VARIANCE = Statistic("variance", "variance, DN²", tolerance=0.08, sums=_moments)
"""A variance that differs by less than 8 % (noise: 4 %) has the noise of light that differs by as much."""
STATISTICS: tuple[Statistic, ...] = (
    MEAN,
    VARIANCE,
    _whole_lines("rows", "rows in time", lambda stack: stack.noise),
    _whole_lines("columns", "columns in time", lambda stack: stack.noise.swapaxes(1, 2)),
    _whole_lines("pattern_rows", "rows of pattern", lambda stack: stack.pattern[None]),
    _whole_lines("pattern_columns", "columns of pattern", lambda stack: stack.pattern.T[None]),
    Statistic("correlation_x", "correlation x", "absolute", sums=_moments, of=_ratio(2)),
    Statistic("correlation_y", "correlation y", "absolute", sums=_moments, of=_ratio(3)),
    Statistic("kurtosis", "kurtosis", "kurtosis", sums=_moments, of=lambda m: m[..., 1] / m[..., 0] ** 2),
    *_spectrum("noise", "noise", lambda stack: _octaves(stack.noise)),
    *_spectrum("pattern", "pattern", lambda stack: _octaves(stack.pattern[None])),
)
"""All that is compared at a level of light; a new statistic is one entry."""
SCATTER = Measure("scatter", "frame means, DN")


@np.errstate(divide="ignore", invalid="ignore")  # frames without noise
def compare_levels(
    real: FrameStack,
    simulated: FrameStack,
    errors: Mapping[str, float] | None = None,
    *,
    kind: str = "",
    level: str = "",
) -> list[MeasureComparison]:
    """Every statistic of a level. errors: further standard errors of differences, by the statistic's name, that the
    parts of one picture do not show.

    >>> drawn = np.random.default_rng(0)
    >>> real, brighter = (FrameStack(drawn.normal(mean, 2.0, (4, 128, 128))) for mean in (100.0, 103.0))
    >>> compare_levels(real, brighter)[0].verdict  # of the mean
    'differs'
    """
    comparisons = []
    for statistic in STATISTICS:
        sums = [statistic.sums(stack) for stack in (real, simulated)]
        count = len(sums[0])
        without = [statistic.of((parts.sum(0) - parts) / (count - 1)) for parts in sums]  # one part each
        # of powers the logarithm, NaN where a part holds nearly all of the power
        relative = statistic.scale == "relative"
        apart = np.log(without[0] / without[1]) if relative else without[0] - without[1]
        # The jackknife's: values with one part left out differ by 1 / (count - 1) of what the parts do.
        error = math.sqrt((count - 1) / count * float(((apart - apart.mean()) ** 2).sum()))
        error = math.hypot(error, (errors or {}).get(statistic.name, 0.0))
        one, other = (float(statistic.of(parts.mean(0))) for parts in sums)
        comparison = compared(statistic, one, other, error, freedom=count - 1, kind=kind, level=level)
        comparisons.append(comparison)
    return comparisons


def compare_scatter(
    real: Sequence[FrameStack], simulated: Sequence[FrameStack], kind: str
) -> MeasureComparison:
    """Compare the standard deviation of frame means about the mean of their level, over all levels (F test).

    >>> drawn = np.random.default_rng(0)
    >>> stacks = [[FrameStack(drawn.normal(100.0, 2.0, (4, 32, 32)))] for _ in range(2)]
    >>> compare_scatter(*stacks, "dark").level
    'all dark'
    """
    freedom = sum(len(stack.frame_means) - 1 for stack in real)
    squares = [
        sum(float(((stack.frame_means - stack.mean_dn) ** 2).sum()) for stack in stacks) / freedom
        for stacks in (real, simulated)
    ]
    one, other = map(math.sqrt, squares)
    difference, p_value = Estimate(math.nan), math.nan
    if min(one, other) > 0:
        ratio, law = squares[0] / squares[1], stats.f(freedom, freedom)
        low, high = (math.sqrt(ratio / law.ppf(quantile)) - 1 for quantile in (0.975, 0.025))
        difference = Estimate(one / other - 1, low, high)
        p_value = 2 * min(float(law.sf(ratio)), float(law.cdf(ratio)))
    return MeasureComparison(SCATTER, one, other, difference, p_value, kind, f"all {kind}")
