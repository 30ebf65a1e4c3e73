"""Faults of an edge: what no lens, no motion and no pixel does to a step, and what hidden faults cost in MTF50.

A shape that no blur makes is held against its standard error, by bootstrap over rows in closed form, and against a
size that matters. Clips, tone curves and sharpening of any strength are fitted to the difference from a Gaussian
edge: one that is certain raises a flag, and what noise or blur may hide makes the interval of MTF50 longer.

Domain: splines scaled to 0 and 1, distances in px along the normal, frequencies in cycles/px.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import avg_pool1d, conv1d, pad

from blurnoise.metrics.edge.geometry import slope
from blurnoise.metrics.edge.sides import NOISELESS, Sides
from blurnoise.metrics.edge.spline import CHI_SQUARE_MEDIAN, KNOT_PX, Spline, knots_px

FALSE_ALARM = 1e-3  # of a test, whatever the number of places it looks at
OVERSHOOT = 0.008  # of the step, beyond one of its sides
NEGATIVE = 0.04  # of the light, in half a pixel, by which light before the pixels may be below 0
DIP = 0.5  # of the lower neighbour, by which the line spread may dip between two humps
DISPLACED = 0.02  # of MTF50, that displaced rows or colours may cost
UNEVEN_NOISE, UNEVEN_SMOOTH = 12.0, 2.5
"""Variance of the noise upon the edge over that of its sides: JPEG of quality 90 leaves 5 to 10."""
SMOOTH_NOISE = 7.5  # power at frequency 0, over the variance, of noise that a filter has smoothed
_MEDIAN_ERROR = 1.65  # standard error of a median of n chi squares over that of their mean, sqrt(2/n)


@dataclass(frozen=True)
class Shape:
    """An edge's sides and the spline between them, scaled to 0 and 1, with the error of anything linear in it.

    position_px: its line, (B, H). reach_px: (B,), how far the blur was taken to reach.
    """

    sides: Sides
    spline: Spline
    position_px: Tensor
    reach_px: Tensor

    @cached_property
    def _together(self) -> int:
        """Rows whose noise belongs together; at least 16 of them are kept apart."""
        return max(1, min(int(self.sides.block.max()), self.position_px.shape[1] // 16))

    @cached_property
    def covariance(self) -> Tensor:
        """Of the spline's coefficients, (B, K, K), by a bootstrap over rows."""
        return self.spline.bootstrapped(self._together)

    @cached_property
    def free(self) -> Tensor:
        """1 for coefficients that were fitted and whose mirror image was, (B, K)."""
        free = (self.spline.inverse.diagonal(dim1=1, dim2=2) > 0).to(torch.float64)
        return free * free.flip(1)

    @cached_property
    def noise(self) -> Tensor:
        """Variance of each of the spline's pixels by its light, from the sides', (n,)."""
        dark, bright = (self.sides.variance / self.sides.step[:, None] ** 2).unbind(1)
        pixels = self.spline.pixels
        share = (pixels.value - self.spline.off[0]).clamp(0, 1)
        return dark[pixels.region] + (bright - dark)[pixels.region] * share

    def error(self, functionals: Tensor) -> Tensor:
        """Standard errors (B, n) of the coefficients' sums with functionals, (K, n) or (B, K, n)."""
        return ((self.covariance @ functionals) * functionals).sum(1).clamp_min(0).sqrt()

    def certain(self, places: Tensor | int) -> Tensor:
        """:func:`certain` of the edge's rows."""
        return certain(math.ceil(self.position_px.shape[1] / self._together), places)

    def exceed(self, values: Tensor, error: Tensor, least: float) -> Tensor:
        """Whether any of ``values`` (B, n) is above ``least`` and no accident of the noise, (B,)."""
        limit = self.certain(self.free.sum(1))[:, None] * error
        return (values > limit.clamp_min(least)).any(1)


