"""Motion as a light effect: straight or along a trajectory, the same for the whole picture or not.

Convention: centred, so that what moves straight is at mid-exposure where the picture without motion has it, and what
moves otherwise on average, or at mid-exposure, as its trajectory says: boxes stay.
"""

from __future__ import annotations

import math
from collections.abc import Hashable
from dataclasses import dataclass

import torch
from torch import Tensor

from blurnoise import path_blur, transfer
from blurnoise._core.borders import Border
from blurnoise.flow_blur import flow_blur
from blurnoise.light.effect import Blur, LightEffect
from blurnoise.operating_point import OperatingPoint, each_of, in_rows, path, row_by_row, skewed


@dataclass(frozen=True)
class Motion(LightEffect):
    """Motion by its transfer function: straight of any length and angle, or a path of straight segments."""

    name = "motion"

    def bound(self, at: OperatingPoint[float]) -> float:
        """:func:`blurnoise.transfer.motion_error`, or :attr:`blurnoise.trajectory.Polyline.error`."""
        if (along := path(at)) is not None:
            return along.error
        if row_by_row(at):
            return 0.0
        return transfer.motion_error(*at.displacement_px)

    def blur(self, at: OperatingPoint[Tensor]) -> Blur:
        """Shared with the lens; where there are objects, :mod:`blurnoise.light.objects` moves all, and where each
        pixel has its motion, :class:`MotionVariation` does."""
        if at.objects or at.flow_px is not None:
            return Blur()
        moved = torch.as_tensor(at.displacement_px)
        if not at.trajectories and not at.camera.row_time_s:
            return Blur(displacement_px=moved)
        each = list(each_of(at))
        elsewhere = torch.tensor(
            [row_by_row(one) or in_rows(one) or skewed(one) for one in each], device=moved.device
        )
        return Blur(displacement_px=moved.masked_fill(elsewhere[:, None], 0.0), paths=tuple(map(path, each)))

    def apply(self, light: Tensor, at: OperatingPoint[Tensor], border: Border) -> Tensor:
        """By its transfer function."""
        own = self.blur(at)
        return path_blur.exposure_blur(light, at.displacement_px, own.paths, own.optics, border=border)

    def sweep_boxes(self, boxes_xyxy: Tensor, at: OperatingPoint[float]) -> Tensor:
        """Grown by half the displacement to either side, or by what the path covers."""
        if (along := path(at)) is not None:
            return boxes_xyxy + boxes_xyxy.new_tensor(along.box)
        if row_by_row(at):
            return boxes_xyxy
        half = swept_half_px(boxes_xyxy.new_tensor(at.displacement_px))
        return boxes_xyxy + torch.cat([-half, half])

    def how(self, at: OperatingPoint[float]) -> str:
        """The length, or the path's extent and segments."""
        if at.objects:
            return f"with the objects, {math.hypot(*at.displacement_px):.3g} px"
        camera, lens = at.camera, at.camera.lens
        apart = camera.defocus_counts_pixel or lens.field_curvature_px
        shares = (camera.defocus_radius_px and not apart) or camera.diffraction_wavelength_um or lens.mtf
        together = ", with the lens's" if shares else ""
        if (along := path(at)) is not None:
            left, top, right, bottom = along.box
            extent = f"{right - left:.3g}x{bottom - top:.3g} px"
            return f"transfer function of {len(along.shares)} segments over {extent}{together}"
        length = f"{math.hypot(*at.displacement_px):.3g} px"
        if at.variation_px:
            return f"{length} in the middle; by transfer function where its variation is not modelled"
        return f"transfer function, {length}{together}"

    def key(self, at: OperatingPoint[float]) -> Hashable:
        """The displacement and the trajectory."""
        return at.displacement_px, at.trajectories


@dataclass(frozen=True)
class MotionVariation(LightEffect):
    """Motion that differs from pixel to pixel, as a moving camera's; left out, one motion serves the picture."""

    name = "motion variation"

    def bound(self, at: OperatingPoint[float]) -> float:
        """:func:`blurnoise.transfer.motion_variation_error` of what is farthest from the one motion."""
        return transfer.motion_variation_error(float(at.variation_px))

    def blur(self, at: OperatingPoint[Tensor]) -> Blur | None:
        """Nothing to share, unless there is a flow that objects have not met."""
        return Blur() if at.flow_px is None or at.objects else None

    def apply(self, light: Tensor, at: OperatingPoint[Tensor], border: Border) -> Tensor:
        """By sub-exposures along each pixel's path."""
        return light if at.flow_px is None or at.objects else flow_blur(light, at.flow_px, border=border)

    def how(self, at: OperatingPoint[float]) -> str:
        """How far displacements differ."""
        return f"sub-exposures along each pixel's path, up to {at.variation_px:.3g} px from the middle one"

    def key(self, at: OperatingPoint[float]) -> Hashable:
        """Of its own: exposures that share their light have one motion for the picture."""
        return at.variation_px


def swept_half_px(displacement_px: Tensor) -> Tensor:
    """What displacements (..., 2), px, sweep to either side of a place at mid-exposure, (..., 2), >= 0."""
    return displacement_px.abs() / 2


MOTION = Motion()
MOTION_VARIATION = MotionVariation()
