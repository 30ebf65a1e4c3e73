"""One edge of each region, from pixels to its line, sides and shape, and what speaks against it.

Domain: regions (B, H, W) float64, linear, the edge near vertical, of either polarity.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from blurnoise.metrics.edge.flags import Flag
from blurnoise.metrics.edge.geometry import Upright, find_line, largest_phase_gap_px, smooth, straighten
from blurnoise.metrics.edge.response import Response, scatter
from blurnoise.metrics.edge.sides import REACH_FACTOR, REACH_PX, STRIP_PX, Sides, measure_sides, reach_of
from blurnoise.metrics.edge.spline import BLOCK_PX, KNOT_PX, LINE_ORDER, Spline, refine

Flags = dict[Flag, Tensor]
"""Which of the regions each flag stands for, (B,) bool."""

LARGEST_GAP_PX = {"exact": 0.55, "iso": 0.3}
"""Along the normal, without a sample: a gap of 0.5 px still shows all below 1 cycle/px, a bin of 1/4 px does not."""
LOPSIDED = 0.05
"""Skewness of the edge's derivative from which a tone curve is suspected."""
QUIETER = 0.8
"""Variance of the bright side over the dark one's below which a tone curve is suspected: light adds noise."""
OVERSHOOT = 0.01
"""Share of the step by which a sharpened edge goes beyond its sides: light only adds, so no blur does."""
WINDOW_REACHES = 10
"""Width of a region, in distances from the edge to the end of its blur, below which the standard's window tells."""
UNEVEN = 0.025
"""Mean misfit of a block, as a share of the step, that counts as noise at least: shading and curves leave as much."""
NOISY = 0.08
"""Standard deviation of MTF50, as a share of it, from which noise dominates."""
NOISELESS = 1e-8
"""Noise variance, as a share of the step squared, below which there is no noise to compare."""
CERTAIN = 5.0
"""Standard errors that such a suspicion must have."""


@dataclass(frozen=True)
class Located:
    """The edge of every region, before its shape is known.

    upright: the regions about their edges. position_px: first lines, (B, H). reach_px: (B,), how far the blur
    reaches. sides: levels and noise beside it.
    """

    upright: Upright
    position_px: Tensor
    reach_px: Tensor
    sides: Sides

    def only(self, kept: Sequence[int]) -> Located:
        """Those regions alone."""
        upright = Upright(*(value[kept] for value in vars(self.upright).values()))
        sides = Sides(*(value[kept] for value in vars(self.sides).values()))
        return Located(upright, self.position_px[kept], self.reach_px[kept], sides)


@dataclass(frozen=True)
class Shape:
    """sides: levels and noise. spline: the edge between them, scaled to 0 and 1. position_px: its line, (B, H).

    reach_px: (B,), how far the blur was taken to reach.
    """

    sides: Sides
    spline: Spline
    position_px: Tensor
    reach_px: Tensor


def locate(values: Tensor) -> tuple[Located, Flags]:
    """Find the edges and their sides, and what withholds a region from being measured."""
    line = find_line(values)
    upright = straighten(values, line.position_px)
    reach = reach_of(upright)
    beside = upright.within(2 * max(int(reach.px.max().ceil()), int(STRIP_PX)) + 3)
    sides = measure_sides(beside, line.position_px, reach.px)
    edge = ~line.no_edge
    whole = edge & ~line.leaves
    flags = {
        Flag.NO_EDGE: line.no_edge,
        Flag.TWO_EDGES: edge & (line.structured | (whole & reach.structured)),
        Flag.EDGE_LEAVES_REGION: edge & line.leaves,
        Flag.REGION_TOO_SMALL: whole & ~line.structured & (reach.too_small | sides.too_small),
    }
    return Located(beside, line.position_px, reach.px, sides), flags


