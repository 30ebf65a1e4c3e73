"""Pictures (B, C, H, W) times a transfer function: one Fourier transform, or overlapping tiles of it.

A transform wraps round, so it covers a margin that holds the reach of the blur; what wraps falls outside the
picture. Only the axes that blur are transformed. A circular border wraps as it should, and so does the full
period of a reflected one. Cutting the picture into tiles (overlap-save) changes the result by no more than
the tail of the band-limited line beyond the margin, and keeps each transform in the processor's cache.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import count, product
from typing import Any, Protocol, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from blurnoise._core import packed_fft as packed
from blurnoise._core.borders import Border, continued, extended
from blurnoise._core.packed_fft import Plane
from blurnoise._core.threads import borrowed, plain, side_by_side
from blurnoise.optics import transfer
from blurnoise.optics.transfer import SHARP, Optics

_Array = TypeVar("_Array", Tensor, NDArray[Any])
_TAIL_PX = 8  # of the band-limited line beyond its ends; the rest is 1e-4 RMS of white, in white noise
_JOIN = 0.05  # cycles/px below half of one, over which a response is led into its alias
STILL_PX = 2e-5  # along an axis that is not worth its transform: 1.4e-5 of a wave, beside other motion
_STRIP = 3 << 16  # values of a strip of rows
_CUTS = (1, 2, 3, 4, 6, 8, 12)  # tiles along an axis
LARGEST_PLANE = 2**28  # values; a motion of millions of pixels should fail by name, not for want of memory


@dataclass(frozen=True)
class Axis:
    """One axis of a layout: ``core`` pixels from each tile, ``before`` them ``margin``, the tile ``length``."""

    size: int
    core: int
    before: int
    length: int

    @property
    def starts(self) -> range:
        """First pixel of each tile's core in the picture, and of each tile in the extended picture."""
        return range(0, self.size, self.core)

    @property
    def span(self) -> int:
        """Pixels of the continued picture."""
        return self.starts[-1] + self.length


@dataclass(frozen=True)
class Layout:
    """How a picture is extended and tiled; dims: the axes that are transformed."""

    y: Axis
    x: Axis
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


class Response(Protocol):
    """A transfer function, or one for each of a batch's pictures.

    variable: what it is made of, through which gradients may go. ``str`` names the parameter, for errors.
    """

    @property
    def variable(self) -> Tensor: ...

    @property
    def reach_px(self) -> tuple[float, float]:
        """Spread of a point (down, across); 0 along an axis without blur."""

    def packed(self, lengths: tuple[int, int], out: Plane) -> Plane:
        """For one picture, as a packed spectrum over its size, in ``out`` or kept; of one axis as a row."""

    def multiply(self, plane: Plane, spectrum: Plane, scratch: Sequence[Plane]) -> Plane:
        """A plane times what :meth:`packed` gives, by :mod:`._core.packed_fft`."""

    def at(self, lengths: tuple[int, int], image: Tensor) -> Tensor:
        """(B, 1, h, w), real or complex, at :func:`frequencies`, as ``image`` needs it; differentiable."""


@lru_cache(maxsize=1024)
def _layout(size: tuple[int, int], margins: tuple[int, int], border: Border, tiled: bool) -> Layout:
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
    both_ways = 2.9 if values <= 2**20 else 3.3 if values <= 2**22 else 6.0
    tiles, axes = len(layout.y.starts) * len(layout.x.starts), len(layout.dims)
    once = 1.4 * values if axes == 2 else 0.0  # the transfer function, the same for all tiles
    return tiles * (values * both_ways * axes / 2 + 20_000) + once


def _axis(size: int, margin: int, count: int, border: Border) -> Axis:
    if count == 1 and border == "circular":
        return Axis(size, size, 0, size)
    if count == 1 and border == "reflect" and 2 * margin > 2 * size:
        return Axis(size, size, 0, max(1, 2 * size - 2))
    core = math.ceil(size / count)
    return Axis(size, core, margin, fast_length(core + 2 * margin) if margin else core)


@lru_cache(maxsize=4096)
def fast_length(length: int) -> int:
    """The next length that a Fourier transform likes: no prime above 7, beyond 256 a multiple of 32, not of 256.

    Rows or columns a large power of two apart share a place in the cache; they take up to half as long again.
    """
    step = 32 if length > 256 else 2
    return next(n for n in count(step * math.ceil(length / step), step) if _is_fast(n))


def _is_fast(length: int) -> bool:
    return 210**30 % length == 0 and (length <= 256 or length % 256 != 0)


