"""Transfer functions of paths during an exposure; complex, since a path need not be symmetric.

Convention: frequencies in cycles/px, fx right and fy down, and H = mean over time of exp(-2 pi i f . x), x in px.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

Complex = NDArray[np.complex128]
Transfer = Callable[[NDArray[Any], NDArray[Any]], Complex]
_AT_ONCE = 1 << 20  # values of segments times frequencies
_DIRECTLY = 1 << 25  # of them, about a second; more are summed over points
_PIECE_PX = 0.25  # of a segment, two points of Gauss's, which err by 4e-4 at half a cycle per pixel both ways
_MOST_POINTS, _MOST_NODES = 1 << 24, 1 << 26
_WIDTH, _SHAPE = (
    5,
    11.5,
)  # nodes, half a pixel apart, of the window exp(shape (sqrt(1 - x^2) - 1)): it errs by 1e-4


def polyline(fx: Tensor, fy: Tensor, knots_px: Tensor, shares: Tensor) -> Tensor:
    """Straight segments, each at uniform speed, exact; differentiable in knots and shares.

    fx, fy: any shapes that broadcast. knots_px: (2, K), x and y. shares: (K - 1,) of the exposure. A segment counts
    exp(-2 pi i f . middle) sinc(f . length).
    """
    fx, fy = fx[..., None].to(knots_px), fy[..., None].to(knots_px)
    (x, y), (dx, dy) = (knots_px[:, 1:] + knots_px[:, :-1]) / 2, knots_px.diff(dim=1)
    phase = -2 * math.pi * (fx * x + fy * y)
    weights = torch.sinc(fx * dx + fy * dy) * shares.to(knots_px)
    return torch.complex((weights * phase.cos()).sum(-1), (weights * phase.sin()).sum(-1))


def polyline_grid(
    fx: NDArray[Any], fy: NDArray[Any], knots_px: NDArray[Any], shares: NDArray[Any]
) -> Complex:
    """:func:`polyline` on a grid (h, w) of fy (h,) and fx (w,), in NumPy: exponentials and sines of sums separate."""
    total = np.zeros((len(fy), len(fx)), np.complex128)
    step = max(1, _AT_ONCE // total.size)
    for first in range(0, len(shares), step):
        some = slice(first, first + step)
        (x, y), (dx, dy) = (knots_px[:, 1:] + knots_px[:, :-1])[:, some] / 2, np.diff(knots_px)[:, some]
        across, down = np.pi * np.outer(dx, fx), np.pi * np.outer(dy, fy)
        phase = across[:, None, :] + down[:, :, None]
        sines = np.cos(down)[:, :, None] * np.sin(across)[:, None, :]
        sines += np.sin(down)[:, :, None] * np.cos(across)[:, None, :]
        still = np.abs(phase) < 1e-6
        sincs = np.where(still, 1.0, sines / np.where(still, 1.0, phase))
        down_waves = np.exp(-2j * np.pi * np.outer(y, fy)) * shares[some, None]
        total += np.einsum("jhw,jh,jw->hw", sincs, down_waves, np.exp(-2j * np.pi * np.outer(x, fx)))
    return total


def polyline_on(lengths: tuple[int, int], knots_px: NDArray[Any], shares: NDArray[Any]) -> Transfer:
    """:func:`polyline_grid` as a function of fx and fy, for those of a grid of ``lengths`` (h, w) and their aliases.

    Where segments times frequencies are many, the path is a sum over points, laid on nodes of half a pixel through
    a window and transformed at once, which errs by 4e-4 at most. Raises ``ValueError`` where it is too long for that.
    """
    if len(shares) * lengths[0] * (lengths[1] // 2 + 1) <= _DIRECTLY:
        return lambda fx, fy: polyline_grid(fx, fy, knots_px, shares)
    height, width = lengths
    length_px = float(np.hypot(*np.diff(knots_px)).sum())
    nodes = 4 * height * width
    if 2 * (len(shares) + length_px / _PIECE_PX) > _MOST_POINTS or nodes > _MOST_NODES:
        raise ValueError(
            f"trajectory: what an exposure sees of it is {length_px:.4g} px long in {len(shares)} segments on a grid "
            f"of {height}x{width} px; at most {_MOST_POINTS // 8} px, {_MOST_POINTS // 2} segments and "
            f"{_MOST_NODES // 4} values are summed"
        )
    plane = np.zeros(nodes)
    for place, weight in _points(knots_px, shares, max(_AT_ONCE // 16, nodes // 4)):
        (across, x), (down, y) = (
            _laid(2 * along, 2 * size) for along, size in zip(place, (width, height), strict=True)
        )
        for row, share in zip(down, y * weight, strict=True):
            for column, other in zip(across, x, strict=True):
                plane += np.bincount(row * (2 * width) + column, share * other, nodes)
    seen = np.fft.rfft2(plane.reshape(2 * height, 2 * width))

    def at(fx: NDArray[Any], fy: NDArray[Any]) -> Complex:
        mirrored = len(fx) > 0 and bool(fx[0] < 0)  # a real plane's other half
        fx, fy = (-fx, -fy) if mirrored else (fx, fy)
        rows, columns = np.rint(fy * height).astype(int) % (2 * height), np.rint(fx * width).astype(int)
        found = seen[np.ix_(rows, columns)] / np.outer(_window(fy / 2), _window(fx / 2))
        return np.asarray(found.conj() if mirrored else found)

    return at


def _points(
    knots_px: NDArray[Any], shares: NDArray[Any], most: int
) -> Iterator[tuple[NDArray[Any], NDArray[Any]]]:
    """Points (2, n) and weights (n,) of a path, two of Gauss's on every piece of it, at most so many at a time."""
    step = np.diff(knots_px)
    pieces = np.ceil(np.hypot(*step) / _PIECE_PX).clip(1).astype(np.int64)
    ends = np.cumsum(pieces)
    for first in range(0, int(ends[-1]), most):
        piece = np.arange(first, min(first + most, int(ends[-1])))
        of = np.searchsorted(ends, piece, side="right")
        within = piece - (ends - pieces)[of]
        for gauss in (0.5 - math.sqrt(1 / 12), 0.5 + math.sqrt(1 / 12)):
            yield knots_px[:, of] + (within + gauss) / pieces[of] * step[:, of], shares[of] / pieces[of] / 2


