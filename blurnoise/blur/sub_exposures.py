"""The one formula of motion: a pixel's mean over its row's exposure of what passes it, layers in front first.

    I(p) = mean over k of (layers)(p - d(p, t_k)),

d a :class:`.displacement.Displacement` of each layer's own, t_k a time of the pixel's row. What moves is at
mid-exposure where the picture has it. A pixel averages what passes it: a constant stays constant. At steps of depth
the picture is one sheet: the nearer side takes from the farther one and the reverse.

Sub-exposures are as many in each band of rows as its longest way needs, their times spread a little so that their
variance is that of an even exposure. They are seen by linear interpolation of the picture at twice its samples
(:mod:`.finer`): of the picture itself it would lose more than all the rest does. Linear interpolation is a
blur of its own. Of a flow alone it counts as part of the motion's, and paths are shorter for it. Of paths and of rows
the samples are three times as many, and what a mean still loses along the axes on which they move is given back.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import ExitStack
from functools import lru_cache
from typing import Literal, NamedTuple

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from blurnoise._core.borders import BORDERS, OPENCV, Border
from blurnoise._core.checks import finite, image_batch, one_of, real_tensor
from blurnoise._core.limits import limited_motion
from blurnoise._core.scratch import borrowed
from blurnoise._core.threads import WORTH_IT, differentiable, side_by_side
from blurnoise._core.uncompiled import uncompiled
from blurnoise._core.windows import Window
from blurnoise.blur.displacement import Displacement, Readout
from blurnoise.blur.finer import MARGIN, Plane, finer, finer_torch, given_back, led, seen_torch, with_margin

SPACING_PX = 2.0
_LEAST_PX = 1e-3
"""Longest path of a band of rows that stays as it is: its blur takes 4e-7 of the finest detail."""
_FINER_PX = 0.6  # spacing where a path bends, or rows see other parts of the motion
_ALL_PLACES_PX = 0.5
_BAND = 16  # rows
_STEPS = 128  # of a table of paths, to each finer value
_LONGEST = 24  # finer values: beyond, linear interpolation widens a path by less than 0.2 %


Loss = Literal["counted", "given back", "lost"]
"""Of linear interpolation: as a part of the motion's blur, before it, or not made good."""
_FACTOR: dict[Loss, int] = {"counted": 2, "given back": 3, "lost": 2}


class Sheet(NamedTuple):
    """Light (C, h, w), times its matte where it has one, (1, h, w), how it moves, and where it begins in the picture.

    border: how it goes on beyond its sides.
    """

    light: Tensor
    moves: Displacement
    top: int = 0
    left: int = 0
    border: Border = "constant"
    matte: Tensor | None = None


class Exposed(NamedTuple):
    """Means over an exposure, (C, h, w): of all sheets, of the hindmost and the foremost alone, and how much of the
    hindmost is uncovered, (1, h, w)."""

    light: Tensor
    hindmost: Tensor
    foremost: Tensor
    uncovered: Tensor


@uncompiled
def flow_blur(image: Tensor, displacement_px: Tensor, *, border: Border = "reflect") -> Tensor:
    """Blur pictures (B, C, H, W), float32 or float64, by each pixel's displacement, (2, H, W) or (B, 2, H, W), px.

    A pixel of displacement d averages what the picture shows from d/2 before it to d/2 behind. Returns the shape of
    ``image``; differentiable in both. Where nothing moves ``image`` itself is returned. Raises ``TypeError`` or
    ``ValueError`` naming the argument.
    """
    image_batch("image", image)
    one_of("border", border, BORDERS)
    moved = flows("displacement_px", displacement_px, image)
    limited_motion("displacement_px", moved)
    if not differentiable(moved) and not bool(moved.any()):
        return image
    once = torch.ones(())
    rows = Readout(image.shape[-2], 0.0, 1.0)
    parts = [
        moved_picture(picture, Displacement(by, once, rows), border)
        for picture, by in zip(image, moved, strict=True)
    ]
    return torch.stack(parts)


