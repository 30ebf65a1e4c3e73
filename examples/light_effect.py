"""A light effect of one's own in twenty lines: the double image of a windscreen, which reflects light twice inside.

For good it is a file in blurnoise/light/ and an entry of the table in blurnoise/light/effects.py.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from blurnoise import Camera, Exposure, develop, plan, simulate
from blurnoise.light import effects
from blurnoise.light.effect import LightEffect


@dataclass(frozen=True)
class DoubleImage(LightEffect):
    """A share of the light comes so many rows lower: the two surfaces of the glass are not parallel."""

    name = "double image"
    share: float = 0.0086  # 9.3 % at each of two reflections: glass of index 1.52, 60 degrees off its normal
    rows: int = 12

    def bound(self, at: object) -> float:
        """White and black change by at most this."""
        return self.share

    def apply(self, light: Tensor, at: object, border: object) -> Tensor:
        """What leaves at the bottom comes in at the top, since nothing is known of what is above."""
        return light + self.share * (light.roll(self.rows, -2) - light)


camera, picture = Camera.preset("imx250"), torch.zeros(1, 3, 120, 160)
picture[..., 40:48, 60:80] = 1.0  # a white sign on a black wall
conditions = {"exposure_s": 0.01, "illuminance_lux": 150.0}
before = develop(simulate(picture, camera, **conditions, generator=[1]), camera)
effects.EFFECTS += (DoubleImage(),)
after = develop(simulate(picture, camera, **conditions, generator=[1]), camera)

lower = (..., slice(52, 60), slice(60, 80))
print(f"below the sign, 0 to 1: {before[lower].mean():.3f}, with the double image {after[lower].mean():.3f}")
budget = {part.name: part.contribution_dn for part in plan(Exposure(camera, **conditions)).stages}
print(f"in the error budget: {budget['double image']:.0f} DN at most")