def shape_of(found: Located) -> Shape:
    """Measure edges that no flag withholds.

    The line is found again from the dark area of every row within the edge's reach, where less noise lies.
    """
    sides = found.sides
    zone = found.upright.within(int(found.reach_px.max().ceil()) + 2)
    scaled = (zone.values - sides.level[:, :1, None]) / sides.step[:, None, None]
    columns = scaled.shape[2]
    place = torch.arange(columns) - columns // 2
    own = (zone.inside > 0) & (place.abs() <= found.reach_px.ceil()[:, None, None] + 1)
    dark_px = columns - torch.where(own, scaled, (place > 0).to(scaled)).sum(2)
    again = smooth(zone.first + dark_px, order=LINE_ORDER)
    noise = sides.variance / sides.step[:, None] ** 2
    spline, line = refine(replace(zone, values=scaled), again, found.reach_px, noise)
    return Shape(sides, spline, line, found.reach_px)


def suspicions(shape: Shape, mode: str, width_px: int) -> Flags:
    """What the shape itself says against the numbers that will be taken from it."""
    few = largest_phase_gap_px(shape.position_px) > LARGEST_GAP_PX[mode]
    blur_px = (shape.reach_px - REACH_PX) / REACH_FACTOR
    return {
        Flag.TOO_FEW_PHASES: few,
        Flag.NON_LINEAR_SUSPECTED: _quieter(shape.sides) | (_lopsided(shape.spline) & ~few),
        Flag.SHARPENED: _overshoots(shape.spline) & ~few,
        Flag.WINDOW_CUTS: (blur_px * WINDOW_REACHES > width_px) & (mode == "iso"),
    }


def not_alone(shape: Shape) -> Tensor:
    """Whether something stands off the edge's own shape, (B,): a blurred corner passes for a wide edge else."""
    noise = (shape.sides.variance.amax(1) / shape.sides.step**2).sqrt()
    return shape.spline.largest_misfit() > (CERTAIN + 1) * (noise / BLOCK_PX).clamp_min(UNEVEN)


def doubts(response: Response, mtf50: Tensor) -> Flags:
    """What the response says against itself. mtf50: (B,), inf where it stays above 50 %."""
    return {
        Flag.NEVER_REACHES_50: torch.isinf(mtf50),
        Flag.NOISE_DOMINATED: scatter(response, mtf50) > NOISY,
    }


def _quieter(sides: Sides) -> Tensor:
    """Whether the bright side has certainly less noise than the dark one, (B,); rounding errors do not count."""
    bright = (sides.step > 0).long()[:, None]
    of_bright, of_dark = (sides.variance.gather(1, side)[:, 0] for side in (bright, 1 - bright))
    error = torch.sqrt((2 / sides.count.sum(1)).sum(1))  # of the ratio's logarithm
    noisy = of_dark > NOISELESS * sides.step**2
    return noisy & (torch.log(of_bright / (QUIETER * of_dark)) < -CERTAIN * error)


def _overshoots(spline: Spline) -> Tensor:
    """Whether the edge, in the mean over a pixel, certainly goes beyond one of its sides, (B,)."""
    knots = round(1 / KNOT_PX)
    mean = torch.eye(spline.coefficients.shape[1], dtype=torch.float64).unfold(0, knots, 1).mean(-1)
    edge = spline.coefficients @ mean.T
    error = ((mean @ spline.covariance) * mean).sum(2).clamp_min(0).sqrt()
    beyond = torch.maximum(edge - 1, -edge)
    return ((beyond > OVERSHOOT) & (beyond > CERTAIN * error)).any(1)


def _lopsided(spline: Spline) -> Tensor:
    """Whether the edge's derivative certainly has a third moment, (B,): motion and most lenses blur evenly."""
    steps = torch.diff(spline.coefficients, dim=1)
    place = (spline.distance_px[:-1] + spline.distance_px[1:]) / 2
    middle = (steps * place).sum(1, keepdim=True)
    away = place - middle
    spread = (steps * away**2).sum(1).clamp_min(1e-12)
    third = (steps * away**3).sum(1)
    # The error of a sum of c_(k+1) - c_k times a weight, about the middle and spread found: a sum over c.
    weight = away**3 - 3 * spread[:, None] * away
    weight = torch.nn.functional.pad(weight, (1, 0)) - torch.nn.functional.pad(weight, (0, 1))
    error = ((weight[:, None] @ spline.covariance)[:, 0] * weight).sum(1).clamp_min(0).sqrt()
    return (third.abs() > LOPSIDED * spread**1.5) & (third.abs() > CERTAIN * error)
