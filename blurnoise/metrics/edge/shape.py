"""One edge of each region, from pixels to its line, sides and shape, and what speaks against it.

Domain: regions (B, H, W) float64, linear, the edge near vertical, of either polarity.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor
from torch.nn.functional import avg_pool2d

from blurnoise._core.luminance import LUMINANCE
from blurnoise.metrics.edge import faults
from blurnoise.metrics.edge.faults import Shape
from blurnoise.metrics.edge.flags import Flag
from blurnoise.metrics.edge.geometry import Upright, find_line, largest_phase_gap_px, smooth, straighten
from blurnoise.metrics.edge.sides import (
    NOISELESS,
    REACH_FACTOR,
    REACH_PX,
    STRIP_PX,
    Sides,
    measure_sides,
    reach_of,
)
from blurnoise.metrics.edge.spline import LINE_ORDER, refine

Flags = dict[Flag, Tensor]
"""Which of the regions each flag stands for, (B,) bool."""

LARGEST_GAP_PX = {"exact": 0.55, "iso": 0.3}
"""Along the normal, without a sample: a gap of 0.5 px still shows all below 1 cycle/px, a bin of 1/4 px does not."""
WINDOW_REACHES = 10  # width of a region that the standard's window needs, over the blur's reach
UNEVEN = 0.025  # mean misfit of a block, of the step, that counts as noise at least: shading and curves leave as much
NOISY = 0.08  # standard deviation of MTF50, as a share of it, from which noise dominates
QUIETER = 0.8  # variance of the bright side's noise over the dark one's: light adds noise
CERTAIN = 5.0  # standard errors of noise that differs from what light makes of it
COLOURS_CERTAIN = 2.2  # errors of the distance between colours: of 400 grey edges none has 1.1
_LEVELS = 2.0  # error of a colour's place over that from its rows alone: the levels that place it have errors
_BLOCK_PX, _ODD_BLOCK = 5, 6.0  # standard errors by which the mean of a block must be off the edge's shape


@dataclass(frozen=True)
class Located:
    """The edge of every region, before its shape is known.

    upright: the regions about their edges. position_px: first lines, (B, H). reach_px: (B,), how far the blur
    reaches. rise: of the light to both sides, per px, (B, 2). sides: levels and noise beside it.
    """

    upright: Upright
    position_px: Tensor
    reach_px: Tensor
    rise: Tensor
    sides: Sides

    def only(self, kept: Sequence[int]) -> Located:
        """Those regions alone."""
        upright = Upright(*(value[kept] for value in vars(self.upright).values()))
        sides = Sides(*(value[kept] for value in vars(self.sides).values()))
        return Located(upright, self.position_px[kept], self.reach_px[kept], self.rise[kept], sides)


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
    return Located(beside, line.position_px, reach.px, reach.rise, sides), flags


def shape_of(found: Located, block: int = 1) -> Shape:
    """Measure edges that no flag withholds; block: rows of them whose noise belongs together.

    The line is found again from the dark area of every row within the edge's reach, where less noise lies.
    """
    sides = found.sides
    zone = found.upright.within(int(found.reach_px.max().ceil()) + 2)
    left, right = (
        level[..., None] + rise[:, None, None] * (zone.distance_px(found.position_px) - place[:, None, None])
        for level, rise, place in zip(
            sides.level_by_row().unbind(2), found.rise.unbind(1), sides.place_px.unbind(1), strict=True
        )
    )
    scaled = (zone.values - left) / (right - left)
    columns = scaled.shape[2]
    place = torch.arange(columns) - columns // 2
    own = (zone.inside > 0) & (place.abs() <= found.reach_px.ceil()[:, None, None] + 1)
    dark_px = columns - torch.where(own, scaled, (place > 0).to(scaled)).sum(2)
    again = smooth(zone.first + dark_px, order=LINE_ORDER)
    noise = sides.variance / sides.step[:, None] ** 2
    spline, line = refine(replace(zone, values=scaled), again, found.reach_px, noise)
    if block > 1:  # the covariance that a bootstrap over blocks of rows finds: of noise that is not white
        spline = replace(spline, covariance=spline.bootstrapped(block))
    return Shape(sides, spline, line, found.reach_px)


def not_alone(shape: Shape) -> Tensor:
    """Whether something stands off the edge's own shape, (B,): a blurred corner passes for a wide edge else."""
    noise = (shape.sides.variance.amax(1) / shape.sides.step**2).sqrt()
    off = shape.spline.pixels.in_place(shape.spline.off[0].float())
    misfit = avg_pool2d(off, _BLOCK_PX, stride=_BLOCK_PX // 2).abs().amax((1, 2)).double()
    return misfit > _ODD_BLOCK * (noise / _BLOCK_PX).clamp_min(UNEVEN)


def suspicions(
    shape: Shape, mode: str, width_px: int, mtf50: Tensor, scattered: Tensor
) -> tuple[Flags, Tensor]:
    """What speaks against the numbers that were taken from a shape, and what hidden faults may cost, (3, B).

    mtf50: (B,), inf where it stays above 50 %; scattered: its standard deviation as a share of it, (B,).
    """
    sides = shape.sides
    few = largest_phase_gap_px(shape.position_px) > LARGEST_GAP_PX[mode]
    blur_px = (shape.reach_px - REACH_PX) / REACH_FACTOR
    unequal, hidden = faults.hidden_faults(shape, mtf50)
    return {
        Flag.NEVER_REACHES_50: torch.isinf(mtf50),
        Flag.NOISE_DOMINATED: scattered > NOISY,
        Flag.TOO_FEW_PHASES: few,
        Flag.NON_LINEAR_SUSPECTED: _quieter(sides) | (unequal & ~few),
        Flag.SHARPENED: (faults.overshoots(shape) & ~few) | sides.alternates,
        Flag.TWO_HUMPS: faults.two_humps(shape) & ~few,
        Flag.TOO_ABRUPT: faults.negative(shape) & ~few,
        Flag.DISPLACED: faults.displaced(shape, mtf50),
        Flag.SMOOTHED: faults.smoothed(shape),
        Flag.NOISE_CORRELATED: sides.correlated,
        Flag.WINDOW_CUTS: (blur_px * WINDOW_REACHES > width_px) & (mode == "iso"),
    }, hidden


def _quieter(sides: Sides) -> Tensor:
    """Whether the bright side has certainly less noise than the dark one, (B,); rounding errors do not count."""
    bright = (sides.step > 0).long()[:, None]
    # A row's noise, the median over rows: a hot pixel makes one row loud.
    of_row = (sides.square / sides.count.clamp_min(1)).median(1).values
    of_bright, of_dark = (of_row.gather(1, side)[:, 0] for side in (bright, 1 - bright))
    error = 1.25 * torch.sqrt((2 / sides.count.sum(1)).sum(1))  # of the ratio's logarithm
    # What a filter or compression leaves of the noise says nothing of light.
    noisy = (of_dark > NOISELESS * sides.step**2) & (sides.block == 1)
    return noisy & (torch.log(of_bright / (QUIETER * of_dark)) < -CERTAIN * error)


def colours_apart(colours: Tensor, mtf50: Tensor) -> Tensor:
    """Whether the edges of colours (B, 3, H, W) certainly lie so far apart that MTF50 (B,) suffers, (B,).

    That is their luminance's: each colour that has a step counts by its share of it.
    """
    batch, _, height, width = colours.shape
    line = find_line(colours.flatten(0, 1))
    step = line.right - line.left
    rows = (line.right[:, None] - colours.flatten(0, 1).mean(2)) / step[:, None] * width
    scatter = _LEVELS * (rows - line.position_px).std(1) / math.sqrt(height)
    told = (line.position_px.mean(1), scatter.nan_to_num(0, 0, 0), step.abs())
    place, error, step = (each.view(batch, 3) for each in told)
    weight = torch.where(line.no_edge.view(batch, 3), 0.0, step * torch.tensor(LUMINANCE, dtype=step.dtype))
    weight = weight / weight.sum(1, keepdim=True)
    middle = (weight * place).sum(1, keepdim=True)
    spread, noise = (weight * (place - middle) ** 2).sum(1), (weight * error**2).sum(1)
    return (spread > COLOURS_CERTAIN**2 * noise) & (
        faults.cost_of_places(spread - noise, mtf50) > faults.DISPLACED
    )
