"""Blur by motion that differs from pixel to pixel: the mean of pictures shifted along each pixel's own path.

Convention: px, x right, y down; a pixel of displacement d averages what the picture shows from d/2 before it to d/2
behind, so what moves is at mid-exposure where the picture has it. A pixel averages what passes it: a constant stays
constant. At steps of depth the picture is one sheet: the nearer side takes from the farther one and the reverse.

Sub-exposures are at most ``SPACING_PX`` apart, as many in each band of rows as its longest path needs, their times
spread a little so that their variance is that of an even exposure. They are seen by linear interpolation of the
picture at twice its samples (Lanczos, 8 taps): of the picture itself it would lose more than all the rest does.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from blurnoise._core.borders import BORDERS, Border, extended
from blurnoise._core.checks import finite, image_batch, one_of, real_tensor
from blurnoise._core.limits import limited_motion
from blurnoise._core.threads import WORTH_IT, side_by_side
from blurnoise._core.uncompiled import uncompiled

SPACING_PX = 2.0
_BAND = 16  # rows
_MARGIN = 4  # px, for the taps
_OFFSETS = np.arange(8) - 3.5
_TAPS = np.sinc(_OFFSETS) * np.sinc(_OFFSETS / 4)
_TAPS /= _TAPS.sum()
_OPENCV = {
    "reflect": cv2.BORDER_REFLECT_101,
    "replicate": cv2.BORDER_REPLICATE,
    "circular": cv2.BORDER_WRAP,
    "constant": cv2.BORDER_CONSTANT,
}


@uncompiled
def flow_blur(image: Tensor, displacement_px: Tensor, *, border: Border = "reflect") -> Tensor:
    """Blur pictures (B, C, H, W), float32 or float64, by each pixel's displacement, (2, H, W) or (B, 2, H, W), px.

    Returns the shape of ``image``; differentiable in both. Where nothing moves ``image`` itself is returned. Raises
    ``TypeError`` or ``ValueError`` naming the argument.
    """
    image_batch("image", image)
    one_of("border", border, BORDERS)
    moved = flows("displacement_px", displacement_px, image)
    limited_motion("displacement_px", moved)
    if not (torch.is_grad_enabled() and moved.requires_grad) and not bool(moved.any()):
        return image
    return _each(image, moved, border, None)


def flow_warp(image: Tensor, displacement_px: Tensor, *, border: Border = "reflect") -> Tensor:
    """Pictures (B, C, H, W) that show at p what was at p - d(p), d as :func:`flow_blur` takes it; differentiable."""
    image_batch("image", image)
    moved = flows("displacement_px", displacement_px, image)
    return _each(image, moved, border, [1.0])


def _each(image: Tensor, moved: Tensor, border: Border, times: list[float] | None) -> Tensor:
    """Every picture at the times, in displacements, or at those that its own flow needs."""
    if torch.is_grad_enabled() and (image.requires_grad or moved.requires_grad):
        pairs = zip(image, moved, strict=True)
        return torch.stack([_differentiable(picture, by, border, times) for picture, by in pairs])
    out = torch.empty_like(image, memory_format=torch.contiguous_format)
    for picture, by, target in zip(image.detach(), moved.detach(), out, strict=True):
        if picture.device.type == "cpu" and picture.dtype == torch.float32:
            _remapped(picture, by, target, border, times)
        else:
            target[:] = _differentiable(picture, by, border, times)
    return out


def flows(name: str, value: object, image: Tensor) -> Tensor:
    """Vectors for each pixel of ``image`` (B, C, H, W), as (B, 2, H, W) in its dtype and on its device.

    value: (2, H, W) or (B, 2, H, W). Raises ``TypeError`` or ``ValueError`` naming it.
    """
    tensor = finite(name, real_tensor(name, value).to(image))
    batch, _, height, width = image.shape
    if tensor.shape not in ((2, height, width), (batch, 2, height, width), (1, 2, height, width)):
        wanted = f"(2, {height}, {width}) or ({batch}, 2, {height}, {width})"
        raise ValueError(f"{name}: shape must be {wanted}, got {tuple(tensor.shape)}")
    return tensor.expand(batch, 2, height, width)


def _bands(by: Tensor, at: list[float] | None) -> list[tuple[slice, list[float]]]:
    """Rows, and the times of the sub-exposures that they need; all at stated ones."""
    longest = by.detach().square().sum(0).amax(1).sqrt()
    bands = [slice(top, top + _BAND) for top in range(0, len(longest), _BAND)]
    return [(rows, at or _times(float(longest[rows].max()))) for rows in bands]


def _times(length_px: float) -> list[float]:
    """Times of sub-exposures, the exposure being from -1/2 to 1/2; their variance is 1/12, as its."""
    if length_px == 0:
        return [0.0]
    count = 1 + math.ceil(length_px / SPACING_PX)
    spread = 1 / math.sqrt(count * count - 1)
    return [(place + 0.5 - count / 2) * spread for place in range(count)]


def _remapped(picture: Tensor, by: Tensor, target: Tensor, border: Border, at: list[float] | None) -> None:
    """By OpenCV, on the CPU: four channels at a time, a third of the time of three, or one."""
    width = picture.shape[-1]
    source, before = _led(picture, border)
    plane = _with_margin(source, border).numpy()
    together = 1 if len(plane) == 1 else 4
    finer = [
        _finer(plane[first : first + together], together, border) for first in range(0, len(plane), together)
    ]
    dx, dy = (2 * by.numpy()).astype(np.float32)
    threads = torch.get_num_threads() if target.numel() >= WORTH_IT else 1

    def blur(band: tuple[slice, list[float]]) -> None:
        rows, times = band
        if times == [0.0]:
            target[:, rows] = picture[:, rows]
            return
        along_x, along_y = dx[rows], dy[rows]
        x0, y0 = np.meshgrid(
            2 * np.arange(width, dtype=np.float32) + before,
            2 * np.arange(rows.start, rows.start + len(along_x), dtype=np.float32) + before,
        )
        sums = [np.zeros((*along_x.shape, together), np.float32) for _ in finer]
        for time in times:
            x, y = cv2.scaleAdd(along_x, -time, x0), cv2.scaleAdd(along_y, -time, y0)
            for values, total in zip(finer, sums, strict=True):
                seen = cv2.remap(values, x, y, cv2.INTER_LINEAR, borderMode=_OPENCV[border], borderValue=0)
                cv2.accumulate(seen.reshape(total.shape), total)
        for place, total in enumerate(sums):
            some = target[place * together : (place + 1) * together, rows]
            mean = torch.from_numpy(total).permute(2, 0, 1) / len(times)
            some[:] = mean[: len(some)]

    side_by_side(blur, _bands(by, at), threads)


def _led(picture: Tensor, border: Border) -> tuple[Tensor, int]:
    """A picture (C, H, W), and how many finer values it begins before itself: where black is beyond."""
    black = border == "constant"
    return (functional.pad(picture, (1, 0, 1, 0)), 2) if black else (picture, 0)


def _with_margin(picture: Tensor, border: Border) -> Tensor:
    """A picture (C, H, W) continued as far as the taps reach."""
    height, width = (side + 2 * _MARGIN for side in picture.shape[-2:])
    return extended(picture[None], (_MARGIN, _MARGIN), (height, width), border)[0]


def _finer(plane: NDArray[np.float32], channels: int, border: Border) -> NDArray[np.float32]:
    """Up to four planes with their margin as one with a value between each two, (2 H, 2 W, channels)."""
    inside = slice(_MARGIN, -_MARGIN)
    height, width = (side - 2 * _MARGIN for side in plane.shape[1:])
    across = [cv2.filter2D(each, -1, _TAPS[None], anchor=(3, 0)) for each in plane]
    finer = np.empty((2 * height, 2 * width), np.dtype((np.void, 4 * channels)))
    for column, planes in enumerate((list(plane), across)):
        down = [cv2.filter2D(each, -1, _TAPS[:, None], anchor=(0, 3)) for each in planes]
        for row, some in enumerate((planes, down)):
            cut = [np.ascontiguousarray(each[inside, inside]) for each in some]
            merged = cv2.merge([*cut, *[cut[0]] * (channels - len(cut))])
            finer[row::2, column::2] = merged.view(finer.dtype).reshape(height, width)
    values = finer.view(np.float32).reshape(2 * height, 2 * width, channels)
    return values[: _whole(height, border), : _whole(width, border)]


def _whole(size: int, border: Border) -> int:
    """Values along a finer side of ``size`` px: without the one beyond the last pixel where the border mirrors it."""
    return 2 * size - 1 if border in ("reflect", "replicate") else 2 * size


def _differentiable(picture: Tensor, by: Tensor, border: Border, at: list[float] | None) -> Tensor:
    """The same by ``grid_sample``, of one picture (C, H, W), on any device."""
    width = picture.shape[-1]
    taps = torch.from_numpy(_TAPS).to(picture)
    source, before = _led(picture, border)
    wide = _between(_with_margin(source, border), taps)
    down, across = (_whole(side, border) for side in source.shape[-2:])
    finer = _between(wide.mT, taps).mT[None, :, :down, :across]
    finer = functional.pad(finer, (1, 1, 1, 1), mode="circular" if border == "circular" else "constant")
    size = finer.shape[-2:]
    columns = torch.arange(width).to(picture)
    parts = []
    for rows, times in _bands(by, at):
        along_x, along_y = by[0, rows], by[1, rows]
        lines = torch.arange(rows.start, rows.start + len(along_x)).to(picture)[:, None]
        total = picture.new_zeros(())
        for time in times:
            x = _folded(2 * (columns - time * along_x) + before, size[1] - 2, border) + 1
            y = _folded(2 * (lines - time * along_y) + before, size[0] - 2, border) + 1
            grid = torch.stack([2 * x / (size[1] - 1) - 1, 2 * y / (size[0] - 1) - 1], -1)
            total = total + functional.grid_sample(
                finer, grid[None], "bilinear", "border", align_corners=True
            )
        parts.append(total[0] / len(times))
    return torch.cat(parts, dim=-2)


def _between(plane: Tensor, taps: Tensor) -> Tensor:
    """Lines (C, H, W) with their margin as (C, H, 2 (W - margins)), a value between each two."""
    lines = plane[..., 1:].flatten(0, 1)[:, None]
    between = functional.conv1d(lines, taps[None, None])[:, 0].reshape(*plane.shape[:2], -1)
    return torch.stack([plane[..., _MARGIN:-_MARGIN], between], -1).flatten(-2)


def _folded(place: Tensor, size: int, border: Border) -> Tensor:
    """Positions among ``size`` values of a finer side, or one beyond, that show what lies at ``place``."""
    if border == "constant":
        return place.clamp(-1, size)
    if border == "circular":
        return place % size
    if border == "replicate" or size == 1:
        return place.clamp(0, size - 1)
    inside = place % (2 * size - 2)
    return torch.minimum(inside, 2 * size - 2 - inside)
