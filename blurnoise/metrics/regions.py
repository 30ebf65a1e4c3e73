"""Pictures of any integer or float type to the linear values that metrics are taken from.

Domain: digital numbers as they come, (H, W), (C, H, W) or (B, C, H, W) with one or three channels; out come
float64 values with the black level removed, (B, H, W), three channels as their luminance (ITU-R BT.709).
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from blurnoise._core import checks

Roi = tuple[int, int, int, int]
"""Left, top, width and height of a region, px."""

SMALLEST_PX = 8
CLIPPED_SHARE = 0.005
LUMINANCE = (0.2126, 0.7152, 0.0722)
"""Of red, green and blue, ITU-R BT.709."""
_FULL_SCALE = {torch.uint8: 255.0, torch.uint16: 65535.0, torch.float32: 1.0, torch.float64: 1.0}


@dataclass(frozen=True)
class Regions:
    """values: (B, H, W) float64, black level removed. colours: (B, C, H, W), what they are the luminance of, as read.

    clipped, finite: (B,) bool.
    """

    values: Tensor
    colours: Tensor
    clipped: Tensor
    finite: Tensor


def read(image: Tensor, *, full_scale: float | None, black_level: float, roi: Roi | None) -> Regions:
    """Cut the region out of each picture and look for what no later step could see.

    full_scale: the largest number that a pixel can hold; None means 255, 65535 or, for floats, 1. The smallest
    is 0, or the picture's least where floats go below it. A pixel at either counts as clipped.
    Raises ``TypeError`` for other types, ``ValueError`` for other shapes, regions outside the picture or smaller
    than 8 x 8 px, values beyond ``full_scale`` and a ``black_level`` that is not below it.
    """
    pixels = _cut(_batch(image), roi)
    top = (
        _FULL_SCALE[image.dtype]
        if full_scale is None
        else checks.in_range("full_scale", full_scale, 0.0, above=True)
    )
    black = checks.in_range("black_level", black_level, 0.0, top)
    if black == top:
        raise ValueError(f"black_level = {black:g}: must be below full_scale = {top:g}")
    raw = pixels.to("cpu", torch.float64)
    finite = torch.isfinite(raw.sum((1, 2, 3)))
    lowest, highest = raw.amin((1, 2, 3)), raw.amax((1, 2, 3))
    if bool((highest[finite] > top).any()):
        largest = float(highest[finite].max())
        raise ValueError(f"image: holds {largest:g}, above full_scale = {top:g}; state its full_scale")
    floor = lowest.clamp(max=0.0)[:, None, None, None]
    clipped = torch.zeros_like(finite)
    if bool(((highest >= top) | (lowest <= 0)).any()):
        at_limit = ((raw >= top) | (raw <= floor)).any(1)  # a channel alone can clip: luminance would hide it
        clipped = at_limit.to(torch.float64).mean((1, 2)) > CLIPPED_SHARE
    weights = raw.new_tensor(LUMINANCE if raw.shape[1] == 3 else [1.0])
    values = torch.einsum("bchw,c->bhw", raw, weights) if raw.shape[1] == 3 else raw[:, 0]
    return Regions(values - black, raw, clipped, finite)


def _batch(image: Tensor) -> Tensor:
    if not isinstance(image, Tensor):
        raise TypeError(f"image: must be a torch.Tensor, got {type(image).__name__}")
    if image.dtype not in _FULL_SCALE:
        raise TypeError(f"image: must be uint8, uint16, float32 or float64, got {image.dtype}")
    if image.ndim not in (2, 3, 4) or 0 in image.shape or (image.ndim > 2 and image.shape[-3] not in (1, 3)):
        raise ValueError(
            "image: shape must be (H, W), (C, H, W) or (B, C, H, W) with 1 or 3 channels, none of them 0, "
            f"got {tuple(image.shape)}"
        )
    channels = 1 if image.ndim == 2 else image.shape[-3]
    return image.detach().reshape(-1, channels, *image.shape[-2:])


def _cut(pixels: Tensor, roi: Roi | None) -> Tensor:
    height, width = pixels.shape[-2:]
    left, top, wide, high = (0, 0, width, height) if roi is None else checks.rectangle("roi", roi)
    if min(left, top) < 0 or left + wide > width or top + high > height:
        raise ValueError(f"roi = {checks.shown(roi)}: must lie inside the picture, {width} x {height} px")
    if min(wide, high) < SMALLEST_PX:
        raise ValueError(
            f"image: the region is {wide} x {high} px; must be at least {SMALLEST_PX} x {SMALLEST_PX}"
        )
    return pixels[..., top : top + high, left : left + wide]