def flow_warp(image: Tensor, displacement_px: Tensor, *, border: Border = "reflect") -> Tensor:
    """Pictures (B, C, H, W) that show at p what was at p - d(p), d as :func:`flow_blur` takes it; differentiable."""
    image_batch("image", image)
    moved = flows("displacement_px", displacement_px, image)
    once, rows = torch.ones(()), Readout(image.shape[-2], 0.0, 1.0)
    window, parts = Window(0, 0, image.shape[-2], image.shape[-1]), []
    for picture, by in zip(image, moved, strict=True):
        sheet = Sheet(picture, Displacement(by, once, rows), border=border)
        parts.append(_exposed([sheet], window, SPACING_PX, "lost", [1.0]).light)
    return torch.stack(parts)


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


def moved_picture(picture: Tensor, moves: Displacement, border: Border) -> Tensor:
    """A picture (C, H, W) as an exposure sees it; no brighter where rows are exposed longer."""
    window = Window(0, 0, picture.shape[-2], picture.shape[-1])
    flow_alone = moves.path is None and not moves.readout.row_s
    return moved_sheet(Sheet(picture, moves, border=border), window, flow_alone=flow_alone)


def moved_sheet(sheet: Sheet, window: Window, *, flow_alone: bool = False) -> Tensor:
    """The same of a sheet (C, h, w) in a window of the picture."""
    if flow_alone:
        return _exposed([sheet], window, SPACING_PX, "counted").light
    return _exposed([sheet], window, _FINER_PX, "given back").light


def layers_over(sheets: Sequence[Sheet], window: Window, spacing_px: float) -> Exposed:
    """Sheets, hindmost first, in a window of the picture, at most ``spacing_px`` between two sub-exposures."""
    if any(each.moves.each_row_differs for each in sheets):  # of which nothing is known more exactly
        return _exposed(sheets, window, min(spacing_px, _FINER_PX), "given back")
    return _exposed(sheets, window, spacing_px, "lost")


def _lossy(moves: Displacement, window: Window, loss: Loss) -> tuple[bool, bool]:
    """Along which axes (x, y) what is lost is given back: where something passes all places between two values."""
    if loss != "given back":
        return False, False
    least, largest = moves.extremes_px(window)
    x, y = (largest - least).max(1) >= _ALL_PLACES_PX
    return bool(x), bool(y)


def _exposed(
    sheets: Sequence[Sheet],
    window: Window,
    spacing_px: float,
    loss: Loss,
    times: list[float] | None = None,
) -> Exposed:
    bands = _bands([sheet.moves for sheet in sheets], window, spacing_px, times)
    first = sheets[0].light
    tensors = [each for sheet in sheets for each in (sheet.light, sheet.moves.even_px, sheet.matte)]
    follows = differentiable(*(each for each in tensors if each is not None))
    if not follows and first.device.type == "cpu" and first.dtype == torch.float32:
        return _by_opencv(sheets, window, bands, loss)
    return _by_torch(sheets, window, bands, loss)


def _bands(
    moves: Sequence[Displacement], window: Window, spacing_px: float, times: list[float] | None
) -> list[tuple[slice, list[float]]]:
    """Rows of a window, and the times of the sub-exposures that they need; all at stated ones."""
    longest = np.max([each.length_px(window) for each in moves], 0)
    bands = [slice(top, min(top + _BAND, window.height)) for top in range(0, window.height, _BAND)]
    return [(rows, times or _times(float(longest[rows].max()), spacing_px)) for rows in bands]


def _times(length_px: float, spacing_px: float) -> list[float]:
    """Times of sub-exposures, the exposure being from -1/2 to 1/2; their variance is 1/12, as its."""
    if length_px <= _LEAST_PX:
        return [0.0]
    return _spread(1 + max(1, math.ceil(length_px / spacing_px - 1e-6)))


def _spread(count: int) -> list[float]:
    """Even times whose variance is 1/12."""
    spread = 1 / math.sqrt(count * count - 1)
    return [(place + 0.5 - count / 2) * spread for place in range(count)]


