"""The lens over its field: defocus, colour, light and places that change from a picture's centre to its corner.

Field height 1 is the corner of the sensor, half its diagonal from the centre; angles are those of a pinhole camera of
the same focal length. x right, y down, px, (0, 0) the centre of the first pixel. A picture of another size is the
sensor's largest part of its shape, about its centre. NumPy, float64.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Annotated, Any, Literal

import numpy as np
from annotated_types import Ge, Le

from blurnoise._core.checks import LIMITS, Limit
from blurnoise._core.fields import Figure, check_fields
from blurnoise.camera.distortion import Distortion, column
from blurnoise.camera.figures import SHARE, CameraFigure
from blurnoise.camera.spectra import Floats, check_samples
from blurnoise.camera.transfer import Mtf

_FIGURES = "must map figures to values"
_Share = Annotated[Figure, Ge(0), Le(1)]
_SCATTERED = Limit(0.0, 0.5)  # of the light: beyond, the veil is the picture


@dataclass(frozen=True)
class RelativeIllumination:
    """Light over the field, 0 to 1 of the brightest, at field heights, linear between, held beyond them.

    heights: increasing; unit: "relative", 1 at the sensor's corner, or "mm" on the sensor.

    >>> measured = RelativeIllumination((0.0, 2.0, 4.0), (1.0, 0.9, 0.6), "mm")
    >>> measured.values[-1]  # 4 mm from the centre
    0.6
    """

    heights: tuple[float, ...]
    values: tuple[_Share, ...]
    unit: Literal["relative", "mm"] = "relative"

    def __post_init__(self) -> None:
        check_fields(self)
        check_samples("heights", self.heights, self.values)


@dataclass(frozen=True)
class Lens:
    """The lens of a camera; figures of 0 or None leave their effect out.

    Raises ``TypeError`` or ``ValueError`` naming the figure.

    >>> Lens(f_number=2.8, transmission=0.9, falloff_power=4.0).displaces
    False
    """

    f_number: Annotated[
        Figure, CameraFigure("f-number", "", Limit(0.5, 256.0))
    ]  # in air no lens is below 0.5
    """Working f-number."""
    transmission: Annotated[Figure, CameraFigure("Transmission", "", SHARE)]
    """Of lens and atmosphere."""
    infrared_cut_nm: Annotated[Figure, CameraFigure("Infrared cut", "nm", Limit(0.0, 1e4))] = 0.0
    """Wavelength from which on a filter passes no light; 0: no filter."""
    defocus_radius_px: Annotated[Figure, CameraFigure("Defocus", "px", LIMITS["radius_px"])] = 0.0
    """Radius of the disc to which a point spreads."""
    diffraction_wavelength_um: Annotated[
        Figure,
        CameraFigure("Diffraction at", "µm", Limit(0.0, 20.0), span=(0.0, 1.0)),  # thermal infrared included
    ] = 0.0
    """Wavelength of the light whose diffraction the lens adds, at its f-number."""
    hfov_deg: Annotated[Figure, CameraFigure("Field of view", "°", LIMITS["hfov_deg"])] = 60.0
    """Horizontal field of view of a pinhole camera of the same focal length."""
    field_curvature_px: Annotated[Figure, CameraFigure("Field curvature", "px", Limit(-50.0, 50.0))] = 0.0
    """Defocus at the sensor's corner, added to defocus_radius_px with the square of the field height; either sign."""
    lateral_red: Annotated[Figure, CameraFigure("Lateral colour of red", "", Limit(-0.1, 0.1))] = 0.0
    lateral_blue: Annotated[Figure, CameraFigure("Lateral colour of blue", "", Limit(-0.1, 0.1))] = 0.0
    """By which share the picture of this colour is larger than green's."""
    falloff_power: Annotated[Figure, CameraFigure("Vignetting", "", Limit(0.0, 16.0))] = 0.0
    """Power of the field angle's cosine, natural vignetting: 4 by the law. In place of relative_illumination."""
    relative_illumination: Annotated[RelativeIllumination | None, _FIGURES] = None
    """Measured light over the field."""
    distortion: Annotated[Distortion | None, _FIGURES] = None
    """Measured distortion, by a model of OpenCV."""
    mtf: Annotated[Mtf | None, _FIGURES] = None
    """Measured transfer function, in place of the disc and diffraction."""
    veil_share: Annotated[Figure, CameraFigure("Veil", "", _SCATTERED, span=(0.0, 0.1))] = 0.0
    """Share of the light that is scattered over the whole picture, see :mod:`blurnoise.light.veil`."""
    halo_share: Annotated[Figure, CameraFigure("Halos", "", _SCATTERED, span=(0.0, 0.2))] = 0.0
    """Share of the light that is scattered around its place, with 1 / r^2 from 4 to 256 px of the sensor."""
    t_number: Annotated[Figure, CameraFigure("T-number", "", Limit(0.0, 1e6))] = 0.0
    """Measured f_number / sqrt(transmission), which sets the light in place of both; 0: none."""

    def __post_init__(self) -> None:
        check_fields(self)
        shape, fault = self.distortion, ""
        pinhole = self.falloff_power or (shape and shape.displaces and not shape.focal_px)
        if self.falloff_power and self.relative_illumination:
            must = "must be 0 beside relative_illumination, which holds it"
            fault = f"falloff_power = {self.falloff_power:g}: {must}"
        elif self.mtf and (self.defocus_radius_px or self.diffraction_wavelength_um):
            must = "defocus_radius_px and diffraction_wavelength_um must be 0 beside it"
            fault = f"lens.mtf: is measured with defocus and diffraction, at its own f-number; {must}"
        elif self.veil_share + self.halo_share > _SCATTERED.high:
            total = f"{self.veil_share + self.halo_share:g}"
            fault = f"veil_share + halo_share = {total}: must be at most {_SCATTERED.high:g}"
        elif self.t_number and self.t_number < self.f_number:
            must = f"must be 0 or at least f_number = {self.f_number:g}, as no lens passes more light than it gets"
            fault = f"t_number = {self.t_number:g}: {must}"
        elif self.hfov_deg >= 180 and pinhole:
            must = "must be < 180 for the field angles of lens.falloff_power and lens.distortion"
            fault = f"hfov_deg = {self.hfov_deg:g}: {must}, or lens.distortion states its focal_px"
        if fault:
            raise ValueError(fault)

    @property
    def displaces(self) -> bool:
        """Whether it displaces objects in the picture; lateral colour does not count."""
        return self.distortion is not None and self.distortion.displaces

    def changed(self, **figures: Any) -> Lens:
        """The lens with other figures. Its t_number scales with f_number; another transmission takes its place.

        >>> Lens(f_number=2.0, transmission=0.9, t_number=2.2).changed(f_number=4.0).t_number
        4.4
        """
        if not self.t_number or "t_number" in figures:
            return replace(self, **figures)
        lens = replace(self, t_number=0.0, **figures)
        if "transmission" in figures:
            return lens
        return replace(lens, t_number=self.t_number * lens.f_number / self.f_number)


