"""Faults of an edge: shapes that no lens, motion or pixel can make of a step.

A fault is reported if it exceeds both its standard error, from a closed-form bootstrap over rows, and the smallest
size that matters. Domain: splines scaled to 0 and 1, distances in px along the normal, frequencies in cycles/px.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache, cached_property

import torch
from torch import Tensor
from torch.nn.functional import avg_pool2d

from blurnoise._core.luminance import LUMINANCE
from blurnoise.metrics.edge.position import NOISELESS, Sides, cosine, find_line
from blurnoise.metrics.edge.spline import CHI_SQUARE_MEDIAN, KNOT_PX, Spline

FALSE_ALARM = 1e-3  # probability per test, however many positions it examines
OVERSHOOT = 0.008  # of the step, beyond one of its sides
NEGATIVE = 0.04  # of the step, by which the light in half a pixel may be below 0
DIP = 0.5  # of the lower neighbour, by which the line spread may dip between two humps
DISPLACED = 0.02  # of MTF50, that displaced rows or colours may cost
UNEVEN_NOISE, UNEVEN_SMOOTH = 12.0, 2.5
"""Variance of the noise upon the edge over that of its sides: JPEG of quality 90 leaves 5 to 10."""
SMOOTH_NOISE = 7.5  # power at frequency 0, over the variance, of noise that a filter has smoothed
MEDIAN_ERROR = 1.65  # standard error of a median of n chi squares over that of their mean, sqrt(2/n)
QUIETER = 0.8  # variance of the bright side's noise over the dark one's: light adds noise
CERTAIN = 5.0  # standard errors of noise that differs from what light makes of it
COLOURS_CERTAIN = 2.2  # errors of the distance between colours; the largest of 400 grey edges was 1.1
LEVELS = 2.0  # factor on a colour's position error from its rows: the levels of its sides have errors, too
UNEVEN = 0.025  # least noise of a block's mean misfit, of the step: shading and curved edges cause as much
BLOCK_PX, ODD_BLOCK = 5, 6.0  # side of a block; standard errors by which its mean must miss the edge's shape


@dataclass(frozen=True)
class Shape:
    """An edge's sides, its line (B, H) and the spline between them, scaled to 0 and 1.

    >>> from blurnoise import charts
    >>> from blurnoise.metrics.edge.measurement import shape_of
    >>> from blurnoise.metrics.edge.position import measure_sides
    >>> picture = charts.slanted_edge(60, 60)[0].double()
    >>> line = find_line(picture).position_px
    >>> sides, upright = measure_sides(picture, line)
    >>> shape_of(upright, line, sides, block=1).rows_together  # white noise: each row for itself
    1
    """

    sides: Sides
    position_px: Tensor
    spline: Spline

    @cached_property
    def rows_together(self) -> int:
        """Number of rows with correlated noise that a bootstrap draws together; at least 16 such blocks remain."""
        return max(1, min(int(self.sides.block.max()), self.position_px.shape[1] // 16))

    @cached_property
    def covariance(self) -> Tensor:
        """Of the spline's coefficients, (B, K, K), by a bootstrap over rows."""
        return self.spline.bootstrapped(self.rows_together)

    @cached_property
    def free(self) -> Tensor:
        """1 for coefficients that were fitted, as well as their mirror image, else 0, (B, K)."""
        free = (self.spline.inverse.diagonal(dim1=1, dim2=2) > 0).to(torch.float64)
        return free * free.flip(1)

    @cached_property
    def noise(self) -> Tensor:
        """Noise variance of each of the spline's pixels, (n,), interpolated between the sides by its light."""
        dark, bright = (self.sides.variance / self.sides.step[:, None] ** 2).unbind(1)
        pixels = self.spline.pixels
        share = (pixels.value - self.spline.off[0]).clamp(0, 1)
        return dark[pixels.region] + (bright - dark)[pixels.region] * share

    def error(self, functionals: Tensor) -> Tensor:
        """Standard errors (B, n) of the coefficients' sums with functionals, (K, n) or (B, K, n)."""
        covariance = self.covariance.to(functionals.dtype)
        return ((covariance @ functionals) * functionals).sum(1).clamp_min(0).sqrt()

    def certain(self, places: Tensor | int) -> Tensor:
        """Standard errors by which one of ``places`` numbers must deviate to be significant."""
        return certain(math.ceil(self.position_px.shape[1] / self.rows_together), places)

    def exceed(self, values: Tensor, error: Tensor, least: float) -> Tensor:
        """Whether any of ``values`` (B, n) is above ``least`` and significant against the noise, (B,)."""
        limit = self.certain(self.free.sum(1))[:, None] * error
        return (values > limit.clamp_min(least)).any(1)


