"""Motion as a light effect: uniform and straight during the exposure, the same for the whole picture.

Convention: centred, so that what moves is at mid-exposure where the picture without motion has it.
"""

from __future__ import annotations

import math
from collections.abc import Hashable
from dataclasses import dataclass

import torch
from torch import Tensor

from blurnoise import blur, transfer
from blurnoise._core.borders import Border
from blurnoise.light.effect import Blur, LightEffect
from blurnoise.operating_point import OperatingPoint


@dataclass(frozen=True)
class Motion(LightEffect):
    """Motion by its transfer function, any length and angle."""

    name = "motion"

    def bound(self, at: OperatingPoint[float]) -> float:
        """:func:`blurnoise.transfer.motion_error` of the length."""
        return transfer.motion_error(math.hypot(*at.displacement_px))

    def blur(self, at: OperatingPoint[Tensor]) -> Blur | None:
        """Shared with the lens; where there are objects, :mod:`blurnoise.light.objects` moves all."""
        return Blur() if at.objects else Blur(displacement_px=torch.as_tensor(at.displacement_px))

    def apply(self, light: Tensor, at: OperatingPoint[Tensor], border: Border) -> Tensor:
        """By its transfer function."""
        return blur.motion_blur(light, at.displacement_px, border=border)

    def sweep_boxes(self, boxes_xyxy: Tensor, at: OperatingPoint[float]) -> Tensor:
        """Grown by half the displacement to either side."""
        half = swept_half_px(boxes_xyxy.new_tensor(at.displacement_px))
        return boxes_xyxy + torch.cat([-half, half])

    def how(self, at: OperatingPoint[float]) -> str:
        """The length."""
        if at.objects:
            return f"with the objects, {math.hypot(*at.displacement_px):.3g} px"
        camera, lens = at.camera, at.camera.lens
        apart = camera.defocus_counts_pixel or lens.field_curvature_px
        shares = (camera.defocus_radius_px and not apart) or camera.diffraction_wavelength_um or lens.mtf
        together = ", with the lens's" if shares else ""
        return f"transfer function, {math.hypot(*at.displacement_px):.3g} px{together}"

    def key(self, at: OperatingPoint[float]) -> Hashable:
        """The displacement."""
        return at.displacement_px


def swept_half_px(displacement_px: Tensor) -> Tensor:
    """What displacements (..., 2), px, sweep to either side of a place at mid-exposure, (..., 2), >= 0."""
    return displacement_px.abs() / 2


MOTION = Motion()
