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
from typing import Any, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from blurnoise._core import packed_fft as packed
from blurnoise._core.borders import Border, continued, extended
from blurnoise._core.scratch import borrowed
from blurnoise._core.threads import side_by_side
from blurnoise.optics import transfer
from blurnoise.optics.transfer import SHARP, Optics

_Array = TypeVar("_Array", Tensor, NDArray[Any])
_TAIL_PX = 8  # of the band-limited line beyond its ends; the rest is 1e-4 RMS of white, in white noise
_JOIN = 0.05  # cycles/px below half of one, over which a response is led into its alias
_STILL_PX = 2e-5  # along an axis that is not worth its transform: 1.4e-5 of a wave, beside other motion
_STRIP = 3 << 16  # values of a strip of rows
_CUTS = (1, 2, 3, 4, 6, 8, 12)  # tiles along an axis
LARGEST_PLANE = 2**28  # values; a motion of millions of pixels should fail by name, not for want of memory


@dataclass(frozen=True)
class Axis:
    """One axis of a plan: ``core`` pixels from each tile, ``before`` them ``margin``, the tile ``length``."""

    size: int
    core: int
    before: int
    length: int

    @property
    def starts(self) -> range:
        """Where each tile's pixels begin in the picture, and each tile in the continued picture."""
        return range(0, self.size, self.core)

    @property
    def span(self) -> int:
        """Pixels of the continued picture."""
        return self.starts[-1] + self.length


@dataclass(frozen=True)
class TransformPlan:
    """How a picture is cut; ``cost_ns`` per value of the picture, predicted for one core."""

    y: Axis
    x: Axis
    dims: tuple[int, ...]
    cost_ns: float

    @property
    def packs(self) -> bool:
        """Whether OpenCV's packed transform serves it."""
        lengths = [{-2: self.y, -1: self.x}[dim].length for dim in self.dims]
        return lengths[-1] % 2 == 0 and all(_is_fast(length) for length in lengths)


def plan(
    size: tuple[int, int], reach_px: tuple[float, float], border: Border, *, tiled: bool
) -> TransformPlan:
    """The fastest plan for pictures (H, W) = ``size`` and a blur that reaches ``reach_px`` (down, across).

    A reach of 0 leaves its axis alone. Without ``tiled``, one transform; otherwise the best of several cuts.
    """
    down, across = (8 * math.ceil((reach + _TAIL_PX) / 8) if reach else 0 for reach in reach_px)
    return _fastest(size, (down, across), border, tiled)


@lru_cache(maxsize=1024)
def _fastest(size: tuple[int, int], margins: tuple[int, int], border: Border, tiled: bool) -> TransformPlan:
    plans = []
    for counts in product(_CUTS, _CUTS) if tiled else [(1, 1)]:
        y, x = (_axis(*each, border) for each in zip(size, margins, counts, strict=True))
        blurred = ((-2, y, margins[0]), (-1, x, margins[1]))
        dims = tuple(dim for dim, axis, margin in blurred if margin and axis.length > 1) or (-1,)
        values, tiles = y.length * x.length, len(y.starts) * len(x.starts)
        cost = tiles * (values * _ns_per_value(values) * len(dims) / 2 + 20_000)
        cost += 1.4 * values if len(dims) == 2 else 0.0  # the transfer function, the same for all tiles
        plans.append(TransformPlan(y, x, dims, cost / math.prod(size)))
    return min(plans, key=lambda each: each.cost_ns)


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


def _ns_per_value(values: int) -> float:
    """There and back over two axes, measured on one core; a plane that leaves the cache costs more."""
    return 2.9 if values <= 2**20 else 3.3 if values <= 2**22 else 6.0


def reach(
    displacement_px: tuple[float, float], optics: Optics, *, every_axis: bool = False
) -> tuple[float, float]:
    """How far (down, across) a motion (x, y) and a lens spread a point, px; 0 along an axis left alone."""
    x, y = (abs(along) / 2 for along in displacement_px)
    if optics != SHARP or every_axis:
        return y + optics.reach_px + _STILL_PX, x + optics.reach_px + _STILL_PX
    return y if y > _STILL_PX / 2 else 0.0, x if x > _STILL_PX / 2 else 0.0


