"""Moments of a signal after each stage of the sensor: mean, variance over frames, variance of the fixed pattern.

Domain: tensors of any shape, of electrons (e-) or digital numbers (DN): EMVA 1288 release 4, linear model. The
stages and what each does stand in :data:`blurnoise.sensor.stages.STAGES`.
"""

from __future__ import annotations

import torch
from torch import Tensor

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
    """After rounding and before the limits: var_y = K^2 (read^2 + dark + photo) + 1/12 DN^2 (EMVA 1288 eq. 13)."""
    told = steps(mean_photo_e, camera, exposure_s=exposure_s, temperature_c=temperature_c)
    return told[stages.QUANTISATION.name]


def clipped(before: Moments, camera: Camera) -> Moments:
    """After the limits 0 and ``camera.clip_dn``, of a normal signal. DN."""
    one = torch.ones_like(before.mean)
    return stages.LIMITS.moments(before, OperatingPoint(camera, one, one, one))
