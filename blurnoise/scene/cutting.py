"""Cutting objects out of pictures: mattes, masks of a batch, layers, and the background behind the objects.

Domain: a matte is (H, W) float32 within [0, 1], the share of each pixel that the object covers; masks are
(B, N, H, W) of any type, with the same meaning, for the N objects of each picture. Coordinates in px from the corner
of the first pixel, x right, y down. A photograph does not show the background behind an object: it is filled in from
the pixels around the object, at ever coarser scales, and ``invented`` marks the filled pixels.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import partial
from types import MappingProxyType
from typing import NamedTuple

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from blurnoise._core.beams import BeamPlanes, checked_planes
from blurnoise._core.checks import an_instance, dense, image_batch, real_tensor
from blurnoise.blur.displacement import spread_px
from blurnoise.blur.layer import Layer

Matte = NDArray[np.float32]
_MIXED_PX = 1  # from an edge inwards, the object's colours contain the background
_BLED_PX = 2  # from an edge outwards, the background contains the object's colours
AROUND_PX = 24  # width of the margin that a hole is filled from
_LEAST = 1e-6  # smallest known share with which a coarse pixel counts as known


class Cut(NamedTuple):
    """A picture (1, C, H, W) without its objects, the objects as layers, and the filled pixels (H, W).

    headlamp_lux: what beams of headlamps add to the light on the background, lux, (1, 1, H, W) each.

    >>> matte = np.zeros((40, 50), np.float32)
    >>> matte[10:20, 12:30] = 1
    >>> cut = cut_out(torch.full((1, 3, 40, 50), 0.5), [matte], [(300.0, 0.0)])
    >>> int(cut.invented.sum())  # 10 x 18 px and 2 px around them
    308
    """

    background: Tensor
    layers: tuple[Layer, ...]
    invented: NDArray[np.bool_]
    headlamp_lux: BeamPlanes = MappingProxyType({})


def cut_out(
    light: Tensor,
    mattes: Sequence[Matte],
    velocities_px_s: Sequence[Iterable[float]],
    plate: Tensor | None = None,
    headlamp_lux: BeamPlanes = MappingProxyType({}),
) -> Cut:
    """Cut the objects out of a picture (1, C, H, W) in linear light, back to front, and fill in the background.

    plate: a picture of the scene without the objects, of the same shape; without it, the background is filled in from
    the surroundings. Colours within 1 px of an object's edge, which contain the background, are taken from further
    inside. headlamp_lux: what beams of headlamps add to the light on the picture, lux, (1, 1, H, W) each, which is
    cut as the light is; a plate is lit as the surroundings of the objects are. Raises ``ValueError`` for a matte of
    another size, an empty one, and for objects that cover everything.

    >>> matte = np.zeros((40, 50), np.float32)
    >>> matte[10:20, 12:30] = 1
    >>> cut = cut_out(torch.full((1, 3, 40, 50), 0.5), [matte], [(300.0, 0.0)])
    >>> cut.layers[0].place_px, tuple(cut.layers[0].light.shape)
    ((12, 10), (3, 10, 18))
    """
    image_batch("light", light)
    size = (light.shape[-2], light.shape[-1])
    if len(light) != 1 or len(mattes) != len(velocities_px_s):
        counts = f"{len(light)} pictures, {len(mattes)} mattes, {len(velocities_px_s)} velocities"
        raise ValueError(f"light: {counts}; must be one picture, and as many velocities as mattes")
    if plate is not None and image_batch("plate", plate).shape != light.shape:
        raise ValueError(f"plate: shape is {tuple(plate.shape)}; must be the picture's, {tuple(light.shape)}")
    covered = np.zeros(size, bool)
    for matte in mattes:
        an_instance("matte", matte, np.ndarray)
        if matte.shape != size:
            raise ValueError(f"matte: shape must be the picture's, {size}, got {matte.shape}")
        if not np.isfinite(matte).all():
            raise ValueError("matte: contains NaN or Inf")
        if not (matte > 0).any():
            raise ValueError("matte: is empty")
        covered |= matte > 0
    lamps = checked_planes("headlamp_lux", headlamp_lux, (1, 1, *size))
    layers = tuple(map(partial(_layer, light, lamps), mattes, velocities_px_s))
    hole = hole_of(covered)
    lit = {beam: filled(plane, hole) for beam, plane in lamps.items()}
    if plate is not None:
        return Cut(plate, layers, np.zeros(size, bool), lit)
    if hole.all():
        raise ValueError("matte: covers the whole picture; must leave some background, or needs a plate")
    return Cut(filled(light, hole), layers, hole, lit)


def hole_of(covered: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Pixels to fill behind objects that cover (H, W): these and their neighbours, which hold some of the light.

    >>> covered = np.zeros((9, 9), bool)
    >>> covered[4, 4] = True
    >>> int(hole_of(covered).sum())  # 2 px to every side
    25
    """
    return np.asarray(cv2.dilate(covered.astype(np.uint8), np.ones((2 * _BLED_PX + 1,) * 2, np.uint8)) > 0)


def _layer(light: Tensor, lamps: BeamPlanes, matte: Matte, velocity_px_s: Iterable[float]) -> Layer:
    matte = np.asarray(matte, np.float32)
    rows, columns = np.flatnonzero(matte.any(1)), np.flatnonzero(matte.any(0))
    box = (slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1))
    alpha = matte[box]
    kernel = np.ones((2 * _MIXED_PX + 1,) * 2, np.uint8)
    whole = (matte >= 1).astype(np.uint8)  # an object that the picture's border cuts goes on beyond it
    inside = cv2.erode(whole, kernel, borderType=cv2.BORDER_REPLICATE)[box] > 0

    def part_of(plane: Tensor) -> Tensor:
        """The part of a picture (1, C, H, W), without what its edge shows of the background."""
        part = plane[..., box[0], box[1]]
        return filled(part, ~inside & (alpha > 0))[0] if inside.any() else part[0]

    by_beam = {beam: part_of(plane) for beam, plane in lamps.items()}
    place = (int(columns[0]), int(rows[0]))
    covers = torch.from_numpy(np.ascontiguousarray(alpha)).to(light)
    return Layer(part_of(light), covers, velocity_px_s, place, headlamp_lux=by_beam)


