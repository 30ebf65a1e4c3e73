"""Backgrounds for rendered targets: plain, graded, rough as nature is, and cluttered; none like another.

Domain: linear RGB reflectance, (1, 3, N, N) float32, from 0.02 (soot) to 0.9 (snow).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

Floats = NDArray[np.float32]

_DARKEST, _BRIGHTEST = 0.02, 0.9
_MEANS = math.log(0.04), math.log(0.5)  # of the logarithm: asphalt when wet to light concrete
_TINT = 0.12  # standard deviation of the channels' logarithms: most things are nearly grey
_FINER = 4  # points per pixel along a side, of the clutter's edges


def background(number: int, rng: Generator, size_px: int) -> Floats:
    """Background ``number`` of a series that takes the kinds in turn, drawn from ``rng``."""
    level = rng.uniform(*_MEANS)
    logarithm = _KINDS[number % len(_KINDS)](rng, size_px, level) + _tint(rng)
    reflectance = np.exp(logarithm).clip(_DARKEST, _BRIGHTEST)
    return np.asarray(reflectance.transpose(2, 0, 1)[None], np.float32)


# Each returns natural logarithms of reflectance, (N, N, 1) or (N, N, 3), about ``level``.


def _plain(rng: Generator, size_px: int, level: float) -> Any:
    return np.full((size_px, size_px, 1), level)


def _graded(rng: Generator, size_px: int, level: float) -> Any:
    """One level that turns into another, up to four times as bright, in some direction."""
    turn, rise = rng.uniform(0, 2 * math.pi), rng.uniform(0.3, 1.0) * math.log(4)
    along = np.linspace(-0.5, 0.5, size_px)
    return (level + rise * (math.cos(turn) * along + math.sin(turn) * along[:, None]))[..., None]


def _rough(rng: Generator, size_px: int, level: float) -> Any:
    """Texture with the amplitude spectrum of natural scenes, 1/f (Field 1987); RMS 0.2 to 0.6 in the logarithm."""
    fx, fy = np.fft.rfftfreq(size_px), np.fft.fftfreq(size_px)[:, None]
    frequency = np.hypot(fx, fy)
    frequency[0, 0] = np.inf
    white = np.fft.rfft2(rng.standard_normal((size_px, size_px)))
    field = np.fft.irfft2(white / frequency, (size_px, size_px))
    return (level + rng.uniform(0.2, 0.6) * field / field.std())[..., None]


def _cluttered(rng: Generator, size_px: int, level: float) -> Any:
    """Things of all sizes that hide each other, each of a reflectance and colour of its own (dead leaves)."""
    side = size_px * _FINER
    canvas = np.full((side, side, 3), level, np.float32)
    radii = np.sort(rng.uniform(0.02, 0.25, 80) ** 2 * 4)[::-1] * side / 2
    for radius in radii.tolist():
        x, y = rng.uniform(0, side, 2).tolist()
        long, turn, round_one = rng.uniform(0.4, 1.0), rng.uniform(0, 180), rng.random() < 0.5
        tint = (level + rng.normal(0, 0.7) + rng.normal(0, 0.25, 3)).tolist()
        if round_one:
            sides = (2 * radius, 2 * radius * long)
            cv2.ellipse(canvas, ((x, y), sides, turn), tint, cv2.FILLED)
        else:
            corners = cv2.boxPoints(((x, y), (2 * radius, 2 * radius * long), turn))
            cv2.fillConvexPoly(canvas, corners.astype(np.int32), tint)
    light = cv2.resize(np.exp(canvas), (size_px, size_px), interpolation=cv2.INTER_AREA)
    return np.log(light)


def _tint(rng: Generator) -> Any:
    return rng.normal(0, _TINT, 3)


_KINDS: tuple[Callable[[Generator, int, float], Any], ...] = (_plain, _graded, _rough, _cluttered)
