"""Distortion by OpenCV's models: where a lens images the directions of a pinhole camera, and back.

Convention: normalised coordinates (x, y) = (X/Z, Y/Z), x right, y down; times the focal length they are px from
the centre. NumPy, float64. "opencv": k1, k2, p1, p2[, k3[, k4, k5, k6]] as ``cv2.projectPoints`` takes them;
"fisheye": k1 to k4 as ``cv2.fisheye.distortPoints`` does (Kannala & Brandt 2006).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from blurnoise._core.checks import limited, shown
from blurnoise._core.validation import check_fields

Floats = NDArray[np.float64]
_COUNTS = {"opencv": (4, 5, 8), "fisheye": (4,)}
_KNOTS = 1 << 14
_STEEPEST_RAD = np.pi / 2 - 1e-3  # a picture of a pinhole camera holds no more
_STEP = 1e-5


@dataclass(frozen=True)
class Distortion:
    """Distortion by one of the models.

    focal_px: (fx, fy) of the calibration, in px of the sensor, or () for the rectilinear lens of the camera's
    hfov_deg. centre_px: (cx, cy), or () for the centre of the sensor, ((width - 1) / 2, (height - 1) / 2).
    """

    model: Literal["opencv", "fisheye"]
    coefficients: tuple[float, ...]
    focal_px: tuple[float, ...] = ()
    centre_px: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        check_fields(self)
        for name, entry, counts in (
            ("coefficients", "coefficient", _COUNTS[self.model]),
            ("focal_px", None, (0, 2)),
            ("centre_px", None, (0, 2)),
        ):
            values = getattr(self, name)
            if len(values) not in counts:
                allowed = " or ".join(map(str, counts))
                raise ValueError(f"{name} = {shown(values)}: must be {allowed} numbers, got {len(values)}")
            for value in values:
                limited(name, value, entry)

    def distorted(self, x: Floats, y: Floats) -> tuple[Floats, Floats]:
        """Where the lens images the directions (x, y)."""
        squared = x * x + y * y
        if self.model == "fisheye":
            r = np.sqrt(squared)
            ratio = np.where(r > 1e-8, self._fisheye(np.arctan(r)) / np.maximum(r, 1e-8), 1.0)
            return x * ratio, y * ratio
        _, _, p1, p2 = self.coefficients[:4]
        ratio = self._rational(squared)
        cross = 2 * x * y
        return (
            x * ratio + p1 * cross + p2 * (squared + 2 * x * x),
            y * ratio + p1 * (squared + 2 * y * y) + p2 * cross,
        )

    def undistorted(self, x: Floats, y: Floats) -> tuple[Floats, Floats]:
        """The directions that the lens images to (x, y): from the radial part, then by Newton's method.

        Raises ``ValueError`` where there is none before the model folds back, or beyond 89.9 degrees from the axis.
        """
        wanted = np.hypot(x, y)
        r, seen = _branch(self)
        slack = 0.0
        if self.model == "opencv":
            slack = 3 * (abs(self.coefficients[2]) + abs(self.coefficients[3])) * min(float(r[-1]), 10.0) ** 2
        if float(wanted.max(initial=0.0)) > seen[-1] + slack:
            raise ValueError(
                f"images nothing beyond {seen[-1]:.4g} focal lengths from the centre, where it folds or ends; "
                f"the picture reaches {wanted.max():.4g}"
            )
        ratio = np.where(wanted > 1e-6, np.interp(wanted, seen, r) / np.maximum(wanted, 1e-6), 1.0)
        u, v = x * ratio, y * ratio
        for _ in range(3 if slack else 1):
            at = self.distorted(u, v)
            ux, uy = self._slopes((u + _STEP, v), (u - _STEP, v))
            vx, vy = self._slopes((u, v + _STEP), (u, v - _STEP))
            off_x, off_y = x - at[0], y - at[1]
            area = ux * vy - vx * uy
            area = np.where(np.abs(area) > 1e-9, area, np.inf)
            u, v = u + (off_x * vy - off_y * vx) / area, v + (off_y * ux - off_x * uy) / area
        at = self.distorted(u, v)
        miss = float(np.hypot(at[0] - x, at[1] - y).max(initial=0.0))
        if not miss < 1e-6:  # NaN included
            raise ValueError(f"cannot be inverted over the picture; misses by {miss:.2g} focal lengths")
        return u, v

    def before_fold(self, x: Floats, y: Floats) -> tuple[Floats, Floats]:
        """The directions (x, y), those beyond where the model folds back drawn in to there."""
        r, last = np.hypot(x, y), float(_branch(self)[0][-1])
        share = np.where(r > last, last / np.maximum(r, 1e-12), 1.0)
        return x * share, y * share

    def _slopes(self, ahead: tuple[Floats, Floats], behind: tuple[Floats, Floats]) -> list[Floats]:
        ends = zip(self.distorted(*ahead), self.distorted(*behind), strict=True)
        return [(after - before) / (2 * _STEP) for after, before in ends]

    def _fisheye(self, angle: Floats) -> Floats:
        t, (k1, k2, k3, k4) = angle * angle, self.coefficients
        return angle * (1 + t * (k1 + t * (k2 + t * (k3 + t * k4))))

    def _rational(self, squared: Floats) -> Floats:
        k1, k2, _, _, k3, k4, k5, k6 = (*self.coefficients, *[0.0] * (8 - len(self.coefficients)))
        above = 1 + squared * (k1 + squared * (k2 + squared * k3))
        return above / (1 + squared * (k4 + squared * (k5 + squared * k6)))


@lru_cache(maxsize=16)
def _branch(lens: Distortion) -> tuple[Floats, Floats]:
    """Radii from 0 to where the radial part stops growing, and where the lens images them."""
    angle = np.linspace(0.0, _STEEPEST_RAD, _KNOTS)
    r = np.tan(angle)
    with np.errstate(all="ignore"):
        seen = lens._fisheye(angle) if lens.model == "fisheye" else r * lens._rational(r * r)
    grows = np.isfinite(seen[1:]) & (np.diff(seen) > 0)
    last = len(r) if grows.all() else int(np.argmin(grows)) + 1
    return r[:last], seen[:last]