def _shortened(along: Tensor, count: int) -> Tensor:
    """Paths, in finer values along an axis, that spread light as ``along`` does with what interpolation adds."""
    if count < 2:
        return along
    table = torch.from_numpy(_paths(count)).to(along)
    place = (along.abs() * _STEPS).clamp_max(len(table) - 1.001)
    before = place.detach().long()
    low = table[before]
    short = low + (place - before) * (table[before + 1] - low)
    return torch.copysign(short + (along.abs() - _LONGEST).clamp_min(0), along)


@lru_cache(maxsize=256)
def _paths(count: int) -> NDArray[np.float64]:
    """The paths to take for those of 0, 1 / _STEPS, ... finer values, at ``count`` times."""
    path = (_LONGEST + 2) * np.linspace(0, 1, 1500) ** 2
    whole, rest = np.divmod(np.abs(np.outer(path, _spread(count))), 1)
    variance = (whole**2 + (2 * whole + 1) * rest).mean(1)  # linear between the squares of whole places
    return np.interp(np.arange(_LONGEST * _STEPS + 1) / _STEPS, np.sqrt(12 * variance), path)


class _Finer(NamedTuple):
    """A sheet at twice its samples, up to four channels in one array, and where the window begins in it."""

    groups: list[Plane]
    matte: Plane | None
    moves: Displacement
    factor: int
    even: tuple[
        Tensor | None, Tensor
    ]  # its displacement in the window, in finer values: in the middle, and what passes
    begins: tuple[int, int]
    border: int


def _by_opencv(
    sheets: Sequence[Sheet], window: Window, bands: list[tuple[slice, list[float]]], loss: Loss
) -> Exposed:
    """On the CPU: four channels at a time, a third of the time of three, or one."""
    picture, moves = sheets[0].light.detach(), sheets[0].moves
    layered, together = len(sheets) > 1, 1 if len(picture) == 1 else 4
    stays = not layered and moves.path is None and not moves.readout.row_s  # where the way is short
    if stays and all(times == [0.0] for _, times in bands):
        return Exposed(picture, picture, picture, picture[:1])
    size = (window.height, window.width)
    light = picture.new_empty(len(picture), *size)
    bare, front = (torch.empty_like(light), torch.empty_like(light)) if layered else (light, light)
    uncovered = light.new_empty(1, *size)

    def expose(finely: list[_Finer], band: tuple[slice, list[float]]) -> None:
        rows, times = band
        if stays and times == [0.0]:
            light[:, rows] = picture[:, rows]
            return
        flat, count = (rows.stop - rows.start, window.width), len(finely[0].groups)
        with (
            borrowed([flat] * (2 + 2 * len(finely)), np.float32) as (x, y, *begins),
            borrowed([(*flat, together)] * (4 + 4 * count), np.float32) as (own, matte, clear, bares, *kept),
        ):
            seen, sums, hind, fore = (kept[part * count :][:count] for part in range(4))
            totals = [(light, sums)]
            totals += [(bare, hind), (front, fore), (uncovered, [bares])] if layered else []
            for total in (each for _, some in totals for each in some):
                total[:] = 0
            ways = [
                _Way.of(sheet, window, rows, times, loss, begins[2 * place : 2 * place + 2])
                for place, sheet in enumerate(finely)
            ]
            for moment, time in enumerate(times):
                for sheet, way in zip(finely, ways, strict=True):
                    way.at(moment, time, (x, y))
                    if sheet.matte is None:
                        for values, found in zip(sheet.groups, seen, strict=True):
                            _look(values, x, y, found, sheet.border)
                        if layered:
                            for found, total in zip(seen, hind, strict=True):
                                cv2.accumulate(found, total)
                            clear[:] = 1
                        continue
                    _look(sheet.matte, x, y, matte, sheet.border)
                    np.subtract(1, matte, out=matte)
                    np.multiply(clear, matte, out=clear)
                    for values, found, total in zip(sheet.groups, seen, fore, strict=True):
                        _look(values, x, y, own, sheet.border)
                        np.multiply(found, matte, out=found)
                        np.add(found, own, out=found)
                        if sheet is finely[-1]:
                            cv2.accumulate(own, total)
                for found, total in zip(seen, sums, strict=True):
                    cv2.accumulate(found, total)
                if layered:
                    cv2.accumulate(clear, bares)
            for target, means in totals:
                for place, total in enumerate(means):
                    some = target[place * together : (place + 1) * together, rows]
                    some[:] = torch.from_numpy(total).permute(2, 0, 1)[: len(some)]
                    some /= len(times)

    threads = torch.get_num_threads() if light.numel() >= WORTH_IT else 1
    with ExitStack() as memory:
        finely = [_prepared(sheet, window, bands, together, loss, memory) for sheet in sheets]
        side_by_side(lambda band: expose(finely, band), bands, threads)
    return Exposed(light, bare, front, uncovered)


