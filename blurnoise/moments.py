"""What each step of the sensor does to the mean and the variance of a signal: EMVA 1288 release 4, linear model.

Domain: means and variances over frames, tensors of any shape, of electrons (e-) or digital numbers (DN). The
steps follow each other as in :func:`~blurnoise.sensor.readout.read_out`; :func:`frame` is all, without clipping,
and :func:`clipped` what clipping makes of it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor

from blurnoise.camera import Camera
from blurnoise.sensor.readout import dark_electrons


class Moments(NamedTuple):
    """Mean, and variance over frames, in the unit of the step and its square."""

    mean: Tensor
    variance: Tensor


def shot(mean_photo_e: Tensor) -> Moments:
    """Photo-electrons: Poisson, the variance is the mean. e-."""
    return Moments(mean_photo_e, mean_photo_e)


def dark(before: Moments, camera: Camera, *, exposure_s: Tensor, temperature_c: Tensor) -> Moments:
    """Dark charge adds mu_I T to mean and variance. e-."""
    charge = dark_electrons(camera, exposure_s, temperature_c)
    return Moments(before.mean + charge, before.variance + charge)


def read(before: Moments, camera: Camera) -> Moments:
    """Read noise adds its square to the variance. e-."""
    return Moments(before.mean, before.variance + camera.read_noise_e**2)


def pattern(before: Moments, camera: Camera, mean_photo_e: Tensor) -> Moments:
    """Over pixels instead of frames, PRNU and DSNU add their squares. e-."""
    spread = (camera.prnu * mean_photo_e) ** 2 + camera.dsnu_e**2
    return Moments(before.mean, before.variance + spread)


def digital(before: Moments, camera: Camera) -> Moments:
    """Gain and black level, and 1/12 DN^2 of rounding, which holds from about 0.5 DN of noise before it. DN."""
    gain = camera.system_gain_dn_per_e
    return Moments(gain * before.mean + camera.black_level_dn, gain**2 * before.variance + 1 / 12)


def frame(mean_photo_e: Tensor, camera: Camera, *, exposure_s: Tensor, temperature_c: Tensor) -> Moments:
    """Every temporal step, unclipped: var_y = K^2 (read^2 + dark + photo) + 1/12, in DN (EMVA 1288 eq. 13)."""
    in_dark = dark(shot(mean_photo_e), camera, exposure_s=exposure_s, temperature_c=temperature_c)
    return digital(read(in_dark, camera), camera)


def clipped(before: Moments, camera: Camera) -> Moments:
    """A normal signal with these moments after the limits 0 and ``camera.clip_dn``. DN.

    With a = (low - mean) / s and b = (high - mean) / s, the mean and variance of the censored normal. Right to
    a rounding step as far as the signal is normal.
    """
    mean, spread = before.mean, torch.sqrt(before.variance)
    low, high = (-mean / spread, (camera.clip_dn - mean) / spread)
    below, above = torch.special.ndtr(low), torch.special.ndtr(-high)
    inside = 1 - below - above
    at_low, at_high = (torch.exp(-edge * edge / 2) / math.sqrt(2 * math.pi) for edge in (low, high))
    first = at_low - at_high  # E[z; inside]
    low_at, high_at = (torch.where(torch.isfinite(e), e, 0.0).clamp(-40, 40) for e in (low, high))
    second = inside + low_at * at_low - high_at * at_high  # E[z^2; inside]
    clipped_mean = inside * mean + spread * first + above * camera.clip_dn
    squares = (
        inside * mean**2 + 2 * mean * spread * first + before.variance * second + above * camera.clip_dn**2
    )
    return Moments(clipped_mean, (squares - clipped_mean**2).clamp_min(0.0))
