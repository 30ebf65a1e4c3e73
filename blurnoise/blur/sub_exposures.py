"""Motion by sub-exposures: each pixel is the mean over its row's exposure of the light that passes it.

    I(p) = mean over k of (layers)(p - d(p, t_k)),

d is the :class:`.displacement.Displacement` of each layer, t_k a time within the exposure of the pixel's row. At
mid-exposure everything is where the picture shows it. A constant stays constant. Steps of depth within one picture
are not modelled: light mixes across them.

Each band of rows gets as many sub-exposures as its longest path needs. Their times are spread a little, so that their
variance is that of an even exposure. Each sub-exposure samples the picture, interpolated to twice its resolution by
Lanczos's window of 12 taps, linearly in between. Linear interpolation is a blur of its own: it counts as part of the
motion, and paths are shortened for it. Where rows see different parts of a motion, the resolution is three times the
picture's, and the remaining loss is compensated along an axis. One loop serves two samplers with equal values:
OpenCV's, and PyTorch's, with gradients.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from blurnoise._core.borders import OPENCV, Border, Window, extended, folded
from blurnoise._core.checks import finite, image_batch, limited_motion, real_tensor
from blurnoise._core.threads import differentiable, side_by_side, threads_for
from blurnoise.blur.displacement import STILL_PX, Displacement, Readout

SPACING_PX = 2.0
_FINE_PX = 0.4  # spacing where rows or paths are seen
_ALL_PLACES_PX = 0.5  # of motion along an axis, which passes all positions between two values
_BAND, _BAND_VALUES = 16, 1 << 13  # rows at least, values at most beyond
_STEPS = 128  # of a table of paths, to each finer value
_LONGEST = 24  # finer values: beyond, linear interpolation widens a path by less than 0.2 %
_MARGIN = 9  # px, for the kernels of finer values
_LOBES = 6
_LOST = (-0.0268, 0.0100, -0.0033)  # by a mean of linear interpolations at three times the samples
_GIVEN_BACK = np.array([*_LOST[::-1], 1 - 2 * sum(_LOST), *_LOST])  # to 2 % up to 0.4 cycles/px

Band = tuple[slice, list[float]]
"""Rows of a window, and the times of their sub-exposures, the exposure being from -1/2 to 1/2."""
Sampler = Callable[[Tensor], Tensor]
"""The light (C, h, w) at positions (2, h, w); there may be more channels than the plane has."""


class MovingPlane(NamedTuple):
    """A picture, or a layer in front of it, and its motion.

    channels: (C, h, w); of a layer the light times its matte and the matte, or the matte alone. top, left: of its
    first pixel in the picture. border: how it continues beyond its sides.

    >>> by = Displacement(torch.tensor([3.0, 0.0]), torch.tensor(0.01), Readout(4, 0.0, 0.01))
    >>> MovingPlane(torch.zeros(3, 4, 6), by, left=10).border  # beyond a layer there is nothing
    'constant'
    """

    channels: Tensor
    moves: Displacement
    top: int = 0
    left: int = 0
    border: Border = "constant"


def flow_warp(image: Tensor, displacement_px: Tensor, *, border: Border = "reflect") -> Tensor:
    """Pictures (B, C, H, W) that show at p what was at p - d(p), d (2, H, W) or (B, 2, H, W), px; differentiable.

    >>> dot = torch.zeros(1, 1, 3, 7)
    >>> dot[..., 1, 2] = 1.0
    >>> flow = torch.tensor([2.0, 0.0])[:, None, None].expand(2, 3, 7)
    >>> flow_warp(dot, flow, border="constant")[0, 0, 1].tolist()
    [0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0]
    """
    planes, (height, width) = flowing(image, displacement_px, border), image.shape[-2:]
    window, at_the_end = Window(0, 0, height, width), [(slice(0, height), [1.0])]
    return torch.stack([_means([plane], window, at_the_end, fine=False)[0] for plane in planes])


def flowing(image: Tensor, displacement_px: Tensor, border: Border) -> list[MovingPlane]:
    """Planes that move by each pixel's displacement. Raises ``TypeError`` or ``ValueError`` naming the argument.

    >>> zoom = torch.linspace(-3, 3, 7).expand(2, 7, 7)
    >>> [plane.moves.flows for plane in flowing(torch.zeros(2, 1, 7, 7), zoom, "reflect")]
    [True, True]
    """
    image_batch("image", image)
    moved = flows("displacement_px", displacement_px, image)
    limited_motion("displacement_px", moved)
    once, rows = torch.ones(()), Readout(image.shape[-2], 0.0, 1.0)
    pairs = zip(image, moved, strict=True)
    return [MovingPlane(picture, Displacement(by, once, rows), border=border) for picture, by in pairs]


def flows(name: str, value: object, image: Tensor) -> Tensor:
    """Vectors for each pixel of ``image`` (B, C, H, W), as (B, 2, H, W) in its dtype and on its device.

    value: (2, H, W) or (B, 2, H, W). Raises ``TypeError`` or ``ValueError`` naming it.

    >>> flows("velocity_px_s", torch.zeros(2, 3, 4), torch.zeros(5, 1, 3, 4)).shape
    torch.Size([5, 2, 3, 4])
    """
    tensor = finite(name, real_tensor(name, value).to(image))
    batch, _, height, width = image.shape
    if tensor.shape not in ((2, height, width), (batch, 2, height, width), (1, 2, height, width)):
        wanted = f"(2, {height}, {width}) or ({batch}, 2, {height}, {width})"
        raise ValueError(f"{name}: shape must be {wanted}, got {tuple(tensor.shape)}")
    return tensor.expand(batch, 2, height, width)


def exposed(plane: MovingPlane, window: Window | None = None) -> Tensor:
    """Mean (C, h, w) of a plane, whole or in a window; rows that are exposed longer are no brighter.

    >>> edge = (torch.arange(64.0) >= 32).expand(1, 8, 64).float()
    >>> flow = torch.tensor([8.0, 0.0])[:, None, None].expand(2, 8, 64)  # the same 8 px everywhere
    >>> seen = exposed(MovingPlane(edge, Displacement(flow, torch.tensor(0.01), Readout(8, 0.0, 0.01))))
    >>> [round(float(seen[0, 4, x]), 1) for x in (24, 30, 34, 40)]
    [0.0, 0.3, 0.8, 1.0]
    """
    moves, window = plane.moves, window or Window(0, 0, *plane.channels.shape[-2:])
    fine = moves.path is not None or moves.readout.row_s != 0
    bands = _bands([moves], window, _FINE_PX if fine else SPACING_PX)
    return _means([plane], window, bands, fine=fine)[0]


def exposed_together(planes: Sequence[MovingPlane], window: Window) -> tuple[Tensor, Tensor]:
    """Expose planes, back to front: return (light, uncovered).

    light: (C, h, w), the mean picture without the background. uncovered: (1, h, w), the mean share of the background
    that no layer covers. The background is blurred more accurately elsewhere, and added by its share.

    >>> still = Displacement(torch.zeros(2), torch.tensor(0.01), Readout(4, 0.0, 0.01))
    >>> behind = MovingPlane(torch.full((1, 4, 6), 0.4), still, border="replicate")
    >>> half = MovingPlane(torch.full((2, 4, 6), 0.5), still)  # light 0.5, matte 0.5
    >>> light, uncovered = exposed_together([behind, half], Window(1, 1, 1, 1))
    >>> round(float(light), 3), round(float(uncovered), 3)
    (0.5, 0.5)
    """
    every = [plane.moves for plane in planes]
    fine = any(moves.each_row_differs for moves in every)
    bands = _bands(every, window, _FINE_PX if fine else SPACING_PX)
    light, background, uncovered = _means(planes, window, bands, fine=fine)
    return light - uncovered * background, uncovered


def _means(
    planes: Sequence[MovingPlane], window: Window, bands: Sequence[Band], *, fine: bool
) -> list[Tensor]:
    """Means over the exposure: of the picture; of several planes also of the background and its uncovered share."""
    first = planes[0].channels
    follows = differentiable(*(each for plane in planes for each in (plane.channels, plane.moves.even_px)))
    fast = not follows and first.device.type == "cpu" and first.dtype == torch.float32
    counted, factor = len(planes) == 1 and not fine, 3 if fine else 2
    planes, means = [_padded(plane) for plane in planes], {}
    moving = [rows for rows, times in bands if not (counted and times == [0.0])]
    if not moving:
        return [first]

    def expose(band: Band) -> None:
        rows, times = band
        if rows not in moving:
            means[rows.start] = [first[:, rows]]
            return
        sums: list[Any] = [0.0] * 3
        positions = [_positions(plane, window, band, factor, counted=counted) for plane in planes]
        for at in zip(*positions, strict=True):
            sums = [total + each for total, each in zip(sums, _composed(planes, samplers, at), strict=False)]
        means[rows.start] = [total[: len(first)] / len(times) for total in sums]

    span = window._replace(top=window.top + moving[0].start, height=moving[-1].stop - moving[0].start)
    by: Callable[..., Sampler] = _by_opencv if fast else _by_torch
    samplers = [by(plane, span, factor, covers=number > 0) for number, plane in enumerate(planes)]
    side_by_side(expose, bands, threads_for(first) if fast else 1)
    return [torch.cat(parts, -2) for parts in zip(*(means[rows.start] for rows, _ in bands), strict=True)]


def _composed(
    planes: Sequence[MovingPlane], samplers: Sequence[Sampler], at: Sequence[Tensor]
) -> list[Tensor]:
    """One sub-exposure: the terms of which :func:`_means` takes the means."""
    if len(planes) == 1:
        return [samplers[0](at[0])]
    background, *layers = (
        sample(positions)[: len(plane.channels)].contiguous()
        for plane, sample, positions in zip(planes, samplers, at, strict=True)
    )
    picture, uncovered = background, torch.ones_like(background[:1])
    for layer in layers:
        transmitted = 1 - layer[-1:]
        picture, uncovered = transmitted * picture, transmitted * uncovered
        picture = picture + layer[:-1] if len(layer) > 1 else picture  # a matte alone only covers
    return [picture, background, uncovered]


def _positions(
    plane: MovingPlane, window: Window, band: Band, factor: int, *, counted: bool
) -> Iterator[Tensor]:
    """Positions (2, h, w) in the interpolated plane that a band of rows samples, one for each of its times."""
    rows, times = band
    part = window._replace(top=window.top + rows.start, height=rows.stop - rows.start)
    base, passed = (factor * each.to(plane.channels) for each in plane.moves.even(part))
    passed = _shortened(passed, len(times)) if counted else passed
    columns = torch.arange(part.width).to(base) + (part.left - plane.left)
    lines = torch.arange(part.height).to(base) + (part.top - plane.top)
    begins = factor * torch.stack(torch.meshgrid(columns, lines, indexing="xy")) - base
    path = plane.moves.along_path(part, np.array(times))
    for moment, time in enumerate(times):
        at = torch.sub(begins, passed, alpha=time)
        yield at if path is None else at - factor * path[moment].to(at)[..., None]


def _by_opencv(plane: MovingPlane, window: Window, factor: int, *, covers: bool) -> Sampler:
    """On the CPU: four channels at a time, a third of the time of three, or one."""
    count, height, width = plane.channels.shape
    top, bottom = 0, height
    if not covers and plane.border in ("reflect", "replicate"):  # others show the other side
        low, high = plane.moves.range_px(window)
        top = max(0, math.floor(window.top - plane.top - high[1]) - 3)
        bottom = min(height, math.ceil(window.top - plane.top + window.height - low[1]) + 3)
        top, bottom = (top, bottom) if top < bottom else (0, height)
    wide = _with_margin(plane.channels.detach(), plane.border).numpy()[:, top : bottom + 2 * _MARGIN]
    # cv2.remap is vectorised for four channels; three take three times as long.
    size = factor * height, factor * width, count if count == 1 else max(4, count)
    values = np.empty(size, np.float32)
    _finer(wide, values[factor * top : factor * bottom], factor, _lossy(plane, window, factor))
    values = values[: _whole(height, plane.border, factor), : _whole(width, plane.border, factor)]
    if covers:
        np.clip(values[..., count - 1], 0, 1, out=values[..., count - 1])

    def sample(at: Tensor) -> Tensor:
        x, y = at.numpy()
        border = OPENCV[plane.border]
        values_at = cv2.remap(values, x, y, cv2.INTER_LINEAR, borderMode=border, borderValue=0)
        return torch.from_numpy(values_at.reshape(*x.shape, -1)).permute(2, 0, 1)

    return sample


def _by_torch(plane: MovingPlane, window: Window, factor: int, *, covers: bool) -> Sampler:
    """As :func:`_by_opencv`, by ``grid_sample``: on any device, with gradients."""
    wide = _with_margin(plane.channels, plane.border)
    values = _finer_torch(wide, plane.border, factor, _lossy(plane, window, factor))
    if covers:
        values = torch.cat([values[:, :-1], values[:, -1:].clamp(0, 1)], 1)
    border, (height, width) = plane.border, values.shape[-2:]  # two values more on every side

    def sample(at: Tensor) -> Tensor:
        x, y = (
            (position.clamp(-2, inside + 1) if border == "constant" else folded(position, inside, border)) + 2
            for position, inside in ((at[0], width - 4), (at[1], height - 4))
        )
        grid = torch.stack([2 * x / (width - 1) - 1, 2 * y / (height - 1) - 1], -1)
        return functional.grid_sample(values, grid[None], "bilinear", "border", align_corners=True)[0]

    return sample


def _padded(plane: MovingPlane) -> MovingPlane:
    """Pad by one black pixel, so that interpolation at the edge fades to black."""
    if plane.border != "constant":
        return plane
    channels = functional.pad(plane.channels, (1, 0, 1, 0))
    return plane._replace(channels=channels, top=plane.top - 1, left=plane.left - 1)


def _lossy(plane: MovingPlane, window: Window, factor: int) -> tuple[bool, bool]:
    """Axes (x, y) whose interpolation loss is compensated: where motion passes all positions between two values."""
    least, largest = plane.moves.extremes_px(window)
    x, y = (largest - least).max(1) >= _ALL_PLACES_PX
    return factor > 2 and bool(x), factor > 2 and bool(y)


def _bands(moves: Sequence[Displacement], window: Window, spacing_px: float) -> list[Band]:
    longest = np.max([each.length_px(window) for each in moves], 0)
    height = max(_BAND, _BAND_VALUES // window.width)
    bands = [slice(top, min(top + height, window.height)) for top in range(0, window.height, height)]
    return [(rows, _times(float(longest[rows].max()), spacing_px)) for rows in bands]


def _times(length_px: float, spacing_px: float) -> list[float]:
    """Even times whose variance is an exposure's, 1/12."""
    if length_px <= STILL_PX:
        return [0.0]
    count = 1 + max(1, math.ceil(length_px / spacing_px - 1e-6))
    # Even times k / count have the variance (1 - 1/count^2) / 12 of their span: too little, hence wider.
    spread = 1 / math.sqrt(count * count - 1)
    return [(index + 0.5 - count / 2) * spread for index in range(count)]


