"""The lens's blur as light effects: defocus and diffraction by their transfer functions, or a measured one."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass
from functools import lru_cache

from torch import Tensor

from blurnoise._core.borders import Border
from blurnoise.blur import convolution, over_the_field
from blurnoise.light.conditions import OperatingPoint
from blurnoise.light.effect import Blur, LightEffect
from blurnoise.optics.camera import Camera
from blurnoise.optics.distortion import Floats
from blurnoise.optics.lens import Field, Size
from blurnoise.optics.transfer import Optics


@dataclass(frozen=True)
class Defocus(LightEffect):
    """The disc of confusion: its transfer function, or its areas in the pixels where the camera asks for them.

    With field curvature another disc for every pixel, see :mod:`blurnoise.blur.over_the_field`.
    """

    name = "defocus"
    figures = ("defocus_radius_px",)

    def bound(self, at: OperatingPoint[float]) -> float:
        """As :attr:`.transfer.Optics.error` of the largest disc; areas do nothing up to half a pixel."""
        if at.camera.defocus_counts_pixel:
            return 0.0 if at.camera.defocus_radius_px <= 0.5 else 0.5
        return Optics(defocus_radius_px=max(_ends_px(at.camera))).error

    def blur(self, at: OperatingPoint[Tensor]) -> Blur | None:
        """Shared with the lens's other blurs and with motion, unless by areas or over the field."""
        if at.camera.defocus_counts_pixel or at.camera.lens.field_curvature_px:
            return None
        return Blur(Optics(defocus_radius_px=at.camera.defocus_radius_px))

    def apply(self, light: Tensor, at: OperatingPoint[Tensor], border: Border) -> Tensor:
        """By the disc's areas in the pixels, or over the field."""
        camera = at.camera
        if not camera.lens.field_curvature_px:
            return convolution.defocus(light, camera.defocus_radius_px, border=border)
        radii, tiles = _over_field(camera.field, camera.defocus_radius_px, (light.shape[-2], light.shape[-1]))
        return over_the_field.defocus(light, radii, border=border, tiles=tiles)

    def how(self, at: OperatingPoint[float]) -> str:
        """By which of the three."""
        if at.camera.defocus_counts_pixel:
            return f"areas of a disc, {at.camera.defocus_radius_px:g} px"
        if not at.camera.lens.field_curvature_px:
            return "transfer function"
        centre, corner = _ends_px(at.camera)
        through = at.camera.defocus_radius_px + at.camera.lens.field_curvature_px < 0  # 0, between them
        discs = over_the_field.discs(0.0 if through else min(centre, corner), max(centre, corner))
        return f"disc of {centre:g} px, {corner:g} px in the corner: at most {len(discs)} blurs, blended"

    def key(self, at: OperatingPoint[float]) -> Hashable:
        """The radius, by which of the three, and the field it changes over."""
        camera = at.camera
        field = camera.field if camera.lens.field_curvature_px else None
        return camera.defocus_radius_px, camera.defocus_counts_pixel, field


@dataclass(frozen=True)
class Diffraction(LightEffect):
    """Diffraction at a round aperture, of the wavelength that the camera states."""

    name = "diffraction"
    figures = ("diffraction_wavelength_um",)

    def bound(self, at: OperatingPoint[float]) -> float:
        """As :attr:`blurnoise.optics.transfer.Optics.error`."""
        return _airy(at).error

    def blur(self, at: OperatingPoint[Tensor]) -> Blur | None:
        """Shared with defocus and motion."""
        return Blur(_airy(at))

    def apply(self, light: Tensor, at: OperatingPoint[Tensor], border: Border) -> Tensor:
        """By its transfer function."""
        return convolution.optical_blur(light, _airy(at), border=border)

    def how(self, at: OperatingPoint[float]) -> str:
        """Its cut-off."""
        reach = _airy(at).diffraction_lambda_n_px
        return f"transfer function, to {1 / reach:.3g} cycles/px" if reach else "transfer function"

    def key(self, at: OperatingPoint[float]) -> Hashable:
        """Wavelength times f-number over pitch."""
        return _airy(at).diffraction_lambda_n_px


@dataclass(frozen=True)
class MeasuredMtf(LightEffect):
    """A measured MTF, in place of defocus and diffraction."""

    name = "measured MTF"

    def bound(self, at: OperatingPoint[float]) -> float:
        """As :attr:`blurnoise.optics.transfer.Optics.error`."""
        return _measured(at).error

    def blur(self, at: OperatingPoint[Tensor]) -> Blur | None:
        """Shared with motion."""
        return Blur(_measured(at))

    def apply(self, light: Tensor, at: OperatingPoint[Tensor], border: Border) -> Tensor:
        """By its transfer function."""
        return convolution.optical_blur(light, _measured(at), border=border)

    def how(self, at: OperatingPoint[float]) -> str:
        """How many samples it has, and up to where."""
        curve = at.camera.lens.mtf
        if curve is None:
            return "transfer function"
        return f"transfer function of {len(curve.values)} samples, to {curve.frequencies[-1]:g} {curve.unit}"

    def key(self, at: OperatingPoint[float]) -> Hashable:
        """The curve, per pixel."""
        return _measured(at).measured


def _airy(at: OperatingPoint[float] | OperatingPoint[Tensor]) -> Optics:
    camera = at.camera
    return Optics(
        diffraction_lambda_n_px=camera.diffraction_wavelength_um * camera.f_number / camera.pixel_pitch_um
    )


def _measured(at: OperatingPoint[float] | OperatingPoint[Tensor]) -> Optics:
    curve = at.camera.lens.mtf
    return Optics(measured=curve.per_px(at.camera.pixel_pitch_um) if curve else None)


def _ends_px(camera: Camera) -> tuple[float, float]:
    """The disc's radius on the axis and in the corner of the sensor, between which it may pass through 0."""
    return camera.defocus_radius_px, abs(camera.defocus_radius_px + camera.lens.field_curvature_px)


@lru_cache(maxsize=8)
def _over_field(field: Field, defocus_px: float, size: Size) -> tuple[Floats, list[over_the_field.Tile]]:
    """The disc's radius (H, W) in a picture, and how it is blurred."""
    radii = abs(defocus_px + field.lens.field_curvature_px * field.heights(size) ** 2)
    return radii, over_the_field.plan(radii)


DEFOCUS, DIFFRACTION, MEASURED_MTF = Defocus(), Diffraction(), MeasuredMtf()