def filled(light: Tensor, hole: NDArray[np.bool_]) -> Tensor:
    """Light (1, C, H, W) with the hole filled from the pixels around it, within their range, without a gradient.

    >>> light, hole = torch.full((1, 1, 9, 9), 0.5), np.zeros((9, 9), bool)
    >>> light[..., 4, 4], hole[4, 4] = 1.0, True
    >>> float(filled(light, hole)[0, 0, 4, 4])
    0.5
    """
    if not hole.any():
        return light
    rows, columns = np.flatnonzero(hole.any(1)), np.flatnonzero(hole.any(0))
    box = tuple(slice(max(0, each[0] - AROUND_PX), each[-1] + 1 + AROUND_PX) for each in (rows, columns))
    missing = hole[box]
    visible = light.detach()[0][:, box[0], box[1]].permute(1, 2, 0).cpu().numpy().astype(np.float32)
    fill = torch.from_numpy(_from_around(visible, ~missing)).permute(2, 0, 1).to(light)
    out = light.clone()
    part = out[0][:, box[0], box[1]]
    part[:] = torch.where(torch.from_numpy(missing).to(light.device), fill, part.clone())
    return out


def _from_around(part: NDArray[np.float32], known: NDArray[np.bool_]) -> NDArray[np.float32]:
    """A part (h, w, C) with unknown pixels filled from half the scale, where they are means of known ones."""
    if known.all() or not known.any():
        return part
    height, width = known.shape
    half, weight = ((width + 1) // 2, (height + 1) // 2), known.astype(np.float32)
    share = cv2.resize(weight, half, interpolation=cv2.INTER_AREA)
    light = cv2.resize(part * weight[..., None], half, interpolation=cv2.INTER_AREA).reshape(*share.shape, -1)
    # Half the scale each time: a hole of any size is filled after as many steps as its size has bits.
    coarse = _from_around(light / np.maximum(share, _LEAST)[..., None], share > _LEAST)
    finer = cv2.resize(coarse, (width, height), interpolation=cv2.INTER_LINEAR).reshape(part.shape)
    return np.where(known[..., None], part, finer)


def checked_masks(masks: Tensor, batch: int, size: tuple[int, int]) -> Tensor:
    """Masks (B, N, H, W) of a batch of pictures (H, W). Raises ``TypeError`` or ``ValueError``.

    >>> checked_masks(torch.zeros(2, 3, 4, 6), batch=2, size=(4, 6)).shape
    torch.Size([2, 3, 4, 6])
    """
    an_instance("masks", masks, Tensor)
    dense("masks", masks)
    if masks.ndim != 4 or (len(masks), *masks.shape[2:]) != (batch, *size):
        wanted = f"({batch}, N, {size[0]}, {size[1]})"
        raise ValueError(f"masks: shape must be {wanted}, one row for each picture, got {tuple(masks.shape)}")
    if masks.numel() and masks.dtype != torch.bool:
        low, high = map(float, real_tensor("masks", masks).detach().aminmax())
        if not (low >= 0 and high <= 1):
            raise ValueError(f"masks: values span [{low:g}, {high:g}]; must lie within [0, 1]")
    return masks


def matte_of(masks: Tensor) -> Matte | None:
    """The union of a picture's masks (N, H, W); None if it is empty or leaves no background.

    >>> masks = torch.zeros(2, 20, 20)
    >>> masks[0, 5, 5], masks[1, 9, 9] = 1.0, 0.5
    >>> float(matte_of(masks).sum()), matte_of(torch.ones(1, 20, 20)) is None  # no background is left
    (1.5, True)
    """
    if not masks.numel():
        return None
    matte = masks.detach().amax(0).to(torch.float32).cpu().numpy()
    return None if not matte.any() or hole_of(matte > 0).all() else matte


def in_motion(
    light: Tensor,
    matte: Matte,
    velocity_px_s: Tensor,
    exposure_s: float,
    headlamp_lux: BeamPlanes = MappingProxyType({}),
) -> Cut:
    """Cut a picture (1, C, H, W) in linear light into the background and the matte's objects at a velocity (2,).

    All objects of a picture move alike, so the union of its masks is enough. Objects whose paths overlap share one
    layer, which is faster.

    >>> light, matte = torch.full((1, 1, 60, 80), 0.5), np.zeros((60, 80), np.float32)
    >>> matte[10:14, 10:14] = matte[40:44, 60:64] = 1
    >>> cut = in_motion(light, matte, torch.tensor([300.0, 0.0]), exposure_s=0.01)
    >>> len(cut.layers)  # two objects, whose paths of 3 px do not overlap
    2
    """
    covered = (matte > 0).astype(np.uint8)
    across, down = [
        max(1, spread_px(abs(along) * exposure_s / 2)) for along in velocity_px_s.detach().tolist()
    ]
    # Objects are one where their paths may meet: within the reach of the blur, tails included.
    near = cv2.dilate(covered, np.ones((2 * down + 1, 2 * across + 1), np.uint8))
    count, parts = cv2.connectedComponents(near)
    mattes = [matte] if count == 2 else [np.where(parts == part, matte, 0) for part in range(1, count)]
    return cut_out(light, mattes, [velocity_px_s] * len(mattes), headlamp_lux=headlamp_lux)
