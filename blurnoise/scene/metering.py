"""Metering: the 18 % grey reference of a picture, and the exposure and gain that a camera sets for its light."""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np
import torch
from annotated_types import Ge, Gt, Le
from torch import Tensor

from blurnoise._core.checks import batch_shaped, in_range, limited, shown
from blurnoise._core.fields import Figure, check_fields
from blurnoise._core.luminance import LUMINANCE
from blurnoise.camera import Camera, gain
from blurnoise.camera.captures import Capture, longest_first_s
from blurnoise.camera.radiometry import colour_shares, dark_electrons, electrons_per_lux_s
from blurnoise.camera.spectra import Curve

# Of photographers' grey cards, half-way between black and white to the eye (L* = 49.5).
GREY = 0.18
_ALLOWED = "must be mean, pNN (a percentile above 0, up to 100) or x0,y0,x1,y1 (px, x1 and y1 not included)"


@dataclass(frozen=True)
class GreyAnchor:
    """A percentile of the luminance, or the mean over a region (x0, y0, x1, y1), px; without both, the mean.

    >>> GreyAnchor.parse("p50").percentile
    50.0
    """

    percentile: float | None = None
    region_px: tuple[int, int, int, int] | None = None

    @classmethod
    def parse(cls, text: str) -> GreyAnchor:
        """Parse "mean", "pNN" or "x0,y0,x1,y1". Raises ``ValueError``."""
        word = text.strip().lower() if isinstance(text, str) else ""
        if word == "mean":
            return cls()
        with suppress(ValueError):
            if word.startswith("p") and 0 < (percentile := float(word[1:])) <= 100:
                return cls(percentile=percentile)
            x0, y0, x1, y1 = (int(part) for part in word.split(","))
            if 0 <= x0 < x1 and 0 <= y0 < y1:
                return cls(region_px=(x0, y0, x1, y1))
        raise ValueError(f"grey_anchor = {shown(text)}: {_ALLOWED}")

    def __str__(self) -> str:
        """The text that :meth:`parse` reads."""
        if self.region_px is not None:
            return ",".join(map(str, self.region_px))
        return "mean" if self.percentile is None else f"p{self.percentile:g}"

    def scale(self, picture: Tensor) -> float:
        """Factor that brings the anchor of a picture (C, H, W) to 0.18.

        Raises ``ValueError`` if the region lies outside the picture or the anchor is black.
        """
        channels, height, width = picture.shape
        values = picture.detach().cpu().numpy().astype(float)
        if self.region_px is not None:
            x0, y0, x1, y1 = self.region_px
            if x1 > width or y1 > height:
                raise ValueError(f"grey_anchor = {self}: lies outside the picture of {width} x {height} px")
            values = values[:, y0:y1, x0:x1]
        weights = LUMINANCE if channels == 3 else (1 / channels,) * channels
        light = np.tensordot(np.array(weights), values, 1)
        grey = float(light.mean() if self.percentile is None else np.percentile(light, self.percentile))
        if grey <= 0 or not math.isfinite(GREY / grey):
            raise ValueError(f"grey_anchor = {self}: is black in this picture; must be brighter than black")
        return GREY / grey


def anchored(light: Tensor, grey_anchor: str | None) -> Tensor:
    """Pictures (B, C, H, W), each scaled so that its ``grey_anchor`` is 18 % reflectance; None: unchanged.

    >>> dark = torch.full((1, 1, 4, 6), 0.09)
    >>> round(float(anchored(dark, "mean").mean()), 2)  # twice as bright: 18 % grey
    0.18
    """
    if grey_anchor is None:
        return light
    anchor = GreyAnchor.parse(grey_anchor)
    return torch.stack([picture * anchor.scale(picture) for picture in light])


_STEP = 1e-9  # of a count of rows or periods: a time that is whole but for rounding stays whole


class Setting(NamedTuple):
    """Exposure, s, gain, dB, and meter reading of an auto-exposure; the reading is below the target at the limits.

    >>> setting = AutoExposure(longest_s=0.01, gain_max_db=0.0).setting(
    ...     Camera.preset("imx250"), mean_light=0.18, illuminance_lux=1.0
    ... )
    >>> setting.exposure_s, setting.gain_db, setting.reading < 0.18  # too dark for these limits
    (0.01, 0.0, True)
    """

    exposure_s: float
    gain_db: float
    reading: float


