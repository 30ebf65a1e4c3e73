"""What an exposure measures before any picture is taken: motion, and the sharpness that lens and motion leave.

Units: px during the exposure, cycles/px. Sizes of pictures are (H, W).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import torch

from blurnoise.light.conditions import middle_of
from blurnoise.optics import transfer
from blurnoise.optics.transfer import Optics
from blurnoise.scene.exposure import Exposure

_FREQUENCIES = 4097


class Motion(NamedTuple):
    """Motion of the picture during an exposure, px; varies: by how much that of some pixels differs from it."""

    x: float
    y: float
    varies: float = 0.0

    @property
    def blur_px(self) -> float:
        """Its length."""
        return math.hypot(self.x, self.y)

    @property
    def angle_deg(self) -> float:
        """Its direction, from x to the right towards y down."""
        return math.degrees(math.atan2(self.y, self.x))


def motion_px(exposure: Exposure, size: tuple[int, int]) -> Motion:
    """Motion by the velocity, or, of a camera that drives, in the middle of what its pixels see."""
    if exposure.drives:
        flow = exposure.vehicle.flow_px_s(exposure.camera, size, exposure.ego_speed_m_s)
        ((x, y),), (varies,) = (each.tolist() for each in middle_of(flow[None] * exposure.exposure_s))
        return Motion(x, y, varies)
    x, y = exposure.velocity_px_s
    return Motion(x * exposure.exposure_s, y * exposure.exposure_s)


def mtf50(optics: Optics, displacement_px: tuple[float, float] = (0.0, 0.0), angle_deg: float = 0.0) -> float:
    """MTF50 of lens and uniform motion, cycles/px: the lowest frequency along ``angle_deg`` (from x to the right
    towards y down) at which |OTF| falls below 0.5; infinite where it does not up to 0.5 cycles/px, where sampling
    ends. Of motion alone 0.603355 / its length along that direction.

    The pixel's own aperture is not part of it: a picture that is simulated has been through one already.
    """
    f = torch.linspace(0.0, 0.5, _FREQUENCIES, dtype=torch.float64)
    x, y = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
    moved = torch.tensor(displacement_px, dtype=torch.float64)
    response = optics.response(f * x, f * y) * transfer.motion((f * x)[None], (f * y)[None], moved)[0]
    below = (response.abs() < 0.5).nonzero()
    if not len(below):
        return math.inf
    place = int(below[0])
    high, low = float(response[place - 1].abs()), float(response[place].abs())
    return float(f[place - 1]) + float(f[1]) * (high - 0.5) / (high - low)
