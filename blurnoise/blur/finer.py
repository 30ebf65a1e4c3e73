"""Pictures (C, H, W) at two or three times their samples, in which linear interpolation loses little.

Between each two values others by Lanczos's window of 12 taps; along ``lossy`` axes (x, y) times what a mean of linear
interpolations loses. Two ways to the same values: OpenCV's, and PyTorch's, with gradients and on any device.
"""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from blurnoise._core.borders import Border, extended, folded
from blurnoise._core.threads import borrowed

Plane = NDArray[np.float32]
MARGIN = 9  # px, for the kernels
_LOBES = 6
_LOST = (-0.053220, 0.026210, -0.008303)  # by a mean of linear interpolations at three times the samples
_GIVEN_BACK = np.array([*_LOST[::-1], 1 - 2 * sum(_LOST), *_LOST])  # to 1 % up to 0.4 cycles/px


def with_margin(planes: Tensor, border: Border) -> Tensor:
    """Planes (C, H, W) continued as far as the kernels reach."""
    height, width = (side + 2 * MARGIN for side in planes.shape[-2:])
    return extended(planes[None], (MARGIN, MARGIN), (height, width), border)[0]


def finer(planes: Plane, into: Plane, factor: int, lossy: tuple[bool, bool]) -> None:
    """Planes with their margin at ``factor`` times their samples, into (h, w, channels); more of these are filled."""
    (height, width), channels = planes.shape[1:], into.shape[2]
    pixels = into.view(np.dtype((np.void, 4 * channels)))[..., 0]
    inside = slice(MARGIN, -MARGIN)
    with borrowed([(height, width, channels)] * 3, np.float32) as (wide, across, found):
        cv2.merge([*planes, *[planes[0]] * (channels - len(planes))], wide)
        for column in range(factor):
            cv2.filter2D(wide, -1, _kernel(column / factor, lossy[0])[None], across)
            for row in range(factor):
                cv2.filter2D(across, -1, _kernel(row / factor, lossy[1])[:, None], found)
                pixels[row::factor, column::factor] = found.view(pixels.dtype)[inside, inside, 0]


@lru_cache(maxsize=8)
def _kernel(part: float, lossy: bool) -> NDArray[np.float64]:
    """Odd weights of the values about one, for what lies ``part`` of the way to the next."""
    off = np.arange(-_LOBES, _LOBES + 1) - part
    taps = np.where(np.abs(off) < _LOBES, np.sinc(off) * np.sinc(off / _LOBES), 0.0) if part else np.ones(1)
    taps /= taps.sum()
    return np.convolve(taps, _GIVEN_BACK) if lossy else taps


def whole(size: int, border: Border, factor: int) -> int:
    """Values along a finer side of ``size`` px: without those beyond the last pixel where the border mirrors it."""
    return factor * size - (factor - 1) * (border in ("reflect", "replicate"))


def finer_torch(wide: Tensor, border: Border, factor: int, lossy: tuple[bool, bool]) -> Tensor:
    """A picture (C, H, W) with its margin as (1, C, h, w), two values more on every side."""
    values = _between(_between(wide, factor, lossy[0]).mT, factor, lossy[1]).mT
    height, width = (whole(side - 2 * MARGIN, border, factor) for side in wide.shape[1:])
    return extended(values[None, :, :height, :width], (2, 2), (height + 4, width + 4), border)


def _between(plane: Tensor, factor: int, lossy: bool) -> Tensor:
    """Lines (C, H, W) with their margin as (C, H, factor (W - margins))."""
    lines, parts = plane.flatten(0, 1)[:, None], []
    for part in range(factor):
        kernel = torch.from_numpy(_kernel(part / factor, lossy)).to(plane)
        unused = MARGIN - len(kernel) // 2
        parts.append(functional.conv1d(lines[..., unused : lines.shape[-1] - unused], kernel[None, None]))
    return torch.cat(parts, 1).mT.reshape(*plane.shape[:2], -1)


def seen_torch(values: Tensor, x: Tensor, y: Tensor, border: Border) -> Tensor:
    """Finer values (1, C, H, W), two more on every side, at places (h, w) in them: (C, h, w)."""
    height, width = values.shape[-2:]
    x, y = (
        (place.clamp(-2, inside + 1) if border == "constant" else folded(place, inside, border)) + 2
        for place, inside in ((x, width - 4), (y, height - 4))
    )
    grid = torch.stack([2 * x / (width - 1) - 1, 2 * y / (height - 1) - 1], -1)
    seen: Tensor = functional.grid_sample(values, grid[None], "bilinear", "border", align_corners=True)
    return seen[0]
