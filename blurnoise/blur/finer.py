"""Pictures (C, H, W) at two or three times their samples, in which linear interpolation loses little.

Between each two values others by Lanczos's window of 8 taps. Two ways to the same values: OpenCV's, four channels in
one array, and PyTorch's, with gradients and on any device.
"""

from __future__ import annotations

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from blurnoise._core.borders import Border, extended, folded
from blurnoise._core.threads import borrowed

Plane = NDArray[np.float32]
MARGIN = 7  # px, for the taps
_LOST = (-0.053220, 0.026210, -0.008303)  # by a mean of linear interpolations at three times the samples
_GIVEN_BACK = np.array([*_LOST[::-1], 1 - 2 * sum(_LOST), *_LOST])  # to 1 % up to 0.4 cycles/px


def with_margin(planes: Tensor, border: Border) -> tuple[Tensor, int]:
    """Planes (C, H, W) continued as far as the taps reach, and by how many pixels more before them: where black is
    beyond, there are values between the first pixel and that."""
    before = int(border == "constant")
    height, width = (side + before + 2 * MARGIN for side in planes.shape[-2:])
    return extended(planes[None], (MARGIN + before,) * 2, (height, width), border)[0], before


def given_back(planes: Plane, axes: tuple[bool, bool]) -> Plane:
    """Planes (C, H, W) sharpened by what a mean of linear interpolations will lose."""
    if not any(axes):
        return planes
    across, down = (_GIVEN_BACK if axis else np.ones(1) for axis in axes)
    return np.stack([cv2.sepFilter2D(plane, -1, across, down) for plane in planes])


def finer(plane: Plane, into: Plane, border: Border, factor: int) -> Plane:
    """Up to four planes with their margin as one of ``factor`` times their samples, in memory (h, w, channels)."""
    inside = slice(MARGIN, -MARGIN)
    (height, width), channels = (side - 2 * MARGIN for side in plane.shape[1:]), into.shape[2]
    pixels = into.view(np.dtype((np.void, 4 * channels)))[..., 0]
    planes = [plane.shape[1:]] * len(plane)
    with (
        borrowed([*planes, *planes], np.float32) as kept,
        borrowed([(height, width, channels)], np.float32) as (merged,),
    ):
        across, down = kept[: len(plane)], kept[len(plane) :]
        for column in range(factor):
            some = list(plane)
            if column:
                some = across
                for each, found in zip(plane, some, strict=True):
                    cv2.filter2D(each, -1, _taps(column / factor)[None], found, (3, 0))
            for row in range(factor):
                lines = some
                if row:
                    lines = down
                    for each, found in zip(some, lines, strict=True):
                        cv2.filter2D(each, -1, _taps(row / factor)[:, None], found, (0, 3))
                cut = [each[inside, inside] for each in lines]
                cv2.merge([*cut, *[cut[0]] * (channels - len(cut))], merged)
                pixels[row::factor, column::factor] = merged.view(pixels.dtype)[..., 0]
    return into[: _whole(height, border, factor), : _whole(width, border, factor)]


def _taps(part: float) -> NDArray[np.float64]:
    """Weights of 8 values, from the third before, of what lies ``part`` of the way to the next."""
    off = np.arange(8) - 3 - part
    taps = np.sinc(off) * np.sinc(off / 4)
    return np.asarray(taps / taps.sum())


def _whole(size: int, border: Border, factor: int) -> int:
    """Values along a finer side of ``size`` px: without those beyond the last pixel where the border mirrors it."""
    return factor * size - (factor - 1) * (border in ("reflect", "replicate"))


def finer_torch(wide: Tensor, border: Border, factor: int, axes: tuple[bool, bool]) -> Tensor:
    """A picture (C, H, W) with its margin as (1, C, h, w), what is lost along ``axes`` given back, two values more on
    every side."""
    kernel = torch.from_numpy(_GIVEN_BACK).to(wide)
    for axis in axes:
        if axis:
            lines = functional.pad(wide.flatten(0, 1)[:, None], (3, 3), mode="reflect")
            wide = functional.conv1d(lines, kernel[None, None])[:, 0].view(wide.shape)
        wide = wide.mT
    values = _between(_between(wide, factor).mT, factor).mT
    height, width = (_whole(side - 2 * MARGIN, border, factor) for side in wide.shape[1:])
    return extended(values[None, :, :height, :width], (2, 2), (height + 4, width + 4), border)


def seen_torch(values: Tensor, x: Tensor, y: Tensor, border: Border) -> Tensor:
    """Finer values (1, C, H, W), two more on every side, at places in them."""
    height, width = values.shape[-2:]
    size = (y.shape[0], x.shape[1])
    x, y = (
        (place.clamp(-2, inside + 1) if border == "constant" else folded(place, inside, border)) + 2
        for place, inside in ((x, width - 4), (y, height - 4))
    )
    x, y = x.expand(size), y.expand(size)
    grid = torch.stack([2 * x / (width - 1) - 1, 2 * y / (height - 1) - 1], -1)
    return functional.grid_sample(values, grid[None], "bilinear", "border", align_corners=True)


def _between(plane: Tensor, factor: int) -> Tensor:
    """Lines (C, H, W) with their margin as (C, H, factor (W - margins))."""
    inside = MARGIN - 4  # of the margin the taps need four
    lines = plane[..., 1 + inside : plane.shape[-1] - inside].flatten(0, 1)[:, None]
    parts = [plane[..., MARGIN:-MARGIN]]
    for part in range(1, factor):
        taps = torch.from_numpy(_taps(part / factor)).to(plane)
        parts.append(functional.conv1d(lines, taps[None, None])[:, 0].reshape(*parts[0].shape[:2], -1))
    return torch.stack(parts, -1).flatten(-2)
