"""A picture's slanted edges in numbers: sharpness, contrast, noise and what both leave of the information.

Domain: pictures as files have them, (H, W) or (H, W, 3), 8 or 16 bit, made linear here; frequencies in cycles/px.
Regions are (left, top, width, height), px.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
import torch
from torch import Tensor

from blurnoise._core import checks
from blurnoise.metrics import Flag, SlantedEdge, information, slanted_edge
from blurnoise.metrics.edge.measurement import Mode
from blurnoise.metrics.values import CLIPPED_SHARE, Estimate, Roi
from blurnoise.optics.colour import linear_from_srgb
from blurnoise_eval.datasets import Image
from blurnoise_eval.quality.find_edges import SHORTEST_PX, STEEPEST_DEG, find_edges
from blurnoise_eval.quality.metrics import Metric
from blurnoise_eval.system.tables import finite

Coding = Literal["auto", "srgb", "linear"]

TARGET_PX, TARGET_CONTRAST = 10, 0.1
"""The square that SNRI's ideal observer is to see: its side, and its Weber contrast to the region's mean level."""
_DOUBTS = {  # flags of numbers, in words
    "noiseless": "no noise: what is measured against it has no bound",
    information.NOT_WHITE: "noise is not white: NEQ(0) takes its power at frequency 0, SIC, NEQ sum and SNRI take it "
    "for white",
}
_UNSEEN = "no single edge shows a tone curve that is symmetric about its middle: the numbers must be linear, or sRGB"
_RESAMPLES = 200
_FEWEST_LEVELS = 255  # of a converter


@dataclass(frozen=True)
class Linear:
    """A linear picture: (C, H, W) float64, what a pixel can hold at most, what it holds without light, in ``unit``.

    notes: what had to be assumed, a sentence each.
    """

    picture: Tensor
    full_scale: float
    black_level: float
    unit: Literal["DN", "of white"]
    notes: tuple[str, ...]


class Pair(NamedTuple):
    """An edge, and one across the other axis, or the same again."""

    edge: SlantedEdge
    second: SlantedEdge


def _edge(measure: Callable[[SlantedEdge], Estimate]) -> Callable[[Pair], Estimate]:
    return lambda pair: measure(pair.edge)


def _both(measure: Callable[[SlantedEdge, SlantedEdge], Estimate]) -> Callable[[Pair], Estimate]:
    return lambda pair: measure(pair.edge, pair.second)  # in either order: seen from the side all is the same


def _scalar(name: str) -> Callable[[Pair], Estimate]:
    return lambda pair: pair.edge.estimate(name)


def _square_snr(pair: Pair) -> Estimate:
    # square_snr's target is as high as the mean step of both
    level, step = (sum(each.bright + sign * each.dark for each in pair) for sign in (1, -1))
    return information.square_snr(*pair, side_px=TARGET_PX) * (TARGET_CONTRAST * level / 2 / step)


EDGE_METRICS: tuple[Metric[Pair, Estimate], ...] = (
    Metric("mtf50", "MTF50", "cycles/px", "response half of that at 0", _scalar("mtf50"), "log"),
    Metric("mtf50p", "MTF50P", "cycles/px", "response half of its peak", _scalar("mtf50p"), "log"),
    Metric("mtf_nyquist_2", "MTF at Nyquist/2", "1", "at 1/4 cycles/px", _scalar("mtf_nyquist_2"), "share"),
    Metric("mtf_nyquist", "MTF at Nyquist", "1", "at 1/2 cycles/px", _scalar("mtf_nyquist"), "share"),
    Metric("cnr", "CNR", "1", "step over the root of the mean noise variance", _scalar("cnr"), "log"),
    Metric("edge_snr_db", "edge SNR", "dB", "20 log10 of CNR", _scalar("edge_snr_db")),
    Metric("michelson", "Michelson contrast", "1", "step over sum of levels", _scalar("michelson"), "share"),
    Metric("sic_radial", "SIC radial", "bits/px", "same blur all round", _edge(information.capacity_radial)),
    Metric("sic_square", "SIC square", "bits/px", "all frequencies", _both(information.capacity_square)),
    Metric("neq_0", "NEQ(0)", "quanta/px", "of the bright side", _edge(information.neq_0), "log"),
    Metric("neq_integral", "NEQ sum", "quanta/px", "all frequencies", _both(information.neq_integral), "log"),
    Metric(
        "snri", f"SNRI of {TARGET_PX} px, {100 * TARGET_CONTRAST:g} %", "1", "ideal observer of a square",
        _square_snr, "log",
    ),
)  # fmt: skip
"""The numbers of a region in their order: a new one is a line here."""


@dataclass(frozen=True)
class Measured:
    """One region. estimates: by the names of ``EDGE_METRICS``; what is not available is NaN, and ``doubts`` say why.

    second: the number of the region whose edge crosses the other axis, for what needs both directions; None where
    there is none, and the blur is taken for the same both ways. doubts: flags in words.
    """

    number: int
    roi: Roi
    edge: SlantedEdge
    second: int | None
    estimates: dict[str, Estimate]
    doubts: tuple[str, ...]

    def row(self) -> dict[str, Any]:
        """All of it by plain names, None for what is not available, or for an end of an interval that is open."""
        row: dict[str, Any] = {"region": self.number}
        row |= zip(("left_px", "top_px", "width_px", "height_px"), self.roi, strict=True)
        row |= {"orientation": self.edge.orientation, "bright_side": self.edge.bright_side}
        row |= {name: finite(getattr(self.edge, name)) for name in ("angle_deg", "dark", "bright")}
        for name, estimate in self.estimates.items():
            ends = {"": estimate.value, "_low": estimate.low, "_high": estimate.high}
            row |= {f"{name}{end}": finite(value) for end, value in ends.items()}
        return row | {"second_region": self.second, "flags": "; ".join(self.doubts)}


def linear(
    picture: Image, coding: Coding = "auto", *, black_level: float | None = None, full_scale: float | None = None
) -> Linear:  # fmt: skip
    """Make a picture linear. ``auto`` takes 8 bits for sRGB-coded and 16 bits for linear.

    black_level (default 0) and full_scale (default all bits set) are digital numbers of a linear picture. Raises
    ``ValueError`` for them beside sRGB coding, and for numbers that do not fit.
    """
    bits = 8 * picture.itemsize
    planes = torch.from_numpy(np.atleast_3d(picture).transpose(2, 0, 1).astype(np.float64))
    levels = {"black_level": black_level, "full_scale": full_scale}
    given = [f"{name} = {value:g}" for name, value in levels.items() if value is not None]
    notes = ["colour: measured as luminance (ITU-R BT.709)"] if len(planes) == 3 else []
    coded = coding == "srgb" or (coding == "auto" and bits == 8)
    if coding == "auto":
        made_linear = "sRGB-coded and made linear; --linear takes the numbers as they are"
        as_is = "linear; --srgb if the picture is sRGB-coded"
        notes.append(f"{bits} bits: taken as {made_linear if coded else as_is}")
    if coded and given:
        raise ValueError(f"{given[0]}: belongs to linear numbers, but these are taken as sRGB; add --linear")
    if coded:
        return Linear(linear_from_srgb(planes / (2**bits - 1)), 1.0, 0.0, "of white", (*notes, _UNSEEN))
    largest, most = float(planes.max()), 2.0**bits - 1
    whole = math.log2(largest + 1).is_integer() and largest >= _FEWEST_LEVELS
    if full_scale is None and whole and float((planes == largest).double().mean()) > CLIPPED_SHARE:
        full_scale = largest  # that of a converter of fewer bits
        notes.append(f"full scale taken as {largest:g}: many pixels stand exactly there")
    top = most if full_scale is None else checks.in_range("full_scale", full_scale, 1.0, most)
    if largest > top:
        raise ValueError(f"full_scale = {top:g}: must not be below the picture's largest number, {largest:g}")
    black = checks.in_range("black_level", black_level or 0.0, 0.0, top - 1)
    if full_scale is None and largest <= most / 4:
        text = f"full scale taken as {most:g}, the largest number is {largest:g}"
        notes.append(f"{text}: clipping at fewer bits goes unseen without --full-scale")
    return Linear(planes, top, black, "DN", (*notes, _UNSEEN))


def found_regions(light: Linear) -> tuple[list[Roi], tuple[str, ...]]:
    """The regions of ``light`` that hold a usable slanted edge, and a note on what was passed over.

    Raises ``ValueError`` that says what was looked for where there is none.
    """
    found = find_edges(light.picture, full_scale=light.full_scale, black_level=light.black_level)
    if not found.rois:
        reasons = "; ".join(f"{count} x {flag.value}" for flag, count in found.turned_down.items())
        raise ValueError(
            f"image: no usable slanted edge: looked for straight edges of {SHORTEST_PX} px or more, at most "
            f"{STEEPEST_DEG:g} degrees off rows or columns but not along them, alone between two even sides that do "
            f"not clip ({reasons or 'no straight line at all'}); name a region with --roi x,y,w,h to see its flags"
        )
    left_out = f"{found.left_out} smaller regions are left out; --roi x,y,w,h names any"
    return found.rois, (left_out,) * (found.left_out > 0)


def measure(light: Linear, rois: Sequence[Roi], *, mode: Mode = "exact") -> list[Measured]:
    """Measure the edge in each region; those that cannot be measured have flags in place of numbers.

    Raises ``ValueError`` for a region outside the picture or below 8 x 8 px.
    """
    scale: Any = {"full_scale": light.full_scale, "black_level": light.black_level}
    edges: list[SlantedEdge] = []
    for roi in rois:
        edge = slanted_edge(light.picture, mode=mode, roi=roi, bootstrap=_RESAMPLES, **scale)
        edges += edge if isinstance(edge, list) else [edge]
    measured = []
    for index, (roi, edge) in enumerate(zip(rois, edges, strict=True)):
        second = _second(index, rois, edges)
        pair = Pair(edge, edge if second is None else edges[second])
        estimates = {metric.name: metric.of(pair) for metric in EDGE_METRICS}
        flags = frozenset[str]().union(*(estimate.flags for estimate in estimates.values()))
        doubts = [flag.value for flag in Flag if flag in edge.flags]
        doubts += [text for flag, text in _DOUBTS.items() if flag in flags]
        number = None if second is None else second + 1
        measured.append(Measured(index + 1, roi, edge, number, estimates, tuple(doubts)))
    return measured


def _second(index: int, rois: Sequence[Roi], edges: Sequence[SlantedEdge]) -> int | None:
    """The nearest region with an edge across the other axis."""
    centres = [(left + width / 2, top + height / 2) for left, top, width, height in rois]
    others = [
        (math.dist(centres[index], centres[other]), other)
        for other, edge in enumerate(edges)
        if not math.isnan(edge.bright) and edge.orientation != edges[index].orientation
    ]
    return min(others)[1] if others and not math.isnan(edges[index].bright) else None