def _shortened(along: Tensor, count: int) -> Tensor:
    """Paths, in finer values along an axis, that spread light as ``along`` does with what interpolation adds."""
    if count < 2:
        return along
    table = torch.from_numpy(_paths(count)).to(along)
    position = (along.abs() * _STEPS).clamp_max(len(table) - 1.001)
    before = position.detach().long()
    low = table[before]
    short = low + (position - before) * (table[before + 1] - low)
    return torch.copysign(short + (along.abs() - _LONGEST).clamp_min(0), along)


@lru_cache(maxsize=256)
def _paths(count: int) -> NDArray[np.float64]:
    """The paths to take for those of 0, 1 / _STEPS, ... finer values, at ``count`` times."""
    path = (_LONGEST + 2) * np.linspace(0, 1, 1500) ** 2
    times = _times(count - 1.0, 1.0)
    whole, rest = np.divmod(np.abs(np.outer(path, times)), 1)
    variance = (whole**2 + (2 * whole + 1) * rest).mean(1)  # linear between the squares of whole places
    return np.interp(np.arange(_LONGEST * _STEPS + 1) / _STEPS, np.sqrt(12 * variance), path)


def _with_margin(planes: Tensor, border: Border) -> Tensor:
    """Planes (C, H, W) continued as far as the kernels reach."""
    height, width = (side + 2 * _MARGIN for side in planes.shape[-2:])
    return extended(planes[None], (_MARGIN, _MARGIN), (height, width), border)[0]


