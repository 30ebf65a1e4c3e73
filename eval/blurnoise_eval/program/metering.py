"""Metering: the gain that a run's camera sets at a light and an exposure, by the mean light of the run's pictures.

Domain: lux, seconds, dB. The rule is that of :mod:`blurnoise.scene.metering`, which set each picture's gain in the
run by that picture's own mean light; a program is for the mean of them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from blurnoise.optics.camera import Camera
from blurnoise.scene.metering import USUAL, AutoExposure

_UNHURRIED = AutoExposure(USUAL.target, frame_rate_hz=1 / 3600)
_TOLD_DB = 0.01  # from a limit of the gain: then it tells of the picture's light


@dataclass(frozen=True)
class Metering:
    """The rule for one camera and pictures of one ``mean_light``, a share of white."""

    camera: Camera
    mean_light: float
    temperature_c: float = 25.0

    def total_s(self, illuminance_lux: float) -> float:
        """Exposure times gain that the meter asks for: the exposure that needs no gain; an hour at most."""
        set_so = _UNHURRIED.setting(
            self.camera,
            mean_light=self.mean_light,
            illuminance_lux=illuminance_lux,
            temperature_c=self.temperature_c,
        )
        return set_so.exposure_s

    def gain_db(self, illuminance_lux: float, exposure_s: float) -> float:
        """As the camera sets it, from 0 dB to its most."""
        return USUAL.setting(
            self.camera,
            mean_light=self.mean_light,
            illuminance_lux=illuminance_lux,
            exposure_s=exposure_s,
            temperature_c=self.temperature_c,
        ).gain_db

    def lacks_gain(self, illuminance_lux: float, exposure_s: float) -> bool:
        """Whether the picture is darker than the meter asks for, at the camera's most gain."""
        factor = 10 ** (self.camera.gain_max_db / 20)
        return self.total_s(illuminance_lux) > factor * exposure_s * (1 + 1e-9)


def mean_light(gains: Iterable[Mapping[str, Any]], camera: Camera) -> float | None:
    """Mean over pictures of their mean light, as their gains tell it; None where none of them does.

    gains: rows of ``image``, ``illuminance_lux``, ``exposure_s`` and ``applied_gain_db``, set by the camera for each
    picture. A gain at either of its limits tells nothing. Dark charge counts for none.
    """
    white = Metering(camera, 1.0).total_s(1.0)  # lux s
    of: dict[str, list[float]] = {}
    for row in gains:
        gain_db = row["applied_gain_db"]
        if _TOLD_DB < gain_db < camera.gain_max_db - _TOLD_DB:
            total = row["illuminance_lux"] * row["exposure_s"] * 10 ** (gain_db / 20)
            of.setdefault(row["image"], []).append(math.log(white / total))
    return float(np.mean([math.exp(float(np.median(logs))) for logs in of.values()])) if of else None
