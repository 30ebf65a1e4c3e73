"""Measurement of a slanted edge: spatial frequency response, MTF50 and related numbers, with intervals and flags.

Domain: digital numbers of a linear picture; regions of one size are measured side by side.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import Any, Literal

import torch
from torch import Tensor

from blurnoise._core import checks
from blurnoise._core.rng import LAST_SEED
from blurnoise.metrics.edge import faults, position, response
from blurnoise.metrics.edge.faults import Shape
from blurnoise.metrics.edge.hidden import hidden_faults
from blurnoise.metrics.edge.position import Sides, Upright, slope
from blurnoise.metrics.edge.response import EdgeResponse
from blurnoise.metrics.edge.spline import KNOT_PX, LINE_ORDER, knots_px, refine
from blurnoise.metrics.values import Estimate, Roi, read_regions

Mode = Literal["exact", "iso"]
Side = Literal["left", "right", "top", "bottom"]
LARGEST_GAP_PX = {"exact": 0.55, "iso": 0.3}
"""Along the normal, without a sample: a gap of 0.5 px still shows all below 1 cycle/px, a bin of 1/4 px does not."""
WINDOW_REACHES = 10  # width of a region that the standard's window needs, over the blur's reach
NOISY = 0.08  # relative standard deviation of MTF50 from which on noise dominates
_CROSSINGS = {"mtf50", "mtf50p"}  # NaN if there is no crossing; their intervals include hidden faults
_TOGETHER = 32  # regions per pass, so that their arrays stay in the cache
_NONE = torch.empty(0, dtype=torch.float64)


class Flag(Enum):
    """A reason to doubt a measured edge; with those in ``WITHHELD`` all numbers are NaN.

    >>> from blurnoise import charts
    >>> edge = slanted_edge(charts.flat_patch(60, 60)[0], bootstrap=0)
    >>> [(flag.name, flag.value) for flag in edge.flags]
    [('NO_EDGE', 'no step stands out of the noise')]
    """

    NOT_FINITE = "the region holds NaN or Inf"
    CLIPPED = "more than 0.5 % of the pixels stand at black or at full scale"
    NO_EDGE = "no step stands out of the noise"
    TWO_EDGES = "more than one edge, or other structure, beside the edge"
    EDGE_LEAVES_REGION = "the edge does not cross the region from end to end"
    REGION_TOO_SMALL = "no flat level beside the edge: the blur fills the region"
    TOO_FEW_PHASES = "the rows cut the edge at too few positions within a pixel"
    NEVER_REACHES_50 = "the response stays above 50 % up to 1 cycle/px"
    NOISE_DOMINATED = "noise moves MTF50 by more than 10 % (one standard deviation)"
    SHARPENED = "the edge overshoots its sides, or noise alternates, which no lens does: sharpening"
    TWO_HUMPS = "the line spread has two humps: two edges side by side, or motion that lingers"
    TOO_ABRUPT = "the edge is sharper than its pixels allow: clipped, or sharpened and cut"
    DISPLACED = "rows are displaced against each other: jitter, which lowers the response"
    SMOOTHED = "the edge is noisier than its sides allow: denoised, compressed, clipped, or a tone curve"
    NOISE_CORRELATED = "noise is correlated over too many rows for its intervals: columns, or a strong filter"
    WINDOW_CUTS = "the standard's window cuts into the blur; the region should be wider"
    NON_LINEAR_SUSPECTED = "a lopsided edge or a quieter bright side: clipping, a tone curve, shifted colours"


WITHHELD = frozenset({Flag.NOT_FINITE, Flag.CLIPPED, Flag.NO_EDGE, Flag.TWO_EDGES}) | {
    Flag.EDGE_LEAVES_REGION,
    Flag.REGION_TOO_SMALL,
}
"""With one of these every number is NaN."""


@dataclass(frozen=True)
class Resamples:
    """Bootstrap resamples: the same edge from n draws of its rows, for the intervals of derived numbers.

    power: (n, F). dark, bright, noise_variance_dark, noise_variance_bright: (n,).

    >>> from blurnoise import charts
    >>> edge = slanted_edge(charts.slanted_edge(60, 60)[0], bootstrap=30)
    >>> len(edge.resamples.dark)
    30
    """

    power: Tensor
    dark: Tensor
    bright: Tensor
    noise_variance_dark: Tensor
    noise_variance_bright: Tensor


@dataclass(frozen=True)
class SlantedEdge:
    """The measurement of one edge. Frequencies in cycles/px along its normal; unavailable numbers are NaN.

    angle_deg: as in :mod:`blurnoise.charts`, 0° vertical and bright on the right, 90° bright at the top.
    mtf50, mtf50p: frequency where the response is half of the response at 0, half of its peak. dark, bright: levels
    above the black level; cnr: their difference over the root of their mean noise variance, edge_snr_db: 20 log10
    cnr. noise_power_at_0: noise power spectrum at frequency 0 over the variance; 1 for white noise.
    intervals: 95 % interval of each scalar by name, by bootstrap over rows, or over blocks of rows with correlated
    noise; inf if the response may never reach 50 %. Those of mtf50 and mtf50p are wider: they include the changes by
    clipping, tone curves and sharpening that the edge cannot exclude. noise_intervals are by noise alone, the only
    difference between two edges of one camera.
    frequencies, power, sfr: (F,). In ``exact`` mode power is the squared modulus of the response less the power of
    noise: it has no bias, hence it is below 0 where only noise is left; sfr is its root, at least 0.
    distance_px, esf, lsf: (K,), the edge's shape along its normal, bright at positive distances, lsf per px.

    >>> from blurnoise import charts
    >>> edge = slanted_edge(charts.slanted_edge(60, 60, dark=0.1, bright=0.8)[0], bootstrap=0)
    >>> round(edge.dark, 2), round(edge.bright, 2), round(edge.mtf_nyquist, 2)  # at 1/2 cycle/px, of a pixel 2/pi
    (0.1, 0.8, 0.64)
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
        """The scalar with this name, its interval (NaN without a bootstrap) and the flags of the edge; "noiseless" is
        added to a ratio to noise if there is no noise."""
        value, flags = getattr(self, name), frozenset(flag.name.lower() for flag in self.flags)
        if name in ("cnr", "edge_snr_db") and value == math.inf:
            return Estimate(value, flags=flags | {"noiseless"})
        return Estimate(value, *self.intervals.get(name, (math.nan, math.nan)), flags)


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
    """Measure the one edge in each region, at any place and in any direction.

    image: linear digital numbers, (H, W), (C, H, W) or (B, C, H, W), one or three channels (measured as their
    luminance), uint8, uint16 or float; a batch returns a list. full_scale: the largest value of a pixel; None: the
    largest of the type, 1 for floats. black_level: value without light, in the same unit. roi: (left, top, width,
    height) of the region, px, of every picture. bootstrap: number of resamples for the intervals, 0 for no intervals;
    they are drawn from ``seed``, the same for every region.

    ``mode="exact"`` puts a spline through every pixel at its own distance from the edge, within the blur's reach.
    ``mode="iso"`` takes the steps of ISO 12233:2023 (4th edition: an edge of 5th order, Tukey's window) as sfrmat5
    does, with their errors, to compare with such numbers.
    A region without a usable edge is no error: its numbers are NaN and its flags give the reason.

    Raises ``TypeError`` or ``ValueError`` for another type, shape or mode, values above ``full_scale``, a region
    outside the picture or below 8 x 8 px, and numbers outside their range.

    >>> from blurnoise import charts
    >>> edge = slanted_edge(charts.slanted_edge(60, 60, angle_deg=5.0)[0], bootstrap=0)
    >>> round(edge.mtf50, 2), round(edge.angle_deg, 2), edge.bright_side  # a pixel's own sinc is 1/2 at 0.603
    (0.6, 5.0, 'right')
    """
    checks.one_of("mode", mode, ("exact", "iso"))
    checks.counted("bootstrap", bootstrap)
    checks.integer("seed", seed, 0, LAST_SEED)
    read = read_regions(image, full_scale=full_scale, black_level=black_level, roi=roi)
    edges = [
        SlantedEdge(mode, frozenset({Flag.CLIPPED if each else Flag.NOT_FINITE})) for each in read.finite
    ]
    usable = read.finite & ~read.clipped
    # An edge is near horizontal if a plane through the region is steeper down than across.
    lying = slope(read.values.mean(2)).abs() > slope(read.values.mean(1)).abs()
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
    line = position.find_line(values)
    sides, upright = position.measure_sides(values, line.position_px)
    whole = ~line.no_edge & ~line.leaves
    withheld = {
        Flag.NO_EDGE: line.no_edge,
        Flag.TWO_EDGES: ~line.no_edge & (line.structured | (whole & sides.structured)),
        Flag.EDGE_LEAVES_REGION: ~line.no_edge & line.leaves,
        Flag.REGION_TOO_SMALL: whole & ~line.structured & sides.too_small,
    }
    edges = [SlantedEdge(mode, names) for names in _by_region(withheld)]
    alike: dict[int, list[int]] = {}
    for index, block in enumerate(sides.block.tolist()):  # regions with equal blocks share their resamples
        if not edges[index].flags:
            alike.setdefault(block, []).append(index)
    for block, kept in alike.items():
        zone, beside = (tuple(each[kept] for each in vars(record).values()) for record in (upright, sides))
        shape = shape_of(Upright(*zone), line.position_px[kept], Sides(*beside), block)
        weights = response.block_weights(bootstrap, values.shape[1], block, seed) if bootstrap else None
        measured = _edges(shape, values[kept], colours[kept], mode, horizontal, weights)
        for index, edge in zip(kept, measured, strict=True):
            edges[index] = edge
    return edges