def _finer(
    planes: NDArray[np.float32], into: NDArray[np.float32], factor: int, lossy: tuple[bool, bool]
) -> None:
    """Planes with their margin at ``factor`` times their samples, into (h, w, channels); more of these are filled."""
    (height, width), channels = planes.shape[1:], into.shape[2]
    pixels = into.view(np.dtype((np.void, 4 * channels)))[..., 0]
    inside = slice(_MARGIN, -_MARGIN)
    wide, across, down = np.empty((3, height, width, channels), np.float32)
    cv2.merge([*planes, *[planes[0]] * (channels - len(planes))], wide)
    for column in range(factor):
        cv2.filter2D(wide, -1, _kernel(column / factor, lossy[0])[None], across)
        for row in range(factor):
            cv2.filter2D(across, -1, _kernel(row / factor, lossy[1])[:, None], down)
            pixels[row::factor, column::factor] = down.view(pixels.dtype)[inside, inside, 0]


@lru_cache(maxsize=8)
def _kernel(part: float, lossy: bool) -> NDArray[np.float64]:
    """Odd weights of the values about one, for what lies ``part`` of the way to the next."""
    off = np.arange(-_LOBES, _LOBES + 1) - part
    taps = np.where(np.abs(off) < _LOBES, np.sinc(off) * np.sinc(off / _LOBES), 0.0) if part else np.ones(1)
    taps /= taps.sum()
    return np.convolve(taps, _GIVEN_BACK) if lossy else taps