class _Way(NamedTuple):
    """Where a band of rows sees a sheet, in values of the finer one; ``begins``: in the middle of exposures."""

    begins: Sequence[Plane]
    passed: Plane | None  # (2, h, w) in an exposure, of each pixel
    later: NDArray[np.float32] | None  # (moments, 2, h, 1), of all pixels of a row alike

    @classmethod
    def of(
        cls,
        sheet: _Finer,
        window: Window,
        rows: slice,
        times: list[float],
        loss: Loss,
        begins: Sequence[Plane],
    ) -> _Way:
        """Of the rows of a window, at times from -1/2 to 1/2 of theirs; into the memory of ``begins``."""
        (base, along), (x, y) = sheet.even, begins
        x[:] = sheet.factor * np.arange(x.shape[1], dtype=np.float32) + sheet.begins[0]
        lines = np.arange(rows.start, rows.stop, dtype=np.float32)[:, None]
        y[:] = sheet.factor * lines + sheet.begins[1]
        if base is not None:
            x -= base[0, rows].numpy()
            y -= base[1, rows].numpy()
        passed = along[:, rows]
        passed = _shortened(passed, len(times)) if loss == "counted" else passed
        band = window._replace(top=window.top + rows.start, height=rows.stop - rows.start)
        path = sheet.moves.along_path(band, np.array(times))
        later = None if path is None else sheet.factor * path[..., None]
        if passed.shape[1:] == x.shape:
            return cls(begins, passed.numpy(), None if later is None else later.astype(np.float32))
        even = np.multiply.outer(times, passed.double().numpy())
        return cls(begins, None, (even if later is None else even + later).astype(np.float32))

    def at(self, moment: int, time: float, into: Sequence[Plane]) -> None:
        """The places at one of the times."""
        for axis, (begin, found) in enumerate(zip(self.begins, into, strict=True)):
            if self.passed is not None:
                cv2.scaleAdd(self.passed[axis], -time, begin, found)
                begin = found
            if self.later is not None:
                np.subtract(begin, self.later[moment, axis], out=found)


def _look(values: Plane, x: Plane, y: Plane, into: Plane, border: int) -> None:
    cv2.remap(values, x, y, cv2.INTER_LINEAR, into if into.shape[2] > 1 else into[..., 0], border, 0)


def _prepared(
    sheet: Sheet,
    window: Window,
    bands: list[tuple[slice, list[float]]],
    together: int,
    loss: Loss,
    memory: ExitStack,
) -> _Finer:
    light = sheet.light.detach()
    top, bottom = 0, light.shape[1]
    if sheet.matte is None and sheet.border in ("reflect", "replicate"):  # others show the other side
        top, bottom = _seen_rows(sheet.moves, window, bands, sheet.top, bottom)
    source, before = led(light, sheet.border)
    axes = _lossy(sheet.moves, window, loss)
    plane = given_back(with_margin(source, sheet.border).numpy(), axes)
    plane = plane[:, top : plane.shape[1] - light.shape[1] + bottom]
    planes = [plane[first : first + together] for first in range(0, len(plane), together)]
    if sheet.matte is not None:
        matte, _ = led(sheet.matte.detach(), sheet.border)
        planes.append(given_back(with_margin(matte, sheet.border).numpy(), axes))
    factor = _FACTOR[loss]
    size = (factor * (plane.shape[1] - 2 * MARGIN), factor * (plane.shape[2] - 2 * MARGIN), together)
    kept = memory.enter_context(borrowed([size] * len(planes), np.float32))
    groups = [finer(each, into, sheet.border, factor) for each, into in zip(planes, kept, strict=True)]
    found = groups.pop() if sheet.matte is not None else None
    if found is not None:
        np.clip(found, 0, 1, out=found)
    base, along = sheet.moves.even(window)
    even = None if base is None else factor * base.detach().float(), factor * along.detach().float()
    begins = factor * (window.left - sheet.left + before), factor * (window.top - sheet.top - top + before)
    return _Finer(groups, found, sheet.moves, factor, even, begins, OPENCV[sheet.border])