def apply(
    image: Tensor,
    response: Response,
    border: Border,
    *,
    tiled: bool = True,
    out: Tensor | None = None,
    threads: int = 1,
) -> Tensor:
    """Pictures times a response, into ``out`` if it is given; differentiable in both without it.

    tiled: in tiles, where that is faster than one transform. On the CPU and without gradients by OpenCV's packed
    transform, for which a response is one picture's; ``threads`` share the planes and tiles, which changes no bit.
    Raises ``ValueError`` where the continued picture would be too large.
    """
    down, across = (8 * math.ceil((reach + _TAIL_PX) / 8) if reach else 0 for reach in response.reach_px)
    layout = _layout((image.shape[-2], image.shape[-1]), (down, across), border, tiled)
    y, x = layout.y, layout.x
    if y.span * x.span > LARGEST_PLANE:
        raise ValueError(
            f"{response}: border {border!r} needs a plane of {y.span}x{x.span} pixels; at most {LARGEST_PLANE} "
            "are allowed"
        )
    if layout.packs and plain(image, response.variable):
        image = image.detach()
        out = torch.empty_like(image, memory_format=torch.contiguous_format) if out is None else out
        for picture, target in zip(image.numpy(), out.numpy(), strict=True):
            if layout.dims == (-2,):  # columns are the rows of the turned picture
                picture, target = picture.swapaxes(1, 2), target.swapaxes(1, 2)
            through = _planes if len(layout.dims) == 2 else _rows
            through(picture, response, layout, border, target, threads)
        return out
    factors = response.at(layout.lengths, image)
    plane = extended(image, (y.before, x.before), (y.span, x.span), border)
    if out is None:
        out = torch.empty_like(image, memory_format=torch.contiguous_format)
    lengths = [layout.lengths[dim] for dim in layout.dims]
    for top, left in product(y.starts, x.starts):
        tile = plane[..., top : top + y.length, left : left + x.length]
        spectrum = torch.fft.rfftn(tile, dim=layout.dims)
        spectrum = spectrum * factors if factors.requires_grad else spectrum.mul_(factors)
        tile = torch.fft.irfftn(spectrum, s=lengths, dim=layout.dims)
        target = out[..., top : top + y.core, left : left + x.core]
        rows, columns = target.shape[-2:]
        target.copy_(tile[..., y.before : y.before + rows, x.before : x.before + columns])
    return out


def _planes(
    sources: Plane, response: Response, layout: Layout, border: Border, targets: Plane, threads: int
) -> None:
    """One picture (C, H, W) through OpenCV's transform over both axes, plane by plane and tile by tile."""
    y, x, lengths, kind = layout.y, layout.x, layout.lengths, sources.dtype
    with borrowed([lengths, (len(sources), y.span, x.span)], kind) as (factors, planes):
        factors = response.packed(lengths, factors)
        for source, plane in zip(sources, planes, strict=True):
            continued(source, plane, (y.before, x.before), border)

        def blur(at: tuple[int, int, int]) -> None:
            channel, top, left = at
            with borrowed([lengths] * 2, kind) as scratch:
                tile = planes[channel, top : top + y.length, left : left + x.length]
                blurred = response.multiply(tile, factors, scratch)
                target = targets[channel, top : top + y.core, left : left + x.core]
                rows, columns = target.shape
                target[:] = blurred[y.before : y.before + rows, x.before : x.before + columns]

        side_by_side(blur, product(range(len(planes)), y.starts, x.starts), threads)