def _whole(size: int, border: Border, factor: int) -> int:
    """Values along a finer side of ``size`` px: without those beyond the last pixel where the border mirrors it."""
    return factor * size - (factor - 1) * (border in ("reflect", "replicate"))


def _finer_torch(wide: Tensor, border: Border, factor: int, lossy: tuple[bool, bool]) -> Tensor:
    """A picture (C, H, W) with its margin as (1, C, h, w), two values more on every side."""
    values = _between(_between(wide, factor, lossy[0]).mT, factor, lossy[1]).mT
    height, width = (_whole(side - 2 * _MARGIN, border, factor) for side in wide.shape[1:])
    return extended(values[None, :, :height, :width], (2, 2), (height + 4, width + 4), border)


def _between(plane: Tensor, factor: int, lossy: bool) -> Tensor:
    """Lines (C, H, W) with their margin as (C, H, factor (W - margins))."""
    lines, parts = plane.flatten(0, 1)[:, None], []
    for part in range(factor):
        kernel = torch.from_numpy(_kernel(part / factor, lossy)).to(plane)
        unused = _MARGIN - len(kernel) // 2
        parts.append(functional.conv1d(lines[..., unused : lines.shape[-1] - unused], kernel[None, None]))
    return torch.cat(parts, 1).mT.reshape(*plane.shape[:2], -1)