def _seen_rows(
    moves: Displacement, window: Window, bands: list[tuple[slice, list[float]]], first: int, height: int
) -> tuple[int, int]:
    """The rows of a sheet of so many, from ``first`` on, that what moves is seen in, from and to."""
    stays = moves.path is None and not moves.readout.row_s
    least, largest = (each[1] for each in moves.extremes_px(window))
    top, bottom = height, 0
    for rows, times in bands:
        if not (stays and times == [0.0]):
            shown = window.top + rows.start - largest[rows].max(), window.top + rows.stop - least[rows].min()
            top, bottom = (
                min(top, math.floor(shown[0]) - first - 3),
                max(bottom, math.ceil(shown[1]) - first + 3),
            )
    top, bottom = max(0, min(top, height - 1)), min(height, max(bottom, 1))
    return (top, bottom) if top < bottom else (0, height)


def _by_torch(
    sheets: Sequence[Sheet], window: Window, bands: list[tuple[slice, list[float]]], loss: Loss
) -> Exposed:
    """The same by ``grid_sample``, on any device, with gradients."""
    factor, finely = _FACTOR[loss], []
    for sheet in sheets:
        planes = sheet.light if sheet.matte is None else torch.cat([sheet.light, sheet.matte])
        source, before = led(planes, sheet.border)
        axes = _lossy(sheet.moves, window, loss)
        values = finer_torch(with_margin(source, sheet.border), sheet.border, factor, axes)
        if sheet.matte is not None:
            values = torch.cat([values[:, :-1], values[:, -1:].clamp(0, 1)], 1)
        finely.append((values, before, sheet.moves.even(window)))
    like, parts = sheets[0].light, []
    columns = torch.arange(window.width).to(like)
    for rows, times in bands:
        lines = torch.arange(rows.start, rows.stop).to(like)[:, None]
        band = window._replace(top=window.top + rows.start, height=rows.stop - rows.start)
        sums = [like.new_zeros(())] * 4
        paths = [sheet.moves.along_path(band, np.array(times)) for sheet in sheets]
        for moment, time in enumerate(times):
            for sheet, path, (values, before, (base, along)) in zip(sheets, paths, finely, strict=True):
                passed = factor * along[:, rows]
                by = time * (_shortened(passed, len(times)) if loss == "counted" else passed)
                by = by if base is None else by + factor * base[:, rows]
                if path is not None:
                    by = by + factor * torch.from_numpy(path[moment]).to(like)[..., None]
                x = factor * columns - by[0] + factor * (window.left - sheet.left + before)
                y = factor * lines - by[1] + factor * (window.top - sheet.top + before)
                found = seen_torch(values, x, y, sheet.border)
                if sheet.matte is None:
                    seen, bare, front, clear = found, found, found, torch.ones_like(found[:, :1])
                else:
                    through = 1 - found[:, -1:]
                    front = found[:, :-1]
                    seen, clear = front + through * seen, clear * through
            sums = [total + each for total, each in zip(sums, (seen, bare, front, clear), strict=True)]
        parts.append([total[0] / len(times) for total in sums])
    return Exposed(*(torch.cat(each, dim=-2) for each in zip(*parts, strict=True)))
