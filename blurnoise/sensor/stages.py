"""The sensor's stages, one table in causal order: the linear model of EMVA 1288 release 4.

``STAGES`` is read wherever a frame is read out, planned or explained: a new entry is all that a new stage needs.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache

import torch
from torch import Tensor

from blurnoise._core import rng
from blurnoise.light.conditions import Conditions
from blurnoise.optics.camera import Camera
from blurnoise.optics.colour import FilterCurves, marked
from blurnoise.optics.radiometry import electrons_per_lux_s
from blurnoise.optics.spectra import Curve, Spectrum
from blurnoise.sensor.stage import MERGE_READ_NOISE_E, Frames, SensorStage, signal_bound_e, within_range_dn


class SpectralIntegration(SensorStage):
    """Light to mean photo-electrons; none below 0 (ringing of a blur). Its bound is of a flat spectral curve."""

    name = "spectral integration"
    essential = True

    def apply(self, signal: Tensor, at: Frames) -> Tensor:
        return (signal * at.white_e).clamp(min=0.0)

    def bound_dn(self, at: Conditions[float]) -> float:
        return within_range_dn(at.camera, _flat_curve_error(at.camera, at.illuminant) * at.white_e)

    def how(self, camera: Camera, noisy: bool) -> str:
        mark = marked(camera.quantum_efficiency)
        return "once per camera and light" + (f"; its curve {mark}" if mark else "")


class Prnu(SensorStage):
    """Photo-response non-uniformity: a fixed factor per pixel."""

    name = "PRNU"
    modelled = "fixed field of factors"
    figures = ("prnu",)
    spreads = True

    def apply(self, signal: Tensor, at: Frames) -> Tensor:
        return signal if at.gain is None else (signal * at.gain).clamp(min=0.0)

    def bound_dn(self, at: Conditions[float]) -> float:
        return within_range_dn(at.camera, at.camera.prnu * signal_bound_e(at))


class DarkCurrent(SensorStage):
    """Dark charge mu_I T, part of what shot noise is drawn from."""

    name = "dark current"
    modelled = "in the mean that shot noise is drawn from"
    figures = ("dark_current_e_s",)
    spreads = True

    def apply(self, signal: Tensor, at: Frames) -> Tensor:
        return signal + at.dark_e

    def bound_dn(self, at: Conditions[float]) -> float:
        return within_range_dn(at.camera, math.hypot(at.dark_e, math.sqrt(at.dark_e)))


class ShotNoise(SensorStage):
    """Poisson noise of photo-electrons and dark charge; under the law "merged" read noise is in the same draw.

    But for pixels whose charge may reach the full well (:func:`nearly_full_e`), which clips before read noise comes.
    """

    name = "shot noise"
    draws = True

    def apply(self, signal: Tensor, at: Frames) -> Tensor:
        if at.law == "exact":
            return rng.poisson(signal, at.seeds)
        if at.normal is None:
            return signal
        if at.law == "merged":
            drawn = noisy_electrons(signal, at.camera.read_noise_e, at.normal)
            full = signal >= nearly_full_e(at.camera)
            if at.read is None or not bool(full.any()):
                return drawn
            charge = noisy_electrons(signal, 0.0, at.normal).clamp(0.0, at.camera.well_limit_e)
            return torch.where(full, charge + at.camera.read_noise_e * at.read, drawn)
        if at.law == "apart":
            return noisy_electrons(signal, 0.0, at.normal).clamp(min=0.0)
        return rng.poisson_of_normal(signal, at.normal)

    def bound_dn(self, at: Conditions[float]) -> float:
        return within_range_dn(at.camera, math.sqrt(signal_bound_e(at) + at.dark_e))

    def how(self, camera: Camera, noisy: bool) -> str:
        if camera.read_noise_e >= MERGE_READ_NOISE_E:
            return "one corrected normal draw, with read noise"
        return "Poisson counts of one normal value per pixel: inversion below 10 e-, corrected normal above"


class FullWell(SensorStage):
    """The full well, where it ends below the converter's range: charge beyond it is lost. Later noises stay."""

    name = "full well"
    essential = True

    def apply(self, signal: Tensor, at: Frames) -> Tensor:
        return signal if at.law == "merged" else signal.clamp(max=at.camera.well_limit_e)


class ReadNoise(SensorStage):
    """Normal noise of the read-out, where the draw of shot noise does not hold it already."""

    name = "read noise"
    draws = True
    figures = ("read_noise_e",)

    def apply(self, signal: Tensor, at: Frames) -> Tensor:
        if at.read is None or at.law == "merged":
            return signal
        return signal + at.camera.read_noise_e * at.read

    def bound_dn(self, at: Conditions[float]) -> float:
        return within_range_dn(at.camera, at.camera.read_noise_e)

    def dither_dn(self, at: Conditions[float]) -> float:
        return at.camera.system_gain_dn_per_e * at.camera.read_noise_e

    def how(self, camera: Camera, noisy: bool) -> str:
        merged = camera.read_noise_e >= MERGE_READ_NOISE_E and noisy
        return "in the draw of shot noise" if merged else "a normal draw of its own"


