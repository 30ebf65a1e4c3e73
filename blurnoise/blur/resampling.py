"""Pictures (B, C, H, W) seen at positions between their pixels: splines of the fifth degree through the pixels.

Convention: positions in px, (0, 0) the centre of the first pixel, x right, y down; outside the picture it goes on as
its border says. The spline passes through the pixels and is exact for polynomials of the fifth degree, so nothing is
displaced; halfway between pixels, at worst, it keeps 0.99999, 0.997 and 0.95 of a wave's amplitude at 0.1, 0.25 and
0.35 cycles/px. Where positions lie more than a pixel apart, what is finer than they hold aliases.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from blurnoise._core.borders import Border, extended, folded
from blurnoise._core.threads import plain, side_by_side, threads_for
from blurnoise.blur import fourier, tiles
from blurnoise.blur.fourier import Plane

Floats = NDArray[np.floating[Any]]
_Pairs = list[tuple[Floats, Floats]]
_MARGIN = 24  # px; what is further off has a weight below 1e-8 in the spline
_TAPS = 6
_STRIP = 1 << 15  # values of a strip of rows, whose weights stay in the cache


class _Prefilter(fourier.Response):
    """From pixels to the coefficients of the spline through them; wrap-around stays in the margin."""

    variable = torch.empty(0)
    reach_px = (1.0, 1.0)

    def packed(self, lengths: tuple[int, int], kind: np.dtype[Any]) -> Sequence[Plane]:
        return [_packed_prefilter(lengths, kind)]

    def at(self, lengths: tuple[int, int], image: Tensor) -> Sequence[Tensor]:
        return [torch.from_numpy(_prefilter(lengths)).to(image)]


def sampled(image: Tensor, x: Floats, y: Floats, border: Border) -> Tensor:
    """``image`` at positions x and y, (H', W') each, px: (B, C, H', W'); differentiable in the image.

    >>> ramp = torch.arange(8.0).expand(1, 1, 8, 8)
    >>> half_way = np.full((1, 1), 3.5)
    >>> round(float(sampled(ramp, half_way, half_way, "replicate")), 3)
    3.5
    """
    if image.device.type == "cpu" and not plain(image) and len(image) > 1:  # bits depend on no other picture
        return torch.cat([sampled(picture, x, y, border) for picture in torch.split(image, 1)])
    height, width = image.shape[-2:]
    spans = (tiles.fast_length(height + 2 * _MARGIN), tiles.fast_length(width + 2 * _MARGIN))
    across, down = _folded(x, width, border) + _MARGIN, _folded(y, height, border) + _MARGIN
    # The prefilter wraps round, so the margin also keeps its two ends apart.
    plane = extended(image, (_MARGIN, _MARGIN), spans, border)
    plane = fourier.apply(plane, _Prefilter(), "circular", tiled=False, threads=threads_for(image))
    rows = max(1, _STRIP // x.shape[1])
    strips = [slice(top, top + rows) for top in range(0, len(x), rows)]
    # cv2.remap takes positions in single precision only.
    if not (plain(image) and image.dtype == torch.float32 and _remaps_exactly()):
        parts = []
        for strip in strips:
            along_y, along_x = (_pairs(each[strip], np.float64) for each in (down, across))
            parts.append(_strip(plane, along_y, along_x))
        return torch.cat(parts, dim=-2)
    out = image.new_empty((*image.shape[:2], *x.shape))
    sources, targets = plane.flatten(0, 1).numpy(), out.flatten(0, 1).numpy()

    def see(strip: slice) -> None:
        along_y, along_x = _pairs(down[strip], np.float32), _pairs(across[strip], np.float32)
        for source, target in zip(sources, targets, strict=True):
            _remap(source, target[strip], along_y, along_x)

    side_by_side(see, strips, threads_for(out))
    return out


@lru_cache(maxsize=4)
def _prefilter(lengths: tuple[int, int]) -> Floats:
    """1 over the transform of the spline's weights at whole pixels, (1, 26, 66, 26, 1) / 120 along each axis."""
    down, across = (
        120 / (66 + 52 * np.cos(2 * np.pi * f) + 2 * np.cos(4 * np.pi * f))
        for f in fourier.frequencies(lengths)
    )
    return np.asarray(down[:, None] * across)


