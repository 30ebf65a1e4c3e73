"""The lens as light effects: defocus and diffraction, by their transfer functions."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass

from torch import Tensor

from blurnoise import blur
from blurnoise._core.borders import Border
from blurnoise.light.effect import Blur, LightEffect
from blurnoise.operating_point import OperatingPoint
from blurnoise.transfer import Optics


@dataclass(frozen=True)
class Defocus(LightEffect):
    """The disc of confusion: its transfer function, or its areas in the pixels where the camera asks for them."""

    name = "defocus"
    figures = ("defocus_radius_px",)

    def bound(self, at: OperatingPoint[float]) -> float:
        """As :attr:`blurnoise.transfer.Optics.error`; areas do nothing up to half a pixel."""
        if at.camera.defocus_counts_pixel:
            return 0.0 if at.camera.defocus_radius_px <= 0.5 else 0.5
        return Optics(defocus_radius_px=at.camera.defocus_radius_px).error

    def blur(self, at: OperatingPoint[Tensor]) -> Blur | None:
        """Shared with the lens's other blurs and with motion, unless by areas."""
        if at.camera.defocus_counts_pixel:
            return None
        return Blur(Optics(defocus_radius_px=at.camera.defocus_radius_px))

    def apply(self, light: Tensor, at: OperatingPoint[Tensor], border: Border) -> Tensor:
        """By the disc's areas in the pixels."""
        return blur.defocus(light, at.camera.defocus_radius_px, border=border)

    def how(self, at: OperatingPoint[float]) -> str:
        """By which of the two."""
        if at.camera.defocus_counts_pixel:
            return f"areas of a disc, {at.camera.defocus_radius_px:g} px"
        return "transfer function"

    def key(self, at: OperatingPoint[float]) -> Hashable:
        """The radius, and by which of the two."""
        return at.camera.defocus_radius_px, at.camera.defocus_counts_pixel


@dataclass(frozen=True)
class Diffraction(LightEffect):
    """Diffraction at a round aperture, of the wavelength that the camera states."""

    name = "diffraction"
    figures = ("diffraction_wavelength_um",)

    def bound(self, at: OperatingPoint[float]) -> float:
        """As :attr:`blurnoise.transfer.Optics.error`."""
        return _airy(at).error

    def blur(self, at: OperatingPoint[Tensor]) -> Blur | None:
        """Shared with defocus and motion."""
        return Blur(_airy(at))

    def apply(self, light: Tensor, at: OperatingPoint[Tensor], border: Border) -> Tensor:
        """By its transfer function."""
        return blur.optical_blur(light, _airy(at), border=border)

    def how(self, at: OperatingPoint[float]) -> str:
        """Its cut-off."""
        reach = _airy(at).diffraction_lambda_n_px
        return f"transfer function, to {1 / reach:.3g} cycles/px" if reach else "transfer function"

    def key(self, at: OperatingPoint[float]) -> Hashable:
        """Wavelength times f-number over pitch."""
        return _airy(at).diffraction_lambda_n_px


def _airy(at: OperatingPoint[float] | OperatingPoint[Tensor]) -> Optics:
    camera = at.camera
    return Optics(
        diffraction_lambda_n_px=camera.diffraction_wavelength_um * camera.f_number / camera.pixel_pitch_um
    )


DEFOCUS, DIFFRACTION = Defocus(), Diffraction()
