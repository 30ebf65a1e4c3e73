"""An exposure: everything that one frame is taken with."""

from __future__ import annotations

from dataclasses import dataclass

from blurnoise.camera import Camera


@dataclass(frozen=True)
class Exposure:
    """What one frame is taken with: camera, s, lux, px/s (x right, y down), degC, dB, and its noise's seed.

    gain_db: digital, after the converter. seed: of the noise, see :mod:`blurnoise._core.rng`.
    """

    camera: Camera
    exposure_s: float
    illuminance_lux: float
    velocity_px_s: tuple[float, float] = (0.0, 0.0)
    temperature_c: float = 25.0
    gain_db: float = 0.0
    seed: int = 0
