"""The lens over its field: defocus, colour and light that change from the centre of the picture to its corner.

Units: field height 1 is the corner of the sensor, half its diagonal from the centre; angles are those of a pinhole
camera of the same focal length. Figures that are 0 or None leave their effect out.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Le

from blurnoise import distortion
from blurnoise._core.checks import in_range, shown
from blurnoise._core.limits import limited, within
from blurnoise._core.validation import Figure, check_fields
from blurnoise.distortion import Floats
from blurnoise.transfer import Measured

_Share = Annotated[Figure, Ge(0), Le(1)]
_LEFT = 0.05  # of modulation at the end of a curve that ends before the pixels do


@dataclass(frozen=True)
class Mtf:
    """A measured, radial MTF of the lens without the pixel: modulation, 0 to 1, at frequencies, linear between.

    frequencies: increasing, from 0, where it is 1 whether stated or not; unit: "cycles/px" or "lp/mm". Beyond the
    last frequency its value holds. Raises ``TypeError`` or ``ValueError``.
    """

    frequencies: tuple[float, ...]
    values: tuple[_Share, ...]
    unit: Literal["cycles/px", "lp/mm"]

    def __post_init__(self) -> None:
        check_fields(self)
        _check_positions("frequencies", self.frequencies, self.values)
        if self.frequencies[0] == 0 and abs(self.values[0] - 1) > 1e-3:
            raise ValueError(f"values: must be 1 at frequency 0, got {self.values[0]:g}")

    def per_px(self, pixel_pitch_um: float) -> Measured:
        """As a transfer function of cycles/px. Raises ``ValueError`` where it ends before the pixels' limit."""
        per_unit = 1.0 if self.unit == "cycles/px" else pixel_pitch_um / 1e3
        frequencies = tuple(each * per_unit for each in self.frequencies)
        if frequencies[-1] < 0.5 and self.values[-1] > _LEFT:
            raise ValueError(
                f"lens.mtf: frequencies: must reach 0.5 cycles/px ({0.5 / per_unit:g} {self.unit}) or a value "
                f"of {_LEFT:g}, end at {self.frequencies[-1]:g} {self.unit} with {self.values[-1]:g}"
            )
        first = () if frequencies[0] == 0 else (0.0,)
        return Measured((*first, *frequencies), (1.0, *self.values[1 - len(first) :]))


@dataclass(frozen=True)
class RelativeIllumination:
    """Light over the field, 0 to 1 of the brightest, at field heights, linear between, held beyond them.

    heights: increasing; unit: "relative", 1 at the sensor's corner, or "mm" on the sensor.
    """

    heights: tuple[float, ...]
    values: tuple[_Share, ...]
    unit: Literal["relative", "mm"] = "relative"

    def __post_init__(self) -> None:
        check_fields(self)
        _check_positions("heights", self.heights, self.values)

    def at(self, height: Floats, corner_mm: float) -> Floats:
        """The light at relative field heights of a sensor whose corner is ``corner_mm`` from its centre."""
        per_unit = 1.0 if self.unit == "relative" else 1 / corner_mm
        return np.interp(height, np.multiply(self.heights, per_unit), self.values)


@dataclass(frozen=True)
class Distortion:
    """Distortion by one of OpenCV's models; see :mod:`blurnoise.distortion`.

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
            ("coefficients", "coefficient", distortion.COUNTS[self.model]),
            ("focal_px", None, (0, 2)),
            ("centre_px", None, (0, 2)),
        ):
            values = getattr(self, name)
            if len(values) not in counts:
                allowed = " or ".join(map(str, counts))
                raise ValueError(f"{name} = {shown(values)}: must be {allowed} numbers, got {len(values)}")
            for value in values:
                limited(name, value, entry)


@dataclass(frozen=True)
class Lens:
    """How a lens changes over its field.

    field_curvature_px: added to the camera's defocus_radius_px times the square of the field height, either sign;
    the radius is what remains without its sign. lateral_red, lateral_blue: by how much larger than green's, as a
    share, the picture of these colours is: 0.0005 is half a pixel at 1000 px from the centre.
    falloff_power: of the field angle's cosine, natural vignetting; the law's is 4. relative_illumination: a
    measured curve in its place. distortion: by OpenCV's models. mtf: measured, in place of the camera's
    defocus_radius_px and diffraction. Raises ``TypeError`` or ``ValueError`` naming the figure.
    """

    field_curvature_px: Annotated[Figure, within("field_curvature_px")] = 0.0
    lateral_red: Annotated[Figure, within("lateral_red")] = 0.0
    lateral_blue: Annotated[Figure, within("lateral_blue")] = 0.0
    falloff_power: Annotated[Figure, within("falloff_power")] = 0.0
    relative_illumination: RelativeIllumination | None = None
    distortion: Distortion | None = None
    mtf: Mtf | None = None

    def __post_init__(self) -> None:
        check_fields(self)
        if self.falloff_power and self.relative_illumination:
            raise ValueError(
                f"falloff_power = {self.falloff_power:g}: must be 0 beside relative_illumination, which holds it"
            )

    @property
    def displaces(self) -> bool:
        """Whether it moves what is in the picture; the colours' own displacements apart."""
        shape = self.distortion
        return shape is not None and (shape.model == "fisheye" or any(shape.coefficients))

    @property
    def focal_px(self) -> tuple[float, ...]:
        """(fx, fy) that the distortion's calibration states, px of the sensor; or ()."""
        return self.distortion.focal_px if self.distortion else ()

    @property
    def centre_px(self) -> tuple[float, ...]:
        """(cx, cy) of the same."""
        return self.distortion.centre_px if self.distortion else ()


SAME_EVERYWHERE = Lens()
"""A lens that adds nothing to the camera's figures."""


def _check_positions(name: str, positions: tuple[float, ...], values: tuple[float, ...]) -> None:
    if len(positions) != len(values) or len(positions) < 2:
        raise ValueError(
            f"{name}, values: must be as many, at least 2, got {len(positions)} and {len(values)}"
        )
    if positions[0] < 0 or any(after <= before for before, after in pairwise(positions)):
        raise ValueError(f"{name} = {shown(positions)}: must be >= 0 and increase")
    in_range(f"{name}: the last", positions[-1], 0.0, 1e6, above=True)
