"""Measurement of slanted edges in a picture: sharpness, contrast, noise and information.

Domain: linear pictures; frequencies in cycles/px. Regions are (left, top, width, height), px.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

from blurnoise._core import checks
from blurnoise.metrics import Flag, SlantedEdge, information
from blurnoise.metrics.edge.measurement import Mode
from blurnoise.metrics.sharpness import acutance
from blurnoise.metrics.values import Estimate, Roi
from blurnoise_eval.measure.find_edges import SHORTEST_PX, STEEPEST_DEG, find_edges
from blurnoise_eval.measure.linear import LinearPicture
from blurnoise_eval.system.tables import finite

LARGEST_TARGET_PX = 64
# Of the bootstrap: five of them lie beyond each end of a 95 % interval.
RESAMPLES = 200
_DOUBTS = {
    "noiseless": "there is no noise, so values relative to noise are unbounded",
    information.NOT_WHITE: "noise is not white: NEQ(0) uses its power at frequency 0; SIC, NEQ sum and SNRI "
    "assume white noise",
}
"""Flags of estimates, in words."""


@dataclass(frozen=True)
class Metric:
    """A metric of image quality: its name in tables, title, unit, definition, and the function that measures it.

    of: from what is measured to an estimate, or a list of them; larger is better, save glare and flicker. scale: of
    its axis in figures; a share lies between 0 and 1.
    """

    name: str
    title: str
    unit: str
    about: str
    of: Callable[[Any], Any]
    scale: Literal["linear", "log", "share"] = "linear"

    @property
    def label(self) -> str:
        """Title and unit."""
        return self.title if self.unit == "1" else f"{self.title} / {self.unit}"


@dataclass(frozen=True)
class TargetSquare:
    """The square that the ideal observer of SNRI detects: its side, px, and its Weber contrast to the mean level.

    >>> TargetSquare.parse("20,0.5")
    TargetSquare(size_px=20, contrast=0.5)
    """

    size_px: int = 10
    contrast: float = 0.1

    def __post_init__(self) -> None:
        checks.in_range("target: size", self.size_px, 1, LARGEST_TARGET_PX)
        checks.limited("target: contrast", self.contrast, "contrast")

    @classmethod
    def parse(cls, text: str) -> TargetSquare:
        """Read ``PX,CONTRAST``. Raises ``ValueError``."""
        try:
            size, contrast = text.split(",")
            return cls(int(size), float(contrast))
        except ValueError as error:
            must = "must be PX,CONTRAST, such as 10,0.1"
            raise (
                error if str(error).startswith("target:") else ValueError(f"target = {text!r}: {must}")
            ) from None


class EdgePair(NamedTuple):
    """An edge, one of the other orientation (or the same again), and the target of the ideal observer."""

    edge: SlantedEdge
    second: SlantedEdge
    target: TargetSquare


def _scalar(name: str) -> Callable[[EdgePair], Estimate]:
    return lambda pair: pair.edge.estimate(name)


def _of(measure: Callable[..., Estimate], edges: int) -> Callable[[EdgePair], Estimate]:
    """A function of one edge, or of both in either order."""
    return lambda pair: measure(*pair[:edges])


def _square_snr(pair: EdgePair) -> Estimate:
    # the target of square_snr is as high as the mean step of both edges
    level, step = (sum(edge.bright + sign * edge.dark for edge in pair[:2]) for sign in (1, -1))
    scale = pair.target.contrast * level / 2 / step
    return information.square_snr(*pair[:2], side_px=pair.target.size_px) * scale


EDGE_METRICS: tuple[Metric, ...] = (
    Metric("mtf50", "MTF50", "cycles/px", "response half of that at 0", _scalar("mtf50"), "log"),
    Metric("mtf50p", "MTF50P", "cycles/px", "response half of its peak", _scalar("mtf50p"), "log"),
    Metric("mtf_nyquist_2", "MTF at Nyquist/2", "1", "at 1/4 cycles/px", _scalar("mtf_nyquist_2"), "share"),
    Metric("mtf_nyquist", "MTF at Nyquist", "1", "at 1/2 cycles/px", _scalar("mtf_nyquist"), "share"),
    Metric("acutance", "acutance", "1", "SFR as the eye weighs it, 60 px per degree", _of(acutance, 1)),
    Metric("cnr", "CNR", "1", "step over the root of the mean noise variance", _scalar("cnr"), "log"),
    Metric("edge_snr_db", "edge SNR", "dB", "20 log10 of CNR", _scalar("edge_snr_db")),
    Metric("michelson", "Michelson contrast", "1", "step over sum of levels", _scalar("michelson"), "share"),
    Metric("sic_radial", "SIC radial", "bits/px", "same blur all round", _of(information.capacity_radial, 1)),
    Metric("sic_square", "SIC square", "bits/px", "all frequencies", _of(information.capacity_square, 2)),
    Metric("neq_0", "NEQ(0)", "quanta/px", "of the bright side", _of(information.neq_0, 1), "log"),
    Metric(
        "neq_integral", "NEQ sum", "quanta/px", "all frequencies", _of(information.neq_integral, 2), "log"
    ),
    Metric("snri", "SNRI", "1", "ideal observer of a square", _square_snr, "log"),
)
"""The metrics of an edge, in the order of tables; a new metric is one entry."""


@dataclass(frozen=True)
class MeasuredEdge:
    """The edge in one region. estimates: by the names of ``EDGE_METRICS``, NaN if missing.

    second: the number of the region with an edge of the other orientation, for metrics that need both directions;
    None where there is none, and the blur is assumed to be the same in both. doubts: the flags of the edge
    and its estimates, in words.
    """

    number: int
    roi: Roi
    edge: SlantedEdge
    second: int | None
    estimates: dict[str, Estimate]
    doubts: tuple[str, ...]

    def row(self) -> dict[str, Any]:
        """Plain values for a file, None for missing values and unbounded ends of intervals."""
        row: dict[str, Any] = {"region": self.number}
        row |= zip(("left_px", "top_px", "width_px", "height_px"), self.roi, strict=True)
        row |= {"orientation": self.edge.orientation, "bright_side": self.edge.bright_side}
        row |= {name: finite(getattr(self.edge, name)) for name in ("angle_deg", "dark", "bright")}
        for name, estimate in self.estimates.items():
            ends = {"": estimate.value, "_low": estimate.low, "_high": estimate.high}
            row |= {f"{name}{end}": finite(value) for end, value in ends.items()}
        return row | {"second_region": self.second, "flags": "; ".join(self.doubts)}


def detected_regions(picture: LinearPicture) -> list[Roi]:
    """Detect the regions of a picture that contain a usable slanted edge.

    Raises ``ValueError`` with the requirements, and the reasons why lines were rejected, if there is none.
    """
    detected = find_edges(picture)
    if not detected.rois:
        reasons = "; ".join(f"{count} x {flag.value}" for flag, count in detected.rejected.items())
        raise ValueError(
            f"image: no slanted edge can be measured; needs straight edges of {SHORTEST_PX} px or more, tilted by "
            f"at most {STEEPEST_DEG:g} degrees from rows or columns, with uniform sides that are not clipped "
            f"(detected: {reasons or 'no straight line'}); use --roi x,y,w,h to see the flags of a region"
        )
    return detected.rois


def measure(
    picture: LinearPicture, rois: Sequence[Roi], *, mode: Mode = "exact", target: TargetSquare | None = None
) -> list[MeasuredEdge]:
    """Measure the edge in each region; regions that cannot be measured have flags in place of numbers.

    Raises ``ValueError`` for a region outside the picture or below 8 x 8 px.

    >>> from blurnoise import charts
    >>> picture = LinearPicture(charts.slanted_edge(60, 80)[0].double(), full_scale=1.0)
    >>> (edge,) = measure(picture, [(0, 0, 80, 60)])
    >>> estimate_text(edge.estimates["michelson"]), edge.doubts
    ('0.7778 (0.778–0.778)', ('there is no noise, so values relative to noise are unbounded',))
    """
    edges = [picture.edge(roi, mode, RESAMPLES) for roi in rois]
    measured = []
    for index, (roi, edge) in enumerate(zip(rois, edges, strict=True)):
        second = _second(index, rois, edges)
        pair = EdgePair(edge, edge if second is None else edges[second], target or TargetSquare())
        estimates = {metric.name: metric.of(pair) for metric in EDGE_METRICS}
        flags = frozenset[str]().union(*(estimate.flags for estimate in estimates.values()))
        doubts = [flag.value for flag in Flag if flag in edge.flags]
        doubts += [text for flag, text in _DOUBTS.items() if flag in flags]
        across = None if second is None else second + 1
        measured.append(MeasuredEdge(index + 1, roi, edge, across, estimates, tuple(doubts)))
    return measured


def _second(index: int, rois: Sequence[Roi], edges: Sequence[SlantedEdge]) -> int | None:
    """Index of the nearest region with an edge of the other orientation."""
    centres = [(left + width / 2, top + height / 2) for left, top, width, height in rois]
    others = [
        (math.dist(centres[index], centres[other]), other)
        for other, edge in enumerate(edges)
        if not math.isnan(edge.bright) and edge.orientation != edges[index].orientation
    ]
    # The nearest one is blurred most alike: lenses and motion differ over the picture.
    return min(others)[1] if others and not math.isnan(edges[index].bright) else None


def estimate_text(estimate: Estimate) -> str:
    """The number with its interval; '?' marks a flagged number, a dash a missing one.

    >>> estimate_text(Estimate(0.098823, 0.098112, 0.09951, frozenset({"sharpened"})))
    '0.09882? (0.0981–0.0995)'
    """
    if not estimate.available:
        return "-"
    doubted = "?" if estimate.flags else ""
    if math.isnan(estimate.low):
        return f"{_number(estimate.value, 4)}{doubted}"
    return f"{_number(estimate.value, 4)}{doubted} ({_number(estimate.low, 3)}–{_number(estimate.high, 3)})"


def _number(value: float, digits: int) -> str:
    return f"{value:.0f}" if 100 <= abs(value) < 1e9 else f"{value:.{digits}g}"


def angle_text(region: MeasuredEdge) -> str:
    """Angle and bright side of the edge, or a dash."""
    edge = region.edge
    return "-" if edge.orientation is None else f"{edge.angle_deg:.2f}, bright {edge.bright_side}"


def second_text(region: MeasuredEdge) -> str:
    """The edge of the other orientation that SIC square and SNRI use."""
    if region.edge.orientation is None:
        return "-"
    return "same blur both ways" if region.second is None else f"edge {region.second}"
