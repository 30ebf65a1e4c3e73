"""Transfer functions of paths of straight segments, each at uniform speed; complex, since a path has a sense.

Convention: frequencies in cycles/px, x right, y down, and H = mean over time of exp(-2 pi i f . x), x in px. A grid
as large as the path and its band-limited ends need gives the point spread, which is laid into a tile of the picture:
an RMS error of 1e-4 of white, in white noise of full contrast.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
import torch
from torch import Tensor

from blurnoise.blur import fourier, tiles
from blurnoise.blur.fourier import Plane
from blurnoise.camera.transfer import SHARP, Optics

_LEAST_PX = 64  # side of the small grid
_ROOM_PX = 32  # of the band-limited ends, both together
_LARGE = 1 << 20  # values of a small grid
_AT_ONCE = 1 << 12  # pieces of a path
# Nodes fill half a gigabyte, points are laid on them one by one: a longer path is a mistake, and is refused.
_MOST_POINTS, _MOST_NODES = 1 << 24, 1 << 26
_PLACES, _WEIGHTS = (torch.from_numpy(each) / 2 for each in np.polynomial.legendre.leggauss(6))
"""Points of a piece of at most a pixel: they err by 4e-8 at half a cycle per pixel both ways."""
_WIDTH, _SHAPE = 12, 26.0
"""Nodes, half a pixel apart, of the window exp(shape (sqrt(1 - x^2) - 1)): it errs by 5e-10."""
_ACROSS = [
    torch.from_numpy(each) for each in np.polynomial.legendre.leggauss(48)
]  # a quadrature over the window


@dataclass(frozen=True, eq=False)
class Path(fourier.Response):
    """Knots (2, K), px from where the picture shows the place, shares (K - 1,) of the exposure, and a lens.

    >>> there_and_back = torch.tensor([[-2.0, 2.0, -2.0], [0.0, 0.0, 0.0]], dtype=torch.float64)
    >>> Path(there_and_back, torch.tensor([0.5, 0.5], dtype=torch.float64)).reach_px[1] > 2.0
    True
    """

    knots_px: Tensor
    shares: Tensor
    optics: Optics = SHARP

    def __str__(self) -> str:
        return f"knots_px of a path over {self.knots_px.abs().amax(1).tolist()} px to either side"

    @property
    def variable(self) -> Tensor:
        return self.knots_px

    @property
    def reach_px(self) -> tuple[float, float]:
        x, y = self.knots_px.detach().abs().amax(1).tolist()
        return y + self.optics.reach_px + fourier.STILL_PX, x + self.optics.reach_px + fourier.STILL_PX

    def packed(self, lengths: tuple[int, int], kind: np.dtype[Any]) -> Sequence[Plane]:
        knots = self.knots_px
        if lengths[1] == 1:  # of a column as of a row
            knots, lengths = knots.flip(0), lengths[::-1]
        places, shares = (each.detach().numpy().tobytes() for each in (knots, self.shares))
        return [_packed(places, shares, self.optics, lengths, kind)]

    @staticmethod
    def multiply(spectrum: Plane, factors: Plane, out: Plane) -> None:
        cv2.mulSpectrums(spectrum, factors, 0, out)

    def at(self, lengths: tuple[int, int], image: Tensor) -> Sequence[Tensor]:
        dims = [dim for dim, length in zip((-2, -1), lengths, strict=True) if length > 1]
        response: Tensor = torch.fft.rfftn(spread_in(lengths, self.knots_px, self.shares), dim=dims or [-1])
        if self.optics != SHARP:
            lens = fourier.lens_response(self.optics, lengths, np.dtype(np.float64))
            response = response * torch.from_numpy(lens)
        kind = torch.complex64 if image.dtype == torch.float32 else torch.complex128
        return [response.to(device=image.device, dtype=kind)[None, None]]


@lru_cache(maxsize=16)
def _packed(
    knots: bytes, shares: bytes, optics: Optics, lengths: tuple[int, int], kind: np.dtype[np.floating]
) -> Plane:
    """A path's transfer function on a tile, packed and divided by its size; not to be written to."""
    places = torch.frombuffer(bytearray(knots), dtype=torch.float64).reshape(2, -1)
    spread = spread_in(lengths, places, torch.frombuffer(bytearray(shares), dtype=torch.float64)).numpy()
    # OpenCV's transforms are not scaled: the division by the size is done once, here.
    spectrum: Plane = cv2.dft((spread / spread.size).astype(kind))
    if optics != SHARP:
        spectrum *= fourier.lens_factors(optics, lengths, kind) * spectrum.size
    return spectrum