def multiply(
    image: Tensor,
    displacement_px: Tensor,
    optics: Optics,
    plan: TransformPlan,
    border: Border,
    out: Tensor | None = None,
    threads: int = 1,
) -> Tensor:
    """Blur pictures by their motions (B, 2) and one lens, by ``plan``, into ``out`` if it is given.

    Without ``out`` it is differentiable in the pictures and the motions. With it, on the CPU, ``threads``
    share its planes and tiles, which changes no bit. Raises ``ValueError`` where the continued
    picture would be too large.
    """
    check_span(plan, border, f"displacement_px = {displacement_px.tolist()}")
    if out is not None and image.device.type == "cpu" and plan.packs:
        for picture, motion, target in zip(image, displacement_px.tolist(), out, strict=True):
            _multiply_planes(picture, motion, optics, plan, border, target, threads)
        return out
    return filtered(image, _response(displacement_px, optics, plan), plan, border, out)


def check_span(plan: TransformPlan, border: Border, moved: str) -> None:
    """Raise ``ValueError`` where the continued picture would be too large; ``moved`` says by what."""
    y, x = plan.y, plan.x
    if y.span * x.span > LARGEST_PLANE:
        raise ValueError(
            f"{moved}: border {border!r} needs a plane of "
            f"{y.span}x{x.span} pixels; at most {LARGEST_PLANE} are allowed"
        )


def filtered(
    image: Tensor, response: Tensor, plan: TransformPlan, border: Border, out: Tensor | None = None
) -> Tensor:
    """Pictures times a response (B, 1, h, w), real or complex, at the frequencies of ``rfftn`` over a plan's axes."""
    y, x = plan.y, plan.x
    plane = extended(image, (y.before, x.before), (y.span, x.span), border)
    if out is None:
        out = torch.empty_like(image, memory_format=torch.contiguous_format)
    lengths = [{-2: y, -1: x}[dim].length for dim in plan.dims]
    for top, left in product(y.starts, x.starts):
        spectrum = torch.fft.rfftn(plane[..., top : top + y.length, left : left + x.length], dim=plan.dims)
        spectrum = spectrum * response if response.requires_grad else spectrum.mul_(response)
        tile = torch.fft.irfftn(spectrum, s=lengths, dim=plan.dims)
        target = out[..., top : top + y.core, left : left + x.core]
        rows, columns = target.shape[-2:]
        target.copy_(tile[..., y.before : y.before + rows, x.before : x.before + columns])
    return out


def _multiply_planes(
    picture: Tensor,
    motion_px: tuple[float, float],
    optics: Optics,
    plan: TransformPlan,
    border: Border,
    out: Tensor,
    threads: int,
) -> None:
    """One picture (C, H, W) through OpenCV's transform, plane by plane and tile by tile."""
    y, x, (dx, dy) = plan.y, plan.x, motion_px
    sources, targets = picture.numpy(), out.numpy()
    if plan.dims == (-1,):
        _multiply_rows(sources, dx, x, border, targets, threads)
        return
    if plan.dims == (-2,):  # columns are the rows of the turned picture
        _multiply_rows(sources.swapaxes(1, 2), dy, y, border, targets.swapaxes(1, 2), threads)
        return
    lengths = (y.length, x.length)
    with borrowed([lengths], sources.dtype) as (factors,):
        _plane_factors((dx, dy), optics, lengths, factors)
        multiply_planes(picture, factors, packed.multiply, plan, border, out, threads)