class Dsnu(SensorStage):
    """Dark-signal non-uniformity: a fixed offset per pixel."""

    name = "DSNU"
    modelled = "fixed field of offsets"
    figures = ("dsnu_e",)
    spreads = True

    def apply(self, signal: Tensor, at: Frames) -> Tensor:
        return signal if at.offset_e is None else signal + at.offset_e

    def bound_dn(self, at: Conditions[float]) -> float:
        return within_range_dn(at.camera, at.camera.dsnu_e)


class Gain(SensorStage):
    """System gain K and black level: electrons to digital numbers, not yet whole ones."""

    name = "gain"
    essential = True

    def apply(self, signal: Tensor, at: Frames) -> Tensor:
        return signal * at.camera.system_gain_dn_per_e + at.camera.black_level_dn


class Quantisation(SensorStage):
    """Rounding to whole digital numbers. Gradients pass through unchanged, as the derivative of rounding is 0."""

    name = "quantisation"
    modelled = "rounding: the result is digital numbers"
    essential = True

    def apply(self, signal: Tensor, at: Frames) -> Tensor:
        return signal + (torch.round(signal) - signal).detach() if at.quantised else signal

    def bound_dn(self, at: Conditions[float]) -> float:
        return 1 / math.sqrt(12)


class Limits(SensorStage):
    """The converter's: 0 and full scale."""

    name = "limits"
    essential = True

    def apply(self, signal: Tensor, at: Frames) -> Tensor:
        return signal.clamp(0.0, at.camera.full_scale_dn)


SPECTRAL_INTEGRATION, PRNU, DARK_CURRENT = SpectralIntegration(), Prnu(), DarkCurrent()
SHOT_NOISE, FULL_WELL, READ_NOISE, DSNU = ShotNoise(), FullWell(), ReadNoise(), Dsnu()
GAIN, QUANTISATION, LIMITS = Gain(), Quantisation(), Limits()
LINEAR_MODEL: tuple[SensorStage, ...] = (
    SPECTRAL_INTEGRATION,
    PRNU,
    DARK_CURRENT,
    SHOT_NOISE,
    FULL_WELL,
    READ_NOISE,
    DSNU,
    GAIN,
    QUANTISATION,
    LIMITS,
)
"""The stages of EMVA 1288, which the fast route implements."""
STAGES = LINEAR_MODEL
"""All stages; those of one's own come between: ``(*LINEAR_MODEL[:5], OWN, *LINEAR_MODEL[5:])``."""


def active(camera: Camera, without: frozenset[str] = frozenset(), *, noisy: bool = True) -> list[SensorStage]:
    """The stages that do something in this camera and are not left out, in order; of noise only if ``noisy``."""
    asked = [stage for stage in STAGES if stage.name not in without and (noisy or not stage.draws)]
    return [
        stage for stage in asked if not stage.figures or any(getattr(camera, name) for name in stage.figures)
    ]


def noisy_electrons(mean_e: Tensor, read_noise_e: float, normal: Tensor) -> Tensor:
    """Shot and read noise in one draw: a normal corrected to the skewness of Poisson(mean) + N(0, read^2).

    x = mean + s z + k (z^2 - 1) with k = mean / (6 v), s^2 = v - 2 k^2, v = mean + read^2 (the first terms of Cornish
    and Fisher): mean and variance exact. After gain and rounding the total variation distance from the exact law is
    below 0.008, and 0.0005 from 100 electrons on, for a read noise of at least 1 electron. mean_e, normal: any shape.
    """
    # Without light and read noise there is no variance: the least of either keeps 0 / 0 and its derivative away.
    variance = mean_e + max(read_noise_e**2, 1e-6)
    skew = mean_e / variance / 6
    spread = variance - 2 * skew * skew
    if read_noise_e**2 < 1 / 18:  # else v > 2 k^2 throughout
        spread = spread.clamp(min=1e-6)
    return mean_e - skew + (torch.sqrt(spread) + skew * normal) * normal


def nearly_full_e(camera: Camera) -> float:
    """Mean electrons from which on the full well may clip: below, it is six deviations of shot noise away."""
    well_e = camera.well_limit_e
    return well_e if math.isinf(well_e) else well_e - 6 * math.sqrt(well_e)


@lru_cache(maxsize=64)
def _flat_curve_error(camera: Camera, illuminant: str | Curve) -> float:
    """Relative error of the signal if the sensor's curve were flat, at its mean over wavelengths."""

    def mean(curve: Spectrum) -> float:
        return sum(curve.values) / len(curve.values) if isinstance(curve, Curve) else curve

    curves = camera.quantum_efficiency
    if isinstance(curves, FilterCurves):
        even: float | FilterCurves = FilterCurves(**{name: mean(curve) for name, curve in curves.stated()})
    else:
        even = mean(curves)
    flat = electrons_per_lux_s(replace(camera, quantum_efficiency=even), illuminant)
    exact = electrons_per_lux_s(camera, illuminant)
    return abs(flat - exact) / exact if exact > 0 else 0.0
