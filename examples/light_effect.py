"""A light effect of one's own in twenty lines: veiling glare, a share of the light spread over all of the picture.

For good it is a file in blurnoise/light/ and an entry of the table in blurnoise/light/effects.py.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from blurnoise import Camera, Exposure, develop, plan, simulate
from blurnoise.light import effects
from blurnoise.light.effect import LightEffect


@dataclass(frozen=True)
class VeilingGlare(LightEffect):
    """A share of all light reaches no place of its own: ISO 18844's glare of a picture of even light."""

    name = "veiling glare"
    share: float = 0.05

    def bound(self, at: object) -> float:
        """White and black change by at most this."""
        return self.share

    def apply(self, light: Tensor, at: object, border: object) -> Tensor:
        """Flux is kept: what is taken everywhere is given everywhere."""
        return light + self.share * (light.mean((-2, -1), keepdim=True) - light)


camera, picture = Camera.preset("imx250"), torch.zeros(1, 3, 120, 160)
picture[..., :60, :] = 1.0  # a bright sky over a black road
conditions = {"exposure_s": 0.01, "illuminance_lux": 150.0}
before = develop(simulate(picture, camera, **conditions, generator=[1]), camera)
effects.EFFECTS += (VeilingGlare(),)
after = develop(simulate(picture, camera, **conditions, generator=[1]), camera)

print(f"black road, 0 to 1: {before[..., 80:, :].mean():.3f}, with glare {after[..., 80:, :].mean():.3f}")
budget = {part.name: part.contribution_dn for part in plan(Exposure(camera, **conditions)).stages}
print(f"in the error budget: {budget['veiling glare']:.0f} DN at most")
