"""The one formula of motion: a pixel's mean over its row's exposure of what passes it, layers in front first.

    I(p) = mean over k of (layers)(p - d(p, t_k)),

d a :class:`.displacement.Displacement` of each layer's own, t_k a time of the pixel's row. What moves is at
mid-exposure where the picture has it. A pixel averages what passes it: a constant stays constant. At steps of depth
the picture is one sheet: the nearer side takes from the farther one and the reverse.

Sub-exposures are as many in each band of rows as its longest way needs, their times spread a little so that their
variance is that of an even exposure. They are seen by linear interpolation of the picture at twice its samples
(:mod:`.finer`): of the picture itself it would lose more than all the rest does. Linear interpolation is a
blur of its own. Of a flow alone it counts as part of the motion's, and paths are shorter for it: values stay within
the picture's, and the shortest paths blur as much as they should, for up to 0.3 DN RMS of fine detail. Of paths and
of rows the samples are three times as many, and what a mean still loses along the axes on which they move is given
back.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from functools import lru_cache
from typing import Literal, NamedTuple

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from blurnoise._core.borders import BORDERS, OPENCV, Border, Window
from blurnoise._core.checks import finite, image_batch, limited_motion, one_of, real_tensor
from blurnoise._core.threads import borrowed, differentiable, no_torch_compile, side_by_side, threads_for
from blurnoise.blur.displacement import STILL_PX, Displacement, Readout
from blurnoise.blur.finer import MARGIN, Plane, finer, finer_torch, given_back, seen_torch, with_margin

SPACING_PX = 2.0
_FINER_PX = 0.6  # spacing before rows
_ROWS_PX = 0.5  # the same where these see other parts of the motion
_ALL_PLACES_PX = 0.5
_BAND, _BAND_VALUES = 16, 1 << 14  # rows at least, values at most
_STEPS = 128  # of a table of paths, to each finer value
_LONGEST = 24  # finer values: beyond, linear interpolation widens a path by less than 0.2 %


Loss = Literal["counted", "given back", "lost"]
"""Of linear interpolation: as a part of the motion's blur, before it, or not made good."""
_FACTOR: dict[Loss, int] = {"counted": 2, "given back": 3, "lost": 2}
Bands = list[tuple[slice, list[float]]]
"""Rows of a window, and the times of their sub-exposures, the exposure being from -1/2 to 1/2."""


class Sheet(NamedTuple):
    """What moves: planes (C, h, w) of light, how they move, and where they begin in the picture.

    covers: the last plane is a matte, times which the light is, or which covers alone. border: how it goes on beyond
    its sides.
    """

    planes: Tensor
    moves: Displacement
    top: int = 0
    left: int = 0
    border: Border = "constant"
    covers: bool = False


class Exposed(NamedTuple):
    """Means over an exposure, (C, h, w): of all sheets, of the hindmost alone, and how much of that is uncovered,
    (1, h, w)."""

    light: Tensor
    hindmost: Tensor
    uncovered: Tensor


@no_torch_compile
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
    once, rows = torch.ones(()), Readout(image.shape[-2], 0.0, 1.0)
    return torch.stack(
        [
            moved_picture(picture, Displacement(by, once, rows), border)
            for picture, by in zip(image, moved, strict=True)
        ]
    )


def flow_warp(image: Tensor, displacement_px: Tensor, *, border: Border = "reflect") -> Tensor:
    """Pictures (B, C, H, W) that show at p what was at p - d(p), d as :func:`flow_blur` takes it; differentiable."""
    image_batch("image", image)
    moved = flows("displacement_px", displacement_px, image)
    once, rows = torch.ones(()), Readout(image.shape[-2], 0.0, 1.0)
    window, at_the_end = Window(0, 0, image.shape[-2], image.shape[-1]), [(slice(0, image.shape[-2]), [1.0])]
    sheets = [
        Sheet(picture, Displacement(by, once, rows), border=border)
        for picture, by in zip(image, moved, strict=True)
    ]
    return torch.stack([_exposed([sheet], window, at_the_end, "lost").light for sheet in sheets])


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
    """Mean of a picture (C, H, W) over an exposure, normalised for rows that are exposed longer."""
    window = Window(0, 0, picture.shape[-2], picture.shape[-1])
    return exposed([Sheet(picture, moves, border=border)], window).light


