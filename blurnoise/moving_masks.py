"""Masks of a batch: which parts of its pictures move, before a background that moves otherwise.

Domain: masks (B, N, H, W), the share of each pixel that an object covers, within [0, 1], of any type. All objects of
a picture move alike, so that the union of its masks says all. What is behind them is invented from around them, by
means of what is known at ever coarser scales: about as near to photographs as the inpainting of
:mod:`blurnoise.mattes`, which every new picture would have to wait for.
"""

from __future__ import annotations

from typing import Literal

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from blurnoise._core.checks import an_instance
from blurnoise.layers import reach_px
from blurnoise.mattes import Cut, Matte, cut_out, hole_of

Moves = Literal["all", "targets", "background"]
"""What moves: everything, as before a camera that turns; what masks show, before a camera at rest; or what is behind
it, before a camera that follows the targets."""
_AROUND_PX = 24  # of a hole, what it is invented from
_LEAST = 1e-6


def checked(masks: Tensor, batch: int, size: tuple[int, int]) -> Tensor:
    """Masks (B, N, H, W) of a batch of pictures (H, W). Raises ``TypeError`` or ``ValueError``."""
    an_instance("masks", masks, Tensor)
    if masks.ndim != 4 or (len(masks), *masks.shape[2:]) != (batch, *size):
        wanted = f"({batch}, N, {size[0]}, {size[1]})"
        raise ValueError(f"masks: shape must be {wanted}, one row for each picture, got {tuple(masks.shape)}")
    if masks.numel() and masks.dtype != torch.bool:
        low, high = (float(end) for end in masks.detach().aminmax())
        if not (low >= 0 and high <= 1):
            raise ValueError(f"masks: values span [{low:g}, {high:g}]; must lie within [0, 1]")
    return masks


def matte_of(masks: Tensor) -> Matte | None:
    """The union of a picture's masks (N, H, W); None where there is nothing, or nothing of the background is left."""
    if not masks.numel():
        return None
    matte = masks.detach().amax(0).to(torch.float32).cpu().numpy()
    return None if not matte.any() or hole_of(matte > 0).all() else matte


def in_motion(light: Tensor, matte: Matte, velocity_px_s: Tensor, exposure_s: float) -> Cut:
    """A picture (1, C, H, W), linear light, cut into its background and what the matte shows, at a velocity (2,).

    Parts so near each other that they meet on their way are one layer, which costs the less.
    """
    covered = (matte > 0).astype(np.uint8)
    reach = [max(1, reach_px(along * exposure_s)) for along in velocity_px_s.detach().tolist()]
    near = cv2.dilate(covered, np.ones((1, 2 * reach[0] + 1), np.uint8))
    near = cv2.dilate(near, np.ones((2 * reach[1] + 1, 1), np.uint8))
    count, parts = cv2.connectedComponents(near)
    own = [matte] if count == 2 else [np.where(parts == part, matte, 0) for part in range(1, count)]
    return cut_out(light, own, [velocity_px_s] * len(own), plate_of(light, matte))


def plate_of(light: Tensor, matte: Matte) -> Tensor:
    """A picture (1, C, H, W) without what the matte shows: no value beyond those around, nor with a gradient."""
    hole = hole_of(matte > 0)
    rows, columns = np.flatnonzero(hole.any(1)), np.flatnonzero(hole.any(0))
    box = tuple(slice(max(0, each[0] - _AROUND_PX), each[-1] + 1 + _AROUND_PX) for each in (rows, columns))
    missing = hole[box]
    seen = light.detach()[0][:, box[0], box[1]].permute(1, 2, 0).cpu().numpy().astype(np.float32)
    found = torch.from_numpy(_from_around(seen, ~missing)).permute(2, 0, 1).to(light)
    out = light.clone()
    part = out[0][:, box[0], box[1]]
    part[:] = torch.where(torch.from_numpy(missing).to(light.device), found, part.clone())
    return out


def _from_around(part: NDArray[np.float32], known: NDArray[np.bool_]) -> NDArray[np.float32]:
    """A part (h, w, C) with what is not known taken from half the scale, where it is the mean of what is."""
    if known.all() or not known.any():
        return part
    height, width = known.shape
    half, weight = ((width + 1) // 2, (height + 1) // 2), known.astype(np.float32)
    share = cv2.resize(weight, half, interpolation=cv2.INTER_AREA)
    light = cv2.resize(part * weight[..., None], half, interpolation=cv2.INTER_AREA).reshape(*share.shape, -1)
    coarse = _from_around(light / np.maximum(share, _LEAST)[..., None], share > _LEAST)
    finer = cv2.resize(coarse, (width, height), interpolation=cv2.INTER_LINEAR).reshape(part.shape)
    return np.where(known[..., None], part, finer)
