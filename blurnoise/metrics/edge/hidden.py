"""Faults that an edge may hide, and their effect on MTF50.

Clipping, tone curves and sharpening of any strength are fitted to the difference from a Gaussian edge. A significant
fault raises a flag; one that noise or blur may hide widens the interval of MTF50.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import avg_pool1d, conv1d, pad

from blurnoise.metrics.edge.faults import Shape
from blurnoise.metrics.edge.spline import knots_px

MASK_PX = 0.7  # of the sharpening's Gaussian
# Sigma of a Gaussian: sharper edges are those of the pixel alone, and the table's formulas divide by it.
SHARPEST_PX = 0.05
MATTERS = 0.015  # share of MTF50 that a fault must change before it raises a flag
MISFIT = (
    0.004  # of the step: difference from a Gaussian edge with the fault from which on the fault is ruled out
)
WITHIN = 1.96  # standard errors of a strength that the interval covers
FINEST, COARSEST, MTF50S = 0.6, 1e-3, 17  # cycles/px, of the table of costs, in even ratios
WEAKEST, STRONGEST, PER_UNIT = -4.0, 6.0, 4  # of that table, in strengths


def gaussian_edge(mtf50: Tensor, place_px: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Of a Gaussian over square pixels of that MTF50 (...), or the sharpest: sigma, px, (..., 1), its level, 0 to 1,
    at ``place_px`` (K,) from the edge, (..., K), and the level behind the sharpening's Gaussian.

    >>> sigma, level, _ = gaussian_edge(torch.tensor(0.2), torch.tensor([-20.0, 0.0, 20.0]))
    >>> level.round(decimals=3).tolist()  # from dark to bright, half-way on the edge
    [0.0, 0.5, 1.0]
    """
    squared = torch.log((2 * torch.sinc(mtf50)).clamp_min(1)) / (2 * (math.pi * mtf50) ** 2)
    sigma = squared.clamp_min(SHARPEST_PX**2).sqrt()[..., None]
    both = torch.stack([sigma, torch.sqrt(sigma**2 + MASK_PX**2)])
    ends = torch.stack([(place_px + 0.5) / both, (place_px - 0.5) / both])
    areas = ends * torch.special.ndtr(ends) + torch.exp(-ends * ends / 2) / math.sqrt(2 * math.pi)
    level, softer = both * (areas[0] - areas[1])
    return sigma, level, softer


def _clipped(level: Tensor, _: Tensor, u: Tensor) -> Tensor:
    """Clipped by 5 % of the step, below or above."""
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
class Fault:
    """A fault: what it makes of a level and of a softer one, by its strength u (..., 1).

    low, high: range of u; 0 is an honest edge. parity: 1 if it makes the edge's halves unequal, which no blur does,
    else -1. usual: the largest u that is assumed if the edge has no trace of it.

    >>> clipped, level = FAULTS[0], torch.tensor([0.0, 0.05, 0.525, 1.0])
    >>> clipped.change(level, level, torch.tensor([1.0])).round(decimals=2)  # below 5 % of the step
    tensor([0.0000, 0.0000, 0.5000, 1.0000])
    """

    change: Callable[[Tensor, Tensor, Tensor], Tensor]
    parity: int
    low: float
    high: float
    usual: float


FAULTS = (
    Fault(_clipped, 1, -4.0, 4.0, 3.0),
    Fault(_bent, 1, -1.2, 1.2, 1.1),
    Fault(_clipped_twice, -1, 0.0, 3.0, 1.1),
    Fault(_s_shaped, -1, 0.0, 2.0, 1.1),
    Fault(_sharpened, -1, 0.0, 6.0, 1.1),
)


