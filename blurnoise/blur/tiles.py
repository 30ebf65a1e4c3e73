"""How a picture is cut into overlapping tiles for Fourier transforms, and which lengths these like.

Cutting changes a result by no more than the tail of the band-limited line beyond the margin, and keeps each transform
in the processor's cache (overlap-save).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from itertools import count, product

from blurnoise._core.borders import Border

_CUTS = (1, 2, 3, 4, 6, 8, 12)  # tiles along an axis
_LARGEST_PLANE = 2**28  # values; a motion of millions of pixels should fail by name, not for want of memory


@dataclass(frozen=True)
class FrequencyAxis:
    """One axis of a layout: ``core`` pixels from each tile, ``before`` them ``margin``, the tile ``length``.

    >>> two_tiles = FrequencyAxis(size=100, core=50, before=7, length=64)
    >>> two_tiles.tiles[1]  # in the continued picture, in the picture, in the tile
    (slice(50, 114, None), slice(50, 100, None), slice(7, 57, None))
    """

    size: int
    core: int
    before: int
    length: int

    @property
    def tiles(self) -> list[tuple[slice, slice, slice]]:
        """Of each tile: its place in the continued picture, its core in the picture, and its core in the tile."""
        cores = [slice(first, min(first + self.core, self.size)) for first in range(0, self.size, self.core)]
        return [
            (
                slice(core.start, core.start + self.length),
                core,
                slice(self.before, self.before + core.stop - core.start),
            )
            for core in cores
        ]

    @property
    def span(self) -> int:
        """Pixels of the continued picture."""
        return (self.size - 1) // self.core * self.core + self.length


@dataclass(frozen=True)
class Layout:
    """How a picture is extended and tiled; dims: the axes that are transformed.

    >>> row, column = FrequencyAxis(480, 480, 0, 480), FrequencyAxis(640, 640, 16, 672)
    >>> Layout(row, column, dims=(-1,)).lengths  # only rows are transformed
    (1, 672)
    """

    y: FrequencyAxis
    x: FrequencyAxis
    dims: tuple[int, ...]

    @property
    def lengths(self) -> tuple[int, int]:
        """Lengths of a transform (down, across); 1 along an axis that is not transformed."""
        return self.y.length if -2 in self.dims else 1, self.x.length if -1 in self.dims else 1

    @property
    def packs(self) -> bool:
        """Whether OpenCV's packed transform can be used."""
        lengths = [self.lengths[dim] for dim in self.dims]
        return lengths[-1] % 2 == 0 and all(_is_fast(length) for length in lengths)


@lru_cache(maxsize=1024)
def layout_of(size: tuple[int, int], margins: tuple[int, int], border: Border, tiled: bool) -> Layout:
    """The fastest layout of a picture (H, W) whose blur reaches over margins (down, across), in px.

    >>> layout_of((64, 64), (0, 16), "reflect", False).lengths  # only rows are transformed
    (1, 96)
    """
    layouts = []
    for counts in product(_CUTS, _CUTS) if tiled else [(1, 1)]:
        y, x = (_axis(*each, border) for each in zip(size, margins, counts, strict=True))
        blurred = ((-2, y, margins[0]), (-1, x, margins[1]))
        dims = tuple(dim for dim, axis, margin in blurred if margin and axis.length > 1) or (-1,)
        layouts.append(Layout(y, x, dims))
    return min(layouts, key=_work)


def _work(layout: Layout) -> float:
    """Predicted time of a layout, ns on one core; planes larger than the cache cost more."""
    values = layout.y.length * layout.x.length
    # Measured: ns a value there and back, of planes that fit the cache of a core, of a socket, or neither.
    both_ways = 2.9 if values <= 2**20 else 3.3 if values <= 2**22 else 6.0
    tiles, axes = len(layout.y.tiles) * len(layout.x.tiles), len(layout.dims)
    once = 1.4 * values if axes == 2 else 0.0  # the transfer function, the same for all tiles
    return tiles * (values * both_ways * axes / 2 + 20_000) + once


def _axis(size: int, margin: int, count: int, border: Border) -> FrequencyAxis:
    if count == 1 and border == "circular":
        return FrequencyAxis(size, size, 0, size)
    # Reflected there and back a picture is periodic: one period serves however long the blur is.
    if count == 1 and border == "reflect" and 2 * margin > 2 * size:
        return FrequencyAxis(size, size, 0, max(1, 2 * size - 2))
    core = math.ceil(size / count)
    return FrequencyAxis(size, core, margin, fast_length(core + 2 * margin) if margin else core)


@lru_cache(maxsize=4096)
def fast_length(length: int) -> int:
    """The next length that a Fourier transform likes: no prime above 7, beyond 256 a multiple of 32, not of 256.

    Rows or columns a large power of two apart share a place in the cache; they take up to half as long again.

    >>> fast_length(97), fast_length(512)  # 98 = 2 x 7 x 7; a large power of two is avoided
    (98, 576)
    """
    step = 32 if length > 256 else 2
    return next(n for n in count(step * math.ceil(length / step), step) if _is_fast(n))


def _is_fast(length: int) -> bool:
    return 210**30 % length == 0 and (length <= 256 or length % 256 != 0)


def limited_plane(needs: Callable[[], str], height: int, width: int) -> None:
    """Raise ``ValueError`` where a plane is too large; ``needs``: makes the text of what needs it.

    >>> limited_plane(lambda: "displacement_px = 1e5 needs", 1 << 10, 1 << 20)
    Traceback (most recent call last):
        ...
    ValueError: displacement_px = 1e5 needs a plane of 1024x1048576 pixels; at most 268435456 are allowed
    """
    if height * width > _LARGEST_PLANE:
        raise ValueError(
            f"{needs()} a plane of {height}x{width} pixels; at most {_LARGEST_PLANE} are allowed"
        )