def exposed(sheets: Sequence[Sheet], window: Window, spacing_px: float = SPACING_PX) -> Exposed:
    """Sheets, hindmost first, in a window of the picture, at most ``spacing_px`` between two sub-exposures."""
    every = [sheet.moves for sheet in sheets]
    loss: Loss = "lost" if len(sheets) > 1 else "given back"
    if len(sheets) == 1 and every[0].path is None and not every[0].readout.row_s:
        loss = "counted"
    elif any(moves.each_row_differs for moves in every):
        loss, spacing_px = "given back", min(spacing_px, _ROWS_PX)
    elif len(sheets) == 1:
        spacing_px = min(spacing_px, _FINER_PX)
    return _exposed(sheets, window, _bands(every, window, spacing_px), loss)


def _exposed(sheets: Sequence[Sheet], window: Window, bands: Bands, loss: Loss) -> Exposed:
    first = sheets[0].planes
    follows = differentiable(*(each for sheet in sheets for each in (sheet.planes, sheet.moves.even_px)))
    fast = not follows and first.device.type == "cpu" and first.dtype == torch.float32
    return (_by_opencv if fast else _by_torch)(sheets, window, bands, loss)


def _lossy(moves: Displacement, window: Window, loss: Loss) -> tuple[bool, bool]:
    """Axes (x, y) whose interpolation loss is compensated: where motion passes all positions between two values."""
    if loss != "given back":
        return False, False
    least, largest = moves.extremes_px(window)
    x, y = (largest - least).max(1) >= _ALL_PLACES_PX
    return bool(x), bool(y)


def _bands(moves: Sequence[Displacement], window: Window, spacing_px: float) -> Bands:
    longest = np.max([each.length_px(window) for each in moves], 0)
    bands: Bands = []
    for top in range(0, window.height, _BAND):
        rows = slice(top, min(top + _BAND, window.height))
        times = _times(float(longest[rows].max()), spacing_px)
        if (
            bands
            and bands[-1][1] == times
            and (rows.stop - bands[-1][0].start) * window.width <= _BAND_VALUES
        ):
            rows = slice(bands.pop()[0].start, rows.stop)
        bands.append((rows, times))
    return bands


def _times(length_px: float, spacing_px: float) -> list[float]:
    if length_px <= STILL_PX:
        return [0.0]
    return _spread(1 + max(1, math.ceil(length_px / spacing_px - 1e-6)))


def _spread(count: int) -> list[float]:
    """Even times whose variance is an exposure's, 1/12."""
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
    """A sheet at more samples, up to four channels in one array; its displacement in the window in finer values, in
    the middle of exposures and during them; where the window begins in it."""

    groups: list[Plane]
    matte: Plane | None
    moves: Displacement
    factor: int
    even: tuple[Tensor | None, Tensor]
    begins: tuple[int, int]
    border: int

    def way(
        self, window: Window, band: tuple[slice, list[float]], loss: Loss, begins: Sequence[Plane]
    ) -> Callable[[int, Sequence[Plane]], None]:
        """What writes the places (x, y) that a band sees at one of its times; ``begins``: memory of its own."""
        (base, along), (x, y), (rows, times) = self.even, begins, band
        x[:] = self.factor * np.arange(x.shape[1], dtype=np.float32) + self.begins[0]
        y[:] = (self.factor * np.arange(rows.start, rows.stop, dtype=np.float32) + self.begins[1])[:, None]
        if base is not None:
            x -= base[0, rows].numpy()
            y -= base[1, rows].numpy()
        counted = loss == "counted"
        passed = (_shortened(along[:, rows], len(times)) if counted else along[:, rows]).numpy()
        by_pixel = passed.shape[1:] == x.shape
        part = window._replace(top=window.top + rows.start, height=rows.stop - rows.start)
        path = self.moves.along_path(part, np.array(times))
        later = None if path is None else self.factor * path[..., None]
        if not by_pixel:
            even = np.multiply.outer(times, passed.astype(np.float64))
            later = even if later is None else even + later
        later = None if later is None else later.astype(np.float32)

        def at(moment: int, into: Sequence[Plane]) -> None:
            for axis, (begin, found) in enumerate(zip(begins, into, strict=True)):
                if by_pixel:
                    cv2.scaleAdd(passed[axis], -times[moment], begin, found)
                    begin = found
                if later is not None:
                    np.subtract(begin, later[moment, axis], out=found)

        return at

    def look(self, values: Plane, x: Plane, y: Plane, into: Plane) -> None:
        """The values at places."""
        found = into if into.shape[2] > 1 else into[..., 0]
        cv2.remap(values, x, y, cv2.INTER_LINEAR, found, self.border, 0)