def _laid(place: NDArray[Any], size: int) -> tuple[NDArray[Any], NDArray[Any]]:
    """Nodes (k, n) of a line that wraps round, and what the window lays on each of a point at ``place`` (n,)."""
    first = np.ceil(place - _WIDTH / 2)
    off = first + np.arange(_WIDTH)[:, None] - place
    return (first.astype(np.int64) + np.arange(_WIDTH)[:, None]) % size, _lay(2 * off / _WIDTH)


def _lay(x: NDArray[Any]) -> NDArray[Any]:
    """The window over [-1, 1], Barnett, Magland and af Klinteberg, SIAM J. Sci. Comput. 41(5), 2019."""
    return np.asarray(np.exp(_SHAPE * (np.sqrt(np.clip(1 - x * x, 0, None)) - 1)))


def _window(f: NDArray[Any]) -> NDArray[Any]:
    """The window's transform at f cycles per node."""
    x = (np.arange(512) + 0.5) / 512
    return np.asarray(np.cos(np.pi * _WIDTH * np.outer(f, x)) @ _lay(x)) * (_WIDTH / 512)


def vibration(
    along: Any, frequency_hz: float, exposure_s: float, *, middle_s: Any = 0.0, phase_rad: float = 0.0
) -> Complex:
    """A sinusoid seen from ``middle_s`` - T/2 to ``middle_s`` + T/2, ``along`` = f . a in cycles; they broadcast.

    sum_k J_k(2 pi f . a) exp(-i k (2 pi nu t + phase)) sinc(k nu T); of whole periods J0 alone. MTF50 is then at
    0.242098 / a, the first 0 at 0.382740 / a. Of a small share nu T of a period it is a line of the length
    2 pi nu T a |cos(phase)|, another at each phase: there is no one MTF (Hadar, Fisher and Kopeika 1992).
    """
    from scipy.special import jv

    x = 2 * np.pi * np.asarray(along, float)
    angle = 2 * np.pi * frequency_hz * np.asarray(middle_s, float) + phase_rad
    most = math.ceil(float(np.abs(x).max(initial=0.0))) + 30  # beyond, J_k is below 1e-16
    periods = frequency_hz * exposure_s
    total = jv(0, x) * np.ones_like(angle, np.complex128)
    for k in range(1, most):
        waves = np.exp(-1j * k * angle) + (-1) ** k * np.exp(1j * k * angle)
        total = total + jv(k, x) * np.sinc(k * periods) * waves
    return np.asarray(total)


def accelerated(along_velocity: Any, along_acceleration: Any, exposure_s: float) -> Complex:
    """Constant acceleration x = v t + g t^2 / 2, t from -T/2 to T/2, by Fresnel's integrals; of f . v and f . g.

    v is the velocity at mid-exposure: from rest, g T / 2, and then it has no zeros. Where f . g is 0 it is the sinc
    of uniform motion.
    """
    from scipy.special import fresnel

    v, g = np.broadcast_arrays(np.asarray(along_velocity, float), np.asarray(along_acceleration, float))
    uniform = np.abs(g) * exposure_s**2 < 1e-6
    rate = np.where(uniform, 1.0, g)
    q = np.sqrt(2 * np.abs(rate))
    (s1, c1), (s2, c2) = (fresnel(q * (t + v / rate)) for t in (-exposure_s / 2, exposure_s / 2))
    curved = np.exp(1j * np.pi * v**2 / rate) / (q * exposure_s) * (c2 - c1 - 1j * np.sign(rate) * (s2 - s1))
    return np.where(uniform, np.sinc(v * exposure_s), curved)
