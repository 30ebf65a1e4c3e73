"""Pictures (B, C, H, W) times a transfer function: one Fourier transform, or overlapping tiles of it.

A transform wraps round, so it covers a margin that holds the reach of the blur; what wraps falls outside the
picture. Only the axes that blur are transformed. A circular border wraps as it should, and so does the full
period of a reflected one. Tiles: :mod:`blurnoise.blur.tiles`.

On the CPU and without gradients OpenCV's real transform serves, twice as fast as a general one. Its packed spectrum
is a real plane (h, w), w even: in each row the real and imaginary parts of neighbouring columns, (Re 0, Re 1, Im 1,
Re 2, ...); the first column and the last are packed likewise downwards.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import product
from typing import Any, TypeVar

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from blurnoise._core.borders import Border, continued, extended
from blurnoise._core.threads import differentiable, plain, side_by_side
from blurnoise.blur.tiles import Layout, layout_of, limited_plane
from blurnoise.camera import transfer
from blurnoise.camera.transfer import SHARP, Optics

Plane = NDArray[Any]
_Array = TypeVar("_Array", Tensor, Plane)
_TAIL_PX = 8  # of the band-limited line beyond its ends; the rest is 1e-4 RMS of white, in white noise
_JOIN = 0.05  # cycles/px below half of one, over which a response is led into its alias
STILL_PX = 2e-5  # along an axis that is not worth its transform: 1.4e-5 of a wave, beside other motion
_STRIP = 3 << 16  # values of a strip of rows


class Response(ABC):
    """Transfer functions by which a picture, or each of a batch, is blurred; ``str`` names the parameter in errors.

    weights: (n, H, W) of the blur by each of n, at every pixel, in their sum; None where there is one.

    >>> class Half(Response):  # of all frequencies
    ...     variable, reach_px = torch.empty(0), (1.0, 1.0)
    ...     def packed(self, lengths, kind):
    ...         return [np.full(lengths, 0.5 / math.prod(lengths), kind)]
    ...     def at(self, lengths, image):
    ...         return [torch.tensor(0.5)]
    >>> float(apply(torch.ones(1, 1, 8, 8), Half(), "reflect")[0, 0, 4, 4].round(decimals=4))
    0.5
    """

    weights: Plane | None = None

    @property
    @abstractmethod
    def variable(self) -> Tensor:
        """What it is made of, through which gradients may go."""

    @property
    @abstractmethod
    def reach_px(self) -> tuple[float, float]:
        """Spread of a point (down, across); 0 along an axis without blur."""

    @abstractmethod
    def packed(self, lengths: tuple[int, int], kind: np.dtype[Any]) -> Sequence[Plane]:
        """For one picture, each as :func:`pack` gives it, not to be written to; of one axis as a row."""

    @abstractmethod
    def at(self, lengths: tuple[int, int], image: Tensor) -> Sequence[Tensor]:
        """Each (B, 1, h, w), real or complex, at :func:`frequencies`, as ``image`` needs it; differentiable."""

    @staticmethod
    def multiply(spectrum: Plane, factors: Plane, out: Plane) -> None:
        """A packed spectrum times what :meth:`packed` gives, here of real and even transfer functions."""
        np.multiply(spectrum, factors, out=out)


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

    tiled: in tiles, where that is faster than one transform. ``threads`` share planes and tiles on the CPU, which
    changes no bit; without gradients a response is one picture's there. Raises ``ValueError`` where the continued
    picture would be too large.

    >>> still = Straight(torch.zeros(1, 2))
    >>> picture = torch.rand(1, 3, 8, 12, generator=torch.Generator().manual_seed(0))
    >>> bool((apply(picture, still, "reflect") - picture).abs().max() < 1e-6)
    True
    """
    high, wide = (8 * math.ceil((reach + _TAIL_PX) / 8) if reach else 0 for reach in response.reach_px)
    layout = layout_of((image.shape[-2], image.shape[-1]), (high, wide), border, tiled)
    y, x = layout.y, layout.x
    limited_plane(lambda: f"{response}: border {border!r} needs", y.span, x.span)
    if out is None:
        out = torch.empty_like(image, memory_format=torch.contiguous_format)
    # Of a blur along one axis the other needs no transform, which saves half of the time.
    along_rows = len(layout.dims) == 1 and response.weights is None
    if layout.packs and plain(image, response.variable) and (along_rows or len(layout.dims) == 2):
        for picture, target in zip(image.detach().numpy(), out.detach().numpy(), strict=True):
            if layout.dims == (-2,):  # columns are the rows of the turned picture
                picture, target = picture.swapaxes(1, 2), target.swapaxes(1, 2)
            through = _rows if along_rows else _planes
            through(picture, response, layout, border, target, threads)
        return out
    responses = response.at(layout.lengths, image)
    weights = None if response.weights is None else torch.from_numpy(response.weights).to(image)
    plane = extended(image, (y.before, x.before), (y.span, x.span), border)
    lengths = [layout.lengths[dim] for dim in layout.dims]
    for (window_y, down, inner_y), (window_x, across, inner_x) in product(y.tiles, x.tiles):
        spectrum, blurs = torch.fft.rfftn(plane[..., window_y, window_x], dim=layout.dims), []
        for index, factors in enumerate(responses):
            blurred = torch.fft.irfftn(spectrum * factors, s=lengths, dim=layout.dims)[..., inner_y, inner_x]
            blurs.append(blurred if weights is None else blurred * weights[index, down, across])
        out[..., down, across] = sum(blurs[1:], blurs[0])
    return out