def multiply_planes(
    picture: Tensor,
    factors: packed.Plane,
    multiply: Callable[[packed.Plane, packed.Plane, Sequence[packed.Plane]], packed.Plane],
    plan: TransformPlan,
    border: Border,
    out: Tensor,
    threads: int,
) -> None:
    """One picture (C, H, W) times packed ``factors`` of a tile, by a ``multiply`` of :mod:`._core.packed_fft`."""
    y, x = plan.y, plan.x
    lengths = (y.length, x.length)
    sources, targets = picture.numpy(), out.numpy()
    with borrowed([(len(sources), y.span, x.span)], sources.dtype) as (planes,):
        for source, plane in zip(sources, planes, strict=True):
            continued(source, plane, (y.before, x.before), border)

        def blur(at: tuple[int, int, int]) -> None:
            channel, top, left = at
            with borrowed([lengths] * 2, planes.dtype) as scratch:
                tile = planes[channel, top : top + y.length, left : left + x.length]
                blurred = multiply(tile, factors, scratch)
                target = targets[channel, top : top + y.core, left : left + x.core]
                rows, columns = target.shape
                target[:] = blurred[y.before : y.before + rows, x.before : x.before + columns]

        side_by_side(blur, product(range(len(planes)), y.starts, x.starts), threads)


def _multiply_rows(
    sources: packed.Plane, along_px: float, x: Axis, border: Border, targets: packed.Plane, threads: int
) -> None:
    """Pictures (C, H, W) along their rows, in strips of rows that stay in a core's cache from border to result."""
    channels, height, _ = sources.shape
    strip = min(height, max(1, _STRIP // x.span))
    row = row_factors(along_px, x.length, sources.dtype)
    with borrowed([(strip, x.length)], sources.dtype) as (factors,):
        factors[:] = row

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


@lru_cache(maxsize=256)
def row_factors(along_px: float, length: int, kind: np.dtype[Any]) -> packed.Plane:
    """A sweep moves many pictures alike: the factors of one row, (1, length), not to be written to."""
    factors = np.empty((1, length), kind)
    _plane_factors((along_px, 0.0), SHARP, (1, length), factors)
    return factors


def _response(displacement_px: Tensor, optics: Optics, plan: TransformPlan) -> Tensor:
    """Transfer functions (B, 1, h, w) at the frequencies of ``rfftn`` over the plan's axes."""
    lengths = (plan.y.length if -2 in plan.dims else 1, plan.x.length if -1 in plan.dims else 1)
    fy, fx = (torch.from_numpy(f).to(displacement_px) for f in frequencies(lengths))

    def motion(fx: Tensor, fy: Tensor) -> Tensor:
        return transfer.motion(fx, fy[:, None], displacement_px)

    response = joined(motion, fx, fy, lengths)
    if optics != SHARP:
        response = response * optics.response(fx, fy[:, None])
    return response[:, None]


def _plane_factors(
    motion_px: tuple[float, float], optics: Optics, lengths: tuple[int, int], out: packed.Plane
) -> None:
    """What ``_response`` gives, for one picture and packed, in NumPy: on one core, at half the cost."""
    fy, fx = frequencies(lengths)
    with borrowed([(len(fy), len(fx))] * 2, out.dtype) as (phase, whole):
        response = motion_response(motion_px, lengths, phase, whole)
        if optics != SHARP:
            response *= _lens(optics, lengths, out.dtype)
        packed.pack(response, out)


def motion_response(
    motion_px: tuple[float, float], lengths: tuple[int, int], phase: packed.Plane, whole: packed.Plane
) -> packed.Plane:
    """The transfer function of a motion at :func:`frequencies`, in the second of two scratch planes of its size."""
    fy, fx = frequencies(lengths)
    dx, dy = (math.pi * along for along in motion_px)
    kind = whole.dtype

    def phase_of(fx: packed.Plane, fy: packed.Plane, out: packed.Plane | None = None) -> packed.Plane:
        phase = np.add((fx * dx).astype(kind), (fy * dy).astype(kind)[:, None], out=out)
        phase += 1e-30  # sinc(0) is 1; no other phase is that small
        return np.asarray(phase)

    def motion(fx: packed.Plane, fy: packed.Plane) -> packed.Plane:
        if whole.shape != (len(fy), len(fx)):
            part = phase_of(fx, fy)
            return np.asarray(np.sin(part) / part)
        np.sin(phase_of(fx, fy, phase), out=whole)
        return np.asarray(np.divide(whole, phase, out=whole))

    return joined(motion, fx, fy, lengths)


@lru_cache(maxsize=8)
def _lens(optics: Optics, lengths: tuple[int, int], kind: np.dtype[Any]) -> packed.Plane:
    """A camera keeps its lens: its response on one grid, not to be written to."""
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
