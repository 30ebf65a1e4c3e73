"""Defocus that changes over the picture: a few blurs of tiles of it, blended pixel by pixel.

A disc's transfer function is smooth in the square u of its radius: between the least and the greatest u of a tile a
polynomial holds it. So each pixel's disc is a sum of the discs at Chebyshev's points of u, each an exact blur of the
tile, with Lagrange's polynomials of the pixel's own u as weights: they are smooth and add up to 1. White stays white;
every pixel sees through its own disc (not: spreads into it, which differs by the change of the radius across a disc:
8e-4 RMS of white in white noise for 0 to 2 px over 640x480, half of that over pictures twice as large).
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from blurnoise._core import packed_fft as packed
from blurnoise._core.borders import Border, extended
from blurnoise._core.packed_fft import Plane
from blurnoise._core.threads import borrowed, plain, side_by_side, threads_for
from blurnoise.blur import fourier
from blurnoise.optics import transfer

Floats = NDArray[np.float64]
TOLERANCE = 1e-4
"""RMS error, in units of white, that a pixel's disc may have in white noise: as a Fourier transform's margin has."""
_MOST = 64  # discs of a tile
_CUTS = (1, 2, 3, 4, 6, 8)
_TAIL_PX = 16  # of a band-limited disc beyond its edge: the rest is 1e-4 RMS of white, in white noise
_NODES = 16  # of a quadrature over frequencies
_NS, _TILE_NS = 1.6, 20_000  # of a transform one way with its share of the blend, per value, and beside it
_STEPS = 256  # of a pixel: tiles whose radii are this close share their discs


class Tile(NamedTuple):
    """A tile of a picture, its margin, and the radii whose discs are blended there, px."""

    rows: slice
    columns: slice
    margin: int
    radii_px: tuple[float, ...]

    @property
    def spans(self) -> tuple[int, int]:
        """Size of the tile with its margin, rounded up for fast Fourier transforms."""
        sizes = (self.rows.stop - self.rows.start, self.columns.stop - self.columns.start)
        height, width = (fourier.fast_length(size + 2 * self.margin) for size in sizes)
        return height, width

    def window(self, before: int) -> tuple[slice, slice]:
        """The tile with its margin, cut from the picture continued ``before`` px above and to the left."""
        top, left = (before + side.start - self.margin for side in (self.rows, self.columns))
        return slice(top, top + self.spans[0]), slice(left, left + self.spans[1])


def defocus(
    image: Tensor, radius_px: Floats, *, border: Border = "reflect", tiles: Sequence[Tile] | None = None
) -> Tensor:
    """Blur by a disc of another radius, radius_px (H, W), at every pixel; differentiable in the image.

    image: (B, C, H, W). tiles: what :func:`plan` gives for these radii, by default with its tolerance.
    """
    tiles = plan(radius_px) if tiles is None else tiles
    before = max(tile.margin for tile in tiles)
    height, width = (
        max(side.stop for side in axis) for axis in zip(*(tile.window(before) for tile in tiles), strict=True)
    )
    packs = plain(image)
    plane = extended(image.detach() if packs else image, (before, before), (height, width), border)
    out = torch.empty_like(image, memory_format=torch.contiguous_format)
    kind = np.dtype(np.float32 if image.dtype == torch.float32 else np.float64)

    def blur(tile: Tile) -> None:
        seen, target = plane[(..., *tile.window(before))], out[..., tile.rows, tile.columns]
        weights = _weights((radius_px[tile.rows, tile.columns] ** 2).astype(kind), tile.radii_px)
        if packs:
            _blend_packed(seen.flatten(0, 1).numpy(), tile, weights, target.flatten(0, 1).numpy())
        else:
            target.copy_(_blended(seen, tile, weights))

    side_by_side(blur, tiles, threads_for(image) if packs else 1)
    return out


def _blend_packed(sources: Plane, tile: Tile, weights: list[Plane], targets: Plane) -> None:
    """Planes of a tile with its margin, by OpenCV's packed transform."""
    factors = [_factors(radius, tile.spans, sources.dtype) for radius in tile.radii_px]
    _, height, width = targets.shape
    with borrowed([tile.spans] * 3, sources.dtype) as (spectrum, *scratch):
        for source, target in zip(sources, targets, strict=True):
            packed.forward(source, spectrum)
            target[:] = 0
            for factor, weight in zip(factors, weights, strict=True):
                seen = packed.back(spectrum, factor, scratch)[tile.margin :, tile.margin :]
                target += seen[:height, :width] * weight


def _blended(image: Tensor, tile: Tile, weights: list[Plane]) -> Tensor:
    """The blend in PyTorch, differentiable."""
    spectrum, total = torch.fft.rfft2(image), image.new_zeros(())
    for radius, weight in zip(tile.radii_px, weights, strict=True):
        response = torch.from_numpy(_response(radius, tile.spans)).to(image)
        seen = torch.fft.irfft2(spectrum * response, s=tile.spans)[..., tile.margin :, tile.margin :]
        height, width = weight.shape
        total = total + seen[..., :height, :width] * torch.from_numpy(weight).to(image)
    return total