Size = tuple[int, int]  # of a picture, (H, W)
_COARSE = 33  # samples along an axis: distortion is smooth, so its maximum needs no finer grid
_AROUND = 64  # points on an ellipse


@dataclass(frozen=True)
class Field:
    """The field of a lens on a sensor of width_px by height_px, whose pinhole camera sees hfov_deg across.

    It has the figures of :class:`Lens` that change over the field, and no others: fields are keys of caches, which
    the f-number and the focus leave valid. Points of pictures (H, W) are arrays (2, ...) of x and y, px.

    >>> field = Field(640, 480, hfov_deg=90.0, falloff_power=4.0)
    >>> round(field.focal_px[0]), field.corner_px, round(least_light(field), 3)
    (320, 400.0, 0.153)
    """

    width_px: int
    height_px: int
    hfov_deg: float
    pixel_pitch_um: float = 1.0
    field_curvature_px: float = 0.0
    lateral_red: float = 0.0
    lateral_blue: float = 0.0
    falloff_power: float = 0.0
    relative_illumination: RelativeIllumination | None = None
    distortion: Distortion | None = None

    @property
    def size(self) -> Size:
        """Height and width of the sensor, px."""
        return self.height_px, self.width_px

    @property
    def corner_px(self) -> float:
        """Distance from the sensor's centre to its corner, px."""
        return math.hypot(self.width_px, self.height_px) / 2

    @property
    def focal_px(self) -> tuple[float, float]:
        """Focal lengths (x, y), px of the sensor."""
        if self.distortion and self.distortion.focal_px:
            return self.distortion.focal_px[0], self.distortion.focal_px[1]
        focal = self.width_px / 2 / math.tan(math.radians(self.hfov_deg) / 2)
        return focal, focal

    def per_sensor_px(self, size: Size) -> float:
        """Pixels of a picture per pixel of the sensor."""
        return max(size[0] / self.height_px, size[1] / self.width_px)

    def heights(self, size: Size) -> Floats:
        """Relative field heights (H, W): 0 on the axis, 1 at the corner of the sensor about its centre."""
        points = pixels(size)
        away = np.hypot(*(points - self._axis_px(points, size)))
        return np.asarray(away / (self.corner_px * self.per_sensor_px(size)))

    def directions(self, points: Floats, size: Size) -> Floats:
        """Directions (X/Z, Y/Z) of points in a picture."""
        rays, shape = self._pinhole_directions(points, size), self.distortion
        return shape.undistorted(rays) if shape and shape.displaces else rays

    def imaged(self, rays: Floats, size: Size) -> Floats:
        """Points at which the lens images directions (X/Z, Y/Z)."""
        if self.distortion:
            rays = self.distortion.distorted(self.distortion.before_fold(rays))
        return self._pinhole_points(rays, size)

    def from_pinhole(self, points: Floats, size: Size) -> Floats:
        """Map points of a pinhole's picture to the lens's picture."""
        return self.imaged(self._pinhole_directions(points, size), size) if self.distortion else points

    def to_pinhole(self, points: Floats, size: Size) -> Floats:
        """Map points of the lens's picture to a pinhole's, the inverse of :meth:`from_pinhole`."""
        return self._pinhole_points(self.directions(points, size), size)

    def moved_boxes(self, boxes_xyxy: Floats, size: Size) -> Floats:
        """Boxes (N, 4) of the scene, between the pixels' edges, as the lens images them."""
        # Of the ellipses inscribed in them: objects seldom fill the corners, which move most.
        turn = np.arange(_AROUND) * (2 * np.pi / _AROUND)
        low, high = boxes_xyxy.T[:2, :, None] - 0.5, boxes_xyxy.T[2:, :, None] - 0.5
        ellipses = (low + high) / 2 + (high - low) / 2 * np.stack([np.cos(turn), np.sin(turn)])[:, None]
        hulls = self.from_pinhole(ellipses, size)
        return np.asarray(0.5 + np.concatenate([hulls.min(-1), hulls.max(-1)]).T)

    def _axis_px(self, points: Floats, size: Size) -> Floats:
        """The optical axis in a picture."""
        centre = ((self.width_px - 1) / 2, (self.height_px - 1) / 2)
        calibrated = (self.distortion.centre_px if self.distortion else ()) or centre
        off = [x - half for x, half in zip(calibrated, centre, strict=True)]
        scale = self.per_sensor_px(size)
        return column(((size[1] - 1) / 2 + off[0] * scale, (size[0] - 1) / 2 + off[1] * scale), points)

    def _pinhole_directions(self, points: Floats, size: Size) -> Floats:
        focal = column(self.focal_px, points) * self.per_sensor_px(size)
        return np.asarray((points - self._axis_px(points, size)) / focal)

    def _pinhole_points(self, rays: Floats, size: Size) -> Floats:
        from_axis_px = rays * column(self.focal_px, rays) * self.per_sensor_px(size)
        return np.asarray(self._axis_px(rays, size) + from_axis_px)


