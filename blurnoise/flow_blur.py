"""Blur by motion that differs from pixel to pixel: the mean of pictures shifted along each pixel's own path.

Convention: px, x right, y down; a pixel of displacement d averages what the picture shows from d/2 before it to d/2
behind, so what moves is at mid-exposure where the picture has it. A pixel averages what passes it: a constant stays
constant. At steps of depth the picture is one sheet: the nearer side takes from the farther one and the reverse.

Sub-exposures are at most ``SPACING_PX`` apart, as many in each band of rows as its longest path needs, seen by linear
interpolation. Beside 128 exact sub-exposures that leaves about 1 DN, 8-bit sRGB RMS, of photographs on a road plane.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from blurnoise._core.borders import BORDERS, Border, extended
from blurnoise._core.checks import finite, image_batch, one_of, real_tensor
from blurnoise._core.limits import limited_motion
from blurnoise._core.threads import WORTH_IT, side_by_side
from blurnoise._core.uncompiled import uncompiled

SPACING_PX = 2.0
SHORTEST_PX = 0.5
"""A pixel that moves less keeps its value: interpolation would blur it more than the motion does."""
_BAND = 32  # rows


@uncompiled
def flow_blur(image: Tensor, displacement_px: Tensor, *, border: Border = "reflect") -> Tensor:
    """Blur pictures (B, C, H, W), float32 or float64, by each pixel's displacement, (2, H, W) or (B, 2, H, W), px.

    Returns the shape of ``image``; differentiable in both, in displacements of ``SHORTEST_PX`` and longer. Where no
    pixel moves that far ``image`` itself is returned. Raises ``TypeError`` or ``ValueError`` naming the argument.
    """
    image_batch("image", image)
    one_of("border", border, BORDERS)
    moved = flows("displacement_px", displacement_px, image)
    limited_motion("displacement_px", moved)
    far = moved.square().sum(1, keepdim=True) >= SHORTEST_PX**2
    if not bool(far.any()):
        return image
    moved = torch.where(far, moved, 0.0)
    if torch.is_grad_enabled() and (image.requires_grad or moved.requires_grad):
        pairs = zip(image, moved, strict=True)
        return torch.stack([_differentiable(picture, by, border) for picture, by in pairs])
    out = torch.empty_like(image, memory_format=torch.contiguous_format)
    for picture, by, target in zip(image.detach(), moved.detach(), out, strict=True):
        if picture.device.type == "cpu" and picture.dtype == torch.float32:
            _remapped(picture, by, target, border)
        else:
            target[:] = _differentiable(picture, by, border)
    return out


def flows(name: str, value: Tensor, image: Tensor) -> Tensor:
    """Vectors for each pixel of ``image`` (B, C, H, W), as (B, 2, H, W) in its dtype and on its device.

    value: (2, H, W) or (B, 2, H, W). Raises ``TypeError`` or ``ValueError`` naming it.
    """
    tensor = finite(name, real_tensor(name, value).to(image))
    batch, _, height, width = image.shape
    if tensor.shape not in ((2, height, width), (batch, 2, height, width), (1, 2, height, width)):
        wanted = f"(2, {height}, {width}) or ({batch}, 2, {height}, {width})"
        raise ValueError(f"{name}: shape must be {wanted}, got {tuple(tensor.shape)}")
    return tensor.expand(batch, 2, height, width)


def _bands(by: Tensor) -> list[tuple[slice, int]]:
    """Rows, and how many sub-exposures they need."""
    longest = by.detach().square().sum(0).amax(1).sqrt()
    found = []
    for top in range(0, len(longest), _BAND):
        rows = slice(top, top + _BAND)
        found.append((rows, max(1, math.ceil(float(longest[rows].max()) / SPACING_PX))))
    return found


def _times(count: int) -> list[float]:
    """Mid-times of sub-exposures, the exposure being from -1/2 to 1/2."""
    return [(place + 0.5) / count - 0.5 for place in range(count)]


def _remapped(picture: Tensor, by: Tensor, target: Tensor, border: Border) -> None:
    """By OpenCV, on the CPU, all channels of up to four together."""
    height, width = picture.shape[-2:]
    plane = extended(picture[None], (1, 1), (height + 2, width + 2), border)[0]
    groups = [np.ascontiguousarray(some.permute(1, 2, 0).numpy()) for some in torch.split(plane, 4)]
    dx, dy = (each.numpy() for each in by)
    across = np.arange(width, dtype=np.float32)

    def blur(band: tuple[slice, int]) -> None:
        rows, count = band
        along_x, along_y = dx[rows], dy[rows]
        down = np.arange(rows.start, rows.start + len(along_x), dtype=np.float32)[:, None]
        sums = [np.zeros((*along_x.shape, group.shape[2]), np.float32) for group in groups]
        for time in _times(count):
            x = _inside(across - np.float32(time) * along_x, width, border)
            y = _inside(down - np.float32(time) * along_y, height, border)
            for group, total in zip(groups, sums, strict=True):
                seen = cv2.remap(group, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
                cv2.accumulate(seen.reshape(total.shape), total)
        whole = np.concatenate(sums, 2) if len(sums) > 1 else sums[0]
        whole /= np.float32(count)
        target[:, rows] = torch.from_numpy(whole).permute(2, 0, 1)

    threads = torch.get_num_threads() if target.numel() >= WORTH_IT else 1
    side_by_side(blur, _bands(by), threads)


def _inside(place: np.typing.NDArray[np.float32], size: int, border: Border) -> np.typing.NDArray[np.float32]:
    """Positions in the picture with a margin of 1 px that show what lies at ``place``."""
    if place.min() < 0 or place.max() > size - 1:
        if border == "constant":
            place = place.clip(-1, size)
        elif border == "replicate" or size == 1:
            place = place.clip(0, size - 1)
        elif border == "circular":
            place = place % np.float32(size)
        else:
            inside = place % np.float32(2 * size - 2)
            place = np.minimum(inside, 2 * size - 2 - inside)
    return place + np.float32(1)


def _differentiable(picture: Tensor, by: Tensor, border: Border) -> Tensor:
    """The same by ``grid_sample``, of one picture (C, H, W), on any device."""
    height, width = picture.shape[-2:]
    plane = extended(picture[None], (1, 1), (height + 2, width + 2), border)
    across = torch.arange(width, dtype=picture.dtype, device=picture.device)
    parts = []
    for rows, count in _bands(by):
        along_x, along_y = by[0, rows], by[1, rows]
        down = torch.arange(rows.start, rows.start + len(along_x)).to(across)[:, None]
        total = picture.new_zeros(())
        for time in _times(count):
            x = _folded(across - time * along_x, width, border)
            y = _folded(down - time * along_y, height, border)
            grid = torch.stack([(x + 1) * (2 / (width + 1)) - 1, (y + 1) * (2 / (height + 1)) - 1], -1)
            total = total + functional.grid_sample(
                plane, grid[None], "bilinear", "border", align_corners=True
            )
        parts.append(total[0] / count)
    return torch.cat(parts, dim=-2)


def _folded(place: Tensor, size: int, border: Border) -> Tensor:
    """Positions of the picture, or of a margin of 1 px, that show what lies at ``place``."""
    if border == "constant":
        return place.clamp(-1, size)
    if border == "replicate" or size == 1:
        return place.clamp(0, size - 1)
    if border == "circular":
        return place % size
    inside = place % (2 * size - 2)
    return torch.minimum(inside, 2 * size - 2 - inside)