def shape_of(upright: Upright, position_px: Tensor, sides: Sides, block: int) -> Shape:
    """Fit the edges' splines and lines, from the dark area of every row within reach; block: rows drawn together.

    >>> from blurnoise import charts
    >>> picture = charts.slanted_edge(60, 60)[0].double()
    >>> line = position.find_line(picture).position_px
    >>> sides, upright = position.measure_sides(picture, line)
    >>> shape = shape_of(upright, line, sides, block=1)
    >>> bool(faults.overshoots(shape)), bool(faults.two_humps(shape))  # an honest edge
    (False, False)
    """
    zone = upright.within(int(sides.reach_px.max().ceil()) + 2)
    scaled = sides.scaled(zone, position_px)
    columns = scaled.shape[2]
    away = torch.arange(columns) - columns // 2
    own = (zone.inside > 0) & (away.abs() <= sides.reach_px.ceil()[:, None, None] + 1)
    dark_px = columns - torch.where(own, scaled, (away > 0).to(scaled)).sum(2)
    again = position.smooth(zone.first + dark_px, order=LINE_ORDER)
    noise = sides.variance / sides.step[:, None] ** 2
    spline, line = refine(replace(zone, values=scaled), again, sides.reach_px, noise)
    if block > 1:  # the spline's own covariance assumes white noise
        spline = replace(spline, covariance=spline.bootstrapped(block))
    return Shape(sides, line, spline)


