"""Truth of moving things by brute force: exposures as means of many moments, each displaced by Lanczos's taps.

Domain: linear light, float64 planes (C, H, W). Convention: px, x right, y down; a displacement is of what is seen, so
the picture shows at p what was at p - d. Nothing here uses :mod:`blurnoise`, which this judges. Borders are continued
by reflection; what they reach is not to be judged.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Path = Callable[[Floats], tuple[Floats, Floats]]
"""Places (x, y), px, at times."""
_LOBES = 6
_FINE = 4  # values to a pixel's side, of what is seen along a road
_BORDER = cv2.BORDER_REFLECT_101


def moments(count: int) -> Floats:
    """Times in the middle of ``count`` equal parts of an exposure from -1/2 to 1/2."""
    return (np.arange(count) + 0.5) / count - 0.5


def taps(shifts_px: Floats, reach_px: int) -> Floats:
    """Weights (n, 2 reach_px + 1) at distances from -reach_px on, of displacements (n,)."""
    off = np.arange(-reach_px, reach_px + 1) - np.asarray(shifts_px)[:, None]
    weights = np.where(np.abs(off) < _LOBES, np.sinc(off) * np.sinc(off / _LOBES), 0.0)
    return np.asarray(weights / weights.sum(1, keepdims=True))


def reach(shifts_px: Floats) -> int:
    """Of the taps of displacements."""
    return math.ceil(float(np.abs(shifts_px).max())) + _LOBES


def along_path(light: Floats, x_px: Floats, y_px: Floats) -> Floats:
    """The mean of pictures (C, H, W) displaced to each of the places of a path, (n,) each."""
    kernel = taps(y_px, reach(y_px)).T @ taps(x_px, reach(x_px)) / len(x_px)
    return np.stack([cv2.filter2D(plane, -1, kernel[::-1, ::-1], borderType=_BORDER) for plane in light])


def displaced(light: Floats, x_px: float, y_px: float) -> Floats:
    """Pictures (C, H, W) displaced once."""
    across, down = (taps(np.array([by]), reach(np.array([by])))[0, ::-1] for by in (x_px, y_px))
    return np.stack([cv2.sepFilter2D(plane, -1, across, down, borderType=_BORDER) for plane in light])


def layered(
    background: Floats,
    light: Floats,
    alpha: Floats,
    object_px: tuple[float, float],
    background_px: tuple[float, float],
    count: int,
) -> Floats:
    """An object, light (C, H, W) and matte (H, W), before a background (C, H, W), both in straight motion."""
    total = np.zeros_like(background)
    for time in moments(count):
        before = displaced(np.concatenate([light * alpha, alpha[None]]), *(time * by for by in object_px))
        behind = (
            displaced(background, *(time * by for by in background_px)) if any(background_px) else background
        )
        total += before[:-1] + (1 - before[-1].clip(0, 1)) * behind
    return total / count


def rolled(light: Floats, path: Path, row_s: float, exposure_s: float, count: int) -> Floats:
    """Rows of (C, H, W) that are exposed one after another, the middle one about time 0, each by its own moments."""
    _, height, width = light.shape
    middles = (np.arange(height) - (height - 1) / 2) * row_s
    places = [path(middle + exposure_s * moments(count)) for middle in middles]
    across, down = (max(reach(place[axis]) for place in places) for axis in (0, 1))
    plane = np.pad(light, ((0, 0), (down, down), (across, across)), mode="reflect")
    spectra, length = np.fft.rfft(plane), plane.shape[-1]
    out = np.empty_like(light)
    for row, (x, y) in enumerate(places):
        vertical = taps(y, down)
        used = np.flatnonzero(vertical.any(0))
        kernel = vertical[:, used].T @ taps(x, across) / count
        seen = (spectra[:, row + 2 * down - used] * np.fft.rfft(kernel, n=length)).sum(1)
        out[:, row] = np.fft.irfft(seen, n=length)[:, 2 * across : 2 * across + width]
    return out


def over_road(light: Floats, focal_px: float, height_m: float, travelled_m: float, count: int) -> Floats:
    """A level pinhole camera that drives straight ahead over a flat road, the horizon in the middle row.

    Each moment sees along exact paths: what is at y below the axis, in focal lengths, is at depth Z = height / y, and
    at mid-exposure it was nearer or farther by what was travelled since. Seen by cubic interpolation of the picture
    at four times its samples.
    """
    _, height, width = light.shape
    finer = np.ascontiguousarray(np.moveaxis(_finer(light), 0, -1), np.float32)
    first = height // 2  # of the road's rows; those above are the sky's
    x, y = np.meshgrid(np.arange(width) - (width - 1) / 2, np.arange(first, height) - (height - 1) / 2)
    total = np.zeros((height - first, width, len(light)))
    for time in moments(count):
        scale = 1 / (1 + travelled_m * time * y / (height_m * focal_px))
        at = [scale * x + (width - 1) / 2, scale * y + (height - 1) / 2]
        at_x, at_y = (np.float32(_FINE * along) for along in at)
        total += cv2.remap(finer, at_x, at_y, cv2.INTER_CUBIC, borderMode=_BORDER)
    return np.concatenate([light[:, :first], np.moveaxis(total, -1, 0) / count], 1)


def _finer(light: Floats) -> NDArray[np.float32]:
    channels, height, width = light.shape
    finer = np.empty((channels, _FINE * height, _FINE * width), np.float32)
    for row in range(_FINE):
        for column in range(_FINE):
            finer[:, row::_FINE, column::_FINE] = displaced(light, -column / _FINE, -row / _FINE)
    return finer