def spread_in(lengths: tuple[int, int], knots_px: Tensor, shares: Tensor) -> Tensor:
    """The point spread of a path in a tile of ``lengths``, which it wraps round, from (0, 0); differentiable.

    By way of the small grid unless that is large, and the larger of the two.

    >>> knots = torch.tensor([[-4.0, 4.0], [0.0, 0.0]], dtype=torch.float64)
    >>> spread = spread_in((64, 64), knots, torch.ones(1, dtype=torch.float64))
    >>> round(float(spread.sum()), 6), round(float(spread[0, 0]), 2)  # 1 over 8 px
    (1.0, 0.12)
    """
    width, height = (
        tiles.fast_length(max(_LEAST_PX, math.ceil(2 * reach) + _ROOM_PX))
        for reach in knots_px.detach().abs().amax(1).tolist()
    )
    sides = height, width
    # A grid smaller than the tile is cheaper to make; of a long path it would be larger, and then the tile serves.
    if height * width > max(_LARGE, math.prod(lengths)):
        sides = max(2, lengths[0]), max(2, lengths[1])
    fy, fx = (torch.from_numpy(f) for f in fourier.frequencies(sides))
    response: Tensor = fourier.joined(transfer_on(sides, knots_px, shares), fx, fy, sides)
    spread: Tensor = torch.fft.irfft2(response, s=sides)
    rows, columns = (
        ((torch.arange(side) + side // 2) % side - side // 2) % length
        for side, length in zip(sides, lengths, strict=True)
    )
    return spread.new_zeros(lengths).index_put((rows[:, None], columns), spread, accumulate=True)


def transfer_on(
    sides: tuple[int, int], knots_px: Tensor, shares: Tensor
) -> Callable[[Tensor, Tensor], Tensor]:
    """H (h, w) of knots (2, K) as a function of fx (w,) and fy (h,), those of a grid and their aliases.

    The path is a sum over points, laid on nodes of half a pixel through a window and transformed at once;
    differentiable. Raises ``ValueError`` where it is too long for that.

    >>> knots = torch.tensor([[-4.0, 4.0], [0.0, 0.0]], dtype=torch.float64)
    >>> response = transfer_on((64, 64), knots, torch.ones(1, dtype=torch.float64))
    >>> first_zero = response(torch.tensor([1 / 8]), torch.tensor([0.0]))  # a wave of 8 px fades over 8 px
    >>> round(abs(complex(first_zero)), 6)
    0.0
    """
    height, width = sides
    # Over a piece of at most a pixel a wave turns by half a cycle: six points integrate that.
    step = knots_px.diff()
    pieces = step.detach().norm(dim=0).ceil().clamp_min(1).long()
    ends = pieces.cumsum(0)
    many, nodes = int(ends[-1]), 4 * height * width
    if len(_PLACES) * many > _MOST_POINTS or nodes > _MOST_NODES:
        raise ValueError(
            f"trajectory: what an exposure sees of it is {float(step.detach().norm(dim=0).sum()):.4g} px long in "
            f"{len(shares)} segments on a grid of {height}x{width} px; at most {_MOST_POINTS // 12} px, "
            f"{_MOST_POINTS // 12} segments and {_MOST_NODES // 4} values are summed"
        )
    plane = torch.zeros(nodes, dtype=torch.float64)
    grid = torch.tensor([2 * width, 2 * height])[:, None, None, None]
    taps = torch.arange(_WIDTH)
    for first in range(0, many, _AT_ONCE):
        piece = torch.arange(first, min(first + _AT_ONCE, many))
        of = torch.searchsorted(ends, piece, right=True)
        within = (piece - (ends - pieces)[of])[:, None] + 0.5 + _PLACES
        place = 2 * (knots_px[:, of, None] + within / pieces[of, None] * step[:, of, None])[..., None]
        nearest = (place.detach() - _WIDTH / 2).ceil()
        columns, rows = (nearest.long() + taps) % grid
        across, down = _window((nearest + taps - place) * (2 / _WIDTH))
        # Each point carries the light of its time, so that slow parts of the path are brighter.
        weight = (shares[of] / pieces[of])[:, None, None] * _WEIGHTS[:, None] * down
        laid = weight[..., :, None] * across[..., None, :]
        plane.index_add_(
            0, (rows[..., :, None] * (2 * width) + columns[..., None, :]).flatten(), laid.flatten()
        )
    seen: Tensor = torch.fft.fft2(plane.reshape(2 * height, 2 * width))

    def at(fx: Tensor, fy: Tensor) -> Tensor:
        rows, columns = ((f * side).round().long() for f, side in ((fy, height), (fx, width)))
        # The window blurred what was laid through it: dividing by its own transform takes that out.
        laid_by = torch.outer(_window_transform(fy / 2), _window_transform(fx / 2))
        return seen[rows[:, None], columns] / laid_by

    return at


def _window(x: Tensor) -> Tensor:
    """Over [-1, 1], after Barnett, Magland and af Klinteberg, SIAM J. Sci. Comput. 41(5), 2019."""
    return torch.exp(_SHAPE * ((1 - x * x).clamp_min(1e-12).sqrt() - 1))


def _window_transform(f: Tensor) -> Tensor:
    """The window's transform at f cycles per node."""
    x, weights = _ACROSS
    waves = torch.cos(math.pi * _WIDTH * torch.outer(f, x))
    return waves @ (_window(x) * weights) * (_WIDTH / 2)