def _rows(
    sources: Plane, response: Response, layout: Layout, border: Border, targets: Plane, threads: int
) -> None:
    """Pictures (C, H, W) along their rows, in strips of rows that stay in a core's cache from border to result."""
    channels, height, _ = sources.shape
    x = layout.x if -1 in layout.dims else layout.y
    strip = min(height, max(1, _STRIP // x.span))
    with borrowed([(strip, x.length)], sources.dtype) as (factors,):
        factors[:] = response.packed(layout.lengths, factors[:1])

        def blur(at: tuple[int, int]) -> None:
            channel, top = at
            source, target = sources[channel, top : top + strip], targets[channel, top : top + strip]
            rows, columns = source.shape
            with borrowed([(rows, x.span), (rows, x.length), (rows, x.length)], sources.dtype) as work:
                plane, *scratch = work
                continued(source, plane, (0, x.before), border)
                for left in x.starts:
                    tile = plane[:, left : left + x.length]
                    blurred = packed.multiply(tile, factors[:rows], scratch, rows_alone=True)
                    core = min(x.core, columns - left)
                    target[:, left : left + core] = blurred[:, x.before : x.before + core]

        side_by_side(blur, product(range(channels), range(0, height, strip)), threads)


@dataclass(frozen=True, eq=False)
class Straight:
    """Uniform motion, displacement_px (B, 2), x and y, and a lens."""

    displacement_px: Tensor
    optics: Optics = SHARP
    multiply = staticmethod(packed.multiply)

    def __str__(self) -> str:
        return f"displacement_px = {self.displacement_px.tolist()}"

    @property
    def variable(self) -> Tensor:
        return self.displacement_px

    @property
    def reach_px(self) -> tuple[float, float]:
        x, y = (along / 2 for along in self.displacement_px.detach().abs().amax(0).tolist())
        if self.optics != SHARP or self.displacement_px.requires_grad:  # which an axis at rest has, too
            return y + self.optics.reach_px + STILL_PX, x + self.optics.reach_px + STILL_PX
        return y if y > STILL_PX / 2 else 0.0, x if x > STILL_PX / 2 else 0.0

    def packed(self, lengths: tuple[int, int], out: Plane) -> Plane:
        x, y = self.displacement_px[0].tolist()
        if 1 in lengths:
            return row_factors((x, y), self.optics, lengths, out.dtype)
        return _packed((x, y), self.optics, lengths, out)

    def at(self, lengths: tuple[int, int], image: Tensor) -> Tensor:
        moved = self.displacement_px
        fy, fx = (torch.from_numpy(f).to(moved) for f in frequencies(lengths))
        response = joined(lambda fx, fy: transfer.motion(fx, fy[:, None], moved), fx, fy, lengths)
        if self.optics != SHARP:
            response = response * self.optics.response(fx, fy[:, None])
        return response[:, None]


@lru_cache(maxsize=256)
def row_factors(
    motion_px: tuple[float, float], optics: Optics, lengths: tuple[int, int], kind: np.dtype[Any]
) -> Plane:
    """Factors of a row (1, L), or of a column, cached for sweeps that move many pictures alike; read only."""
    return _packed(motion_px, optics, lengths, np.empty((1, max(lengths)), kind))


def _packed(motion_px: tuple[float, float], optics: Optics, lengths: tuple[int, int], out: Plane) -> Plane:
    fy, fx = frequencies(lengths)
    with borrowed([(len(fy), len(fx))] * 2, out.dtype) as (phase, whole):
        response = motion_response(motion_px, lengths, phase, whole)
        if optics != SHARP:
            response *= lens_response(optics, lengths, out.dtype)
        packed.pack(response.reshape(-1, out.shape[1] // 2 + 1), out)
    return out


def motion_response(
    motion_px: tuple[float, float], lengths: tuple[int, int], phase: Plane, whole: Plane
) -> Plane:
    """:func:`.transfer.motion` at :func:`frequencies`, in the second of two scratch planes of its size.

    In NumPy: on one core, at half the cost.
    """
    fy, fx = frequencies(lengths)
    dx, dy = (math.pi * along for along in motion_px)
    kind = whole.dtype

    def motion(fx: Plane, fy: Plane) -> Plane:
        at_once = whole.shape == (len(fy), len(fx))
        angle = np.add(
            (fx * dx).astype(kind), (fy * dy).astype(kind)[:, None], out=phase if at_once else None
        )
        angle += 1e-30  # sinc(0) is 1; no other phase is that small
        sine = np.sin(angle, out=whole if at_once else None)
        return np.asarray(np.divide(sine, angle, out=sine))

    return joined(motion, fx, fy, lengths)


@lru_cache(maxsize=8)
def lens_response(optics: Optics, lengths: tuple[int, int], kind: np.dtype[Any]) -> Plane:
    """A lens's response on one grid, cached; read only."""
    fy, fx = (torch.from_numpy(f.astype(kind)) for f in frequencies(lengths))
    return np.asarray(optics.response(fx, fy[:, None]).numpy())


def frequencies(lengths: tuple[int, int]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Of ``rfftn``, (fy, fx), cycles/px: its last axis goes from 0 to 1/2, another over +-1/2 back to 0.

    An axis of length 1 is not transformed.
    """
    height, width = lengths
    return np.fft.fftfreq(height) if width > 1 else np.fft.rfftfreq(height), np.fft.rfftfreq(width)


def joined(motion: Callable[[Any, Any], _Array], fx: _Array, fy: _Array, lengths: tuple[int, int]) -> _Array:
    """``motion``'s response (..., h, w), led smoothly into its alias towards half a cycle per pixel.

    A step there would ring far into the picture. At f cycles/px the alias is the response at f - 1; it has no
    weight up to f = 0.45 and half the weight at 0.5. Serves tensors and arrays alike.
    """

    def near(f: Any, length: int) -> tuple[slice, Any, Any]:
        first = math.floor((0.5 - _JOIN) * length) + 1
        band = slice(first, max(first, len(f)) if len(f) < length or length == 1 else length + 1 - first)
        inside = (0.5 - abs(f[band])) / _JOIN
        return band, f[band] + 1 - 2 * (f[band] > 0), 0.5 - (3 - inside * inside) * inside / 4

    def over_rows(fx: Any) -> _Array:
        values = motion(fx, fy)
        rows, alias, weight = near(fy, lengths[0])
        if len(alias):
            values[..., rows, :] += weight[:, None] * (motion(fx, alias) - values[..., rows, :])
        return values

    values = over_rows(fx)
    columns, alias, weight = near(fx, lengths[1])
    if len(alias):
        values[..., columns] += weight * (over_rows(alias) - values[..., columns])
    return values
