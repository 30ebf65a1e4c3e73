"""Mattes of boxes and annotations: COCO's polygons and run lengths.

Domain: as :mod:`blurnoise.scene.cutting`; coordinates in px from the corner of the first pixel, x right, y down.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blurnoise._core.checks import in_range, picture_size, shown
from blurnoise.scene.cutting import Matte

LARGEST_PX = 1e6
_FINER = 8  # pixels of a polygon's mask along one of the picture's


def of_box(x: float, y: float, width: float, height: float, size: tuple[int, int]) -> Matte:
    """Matte of a rectangle in a picture (H, W): the covered area of each pixel.

    >>> of_box(0.5, 0, 2, 1, size=(2, 3))
    array([[0.5, 1. , 0.5],
           [0. , 0. , 0. ]], dtype=float32)
    """
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
    """Of polygons (x0, y0, x1, y1, ...) in a picture (H, W) the union, by the area that it takes of every pixel.

    >>> of_polygons([[0.5, 0, 2, 0, 2, 1, 0.5, 1]], size=(2, 2))
    array([[0.5, 1. ],
           [0. , 0. ]], dtype=float32)
    """
    corners = [_corners(polygon) for polygon in polygons]
    matte = np.zeros(size, np.float32)
    all_points = np.concatenate(corners)
    left, top = np.floor(all_points.min(0)).clip(0).astype(int).tolist()
    right, bottom = np.minimum(np.ceil(all_points.max(0)), size[::-1]).astype(int).tolist()
    if right <= left or bottom <= top:
        return matte
    fine = np.zeros(((bottom - top) * _FINER, (right - left) * _FINER), np.uint8)
    for points in corners:
        fine |= _inside((points - (left, top)) * _FINER, fine.shape)
    area = fine.reshape(bottom - top, _FINER, right - left, _FINER).mean((1, 3), dtype=np.float32)
    matte[top:bottom, left:right] = area
    return matte


def _corners(polygon: Sequence[float]) -> NDArray[np.float64]:
    """Those of a polygon, (N, 2). Raises ``ValueError``."""
    flat = np.asarray(polygon, np.float64)
    if flat.ndim != 1 or flat.size < 6 or flat.size % 2 or not np.isfinite(flat).all():
        raise ValueError(f"polygon = {shown(polygon)}: must be x0, y0, x1, y1, ... with 3 corners or more")
    return flat.reshape(-1, 2).clip(-LARGEST_PX, LARGEST_PX)


def _inside(corners: NDArray[np.float64], size: tuple[int, ...]) -> NDArray[np.uint8]:
    """Whether the middles of cells (H, W) are inside a polygon (N, 2): an odd number of edges left of them."""
    (x0, y0), (x1, y1) = corners.T, np.roll(corners, -1, 0).T
    middles = np.arange(size[0]) + 0.5
    edge, row = np.nonzero((y0[:, None] <= middles) != (y1[:, None] <= middles))
    x = x0[edge] + (middles[row] - y0[edge]) / (y1 - y0)[edge] * (x1 - x0)[edge]
    # Edges change the parity at the first middle to their right; sums along the row give every cell's.
    crossed = np.zeros((size[0], size[1] + 1), np.uint8)
    np.add.at(crossed, (row, np.ceil(x - 0.5).clip(0, size[1]).astype(np.int64)), 1)
    return np.asarray(np.bitwise_xor.accumulate(crossed & 1, axis=1)[:, :-1])


def of_rle(counts: str | bytes | Sequence[int], size: tuple[int, int]) -> Matte:
    """Of COCO's run lengths, column by column, compressed or not, in a picture (H, W).

    >>> of_rle([1, 2, 1], (2, 2)).tolist()  # down the columns: one outside, two inside, one outside
    [[0.0, 1.0], [1.0, 0.0]]
    """
    from faster_coco_eval.core import mask

    runs: Any = {"size": [*size], "counts": counts}
    packed = runs if isinstance(counts, (str, bytes)) else mask.frPyObjects(runs, *size)
    return np.asarray(mask.decode(packed), np.float32)


def of_annotation(annotation: Mapping[str, Any], size: tuple[int, int]) -> Matte:
    """Of an annotation of COCO's in a picture (H, W): its polygons or run lengths.

    Raises ``ValueError`` for what is no segmentation of one object in a picture of this size.
    """
    segmentation, one = annotation.get("segmentation"), not annotation.get("iscrowd")
    try:
        if one and isinstance(segmentation, Mapping) and segmentation["size"] == [*size]:
            return of_rle(segmentation["counts"], size)
        if one and isinstance(segmentation, (list, tuple)) and segmentation:
            return of_polygons(segmentation, size)
    except Exception as error:  # of C++, of several kinds
        raise ValueError(f"segmentation = {shown(segmentation)}: {error}") from None
    raise ValueError(
        f"segmentation = {shown(segmentation)}: must be polygons or run lengths of one object in {size}"
    )
