"""Masks of a batch: which parts of its pictures move, before a background that moves otherwise.

Domain: masks (B, N, H, W), the share of each pixel that an object covers, within [0, 1], of any type. All objects of
a picture move alike, so that the union of its masks says all. What is behind them is invented from around them
(:func:`blurnoise.mattes.cut_out`).
"""

from __future__ import annotations

from typing import Literal

import cv2
import numpy as np
import torch
from torch import Tensor

from blurnoise._core.checks import an_instance
from blurnoise.layers import reach_px
from blurnoise.mattes import Cut, Matte, cut_out, hole_of

Moves = Literal["all", "targets", "background"]
"""What moves: everything, as before a camera that turns; what masks show, before a camera at rest; or what is behind
it, before a camera that follows the targets."""


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
    return cut_out(light, own, [velocity_px_s] * len(own))