def _by_opencv(sheets: Sequence[Sheet], window: Window, bands: Bands, loss: Loss) -> Exposed:
    """On the CPU: four channels at a time, a third of the time of three, or one."""
    picture, moves = sheets[0].planes.detach(), sheets[0].moves
    layered, together = len(sheets) > 1, 1 if len(picture) == 1 else 4
    stays = not layered and moves.path is None and not moves.readout.row_s  # where the way is short
    if stays and all(times == [0.0] for _, times in bands):
        return Exposed(picture, picture, picture[:1])
    light = picture.new_empty(len(picture), window.height, window.width)
    bare = torch.empty_like(light) if layered else light
    uncovered = torch.empty_like(light[:1])

    def expose(finely: list[_Finer], band: tuple[slice, list[float]]) -> None:
        rows, times = band
        if stays and times == [0.0]:
            light[:, rows] = picture[:, rows]
            return
        flat, count = (rows.stop - rows.start, window.width), len(finely[0].groups)
        with (
            borrowed([flat] * (2 + 2 * len(finely)), np.float32) as (x, y, *begins),
            borrowed([(*flat, together)] * (4 + 3 * count), np.float32) as (own, matte, clear, clears, *kept),
        ):
            seen, sums, hind = (kept[part * count :][:count] for part in range(3))
            totals = [(light, sums), *([(bare, hind), (uncovered, [clears])] if layered else [])]
            for total in (each for _, some in totals for each in some):
                total[:] = 0
            ways = [
                sheet.way(window, band, loss, begins[2 * place : 2 * place + 2])
                for place, sheet in enumerate(finely)
            ]
            for moment in range(len(times)):
                for sheet, way in zip(finely, ways, strict=True):
                    way(moment, (x, y))
                    if sheet.matte is None:
                        for values, found, total in zip(sheet.groups, seen, hind, strict=True):
                            sheet.look(values, x, y, found)
                            if layered:
                                cv2.accumulate(found, total)
                        clear[:] = 1
                        continue
                    sheet.look(sheet.matte, x, y, matte)
                    np.subtract(1, matte, out=matte)
                    np.multiply(clear, matte, out=clear)
                    for found in seen:
                        np.multiply(found, matte, out=found)
                    for values, found in zip(sheet.groups, seen, strict=False):
                        sheet.look(values, x, y, own)
                        np.add(found, own, out=found)
                for found, total in zip(seen, sums, strict=True):
                    cv2.accumulate(found, total)
                if layered:
                    cv2.accumulate(clear, clears)
            for target, means in totals:
                for place, total in enumerate(means):
                    some = target[place * together : (place + 1) * together, rows]
                    some[:] = torch.from_numpy(total).permute(2, 0, 1)[: len(some)]
                    some /= len(times)

    with ExitStack() as memory:
        finely = [_prepared(sheet, window, bands, together, loss, memory) for sheet in sheets]
        side_by_side(lambda band: expose(finely, band), bands, threads_for(light))
    return Exposed(light, bare, uncovered)


