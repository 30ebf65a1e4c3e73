"""Auto-exposure: the exposure time and gain that a camera sets itself for a scene's light.

Domain: light on the scene in lux, mean light of the picture as a share of white (its luma, linear), seconds, dB. The
meter reads the mean frame, never a noisy one: mean (DN - black) / (full scale - black), without the clipping of
highlights. Motion and lens do not change it. Time comes first, up to its limits, then analogue gain, then digital.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, NamedTuple

from annotated_types import Ge, Gt, Le
from torch import Tensor

from blurnoise._core.checks import batch_shaped, in_range
from blurnoise._core.limits import limited
from blurnoise._core.validation import Figure, check_fields
from blurnoise.camera import Camera
from blurnoise.radiometry import colour_shares, dark_electrons, electrons_per_lux_s
from blurnoise.spectra import Curve

LUMA = (0.2126, 0.7152, 0.0722)
"""Weights of linear red, green and blue (ITU-R BT.709)."""
_STEP = 1e-9  # of a count of rows or periods: a time that is whole but for rounding stays whole


class Setting(NamedTuple):
    """What auto-exposure sets: s, dB, and the meter's reading with it; below the target where limits are reached."""

    exposure_s: float
    gain_db: float
    reading: float


@dataclass(frozen=True)
class AutoExposure:
    """How a camera meters and what it may set.

    target: of the meter's reading. frame_rate_hz, readout_s: the exposure is at most 1 / frame_rate_hz - readout_s;
    longest_s: and at most this. mains_hz: 50 or 60: whole periods of the light, 1 / (2 mains_hz), from one on;
    0: any. row_time_s: the exposure is whole rows; 0: any. gain_max_db: in place of the camera's own, if less.
    Raises ``TypeError`` or ``ValueError`` naming the field.
    """

    target: Annotated[Figure, Gt(0), Le(1)] = 0.18
    frame_rate_hz: Annotated[Figure, Gt(0), Le(1e6)] = 30.0
    readout_s: Annotated[Figure, Ge(0), Le(3600)] = 0.0
    longest_s: Annotated[Figure, Gt(0), Le(3600)] = 3600.0
    mains_hz: Figure = 0.0
    row_time_s: Annotated[Figure, Ge(0), Le(1)] = 0.0
    gain_max_db: Annotated[Figure, Ge(0), Le(120)] = 120.0

    def __post_init__(self) -> None:
        check_fields(self)
        if self.mains_hz not in (0.0, 50.0, 60.0):
            raise ValueError(f"mains_hz = {self.mains_hz!r}: must be 0, 50 or 60")
        if 1 / self.frame_rate_hz <= self.readout_s:
            raise ValueError(
                f"readout_s = {self.readout_s!r}: must be < 1 / frame_rate_hz, {1 / self.frame_rate_hz:g} s"
            )
        if self.row_time_s > self.limit_s:
            raise ValueError(
                f"row_time_s = {self.row_time_s!r}: must be <= the longest exposure, {self.limit_s:g} s"
            )

    @property
    def limit_s(self) -> float:
        """The longest exposure allowed, before periods and rows are counted."""
        return min(self.longest_s, 1 / self.frame_rate_hz - self.readout_s)

    def gain_db(
        self,
        camera: Camera,
        *,
        mean_light: float,
        illuminance_lux: float,
        exposure_s: float,
        temperature_c: float = 25.0,
        illuminant: str | Curve = "D55",
    ) -> float:
        """The gain for a given exposure, 0 dB to the largest: target / reading, for a picture of ``mean_light``.

        Raises ``ValueError`` naming the argument.
        """
        reading = limited("exposure_s", exposure_s) * _per_second(
            camera, mean_light, illuminance_lux, temperature_c, illuminant
        )
        most = min(self.gain_max_db, camera.gain_max_db)
        if reading <= self.target * 10 ** (-most / 20):
            return most
        return max(0.0, 20 * math.log10(self.target / reading))

    def setting(
        self,
        camera: Camera,
        *,
        mean_light: float,
        illuminance_lux: float,
        temperature_c: float = 25.0,
        illuminant: str | Curve = "D55",
    ) -> Setting:
        """Time first, then gain. Raises ``ValueError`` naming the argument."""
        rate = _per_second(camera, mean_light, illuminance_lux, temperature_c, illuminant)
        exposure_s = self.allowed_s(self.target / rate if rate > 0 else math.inf)
        gain_db = self.gain_db(
            camera,
            mean_light=mean_light,
            illuminance_lux=illuminance_lux,
            exposure_s=exposure_s,
            temperature_c=temperature_c,
            illuminant=illuminant,
        )
        return Setting(exposure_s, gain_db, rate * exposure_s * 10 ** (gain_db / 20))

    def allowed_s(self, wanted_s: float) -> float:
        """The longest allowed exposure that is not longer than ``wanted_s``, at least one row where rows count.

        Below one period of the mains' light the exposure is what it must be: the picture may flicker.
        """
        exposure_s = min(wanted_s, self.limit_s)
        period_s = 1 / (2 * self.mains_hz) if self.mains_hz else 0.0
        if period_s and exposure_s >= period_s * (1 - _STEP):
            exposure_s = math.floor(exposure_s / period_s + _STEP) * period_s
        if self.row_time_s:
            exposure_s = max(1, math.floor(exposure_s / self.row_time_s + _STEP)) * self.row_time_s
        return exposure_s


USUAL = AutoExposure()
"""18 % at 30 frames a second."""


def mean_luma(light: Tensor, camera: Camera | None = None, illuminant: str | Curve = "D55") -> Tensor:
    """Mean light of pictures (B, C, H, W) in linear light, (B,): by luma where there are three colours.

    Of a camera whose pictures are grey by what its pixels make of them.
    """
    means = batch_shaped("light", light).mean(dim=(-2, -1))
    if light.shape[1] != len(LUMA):
        return means.mean(dim=1)
    if camera is None or camera.cfa not in ("mono", "RCCC"):
        return means @ means.new_tensor(LUMA)
    return means @ means.new_tensor(colour_shares(camera, illuminant))


def _per_second(
    camera: Camera, mean_light: float, illuminance_lux: float, temperature_c: float, illuminant: str | Curve
) -> float:
    """The meter's reading for each second of exposure, at gain 0 dB."""
    light = in_range("mean_light", mean_light, 0.0, 1e6)
    lux = limited("illuminance_lux", illuminance_lux)
    electrons = light * lux * electrons_per_lux_s(camera, illuminant)
    electrons += dark_electrons(camera, 1.0, limited("temperature_c", temperature_c))
    return electrons * camera.system_gain_dn_per_e / (camera.full_scale_dn - camera.black_level_dn)