def hidden_faults(shape: Shape, mtf50: Tensor) -> tuple[Tensor, Tensor]:
    """Whether the edge's halves are significantly unequal, (B,), and the effect of hidden faults, (3, B).

    The effect is the share of the measured ``mtf50`` (B,) by which they likely raised it, at most raised it, and at
    most lowered it.

    >>> from blurnoise import charts
    >>> from blurnoise.metrics.edge.measurement import shape_of
    >>> from blurnoise.metrics.edge.position import find_line, measure_sides
    >>> picture = charts.slanted_edge(60, 60)[0].double()
    >>> line = find_line(picture).position_px
    >>> sides, upright = measure_sides(picture, line)
    >>> shape = shape_of(upright, line, sides, block=1)
    >>> unequal, effect = hidden_faults(shape, torch.tensor([0.6], dtype=torch.float64))
    >>> unequal.tolist(), effect.shape
    ([False], torch.Size([3, 1]))
    """
    mtf50 = mtf50.clamp(COARSEST, FINEST)
    position = torch.log(mtf50 / COARSEST) * ((MTF50S - 1) / math.log(FINEST / COARSEST))
    index = position.long().clamp_max(MTF50S - 2)
    table = cost_table()
    costs = torch.lerp(table[:, index], table[:, index + 1], (position - index)[:, None])
    traces = [_traced(fault, cost, shape, mtf50) for fault, cost in zip(FAULTS, costs, strict=True)]
    unequal, within = (torch.stack(each) for each in zip(*traces, strict=True))
    likely = within[:, 0].amax(0).clamp_min(0)
    largest, lowered = torch.maximum(likely, within.amax((0, 1))), -within.amin((0, 1)).clamp_max(0)
    return unequal.any(0), torch.stack([likely, largest, lowered])


def _traced(fault: Fault, costs: Tensor, shape: Shape, mtf50: Tensor) -> tuple[Tensor, Tensor]:
    """Whether ``fault`` certainly made the edge's halves unequal, (B,), and its cost: likely, at the ends, (3, B)."""
    free = shape.free
    knots = knots_px(free.shape[1])
    _, level, _ = gaussian_edge(mtf50, knots)
    slope = torch.gradient(level, dim=1)[0]
    # Another place and height of the step explain unequal halves; another width and contrast, equal ones.
    explained = (slope, torch.ones_like(level)) if fault.parity > 0 else (knots * slope, level - 0.5)
    basis = torch.linalg.qr(torch.stack([each * free for each in explained], dim=2)).Q

    def half(values: Tensor) -> Tensor:
        """The part of ``values`` (B, K) of the fault's parity, without what is explained."""
        part = (values + fault.parity * values.flip(-1)) / 2 * free
        left: Tensor = part - (basis @ (basis.mT @ part[..., None]))[..., 0]
        return left

    def changes(u: Tensor) -> Tensor:
        """By the fault of strength u, (B,), at the MTF50 that it leaves, (B, K)."""
        _, before, softer = gaussian_edge(mtf50 / (1 + _at(costs, u)), knots)
        return half(fault.change(before, softer, u[:, None]) - level)

    off = half(_at_knots(shape.spline.coefficients) - level)
    if fault.parity > 0:
        off = torch.where(shape.sides.step < 0, -1, 1)[:, None] * off
    unit = changes(torch.ones_like(mtf50))
    weight = unit / (unit**2).sum(-1, keepdim=True).clamp_min(1e-12)
    error = shape.error(_at_knots(weight)[..., None])[:, 0]
    first = (weight * off).sum(-1)
    guess = first.clamp(fault.low, fault.high)
    left = off - changes(guess)
    more = (weight * left).sum(-1)
    # By what more is seen of a fault per strength, 1 at 1: between there, or 0, and the guess.
    at = (guess > 0).to(guess)
    steepness = ((first - more - at) / (guess - at)).clamp(0.25, 4.0)
    # At 1, and at 2, where the range of S-shaped curves ends, it is taken to be 1.
    steepness = torch.where(((guess - at).abs() < 1e-3) | (guess - at == 1), 1.0, steepness)
    u, u_error = guess + more / steepness, error / steepness
    if fault.parity < 0:
        # The fault fits if what it leaves unexplained, in means over 5 knots, is noise or small.
        windows = shape.covariance.unfold(1, 5, 1).unfold(2, 5, 1).diagonal(dim1=1, dim2=2)
        by_noise = shape.certain(free.sum(1))[:, None] * windows.mean((1, 2)).clamp_min(0).sqrt()
        misfit = avg_pool1d(left - more[:, None] * unit, 5, stride=1, padding=2).abs()
        fits = (misfit <= pad(by_noise, (2, 2), "replicate").clamp_min(MISFIT)).all(-1)
        u, u_error = torch.where(fits, u, 0.0), torch.where(fits, u_error, 0.0)
    trace = u.abs() > WITHIN * u_error
    low = torch.where(trace, u.new_tensor(fault.low), max(fault.low, -fault.usual))
    high = torch.where(trace, u.new_tensor(fault.high), min(fault.high, fault.usual))
    strengths = (u, u - WITHIN * u_error, u + WITHIN * u_error)
    within = torch.stack([_at(costs, torch.minimum(torch.maximum(each, low), high)) for each in strengths])
    sure = first.abs() > shape.certain(2) * error  # of two kinds of fault
    matters = _at(costs, torch.minimum(u.abs(), high)) > MATTERS
    return sure & matters & (fault.parity > 0), within


