"""Moments of a signal after each stage of the sensor: mean, variance over frames, variance of the fixed pattern.

An oracle in closed form, EMVA 1288 release 4, linear model; tensors of any shape, electrons or digital numbers.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from blurnoise import Camera
from blurnoise._core.checks import LIMITS
from blurnoise.light.conditions import Conditions
from blurnoise.sensor import stages
from blurnoise.sensor.stage import SensorStage

Point = Conditions[Tensor]


class Cut(NamedTuple):
    """What the full well took: enough to tell what limits further on still find to clip.

    headroom: of the well over the mean before it. uncut_variance: over frames, before it. lost: by which the mean
    fell. left_variance: over frames, after it.
    """

    headroom: Tensor
    uncut_variance: Tensor
    lost: Tensor
    left_variance: Tensor

    def scaled(self, factor: float | Tensor) -> Cut:
        squared = factor * factor
        return Cut(
            self.headroom * factor,
            self.uncut_variance * squared,
            self.lost * factor,
            self.left_variance * squared,
        )


class Moments(NamedTuple):
    """Mean, variance over frames, and variance over pixels of the fixed pattern, in the unit of the step.

    cut: after the full well, what it did.
    """

    mean: Tensor
    variance: Tensor
    pattern_variance: Tensor
    cut: Cut | None = None

    def scaled(self, factor: float | Tensor) -> Moments:
        squared = factor * factor
        cut = self.cut.scaled(factor) if self.cut else None
        return Moments(self.mean * factor, self.variance * squared, self.pattern_variance * squared, cut)


def steps(
    mean_photo_e: Tensor, camera: Camera, *, exposure_s: Tensor, temperature_c: Tensor
) -> dict[str, Moments]:
    """Moments after every stage, by its name, of pixels with these mean photo-electrons."""
    nothing = torch.zeros_like(mean_photo_e)
    at = Conditions(camera, exposure_s, temperature_c, white_e=torch.ones_like(mean_photo_e))
    told, moments = {}, Moments(mean_photo_e, nothing, nothing)
    for stage in stages.STAGES:
        moments = told[stage.name] = after(stage, moments, at)
    return told


def frame(mean_photo_e: Tensor, camera: Camera, *, exposure_s: Tensor, temperature_c: Tensor) -> Moments:
    """After rounding, without any limit: var_y = K^2 (read^2 + dark + photo) + 1/12 DN^2 (EMVA 1288 eq. 13)."""
    unlimited = replace(camera, full_well_e=LIMITS["full_well_e"].high)
    told = steps(mean_photo_e, unlimited, exposure_s=exposure_s, temperature_c=temperature_c)
    return told[stages.QUANTISATION.name]._replace(cut=None)


def after(stage: SensorStage, before: Moments, at: Point) -> Moments:
    """What a stage of the table makes of moments."""
    return _AFTER[stage.name](before, at)


def _scaled_to_electrons(before: Moments, at: Point) -> Moments:
    return before.scaled(at.white_e)


def _prnu(before: Moments, at: Point) -> Moments:
    return before._replace(
        pattern_variance=before.pattern_variance + (at.camera.prnu_total * before.mean) ** 2
    )


def _dark_current(before: Moments, at: Point) -> Moments:
    """The mean; its variance comes with shot noise."""
    return before._replace(mean=before.mean + at.dark_e)


def _shot_noise(before: Moments, at: Point) -> Moments:
    points = np.array(at.camera.photon_transfer or [(0.0, 1.0)]).T
    factor = np.interp(before.mean.numpy() / at.camera.saturation_e, *points)
    return before._replace(variance=before.variance + torch.from_numpy(np.asarray(factor)) * before.mean)


def _full_well(before: Moments, at: Point) -> Moments:
    """Of the censored normal; a fixed pattern keeps the share that is not clipped."""
    if math.isinf(at.camera.well_limit_e):
        return before
    well_e = torch.full_like(before.mean, at.camera.well_limit_e)
    mean, variance, inside = censored(
        before.mean, before.variance, torch.full_like(well_e, -math.inf), well_e
    )
    cut = Cut(well_e - before.mean, before.variance, before.mean - mean, variance)
    return Moments(mean, variance, before.pattern_variance * inside**2, cut)


def _read_noise(before: Moments, at: Point) -> Moments:
    return before._replace(variance=before.variance + at.camera.read_noise_e**2)


def _shared(figure: str, before: Moments, at: Point) -> Moments:
    """Of a pixel over frames, whoever shares it; those of the black level are given in DN."""
    unit = at.camera.system_gain_dn_per_e if figure == "black_level_drift_dn" else 1.0
    return before._replace(variance=before.variance + (getattr(at.camera, figure) / unit) ** 2)


def _unchanged(before: Moments, at: Point) -> Moments:
    return before


def _dsnu(before: Moments, at: Point) -> Moments:
    return before._replace(pattern_variance=before.pattern_variance + at.camera.dsnu_total_e**2)


def _gain(before: Moments, at: Point) -> Moments:
    scaled = before.scaled(at.camera.system_gain_dn_per_e)
    return scaled._replace(mean=scaled.mean + at.camera.black_level_dn)


def _quantisation(before: Moments, at: Point) -> Moments:
    """1/12 DN^2, which holds from about 0.5 DN of noise before it."""
    return before._replace(variance=before.variance + 1 / 12)


def _limits(before: Moments, at: Point) -> Moments:
    """Of what the full well left of a normal, plus normal noise, censored again; right to a rounding step.

    With charge X, well W and later noise R the number is min(X, W) + R within [0, C]. For each value r of R
    that is X censored to [-r, min(W, C - r)], plus r: closed-form moments, averaged over r by the trapezoid
    rule. A fixed pattern keeps the share that is not clipped.
    """
    low, high = torch.zeros_like(before.mean), torch.full_like(before.mean, at.camera.full_scale_dn)
    if before.cut is None:
        mean, variance, inside = censored(before.mean, before.variance, low, high)
        return Moments(mean, variance, before.pattern_variance * inside**2)
    cut = before.cut
    uncut = before.mean + cut.lost
    well = uncut + cut.headroom
    later = torch.sqrt((before.variance - cut.left_variance).clamp_min(0.0))
    z = torch.linspace(-8, 8, 257, dtype=later.dtype, device=later.device)
    weight = torch.exp(-z * z / 2)
    first, second, inside = (torch.zeros_like(uncut) for _ in range(3))
    for each, share in zip(z, weight / weight.sum(), strict=True):
        r = later * each
        top = torch.minimum(well, high - r).maximum(low - r)
        mean, variance, kept = censored(uncut, cut.uncut_variance, low - r, top)
        first, second = first + share * (mean + r), second + share * (variance + (mean + r) ** 2)
        inside = inside + share * torch.where(well + r <= high, 1.0, kept)  # the well's share is out already
    return Moments(first, (second - first**2).clamp_min(0.0), before.pattern_variance * inside**2)


_AFTER: dict[str, Callable[[Moments, Point], Moments]] = {
    stages.SPECTRAL_INTEGRATION.name: _scaled_to_electrons,
    stages.PRNU.name: _prnu,
    stages.DARK_CURRENT.name: _dark_current,
    stages.PHOTON_TRANSFER.name: _unchanged,  # in the draw of shot noise
    stages.SHOT_NOISE.name: _shot_noise,
    stages.FULL_WELL.name: _full_well,
    stages.READ_NOISE.name: _read_noise,
    **{stage.name: partial(_shared, stage.figures[0]) for stage in stages.SHARED_NOISES},
    stages.DSNU.name: _dsnu,
    stages.GAIN.name: _gain,
    stages.QUANTISATION.name: _quantisation,
    stages.LIMITS.name: _limits,
}


def censored(mean: Tensor, variance: Tensor, low: Tensor, high: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Mean and variance of a normal whose values beyond low and high count as these, and the share between them.

    With a = (low - mean) / s and b = (high - mean) / s; a variance of 0 is that of a constant.
    """
    spread = torch.sqrt(variance).clamp_min(1e-12)
    a, b = (low - mean) / spread, (high - mean) / spread
    below, above = torch.special.ndtr(a), torch.special.ndtr(-b)
    inside = 1 - below - above
    at_a, at_b = (torch.exp(-edge * edge / 2) / math.sqrt(2 * math.pi) for edge in (a, b))
    # Moments about the mean: differences of squares of a large one would be short of digits.
    a, b = a.clamp(-40, 40), b.clamp(-40, 40)
    below_, above_ = (torch.where(share > 0, share * edge, 0.0) for share, edge in ((below, a), (above, b)))
    first = at_a - at_b + below_ + above_  # E[z censored]
    second = inside + a * at_a - b * at_b + below_ * a + above_ * b  # E[z^2 censored]
    far = torch.maximum(low, torch.minimum(mean, high))  # where no digit of z is left
    cut = torch.where((a > 39) | (b < -39), far, mean + spread * first)
    left = torch.where((a > 39) | (b < -39), 0.0, spread**2 * (second - first**2).clamp_min(0.0))
    return cut, left, inside.clamp_min(0.0)