def _planes(
    sources: Plane, response: Response, layout: Layout, border: Border, targets: Plane, threads: int
) -> None:
    """One picture (C, H, W) through OpenCV's transform over both axes, plane by plane and tile by tile."""
    y, x, lengths, kind = layout.y, layout.x, layout.lengths, sources.dtype
    factors, weights = response.packed(lengths, kind), response.weights
    planes = np.empty((len(sources), y.span, x.span), kind)
    for source, plane in zip(sources, planes, strict=True):
        continued(source, plane, (y.before, x.before), border)

    def blur(job: tuple[int, tuple[slice, slice, slice], tuple[slice, slice, slice]]) -> None:
        channel, (window_y, down, inner_y), (window_x, across, inner_x) = job
        target = targets[channel, down, across]
        spectrum, blurred = np.empty((2, *lengths), kind)
        filtered = spectrum if weights is None else np.empty(lengths, kind)
        cv2.dft(planes[channel, window_y, window_x], spectrum)
        for index, each in enumerate(factors):
            response.multiply(spectrum, each, filtered)
            cv2.dft(filtered, blurred, cv2.DFT_INVERSE)
            inner = blurred[inner_y, inner_x]
            if weights is not None:
                inner = np.multiply(inner, weights[index, down, across], out=inner)
            if index:
                target += inner
            else:
                target[:] = inner

    side_by_side(blur, product(range(len(planes)), y.tiles, x.tiles), threads)


