"""Mattes: where objects are in a picture, and the layers cut out by them.

Domain: a matte is (H, W) float32 within [0, 1], the share of each pixel that the object covers. Coordinates in px
from the corner of the first pixel, x right, y down. What is behind an object in a photograph nobody knows: it is
invented from around it (Bertalmío et al. 2001), and ``invented`` says where.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from blurnoise._core.checks import an_instance, image_batch, in_range, integer, shown
from blurnoise._core.limits import LARGEST_PICTURE
from blurnoise.layers import Layer

Matte = NDArray[np.float32]
Size = tuple[int, int]
_MIXED_PX = 1  # from an edge inwards, colours hold what was behind
_BLED_PX = 2  # from an edge outwards, what is behind holds the object's
AROUND_PX = 24  # what is looked at around a hole
_NEAR_PX = 5.0
LARGEST_PX = 1e6


class Cut(NamedTuple):
    """A picture (1, C, H, W) without its objects, these as layers, and where (H, W) it had to be invented."""

    background: Tensor
    layers: tuple[Layer, ...]
    invented: NDArray[np.bool_]


def of_box(x: float, y: float, width: float, height: float, size: Size) -> Matte:
    """Of a rectangle in a picture (H, W), by area."""
    size = checked_size(size)
    spans = []
    for name, start, length, most in (("x, width", x, width, size[1]), ("y, height", y, height, size[0])):
        in_range(f"box: {name}", start, -LARGEST_PX, LARGEST_PX)
        in_range(f"box: {name}", length, 0.0, LARGEST_PX, above=True)
        pixels = np.arange(most)
        spans.append(np.clip(np.minimum(start + length, pixels + 1) - np.maximum(start, pixels), 0, 1))
    across, down = spans
    return np.asarray(down[:, None] * across, np.float32)


def checked_size(size: Size) -> Size:
    """``size``, checked. Raises ``TypeError`` or ``ValueError``."""
    if not isinstance(size, (tuple, list)) or len(size) != 2:
        raise ValueError(f"size = {shown(size)}: must be two whole numbers (H, W)")
    height, width = (integer("size", side, 1, 1 << 20) for side in size)
    if height * width > LARGEST_PICTURE:
        raise ValueError(f"size = {height} x {width}: must be at most {LARGEST_PICTURE} pixels")
    return height, width


def cut_out(
    light: Tensor,
    mattes: Sequence[Matte],
    velocities_px_s: Sequence[Iterable[float]],
    plate: Tensor | None = None,
) -> Cut:
    """The objects of a picture (1, C, H, W), linear light, back to front, and what is behind them.

    plate: the scene without them, of the same shape; without it, what they cover is invented from around them.
    Colours within 1 px of an object's edge, which hold what was behind, are taken from further inside. Raises
    ``ValueError`` for a matte of another size, an empty one, and for objects that leave nothing to see around them.
    """
    image_batch("light", light)
    size = (light.shape[-2], light.shape[-1])
    if len(light) != 1 or len(mattes) != len(velocities_px_s):
        raise ValueError(
            f"light: {len(light)} pictures, {len(mattes)} mattes, {len(velocities_px_s)} velocities"
        )
    if plate is not None and image_batch("plate", plate).shape != light.shape:
        raise ValueError(
            f"plate: shape must be the picture's, {tuple(light.shape)}, got {tuple(plate.shape)}"
        )
    layers = []
    covered = np.zeros(size, bool)
    for matte, velocity in zip(mattes, velocities_px_s, strict=True):
        an_instance("matte", matte, np.ndarray)
        if matte.shape != size:
            raise ValueError(f"matte: shape must be the picture's, {size}, got {matte.shape}")
        if not np.isfinite(matte).all():
            raise ValueError("matte: contains NaN or Inf")
        if not (matte > 0).any():
            raise ValueError("matte: is empty")
        layers.append(_layer(light, np.asarray(matte, np.float32), velocity))
        covered |= matte > 0
    if plate is not None:
        return Cut(plate, tuple(layers), np.zeros(size, bool))
    hole = hole_of(covered)
    if hole.all():
        raise ValueError(
            "matte: leaves nothing of the picture from which to invent what is behind; give a plate"
        )
    return Cut(filled(light, hole), tuple(layers), hole)


def hole_of(covered: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """What is to be invented where objects cover (H, W): what is next to them holds some of their light, too."""
    return np.asarray(cv2.dilate(covered.astype(np.uint8), np.ones((2 * _BLED_PX + 1,) * 2, np.uint8)) > 0)


def _layer(light: Tensor, matte: Matte, velocity_px_s: Iterable[float]) -> Layer:
    rows, columns = np.flatnonzero(matte.any(1)), np.flatnonzero(matte.any(0))
    box = (slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1))
    alpha = matte[box]
    whole = cv2.copyMakeBorder((alpha >= 1).astype(np.uint8), *(_MIXED_PX,) * 4, cv2.BORDER_REPLICATE)
    sides = (rows[0] == 0, rows[-1] + 1 == len(matte), columns[0] == 0, columns[-1] + 1 == matte.shape[1])
    for side, edge in zip(((0,), (-1,), (slice(None), 0), (slice(None), -1)), sides, strict=True):
        if not edge:  # there the object ends; at the picture's border it goes on
            whole[side] = 0
    sure = cv2.erode(whole, np.ones((2 * _MIXED_PX + 1,) * 2, np.uint8), borderValue=1)
    inside = sure[_MIXED_PX:-_MIXED_PX, _MIXED_PX:-_MIXED_PX] > 0
    own = light[..., box[0], box[1]]
    colour = filled(own, ~inside & (alpha > 0)) if inside.any() else own
    place = (int(columns[0]), int(rows[0]))
    return Layer(colour[0], torch.from_numpy(np.ascontiguousarray(alpha)).to(light), velocity_px_s, place)


def filled(light: Tensor, hole: NDArray[np.bool_]) -> Tensor:
    """Light (1, C, H, W) with the hole filled from around it, channel by channel; the rest as it is."""
    if not hole.any():
        return light
    rows, columns = np.flatnonzero(hole.any(1)), np.flatnonzero(hole.any(0))
    box = tuple(slice(max(0, each[0] - AROUND_PX), each[-1] + 1 + AROUND_PX) for each in (rows, columns))
    missing = hole[box].astype(np.uint8)
    out = light.clone()
    for channel in range(out.shape[1]):
        part = out[0, channel][box]
        seen = np.ascontiguousarray(part.detach().cpu().numpy(), np.float32)
        found = cv2.inpaint(
            seen, missing, _NEAR_PX, cv2.INPAINT_NS
        )  # of floats, OpenCV 5.0's Telea goes wild
        part[torch.from_numpy(missing > 0).to(light.device)] = torch.from_numpy(found[missing > 0]).to(light)
    return out
