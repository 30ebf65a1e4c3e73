"""Pictures (B, C, H, W) seen at positions between their pixels: splines of the fifth degree through the pixels.

Convention: positions in px, (0, 0) the centre of the first pixel, x right, y down; outside the picture it goes on as
its border says. The spline passes through the pixels and is exact for polynomials of the fifth degree, so nothing is
displaced; halfway between pixels, at worst, it keeps :func:`response` of a wave's amplitude: 0.99999, 0.997 and 0.95
at 0.1, 0.25 and 0.35 cycles/px. Where positions lie more than a pixel apart, what is finer than they hold aliases.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from blurnoise._core import packed_fft as packed
from blurnoise._core.borders import Border, continued, extended
from blurnoise._core.threads import borrowed, plain, side_by_side, threads_for
from blurnoise.blur import fourier

Floats = NDArray[np.floating[Any]]
_MARGIN = 24  # px; what is further off has a weight below 1e-8 in the spline
_TAPS = 6
_STRIP = 1 << 15  # values of a strip of rows, whose weights stay in the cache


def sampled(image: Tensor, x: Floats, y: Floats, border: Border) -> Tensor:
    """``image`` at positions x and y, (H', W') each, px: (B, C, H', W'); differentiable in the image."""
    height, width = image.shape[-2:]
    spans = (fourier.fast_length(height + 2 * _MARGIN), fourier.fast_length(width + 2 * _MARGIN))
    across, down = _folded(x, width, border) + _MARGIN, _folded(y, height, border) + _MARGIN
    rows = max(1, _STRIP // x.shape[1])
    strips = [slice(top, top + rows) for top in range(0, len(x), rows)]
    if plain(image) and image.dtype == torch.float32 and _remaps_exactly():
        return _remapped(image.detach(), across, down, spans, strips, border)
    at_once = 1 if image.device.type == "cpu" else len(image)  # whose bits then depend on no other picture
    factors = torch.from_numpy(_prefilter_plane(*spans)).to(image)
    planes = []
    for some in torch.split(image, at_once):
        plane = extended(some, (_MARGIN, _MARGIN), spans, border)
        planes.append(torch.fft.irfft2(torch.fft.rfft2(plane) * factors, s=spans))
    parts = []
    for strip in strips:
        along_y, along_x = (_pairs(each[strip], np.float64) for each in (down, across))
        parts.append(torch.cat([_strip(plane, along_y, along_x) for plane in planes]))
    return torch.cat(parts, dim=-2)


def response(f: float, shift_px: float = 0.5) -> complex:
    """Complex response to a wave of f cycles/px, sampled ``shift_px`` from the pixels; 1 is no loss."""
    taps = zip(range(-2, _TAPS - 2), _pieces(np.array(shift_px)), strict=True)
    seen = sum(float(weight) * cmath.exp(2j * math.pi * f * (place - shift_px)) for place, weight in taps)
    return seen * float(_prefilter(np.array(f)))


@lru_cache(maxsize=4)
def _prefilter_plane(height: int, width: int) -> Floats:
    """Prefilter for the spline's coefficients; wrap-around stays in the margin."""
    return _prefilter(np.fft.fftfreq(height))[:, None] * _prefilter(np.fft.rfftfreq(width))


@lru_cache(maxsize=4)
def _packed_prefilter(height: int, width: int) -> NDArray[np.float32]:
    factors = np.empty((height, width), np.float32)
    packed.pack(_prefilter_plane(height, width), factors)
    return factors


def _prefilter(f: Floats) -> Floats:
    """1 over the transform of the spline's weights at whole pixels, (1, 26, 66, 26, 1) / 120."""
    return np.asarray(120 / (66 + 52 * np.cos(2 * np.pi * f) + 2 * np.cos(4 * np.pi * f)))


def _folded(position: Floats, size: int, border: Border) -> Floats:
    """Positions within the picture, or its margin, that show the same."""
    if position.min() >= 0 and position.max() <= size - 1:
        return position
    if border == "circular":
        return position % size
    if border == "constant":
        return position.clip(3 - _MARGIN, size + _MARGIN - 4)
    if border == "replicate" or size == 1:
        return position.clip(0, size - 1)
    inside = position % (2 * size - 2)
    return np.minimum(inside, 2 * size - 2 - inside)


