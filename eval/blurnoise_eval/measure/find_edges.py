"""Detection of slanted edges in a picture of a chart or of any scene.

Domain: linear pictures, finite. A line detector proposes, :func:`slanted_edge` and a check of
what lies beside the edge decide, and each region grows while both agree. Regions are (left, top, width, height), px.

An edge nearer to horizontal is handled in the transposed picture, so that below every edge runs down its region.
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
"""Below it an edge has too few rows for a number worth printing."""
STEEPEST_DEG = 35.0
"""Off the rows or columns: beyond it the region would be mostly corners."""
MOST = 24  # regions reported of one picture, the largest ones
UNUSABLE = WITHHELD | {Flag.TOO_FEW_PHASES, Flag.NOISE_DOMINATED}

_STEEPEST = math.tan(math.radians(STEEPEST_DEG))
_FINEST_PX = 2048  # longer side in which lines are looked for; coarser by factors of 2, for wide blurs
_COARSEST_PX = 100
_TRIALS = 160  # lines looked into, longest first
_WIDTHS_PX = (10, 16, 25, 40, 64, 100)  # beside the edge, at first the same on both sides
_GROWTH = 1.4
_REACHES = 6  # of the blur, that a side is wide enough for every window
_END_PX = 4  # cut off either end of a line, where its corner begins
_BLOCK_PX = 5
_UNEVEN = 0.15  # share of the step by which a block may stand off the edge's shape

Segment = tuple[float, float, float, float]
"""x0, y0, x1, y1 of a line, px, y0 < y1."""


@dataclass(frozen=True)
class Found:
    """rois: the ``MOST`` largest regions, top to bottom. turned_down: lines that are no usable edge, by reason."""

    rois: list[Roi]
    turned_down: Mapping[Flag, int]


@dataclass(frozen=True)
class _Box:
    """A region about a line that runs down it: rows top to bottom, and what it holds beside the line, px."""

    line: Segment
    top: float
    bottom: float
    left: float = 0.0
    right: float = 0.0

    def roi(self, height: int, width: int) -> Roi | None:
        """As far as the picture reaches; None where that is too small."""
        top, bottom = max(0, math.ceil(self.top)), min(height, math.floor(self.bottom))
        x0, y0, x1, y1 = self.line
        ends = [x0 + (x1 - x0) * (y - y0) / (y1 - y0) for y in (top, bottom)]
        left, right = max(0, math.floor(min(ends) - self.left)), min(width, math.ceil(max(ends) + self.right))
        large_enough = bottom - top >= SHORTEST_PX and right - left >= _WIDTHS_PX[0]
        return (left, top, right - left, bottom - top) if large_enough else None


def find_edges(light: LinearPicture) -> Found:
    """Look for straight edges, alone in their regions, that :func:`slanted_edge` measures.

    Edges are ``SHORTEST_PX`` or longer and up to ``STEEPEST_DEG`` off rows or columns, but not so little that they
    miss phases; regions grow as far as the sides stay even. The same picture gives the same regions.
    """
    kept: list[tuple[Roi, bool, Segment]] = []
    reasons: Counter[Flag] = Counter()
    frames = [_Frame(each) for each in (light, replace(light, picture=light.picture.mT))]
    for lying, line in _lines(frames[0].plane):
        alike = [(roi, known) for roi, other, known in kept if other == lying]
        if any(_crosses(line, roi) for roi, _ in alike):
            continue
        found = frames[lying].grown(line)
        if isinstance(found, Flag):
            reasons[found] += 1
        elif not any(_crosses(known, found) for _, known in alike):
            kept.append((found, lying, line))
    rois = [(roi[1], roi[0], roi[3], roi[2]) if lying else roi for roi, lying, _ in kept]
    largest = sorted(rois, key=lambda roi: (-roi[2] * roi[3], roi))[:MOST]
    return Found(sorted(largest, key=lambda roi: (roi[1], roi[0])), dict(reasons.most_common()))


def _crosses(line: Segment, roi: Roi) -> bool:
    """Whether the middle of ``line`` is in the region."""
    left, top, width, height = roi
    x, y = (line[0] + line[2]) / 2, (line[1] + line[3]) / 2
    return left <= x <= left + width and top <= y <= top + height


class _Frame:
    """The picture, upright or transposed, as the edges in it see it."""

    def __init__(self, light: LinearPicture) -> None:
        self.light, self.plane = light, np.ascontiguousarray(light.grey, np.float32)

    def grown(self, line: Segment) -> Roi | Flag:
        """The largest region about ``line`` in which the edge can be used, or why there is none."""
        _, top, _, bottom = line
        why = []
        for ends_px in sorted({_END_PX, max(_END_PX, (bottom - top) / 4)}):  # a blurred corner begins earlier
            box, edge = self._widest(_Box(line, top + ends_px, bottom - ends_px))
            if not isinstance(edge, Flag):
                box = self._stretched(box, float(edge.distance_px[-1]))
                return box.roi(*self.plane.shape) or Flag.REGION_TOO_SMALL
            why.append(edge)
        return why[0]

    def _edge_in(self, box: _Box) -> SlantedEdge | Flag:
        """The edge in ``box``, or why it cannot be used."""
        roi = box.roi(*self.plane.shape)
        if roi is None:
            return Flag.REGION_TOO_SMALL
        edge = self.light.edge(roi)
        if bad := edge.flags & UNUSABLE:
            return min(bad, key=list(Flag).index)
        return edge if edge.orientation == "vertical" and self._alone(roi, edge) else Flag.TWO_EDGES

    def _alone(self, roi: Roi, edge: SlantedEdge) -> bool:
        """Whether no block of the region stands off what the edge's shape along a straight line says of it.

        Closer than the edge's own flags: a corner of the region that holds another edge changes no number yet, and
        the corner of a blurred square passes for a slanted edge with a wider blur.
        """
        left, top, width, height = roi
        step = edge.bright - edge.dark
        values = (self.plane[top : top + height, left : left + width] - edge.dark) / step
        rising = values if edge.bright_side == "right" else values[:, ::-1]
        rows = np.arange(height)
        # the dark part of each row ends at the edge
        slope, first = np.polyfit(rows, width - rising.sum(1), 1)
        away = (np.arange(width) + 0.5 - (first + slope * rows)[:, None]) / math.hypot(1, slope)
        shape = (edge.esf.numpy() - edge.dark) / step
        off = (rising - np.interp(away, edge.distance_px.numpy(), shape)).astype(np.float32)
        noise = math.sqrt(max(edge.noise_variance_dark, edge.noise_variance_bright)) / step
        blocks = cv2.blur(off, (_BLOCK_PX, _BLOCK_PX), borderType=cv2.BORDER_REFLECT)
        return bool(np.abs(blocks).max() < max(_UNEVEN, 6 * noise / _BLOCK_PX))

    def _widest(self, box: _Box) -> tuple[_Box, SlantedEdge | Flag]:
        """The widest of the regions with as much on both sides, or why there is none."""
        best: tuple[_Box, SlantedEdge | Flag] | None = None
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

    def _stretched(self, box: _Box, reach_px: float) -> _Box:
        """``box`` moved outwards on one side after the other while the edge can be used.

        reach_px: of the edge's blur. So much is cut off the ends again, at most a quarter of the length, for the
        blur of a corner may reach there. Beside the edge there is enough at half its length, or at ``_REACHES``.
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

    def _if_usable(self, box: _Box, **moved: Any) -> _Box | None:
        """``box`` with other sides, where the edge in it can be used."""
        other = replace(box, **moved)
        return None if isinstance(self._edge_in(other), Flag) else other


