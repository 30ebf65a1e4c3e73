"""The field of a camera: where each pixel of a picture stands in it, what light it gets, and from where.

Convention: x right, y down, px, (0, 0) the centre of the first pixel. A picture of another size than the sensor's
stands for the largest part of the sensor that has its shape, about the sensor's centre. NumPy, float64.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from blurnoise import distortion
from blurnoise.distortion import Floats
from blurnoise.lens import Lens

Size = tuple[int, int]
"""Of a picture, (H, W)."""
_COARSE = 33  # points along an axis on which a smooth field is looked at
_AROUND = 64  # points of an ellipse


@dataclass(frozen=True)
class Field:
    """A lens before a sensor of width_px by height_px, whose pinhole camera sees hfov_deg across."""

    lens: Lens
    width_px: int
    height_px: int
    hfov_deg: float
    pixel_pitch_um: float

    @property
    def size(self) -> Size:
        """Of the sensor."""
        return self.height_px, self.width_px

    @property
    def corner_px(self) -> float:
        """From the sensor's centre to its corner."""
        return math.hypot(self.width_px, self.height_px) / 2

    @property
    def focal_px(self) -> tuple[float, float]:
        """Focal lengths (x, y), px of the sensor."""
        if self.lens.focal_px:
            return self.lens.focal_px[0], self.lens.focal_px[1]
        focal = self.width_px / 2 / math.tan(math.radians(self.hfov_deg) / 2)
        return focal, focal

    def per_sensor_px(self, size: Size) -> float:
        """Pixels of a picture (H, W) per pixel of the sensor."""
        return max(size[0] / self.height_px, size[1] / self.width_px)

    def axis_px(self, size: Size) -> tuple[float, float]:
        """Where the optical axis meets a picture, (x, y)."""
        centre = ((self.width_px - 1) / 2, (self.height_px - 1) / 2)
        off = [own - half for own, half in zip(self.lens.centre_px or centre, centre, strict=True)]
        scale = self.per_sensor_px(size)
        return (size[1] - 1) / 2 + off[0] * scale, (size[0] - 1) / 2 + off[1] * scale

    def heights(self, size: Size) -> Floats:
        """Relative field heights (H, W): 0 on the axis, 1 at the corner of the sensor about its centre."""
        x, y = self._from_axis(*_pixels(size), size)
        return np.hypot(x, y) / (self.corner_px * self.per_sensor_px(size))

    def light(self, size: Size) -> Floats:
        """Relative illumination (H, W) of a picture: the cosine's power, or the measured curve."""
        curve = self.lens.relative_illumination
        if curve is not None:
            return curve.at(self.heights(size), self.corner_px * self.pixel_pitch_um / 1e3)
        x, y = self.directions(*_pixels(size), size)
        return np.asarray((1 + x * x + y * y) ** (-self.lens.falloff_power / 2))

    def sources(self, size: Size) -> tuple[Floats, Floats]:
        """Where the pinhole's picture has what each pixel sees, (x, y), (H, W) each."""
        return self._seen_at(*self.directions(*_pixels(size), size), size)

    def larger(self, share: float, size: Size) -> tuple[Floats, Floats]:
        """Where the picture has what each pixel sees in one that is larger by a share, (x, y), (H, W) each."""
        x, y = _pixels(size)
        axis_x, axis_y = self.axis_px(size)
        return axis_x + (x - axis_x) / (1 + share), axis_y + (y - axis_y) / (1 + share)

    def moved(self, x: Floats, y: Floats, size: Size) -> tuple[Floats, Floats]:
        """Where the lens images points of the pinhole's picture."""
        return self.imaged(*self._normalised(x, y, size), size) if self.lens.distortion else (x, y)

    def imaged(self, u: Floats, v: Floats, size: Size) -> tuple[Floats, Floats]:
        """Where the lens images directions (X/Z, Y/Z), px."""
        shape = self.lens.distortion
        if shape is not None:
            u, v = distortion.before_fold(shape.model, shape.coefficients, u, v)
            u, v = distortion.distorted(shape.model, shape.coefficients, u, v)
        return self._seen_at(u, v, size)

    def moved_boxes(self, boxes_xyxy: Floats, size: Size) -> Floats:
        """Boxes (N, 4) of the scene, between the pixels' edges, as the lens images them.

        Each bounds the image of the ellipse inscribed in its box: an object seldom fills the corners, which move
        most. Corners of a picture beyond where the lens images anything stay at its limit.
        """
        turn = np.arange(_AROUND) * (2 * np.pi / _AROUND)
        low, high = boxes_xyxy[:, None, :2] - 0.5, boxes_xyxy[:, None, 2:] - 0.5
        middle, half = (low + high) / 2, (high - low) / 2
        x, y = self.moved(
            middle[..., 0] + half[..., 0] * np.cos(turn), middle[..., 1] + half[..., 1] * np.sin(turn), size
        )
        return 0.5 + np.stack([x.min(1), y.min(1), x.max(1), y.max(1)], -1)

    def check(self) -> None:
        """Raise ``ValueError`` unless the distortion is one to one over the sensor."""
        try:
            self._displaced()
        except ValueError as error:
            raise ValueError(f"lens.distortion: {error}") from None

    def farthest_px(self) -> float:
        """The largest displacement by distortion in a picture of the sensor's size."""
        return _farthest_px(self)

    def least_light(self) -> float:
        """The least relative illumination in a picture of the sensor's size."""
        return _least_light(self)

    def _displaced(self) -> float:
        (height, width), share = self.size, np.linspace(0.0, 1.0, _COARSE)
        x, y = np.meshgrid(share * width - 0.5, share * height - 0.5)  # from edge to edge
        seen_x, seen_y = self._seen_at(*self.directions(x, y, self.size), self.size)
        return float(np.hypot(seen_x - x, seen_y - y).max())

    def _from_axis(self, x: Floats, y: Floats, size: Size) -> tuple[Floats, Floats]:
        axis_x, axis_y = self.axis_px(size)
        return x - axis_x, y - axis_y

    def _normalised(self, x: Floats, y: Floats, size: Size) -> tuple[Floats, Floats]:
        (x, y), scale = self._from_axis(x, y, size), self.per_sensor_px(size)
        return x / (self.focal_px[0] * scale), y / (self.focal_px[1] * scale)

    def directions(self, x: Floats, y: Floats, size: Size) -> tuple[Floats, Floats]:
        """The directions (X/Z, Y/Z) that pixels see."""
        u, v = self._normalised(x, y, size)
        if not self.lens.displaces or self.lens.distortion is None:
            return u, v
        return distortion.undistorted(self.lens.distortion.model, self.lens.distortion.coefficients, u, v)

    def _seen_at(self, u: Floats, v: Floats, size: Size) -> tuple[Floats, Floats]:
        """Where a pinhole images directions."""
        (axis_x, axis_y), scale = self.axis_px(size), self.per_sensor_px(size)
        return axis_x + u * self.focal_px[0] * scale, axis_y + v * self.focal_px[1] * scale


@lru_cache(maxsize=256)
def _farthest_px(field: Field) -> float:
    return field._displaced()


@lru_cache(maxsize=256)
def _least_light(field: Field) -> float:
    height, width = field.size
    step = max(1, min(height, width) // 256)
    return float(field.light((max(1, height // step), max(1, width // step))).min())


def _pixels(size: Size) -> tuple[Floats, Floats]:
    """The pixels' centres (x, y), (H, W) each."""
    across, down = np.meshgrid(np.arange(float(size[1])), np.arange(float(size[0])))
    return across, down
