"""A lens's effects on light: distortion, lateral colour, defocus, diffraction or a measured MTF, vignetting.

Convention: the scene is what a pinhole camera of the same focal length and axis sees. Where the lens sees further,
the picture is black, whatever its border: a mirrored object would have no label.
Displacements are by :mod:`blurnoise.blur.resampling`, which loses what is near 0.5 cycles/px.
"""

from __future__ import annotations

import math
from collections.abc import Hashable
from dataclasses import replace
from functools import lru_cache

import numpy as np
import torch
from torch import Tensor

from blurnoise._core.borders import Border, Window
from blurnoise.blur import over_the_field, resampling
from blurnoise.blur.layer import Layer, coloured, plane_of
from blurnoise.camera import Camera, lens
from blurnoise.camera.lens import Field, Size
from blurnoise.camera.spectra import Floats
from blurnoise.camera.transfer import SHARP, Optics
from blurnoise.light.effect import Blur, LightEffect
from blurnoise.light.resolved import Resolved


class _OverTheField(LightEffect):
    """An effect that differs from place to place."""

    def key(self, at: Resolved[float]) -> Hashable:
        return None if self.idle(at.camera) else at.camera.field


class _ByTransferFunction(LightEffect):
    """A blur that is the same everywhere and shares a transform with its neighbours; cause: its field of Optics."""

    cause: str

    def optics(self, camera: Camera) -> Optics:
        """The lens with this cause of blur alone."""
        return Optics(**{self.cause: getattr(camera.optics, self.cause)})

    def idle(self, camera: Camera) -> bool:
        return bool(getattr(camera.optics, self.cause) == getattr(SHARP, self.cause))

    def bound(self, at: Resolved[float]) -> float:
        return self.optics(at.camera).error

    def blur(self, at: Resolved[Tensor]) -> Blur | None:
        return Blur(self.optics(at.camera))

    def key(self, at: Resolved[float]) -> Hashable:
        return self.optics(at.camera)


class LensDistortion(_OverTheField):
    """Distortion by OpenCV's models; boxes follow.

    >>> from blurnoise.camera.distortion import Distortion
    >>> barrel = Distortion("opencv", (-0.2, 0.0, 0.0, 0.0))
    >>> camera = Camera.preset("imx250").with_figures(distortion=barrel, width_px=640, height_px=480)
    >>> at = Resolved(camera, 0.01, 25.0, white_e=1000.0)
    >>> DISTORTION.move_boxes(torch.tensor([[600.0, 230.0, 620.0, 250.0]]), at).round()  # towards the centre
    tensor([[586., 231., 602., 249.]])
    """

    name = "distortion"

    def idle(self, camera: Camera) -> bool:
        return not camera.lens.displaces

    def bound(self, at: Resolved[float]) -> float:
        return _displaced(lens.farthest_px(at.camera.field))

    def apply(self, light: Tensor, at: Resolved[Tensor], border: Border) -> Tensor:
        size = _size(light)
        x, y = lens.sources(at.camera.field, size)
        sampled = resampling.sampled(light, x, y, border)
        # Beyond what the scene shows there is no light, whatever the border: a mirrored sign would have no label.
        inside = lens.inside(at.camera.field, size)
        return sampled if inside is None else sampled * torch.from_numpy(inside).to(sampled)

    def apply_to_layer(self, layer: Layer, like: Tensor, at: Resolved[Tensor], border: Border) -> Layer:
        """The layer as the lens shows it, in a window as large as the picture."""
        plane = plane_of([layer], Window(0, 0, like.shape[-2], like.shape[-1]), like, "constant")
        light, alpha = coloured(self.apply(plane, at, border)[0])
        return replace(layer, light=light, alpha=alpha, place_px=(0, 0), headlamp_lux={})

    def how(self, at: Resolved[float]) -> str:
        shape, farthest_px = at.camera.lens.distortion, lens.farthest_px(at.camera.field)
        return f"{shape.model if shape else ''}, up to {farthest_px:.3g} px: resampled by splines"

    def move_boxes(self, boxes_xyxy: Tensor, at: Resolved[float]) -> Tensor:
        field = at.camera.field
        moved = field.moved_boxes(boxes_xyxy.detach().cpu().double().numpy(), at.size or field.size)
        return torch.from_numpy(moved).to(boxes_xyxy)

    def origins(self, points: Floats, at: Resolved[float]) -> Floats:
        return at.camera.field.to_pinhole(points, at.size or at.camera.field.size)