def certain(rows: int, places: Tensor | int) -> Tensor:
    """Errors by which one of ``places`` numbers, or of (B,), must be off to be no accident.

    Bonferroni, and Student's quantile with a degree of freedom per row, by Cornish and Fisher.
    """
    freedom = max(rows - 1, 4)
    tail = FALSE_ALARM / 2 / torch.as_tensor(places, dtype=torch.float64).clamp_min(1)
    z = -torch.special.ndtri(tail)
    t: Tensor = z + (z**3 + z) / (4 * freedom) + (5 * z**5 + 16 * z**3 + 3 * z) / (96 * freedom**2)
    return t


def overshoots(shape: Shape) -> Tensor:
    """Whether the edge, in the mean over a pixel, goes beyond one of its sides, (B,)."""
    knots = torch.eye(shape.spline.coefficients.shape[1], dtype=torch.float64)
    means = knots.unfold(0, round(1 / KNOT_PX), 1).mean(-1).T
    edge = shape.spline.coefficients @ means
    return shape.exceed(torch.maximum(edge - 1, -edge), shape.error(means), OVERSHOOT)


def two_humps(shape: Shape) -> Tensor:
    """Whether the line spread dips between two humps, (B,): two edges, or motion that lingers at its ends.

    It is averaged over an eighth of the reach, at least half a pixel. Humps closer to the dip than 3/4 px do not
    count: so does a filter of the picture's own pixels ring.
    """
    apart = round(0.75 / KNOT_PX)
    knots = torch.eye(shape.spline.coefficients.shape[1], dtype=torch.float64)
    found = torch.zeros(len(shape.reach_px), dtype=torch.bool)
    widths = (shape.reach_px / 8 / KNOT_PX).round().long().clamp_min(2)
    for width in set(widths.tolist()):
        rises = knots[:, width:] - knots[:, :-width]
        line, error = shape.spline.coefficients @ rises, shape.error(rises)
        left, right = line.cummax(1).values, line.flip(1).cummax(1).values.flip(1)
        hump = torch.minimum(left[:, : -2 * apart], right[:, 2 * apart :])
        places = (shape.free.sum(1) / width) ** 3  # two humps and what lies between them
        certain = shape.certain(places)[:, None] * math.sqrt(2) * error[:, apart:-apart]
        dips = hump - line[:, apart:-apart] > torch.maximum(certain, DIP * hump)
        found |= (widths == width) & (dips & (hump > 0.1 * line.amax(1, keepdim=True))).any(1)
    return found


