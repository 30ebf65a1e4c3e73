"""Sheeting: how much of the light of a lamp a retroreflective surface returns towards a camera beside that lamp.

Domain: the coefficient of retroreflection R_A, cd/(lx m2), is the luminance of the surface for each lux that the lamp
sends to it. It falls steeply with the observation angle, degrees, between lamp and camera as the surface sees them;
ISO 20471, EN 12899-1 and ASTM D4956 define both. The values are the least that new white material may have, 5 degrees
or less off its normal. At an entrance angle of 30 degrees it keeps about half of them, which is not modelled.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from types import MappingProxyType
from typing import Annotated

import numpy as np
from annotated_types import Gt, Le
from numpy.typing import ArrayLike

from blurnoise._core.checks import real_tensor, shown
from blurnoise._core.fields import Figure, check_fields
from blurnoise.camera.spectra import Floats


@dataclass(frozen=True)
class Sheeting:
    """Coefficients of retroreflection, cd/(lx m2), of white material at observation angles that increase, degrees.

    Raises ``TypeError`` or ``ValueError`` naming the field and what is allowed.

    >>> Sheeting("own", (0.2, 0.5, 2.0), (150.0, 60.0, 4.0)).at([0.1, 0.5, 4.0]).round(3).tolist()
    [150.0, 60.0, 1.0]
    """

    name: str
    angles_deg: tuple[Annotated[Figure, Gt(0), Le(180)], ...]
    values: tuple[Annotated[Figure, Gt(0), Le(1e6)], ...]

    def __post_init__(self) -> None:
        check_fields(self)
        if len(self.angles_deg) < 2 or any(one >= other for one, other in pairwise(self.angles_deg)):
            raise ValueError(f"angles_deg = {shown(self.angles_deg)}: must be two or more that increase")
        if len(self.values) != len(self.angles_deg):
            must = f"must be {len(self.angles_deg)}, one for each angle"
            raise ValueError(f"values = {shown(self.values)}: {must}")

    def at(self, alpha_deg: ArrayLike) -> Floats:
        """Coefficients at observation angles >= 0 of any shape.

        Log-log between the angles of the table, as the values span two decades; held below the first one, where
        standards have no value, and falling with the square of the angle beyond the last one.
        """
        alpha = numbers("alpha_deg", alpha_deg, 0.0, 180.0)
        first, last = self.angles_deg[0], self.angles_deg[-1]
        within = np.clip(alpha, first, last)
        inside = np.exp(np.interp(np.log(within), np.log(self.angles_deg), np.log(self.values)))
        return np.asarray(inside * (last / np.maximum(alpha, last)) ** 2)


_ANGLES_DEG = (0.2, 0.5, 2.0)

SHEETINGS: Mapping[str, Sheeting] = MappingProxyType(
    {
        name: Sheeting(name, _ANGLES_DEG, values)
        for name, values in {
            # ASTM D4956-01, at -4 degrees of entrance (angelfire.com/trek/cityton/american.htm). At 2 degrees, beyond
            # that standard, as EN 12899-1 classes RA1 and RA2 are remembered: assumed.
            "I": (70.0, 30.0, 5.0),
            "III": (250.0, 95.0, 5.0),
            "XI": (580.0, 420.0, 20.0),  # assumed: prismatic sheeting, found in no source that could be read
            # ISO 20471 and ANSI/ISEA 107: 330 at 12 minutes (chinareflective.com); the rest falls as III does.
            "vest": (330.0, 125.0, 6.6),
            # The least white that a stop sign may keep, MUTCD table 2A-3, as remembered: assumed. Falls as III does.
            "worn": (35.0, 13.0, 0.7),
        }.items()
    }
)
"""By name: types of ASTM D4956 for signs and plates, the bands of vests, the least that a stop sign may return.

At a third of a degree DIN 67520 asks 60 of class RA1 and 180 of RA2 (baustellenabsicherung24.de), where types I and
III have 44 and 146 here: standards for the same material differ by a quarter.
"""


def numbers(name: str, value: ArrayLike, low: float, high: float) -> Floats:
    """Real numbers of any shape within [low, high], in double precision. Raises ``TypeError`` or ``ValueError``.

    >>> numbers("alpha_deg", [0.2, 2], 0.0, 180.0)
    array([0.2, 2. ])
    """
    array = real_tensor(name, value).detach().cpu().double().numpy()
    if not bool(((array >= low) & (array <= high)).all()):
        raise ValueError(f"{name}: values must be finite and lie within [{low:g}, {high:g}]")
    return array
