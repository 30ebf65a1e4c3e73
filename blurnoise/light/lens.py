"""A lens's effects on light: distortion, lateral colour, defocus, diffraction or a measured MTF, vignetting.

Convention: the scene is what a pinhole camera of the same focal length and axis sees; what it does not see follows
the picture's border. Displacements are by :mod:`blurnoise.blur.resampling`, which loses what is near 0.5 cycles/px.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Hashable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import torch
from torch import Tensor

from blurnoise._core.borders import Border
from blurnoise.blur import convolution, over_the_field, resampling
from blurnoise.light.conditions import Conditions
from blurnoise.light.effect import Blur, LightEffect
from blurnoise.optics import lens
from blurnoise.optics.camera import Camera
from blurnoise.optics.lens import Field, Size
from blurnoise.optics.spectra import Floats
from blurnoise.optics.transfer import Optics


@dataclass(frozen=True)
class _OverTheField(LightEffect):
    """An effect that differs from place to place, of cameras whose lens :meth:`has` it."""

    @abstractmethod
    def has(self, camera: Camera) -> bool:
        """Whether the camera's lens has this effect."""

    def blur(self, at: Conditions[Tensor]) -> Blur | None:
        return None if self.has(at.camera) else Blur()

    def key(self, at: Conditions[float]) -> Hashable:
        return at.camera.field if self.has(at.camera) else None


@dataclass(frozen=True)
class _ByTransferFunction(LightEffect):
    """A blur that is the same everywhere, hence shares a transform with its neighbours."""

    @abstractmethod
    def optics(self, camera: Camera) -> Optics:
        """The lens with this cause of blur alone."""

    def bound(self, at: Conditions[float]) -> float:
        return self.optics(at.camera).error

    def blur(self, at: Conditions[Tensor]) -> Blur | None:
        return Blur(self.optics(at.camera))

    def apply(self, light: Tensor, at: Conditions[Tensor], border: Border) -> Tensor:
        return convolution.optical_blur(light, self.optics(at.camera), border=border)

    def key(self, at: Conditions[float]) -> Hashable:
        return self.optics(at.camera)


class Distortion(_OverTheField):
    """Distortion by OpenCV's models; boxes follow."""

    name = "distortion"

    def has(self, camera: Camera) -> bool:
        return camera.lens.displaces

    def bound(self, at: Conditions[float]) -> float:
        return _displaced(lens.farthest_px(at.camera.field)) if self.has(at.camera) else 0.0

    def apply(self, light: Tensor, at: Conditions[Tensor], border: Border) -> Tensor:
        x, y = lens.sources(at.camera.field, _size(light))
        return resampling.sampled(light, x, y, border)

    def how(self, at: Conditions[float]) -> str:
        shape = at.camera.lens.distortion
        if shape is None:
            return "resampled"
        return f"{shape.model}, up to {lens.farthest_px(at.camera.field):.3g} px: resampled by splines"

    def displaces(self, camera: Camera) -> bool:
        return self.has(camera)

    def move_boxes(self, boxes_xyxy: Tensor, at: Conditions[float]) -> Tensor:
        if not self.has(at.camera):
            return boxes_xyxy
        field = at.camera.field
        moved = field.moved_boxes(boxes_xyxy.detach().cpu().double().numpy(), at.size or field.size)
        return torch.from_numpy(moved).to(boxes_xyxy)


class LateralColour(_OverTheField):
    """Red and blue larger or smaller than green, in pictures of three channels, R, G and B; others have no colour."""

    name = "lateral colour"

    def has(self, camera: Camera) -> bool:
        return any(_shares(camera))

    def bound(self, at: Conditions[float]) -> float:
        return _displaced(max(map(abs, _shares(at.camera))) * at.camera.field.corner_px)

    def apply(self, light: Tensor, at: Conditions[Tensor], border: Border) -> Tensor:
        if light.shape[1] != 3:
            return light
        red, green, blue = (light[:, place : place + 1] for place in range(3))
        of_red, of_blue = _shares(at.camera)
        return torch.cat([_larger(red, of_red, at, border), green, _larger(blue, of_blue, at, border)], 1)

    def how(self, at: Conditions[float]) -> str:
        red, blue = (share * at.camera.field.corner_px for share in _shares(at.camera))
        return f"in the corner red {red:+.3g} px, blue {blue:+.3g} px from green: resampled by splines"


