"""Measures of the frames of one level, real and simulated: values, the interval of their difference, a verdict.

Domain: stacks of frames (N, H, W), DN. Noise in time is that of differences of two frames over the root of 2, the
pattern that of the mean frame less its smooth light. Each measure is a function of sums over parts of the picture
(blocks, or bands of whole rows or columns), and the interval comes from leaving out one part at a time (jackknife).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from blurnoise_eval.system.tables import finite

Floats = NDArray[np.float64]
AGREES, DIFFERS, CANNOT_TELL = "agrees", "differs", "cannot tell"
SIGNIFICANT = 0.05  # chance that any of all measures differs though none does
_BLOCK_PX = 64  # of which 32 or less in small pictures, two or more along each side
_BANDS = 16
_OCTAVES = (0.5, 0.25, 0.125, 0.0625, 0.03125)  # cycles/px
_WIDEST = {"relative": 0.5, "absolute": 0.1, "kurtosis": 0.5}
"""Half of an interval, from which on it says nothing."""
_ORDER = 5  # of the surface that the light of a flat frame follows


class Stack:
    """The frames of a level: noise in time (N // 2, H, W), and the pattern (H, W), each about 0.

    surface: light over the picture, the mean of which is ``mean_dn``.
    """

    def __init__(self, frames: Floats) -> None:
        pairs = frames[: len(frames) // 2 * 2]
        noise = (pairs[0::2] - pairs[1::2]) / math.sqrt(2)
        self.noise = noise - noise.mean((1, 2), keepdims=True)
        mean = frames.mean(0)
        self.mean, self.mean_dn, self.frame_means = mean, float(mean.mean()), frames.mean((1, 2))

    @cached_property
    def surface(self) -> Floats:
        """A smooth surface for each of the four sites of a mosaic, fitted to the mean frame."""
        surface = np.empty_like(self.mean)
        for site in ((row, column) for row in (0, 1) for column in (0, 1)):
            part = self.mean[site[0] :: 2, site[1] :: 2]
            down, across = (np.linspace(-1, 1, side) for side in part.shape)
            terms = [(i, j) for i in range(_ORDER + 1) for j in range(_ORDER + 1 - i)]
            columns = [np.polynomial.legendre.legval(down, np.eye(_ORDER + 1)[i]) for i, _ in terms]
            rows = [np.polynomial.legendre.legval(across, np.eye(_ORDER + 1)[j]) for _, j in terms]
            powers = np.einsum("ay,by->ab", columns, columns) * np.einsum("ax,bx->ab", rows, rows)
            wanted = np.einsum("ay,yx,ax->a", columns, part, rows, optimize=True)
            found = np.linalg.solve(powers, wanted)
            surface[site[0] :: 2, site[1] :: 2] = np.einsum(
                "a,ay,ax->yx", found, columns, rows, optimize=True
            )
        return np.asarray(surface)

    @cached_property
    def pattern(self) -> Floats:
        """The mean frame less its smooth light."""
        return np.asarray(self.mean - self.surface)


def _blocks(planes: Floats) -> Floats:
    """Squares (N, G, side, side) of planes (N, H, W)."""
    height, width = planes.shape[1:]
    least = min(height, width)
    side = min(_BLOCK_PX // 2, 1 << ((least // 2).bit_length() - 1))
    if least >= 4 * _BLOCK_PX:
        side = _BLOCK_PX
    down, across = height // side, width // side
    cut = planes[:, : down * side, : across * side].reshape(-1, down, side, across, side)
    return np.asarray(cut.swapaxes(2, 3).reshape(len(planes), down * across, side, side))


def _level(stack: Stack) -> Floats:
    return np.asarray(_blocks(stack.mean[None]).mean((0, 2, 3))[:, None])


def _moments(stack: Stack) -> Floats:
    """Per block: mean square, mean fourth power, and mean product of neighbours along rows and along columns."""
    noise = _blocks(stack.noise)
    squares = noise * noise
    along, across = noise[..., 1:] * noise[..., :-1], noise[..., 1:, :] * noise[..., :-1, :]
    means = (squares, squares * squares, along, across)
    return np.stack([each.mean((0, 2, 3)) for each in means], 1)


def _bands(planes: Floats) -> Floats:
    """Per band of rows: squared means of rows, times the pixels of a row, and mean squares; (bands, 2).

    Without the means of columns, which every band has alike.
    """
    planes = planes - planes.mean(1, keepdims=True)
    over_white = (planes.mean(2) ** 2 * planes.shape[2]).mean(0)
    squares = (planes * planes).mean((0, 2))
    count = max(4, min(_BANDS, len(squares) // 4))
    return np.stack(
        [[part.mean() for part in np.array_split(each, count)] for each in (over_white, squares)], 1
    )


def _octaves(planes: Floats) -> Floats:
    """Per block: mean power, DN^2, in each octave of frequency, 0 where the block is too small to hold it.

    Without the means of whole rows and columns (``_bands`` has these): blocks beside each other share them, so
    leaving out blocks would not show how uncertain their power is.
    """
    planes = planes - planes.mean(1, keepdims=True) - planes.mean(2, keepdims=True)
    blocks = _blocks(planes)
    side = blocks.shape[-1]
    window = np.hanning(side + 1)[:-1]
    window = np.outer(window, window)
    blocks = blocks - (blocks * window).sum((2, 3), keepdims=True) / window.sum()
    power = np.abs(np.fft.rfft2(blocks * window)) ** 2 / (window**2).sum()
    frequency = np.hypot(np.fft.fftfreq(side)[:, None], np.fft.rfftfreq(side))
    inside = [(frequency <= top) & (frequency > top / 2) for top in _OCTAVES[:-1]]
    return np.stack([power[..., band].mean(0).sum(1) / max(1, np.count_nonzero(band)) for band in inside], 1)


@dataclass(frozen=True)
class Measure:
    """A number of a level. sums: of a stack, (parts, k); of: from the mean of these (..., k) to the number.

    scale: whether real and simulated are compared by their ratio or by their difference. octave: of a spectrum.
    """

    name: str
    title: str
    sums: Callable[[Stack], Floats]
    of: Callable[[Floats], Floats]
    scale: Literal["relative", "absolute", "kurtosis"] = "relative"
    octave: bool = False


def _ratio(number: int, over: int = 0) -> Callable[[Floats], Floats]:
    return lambda sums: sums[..., number] / sums[..., over]


def _column(number: int) -> Callable[[Floats], Floats]:
    return lambda sums: sums[..., number]


def _noise_rows(stack: Stack) -> Floats:
    return _bands(stack.noise)


def _noise_columns(stack: Stack) -> Floats:
    return _bands(stack.noise.swapaxes(1, 2))


def _pattern_rows(stack: Stack) -> Floats:
    return _bands(stack.pattern[None])


def _pattern_columns(stack: Stack) -> Floats:
    return _bands(stack.pattern.T[None])


def _noise_octaves(stack: Stack) -> Floats:
    return _octaves(stack.noise)


def _pattern_octaves(stack: Stack) -> Floats:
    return _octaves(stack.pattern[None])


def _of_octaves(name: str, title: str, sums: Callable[[Stack], Floats]) -> list[Measure]:
    return [
        Measure(f"{name}_{low:g}", f"{title} {low:.2g}-{2 * low:.2g}", sums, _column(place), octave=True)
        for place, low in enumerate(_OCTAVES[1:])
    ]


MEASURES: tuple[Measure, ...] = (
    Measure("mean", "mean, DN", _level, _column(0)),
    Measure("variance", "variance, DN²", _moments, _column(0)),
    Measure("kurtosis", "kurtosis", _moments, lambda m: m[..., 1] / m[..., 0] ** 2, "kurtosis"),
    Measure("correlation_x", "correlation x", _moments, _ratio(2), "absolute"),
    Measure("correlation_y", "correlation y", _moments, _ratio(3), "absolute"),
    Measure("rows", "rows in time", _noise_rows, _ratio(0, 1)),
    Measure("columns", "columns in time", _noise_columns, _ratio(0, 1)),
    *_of_octaves("noise", "noise", _noise_octaves),
    Measure("pattern_rows", "rows of pattern", _pattern_rows, _ratio(0, 1)),
    Measure("pattern_columns", "columns of pattern", _pattern_columns, _ratio(0, 1)),
    *_of_octaves("pattern", "pattern", _pattern_octaves),
)
"""All that is measured of a level; a new measure is a line here."""
SCATTER = Measure("scatter", "frame means, DN", _level, _column(0))
EVERY = (*MEASURES, SCATTER)


@dataclass(frozen=True)
class Comparison:
    """One measure of one level. difference: of the real one, relative to the simulated one, or absolute.

    low, high: its 95 % interval. chance: probability of a difference as large if there were none; after
    :func:`corrected`, with the number of comparisons taken into account.
    """

    level: str
    kind: str
    measure: Measure
    real: float
    simulated: float
    difference: float
    low: float
    high: float
    chance: float

    @property
    def verdict(self) -> str:
        """One of three."""
        if not math.isfinite(self.chance):
            return CANNOT_TELL
        if self.chance < SIGNIFICANT:
            return DIFFERS
        return CANNOT_TELL if self.high - self.low > 2 * _WIDEST[self.measure.scale] else AGREES

    def row(self) -> dict[str, Any]:
        """Plain values, None for what is unknown."""
        names = ("real", "simulated", "difference", "low", "high", "chance")
        numbers = {name: finite(getattr(self, name)) for name in names}
        about = {"level": self.level, "kind": self.kind, "measure": self.measure.name}
        return {**about, **numbers, "verdict": self.verdict}


@np.errstate(divide="ignore", invalid="ignore")  # frames without noise
def compare(
    level: str, kind: str, real: Stack, simulated: Stack, errors: dict[str, float] | None = None
) -> list[Comparison]:
    """Every measure of a level. errors: standard errors, beside those that the parts of the picture show, of the
    measures' differences, on their scales."""
    found = []
    for measure in MEASURES:
        sums = [measure.sums(stack) for stack in (real, simulated)]
        count = len(sums[0])
        without = [(each.sum(0) - each) / (count - 1) for each in sums]
        (one, other), parts = (
            [measure.of(x) for x in each] for each in (([s.mean(0) for s in sums]), without)
        )
        known = measure.scale != "relative" or (min(one, other) > 0 and min(map(np.min, parts)) > 0)
        if not known:
            unknown = [math.nan] * 4
            found.append(Comparison(level, kind, measure, float(one), float(other), *unknown))
            continue
        relative = measure.scale == "relative"
        apart = math.log(one / other) if relative else float(one - other)
        each = np.log(parts[0] / parts[1]) if relative else parts[0] - parts[1]
        error = math.sqrt((count - 1) / count * float(((each - each.mean()) ** 2).sum()))
        error = math.hypot(error, (errors or {}).get(measure.name, 0.0))
        half = float(stats.t.ppf(0.975, count - 1)) * error
        chance = 2 * float(stats.t.sf(abs(apart) / error, count - 1)) if error else math.nan
        low, high = apart - half, apart + half
        if relative:
            apart, low, high = math.expm1(apart), math.expm1(low), math.expm1(high)
        found.append(Comparison(level, kind, measure, float(one), float(other), apart, low, high, chance))
    return found


def compare_scatter(kind: str, real: Sequence[Stack], simulated: Sequence[Stack]) -> Comparison:
    """Standard deviation of the frames' means about that of their level, over all levels together (F test)."""
    squares, freedom = [], sum(len(stack.frame_means) - 1 for stack in real)
    for stacks in (real, simulated):
        squares.append(sum(float(((s.frame_means - s.mean_dn) ** 2).sum()) for s in stacks) / freedom)
    one, other = map(math.sqrt, squares)
    numbers = [math.nan] * 4
    if min(one, other) > 0:
        ratio = squares[0] / squares[1]
        law = stats.f(freedom, freedom)
        low, high = (math.sqrt(ratio / law.ppf(level)) - 1 for level in (0.975, 0.025))
        numbers = [one / other - 1, low, high, 2 * min(float(law.sf(ratio)), float(law.cdf(ratio)))]
    return Comparison(f"all {kind}", kind, SCATTER, one, other, *numbers)


def corrected(found: Sequence[Comparison]) -> list[Comparison]:
    """The comparisons with their chances for all of them together (Holm): none differs by accident in 95 of 100."""
    known = sorted((x.chance, place) for place, x in enumerate(found) if math.isfinite(x.chance))
    adjusted, highest = list(found), 0.0
    for passed, (chance, place) in enumerate(known):
        highest = max(highest, min(1.0, chance * (len(known) - passed)))
        adjusted[place] = replace(found[place], chance=highest)
    return adjusted
