"""Detection of slanted edges in a picture of a chart or of any scene.

Domain: linear pictures, finite. A line detector proposes edges; :func:`slanted_edge` and a check of the area beside
the edge accept or reject them; each region grows as long as both accept it. Regions are (left, top, width, height),
px.

Edges nearer to horizontal are handled in the transposed picture, so that every edge below runs from top to bottom.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from blurnoise.metrics import Flag, SlantedEdge
from blurnoise.metrics.edge.measurement import WITHHELD
from blurnoise.metrics.values import Roi
from blurnoise_eval.measure.linear import LinearPicture

SHORTEST_PX = 24
"""Shorter edges have too few rows for a useful result."""
STEEPEST_DEG = 35.0
"""Largest angle to the rows or columns: beyond it the region would be mostly corners."""
MOST = 24  # regions of a picture, the largest ones
UNUSABLE = WITHHELD | {Flag.TOO_FEW_PHASES, Flag.NOISE_DOMINATED}

_STEEPEST = math.tan(math.radians(STEEPEST_DEG))
_FINEST_PX = (
    2048  # longer side of the picture for line detection; also coarser by factors of 2, for wide blurs
)
_COARSEST_PX = 100
_TRIALS = 160  # lines that are tried, longest first
_WIDTHS_PX = (10, 16, 25, 40, 64, 100)  # of the area on each side of the edge
_GROWTH = 1.4
_REACHES = 6  # widths of the blur, enough for every window of the measurement
_END_PX = 4  # removed at both ends of a line, where corners begin
_BLOCK_PX = 5
_UNEVEN = 0.15  # share of the step by which a block may differ from the profile of the edge

Segment = tuple[float, float, float, float]
"""x0, y0, x1, y1 of a line, px, y0 < y1."""


@dataclass(frozen=True)
class DetectedEdges:
    """rois: the ``MOST`` largest regions, top to bottom. rejected: numbers of unusable lines, by reason."""

    rois: list[Roi]
    rejected: Mapping[Flag, int]


@dataclass(frozen=True)
class _LineRegion:
    """A region around a line from top to bottom: its rows, and its widths left and right of the line, px."""

    line: Segment
    top: float
    bottom: float
    left: float = 0.0
    right: float = 0.0

    def roi(self, height: int, width: int) -> Roi | None:
        """The part of the box inside the picture; None if that is too small."""
        top, bottom = max(0, math.ceil(self.top)), min(height, math.floor(self.bottom))
        x0, y0, x1, y1 = self.line
        ends = [x0 + (x1 - x0) * (y - y0) / (y1 - y0) for y in (top, bottom)]
        left, right = max(0, math.floor(min(ends) - self.left)), min(width, math.ceil(max(ends) + self.right))
        large_enough = bottom - top >= SHORTEST_PX and right - left >= _WIDTHS_PX[0]
        return (left, top, right - left, bottom - top) if large_enough else None


def find_edges(picture: LinearPicture) -> DetectedEdges:
    """Detect straight edges that :func:`slanted_edge` can measure, each alone in its region.

    Edges are ``SHORTEST_PX`` or longer and up to ``STEEPEST_DEG`` off rows or columns, but tilted enough to sample
    all phases; regions grow while their sides are uniform. The same picture gives the same regions.

    >>> from blurnoise import charts
    >>> picture = LinearPicture(charts.slanted_edge(60, 80)[0].double(), full_scale=1.0)
    >>> find_edges(picture).rois
    [(0, 0, 80, 60)]
    """
    accepted: list[tuple[Roi, bool, Segment]] = []
    reasons: Counter[Flag] = Counter()
    views = [_OrientedView(image) for image in (picture, replace(picture, picture=picture.picture.mT))]
    for transposed, line in _lines(views[0].plane):
        alike = [(roi, other) for roi, other_transposed, other in accepted if other_transposed == transposed]
        if any(_crosses(line, roi) for roi, _ in alike):
            continue
        region = views[transposed].grow(line)
        if isinstance(region, Flag):
            reasons[region] += 1
        elif not any(_crosses(other, region) for _, other in alike):
            accepted.append((region, transposed, line))
    rois = [(roi[1], roi[0], roi[3], roi[2]) if transposed else roi for roi, transposed, _ in accepted]
    largest = sorted(rois, key=lambda roi: (-roi[2] * roi[3], roi))[:MOST]
    return DetectedEdges(sorted(largest, key=lambda roi: (roi[1], roi[0])), dict(reasons.most_common()))


def _crosses(line: Segment, roi: Roi) -> bool:
    """Whether the middle of ``line`` is in the region."""
    left, top, width, height = roi
    x, y = (line[0] + line[2]) / 2, (line[1] + line[3]) / 2
    return left <= x <= left + width and top <= y <= top + height


class _OrientedView:
    """The picture, upright or transposed, in which edges run from top to bottom."""

    def __init__(self, picture: LinearPicture) -> None:
        self.picture, self.plane = picture, np.ascontiguousarray(picture.grey, np.float32)

    def grow(self, line: Segment) -> Roi | Flag:
        """The largest region around ``line`` with a usable edge, or the reason why there is none."""
        _, top, _, bottom = line
        why = []
        for ends_px in sorted(
            {_END_PX, max(_END_PX, (bottom - top) / 4)}
        ):  # blurred corners reach further in
            box, edge = self._widest(_LineRegion(line, top + ends_px, bottom - ends_px))
            if not isinstance(edge, Flag):
                box = self._stretched(box, float(edge.distance_px[-1]))
                return box.roi(*self.plane.shape) or Flag.REGION_TOO_SMALL
            why.append(edge)
        return why[0]

    def _edge_in(self, box: _LineRegion) -> SlantedEdge | Flag:
        """The edge in ``box``, or the reason why it is not usable."""
        roi = box.roi(*self.plane.shape)
        if roi is None:
            return Flag.REGION_TOO_SMALL
        edge = self.picture.edge(roi)
        if bad := edge.flags & UNUSABLE:
            return min(bad, key=list(Flag).index)
        return edge if edge.orientation == "vertical" and self._alone(roi, edge) else Flag.TWO_EDGES

    def _alone(self, roi: Roi, edge: SlantedEdge) -> bool:
        """Whether every block fits a straight edge of this profile.

        This is stricter than the flags of the edge: a second edge in a corner of the region changes no number yet,
        and the corner of a blurred square looks like a slanted edge with a wider blur.
        """
        left, top, width, height = roi
        step = edge.bright - edge.dark
        values = (self.plane[top : top + height, left : left + width] - edge.dark) / step
        rising = values if edge.bright_side == "right" else values[:, ::-1]
        rows = np.arange(height)
        # the sum of a row is its bright part, so the rest is where the edge crosses the row
        slope, first = np.polyfit(rows, width - rising.sum(1), 1)
        distance = (np.arange(width) + 0.5 - (first + slope * rows)[:, None]) / math.hypot(1, slope)
        shape = (edge.esf.numpy() - edge.dark) / step
        off = (rising - np.interp(distance, edge.distance_px.numpy(), shape)).astype(np.float32)
        noise = math.sqrt(max(edge.noise_variance_dark, edge.noise_variance_bright)) / step
        blocks = cv2.blur(off, (_BLOCK_PX, _BLOCK_PX), borderType=cv2.BORDER_REFLECT)
        return bool(np.abs(blocks).max() < max(_UNEVEN, 6 * noise / _BLOCK_PX))

    def _widest(self, box: _LineRegion) -> tuple[_LineRegion, SlantedEdge | Flag]:
        """The widest usable region with equal sides, or the reason why there is none."""
        best: tuple[_LineRegion, SlantedEdge | Flag] | None = None
        why: list[Flag] = []
        for width in _WIDTHS_PX:
            wider = replace(box, left=width, right=width)
            edge = self._edge_in(wider)
            if not isinstance(edge, Flag):
                best = wider, edge
                continue
            why.append(edge)
            if best or why.count(Flag.TWO_EDGES) == 2:  # once would be noise, or a blur that fills the region
                break
        return best or (box, why[0])

    def _stretched(self, box: _LineRegion, reach_px: float) -> _LineRegion:
        """Move one side of ``box`` after the other outwards while the edge is usable.

        reach_px: of the blur. This much is removed from the ends again, at most a quarter of the length, because the
        blur of a corner may reach there. A side needs no more than half the length, or ``_REACHES`` of the blur.
        """
        for end, sign in (("top", -1.0), ("bottom", 1.0)):
            step = sign * (_GROWTH - 1) * (box.bottom - box.top)
            while longer := self._if_usable(box, **{end: getattr(box, end) + step}):
                if longer.roi(*self.plane.shape) == box.roi(*self.plane.shape):
                    break
                box = longer
        cut = min(reach_px, (box.bottom - box.top) / 4)
        box = self._if_usable(box, top=box.top + cut, bottom=box.bottom - cut) or box
        most = max((box.bottom - box.top) / 2, _REACHES * reach_px)
        box = replace(box, left=min(box.left, most), right=min(box.right, most))
        for side in ("left", "right"):
            while (width := getattr(box, side)) < most:
                wider = self._if_usable(box, **{side: min(_GROWTH * width, most)})
                if not wider:
                    break
                box = wider
        return box

    def _if_usable(self, box: _LineRegion, **moved: Any) -> _LineRegion | None:
        """``box`` with other sides, if its edge is usable."""
        other = replace(box, **moved)
        return None if isinstance(self._edge_in(other), Flag) else other


def _lines(plane: NDArray[np.float32]) -> list[tuple[bool, Segment]]:
    """Lines of a line segment detector at several scales, longest first: whether it is transposed, and its ends.

    The detector gets 8 bits of the square root, in which shot noise is about the same everywhere.
    """
    low, high = np.quantile(plane, [0.001, 0.999])
    if high <= low:
        return []
    shown = np.sqrt(np.clip((plane - low) / (high - low), 0, 1)).astype(np.float32)
    detector = cv2.createLineSegmentDetector(cv2.LSD_REFINE_STD)
    scales = [min(1.0, _FINEST_PX / max(plane.shape))]
    while max(plane.shape) * scales[-1] >= 2 * _COARSEST_PX:
        scales.append(scales[-1] / 2)
    lines: set[tuple[bool, Segment]] = set()
    for scale in scales:
        size = tuple(max(1, round(side * scale)) for side in plane.shape[::-1])
        small = cv2.resize(shown, size, interpolation=cv2.INTER_AREA)
        segments = detector.detect((255 * small).round().astype(np.uint8))[0]
        for x0, y0, x1, y1 in np.reshape([] if segments is None else segments, (-1, 4)) / np.float64(scale):
            transposed = bool(abs(x1 - x0) > abs(y1 - y0))
            (top, first), (bottom, last) = sorted(
                [(x0, y0), (x1, y1)] if transposed else [(y0, x0), (y1, x1)]
            )
            if bottom - top >= SHORTEST_PX and abs(last - first) <= _STEEPEST * (bottom - top):
                lines.add((transposed, (first, top, last, bottom)))
    return sorted(lines, key=lambda line: (line[1][1] - line[1][3], line))[:_TRIALS]