@lru_cache(maxsize=256)
def farthest_px(field: Field) -> float:
    """The largest displacement by distortion on the sensor. Raises ``ValueError`` unless it is one to one there.

    >>> barrel = Distortion("opencv", (-0.2, 0.0, 0.0, 0.0))
    >>> round(farthest_px(Field(640, 480, 60.0, distortion=barrel)), 1)
    65.8
    """
    (height, width), share = field.size, np.linspace(0.0, 1.0, _COARSE)
    points = np.stack(np.meshgrid(share * width - 0.5, share * height - 0.5))
    try:
        rays = field.to_pinhole(points, field.size)
    except ValueError as error:
        raise ValueError(f"lens.distortion: {error}") from None
    return float(np.hypot(*(rays - points)).max())


@lru_cache(maxsize=8)
def light(field: Field, size: Size) -> Floats:
    """Relative illumination (H, W) of a picture: the cosine's power, or the measured curve.

    >>> of_picture = light(Field(640, 480, 90.0, falloff_power=4.0), (480, 640))
    >>> of_picture[240, [320, 639]].round(2).tolist()  # cos^4 of 0 and of 45 degrees
    [1.0, 0.25]
    """
    curve = field.relative_illumination
    if curve is not None:
        per_unit = 1.0 if curve.unit == "relative" else 1 / (field.corner_px * field.pixel_pitch_um / 1e3)
        return np.interp(field.heights(size), np.multiply(curve.heights, per_unit), curve.values)
    x, y = field.directions(pixels(size), size)
    return np.asarray((1 + x * x + y * y) ** (-field.falloff_power / 2))


