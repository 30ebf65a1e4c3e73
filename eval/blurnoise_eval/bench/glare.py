"""The bench of veiling glare: ways to spread halos of 1 / r^2 around lamps.

Errors are percent of the truth, RMS over what lamps scatter onto the pixels around them. The truth is the kernel in
space, summed over all mirror images of the picture that it reaches, in double precision. Pictures (H, W, C), linear.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from scipy.signal import fftconvolve
from torch import Tensor

from blurnoise.light.veil import INNER_PX, OUTER_PX, scattered
from blurnoise_eval.bench.contest import Case, Contender, Contest

SIZES = ((640, 640), (480, 640), (360, 480))
HALO_SHARE = 0.07
_LAMP = 1000.0
_REACH_PX = 768  # three times the outer radius: 1e-5 of the light is beyond
_OCTAVES = round(math.log2(OUTER_PX / INNER_PX))
Picture = NDArray[Any]


def glare(*, quick: bool) -> Contest:
    """Halos around lamps, in pictures of the sensor's size."""
    cases = [partial(lamps, size) for size in SIZES[: 1 if quick else None]]
    return Contest("glare", "Halos around lamps, in colour", cases, error_unit="% RMS")


def lamps(size: tuple[int, int]) -> Case:
    """Dark pictures with lamps: of one pixel, of 6 x 6 px, and in the corner."""
    light = np.full((*size, 3), 0.05, np.float32)
    around = np.ones(size, bool)
    for y, x, side in ((size[0] // 3, size[1] // 2, 1), (size[0] // 2, size[1] // 3, 6), (0, size[1] - 4, 4)):
        light[y : y + side, x : x + side] = _LAMP
        around[y : y + side, x : x + side] = False
    expected = by_kernel(light.astype(float), _REACH_PX)[around] - (1 - HALO_SHARE) * 0.05
    planes = torch.from_numpy(light).permute(2, 0, 1)[None].contiguous()
    ways = [
        Contender("blurnoise", lambda: scattered(planes, 0.0, HALO_SHARE), True),
        Contender("kernel, FFT of 256 px more", lambda: by_kernel(light, round(OUTER_PX))),
        Contender("pyramid of averages", lambda: _mixed(light, by_pyramid)),
        Contender(f"{_OCTAVES} x cv2.GaussianBlur", lambda: _mixed(light, by_gaussians)),
    ]

    def percent(seen: Tensor | Picture) -> float:
        found = seen[0].permute(1, 2, 0).numpy() if isinstance(seen, Tensor) else seen
        off = (found[around] - (1 - HALO_SHARE) * 0.05) / expected - 1
        return 100 * float(np.sqrt(np.mean(off**2)))

    return Case(f"{size[1]}x{size[0]} px", ways, percent)


def by_kernel(light: Picture, reach_px: int) -> Picture:
    """The picture with its halos by convolution with the kernel, cut off at ``reach_px``."""
    far = np.arange(-reach_px, reach_px + 1, dtype=light.dtype)
    squared = np.maximum(far[:, None] ** 2 + far**2, 1e-3)  # the limit in the middle
    shell = np.exp(-squared / OUTER_PX**2) - np.exp(-squared / INNER_PX**2)
    kernel = shell / (2 * np.pi * math.log(OUTER_PX / INNER_PX) * squared)
    sides = ((reach_px, reach_px), (reach_px, reach_px), (0, 0))
    wide = np.pad(light, sides, mode="symmetric")
    halos = fftconvolve(wide, kernel[..., None].astype(light.dtype), mode="valid", axes=(0, 1))
    return np.asarray((1 - HALO_SHARE) * light + HALO_SHARE * halos)


def by_pyramid(light: Picture) -> Picture:
    """Halos as renderers make bloom: the mean of smaller and smaller pictures, enlarged again."""
    height, width = light.shape[:2]
    levels = [cv2.resize(light, (width // 4, height // 4), interpolation=cv2.INTER_AREA)]
    for _ in range(_OCTAVES):
        levels.append(cv2.pyrDown(levels[-1], borderType=cv2.BORDER_REFLECT))
    total = levels[-1]
    for level in levels[-2::-1]:
        total = level + cv2.resize(total, level.shape[1::-1], interpolation=cv2.INTER_LINEAR)
    return np.asarray(cv2.resize(total / len(levels), (width, height), interpolation=cv2.INTER_LINEAR))


def by_gaussians(light: Picture) -> Picture:
    """Halos as the mean of a Gaussian for each octave, as the kernel is one of all widths between."""
    sigmas = [INNER_PX / math.sqrt(2) * 2 ** (octave + 0.5) for octave in range(_OCTAVES)]
    border = cv2.BORDER_REFLECT
    return np.asarray(
        sum(cv2.GaussianBlur(light, (0, 0), sigma, borderType=border) for sigma in sigmas) / _OCTAVES
    )


def _mixed(light: Picture, halos: Callable[[Picture], Picture]) -> Picture:
    return np.asarray((1 - HALO_SHARE) * light + HALO_SHARE * halos(light))
