"""Blur by motion that differs from pixel to pixel: the mean of pictures shifted along each pixel's own path.

Convention: px, x right, y down; a pixel of displacement d averages what the picture shows from d/2 before it to d/2
behind, so what moves is at mid-exposure where the picture has it. A pixel averages what passes it: a constant stays
constant. At steps of depth the picture is one sheet: the nearer side takes from the farther one and the reverse.

Sub-exposures are at most ``SPACING_PX`` apart, as many in each band of rows as its longest path needs, their times
spread a little so that their variance is that of an even exposure. They are seen by linear interpolation of the
picture at twice its samples (Lanczos, 8 taps): of the picture itself it would lose more than all the rest does.
Linear interpolation is a blur of its own. It counts as part of the motion's, and paths are shorter for it.
"""

from __future__ import annotations

import math
from functools import lru_cache, partial

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from blurnoise._core.borders import BORDERS, Border, extended
from blurnoise._core.checks import finite, image_batch, one_of, real_tensor
from blurnoise._core.limits import limited_motion
from blurnoise._core.scratch import borrowed
from blurnoise._core.threads import WORTH_IT, side_by_side
from blurnoise._core.uncompiled import uncompiled

SPACING_PX = 2.0
_LEAST_PX = 1e-3
"""Longest path of a band of rows that stays as it is: its blur takes 4e-7 of the finest detail."""
_BAND = 16  # rows
_FINER = 128  # steps of a table of paths, to each finer value
_LONGEST = 24  # finer values: beyond, linear interpolation widens a path by less than 0.2 %
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
    if length_px <= _LEAST_PX:
        return [0.0]
    return _spread(1 + math.ceil(length_px / SPACING_PX))


def _spread(count: int) -> list[float]:
    """Even times whose variance is 1/12."""
    spread = 1 / math.sqrt(count * count - 1)
    return [(place + 0.5 - count / 2) * spread for place in range(count)]


def _shortened(along: Tensor, count: int) -> Tensor:
    """Paths, in finer values along an axis, that spread light as ``along`` does with what interpolation adds."""
    if count < 2:
        return along
    table = torch.from_numpy(_paths(count)).to(along)
    place = (along.abs() * _FINER).clamp_max(len(table) - 1.001)
    before = place.detach().long()
    low = table[before]
    short = low + (place - before) * (table[before + 1] - low)
    return torch.copysign(short + (along.abs() - _LONGEST).clamp_min(0), along)


@lru_cache(maxsize=256)
def _paths(count: int) -> NDArray[np.float64]:
    """The paths to take for those of 0, 1 / _FINER, ... finer values, at ``count`` times."""
    path = (_LONGEST + 2) * np.linspace(0, 1, 1500) ** 2
    whole, rest = np.divmod(np.abs(np.outer(path, _spread(count))), 1)
    variance = (whole**2 + (2 * whole + 1) * rest).mean(1)  # linear between the squares of whole places
    return np.interp(np.arange(_LONGEST * _FINER + 1) / _FINER, np.sqrt(12 * variance), path)


def _remapped(picture: Tensor, by: Tensor, target: Tensor, border: Border, at: list[float] | None) -> None:
    """By OpenCV, on the CPU: four channels at a time, a third of the time of three, or one."""
    width = picture.shape[-1]
    bands = _bands(by, at)
    if all(times == [0.0] for _, times in bands):
        target[:] = picture
        return
    top, bottom = _seen_rows(by, bands, border)
    source, before = _led(picture, border)
    plane = _with_margin(source, border).numpy()[:, top : len(source[0]) - len(by[0]) + bottom + 2 * _MARGIN]
    together = 1 if len(plane) == 1 else 4
    groups = [plane[first : first + together] for first in range(0, len(plane), together)]
    along = 2 * by
    threads = torch.get_num_threads() if target.numel() >= WORTH_IT else 1
    height_margined, width_margined = plane.shape[1:]
    twice = (2 * (height_margined - 2 * _MARGIN), 2 * (width_margined - 2 * _MARGIN), together)

    def blur(finer: list[NDArray[np.float32]], band: tuple[slice, list[float]]) -> None:
        rows, times = band
        if times == [0.0]:
            target[:, rows] = picture[:, rows]
            return
        along_x, along_y = (along[:, rows] if at else _shortened(along[:, rows], len(times))).numpy()
        first = rows.start - top
        shape = (len(along_x), width)
        with borrowed([shape] * 4 + [(*shape, together)] * (1 + len(finer)), np.float32) as kept:
            x0, y0, x, y, seen, *sums = kept
            x0[:] = 2 * np.arange(width, dtype=np.float32) + before
            y0[:] = (2 * np.arange(first, first + len(along_x), dtype=np.float32) + before)[:, None]
            for total in sums:
                total[:] = 0
            for time in times:
                cv2.scaleAdd(along_x, -time, x0, x)
                cv2.scaleAdd(along_y, -time, y0, y)
                for values, total in zip(finer, sums, strict=True):
                    found = seen if together > 1 else seen[..., 0]
                    cv2.remap(values, x, y, cv2.INTER_LINEAR, found, _OPENCV[border], 0)
                    cv2.accumulate(seen, total)
            for place, total in enumerate(sums):
                some = target[place * together : (place + 1) * together, rows]
                some[:] = torch.from_numpy(total).permute(2, 0, 1)[: len(some)]
                some /= len(times)

    with borrowed([twice] * len(groups), np.float32) as memory:
        finer = [_finer(group, into, border) for group, into in zip(groups, memory, strict=True)]
        side_by_side(partial(blur, finer), bands, threads)


