"""Mattes of annotations and boxes: COCO's polygons and run lengths, and what GrabCut finds in a box.

Domain: as :mod:`blurnoise.scene.cutting`; coordinates in px from the corner of the first pixel, x right, y down.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from blurnoise._core.checks import in_range, picture_size, shown
from blurnoise.scene.cutting import AROUND_PX, Matte

LARGEST_PX = 1e6
_FINER = 8  # pixels of a polygon's mask along one of the picture's
_CUT_PX = 160  # longest side of what GrabCut works on: its time goes with the pixels
_AROUND_BOX = 0.25  # of a box's sides, what is looked at around it
_CUTS = 3  # rounds of GrabCut
_FEWEST_PIXELS = 64  # of object and of background, to know their colours
_REACHES = 0.9  # of a box's area, what the upright hull of its object has at least


def of_box(x: float, y: float, width: float, height: float, size: tuple[int, int]) -> Matte:
    """Matte of a rectangle in a picture (H, W): the covered area of each pixel."""
    size = picture_size("size", size)
    spans = []
    for name, start, length, most in (("x, width", x, width, size[1]), ("y, height", y, height, size[0])):
        in_range(f"box: {name}", start, -LARGEST_PX, LARGEST_PX)
        in_range(f"box: {name}", length, 0.0, LARGEST_PX, above=True)
        pixels = np.arange(most)
        spans.append(np.clip(np.minimum(start + length, pixels + 1) - np.maximum(start, pixels), 0, 1))
    across, down = spans
    return np.asarray(down[:, None] * across, np.float32)


def of_polygons(polygons: Sequence[Sequence[float]], size: tuple[int, int]) -> Matte:
    """Of polygons (x0, y0, x1, y1, ...) in a picture (H, W) the union, by the area that it takes of every pixel."""
    corners = _corners(polygons)
    matte = np.zeros(size, np.float32)
    every = np.concatenate(corners)
    left, top = (int(max(0, edge)) for edge in np.floor(every.min(0)))
    right, bottom = (
        int(min(edge, most)) for edge, most in zip(np.ceil(every.max(0)), size[::-1], strict=True)
    )
    if right <= left or bottom <= top:
        return matte
    fine = np.zeros(((bottom - top) * _FINER, (right - left) * _FINER), np.uint8)
    for points in corners:
        fine |= _inside((points - (left, top)) * _FINER, fine.shape)
    area = fine.reshape(bottom - top, _FINER, right - left, _FINER).mean((1, 3), dtype=np.float32)
    matte[top:bottom, left:right] = area
    return matte


def _corners(polygons: Sequence[Sequence[float]]) -> list[NDArray[np.float64]]:
    """Those of each polygon, (N, 2). Raises ``ValueError``."""
    if not isinstance(polygons, (list, tuple)) or not polygons:
        raise ValueError("segmentation: must hold at least one polygon")
    corners = []
    for polygon in polygons:
        try:
            flat = np.asarray(polygon, np.float64).reshape(-1, 2)
        except (TypeError, ValueError, OverflowError):  # an odd number; text, an integer beyond 1e308
            flat = np.zeros((0, 2))
        if len(flat) < 3 or not np.isfinite(flat).all():
            must = "must be x0, y0, x1, y1, ... of 3 corners or more"
            raise ValueError(f"segmentation: polygon {shown(polygon)}: {must}")
        corners.append(flat.clip(-LARGEST_PX, LARGEST_PX))
    return corners


def _inside(corners: NDArray[np.float64], size: tuple[int, ...]) -> NDArray[np.uint8]:
    """Whether the middles of cells (H, W) are inside a polygon (N, 2): an odd number of edges left of them."""
    (x0, y0), (x1, y1) = corners.T, np.roll(corners, -1, 0).T
    middles = np.arange(size[0]) + 0.5
    edge, row = np.nonzero((y0[:, None] <= middles) != (y1[:, None] <= middles))
    x = x0[edge] + (middles[row] - y0[edge]) / (y1 - y0)[edge] * (x1 - x0)[edge]
    crossed = np.zeros((size[0], size[1] + 1), np.uint8)
    np.add.at(crossed, (row, np.ceil(x - 0.5).clip(0, size[1]).astype(np.int64)), 1)
    return np.asarray(np.bitwise_xor.accumulate(crossed & 1, axis=1)[:, :-1])


def of_object_in(picture: NDArray[np.uint8], box_xyxy: Sequence[float]) -> Matte:
    """Of what stands in a box of a picture (H, W, 3), 8 bits: what has other colours than what is around the box.

    GrabCut (Rother, Kolmogorov & Blake 2004) with a fixed seed, at most ``_CUT_PX`` px a side. An object reaches all
    four sides of its box; where what is found does not, part of it is missing, which left behind would be a sharp
    ghost: then all of the box is taken, as where there is nothing around it to compare with.
    """
    height, width = picture.shape[:2]
    x0, y0, x1, y1 = box_xyxy
    boxed = of_box(x0, y0, x1 - x0, y1 - y0, (height, width))
    around_x, around_y = (max(AROUND_PX / 2, _AROUND_BOX * side) for side in (x1 - x0, y1 - y0))
    left, top = (max(0, math.floor(edge)) for edge in (x0 - around_x, y0 - around_y))
    right, bottom = min(width, math.ceil(x1 + around_x)), min(height, math.ceil(y1 + around_y))
    if not boxed.any():
        return boxed
    part = np.ascontiguousarray(picture[top:bottom, left:right])
    scale = min(1.0, _CUT_PX / max(part.shape[:2]))
    small = cv2.resize(part, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA) if scale < 1 else part
    inside = (
        cv2.resize(boxed[top:bottom, left:right], small.shape[1::-1], interpolation=cv2.INTER_AREA) >= 0.5
    )
    labels = np.where(inside, cv2.GC_PR_FGD, cv2.GC_BGD).astype(np.uint8)
    if min(inside.sum(), (~inside).sum()) < _FEWEST_PIXELS:
        return boxed
    with ThreadPoolExecutor(1) as worker:
        worker.submit(_grab_cut, small, labels).result()
    own = np.isin(labels, (cv2.GC_FGD, cv2.GC_PR_FGD)).astype(np.uint8)
    outlines = cv2.findContours(own, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[0]
    cv2.drawContours(own, outlines, -1, 1, cv2.FILLED)  # what has the background's colours within is its own
    if _share_of_hull(own, inside) < _REACHES:
        return boxed
    found = np.zeros_like(boxed)
    found[top:bottom, left:right] = cv2.resize(
        own.astype(np.float32), part.shape[1::-1], interpolation=cv2.INTER_LINEAR
    )
    return np.asarray(found * boxed, np.float32)


def _grab_cut(picture: NDArray[np.uint8], labels: NDArray[np.uint8]) -> None:
    """Improve the labels, by random numbers of OpenCV's that are the thread's own."""
    cv2.setRNGSeed(0)
    cv2.grabCut(picture, labels, None, np.zeros((1, 65)), np.zeros((1, 65)), _CUTS, cv2.GC_INIT_WITH_MASK)


def _share_of_hull(own: NDArray[np.uint8], box: NDArray[np.bool_]) -> float:
    """The area of the upright hull of an object by that of its box."""
    hulls = [np.flatnonzero(each.any(axis)) for each in (own > 0, box) for axis in (0, 1)]
    across, down, wide, high = (float(np.ptp(each) + 1) if len(each) else 0.0 for each in hulls)
    return across * down / (wide * high)


def of_rle(counts: str | bytes | Sequence[int], size: tuple[int, int]) -> Matte:
    """Of COCO's run lengths, column by column, compressed or not. Raises ``ValueError`` unless they fill (H, W)."""
    from faster_coco_eval.core import mask

    runs: Any = {"size": [*size], "counts": counts}
    try:
        return np.asarray(
            mask.decode(runs if isinstance(counts, (str, bytes)) else mask.frPyObjects(runs, *size)),
            np.float32,
        )
    except Exception as error:  # of C++, of several kinds
        reason = " ".join(str(error).split())[:100]
        raise ValueError(
            f"segmentation: counts = {shown(counts)}: not run lengths of {size} ({reason})"
        ) from None


def of_annotation(annotation: Mapping[str, Any], size: tuple[int, int]) -> Matte:
    """Of an annotation of COCO's in a picture (H, W): its polygons or run lengths.

    Raises ``ValueError`` for a crowd, whose mask is no object's, and for one without a segmentation of this size.
    """
    segmentation = annotation.get("segmentation")
    if annotation.get("iscrowd") or not segmentation:
        raise ValueError("segmentation: must be that of one object; there is none, or it is a crowd's")
    if not isinstance(segmentation, Mapping):
        return of_polygons(segmentation, size)
    if segmentation.get("size") != [*size]:
        must = f"must be the picture's, {[*size]}"
        raise ValueError(f"segmentation: size = {shown(segmentation.get('size'))}: {must}")
    return of_rle(segmentation.get("counts", ""), size)
