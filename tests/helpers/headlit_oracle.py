"""An independent reckoning of signs and people in headlamps, number by number, without code of the package.

Scenes are stated in metres; a pinhole images them. Angles are taken by the law of cosines, coefficients of
retroreflection by a power law from one tabulated angle to the next.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

TYPE_III = ((0.2, 250.0), (0.5, 95.0), (2.0, 5.0))
"""White, ASTM D4956 and EN 12899-1: observation angle, degrees, and cd/(lx m2)."""


@dataclass(frozen=True)
class StatedScene:
    """A flat target of width_m x height_m whose lower edge is base_m above the road, seen by a pinhole."""

    right_m: float
    ahead_m: float
    base_m: float
    width_m: float
    height_m: float
    focal_px: float
    size: tuple[int, int]
    camera_height_m: float = 1.5

    @property
    def box(self) -> tuple[float, float, float, float]:
        """Where the pinhole images it, px from the picture's corner."""
        x = [self.right_m + side * self.width_m / 2 for side in (-1, 1)]
        y = [self.camera_height_m - self.base_m - up for up in (self.height_m, 0.0)]
        scale = self.focal_px / self.ahead_m
        left, right = (self.size[1] / 2 + scale * each for each in x)
        top, bottom = (self.size[0] / 2 + scale * each for each in y)
        return left, top, right, bottom

    def lit(self, up_m: float, high: bool, table=TYPE_III) -> tuple[float, float]:
        """(lux on the target, cd/m2 that its white returns to the camera) at a height above the road."""
        lux = returned = 0.0
        for lamp_m in (-0.6, 0.6):
            x, y, z = self.right_m - lamp_m, up_m - 0.65, self.ahead_m
            away = math.sqrt(x * x + y * y + z * z)
            h, v = math.degrees(math.atan(x / z)), math.degrees(math.asin(y / away))
            e = _candela(h, v, high) / away**2
            camera = math.sqrt(self.right_m**2 + (up_m - self.camera_height_m) ** 2 + z * z)
            apart = math.sqrt(lamp_m**2 + (self.camera_height_m - 0.65) ** 2)
            cosine = (away**2 + camera**2 - apart**2) / (2 * away * camera)
            lux += e
            returned += e * _returned(math.degrees(math.acos(cosine)), table)
        return lux, returned


def _candela(h: float, v: float, high: bool) -> float:
    """The published model of a low beam, and the two humps that a high beam adds."""
    edge = -0.57 if h < 0 else min(0.1, -0.57 + 0.2679492 * h)
    below = edge - v
    share = 1 / (1 + math.exp(-below / 0.12)) if below > -60 else 0.0
    under = below if below > 0 else 0.0
    found = share * 18000 * math.exp(-0.5 * ((h - 1.5) / 4.5) ** 2) * math.exp(-under / 4)
    found += share * 3000 * math.exp(-0.5 * (h / 14) ** 2) * math.exp(-under / 5)
    found += 510 * math.exp(-0.5 * (h / 20) ** 2) / (1 + (v if v > 0 else 0.0))
    if high:
        found += 40000 * math.exp(-0.5 * (h / 3) ** 2) * math.exp(-0.5 * (v / 1.5) ** 2)
        found += 3000 * math.exp(-0.5 * (h / 12) ** 2) * math.exp(-0.5 * (v / 3) ** 2)
    return found


def _returned(alpha_deg: float, table) -> float:
    if alpha_deg <= table[0][0]:
        return table[0][1]
    for (low, first), (high, last) in pairwise(table):
        if alpha_deg <= high:
            power = math.log(last / first) / math.log(high / low)
            return first * (alpha_deg / low) ** power
    return table[-1][1] * (table[-1][0] / alpha_deg) ** 2
