"""MTF50 of the chain: the frequency at which lens and uniform motion together leave half of a contrast.

Unit: cycles/px, up to 0.5, where sampling ends. The pixel's own aperture is not among the causes: a picture that is
simulated has been through one already.
"""

from __future__ import annotations

import math

import torch

from blurnoise.optics import transfer
from blurnoise.optics.transfer import Optics

NYQUIST = 0.5
_PLACES = 4097


def mtf50(optics: Optics, displacement_px: tuple[float, float] = (0.0, 0.0), angle_deg: float = 0.0) -> float:
    """The lowest frequency along ``angle_deg`` (from x to the right towards y down) at which |OTF| falls below 0.5;
    infinite where it does not up to 0.5 cycles/px. Of motion alone 0.603355 / its length along that direction."""
    f = torch.linspace(0.0, NYQUIST, _PLACES, dtype=torch.float64)
    x, y = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
    moved = torch.tensor(displacement_px, dtype=torch.float64)
    response = optics.response(f * x, f * y) * transfer.motion((f * x)[None], (f * y)[None], moved)[0]
    below = (response.abs() < 0.5).nonzero()
    if not len(below):
        return math.inf
    place = int(below[0])
    high, low = float(response[place - 1].abs()), float(response[place].abs())
    return float(f[place - 1]) + float(f[1]) * (high - 0.5) / (high - low)