def plan(radius_px: Floats, tolerance: float = TOLERANCE) -> list[Tile]:
    """The tiles, row by row, and their radii: what is predicted to cost least.

    The error of each pixel's disc is below ``tolerance``, RMS in units of white, for the worst picture within
    [0, 1]: black and white without correlation.
    """
    plans = [_cut(radius_px, down, across, tolerance) for down in _CUTS for across in _CUTS]
    possible = [tiles for tiles in plans if all(tile.radii_px for tile in tiles)]
    if not possible:
        raise ValueError(
            f"field_curvature_px: discs from {radius_px.min():g} to {radius_px.max():g} px in one picture are too "
            "many to blend"
        )
    return min(possible, key=_cost_ns)


def discs(least_px: float, most_px: float, tolerance: float = TOLERANCE) -> tuple[float, ...]:
    """The fewest radii whose discs hold all from ``least_px`` to ``most_px`` within ``tolerance``; () beyond 64."""
    return _discs(math.floor(least_px * _STEPS) / _STEPS, math.ceil(most_px * _STEPS) / _STEPS, tolerance)


@lru_cache(maxsize=4096)
def _discs(least_px: float, most_px: float, tolerance: float) -> tuple[float, ...]:
    if least_px == most_px:
        return (least_px,)
    f, share = np.polynomial.legendre.leggauss(
        _NODES
    )  # over [-1, 1]; the band's quarter is [0, 1/2] both ways
    band = torch.from_numpy(np.hypot(f + 1, f[:, None] + 1).ravel() / 4)
    shares = np.outer(share, share).ravel() / 4
    seen = np.linspace(least_px**2, most_px**2, 4 * math.ceil(most_px - least_px) + 33)
    exact = transfer.disc(band * torch.from_numpy(np.sqrt(seen))[:, None], 1.0).numpy()

    def suffices(count: int) -> bool:
        radii = _points(least_px, most_px, count)
        known = transfer.disc(band * torch.tensor(radii, dtype=torch.float64)[:, None], 1.0).numpy()
        off = np.stack(_weights(seen, radii)).T @ known - exact
        return bool(np.sqrt(off**2 @ shares).max() / 2 <= tolerance)

    enough = next((count for count in (1, 2, 4, 8, 16, 32, _MOST) if suffices(count)), None)
    if enough is None:
        return ()
    fewest = bisect_left(range(enough), True, lo=enough // 2 + 1, key=suffices)
    return _points(least_px, most_px, fewest)


def _points(least_px: float, most_px: float, count: int) -> tuple[float, ...]:
    """Chebyshev's points of the radius's square."""
    middle, half = (most_px**2 + least_px**2) / 2, (most_px**2 - least_px**2) / 2
    cosines = np.cos((np.arange(count) + 0.5) * np.pi / count)
    return tuple(np.sqrt(np.maximum(middle + half * cosines, 0.0)).tolist())


def _weights(u: Plane, radii_px: tuple[float, ...]) -> list[Plane]:
    """Lagrange's polynomials, one for each radius, at squares of radii."""
    nodes = [radius**2 for radius in radii_px]
    unit = max(1e-9, (nodes[0] - nodes[-1]) / 4)  # products of any number of factors stay of the order of 1
    off = [(u - node) / unit for node in nodes]
    below, above = [u * 0 + 1], [u * 0 + 1]
    for each in off[:-1]:
        below.append(below[-1] * each)
    for each in off[:0:-1]:
        above.append(above[-1] * each)
    scales = [
        math.prod((own - other) / unit for at, other in enumerate(nodes) if at != place)
        for place, own in enumerate(nodes)
    ]
    return [low * high / scale for low, high, scale in zip(below, reversed(above), scales, strict=True)]


def _cut(radius_px: Floats, down: int, across: int, tolerance: float) -> list[Tile]:
    height, width = radius_px.shape
    step_y, step_x = math.ceil(height / down), math.ceil(width / across)
    tiles = []
    for top in range(0, height, step_y):
        for left in range(0, width, step_x):
            rows, columns = slice(top, min(top + step_y, height)), slice(left, min(left + step_x, width))
            part = radius_px[rows, columns]
            least, most = float(part.min()), float(part.max())
            margin = 8 * math.ceil((most + _TAIL_PX) / 8)
            tiles.append(Tile(rows, columns, margin, discs(least, most, tolerance)))
    return tiles


def _cost_ns(tiles: list[Tile]) -> float:
    return sum((1 + len(tile.radii_px)) * (_NS * math.prod(tile.spans) + _TILE_NS) for tile in tiles)


@lru_cache(maxsize=64)
def _factors(radius_px: float, spans: tuple[int, int], kind: np.dtype[Any]) -> Plane:
    """A disc's packed factors, cached; read only."""
    factors = np.empty(spans, kind)
    packed.pack(_response(radius_px, spans), factors)
    return factors


def _response(radius_px: float, spans: tuple[int, int]) -> Floats:
    fy, fx = fourier.frequencies(spans)
    return np.asarray(transfer.disc(torch.from_numpy(np.hypot(fy[:, None], fx)), radius_px).numpy())