@dataclass(frozen=True)
class Defocus(LightEffect):
    """The disc of confusion: its transfer function, or its areas in the pixels where the camera asks for them.

    With field curvature another disc for every pixel, see :mod:`blurnoise.blur.over_the_field`.
    """

    name = "defocus"
    figures = ("defocus_radius_px",)

    def bound(self, at: Conditions[float]) -> float:
        """The error of the largest disc; disc areas up to half a pixel are the identity."""
        if at.camera.defocus_counts_pixel:
            return 0.0 if at.camera.defocus_radius_px <= 0.5 else 0.5
        return Optics(defocus_radius_px=max(_ends_px(at.camera))).error

    def blur(self, at: Conditions[Tensor]) -> Blur | None:
        if at.camera.defocus_counts_pixel or at.camera.lens.field_curvature_px:
            return None
        return Blur(Optics(defocus_radius_px=at.camera.defocus_radius_px))

    def apply(self, light: Tensor, at: Conditions[Tensor], border: Border) -> Tensor:
        camera = at.camera
        if not camera.lens.field_curvature_px:
            return convolution.defocus(light, camera.defocus_radius_px, border=border)
        radii = _over_field(camera.field, camera.defocus_radius_px, _size(light))
        return over_the_field.defocus(light, radii, border=border)

    def how(self, at: Conditions[float]) -> str:
        if at.camera.defocus_counts_pixel:
            return f"areas of a disc, {at.camera.defocus_radius_px:g} px"
        if not at.camera.lens.field_curvature_px:
            return "transfer function"
        centre, corner = _ends_px(at.camera)
        through = at.camera.defocus_radius_px + at.camera.lens.field_curvature_px < 0  # 0, between them
        discs = over_the_field.discs(0.0 if through else min(centre, corner), max(centre, corner))
        return f"disc of {centre:g} px, {corner:g} px in the corner: at most {len(discs)} blurs, blended"

    def key(self, at: Conditions[float]) -> Hashable:
        camera = at.camera
        field = camera.field if camera.lens.field_curvature_px else None
        return camera.defocus_radius_px, camera.defocus_counts_pixel, field


class Diffraction(_ByTransferFunction):
    """Diffraction at a round aperture, of the camera's diffraction_wavelength_um."""

    name = "diffraction"
    figures = ("diffraction_wavelength_um",)

    def optics(self, camera: Camera) -> Optics:
        return Optics(diffraction_lambda_n_px=camera.optics.diffraction_lambda_n_px)

    def how(self, at: Conditions[float]) -> str:
        reach = at.camera.optics.diffraction_lambda_n_px
        return f"transfer function, to {1 / reach:.3g} cycles/px" if reach else "transfer function"


class MeasuredMtf(_ByTransferFunction):
    """A measured MTF, in place of defocus and diffraction."""

    name = "measured MTF"

    def optics(self, camera: Camera) -> Optics:
        return Optics(measured=camera.optics.measured)

    def how(self, at: Conditions[float]) -> str:
        curve = at.camera.lens.mtf
        if curve is None:
            return "transfer function"
        return f"transfer function of {len(curve.values)} samples, to {curve.frequencies[-1]:g} {curve.unit}"


class Vignetting(_OverTheField):
    """The light of every pixel times its relative illumination, by the field angle or by a measured curve."""

    name = "vignetting"

    def has(self, camera: Camera) -> bool:
        return camera.lens.falloff_power > 0 or camera.lens.relative_illumination is not None

    def bound(self, at: Conditions[float]) -> float:
        """The largest loss of light in a white picture."""
        return 1 - lens.least_light(at.camera.field) if self.has(at.camera) else 0.0

    def apply(self, light: Tensor, at: Conditions[Tensor], border: Border) -> Tensor:
        return light * torch.from_numpy(lens.light(at.camera.field, _size(light))).to(light)

    def how(self, at: Conditions[float]) -> str:
        if not self.has(at.camera):
            return "pixel by pixel"
        by = f"cos^{at.camera.lens.falloff_power:g}" if at.camera.lens.falloff_power else "measured curve"
        return f"{by}, {lens.least_light(at.camera.field):.3g} of the light in the darkest corner"


def _displaced(by_px: float) -> float:
    """Largest RMS change of a picture by a displacement, in units of white.

    A wave changes by at most 2 pi f d of its amplitude; the worst picture is a checkerboard, whose contrast, 1/2 RMS,
    lies at f = 1 / sqrt(2).
    """
    return min(1.0, math.pi * by_px / math.sqrt(2))


def _shares(camera: Camera) -> tuple[float, float]:
    return camera.lens.lateral_red, camera.lens.lateral_blue


def _larger(plane: Tensor, share: float, at: Conditions[Tensor], border: Border) -> Tensor:
    if not share:
        return plane
    x, y = lens.larger(at.camera.field, share, _size(plane))
    return resampling.sampled(plane, x, y, border)


def _ends_px(camera: Camera) -> tuple[float, float]:
    """The disc's radius on the axis and in the corner of the sensor, between which it may pass through 0."""
    return camera.defocus_radius_px, abs(camera.defocus_radius_px + camera.lens.field_curvature_px)


def _size(light: Tensor) -> Size:
    return light.shape[-2], light.shape[-1]


@lru_cache(maxsize=8)
def _over_field(field: Field, defocus_px: float, size: Size) -> Floats:
    """The disc's radius (H, W) in a picture."""
    return np.asarray(abs(defocus_px + field.lens.field_curvature_px * field.heights(size) ** 2))


DISTORTION, LATERAL_COLOUR, VIGNETTING = Distortion(), LateralColour(), Vignetting()
DEFOCUS, DIFFRACTION, MEASURED_MTF = Defocus(), Diffraction(), MeasuredMtf()
