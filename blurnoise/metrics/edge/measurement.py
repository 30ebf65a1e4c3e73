"""Measurement of a slanted edge: its spatial frequency response, MTF50 and its kin, with intervals and doubts.

Domain: digital numbers of a linear picture; regions of one size are measured side by side.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import torch
from torch import Tensor

from blurnoise._core import checks
from blurnoise._core.limits import counted
from blurnoise._core.rng import LAST_SEED
from blurnoise.metrics.edge.correlation import block_weights, widening
from blurnoise.metrics.edge.flags import WITHHELD, Flag, words
from blurnoise.metrics.edge.geometry import is_horizontal, slope
from blurnoise.metrics.edge.iso import iso_response
from blurnoise.metrics.edge.response import Response, exact_response, intervals, numbers, peak, scatter
from blurnoise.metrics.edge.shape import (
    NOISY,
    Flags,
    Shape,
    colours_apart,
    doubts,
    locate,
    not_alone,
    shape_of,
    suspicions,
)
from blurnoise.metrics.edge.sides import Sides
from blurnoise.metrics.edge.spline import KNOT_PX, Spline
from blurnoise.metrics.estimate import Estimate
from blurnoise.metrics.values import Roi, read_regions

Mode = Literal["exact", "iso"]
Side = Literal["left", "right", "top", "bottom"]
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
    edges = [
        SlantedEdge(mode, frozenset({Flag.CLIPPED if finite else Flag.NOT_FINITE}))
        for finite in read.finite.tolist()
    ]
    usable, lying = read.finite & ~read.clipped, is_horizontal(read.values)
    for horizontal in (False, True):
        todo = (usable & (lying == horizontal)).nonzero()[:, 0].tolist()
        for start in range(0, len(todo), _TOGETHER):
            chosen = todo[start : start + _TOGETHER]
            values = read.values[chosen]
            values = values.mT.contiguous() if horizontal else values
            told = _measured(values, mode, horizontal, bootstrap, seed)
            if read.colours.shape[1] == 3:
                colours = read.colours[chosen]
                told = _with_colours(told, colours.mT if horizontal else colours)
            for index, edge in zip(chosen, told, strict=True):
                edges[index] = edge
    return edges if image.ndim == 4 else edges[0]


def _measured(values: Tensor, mode: Mode, horizontal: bool, bootstrap: int, seed: int) -> list[SlantedEdge]:
    """Measure near-vertical edges (B, H, W); horizontal: the regions were transposed."""
    found, flags = locate(values)
    edges = [SlantedEdge(mode, names) for names in _named(flags, len(values))]
    alike: dict[int, list[int]] = {}
    for index, block in enumerate(found.sides.block.tolist()):
        if not edges[index].flags & WITHHELD:
            alike.setdefault(block, []).append(index)
    for block, kept in alike.items():
        weights = block_weights(bootstrap, values.shape[1], block, seed) if bootstrap else None
        shape = shape_of(found.only(kept), block)
        wider = widening(values.shape[1], block)
        told = _told(values[kept], shape, mode, horizontal, weights, wider)
        for index, edge, doubtful in zip(kept, told, not_alone(shape).tolist(), strict=True):
            edges[index] = SlantedEdge(mode, frozenset({Flag.TWO_EDGES})) if doubtful else edge
    return edges


def _with_colours(edges: list[SlantedEdge], colours: Tensor) -> list[SlantedEdge]:
    """The edges, flagged where their colours (B, 3, H, W) lie apart."""
    doubted = colours_apart(
        colours, torch.tensor([edge.mtf50 for edge in edges], dtype=colours.dtype)
    ).tolist()
    flags = frozenset({Flag.NON_LINEAR_SUSPECTED})
    return [
        replace(edge, flags=edge.flags | flags) if doubtful else edge
        for edge, doubtful in zip(edges, doubted, strict=True)
    ]


def _told(
    values: Tensor, shape: Shape, mode: Mode, horizontal: bool, weights: Tensor | None, wider: float
) -> list[SlantedEdge]:
    """Read the numbers off each shape. weights: (n, H), of the rows in n resamples; wider: what these miss."""
    sides, rising = shape.sides, shape.sides.step > 0
    if mode == "exact":
        response = exact_response(shape.spline, sides, weights)
    else:
        facing_right = torch.where(rising[:, None, None], values, values.flip(2))
        response = iso_response(facing_right, sides.variance.mean(1), weights)
    scalars = numbers(response.power, response.spacing, peak(response), sides.level, sides.variance)
    scattered = scatter(response, scalars["mtf50"])
    against, other = suspicions(shape, mode, values.shape[2], scalars["mtf50"], scattered)
    flags = _named(against | doubts(scalars["mtf50"], scattered), len(values))
    ends = torch.stack([~rising, rising], dim=1).long()  # which side is dark, which bright
    levels, noises = sides.level.gather(1, ends).tolist(), sides.variance.gather(1, ends).tolist()
    tilts, flips = slope(shape.position_px).tolist(), (~rising).tolist()
    read = {name: value.tolist() for name, value in scalars.items()}
    power_at_0 = sides.power_at_0.tolist()
    frequencies, sfr = response.frequencies, response.power.clamp_min(0).sqrt()
    samples, ranges = _resamples(response, sides, ends, weights, scalars, wider)
    flags = [
        names | _by_interval(each, middle)
        for names, each, middle in zip(flags, ranges, read["mtf50"], strict=True)
    ]
    widened = [dict(each) for each in ranges]
    hidden = zip(other.likely.tolist(), other.largest.tolist(), other.lowered.tolist(), strict=True)
    for index, shares in enumerate(hidden):
        for name in ranges[index].keys() & {"mtf50", "mtf50p"}:
            widened[index][name] = _with_hidden(ranges[index][name], read[name][index], *shares)
    esf, lsf = _profiles(shape.spline, rising, sides)
    edges = []
    for index, names in enumerate(flags):
        (dark, bright), (noise_dark, noise_bright) = levels[index], noises[index]
        angle, side = _facing(tilts[index], flips[index], horizontal)
        edges.append(
            SlantedEdge(
                mode=mode,
                flags=names,
                angle_deg=angle,
                orientation="horizontal" if horizontal else "vertical",
                bright_side=side,
                mtf50=_reached(read["mtf50"][index]),
                mtf50p=_reached(read["mtf50p"][index]),
                mtf_nyquist=read["mtf_nyquist"][index],
                mtf_nyquist_2=read["mtf_nyquist_2"][index],
                mtf_nyquist_4=read["mtf_nyquist_4"][index],
                cnr=read["cnr"][index],
                edge_snr_db=read["edge_snr_db"][index],
                michelson=read["michelson"][index],
                dark=dark,
                bright=bright,
                noise_variance_dark=noise_dark,
                noise_variance_bright=noise_bright,
                noise_power_at_0=power_at_0[index],
                intervals=widened[index],
                noise_intervals=ranges[index],
                frequencies=frequencies[index],
                power=response.power[index],
                sfr=sfr[index],
                distance_px=shape.spline.distance_px[1:-1],
                esf=esf[index],
                lsf=lsf[index],
                resamples=samples[index],
            )
        )
    return edges


def _named(flags: Flags, batch: int) -> list[frozenset[Flag]]:
    raised = {flag: raised.tolist() for flag, raised in flags.items()}
    return [frozenset(flag for flag, where in raised.items() if where[index]) for index in range(batch)]


def _by_interval(ranges: Mapping[str, tuple[float, float]], mtf50: float) -> frozenset[Flag]:
    """Whether draws of rows scatter as far as the flag says, of which 95 % span four standard deviations."""
    low, high = ranges.get("mtf50", (mtf50, mtf50))
    wide = math.isfinite(mtf50) and not high - low <= 4 * NOISY * mtf50
    return frozenset({Flag.NOISE_DOMINATED}) if wide else frozenset()


def _with_hidden(
    ends: tuple[float, float], middle: float, likely: float, largest: float, lowered: float
) -> tuple[float, float]:
    """The interval with faults that may have raised the number by ``likely``, at most ``largest``, or lowered it."""
    low, high = ends
    if not math.isfinite(middle):
        return ends
    least = middle / (1 + likely) - math.hypot(middle - low, middle * (largest - likely))
    return least, middle + math.hypot(high - middle, middle * lowered)


def _reached(frequency: float) -> float:
    return frequency if math.isfinite(frequency) else math.nan


def _facing(tilt: float, flipped: bool, horizontal: bool) -> tuple[float, Side]:
    """Angle, degrees, and the bright side. tilt: px along the rows (of the transposed picture) per row."""
    sign = -1.0 if flipped else 1.0
    if horizontal:  # the normal, (x, y) and y down, is sign * (-tilt, 1)
        return math.degrees(math.atan2(-sign, -sign * tilt)), "top" if flipped else "bottom"
    return math.degrees(math.atan2(sign * tilt, sign)), "left" if flipped else "right"


def _profiles(spline: Spline, rising: Tensor, sides: Sides) -> tuple[Tensor, Tensor]:
    """Level at the spline's knots but the outermost, and its derivative as a share of the step, 1/px."""
    upward = torch.where(rising[:, None], spline.coefficients, 1 - spline.coefficients.flip(1))
    left, middle, right = upward[:, :-2], upward[:, 1:-1], upward[:, 2:]
    share = (left + 4 * middle + right) / 6
    dark = sides.level.amin(1, keepdim=True)
    return dark + sides.step.abs()[:, None] * share, (right - left) / (2 * KNOT_PX)


def _resamples(
    response: Response,
    sides: Sides,
    ends: Tensor,
    weights: Tensor | None,
    plain: dict[str, Tensor],
    wider: float,
) -> tuple[list[Resamples | None], list[dict[str, tuple[float, float]]]]:
    """The resamples of each region, and the intervals of its scalars."""
    if weights is None or response.resampled is None:
        return [None] * len(ends), [{} for _ in ends]
    level, variance = sides.resampled(weights)
    drawn = numbers(response.resampled, response.spacing[:, None], peak(response)[:, None], level, variance)
    limits = {name: each.tolist() for name, each in intervals(drawn, plain, wider).items()}
    samples: list[Resamples | None] = []
    for power, index, levels, variances in zip(response.resampled, ends, level, variance, strict=True):
        samples.append(Resamples(power, *levels[:, index].T, *variances[:, index].T))
    return samples, [
        {name: (each[index][0], each[index][1]) for name, each in limits.items()}
        for index in range(len(ends))
    ]
