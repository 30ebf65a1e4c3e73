"""Blurs that tests need alone: by a lens, and by each pixel's displacement."""

from __future__ import annotations

import torch
from torch import Tensor

from blurnoise._core.borders import BORDERS, Border
from blurnoise._core.checks import one_of
from blurnoise.blur.convolution import exposure_blur
from blurnoise.blur.sub_exposures import exposed, flowing
from blurnoise.optics.transfer import Optics


def flow_blur(image: Tensor, displacement_px: Tensor, *, border: Border = "reflect") -> Tensor:
    """Pictures (B, C, H, W) of which each pixel averages from d/2 before it to d/2 behind, d (2, H, W) or
    (B, 2, H, W), px."""
    one_of("border", border, BORDERS)
    sheets = flowing(image, displacement_px, border)
    if all(sheet.moves.still for sheet in sheets):
        return image
    return torch.stack([exposed(sheet) for sheet in sheets])


def optical_blur(image: Tensor, optics: Optics, *, border: Border = "reflect") -> Tensor:
    """Blur by the lens."""
    return exposure_blur(image, (0.0, 0.0), optics, border=border)