@dataclass(frozen=True)
class AutoExposure:
    """Automatic exposure and gain: the target of the meter and the limits of the settings.

    target: meter reading to reach. frame_rate_hz, readout_s: limit the exposure to 1 / frame_rate_hz - readout_s; for
    a camera with several captures, their sum. longest_s: limits it further. mains_hz: 50 or 60 allow, above one
    period of the light, only whole periods 1 / (2 mains_hz); 0 allows any exposure. row_time_s: allows only whole
    rows; 0 allows any exposure. gain_max_db: limits the gain in addition to the camera's own limit. Raises
    ``TypeError`` or ``ValueError`` naming the field.

    >>> setting = AutoExposure().setting(Camera.preset("imx250"), mean_light=0.18, illuminance_lux=20.0)
    >>> round(setting.exposure_s, 4), round(setting.gain_db, 1)
    (0.0333, 7.3)
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
        if (frame_s := 1 / self.frame_rate_hz) <= self.readout_s:
            raise ValueError(f"readout_s = {self.readout_s!r}: must be < 1 / frame_rate_hz, {frame_s:g} s")
        if self.row_time_s > self.limit_s:
            raise ValueError(f"row_time_s = {self.row_time_s!r}: must be <= limit_s, {self.limit_s:g} s")

    @property
    def limit_s(self) -> float:
        """The longest exposure allowed, before periods and rows are counted."""
        return min(self.longest_s, 1 / self.frame_rate_hz - self.readout_s)

    def setting(
        self,
        camera: Camera,
        *,
        mean_light: float,
        illuminance_lux: float,
        exposure_s: float | None = None,
        temperature_c: float = 25.0,
        illuminant: str | Curve = "D55",
    ) -> Setting:
        """The setting for a picture of ``mean_light``: the longest useful exposure or exposure_s, then gain.

        The gain is 0 dB or more. Raises ``ValueError`` naming the argument.
        """
        light = in_range("mean_light", mean_light, 0.0, 1e6) * limited("illuminance_lux", illuminance_lux)
        first = (
            camera.sensor.captures[0] if camera.sensor.captures else Capture()
        )  # by which a picture of several is metered
        electrons = light * electrons_per_lux_s(camera, illuminant) * first.sensitivity
        electrons += dark_electrons(camera, 1.0, limited("temperature_c", temperature_c))
        rate = (
            electrons
            * camera.sensor.system_gain_dn_per_e
            / (camera.sensor.full_scale_dn - camera.sensor.black_level_dn)
        )
        rate *= brightness(camera, first.gain_db) if first.gain_db else 1.0
        if exposure_s is None:
            longest_s = longest_first_s(camera.sensor.captures, self.limit_s)
            exposure_s = self.allowed_s(min(longest_s, self.target / rate if rate > 0 else math.inf))
        exposure_s, gain_db = (
            limited("exposure_s", exposure_s),
            min(self.gain_max_db, camera.sensor.gain_max_db),
        )
        # With the largest gain the picture would be too bright: the target takes less.
        if (reading := exposure_s * rate) * brightness(camera, gain_db) > self.target:
            gain_db = _gain_db(camera, max(1.0, self.target / reading), gain_db)
        return Setting(exposure_s, gain_db, reading * brightness(camera, gain_db))

    def allowed_s(self, wanted_s: float) -> float:
        """The longest allowed exposure up to ``wanted_s``, at least one row if ``row_time_s`` is set.

        Exposures below one period of the mains' light are allowed: such pictures may flicker.

        >>> AutoExposure(mains_hz=50.0).allowed_s(0.025)
        0.02
        """
        exposure_s = min(wanted_s, self.limit_s)
        # Lamps on the mains flicker twice a period: once for each half-wave.
        period_s = 1 / (2 * self.mains_hz) if self.mains_hz else 0.0
        if period_s and exposure_s >= period_s * (1 - _STEP):
            exposure_s = math.floor(exposure_s / period_s + _STEP) * period_s
        if self.row_time_s:
            exposure_s = max(1, math.floor(exposure_s / self.row_time_s + _STEP)) * self.row_time_s
        return exposure_s


def brightness(camera: Camera, gain_db: float) -> float:
    """Factor by which a gain brightens the signal, as a share of the converter's range above black.

    >>> round(brightness(Camera.preset("imx250"), 20.0), 6)
    10.0
    """
    if not camera.sensor.gains:
        return float(10 ** (gain_db / 20))
    at_0_db, analogue_db = camera.sensor.at_0_db, min(gain_db, camera.sensor.analogue_gain_max_db)
    at_gain = gain.measured(at_0_db, camera.sensor.gains, analogue_db)
    ranges = [camera.sensor.full_scale_dn - row.black_level_dn for row in (at_0_db, at_gain)]
    more = at_gain.system_gain_dn_per_e / at_0_db.system_gain_dn_per_e * ranges[0] / ranges[1]
    return float(more * 10 ** ((gain_db - analogue_db) / 20))


def _gain_db(camera: Camera, factor: float, most_db: float) -> float:
    """The gain up to ``most_db`` whose :func:`brightness` is ``factor``, 1 or more; measured gains by bisection."""
    if not camera.sensor.gains:
        return 20 * math.log10(factor)
    from scipy.optimize import bisect

    return float(bisect(lambda gain_db: brightness(camera, gain_db) - factor, 0.0, most_db))


USUAL = AutoExposure()
"""18 % at 30 frames a second."""


def mean_luma(light: Tensor, camera: Camera | None = None, illuminant: str | Curve = "D55") -> Tensor:
    """Mean light (B,) of pictures (B, C, H, W) in linear light; the luma of three colours.

    With a camera whose pictures are grey, the colours are weighted as its pixels weight them.

    >>> red = torch.zeros(1, 3, 4, 6)
    >>> red[:, 0] = 1.0
    >>> mean_luma(red).round(decimals=2)
    tensor([0.2100])
    """
    channels = batch_shaped("light", light).shape[1]
    weights = LUMINANCE if channels == 3 else (1 / channels,) * channels
    if channels == 3 and camera is not None and camera.sensor.cfa in ("mono", "RCCC"):
        weights = colour_shares(camera, illuminant)
    by = light.new_tensor(weights)  # picture by picture: sums over a batch have other bits
    return torch.cat([picture.mean(dim=(-2, -1)) @ by for picture in torch.split(light, 1)])
