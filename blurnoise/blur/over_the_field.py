"""Defocus that changes over the picture: a few blurs of it, blended pixel by pixel.

A disc's transfer function is smooth in the square u of its radius: between the least and the greatest u of a picture
a polynomial holds it. So each pixel's disc is a sum of the discs at Chebyshev's points of u, each an exact blur of
the picture, with Lagrange's polynomials of the pixel's own u as weights: they are smooth and add up to 1. White stays
white; every pixel sees through its own disc (not: spreads into it, which differs by the change of the radius across a
disc: 8e-4 RMS of white in white noise for 0 to 2 px over 640x480, half of that over pictures twice as large).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from blurnoise._core.borders import Border
from blurnoise._core.threads import threads_for
from blurnoise.blur import fourier
from blurnoise.blur.fourier import Plane
from blurnoise.camera import transfer
from blurnoise.camera.transfer import Optics

Floats = NDArray[np.float64]
TOLERANCE = 1e-4
"""RMS error, in units of white, that a pixel's disc may have in white noise: as a Fourier transform's margin has."""
_MOST = 64  # discs
_TAIL_PX = 8  # of a band-limited disc, beside a line's: the rest is 1e-4 RMS of white, in white noise
_NODES = 16  # of a quadrature over frequencies


@dataclass(frozen=True, eq=False)
class _Discs(fourier.Response):
    """Discs of defocus and the weight of each at every pixel, (H, W)."""

    variable = torch.empty(0)
    radii_px: tuple[float, ...]
    weights: Plane

    def __str__(self) -> str:
        return f"defocus over the field, of up to {max(self.radii_px):g} px"

    @property
    def reach_px(self) -> tuple[float, float]:
        reach = max(self.radii_px) + _TAIL_PX
        return reach, reach

    def packed(self, lengths: tuple[int, int], kind: np.dtype[Any]) -> Sequence[Plane]:
        return [fourier.lens_factors(Optics(radius), lengths, kind) for radius in self.radii_px]

    def at(self, lengths: tuple[int, int], image: Tensor) -> Sequence[Tensor]:
        fy, fx = (torch.from_numpy(f).to(image) for f in fourier.frequencies(lengths))
        return [Optics(radius).response(fx, fy[:, None]) for radius in self.radii_px]


def defocus(
    image: Tensor, radius_px: Floats, *, border: Border = "reflect", tolerance: float = TOLERANCE
) -> Tensor:
    """Blur by a disc of another radius, radius_px (H, W), at every pixel; differentiable in the image.

    image: (B, C, H, W). The error of each pixel's disc is below ``tolerance``, RMS in units of white, for the worst
    picture within [0, 1]: black and white without correlation. Raises ``ValueError`` for more than 64 discs.

    >>> noise = torch.rand(1, 1, 24, 32, generator=torch.Generator().manual_seed(0))
    >>> radius_px = np.linspace(0.0, 2.0, 32)[None].repeat(24, 0)  # sharp on the left, 2 px on the right
    >>> seen = defocus(noise, radius_px)
    >>> bool(seen[..., :4].std() > 3 * seen[..., -4:].std())
    True
    """
    kind = np.dtype(np.float32 if image.dtype == torch.float32 else np.float64)
    radii = discs(float(radius_px.min()), float(radius_px.max()), tolerance)
    blend = _Discs(radii, weights((radius_px**2).astype(kind), radii))
    return fourier.apply(image, blend, border, threads=threads_for(image))


@lru_cache(maxsize=4096)
def discs(least_px: float, most_px: float, tolerance: float = TOLERANCE) -> tuple[float, ...]:
    """The fewest radii whose discs hold all from ``least_px`` to ``most_px`` within ``tolerance``.

    Raises ``ValueError`` if they are more than 64.

    >>> discs(2.0, 2.0), len(discs(0.0, 2.0))
    ((2.0,), 7)
    """
    # The error of a blend is an integral over the band, by Parseval's theorem: no picture is needed to find it.
    f, share = np.polynomial.legendre.leggauss(
        _NODES
    )  # over [-1, 1]; the band's quarter is [0, 1/2] both ways
    band = torch.from_numpy(np.hypot(f + 1, f[:, None] + 1).ravel() / 4)
    shares = np.outer(share, share).ravel() / 4
    # The error is largest between two discs: radii so dense that none of its maxima is missed.
    seen = np.linspace(least_px**2, most_px**2, 4 * math.ceil(most_px - least_px) + 33)
    exact = _of_discs(np.sqrt(seen), band)
    for count in range(1, _MOST + 1):
        middle, half = (most_px**2 + least_px**2) / 2, (most_px**2 - least_px**2) / 2
        # Chebyshev's points: a polynomial through even ones would swing towards both ends.
        points = middle + half * np.cos((np.arange(count) + 0.5) * np.pi / count)
        radii = tuple(np.sqrt(np.maximum(points, 0.0)).tolist())
        off = weights(seen, radii).T @ _of_discs(np.array(radii), band) - exact
        if np.sqrt(off**2 @ shares).max() / 2 <= tolerance:
            return radii
    raise ValueError(
        f"field_curvature_px: discs from {least_px:g} to {most_px:g} px in one picture are too many to blend"
    )


def _of_discs(radii_px: Floats, f: Tensor) -> Floats:
    """Transfer functions (n, F) at radial frequencies f (F,)."""
    return np.asarray(transfer.disc(f * torch.from_numpy(radii_px)[:, None], 1.0).numpy())


def weights(u: Plane, radii_px: tuple[float, ...]) -> Plane:
    """Lagrange's polynomials (n, ...) of :func:`discs`'s radii at squares of radii, by the barycentric formula.

    See Berrut and Trefethen, SIAM Review 46(3), 2004.

    >>> radii = discs(0.0, 2.0)
    >>> round(float(weights(np.array([1.0]), radii).sum()), 9)  # shares of the discs at a radius of 1 px
    1.0
    """
    count = len(radii_px)
    nodes = np.array(radii_px, u.dtype).reshape(-1, *[1] * u.ndim) ** 2
    apart = u - nodes
    # At a node the formula is 0 / 0: a tiny distance gives that node all of the weight.
    apart[apart == 0] = np.finfo(u.dtype).tiny
    signs = (-1.0) ** np.arange(count) * np.sin((np.arange(count) + 0.5) * np.pi / count)
    np.divide(signs.astype(u.dtype).reshape(nodes.shape), apart, out=apart)
    apart /= apart.sum(0)
    return np.asarray(apart)
