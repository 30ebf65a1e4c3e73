"""Pictures (B, C, H, W) times a transfer function: one Fourier transform, or overlapping tiles of it.

A transform wraps round, so it covers a margin that holds the reach of the blur; what wraps falls outside the
picture. Only the axes that blur are transformed. A circular border wraps as it should, and so does the full
period of a reflected one. Cutting the picture into tiles (overlap-save) changes the result by no more than
the tail of the band-limited line beyond the margin, and keeps each transform in the processor's cache.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from itertools import count, product
from typing import cast

import torch
from torch import Tensor

from blurnoise import transfer
from blurnoise.borders import Border, extended
from blurnoise.transfer import SHARP, Optics

_TAIL_PX = 8  # of the band-limited line beyond its ends; the rest is 1e-4 RMS of white, in white noise
_JOIN = 0.05  # cycles/px below half of one, over which a response is led into its alias
_STILL_PX = 1e-3  # motion along an axis that is not worth its transform: an error of 1e-7
_CUTS = (1, 2, 3, 4, 6, 8, 12)  # tiles along an axis
_LARGEST_PLANE = 2**28  # values; a motion of millions of pixels should fail by name, not for want of memory


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
class Plan:
    """How a picture is cut; ``cost_ns`` per value of the picture, predicted for two cores."""

    y: Axis
    x: Axis
    dims: tuple[int, ...]
    cost_ns: float


@lru_cache(maxsize=512)
def plan(size: tuple[int, int], reach_px: tuple[float, float], border: Border, *, tiled: bool) -> Plan:
    """The fastest plan for pictures (H, W) = ``size`` and a blur that reaches ``reach_px`` (down, across).

    A reach of 0 leaves its axis alone. Without ``tiled``, one transform; otherwise the best of several cuts.
    """
    margins = [8 * math.ceil((reach + _TAIL_PX) / 8) if reach else 0 for reach in reach_px]
    dims = tuple(dim for dim, margin in zip((-2, -1), margins, strict=True) if margin)
    plans = []
    for counts in product(_CUTS, _CUTS) if tiled else [(1, 1)]:
        y, x = (_axis(*each, border) for each in zip(size, margins, counts, strict=True))
        values = y.length * x.length
        cost = len(y.starts) * len(x.starts) * (values * _ns_per_value(values) * len(dims) / 2 + 40_000)
        cost += (
            0.5 * values if len(dims) == 2 else 0.0
        )  # the transfer function itself, the same for all tiles
        plans.append(Plan(y, x, dims, cost / math.prod(size)))
    return min(plans, key=lambda each: each.cost_ns)


def _axis(size: int, margin: int, count: int, border: Border) -> Axis:
    if count == 1 and border == "circular":
        return Axis(size, size, 0, size)
    if count == 1 and border == "reflect" and 2 * margin > 2 * size:
        return Axis(size, size, 0, max(1, 2 * size - 2))
    core = math.ceil(size / count)
    return Axis(size, core, margin, _fast_length(core + 2 * margin) if margin else core)


@lru_cache(maxsize=4096)
def _fast_length(length: int) -> int:
    """The next length that a Fourier transform likes: no prime above 7, beyond 256 a multiple of 32."""
    step = 32 if length > 256 else 2
    return next(n for n in count(step * math.ceil(length / step), step) if 210**30 % n == 0)


def _ns_per_value(values: int) -> float:
    """There and back over two axes, measured on two cores; a plane that leaves the cache costs more."""
    return 2.9 if values <= 2**19 else 3.3 if values <= 2**21 else 9.0


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
    plan: Plan,
    border: Border,
    out: Tensor | None = None,
) -> Tensor:
    """Blur pictures by their motions (B, 2) and one lens, by ``plan``, into ``out`` if it is given.

    Differentiable in the pictures and the motions without ``out``. Raises ``ValueError`` where the continued
    picture would be too large.
    """
    y, x = plan.y, plan.x
    if y.span * x.span > _LARGEST_PLANE:
        raise ValueError(
            f"displacement_px = {displacement_px.tolist()}: border {border!r} needs a plane of "
            f"{y.span}x{x.span} pixels; at most {_LARGEST_PLANE} are allowed"
        )
    response = _response(displacement_px, optics, plan)
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


def _response(displacement_px: Tensor, optics: Optics, plan: Plan) -> Tensor:
    """Transfer functions (B, 1, h, w) at the frequencies of ``rfftn`` over the plan's axes."""
    fy, fx = (_frequencies(plan, dim, displacement_px) for dim in (-2, -1))

    def over_rows(fx: Tensor) -> Tensor:
        return _joined(lambda fy: transfer.motion(fx, fy, displacement_px), fy[:, None], 1)

    response = _joined(over_rows, fx, 2)
    if optics != SHARP:
        response = response * optics.response(fx, fy[:, None])
    return response[:, None]


def _frequencies(plan: Plan, dim: int, like: Tensor) -> Tensor:
    """Of ``rfftn``, cycles/px: its last axis goes from 0 to 1/2, another from 0 by way of +-1/2 back to 0."""
    length = {-2: plan.y, -1: plan.x}[dim].length
    if dim not in plan.dims:
        return like.new_zeros(1)
    frequencies = torch.fft.rfftfreq if dim == plan.dims[-1] else torch.fft.fftfreq
    return cast(Tensor, frequencies(length, dtype=like.dtype, device=like.device))


def _joined(response: Callable[[Tensor], Tensor], f: Tensor, dim: int) -> Tensor:
    """Lead ``response`` along ``dim`` smoothly into its alias, which it meets at half a cycle per pixel.

    A step there would ring far into the picture. At f cycles/px the alias, f - 1, has weight 1/2 at f = 1/2.
    """
    values = response(f)
    near = (f.flatten().abs() > 0.5 - _JOIN).nonzero()
    if len(near) == 0:
        return values
    first, count = int(near[0]), len(near)
    band = f.narrow(dim - 1, first, count) if f.ndim > 1 else f[first:]
    own = (1 + torch.sin((0.5 - band.abs()) * (math.pi / 2 / _JOIN))) / 2
    part = values.narrow(dim, first, count)
    part.copy_(torch.lerp(response(band - band.sign()), part, own))
    return values
