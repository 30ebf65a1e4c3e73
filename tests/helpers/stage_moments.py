"""Moments of a signal after each stage of the sensor: mean, variance over frames, variance of the fixed pattern.

An oracle in closed form, EMVA 1288 release 4, linear model, far from the limits; tensors of any shape, electrons or
digital numbers.
"""

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from blurnoise.sensor import stages


class Moments(NamedTuple):
    """In the unit of the step."""

    mean: Tensor
    variance: Tensor
    pattern_variance: Tensor

    def scaled(self, factor):
        return Moments(self.mean * factor, self.variance * factor**2, self.pattern_variance * factor**2)

    def added(self, mean=0.0, variance=0.0, pattern_variance=0.0):
        return Moments(self.mean + mean, self.variance + variance, self.pattern_variance + pattern_variance)


def after(stage, before, at):
    """What a stage of the table makes of moments under Conditions."""
    return _AFTER[stage.name](before, at)


def _shot_noise(before, at):
    points = np.array(at.camera.sensor.photon_transfer or [(0.0, 1.0)]).T
    factor = np.interp(before.mean.numpy() / at.camera.sensor.saturation_e, *points)
    return before.added(variance=torch.from_numpy(np.asarray(factor)) * before.mean)


def _shared(figure):
    """Of a pixel over frames, whoever shares it; those of the black level are given in DN."""

    def add(before, at):
        unit = at.camera.sensor.system_gain_dn_per_e if figure == "black_level_drift_dn" else 1.0
        return before.added(variance=(at.camera.figure(figure) / unit) ** 2)

    return add


def _gain(before, at):
    return before.scaled(at.camera.sensor.system_gain_dn_per_e).added(mean=at.camera.sensor.black_level_dn)


def _unchanged(before, at):
    return before


_AFTER = {
    stages.SPECTRAL_INTEGRATION.name: lambda before, at: before.scaled(at.white_e),
    stages.PRNU.name: lambda before, at: before.added(
        pattern_variance=(at.camera.sensor.prnu_total * before.mean) ** 2
    ),
    stages.DARK_CURRENT.name: lambda before, at: before.added(mean=at.dark_e),  # its variance is shot noise
    stages.PHOTON_TRANSFER.name: _unchanged,  # in the draw of shot noise
    stages.SHOT_NOISE.name: _shot_noise,
    stages.FULL_WELL.name: _unchanged,
    stages.READ_NOISE.name: lambda before, at: before.added(variance=at.camera.sensor.read_noise_e**2),
    **{stage.name: _shared(stage.figures[0]) for stage in stages.SHARED_NOISES},
    stages.DSNU.name: lambda before, at: before.added(pattern_variance=at.camera.sensor.dsnu_total_e**2),
    stages.GAIN.name: _gain,
    stages.QUANTISATION.name: lambda before, at: before.added(
        variance=1 / 12
    ),  # from 0.5 DN of noise before it
    stages.LIMITS.name: _unchanged,
}