def _seen_rows(by: Tensor, bands: list[tuple[slice, list[float]]], border: Border) -> tuple[int, int]:
    """The rows of the picture that what moves is seen in, from and to; all where its border shows other sides."""
    height = by.shape[1]
    if border not in ("reflect", "replicate"):
        return 0, height
    top, bottom = height, 0
    for rows, times in bands:
        if times == [0.0]:
            continue
        reach = math.ceil(float(by[1, rows].abs().max()) * max(map(abs, times))) + 1
        top, bottom = min(top, rows.start - reach), max(bottom, rows.stop + reach)
    return max(0, top), min(height, bottom)


def _led(picture: Tensor, border: Border) -> tuple[Tensor, int]:
    """A picture (C, H, W), and how many finer values it begins before itself: where black is beyond."""
    black = border == "constant"
    return (functional.pad(picture, (1, 0, 1, 0)), 2) if black else (picture, 0)


def _with_margin(picture: Tensor, border: Border) -> Tensor:
    """A picture (C, H, W) continued as far as the taps reach."""
    height, width = (side + 2 * _MARGIN for side in picture.shape[-2:])
    return extended(picture[None], (_MARGIN, _MARGIN), (height, width), border)[0]


def _finer(plane: NDArray[np.float32], into: NDArray[np.float32], border: Border) -> NDArray[np.float32]:
    """Up to four planes with their margin as one with a value between each two, in memory (2 H, 2 W, channels)."""
    inside = slice(_MARGIN, -_MARGIN)
    (height, width), channels = (side - 2 * _MARGIN for side in plane.shape[1:]), into.shape[2]
    pixels = into.view(np.dtype((np.void, 4 * channels)))[..., 0]
    planes = [plane.shape[1:]] * len(plane)
    with (
        borrowed([*planes, *planes], np.float32) as kept,
        borrowed([(height, width, channels)], np.float32) as (merged,),
    ):
        across, down = kept[: len(plane)], kept[len(plane) :]
        for each, found in zip(plane, across, strict=True):
            cv2.filter2D(each, -1, _TAPS[None], found, (3, 0))
        for column, some in enumerate((list(plane), across)):
            for each, found in zip(some, down, strict=True):
                cv2.filter2D(each, -1, _TAPS[:, None], found, (0, 3))
            for row, lines in enumerate((some, down)):
                cut = [each[inside, inside] for each in lines]
                cv2.merge([*cut, *[cut[0]] * (channels - len(cut))], merged)
                pixels[row::2, column::2] = merged.view(pixels.dtype)[..., 0]
    return into[: _whole(height, border), : _whole(width, border)]


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
        along_x, along_y = 2 * by[:, rows] if at else _shortened(2 * by[:, rows], len(times))
        lines = torch.arange(rows.start, rows.start + len(along_x)).to(picture)[:, None]
        total = picture.new_zeros(())
        for time in times:
            x = _folded(2 * columns - time * along_x + before, size[1] - 2, border) + 1
            y = _folded(2 * lines - time * along_y + before, size[0] - 2, border) + 1
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