@lru_cache(maxsize=4)
def _packed_prefilter(lengths: tuple[int, int], kind: np.dtype[Any]) -> Plane:
    return fourier.pack(_prefilter(lengths).astype(kind))


def _folded(position: Floats, size: int, border: Border) -> Floats:
    """Positions within the picture, or its margin, that show the same."""
    if position.min() >= 0 and position.max() <= size - 1:
        return position
    if border == "constant":
        return position.clip(3 - _MARGIN, size + _MARGIN - 4)
    return np.asarray(folded(torch.from_numpy(position), size, border).numpy())


@lru_cache(maxsize=1)
def _remaps_exactly() -> bool:
    """Whether OpenCV samples at exact positions: before version 5 it rounds to 1/32 px."""
    ramp = np.arange(64, dtype=np.float32)[None].repeat(2, 0)
    x = np.linspace(9, 50, 997, dtype=np.float32)[None]
    return float(np.abs(cv2.remap(ramp, x, np.zeros_like(x), cv2.INTER_LINEAR) - x).max()) < 1e-4


def _remap(source: Plane, target: Plane, along_y: _Pairs, along_x: _Pairs) -> None:
    """:func:`_strip` of a plane by OpenCV, at a quarter of the time."""
    target[:] = 0
    for place_y, weight_y in along_y:
        row = np.zeros_like(target)
        for place_x, weight_x in along_x:
            tap = cv2.remap(source, place_x, place_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
            row += np.multiply(tap, weight_x, out=tap)
        target += np.multiply(row, weight_y, out=row)


def _strip(plane: Tensor, along_y: _Pairs, along_x: _Pairs) -> Tensor:
    """Six taps along each axis, two at a time by a bilinear sample between them, since no weight is negative."""
    height, width = plane.shape[-2:]
    total = plane.new_zeros(())
    for place_y, weight_y in along_y:
        for place_x, weight_x in along_x:
            grid = np.stack([place_x * (2 / (width - 1)) - 1, place_y * (2 / (height - 1)) - 1], -1)
            places = torch.from_numpy(grid).to(plane).expand(len(plane), -1, -1, -1)
            # A bilinear sample at the right point between two taps holds both: half as many along each axis.
            tap = functional.grid_sample(plane, places, "bilinear", "border", align_corners=True)
            total = total + tap * torch.from_numpy(weight_x * weight_y).to(plane)
    return total


def _pairs(position: Floats, kind: type[np.floating[Any]]) -> _Pairs:
    """Sampling position, px, and weight of each pair of taps."""
    first = np.floor(position)
    weights = _spline((position - first).astype(kind))
    first = first.astype(kind)
    pairs: _Pairs = []
    for tap in range(0, _TAPS, 2):
        both = weights[tap] + weights[tap + 1]
        pairs.append((first + (weights[tap + 1] / both + (tap - 2)), both))
    return pairs


def _spline(t: Floats) -> list[Floats]:
    """Weights of six pixels, from the second before the one at or before a position, t px before it."""
    s = 1 - t
    return [_end(s), _near(1 + t), _centre(t), _centre(s), _near(1 + s), _end(t)]


def _end(u: Floats) -> Floats:
    """The spline u px before its end."""
    q = u * u
    return q * q * u / 120


def _centre(u: Floats) -> Floats:
    """The spline up to one pixel from its centre."""
    q = u * u
    return 0.55 + q * (-0.5 + q * (0.25 - u / 12))


def _near(u: Floats) -> Floats:
    """The spline from one to two pixels."""
    return 0.425 + u * (0.625 + u * (-1.75 + u * (1.25 + u * (-0.375 + u / 24))))