def _rows(
    sources: Plane, response: Response, layout: Layout, border: Border, targets: Plane, threads: int
) -> None:
    """Pictures (C, H, W) along their rows, in strips of rows that stay in a core's cache from border to result."""
    (channels, height, _), kind = sources.shape, sources.dtype
    x = layout.x if -1 in layout.dims else layout.y
    strip = min(height, max(1, _STRIP // x.span))
    # Repeated once for all strips: OpenCV's product of a path takes factors as large as the spectrum.
    factors = np.repeat(response.packed(layout.lengths, kind)[0], strip, axis=0)

    def blur(job: tuple[int, int]) -> None:
        channel, top = job
        source, target = sources[channel, top : top + strip], targets[channel, top : top + strip]
        rows = len(source)
        plane = np.empty((rows, x.span), kind)
        spectrum, blurred = np.empty((2, rows, x.length), kind)
        continued(source, plane, (0, x.before), border)
        for window, core, inner in x.tiles:
            cv2.dft(plane[:, window], spectrum, cv2.DFT_ROWS)
            response.multiply(spectrum, factors[:rows], spectrum)
            cv2.dft(spectrum, blurred, cv2.DFT_ROWS | cv2.DFT_INVERSE)
            target[:, core] = blurred[:, inner]

    side_by_side(blur, product(range(channels), range(0, height, strip)), threads)


@dataclass(frozen=True, eq=False)
class Straight(Response):
    """Uniform motion, displacement_px (B, 2), x and y, and a lens.

    >>> Straight(torch.tensor([[6.0, 0.0]])).reach_px  # down and across: half of the motion to either side
    (0.0, 3.0)
    """

    displacement_px: Tensor
    optics: Optics = SHARP

    def __str__(self) -> str:
        return f"displacement_px = {self.displacement_px.tolist()}"

    @property
    def variable(self) -> Tensor:
        return self.displacement_px

    @cached_property
    def most_px(self) -> tuple[float, float]:
        """The longest motion of any picture, across and down. All else follows from it: a device is asked once."""
        x, y = self.displacement_px.detach().abs().amax(0).tolist()
        return x, y

    @property
    def reach_px(self) -> tuple[float, float]:
        x, y = (along / 2 for along in self.most_px)
        if self.optics != SHARP or differentiable(self.displacement_px):  # which an axis at rest has, too
            return y + self.optics.reach_px + STILL_PX, x + self.optics.reach_px + STILL_PX
        return y if y > STILL_PX / 2 else 0.0, x if x > STILL_PX / 2 else 0.0

    def packed(self, lengths: tuple[int, int], kind: np.dtype[Any]) -> Sequence[Plane]:
        x, y = self.displacement_px[0].tolist()
        return [(row_factors if 1 in lengths else _plane_factors)((x, y), self.optics, lengths, kind)]

    def at(self, lengths: tuple[int, int], image: Tensor) -> Sequence[Tensor]:
        moved = self.displacement_px
        fy, fx = (torch.from_numpy(f).to(moved) for f in frequencies(lengths))
        response = joined(lambda fx, fy: transfer.motion(fx, fy[:, None], moved), fx, fy, lengths)
        if self.optics != SHARP:
            response = response * self.optics.response(fx, fy[:, None])
        return [response[:, None]]


def pack(response: Plane) -> Plane:
    """A real transfer function as a packed spectrum (h, w), or (1, w), over its size for the way back; w is even.

    response: (h, w / 2 + 1), at the frequencies of ``rfft2`` and even in both axes together, or for transforms
    of rows alone (1, w / 2 + 1).

    >>> pack(np.ones((1, 3)))  # of 4 values: real 0, real and imaginary 1, real 2, each over 4
    array([[0.25, 0.25, 0.25, 0.25]])
    """
    out = np.empty((len(response), 2 * response.shape[1] - 2), response.dtype)
    out[:, 1:-1:2] = out[:, 2:-1:2] = response[:, 1:-1]
    down = (np.arange(len(response)) + 1) // 2
    # The first and the last column are real transforms of a column, and so packed downwards as rows are.
    out[:, 0], out[:, -1] = response[down, 0], response[down, -1]
    out /= out.size
    return out


def _factors(
    motion_px: tuple[float, float], optics: Optics, lengths: tuple[int, int], kind: np.dtype[Any]
) -> Plane:
    """The factors of uniform motion and a lens; of a column turned into a row."""
    response = motion_response(motion_px, lengths, kind)
    if optics != SHARP:
        response *= lens_response(optics, lengths, kind)
    return pack(response.T if lengths[1] == 1 else response)


row_factors = lru_cache(maxsize=256)(_factors)
"""The same, cached for sweeps that move many pictures alike along an axis; read only."""
_plane_factors = lru_cache(maxsize=1)(_factors)  # for the next picture of a batch that moves alike


def motion_response(motion_px: tuple[float, float], lengths: tuple[int, int], kind: np.dtype[Any]) -> Plane:
    """:func:`.transfer.motion` at :func:`frequencies`, in NumPy: on one core, at half the cost.

    >>> response = motion_response((4.0, 0.0), (1, 32), np.dtype(np.float64))
    >>> response[0, [0, 8]].round(6).tolist()  # at 0 and at 1/4 cycles/px, the first zero of 4 px
    [1.0, 0.0]
    """
    dx, dy = (math.pi * along for along in motion_px)

    def motion(fx: Plane, fy: Plane) -> Plane:
        phase = (fx * dx).astype(kind) + (fy * dy).astype(kind)[:, None]
        # Without a mask: NumPy would go over the plane twice more.
        phase += 1e-30  # sinc(0) is 1; no other phase is that small
        return np.asarray(np.divide(np.sin(phase), phase, out=phase))

    fy, fx = frequencies(lengths)
    return joined(motion, fx, fy, lengths)


@lru_cache(maxsize=64)
def lens_factors(optics: Optics, lengths: tuple[int, int], kind: np.dtype[Any]) -> Plane:
    """A lens's response as :func:`pack` gives it, cached; read only.

    >>> lens_factors(Optics(defocus_radius_px=1.0), (4, 8), np.dtype(np.float64)).shape
    (4, 8)
    """
    return pack(lens_response(optics, lengths, kind))


@lru_cache(maxsize=8)
def lens_response(optics: Optics, lengths: tuple[int, int], kind: np.dtype[Any]) -> Plane:
    """A lens's response on one grid, cached; read only.

    >>> response = lens_response(Optics(gaussian_sigma_px=1.0), (1, 8), np.dtype(np.float64))
    >>> response[0, :2].round(4).tolist()  # exp(-2 pi^2 / 64) at 1/8 cycles/px
    [1.0, 0.7346]
    """
    fy, fx = (torch.from_numpy(f.astype(kind)) for f in frequencies(lengths))
    return np.asarray(optics.response(fx, fy[:, None]).numpy())


def frequencies(lengths: tuple[int, int]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Of ``rfftn``, (fy, fx), cycles/px: its last axis goes from 0 to 1/2, another over +-1/2 back to 0.

    An axis of length 1 is not transformed.

    >>> fy, fx = frequencies((4, 4))
    >>> fy.tolist(), fx.tolist()
    ([0.0, 0.25, -0.5, -0.25], [0.0, 0.25, 0.5])
    """
    height, width = lengths
    return np.fft.fftfreq(height) if width > 1 else np.fft.rfftfreq(height), np.fft.rfftfreq(width)


def joined(motion: Callable[[Any, Any], _Array], fx: _Array, fy: _Array, lengths: tuple[int, int]) -> _Array:
    """``motion``'s response (..., h, w), led smoothly into its alias towards half a cycle per pixel.

    A step there would ring far into the picture. At f cycles/px the alias is the response at f - 1; it has no
    weight up to f = 0.45 and half the weight at 0.5. Serves tensors and arrays alike.

    >>> fx = np.array([0.0, 0.5])  # half a pixel to the left: i at 1/2 cycle/px, and -i at its alias
    >>> shifted = joined(lambda fx, fy: np.exp(1j * np.pi * fx)[None], fx, np.zeros(1), (1, 2))
    >>> abs(shifted[0]).round(6).tolist()  # the mean of both
    [1.0, 0.0]
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
            # First along y, then along x of what that gives: corners of the band meet the aliases of both axes.
            values[..., rows, :] += weight[:, None] * (motion(fx, alias) - values[..., rows, :])
        return values

    values = over_rows(fx)
    columns, alias, weight = near(fx, lengths[1])
    if len(alias):
        values[..., columns] += weight * (over_rows(alias) - values[..., columns])
    return values
