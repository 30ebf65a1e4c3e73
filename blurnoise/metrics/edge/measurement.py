"""Measurement of a slanted edge: its spatial frequency response, MTF50 and its kin, with intervals and doubts.

Domain: digital numbers of a linear picture; regions of one size are measured side by side.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import torch
from torch import Tensor

from blurnoise._core import checks
from blurnoise._core.checks import counted
from blurnoise._core.rng import LAST_SEED
from blurnoise.metrics.edge.faults import Shape
from blurnoise.metrics.edge.flags import WITHHELD, Flag, words
from blurnoise.metrics.edge.geometry import is_horizontal, slope
from blurnoise.metrics.edge.iso import iso_response
from blurnoise.metrics.edge.response import (
    Response,
    block_weights,
    exact_response,
    intervals,
    numbers,
    peak,
    scatter,
    widening,
)
from blurnoise.metrics.edge.shape import (
    NOISY,
    Flags,
    colours_apart,
    locate,
    not_alone,
    shape_of,
    suspicions,
)
from blurnoise.metrics.edge.spline import KNOT_PX, knots_px
from blurnoise.metrics.estimate import Estimate
from blurnoise.metrics.values import Roi, read_regions

Mode = Literal["exact", "iso"]
Side = Literal["left", "right", "top", "bottom"]
_CROSSINGS = {"mtf50", "mtf50p"}  # NaN where there is none, and wider by what an edge may hide
_TOGETHER = 32  # regions in one go: their arrays stay in the cache
_NONE = torch.empty(0, dtype=torch.float64)


@dataclass(frozen=True)
class Resamples:
    """The same edge from n draws of its rows: what the interval of anything derived from it is made of.

    power: (n, F). dark, bright, noise_variance_dark, noise_variance_bright: (n,).
    """

    power: Tensor
    dark: Tensor
    bright: Tensor
    noise_variance_dark: Tensor
    noise_variance_bright: Tensor


@dataclass(frozen=True)
class SlantedEdge:
    """What one edge says. Frequencies in cycles/px along its normal; numbers that cannot be told are NaN.

    angle_deg: as in :mod:`blurnoise.charts`, 0° vertical and bright on the right, 90° bright at the top.
    mtf50, mtf50p: where the response is half of that at 0, half of its peak. dark, bright: levels without black
    level; cnr: their difference over the root of their mean noise variance, edge_snr_db: 20 log10 of it.
    noise_power_at_0: of the noise power spectrum at frequency 0, over the variance; 1 where noise is white.
    intervals: 95 % of each scalar by its name, by bootstrap over rows, or over blocks of them whose noise belongs
    together; inf where 50 % may never be reached. Those of mtf50 and mtf50p reach further, to what clips, tone
    curves and sharpening that cannot be told from this edge would have changed; noise_intervals are by noise alone,
    which is all that makes two edges of one chain differ.
    frequencies, power, sfr: (F,). In ``exact`` mode power is the squared modulus of the response less what noise
    adds to it: right on the average, hence below 0 where only noise is left; sfr is its root, at least 0.
    distance_px, esf, lsf: (K,), the edge's shape along its normal, bright at positive distances, lsf per px.
    """

    mode: Mode
    flags: frozenset[Flag]
    angle_deg: float = math.nan
    orientation: Literal["vertical", "horizontal"] | None = None
    bright_side: Side | None = None
    mtf50: float = math.nan
    mtf50p: float = math.nan
    mtf_nyquist: float = math.nan
    mtf_nyquist_2: float = math.nan
    mtf_nyquist_4: float = math.nan
    cnr: float = math.nan
    edge_snr_db: float = math.nan
    michelson: float = math.nan
    dark: float = math.nan
    bright: float = math.nan
    noise_variance_dark: float = math.nan
    noise_variance_bright: float = math.nan
    noise_power_at_0: float = math.nan
    intervals: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    noise_intervals: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    frequencies: Tensor = _NONE
    power: Tensor = _NONE
    sfr: Tensor = _NONE
    distance_px: Tensor = _NONE
    esf: Tensor = _NONE
    lsf: Tensor = _NONE
    resamples: Resamples | None = None

    def estimate(self, name: str) -> Estimate:
        """The scalar of that name with its interval, NaN without a bootstrap, and the flags of the edge."""
        low, high = self.intervals.get(name, (math.nan, math.nan))
        return Estimate(getattr(self, name), low, high, words(self.flags))


def slanted_edge(
    image: Tensor,
    *,
    mode: Mode = "exact",
    full_scale: float | None = None,
    black_level: float = 0.0,
    roi: Roi | None = None,
    bootstrap: int = 200,
    seed: int = 0,
) -> SlantedEdge | list[SlantedEdge]:
    """Measure the one edge that each region holds, wherever it lies in it and whichever way it faces.

    image: linear digital numbers, (H, W), (C, H, W) or (B, C, H, W), one or three channels (measured as their
    luminance), uint8, uint16 or float; a batch gives a list. full_scale: the largest number a pixel can hold, None
    for that of the type, 1 for floats. black_level: that of no light, in the same unit. roi: (left, top, width,
    height) of the region, px, of every picture. bootstrap: resamples for the intervals, 0 for none; they are drawn
    from ``seed``, the same for every region.

    ``mode="exact"`` puts a spline through every pixel at its own distance from the edge, within the blur's reach.
    ``mode="iso"`` takes the steps of ISO 12233 as sfrmat5 does, with their errors, to compare with such numbers.
    A region without a usable edge raises nothing: its numbers are NaN and its flags say why.

    Raises ``TypeError`` or ``ValueError`` for another type, shape or mode, values above ``full_scale``, a region
    outside the picture or below 8 x 8 px, and numbers outside their range.
    """
    checks.one_of("mode", mode, ("exact", "iso"))
    counted("bootstrap", bootstrap)
    checks.integer("seed", seed, 0, LAST_SEED)
    read = read_regions(image, full_scale=full_scale, black_level=black_level, roi=roi)
    unusable = {True: frozenset({Flag.CLIPPED}), False: frozenset({Flag.NOT_FINITE})}
    edges = [SlantedEdge(mode, unusable[finite]) for finite in read.finite.tolist()]
    usable, lying = read.finite & ~read.clipped, is_horizontal(read.values)
    for horizontal in (False, True):
        todo = (usable & (lying == horizontal)).nonzero()[:, 0].tolist()
        for start in range(0, len(todo), _TOGETHER):
            chosen = todo[start : start + _TOGETHER]
            values, colours = read.values[chosen], read.colours[chosen]
            if horizontal:
                values, colours = values.mT.contiguous(), colours.mT
            measured = _measured(values, colours, mode, horizontal, bootstrap, seed)
            for index, edge in zip(chosen, measured, strict=True):
                edges[index] = edge
    return edges if image.ndim == 4 else edges[0]


def _measured(
    values: Tensor, colours: Tensor, mode: Mode, horizontal: bool, bootstrap: int, seed: int
) -> list[SlantedEdge]:
    """Measure near-vertical edges (B, H, W) of colours (B, C, H, W); horizontal: the regions were transposed."""
    found, flags = locate(values)
    edges = [SlantedEdge(mode, names) for names in _by_region(flags, len(values))]
    alike: dict[int, list[int]] = {}
    for index, block in enumerate(found.sides.block.tolist()):
        if not edges[index].flags & WITHHELD:
            alike.setdefault(block, []).append(index)
    for block, kept in alike.items():
        weights = block_weights(bootstrap, values.shape[1], block, seed) if bootstrap else None
        shape = shape_of(found.only(kept), block)
        wider = widening(values.shape[1], block)
        measured = _edges(values[kept], colours[kept], shape, mode, horizontal, weights, wider)
        for index, edge, doubtful in zip(kept, measured, not_alone(shape).tolist(), strict=True):
            edges[index] = SlantedEdge(mode, frozenset({Flag.TWO_EDGES})) if doubtful else edge
    return edges


def _edges(
    values: Tensor,
    colours: Tensor,
    shape: Shape,
    mode: Mode,
    horizontal: bool,
    weights: Tensor | None,
    wider: float,
) -> list[SlantedEdge]:
    """Read the numbers off each shape. weights: (n, H), of the rows in n resamples; wider: what these miss."""
    sides, rising = shape.sides, shape.sides.step > 0
    if mode == "exact":
        response = exact_response(shape.spline, sides, weights)
    else:
        facing_right = torch.where(rising[:, None, None], values, values.flip(2))
        response = iso_response(facing_right, sides.variance.mean(1), weights)
    scalars = numbers(response.power, response.spacing, peak(response), sides.level, sides.variance)
    mtf50 = scalars["mtf50"]
    flags, hidden = suspicions(shape, mode, values.shape[2], mtf50, scatter(response, mtf50))
    if colours.shape[1] == 3:
        flags[Flag.NON_LINEAR_SUSPECTED] |= colours_apart(colours, mtf50)
    ends = torch.stack([~rising, rising], dim=1).long()  # which side is dark, which bright
    samples, noise_intervals = _resamples(response, shape, ends, weights, scalars, wider)
    if noise_intervals:  # 95 % span four standard deviations
        low, high = noise_intervals["mtf50"].unbind(1)
        flags[Flag.NOISE_DOMINATED] |= mtf50.isfinite() & ~(high - low <= 4 * NOISY * mtf50)
    dark, bright = sides.level.gather(1, ends).unbind(1)
    noise_dark, noise_bright = sides.variance.gather(1, ends).unbind(1)
    told = {name: torch.where(scalars[name].isfinite(), scalars[name], torch.nan) for name in _CROSSINGS}
    told |= {"dark": dark, "bright": bright, "noise_power_at_0": sides.power_at_0}
    told |= {"noise_variance_dark": noise_dark, "noise_variance_bright": noise_bright}
    columns = {name: value.tolist() for name, value in (scalars | told).items()}
    limits = {name: each.tolist() for name, each in noise_intervals.items()}
    frequencies, sfr = response.frequencies, response.power.clamp_min(0).sqrt()
    distance_px, esf, lsf = _profiles(shape)
    tilts, flips = slope(shape.position_px).tolist(), (~rising).tolist()
    edges = []
    for index, names in enumerate(_by_region(flags, len(values))):
        angle_deg, bright_side = _facing(tilts[index], flips[index], horizontal)
        scalar = {name: column[index] for name, column in columns.items()}
        by_noise = {name: (each[index][0], each[index][1]) for name, each in limits.items()}
        edges.append(
            SlantedEdge(
                mode=mode,
                flags=names,
                angle_deg=angle_deg,
                orientation="horizontal" if horizontal else "vertical",
                bright_side=bright_side,
                intervals=_with_hidden(by_noise, scalar, hidden[:, index].tolist()),
                noise_intervals=by_noise,
                frequencies=frequencies[index],
                power=response.power[index],
                sfr=sfr[index],
                distance_px=distance_px,
                esf=esf[index],
                lsf=lsf[index],
                resamples=samples[index],
                **scalar,
            )
        )
    return edges


def _by_region(flags: Flags, batch: int) -> list[frozenset[Flag]]:
    raised = {flag: raised.tolist() for flag, raised in flags.items()}
    return [frozenset(flag for flag, where in raised.items() if where[index]) for index in range(batch)]


def _with_hidden(
    intervals: Mapping[str, tuple[float, float]], scalars: Mapping[str, float], hidden: list[float]
) -> dict[str, tuple[float, float]]:
    """The intervals, those of MTF50 and MTF50P with the faults that may have raised or lowered them."""
    likely, largest, lowered = hidden
    wider = dict(intervals)
    for name in _CROSSINGS & intervals.keys():
        (low, high), middle = intervals[name], scalars[name]
        if math.isfinite(middle):
            least = middle / (1 + likely) - math.hypot(middle - low, middle * (largest - likely))
            wider[name] = least, middle + math.hypot(high - middle, middle * lowered)
    return wider


def _facing(tilt: float, flipped: bool, horizontal: bool) -> tuple[float, Side]:
    """Angle, degrees, and the bright side. tilt: px along the rows (of the transposed picture) per row."""
    sign = -1.0 if flipped else 1.0
    if horizontal:  # the normal, (x, y) and y down, is sign * (-tilt, 1)
        return math.degrees(math.atan2(-sign, -sign * tilt)), "top" if flipped else "bottom"
    return math.degrees(math.atan2(sign * tilt, sign)), "left" if flipped else "right"


def _profiles(shape: Shape) -> tuple[Tensor, Tensor, Tensor]:
    """The spline's knots but the outermost, the level there, and its derivative as a share of the step, 1/px."""
    sides, coefficients = shape.sides, shape.spline.coefficients
    upward = torch.where(sides.step[:, None] > 0, coefficients, 1 - coefficients.flip(1))
    left, middle, right = upward[:, :-2], upward[:, 1:-1], upward[:, 2:]
    share = (left + 4 * middle + right) / 6
    level = sides.level.amin(1)[:, None] + sides.step.abs()[:, None] * share
    return knots_px(coefficients.shape[1])[1:-1], level, (right - left) / (2 * KNOT_PX)


def _resamples(
    response: Response,
    shape: Shape,
    ends: Tensor,
    weights: Tensor | None,
    plain: dict[str, Tensor],
    wider: float,
) -> tuple[list[Resamples | None], dict[str, Tensor]]:
    """The resamples of each region, and the intervals (B, 2) of its scalars."""
    if response.resampled is None or weights is None:
        return [None] * len(ends), {}
    level, variance = shape.sides.resampled(weights)
    drawn = numbers(response.resampled, response.spacing[:, None], peak(response)[:, None], level, variance)
    samples: list[Resamples | None] = [
        Resamples(power, *levels[:, index].T, *variances[:, index].T)
        for power, index, levels, variances in zip(response.resampled, ends, level, variance, strict=True)
    ]
    return samples, intervals(drawn, plain, wider)