def _lines(plane: NDArray[np.float32]) -> list[tuple[bool, Segment]]:
    """Lines of a line segment detector on several scales, the longest first: whether it lies, and its ends.

    The picture goes in as 8 bits of its square root, which has about the same noise everywhere.
    """
    low, high = np.quantile(plane, [0.001, 0.999])
    if high <= low:
        return []
    shown = np.sqrt(np.clip((plane - low) / (high - low), 0, 1)).astype(np.float32)
    detector = cv2.createLineSegmentDetector(cv2.LSD_REFINE_STD)
    scales = [min(1.0, _FINEST_PX / max(plane.shape))]
    while max(plane.shape) * scales[-1] >= 2 * _COARSEST_PX:
        scales.append(scales[-1] / 2)
    found: set[tuple[bool, Segment]] = set()
    for scale in scales:
        size = tuple(max(1, round(side * scale)) for side in plane.shape[::-1])
        small = cv2.resize(shown, size, interpolation=cv2.INTER_AREA)
        segments = detector.detect((255 * small).round().astype(np.uint8))[0]
        for x0, y0, x1, y1 in np.reshape([] if segments is None else segments, (-1, 4)) / np.float64(scale):
            lying = bool(abs(x1 - x0) > abs(y1 - y0))
            (top, first), (bottom, last) = sorted([(x0, y0), (x1, y1)] if lying else [(y0, x0), (y1, x1)])
            if bottom - top >= SHORTEST_PX and abs(last - first) <= _STEEPEST * (bottom - top):
                found.add((lying, (first, top, last, bottom)))
    return sorted(found, key=lambda line: (line[1][1] - line[1][3], line))[:_TRIALS]