def _prepared(
    sheet: Sheet, window: Window, bands: Bands, together: int, loss: Loss, memory: ExitStack
) -> _Finer:
    height, factor = sheet.planes.shape[1], _FACTOR[loss]
    top, bottom = 0, height
    if not sheet.covers and sheet.border in ("reflect", "replicate"):  # others show the other side
        top, bottom = _seen_rows(sheet.moves, window, bands, sheet.top, height)
    wide, before = with_margin(sheet.planes.detach(), sheet.border)
    planes = given_back(wide.numpy(), _lossy(sheet.moves, window, loss))
    planes = planes[:, top : planes.shape[1] - height + bottom]
    light = planes[:-1] if sheet.covers else planes
    groups = [light[first : first + together] for first in range(0, len(light), together)]
    groups += [planes[-1:]] if sheet.covers else []
    size = (*(factor * (side - 2 * MARGIN) for side in planes.shape[1:]), together)
    kept = memory.enter_context(borrowed([size] * len(groups), np.float32))
    found = [finer(each, into, sheet.border, factor) for each, into in zip(groups, kept, strict=True)]
    matte = np.clip(found[-1], 0, 1, out=found[-1]) if sheet.covers else None
    base, along = sheet.moves.even(window)
    even = None if base is None else factor * base.detach().float(), factor * along.detach().float()
    begins = factor * (window.left - sheet.left + before), factor * (window.top - sheet.top - top + before)
    light_alone = found[:-1] if sheet.covers else found
    return _Finer(light_alone, matte, sheet.moves, factor, even, begins, OPENCV[sheet.border])


def _seen_rows(moves: Displacement, window: Window, bands: Bands, first: int, height: int) -> tuple[int, int]:
    """Range of rows that the bands sample, in a sheet of ``height`` rows that begins at row ``first``."""
    stays = moves.path is None and not moves.readout.row_s
    least, largest = (each[1] for each in moves.extremes_px(window))
    seen = [rows for rows, times in bands if not (stays and times == [0.0])]
    top = min((window.top + rows.start - largest[rows].max() for rows in seen), default=first + height)
    bottom = max((window.top + rows.stop - least[rows].min() for rows in seen), default=first)
    top, bottom = max(0, math.floor(top) - first - 3), min(height, math.ceil(bottom) - first + 3)
    return (top, bottom) if top < bottom else (0, height)


def _by_torch(sheets: Sequence[Sheet], window: Window, bands: Bands, loss: Loss) -> Exposed:
    """As :func:`_by_opencv`, by ``grid_sample``: on any device, with gradients."""
    factor, finely = _FACTOR[loss], []
    for sheet in sheets:
        wide, before = with_margin(sheet.planes, sheet.border)
        values = finer_torch(wide, sheet.border, factor, _lossy(sheet.moves, window, loss))
        if sheet.covers:
            values = torch.cat([values[:, :-1], values[:, -1:].clamp(0, 1)], 1)
        finely.append((values, before, sheet.moves.even(window)))
    like, parts = sheets[0].planes, []
    columns = torch.arange(window.width).to(like)
    for rows, times in bands:
        lines = torch.arange(rows.start, rows.stop).to(like)[:, None]
        band = window._replace(top=window.top + rows.start, height=rows.stop - rows.start)
        sums = [like.new_zeros(())] * 3
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
                if not sheet.covers:
                    seen, bare, clear = found, found, torch.ones_like(found[:, :1])
                    continue
                through = 1 - found[:, -1:]
                seen, clear = through * seen, clear * through
                seen = seen + found[:, :-1] if found.shape[1] > 1 else seen
            sums = [total + each for total, each in zip(sums, (seen, bare, clear), strict=True)]
        parts.append([total[0] / len(times) for total in sums])
    return Exposed(*(torch.cat(each, dim=-2) for each in zip(*parts, strict=True)))
