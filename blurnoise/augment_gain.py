"""Gains of training pictures, dB: stated, or what auto-exposure sets for a picture's light, or both in one batch."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from blurnoise._core.checks import Numbers
from blurnoise._core.limits import limited, limited_per_image
from blurnoise.optics.camera import Camera
from blurnoise.optics.colour import Encoding
from blurnoise.scene.metering import AutoExposure, mean_luma
from blurnoise.scene.scene import scene_reflectance

Gains = Numbers | AutoExposure | Sequence[float | AutoExposure]
"""A number or one per picture; auto-exposure, or either for each picture."""


def gains_db(
    gain_db: Gains,
    scene: Tensor,
    cameras: Sequence[Camera],
    *,
    exposure_s: Tensor,
    illuminance_lux: Tensor,
    temperature_c: Tensor,
    encoding: Encoding,
) -> list[float]:
    """The gain of each picture of ``scene`` (B, C, H, W), before one of the ``cameras`` or each before its own.

    Raises ``TypeError`` or ``ValueError`` naming the gain.
    """
    batch = len(scene)
    of_each = [gain_db] if isinstance(gain_db, AutoExposure) else gain_db
    if not isinstance(of_each, Sequence) or not any(isinstance(each, AutoExposure) for each in of_each):
        stated: Numbers = of_each  # type: ignore[assignment]
        return limited_per_image("gain_db", stated, batch, scene).tolist()
    if len(of_each) not in (1, batch):
        raise ValueError(f"gain_db: got {len(of_each)}; must be one, or {batch}, one for each picture")
    with torch.no_grad():
        light = scene_reflectance(scene, encoding)
        by_camera = {each: mean_luma(light, each).tolist() for each in {*cameras}}
    found = []
    for item, (exposure, lux, celsius) in enumerate(
        zip(exposure_s.tolist(), illuminance_lux.tolist(), temperature_c.tolist(), strict=True)
    ):
        own, camera = of_each[item % len(of_each)], cameras[item % len(cameras)]
        if isinstance(own, AutoExposure):
            own = own.gain_db(
                camera,
                mean_light=by_camera[camera][item],
                illuminance_lux=lux,
                exposure_s=exposure,
                temperature_c=celsius,
            )
        found.append(limited("gain_db", own))
    return found