def _at_knots(coefficients: Tensor) -> Tensor:
    """A cubic spline's values at its knots."""
    kernel = coefficients.new_tensor([[[1 / 6, 4 / 6, 1 / 6]]])
    wide = torch.cat([coefficients[:, :1], coefficients, coefficients[:, -1:]], dim=1)
    return conv1d(wide[:, None], kernel)[:, 0]


def _at(costs: Tensor, u: Tensor) -> Tensor:
    """The costs (B, U) of strengths (B,)."""
    position = (u - WEAKEST) * PER_UNIT
    index = position.long().clamp(0, costs.shape[1] - 2)
    row = torch.arange(len(u))
    return torch.lerp(costs[row, index], costs[row, index + 1], position - index)


@cache
def cost_table() -> Tensor:
    """Relative change of MTF50 by each fault, (F, M, U): faults, MTF50 measured with the fault, strengths.

    >>> cost_table().shape == (len(FAULTS), MTF50S, (STRONGEST - WEAKEST) * PER_UNIT + 1)
    True
    """
    mtf50 = torch.logspace(math.log10(COARSEST), math.log10(FINEST), MTF50S, dtype=torch.float64)
    sigma, _, _ = gaussian_edge(mtf50, torch.zeros(1, dtype=torch.float64))
    step = (sigma / 12).clamp_min(0.125)
    position_px = step * torch.arange(-80, 81)
    _, level, softer = gaussian_edge(mtf50, position_px)
    count = round((STRONGEST - WEAKEST) * PER_UNIT) + 1
    strength = torch.linspace(WEAKEST, STRONGEST, count, dtype=torch.float64)
    table = torch.empty(len(FAULTS), MTF50S, count, dtype=torch.float64)
    for fault, into in zip(FAULTS, table, strict=True):
        u = strength.clamp(fault.low, fault.high)[:, None, None]
        line = torch.diff(fault.change(level, softer, u))
        mtf50_after = mtf50.expand(line.shape[:2])
        for _ in range(6):  # of Newton's steps
            angle = math.pi * mtf50_after
            wave = 2 * angle[..., None] * (position_px[:, 1:] + position_px[:, :-1]) / 2
            response = torch.hypot((line * torch.cos(wave)).sum(-1), (line * torch.sin(wave)).sum(-1))
            response = response / torch.sinc(mtf50_after * step[:, 0])
            steepness = (2 * angle * sigma[:, 0]) ** 2 + 1 - angle / torch.tan(angle)
            mtf50_after = (mtf50_after * (1 + torch.log(2 * response) / steepness)).clamp(max=0.95)
        honest = mtf50_after[round(-WEAKEST * PER_UNIT)]
        for column, after in enumerate(mtf50_after):
            share = np.interp(mtf50.log().numpy(), after.log().numpy(), (after / honest - 1).numpy())
            into[:, column] = torch.from_numpy(share)
    return table