@lru_cache(maxsize=256)
def least_light(field: Field) -> float:
    """The least relative illumination in a picture of the sensor's size.

    >>> falloff = RelativeIllumination((0.0, 1.0), (1.0, 0.6))
    >>> round(least_light(Field(640, 480, 90.0, relative_illumination=falloff)), 2)
    0.6
    """
    height, width = field.size
    # Illumination is smooth: 256 samples along the shorter side find its least value.
    step = max(1, min(height, width) // 256)
    return float(light(field, (max(1, height // step), max(1, width // step))).min())


@lru_cache(maxsize=2)
def sources(field: Field, size: Size) -> Floats:
    """Points (2, H, W) of the pinhole's picture that the pixels show.

    >>> barrel = Distortion("opencv", (-0.2, 0.0, 0.0, 0.0))
    >>> x, y = sources(Field(640, 480, 60.0, distortion=barrel), (480, 640))
    >>> round(x[240, 639] - 639)  # the last column shows what a pinhole would have so many px further out
    27
    """
    return field.to_pinhole(pixels(size), size)


@lru_cache(maxsize=2)
def inside(field: Field, size: Size) -> Floats | None:
    """Share (H, W) of each pixel that lies in the pinhole's picture; None if all do entirely.

    >>> field = Field(640, 480, 60.0, distortion=Distortion("opencv", (0.2, 0.0, 0.0, 0.0)))
    >>> inside(field, (480, 640)) is None  # a pincushion enlarges: nothing from beyond the picture is seen
    True
    """
    x, y = sources(field, size)
    shares = np.ones(size)
    for positions, length in ((x, size[1]), (y, size[0])):
        shares *= np.clip(np.minimum(positions + 1, length - positions), 0, 1)
    return None if (shares == 1).all() else shares


@lru_cache(maxsize=4)
def larger(field: Field, share: float, size: Size) -> Floats:
    """Points (2, H, W) at which a picture is sampled to magnify it by 1 + ``share`` about the optical axis.

    >>> x, y = larger(Field(640, 480, 60.0), 0.01, (101, 101))
    >>> x[50, [50, 100]].round(2).tolist()  # the axis stays; 50 px from it, 50 / 1.01
    [50.0, 99.5]
    """
    points = pixels(size)
    axis = field._axis_px(points, size)
    return np.asarray(axis + (points - axis) / (1 + share))


def pixels(size: Size) -> Floats:
    """The pixels' centres (2, H, W).

    >>> pixels((1, 3)).tolist()
    [[[0.0, 1.0, 2.0]], [[0.0, 0.0, 0.0]]]
    """
    return np.stack(np.meshgrid(np.arange(float(size[1])), np.arange(float(size[0]))))