class LateralColour(_OverTheField):
    """Red and blue larger or smaller than green, in pictures of three channels, R, G and B; others have no colour.

    >>> camera = Camera.preset("imx250").with_figures(lateral_red=0.001, width_px=640, height_px=480)
    >>> LATERAL_COLOUR.how(Resolved(camera, 0.01, 25.0, white_e=1000.0))  # 400 px from the centre
    'in the corner red +0.4 px, blue +0 px from green: resampled by splines'
    """

    name = "lateral colour"

    def idle(self, camera: Camera) -> bool:
        return not camera.lens.lateral_red and not camera.lens.lateral_blue

    def bound(self, at: Resolved[float]) -> float:
        of_lens = at.camera.lens
        return _displaced(
            max(abs(of_lens.lateral_red), abs(of_lens.lateral_blue)) * at.camera.field.corner_px
        )

    def apply(self, light: Tensor, at: Resolved[Tensor], border: Border) -> Tensor:
        if light.shape[1] != 3:  # grey light has no colours to separate
            return light
        field, planes = at.camera.field, list(torch.split(light, 1, 1))
        for channel, share in ((0, field.lateral_red), (2, field.lateral_blue)):
            if share:
                x, y = lens.larger(field, share, _size(light))
                planes[channel] = resampling.sampled(planes[channel], x, y, border)
        return torch.cat(planes, 1)

    def how(self, at: Resolved[float]) -> str:
        field = at.camera.field
        red, blue = field.lateral_red * field.corner_px, field.lateral_blue * field.corner_px
        return f"in the corner red {red:+.3g} px, blue {blue:+.3g} px from green: resampled by splines"


class Defocus(_ByTransferFunction):
    """The disc of confusion, by its transfer function.

    With field curvature another disc for every pixel, see :mod:`blurnoise.blur.over_the_field`.

    >>> camera = Camera.preset("imx250").with_figures(defocus_radius_px=1.0, field_curvature_px=1.0)
    >>> DEFOCUS.how(Resolved(camera, 0.01, 25.0, white_e=1000.0))
    'disc of 1 px, 2 px in the corner: at most 6 blurs, blended'
    """

    name = "defocus"
    figures = ("defocus_radius_px",)
    cause = "defocus_radius_px"

    def idle(self, camera: Camera) -> bool:
        return not camera.lens.defocus_radius_px and not camera.lens.field_curvature_px

    def bound(self, at: Resolved[float]) -> float:
        """The error of the largest disc."""
        return Optics(defocus_radius_px=max(_ends_px(at.camera))).error

    def blur(self, at: Resolved[Tensor]) -> Blur | None:
        # A disc that varies over the field has no transfer function to multiply.
        return None if at.camera.lens.field_curvature_px else super().blur(at)

    def apply(self, light: Tensor, at: Resolved[Tensor], border: Border) -> Tensor:
        radii = _radii_px(at.camera.field, at.camera.lens.defocus_radius_px, _size(light))
        return over_the_field.defocus(light, radii, border=border)

    def how(self, at: Resolved[float]) -> str:
        if not at.camera.lens.field_curvature_px:
            return "transfer function"
        centre, corner = _ends_px(at.camera)
        through = at.camera.lens.defocus_radius_px + at.camera.lens.field_curvature_px < 0  # 0, between them
        discs = over_the_field.discs(0.0 if through else min(centre, corner), max(centre, corner))
        return f"disc of {centre:g} px, {corner:g} px in the corner: at most {len(discs)} blurs, blended"

    def key(self, at: Resolved[float]) -> Hashable:
        camera = at.camera
        field = camera.field if camera.lens.field_curvature_px else None
        return camera.lens.defocus_radius_px, field


