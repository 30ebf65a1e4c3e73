"""Distortion of a lens: where a point of the rectilinear picture is in the real one, and back.

NumPy, float64; x right, y down.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated, Literal

import numpy as np

from blurnoise._core.checks import shown
from blurnoise._core.fields import Figure, check_fields, within
from blurnoise.camera.spectra import Floats

_COUNTS = {"opencv": (4, 5, 8), "fisheye": (4,)}
# Field angles at which the radial part is tabulated, for the start of its inverse.
_KNOTS = 1 << 14
_STEEPEST_RAD = np.pi / 2 - 1e-3  # a picture of a pinhole camera holds no more
# Of a central difference: its own error, a sixth of the square, and rounding's, 1e-16 / 1e-5, are alike, 1e-11.
_STEP = 1e-5


@dataclass(frozen=True)
class Distortion:
    """Distortion by OpenCV's models: where a lens images the directions of a pinhole camera, and back.

    Directions are (x, y) = (X/Z, Y/Z), arrays (2, ...); times the focal length they are px from the centre. "opencv":
    k1, k2, p1, p2[, k3[, k4, k5, k6]] as ``cv2.projectPoints`` takes them; "fisheye": k1 to k4 as
    ``cv2.fisheye.distortPoints`` does (Kannala & Brandt 2006).

    focal_px: (fx, fy) of the calibration, in px of the sensor, or () for the rectilinear lens of the camera's
    hfov_deg. centre_px: (cx, cy), or () for the centre of the sensor, ((width - 1) / 2, (height - 1) / 2).

    >>> barrel = Distortion("opencv", (-0.2, 0.0, 0.0, 0.0))
    >>> barrel.distorted(np.array([[0.5], [0.0]])).ravel()
    array([0.475, 0.   ])
    """

    model: Literal["opencv", "fisheye"]
    coefficients: tuple[Annotated[Figure, within("coefficient")], ...]
    focal_px: tuple[Annotated[Figure, within("focal_px")], ...] = ()
    centre_px: tuple[Annotated[Figure, within("centre_px")], ...] = ()

    def __post_init__(self) -> None:
        check_fields(self)
        counts = {"coefficients": _COUNTS[self.model], "focal_px": (0, 2), "centre_px": (0, 2)}
        for name, allowed in counts.items():
            if len(values := getattr(self, name)) not in allowed:
                must = " or ".join(map(str, allowed))
                raise ValueError(f"{name} = {shown(values)}: must be {must} numbers, got {len(values)}")

    @property
    def displaces(self) -> bool:
        """Whether a direction is imaged elsewhere than by a pinhole."""
        return self.model == "fisheye" or any(self.coefficients)

    def distorted(self, rays: Floats) -> Floats:
        """Image of directions through the lens."""
        x, y = rays
        squared = x * x + y * y
        if self.model == "fisheye":
            r = np.sqrt(squared)
            ratio = np.where(r > 1e-8, self._fisheye(np.arctan(r)) / np.maximum(r, 1e-8), 1.0)
            return np.asarray(rays * ratio)
        p1, p2 = self.coefficients[2:4]
        ratio, cross = self._rational(squared), 2 * x * y
        along = x * ratio + p1 * cross + p2 * (squared + 2 * x * x)
        return np.stack([along, y * ratio + p1 * (squared + 2 * y * y) + p2 * cross])

    def undistorted(self, image: Floats) -> Floats:
        """Invert the distortion: Newton's method, which starts from the inverse of the radial part.

        Raises ``ValueError`` for images beyond the model's fold, or beyond 89.9 degrees from the axis.
        """
        wanted = np.hypot(*image)
        r, reached = _branch(self)
        slack = 0.0
        if self.model == "opencv":
            # Tangential distortion moves the fold a little, by at most 3 p r^2.
            slack = 3 * (abs(self.coefficients[2]) + abs(self.coefficients[3])) * min(float(r[-1]), 10.0) ** 2
        if float(wanted.max(initial=0.0)) > reached[-1] + slack:
            ends = f"{reached[-1]:.4g} focal lengths from the centre, where it folds or ends"
            raise ValueError(f"images nothing beyond {ends}; the picture reaches {wanted.max():.4g}")
        rays = image * np.where(wanted > 1e-6, np.interp(wanted, reached, r) / np.maximum(wanted, 1e-6), 1.0)
        for _ in range(3 if slack else 1):
            off_x, off_y = image - self.distorted(rays)
            (ux, uy), (vx, vy) = self._slopes(rays, _STEP, 0.0), self._slopes(rays, 0.0, _STEP)
            area = ux * vy - vx * uy
            # Where the slope vanishes, at the fold, Newton's step would lead away: none is made.
            area = np.where(np.abs(area) > 1e-9, area, np.inf)
            rays = rays + np.stack([off_x * vy - off_y * vx, off_y * ux - off_x * uy]) / area
        miss = float(np.hypot(*(self.distorted(rays) - image)).max(initial=0.0))
        if not miss < 1e-6:  # NaN included
            raise ValueError(f"cannot be inverted over the picture; misses by {miss:.2g} focal lengths")
        return rays

    def before_fold(self, rays: Floats) -> Floats:
        """Directions, with those beyond the model's fold moved in to the fold."""
        r, last = np.hypot(*rays), float(_branch(self)[0][-1])
        return np.asarray(rays * np.where(r > last, last / np.maximum(r, 1e-12), 1.0))

    def _slopes(self, rays: Floats, dx: float, dy: float) -> Floats:
        step = column((dx, dy), rays)
        return (self.distorted(rays + step) - self.distorted(rays - step)) / (2 * _STEP)

    def _fisheye(self, angle: Floats) -> Floats:
        t, (k1, k2, k3, k4) = angle * angle, self.coefficients
        return angle * (1 + t * (k1 + t * (k2 + t * (k3 + t * k4))))

    def _rational(self, squared: Floats) -> Floats:
        k1, k2, _, _, k3, k4, k5, k6 = (*self.coefficients, *[0.0] * (8 - len(self.coefficients)))
        above = 1 + squared * (k1 + squared * (k2 + squared * k3))
        return above / (1 + squared * (k4 + squared * (k5 + squared * k6)))


@lru_cache(maxsize=16)
def _branch(lens: Distortion) -> tuple[Floats, Floats]:
    """Radii from 0 to the fold, where the radial part stops growing, and their images."""
    # Even in angle, not in radius: a tangent's steps would crowd the far field or starve the axis.
    angle = np.linspace(0.0, _STEEPEST_RAD, _KNOTS)
    r = np.tan(angle)
    with np.errstate(all="ignore"):
        reached = lens._fisheye(angle) if lens.model == "fisheye" else r * lens._rational(r * r)
    grows = np.isfinite(reached[1:]) & (np.diff(reached) > 0)
    last = len(r) if grows.all() else int(np.argmin(grows)) + 1
    return r[:last], reached[:last]


def column(values: Sequence[float], points: Floats) -> Floats:
    """Two numbers, x and y, in the shape that points (2, ...) are multiplied by.

    >>> column((2.0, 3.0), np.zeros((2, 4, 5))).shape
    (2, 1, 1)
    """
    return np.reshape(values, (2, *[1] * (points.ndim - 1)))