def _remapped(
    image: Tensor, x: Floats, y: Floats, spans: tuple[int, int], strips: Sequence[slice], border: Border
) -> Tensor:
    """As :func:`sampled`, by OpenCV's bilinear samples at a quarter of the time; planes share a strip's weights."""
    out = image.new_empty((*image.shape[:2], *x.shape))
    sources, targets = image.flatten(0, 1).numpy(), out.flatten(0, 1).numpy()
    threads = threads_for(out)
    planes = np.empty((len(sources), *spans), np.float32)

    def prepare(channel: int) -> None:
        with borrowed([spans] * 3, planes.dtype) as (plane, *scratch):
            continued(sources[channel], plane, (_MARGIN, _MARGIN), border)
            planes[channel] = packed.multiply(plane, _packed_prefilter(*spans), scratch)

    def see(strip: slice) -> None:
        along_y, along_x = _pairs(y[strip], np.float32), _pairs(x[strip], np.float32)
        for plane, target in zip(planes, targets, strict=True):
            seen = target[strip]
            seen[:] = 0
            for place_y, weight_y in along_y:
                row = np.zeros_like(seen)
                for place_x, weight_x in along_x:
                    tap = cv2.remap(
                        plane, place_x, place_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
                    )
                    row += np.multiply(tap, weight_x, out=tap)
                seen += np.multiply(row, weight_y, out=row)

    side_by_side(prepare, range(len(planes)), threads)
    side_by_side(see, strips, threads)
    return out


@lru_cache(maxsize=1)
def _remaps_exactly() -> bool:
    """Whether OpenCV samples at exact positions: before version 5 it rounds to 1/32 px."""
    ramp = np.arange(64, dtype=np.float32)[None].repeat(2, 0)
    x = np.linspace(9, 50, 997, dtype=np.float32)[None]
    return float(np.abs(cv2.remap(ramp, x, np.zeros_like(x), cv2.INTER_LINEAR) - x).max()) < 1e-4


def _strip(
    plane: Tensor, along_y: list[tuple[Floats, Floats]], along_x: list[tuple[Floats, Floats]]
) -> Tensor:
    """Six taps along each axis, two at a time by a bilinear sample between them, since no weight is negative."""
    height, width = plane.shape[-2:]
    seen = plane.new_zeros(())
    for place_y, weight_y in along_y:
        for place_x, weight_x in along_x:
            grid = np.stack([place_x * (2 / (width - 1)) - 1, place_y * (2 / (height - 1)) - 1], -1)
            places = torch.from_numpy(grid).to(plane).expand(len(plane), -1, -1, -1)
            tap = functional.grid_sample(plane, places, "bilinear", "border", align_corners=True)
            seen = seen + tap * torch.from_numpy(weight_x * weight_y).to(plane)
    return seen


def _pairs(position: Floats, kind: type[np.floating[Any]]) -> list[tuple[Floats, Floats]]:
    """Sampling position, px, and weight of each pair of taps."""
    first = np.floor(position)
    weights = _pieces((position - first).astype(kind))
    first = first.astype(kind)
    pairs: list[tuple[Floats, Floats]] = []
    for place in range(0, _TAPS, 2):
        both = weights[place] + weights[place + 1]
        pairs.append((first + (weights[place + 1] / both + (place - 2)), both))
    return pairs


def _pieces(t: Floats) -> list[Floats]:
    """Weights of six pixels, from the second before the one at or before a position, t px before it."""
    s = 1 - t
    return [_end(s), _near(1 + t), _core(t), _core(s), _near(1 + s), _end(t)]


def _end(u: Floats) -> Floats:
    """The spline u px before its end."""
    q = u * u
    return q * q * u / 120


def _core(u: Floats) -> Floats:
    """The spline up to one pixel from its centre."""
    q = u * u
    return 0.55 + q * (-0.5 + q * (0.25 - u / 12))


def _near(u: Floats) -> Floats:
    """The spline from one to two pixels."""
    return 0.425 + u * (0.625 + u * (-1.75 + u * (1.25 + u * (-0.375 + u / 24))))