class Diffraction(_ByTransferFunction):
    """Diffraction at a round aperture, of the camera's diffraction_wavelength_um.

    >>> camera = Camera.preset("imx250").with_figures(diffraction_wavelength_um=0.55, f_number=8.0)
    >>> DIFFRACTION.how(Resolved(camera, 0.01, 25.0, white_e=1000.0))  # 3.45 / (0.55 x 8)
    'transfer function, to 0.784 cycles/px'
    """

    name = "diffraction"
    figures = ("diffraction_wavelength_um",)
    cause = "diffraction_lambda_n_px"

    def how(self, at: Resolved[float]) -> str:
        return f"transfer function, to {1 / at.camera.optics.diffraction_lambda_n_px:.3g} cycles/px"


class MeasuredMtf(_ByTransferFunction):
    """A measured MTF, in place of defocus and diffraction.

    >>> from blurnoise.camera.transfer import Mtf
    >>> camera = Camera.preset("imx250").with_figures(mtf=Mtf((0.0, 0.5), (1.0, 0.4), "cycles/px"))
    >>> MEASURED_MTF.how(Resolved(camera, 0.01, 25.0, white_e=1000.0))
    'transfer function of 2 samples, to 0.5 cycles/px'
    """

    name = "measured MTF"
    cause = "measured"

    def how(self, at: Resolved[float]) -> str:
        curve = at.camera.lens.mtf
        if curve is None:
            return "none here"
        return f"transfer function of {len(curve.values)} samples, to {curve.frequencies[-1]:g} {curve.unit}"


class Vignetting(_OverTheField):
    """The light of every pixel times its relative illumination, by the field angle or by a measured curve.

    >>> camera = Camera.preset("imx250").with_figures(falloff_power=4.0, hfov_deg=60.0, width_px=640, height_px=480)
    >>> VIGNETTING.how(Resolved(camera, 0.01, 25.0, white_e=1000.0))
    'cos^4, 0.433 of the light in the darkest corner'
    """

    name = "vignetting"

    def idle(self, camera: Camera) -> bool:
        return not camera.lens.falloff_power and camera.lens.relative_illumination is None

    def bound(self, at: Resolved[float]) -> float:
        """The largest loss of light in a white picture."""
        return 1 - lens.least_light(at.camera.field)

    def apply(self, light: Tensor, at: Resolved[Tensor], border: Border) -> Tensor:
        return light * torch.from_numpy(lens.light(at.camera.field, _size(light))).to(light)

    def how(self, at: Resolved[float]) -> str:
        by = f"cos^{at.camera.lens.falloff_power:g}" if at.camera.lens.falloff_power else "measured curve"
        return f"{by}, {lens.least_light(at.camera.field):.3g} of the light in the darkest corner"


def _displaced(by_px: float) -> float:
    """Largest RMS change of a picture by a displacement, in units of white.

    A wave changes by at most 2 pi f d of its amplitude; the worst picture is a checkerboard, whose contrast, 1/2 RMS,
    lies at f = 1 / sqrt(2).
    """
    return min(1.0, math.pi * by_px / math.sqrt(2))


def _ends_px(camera: Camera) -> tuple[float, float]:
    """The disc's radius on the axis and in the corner of the sensor, between which it may pass through 0."""
    return camera.lens.defocus_radius_px, abs(camera.lens.defocus_radius_px + camera.lens.field_curvature_px)


def _size(light: Tensor) -> Size:
    return light.shape[-2], light.shape[-1]


@lru_cache(maxsize=8)
def _radii_px(field: Field, defocus_px: float, size: Size) -> Floats:
    """The disc's radius (H, W) in a picture."""
    return np.asarray(abs(defocus_px + field.field_curvature_px * field.heights(size) ** 2))


DISTORTION, LATERAL_COLOUR, VIGNETTING = LensDistortion(), LateralColour(), Vignetting()
DEFOCUS, DIFFRACTION, MEASURED_MTF = Defocus(), Diffraction(), MeasuredMtf()