def negative(shape: Shape) -> Tensor:
    """Whether such an edge asks for less than no light somewhere before the pixels, (B,): clipped, or sharpened.

    The edge spread is that of lens and motion, P, averaged over a pixel: E'(u) = P(u + 1/2) - P(u - 1/2). So P is a
    sum of E' at places a pixel apart, from the left or from the right, and must never fall: a line spread that
    ends sooner than a pixel takes to leave it does so. Means over adjacent halves of a pixel are compared.
    """
    coefficients = shape.spline.coefficients.float()  # enough, and twice as fast
    count = coefficients.shape[1]
    knot = torch.arange(count) - count // 2
    pixel = (1 / torch.sqrt(1 + slope(shape.position_px) ** 2)).float()[:, None, None]
    place = (torch.arange(count + 8) - count // 2 - 4)[:, None] * pixel  # knots; a pixel is 4 of them
    away = (place - knot).abs()
    spline = torch.where(away < 1, 2 / 3 - away * away * (1 - away / 2), (2 - away).clamp_min(0) ** 3 / 6)
    rises = _rises(count + 8) @ spline
    beyond = (1 - spline.sum(2)) * (place[..., 0] > 0)  # where there are no knots any more, the edge is 1
    found = (rises @ coefficients[..., None])[..., 0] + beyond @ _rises(count + 8).T
    error = ((rises @ shape.covariance.float()) * rises).sum(2).clamp_min(0).sqrt()
    return shape.exceed(-found, error, NEGATIVE)


@cache
def _rises(count: int) -> Tensor:
    """By how much P rises from a half of a pixel to the next, of an edge at quarters of a pixel, (n, count)."""
    one = torch.eye(count)
    curved = 2 * (one[4:] - 2 * one[2:-2] + one[:-4])
    place = torch.arange(len(curved))
    after = place[:, None] - place
    aligned = (after % 4 == 0).float()
    return torch.cat([(aligned * (after >= 0)) @ curved, -(aligned * (after < 0)) @ curved])


def displaced(shape: Shape, mtf50: Tensor) -> Tensor:
    """Whether rows are displaced against each other by more than noise moves them, (B,), and what it costs MTF50.

    A row's own place follows from its misfit along the edge's slope; the median over rows stands for all of them,
    for a hot pixel moves one.
    """
    (off, pull), by_row = shape.spline.off, shape.spline.pixels.by_row
    curvature = by_row(pull * pull).clamp_min(1e-12)
    place = by_row(pull * off) / curvature
    expected = by_row(pull * pull * shape.noise) / curvature**2
    ratio = (place**2 / expected.clamp_min(1e-18)).median(1).values / CHI_SQUARE_MEDIAN
    sure = ratio - 1 > 5 * _MEDIAN_ERROR * math.sqrt(2 / place.shape[1])
    excess = ((ratio - 1) * expected.mean(1)).clamp_min(0)
    return sure & (cost_of_places(excess, mtf50.nan_to_num(0, 0, 0)) > DISPLACED)


def cost_of_places(variance: Tensor, mtf50: Tensor) -> Tensor:
    """Share of MTF50 that displacements of this variance, px^2, cost.

    They lower the response at f by 2 (pi f)^2 times it, and MTF50 by that over its slope, -2 ln 2 for a Gaussian.
    """
    return 2 * (math.pi * mtf50) ** 2 * variance / (2 * math.log(2))


def smoothed(shape: Shape) -> Tensor:
    """Whether the sides have certainly less noise than the edge between them, (B,): denoised, clipped, curved.

    Of light, noise in between lies between theirs. The median over pixels, for a hot one changes nothing.
    """
    sides, pixels, (off, _) = shape.sides, shape.spline.pixels, shape.spline.off
    share = pixels.value - off
    ratio = torch.where((share > 0.1) & (share < 0.9), off**2 / shape.noise.clamp_min(1e-18), torch.nan)
    of_regions = torch.split(ratio, pixels.count.tolist())
    count = torch.stack([each.isfinite().sum() for each in of_regions])
    median = torch.stack([each.nanmedian() for each in of_regions]) / CHI_SQUARE_MEDIAN
    limit = torch.where(sides.power_at_0 > SMOOTH_NOISE, UNEVEN_SMOOTH, UNEVEN_NOISE)
    noisy = sides.variance.amax(1) > NOISELESS * sides.step**2
    sure = median > 1 + 5 * _MEDIAN_ERROR * torch.sqrt(2 / count)
    return noisy & (count >= 20) & sure & (median > limit)


_MASK_PX = 0.7  # of the sharpening's Gaussian
_SHARPEST_PX = 0.05
MATTERS = 0.015  # of MTF50, that a fault must have cost before it raises a flag
MISFIT = 0.004  # of the step, by which an edge may differ from a Gaussian one with a fault before that is ruled out
UNEQUAL = 0.002  # of the step, by which the edge may differ from itself turned by half a turn, halved
_WITHIN = 1.96  # standard errors of a strength that the interval covers
_FINEST, _COARSEST, _MTF50S = 0.6, 1e-3, 17  # cycles/px, of the table of costs, in even ratios
_STRENGTHS = 4  # of that table, in a unit of strength


def gaussian_edge(mtf50: Tensor, place_px: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """A Gaussian over square pixels of that MTF50 (...), or the sharpest, at ``place_px`` (K,) from the edge.

    Its sigma, px, (..., 1), its level from 0 to 1, (..., K), and the level behind the sharpening's Gaussian.
    """
    squared = torch.log((2 * torch.sinc(mtf50)).clamp_min(1)) / (2 * (math.pi * mtf50) ** 2)
    sigma = squared.clamp_min(_SHARPEST_PX**2).sqrt()[..., None]
    both = torch.stack([sigma, torch.sqrt(sigma**2 + _MASK_PX**2)])
    level, softer = both * (_area((place_px + 0.5) / both) - _area((place_px - 0.5) / both))
    return sigma, level, softer


def _area(place: Tensor) -> Tensor:
    """Area under the normal law's distribution function."""
    area: Tensor = place * torch.special.ndtr(place) + torch.exp(-place * place / 2) / math.sqrt(2 * math.pi)
    return area


def _clipped(level: Tensor, _: Tensor, u: Tensor) -> Tensor:
    """By 5 % of the step, below or above."""
    low, high = 0.05 * u.clamp_min(0), 1 + 0.05 * u.clamp_max(0)
    return (torch.minimum(torch.maximum(level, low), high) - low) / (high - low)


def _bent(level: Tensor, _: Tensor, u: Tensor) -> Tensor:
    """The light to the power of 2.2, or the root, of a dark side with a quarter of the bright one's."""
    power = 2.2**u
    dark: Tensor = 0.25**power
    return ((0.25 + 0.75 * level) ** power - dark) / (1 - dark)


def _clipped_twice(level: Tensor, _: Tensor, u: Tensor) -> Tensor:
    cut = 0.05 * u
    return (torch.minimum(torch.maximum(level, cut), 1 - cut) - cut) / (1 - 2 * cut)


def _s_shaped(level: Tensor, _: Tensor, u: Tensor) -> Tensor:
    """3 x^2 - 2 x^3 of 0.2 to 0.8 of full scale."""
    light = 0.2 + 0.6 * level
    return level + u * ((light * light * (3 - 2 * light) - 0.104) / 0.792 - level)


def _sharpened(level: Tensor, softer: Tensor, u: Tensor) -> Tensor:
    return level + 0.3 * u * (level - softer)


@dataclass(frozen=True)
class _Fault:
    """What a fault of strength u (..., 1), 0 of an honest edge, makes of a level and a softer one (..., K).

    parity: 1 where it leaves the edge's halves unequal, which no blur does, else -1. range: of u. usual: the largest
    u that is reckoned with where there is no trace of it.
    """

    change: Callable[[Tensor, Tensor, Tensor], Tensor]
    parity: float
    range: tuple[float, float]
    usual: float


_FAULTS = (
    _Fault(_clipped, 1.0, (-4.0, 4.0), 3.0),
    _Fault(_bent, 1.0, (-1.2, 1.2), 1.1),
    _Fault(_clipped_twice, -1.0, (0.0, 3.0), 1.1),
    _Fault(_s_shaped, -1.0, (0.0, 2.0), 1.1),
    _Fault(_sharpened, -1.0, (0.0, 6.0), 1.1),
)
_PARITY, _LOW, _HIGH, _USUAL = torch.tensor(
    [(fault.parity, *fault.range, fault.usual) for fault in _FAULTS], dtype=torch.float64
).T[..., None]  # (F, 1) each
_LEAST_U, _MOST_U = float(_LOW.min()), float(_HIGH.max())


def hidden_faults(shape: Shape, mtf50: Tensor) -> tuple[Tensor, Tensor]:
    """Whether the edge's halves are certainly unequal, (B,), and what hidden faults cost the measured ``mtf50`` (B,).

    The cost, (3, B), is the shares by which they likely raised it, and at most raised and lowered it.
    """
    free = shape.free
    place = knots_px(free.shape[1])
    mtf50 = mtf50.clamp(_COARSEST, _FINEST)
    _, level, _ = gaussian_edge(mtf50, place)
    costs = _costs(mtf50)
    slope = torch.gradient(level, dim=1)[0]
    # Another place and height of the step explain unequal halves; another width and contrast, equal ones.
    explained = [(slope, torch.ones_like(level)), (place * slope, level - 0.5)]
    bases = [torch.linalg.qr(torch.stack([each * free for each in both], dim=2)).Q for both in explained]
    basis = [bases[0 if fault.parity > 0 else 1] for fault in _FAULTS]

    def half(values: Tensor) -> Tensor:
        """The part of ``values`` (B, K) or (F, B, K) of each fault's parity, without what is explained."""
        parts = (values + _PARITY[..., None] * values.flip(-1)) / 2 * free
        left = [part - (q @ (q.mT @ part[..., None]))[..., 0] for q, part in zip(basis, parts, strict=True)]
        return torch.stack(left)

    def changes(u: Tensor) -> Tensor:
        """By the faults of strengths u, (F, B), at the MTF50 that they leave, (F, B, K)."""
        _, before, softer = gaussian_edge(mtf50 / (1 + _at(costs, u)), place)
        made = zip(_FAULTS, before, softer, u[..., None], strict=True)
        return half(torch.stack([fault.change(*edge) for fault, *edge in made]) - level)

    even = _PARITY > 0
    off = half(_at_knots(shape.spline.coefficients) - level)
    unexplained = torch.diag_embed(free) - bases[0] @ bases[0].mT
    mirrored = shape.covariance + shape.covariance.flip(1)
    mirrored = unexplained @ (mirrored + mirrored.flip(2)) @ unexplained / 4
    lopsided = _mean(off)[0].abs() > _misfit(shape, mirrored, UNEQUAL)
    off = torch.where(even & (shape.sides.step < 0), -1, 1)[..., None] * off
    units = changes(torch.ones(len(_FAULTS), len(mtf50), dtype=torch.float64))
    weights = units / (units**2).sum(-1, keepdim=True).clamp_min(1e-12)
    error = shape.error(torch.stack([_at_knots(weight) for weight in weights], 2)).mT
    first = (weights * off).sum(-1)
    guess = torch.minimum(torch.maximum(first, _LOW), _HIGH)
    left = off - changes(guess)
    more = (weights * left).sum(-1)
    misfit = _mean(left - more[..., None] * units).abs()
    fits = even | (misfit <= _misfit(shape, shape.covariance, MISFIT)).all(-1)
    steepness = _steepness(guess, first - more)
    u = torch.where(fits, guess + more / steepness, 0.0)
    limit = shape.certain(2) * error  # of two kinds of fault
    error = torch.where(fits, error / steepness, 0.0)
    trace = u.abs() > _WITHIN * error
    low, high = (torch.where(trace, end, end.clamp(-_USUAL, _USUAL)) for end in (_LOW, _HIGH))
    cost, *ends = (
        _at(costs, torch.minimum(torch.maximum(each, low), high))
        for each in (u, u - _WITHIN * error, u + _WITHIN * error)
    )
    unequal = even & (first.abs() > limit) & (_at(costs, torch.minimum(u.abs(), high)) > MATTERS)
    within, likely = torch.stack([cost, *ends]), cost.amax(0).clamp_min(0)
    largest, lowered = torch.maximum(likely, within.amax((0, 1))), -within.amin((0, 1)).clamp_max(0)
    return unequal.any(0) | lopsided.any(1), torch.stack([likely, largest, lowered])


def _steepness(u: Tensor, seen: Tensor) -> Tensor:
    """By what more is seen of faults of strength u per u, seen being 1 at 1: between there, or 0, and u."""
    at = (u > 0).to(u)
    slope = (seen - at) / (u - at)
    # At 1, and at 2, where the range of S-shaped curves ends, it is taken to be 1.
    return torch.where(((u - at).abs() < 1e-3) | (u - at == 1), 1.0, slope.clamp(0.25, 4.0))


def _at_knots(coefficients: Tensor) -> Tensor:
    """A cubic spline's values at its knots."""
    kernel = coefficients.new_tensor([[[1 / 6, 4 / 6, 1 / 6]]])
    wide = torch.cat([coefficients[:, :1], coefficients, coefficients[:, -1:]], dim=1)
    return conv1d(wide[:, None], kernel)[:, 0]


def _costs(mtf50: Tensor) -> Tensor:
    """Shares by which faults raise MTF50, (F, B, U), at even steps of u, of edges that have this one (B,) with it."""
    table = _cost_table()
    place = torch.log(mtf50 / _COARSEST) * ((_MTF50S - 1) / math.log(_FINEST / _COARSEST))
    index = place.long().clamp_max(_MTF50S - 2)
    return torch.lerp(table[:, index], table[:, index + 1], (place - index)[:, None])


def _at(costs: Tensor, u: Tensor) -> Tensor:
    """The costs of strengths (F, B)."""
    place = (u - _LEAST_U) * _STRENGTHS
    index = place.long().clamp(0, costs.shape[2] - 2)[..., None]
    below, above = (costs.gather(2, each)[..., 0] for each in (index, index + 1))
    return torch.lerp(below, above, place - index[..., 0])


@cache
def _cost_table() -> Tensor:
    """By what the faults raise MTF50, (F, M, U), by the MTF50 that is then measured."""
    mtf50 = torch.logspace(math.log10(_COARSEST), math.log10(_FINEST), _MTF50S, dtype=torch.float64)
    sigma, _, _ = gaussian_edge(mtf50, torch.zeros(1, dtype=torch.float64))
    step = (sigma / 12).clamp_min(0.125)
    place = step * torch.arange(-80, 81)
    _, level, softer = gaussian_edge(mtf50, place)
    count = round((_MOST_U - _LEAST_U) * _STRENGTHS) + 1
    strength = torch.linspace(_LEAST_U, _MOST_U, count, dtype=torch.float64)
    table = torch.empty(len(_FAULTS), _MTF50S, count, dtype=torch.float64)
    for fault, into in zip(_FAULTS, table, strict=True):
        u = strength.clamp(*fault.range)[:, None, None]
        line = torch.diff(fault.change(level, softer, u))
        found = mtf50.expand(line.shape[:2])
        for _ in range(6):  # of Newton's steps
            angle = math.pi * found
            wave = 2 * angle[..., None] * (place[:, 1:] + place[:, :-1]) / 2
            response = torch.hypot((line * torch.cos(wave)).sum(-1), (line * torch.sin(wave)).sum(-1))
            response = response / torch.sinc(found * step[:, 0])
            steepness = (2 * angle * sigma[:, 0]) ** 2 + 1 - angle / torch.tan(angle)
            found = (found * (1 + torch.log(2 * response) / steepness)).clamp(max=0.95)
        honest = found[round(-_LEAST_U * _STRENGTHS)]
        for column, after in enumerate(found):
            share = np.interp(mtf50.log().numpy(), after.log().numpy(), (after / honest - 1).numpy())
            into[:, column] = torch.from_numpy(share)
    return table


def _misfit(shape: Shape, covariance: Tensor, least: float) -> Tensor:
    """What the mean over 5 knots of what is left of an edge, (B, K), may be by noise, or matters little."""
    windows = covariance.unfold(1, 5, 1).unfold(2, 5, 1).diagonal(dim1=1, dim2=2)
    error = windows.mean((1, 2)).clamp_min(0).sqrt()
    return pad(shape.certain(shape.free.sum(1))[:, None] * error, (2, 2), "replicate").clamp_min(least)


def _mean(values: Tensor) -> Tensor:
    return avg_pool1d(values, 5, stride=1, padding=2)
