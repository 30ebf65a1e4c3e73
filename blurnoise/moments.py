"""Moments of a signal after each stage of the sensor: mean, variance over frames, variance of the fixed pattern.

Domain: tensors of any shape, of electrons (e-) or digital numbers (DN): EMVA 1288 release 4, linear model. The
stages and what each does stand in :data:`blurnoise.sensor.stages.STAGES`.
"""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from blurnoise._core.limits import LIMITS
from blurnoise.camera import Camera
from blurnoise.operating_point import OperatingPoint
from blurnoise.sensor import stages
from blurnoise.sensor.stage import Moments

__all__ = ["Moments", "clipped", "frame", "steps"]


def steps(
    mean_photo_e: Tensor, camera: Camera, *, exposure_s: Tensor, temperature_c: Tensor
) -> dict[str, Moments]:
    """Moments after every stage, by its name, of pixels with these mean photo-electrons."""
    nothing = torch.zeros_like(mean_photo_e)
    at = OperatingPoint(camera, exposure_s, temperature_c, white_e=torch.ones_like(mean_photo_e))
    told, moments = {}, Moments(mean_photo_e, nothing, nothing)
    for stage in stages.STAGES:
        moments = told[stage.name] = stage.moments(moments, at)
    return told


def frame(mean_photo_e: Tensor, camera: Camera, *, exposure_s: Tensor, temperature_c: Tensor) -> Moments:
    """After rounding, without any limit: var_y = K^2 (read^2 + dark + photo) + 1/12 DN^2 (EMVA 1288 eq. 13)."""
    unlimited = replace(camera, full_well_e=LIMITS["full_well_e"].high)
    told = steps(mean_photo_e, unlimited, exposure_s=exposure_s, temperature_c=temperature_c)
    return told[stages.QUANTISATION.name]._replace(cut=None)


def clipped(before: Moments, camera: Camera) -> Moments:
    """What full well and converter leave of a :func:`frame`, DN; charge is taken as normal.

    The well clips charge alone: read noise and rounding, K^2 read^2 + 1/12 of the variance, come after it.
    """
    gain, one = camera.system_gain_dn_per_e, torch.ones_like(before.mean)
    later = (gain * camera.read_noise_e) ** 2 + 1 / 12
    point = OperatingPoint(camera, one, one, one)
    charge = Moments(
        (before.mean - camera.black_level_dn) / gain,
        (before.variance - later).clamp_min(0.0) / gain**2,
        before.pattern_variance / gain**2,
    )
    held = stages.GAIN.moments(stages.FULL_WELL.moments(charge, point), point)
    return stages.LIMITS.moments(held._replace(variance=held.variance + later), point)