def certain(rows: int, places: Tensor | int) -> Tensor:
    """Standard errors by which one of ``places`` numbers must deviate: Bonferroni's correction of Student's law.

    Student's quantile is the normal one with the expansion of Cornish and Fisher.

    >>> round(float(certain(100, 1)), 2)
    3.39"""
    freedom = max(rows - 1, 4)
    tail = FALSE_ALARM / 2 / torch.as_tensor(places, dtype=torch.float64).clamp_min(1)
    z = -torch.special.ndtri(tail)
    t: Tensor = z + (z**3 + z) / (4 * freedom) + (5 * z**5 + 16 * z**3 + 3 * z) / (96 * freedom**2)
    return t


def structured(shape: Shape) -> Tensor:
    """Whether blocks of pixels deviate from the fitted shape, (B,): a blurred corner would pass for a wide edge.

    >>> from blurnoise import charts
    >>> from blurnoise.metrics.edge.measurement import shape_of
    >>> from blurnoise.metrics.edge.position import measure_sides
    >>> picture = charts.slanted_edge(60, 60)[0].double()
    >>> picture[:, :20, 20:40] = picture.amin()  # the bright side ends at a corner
    >>> line = find_line(picture).position_px
    >>> sides, upright = measure_sides(picture, line)
    >>> structured(shape_of(upright, line, sides, block=1)).tolist()
    [True]
    """
    noise = (shape.sides.variance.amax(1) / shape.sides.step**2).sqrt()
    off = shape.spline.pixels.in_place(shape.spline.off[0].float())
    misfit = avg_pool2d(off, BLOCK_PX, stride=BLOCK_PX // 2).abs().amax((1, 2)).double()
    return misfit > ODD_BLOCK * (noise / BLOCK_PX).clamp_min(UNEVEN)


def overshoots(shape: Shape) -> Tensor:
    """Whether the edge, in the mean over a pixel, goes beyond one of its sides, (B,).

    >>> from blurnoise import charts
    >>> from blurnoise.metrics.edge.measurement import shape_of
    >>> from blurnoise.metrics.edge.position import measure_sides
    >>> picture = charts.slanted_edge(60, 60)[0].double()
    >>> picture = picture + 0.5 * (picture - avg_pool2d(picture, 3, stride=1, padding=1, count_include_pad=False))
    >>> line = find_line(picture).position_px
    >>> sides, upright = measure_sides(picture, line)
    >>> overshoots(shape_of(upright, line, sides, block=1)).tolist()  # sharpened
    [True]
    """
    knots = torch.eye(shape.spline.coefficients.shape[1], dtype=torch.float64)
    means = knots.unfold(0, round(1 / KNOT_PX), 1).mean(-1).T
    edge = shape.spline.coefficients @ means
    return shape.exceed(torch.maximum(edge - 1, -edge), shape.error(means), OVERSHOOT)


def two_humps(shape: Shape) -> Tensor:
    """Whether the line spread, averaged over an eighth of the reach, dips between two humps, (B,).

    >>> from blurnoise import charts
    >>> from blurnoise.metrics.edge.measurement import shape_of
    >>> from blurnoise.metrics.edge.position import measure_sides
    >>> noise = 0.0005 * torch.randn(1, 60, 60, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    >>> edge = charts.slanted_edge(60, 60)[0].double()
    >>> picture = ((edge.roll(3, -1) + edge.roll(-3, -1)) / 2 + noise)[:, :, 10:-10]  # a ghost, 6 px away
    >>> line = find_line(picture).position_px
    >>> sides, upright = measure_sides(picture, line)
    >>> two_humps(shape_of(upright, line, sides, block=1)).tolist()
    [True]
    """
    apart = round(0.75 / KNOT_PX)  # from a hump to the dip, at least: closer ones are the ringing of a filter
    knots = torch.eye(shape.spline.coefficients.shape[1], dtype=torch.float64)
    dipping = torch.zeros_like(shape.sides.structured)
    widths = (shape.sides.reach_px / 8 / KNOT_PX).round().long().clamp_min(2)
    for width in set(widths.tolist()):
        rises = knots[:, width:] - knots[:, :-width]
        line, error = shape.spline.coefficients @ rises, shape.error(rises)
        left, right = line.cummax(1).values, line.flip(1).cummax(1).values.flip(1)
        hump = torch.minimum(left[:, : -2 * apart], right[:, 2 * apart :])
        places = (shape.free.sum(1) / width) ** 3  # two humps and what lies between them
        certain = shape.certain(places)[:, None] * math.sqrt(2) * error[:, apart:-apart]
        dips = hump - line[:, apart:-apart] > torch.maximum(certain, DIP * hump)
        dipping |= (widths == width) & (dips & (hump > 0.1 * line.amax(1, keepdim=True))).any(1)
    return dipping


def negative(shape: Shape) -> Tensor:
    """Whether the edge implies negative light in front of the pixels, (B,): it is clipped, or sharpened.

    The edge spread is that of lens and motion, P, averaged over a pixel: E'(u) = P(u + 1/2) - P(u - 1/2). So P is a
    sum of E' at places a pixel apart and must never fall. Means over adjacent halves of a pixel are compared.

    >>> from blurnoise import charts
    >>> from blurnoise.metrics.edge.measurement import shape_of
    >>> from blurnoise.metrics.edge.position import measure_sides
    >>> picture = charts.slanted_edge(60, 60)[0].double().clamp(0.2, 0.6)  # a step from .1 to .8, clipped
    >>> line = find_line(picture).position_px
    >>> sides, upright = measure_sides(picture, line)
    >>> negative(shape_of(upright, line, sides, block=1)).tolist()
    [True]
    """
    coefficients = shape.spline.coefficients.float()  # single precision is enough here, and twice as fast
    count = coefficients.shape[1]
    knot = torch.arange(count) - count // 2
    pixel = cosine(shape.position_px).float()[:, None, None]
    position = (torch.arange(count + 8) - count // 2 - 4)[:, None] * pixel  # knots; a pixel is 4 of them
    away = (position - knot).abs()
    spline = torch.where(away < 1, 2 / 3 - away * away * (1 - away / 2), (2 - away).clamp_min(0) ** 3 / 6)
    beyond = (1 - spline.sum(2)) * (position[..., 0] > 0)  # beyond the last knot the edge is 1
    by_quarter = _rises(count + 8)
    rises = by_quarter @ spline
    light = (rises @ coefficients[..., None])[..., 0] + beyond @ by_quarter.T
    return shape.exceed(-light, shape.error(rises.mT), NEGATIVE)


@cache
def _rises(count: int) -> Tensor:
    """Matrix (n, count) from an edge at quarters of a pixel to the rises of P between adjacent half pixels."""
    one = torch.eye(count)
    curved = 2 * (one[4:] - 2 * one[2:-2] + one[:-4])
    index = torch.arange(len(curved))
    after = index[:, None] - index
    aligned = (after % 4 == 0).float()
    return torch.cat([(aligned * (after >= 0)) @ curved, -(aligned * (after < 0)) @ curved])


def displaced(shape: Shape, mtf50: Tensor) -> Tensor:
    """Whether rows are displaced against each other by more than noise explains, so far that MTF50 suffers, (B,).

    >>> from blurnoise import charts
    >>> from blurnoise.metrics.edge.measurement import shape_of
    >>> from blurnoise.metrics.edge.position import measure_sides
    >>> noise = 0.002 * torch.randn(1, 60, 60, generator=torch.Generator().manual_seed(0))
    >>> picture = (charts.slanted_edge(60, 60)[0] + noise).double()
    >>> picture[:, ::2] = picture[:, ::2].roll(1, -1)  # every other row one pixel to the right
    >>> line = find_line(picture).position_px
    >>> sides, upright = measure_sides(picture, line)
    >>> displaced(shape_of(upright, line, sides, block=1), torch.tensor([0.5])).tolist()
    [True]
    """
    (off, pull), by_row = shape.spline.off, shape.spline.pixels.by_row
    curvature = by_row(pull * pull).clamp_min(1e-12)
    shift_px = by_row(pull * off) / curvature  # of each row, from its misfit projected on the edge's slope
    expected = by_row(pull * pull * shape.noise) / curvature**2
    # The median over rows is robust against a hot pixel, which moves one row.
    ratio = (shift_px**2 / expected.clamp_min(1e-18)).median(1).values / CHI_SQUARE_MEDIAN
    sure = ratio - 1 > 5 * MEDIAN_ERROR * math.sqrt(2 / shift_px.shape[1])
    excess = ((ratio - 1) * expected.mean(1)).clamp_min(0)
    return sure & (_cost_of_places(excess, mtf50.nan_to_num(0, 0, 0)) > DISPLACED)


def _cost_of_places(variance: Tensor, mtf50: Tensor) -> Tensor:
    """Share of MTF50 lost to displacements of variance px^2: 2 (pi f)^2 of it over a Gaussian's slope, 2 ln 2."""
    return 2 * (math.pi * mtf50) ** 2 * variance / (2 * math.log(2))


def smoothed(shape: Shape) -> Tensor:
    """Whether the sides have significantly less noise than the edge between them, (B,): denoised, clipped, curved.

    >>> from blurnoise import charts
    >>> from blurnoise.metrics.edge.measurement import shape_of
    >>> from blurnoise.metrics.edge.position import measure_sides
    >>> noise = torch.randn(1, 60, 60, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    >>> picture = charts.slanted_edge(60, 60)[0].double()
    >>> noise *= torch.where((picture > 0.17) & (picture < 0.73), 0.05, 0.002)  # only the sides are denoised
    >>> line = find_line(picture + noise).position_px
    >>> sides, upright = measure_sides(picture + noise, line)
    >>> smoothed(shape_of(upright, line, sides, block=1)).tolist()
    [True]
    """
    sides, pixels, (off, _) = shape.sides, shape.spline.pixels, shape.spline.off
    share = pixels.value - off
    ratio = torch.where((share > 0.1) & (share < 0.9), off**2 / shape.noise.clamp_min(1e-18), torch.nan)
    of_regions = torch.split(ratio, pixels.count.tolist())
    count = torch.stack([each.isfinite().sum() for each in of_regions])
    median = torch.stack([each.nanmedian() for each in of_regions]) / CHI_SQUARE_MEDIAN
    limit = torch.where(sides.power_at_0 > SMOOTH_NOISE, UNEVEN_SMOOTH, UNEVEN_NOISE)
    noisy = sides.variance.amax(1) > NOISELESS * sides.step**2
    sure = median > 1 + 5 * MEDIAN_ERROR * torch.sqrt(2 / count)
    return noisy & (count >= 20) & sure & (median > limit)


def quieter(sides: Sides) -> Tensor:
    """Whether the bright side has significantly less noise than the dark one, (B,); rounding errors do not count.

    >>> from blurnoise.metrics.edge.position import measure_sides
    >>> values = 20 * torch.randn(1, 80, 60, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    >>> values[:, :, 30:] = 1000 + values[:, :, 30:] / 10  # the bright side, which light would make noisier
    >>> sides, _ = measure_sides(values, find_line(values).position_px)
    >>> quieter(sides).tolist()
    [True]
    """
    # The median over the rows' noise is robust against a hot pixel, which makes one row noisy.
    left, right = (sides.square / sides.count.clamp_min(1)).median(1).values.unbind(1)
    of_bright, of_dark = torch.where(sides.step > 0, torch.stack([right, left]), torch.stack([left, right]))
    error = 1.25 * torch.sqrt((2 / sides.count.sum(1)).sum(1))  # of the ratio's logarithm
    # Correlated noise was filtered or compressed, so it no longer depends on light as shot noise does.
    noisy = (of_dark > NOISELESS * sides.step**2) & (sides.block == 1)
    is_quieter: Tensor = noisy & (torch.log(of_bright / (QUIETER * of_dark)) < -CERTAIN * error)
    return is_quieter


def colours_apart(colours: Tensor, mtf50: Tensor) -> Tensor:
    """Whether the edges of colours (B, 3, H, W), by their share of luminance, lie so far apart that MTF50 suffers.

    >>> from blurnoise import charts
    >>> red = charts.slanted_edge(60, 60)[0].double()
    >>> shifted = torch.cat([red.roll(2, -1), red, red])[None]
    >>> colours_apart(shifted, torch.tensor([0.5])).tolist()  # red lies 2 px from green and blue
    [True]
    """
    batch, _, height, width = colours.shape
    line = find_line(colours.flatten(0, 1))
    step = line.right - line.left
    rows = (line.right[:, None] - colours.flatten(0, 1).mean(2)) / step[:, None] * width
    scatter = LEVELS * (rows - line.position_px).std(1) / math.sqrt(height)
    of_colours = (line.position_px.mean(1), scatter.nan_to_num(0, 0, 0), step.abs())
    position, error, step = (each.view(batch, 3) for each in of_colours)
    weight = torch.where(line.no_edge.view(batch, 3), 0.0, step * torch.tensor(LUMINANCE, dtype=step.dtype))
    weight = weight / weight.sum(1, keepdim=True)
    middle = (weight * position).sum(1, keepdim=True)
    spread, noise = (weight * (position - middle) ** 2).sum(1), (weight * error**2).sum(1)
    costs = _cost_of_places(spread - noise, mtf50)
    return (spread > COLOURS_CERTAIN**2 * noise) & (costs > DISPLACED)