def _edges(
    shape: Shape, values: Tensor, colours: Tensor, mode: Mode, horizontal: bool, weights: Tensor | None
) -> list[SlantedEdge]:
    """Compute the numbers of each shape. weights: (n, H), of the rows in n resamples."""
    sides, rising = shape.sides, shape.sides.step > 0
    if mode == "exact":
        curve = response.exact_response(shape.spline, sides, weights)
    else:
        facing_right = torch.where(rising[:, None, None], values, values.flip(2))
        curve = response.iso_response(facing_right, sides.variance.mean(1), weights)
    peak = curve.peak()
    scalars = response.numbers(curve.power, curve.spacing, peak, sides.level, sides.variance)
    mtf50 = scalars["mtf50"]
    flags, hidden = _doubts(shape, curve, colours, mode, mtf50)
    ends = torch.stack([~rising, rising], dim=1).long()  # which side is dark, which bright
    samples: list[Resamples | None] = [None] * len(ends)
    limits: dict[str, Any] = {}
    if curve.resampled is not None and weights is not None:
        level, variance = sides.resampled(weights)
        drawn = response.numbers(curve.resampled, curve.spacing[:, None], peak[:, None], level, variance)
        by_noise = response.intervals(drawn, scalars, response.widening(values.shape[1], int(sides.block[0])))
        low, high = by_noise["mtf50"].unbind(1)  # 95 % span four standard deviations
        flags[Flag.NOISE_DOMINATED] |= mtf50.isfinite() & ~(high - low <= 4 * NOISY * mtf50)
        limits = {name: each.tolist() for name, each in by_noise.items()}
        samples = [
            Resamples(power, *levels[:, index].T, *variances[:, index].T)
            for power, index, levels, variances in zip(curve.resampled, ends, level, variance, strict=True)
        ]
    dark, bright = sides.level.gather(1, ends).unbind(1)
    noise_dark, noise_bright = sides.variance.gather(1, ends).unbind(1)
    scalars |= {name: scalars[name].where(scalars[name].isfinite(), torch.nan) for name in _CROSSINGS}
    scalars |= {"dark": dark, "bright": bright, "noise_power_at_0": sides.power_at_0}
    scalars |= {"noise_variance_dark": noise_dark, "noise_variance_bright": noise_bright}
    columns: dict[str, Any] = {name: value.tolist() for name, value in scalars.items()}
    coefficients = shape.spline.coefficients
    upward = torch.where(rising[:, None], coefficients, 1 - coefficients.flip(1))
    left, middle, right = upward[:, :-2], upward[:, 1:-1], upward[:, 2:]
    columns |= {
        "frequencies": curve.frequencies,
        "power": curve.power,
        "sfr": curve.power.clamp_min(0).sqrt(),
        "esf": dark[:, None] + (bright - dark)[:, None] * (left + 4 * middle + right) / 6,
        "lsf": (right - left) / (2 * KNOT_PX),
        "resamples": samples,
    }
    tilts, signs = slope(shape.position_px).tolist(), sides.step.sign().tolist()
    edges = []
    for index, names in enumerate(_by_region(flags)):
        if Flag.TWO_EDGES in names:
            edges.append(SlantedEdge(mode, frozenset({Flag.TWO_EDGES})))
            continue
        row = {name: column[index] for name, column in columns.items()}
        tilt, sign = tilts[index], signs[index]
        if horizontal:  # transposed: the normal (x, y), y down, is sign * (-tilt, 1)
            row["angle_deg"] = math.degrees(math.atan2(-sign, -sign * tilt))
            row["bright_side"] = "top" if sign < 0 else "bottom"
        else:
            row["angle_deg"] = math.degrees(math.atan2(sign * tilt, sign))
            row["bright_side"] = "left" if sign < 0 else "right"
        row["noise_intervals"] = {name: (each[index][0], each[index][1]) for name, each in limits.items()}
        row["intervals"] = _with_hidden(row, hidden[:, index].tolist())
        row["orientation"] = "horizontal" if horizontal else "vertical"
        row["distance_px"] = knots_px(coefficients.shape[1])[1:-1]
        edges.append(SlantedEdge(mode, names, **row))
    return edges


def _doubts(
    shape: Shape, curve: EdgeResponse, colours: Tensor, mode: Mode, mtf50: Tensor
) -> tuple[dict[Flag, Tensor], Tensor]:
    """Regions for which each flag is raised, (B,) bool; and the effect of hidden faults on MTF50, (3, B)."""
    sides = shape.sides
    enough = position.largest_phase_gap_px(shape.position_px) <= LARGEST_GAP_PX[mode]
    blur_px = (sides.reach_px - position.REACH_PX) / position.REACH_FACTOR
    unequal, hidden = hidden_faults(shape, mtf50)
    flags = {
        Flag.TWO_EDGES: faults.structured(shape),
        Flag.NEVER_REACHES_50: torch.isinf(mtf50),
        Flag.NOISE_DOMINATED: curve.scatter(mtf50) > NOISY,
        Flag.TOO_FEW_PHASES: ~enough,
        Flag.NON_LINEAR_SUSPECTED: faults.quieter(sides) | (unequal & enough),
        Flag.SHARPENED: (faults.overshoots(shape) & enough) | sides.alternates,
        Flag.TWO_HUMPS: faults.two_humps(shape) & enough,
        Flag.TOO_ABRUPT: faults.negative(shape) & enough,
        Flag.DISPLACED: faults.displaced(shape, mtf50),
        Flag.SMOOTHED: faults.smoothed(shape),
        Flag.NOISE_CORRELATED: sides.correlated,
        Flag.WINDOW_CUTS: (blur_px * WINDOW_REACHES > colours.shape[-1]) & (mode == "iso"),
    }
    if colours.shape[1] == 3:
        flags[Flag.NON_LINEAR_SUSPECTED] |= faults.colours_apart(colours, mtf50)
    return flags, hidden


def _by_region(flags: Mapping[Flag, Tensor]) -> list[frozenset[Flag]]:
    names = list(flags)
    rows = torch.stack(list(flags.values()), dim=1).tolist()
    return [frozenset(name for name, raised in zip(names, row, strict=True) if raised) for row in rows]


def _with_hidden(row: Mapping[str, Any], hidden: list[float]) -> dict[str, tuple[float, float]]:
    """The intervals, with those of MTF50 and MTF50P widened by the faults that may have raised or lowered them."""
    likely, largest, lowered = hidden
    wider = dict(row["noise_intervals"])
    for name in _CROSSINGS & wider.keys():
        (low, high), middle = wider[name], row[name]
        if math.isfinite(middle):
            least = middle / (1 + likely) - math.hypot(middle - low, middle * (largest - likely))
            wider[name] = least, middle + math.hypot(high - middle, middle * lowered)
    return wider
