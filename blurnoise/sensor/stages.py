"""The sensor's stages, one table in causal order: the linear model of EMVA 1288 release 4.

``STAGES`` is read wherever a frame is read out, planned or explained: a new entry is all that a new stage needs.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
import torch
from torch import Tensor

from blurnoise._core import rng
from blurnoise.camera import Camera
from blurnoise.camera.colour import FilterCurves, marked
from blurnoise.camera.radiometry import electrons_per_lux_s
from blurnoise.camera.sensor import DSNU as DSNU_FIGURES
from blurnoise.camera.sensor import PRNU as PRNU_FIGURES
from blurnoise.camera.spectra import Curve, Spectrum, flattened
from blurnoise.light.resolved import Resolved
from blurnoise.sensor.shared import ROW_GAIN, SHARED_NOISES
from blurnoise.sensor.stage import (
    MERGE_READ_NOISE_E,
    ReadoutFields,
    SensorStage,
    signal_bound_e,
    within_range_dn,
)


class SpectralIntegration(SensorStage):
    """Light to mean photo-electrons; none below 0 (ringing of a blur). Its bound is of a flat spectral curve.

    >>> camera, light = Camera.preset("imx250"), torch.tensor([-0.01, 0.5])
    >>> at = ReadoutFields(camera, "none", white_e=torch.tensor(1000.0), dark_e=torch.tensor(0.0), seeds=[0])
    >>> SPECTRAL_INTEGRATION.apply(light, at)  # electrons; a blur's ringing below black is no light
    tensor([  0., 500.])
    """

    name = "spectral integration"
    essential = True

    def apply(self, signal: Tensor, at: ReadoutFields) -> Tensor:
        return (signal * at.white_e).clamp(min=0.0)

    def bound_dn(self, at: Resolved[float]) -> float:
        return within_range_dn(at.camera, _flat_curve_error(at.camera, at.illuminant) * at.white_e)

    def how(self, camera: Camera, noisy: bool) -> str:
        mark = marked(camera.sensor.quantum_efficiency)
        return "once per camera and light" + (f"; its curve {mark}" if mark else "")


class Prnu(SensorStage):
    """Photo-response non-uniformity: a fixed factor of each pixel, with parts of its row and its column.

    >>> uneven = Camera.preset("imx250").with_figures(prnu=0.01, system_gain_dn_per_e=0.5)
    >>> PRNU.bound_dn(Resolved(uneven, 0.01, 25.0, white_e=1000.0))  # 1 % of 1000 electrons of 0.5 DN
    5.0
    """

    name = "PRNU"
    modelled = "fixed field of factors"
    figures = PRNU_FIGURES
    spreads = True

    def apply(self, signal: Tensor, at: ReadoutFields) -> Tensor:
        return signal if at.gain is None else (signal * at.gain).clamp(min=0.0)

    def bound_dn(self, at: Resolved[float]) -> float:
        return within_range_dn(at.camera, at.camera.sensor.prnu_total * signal_bound_e(at))


class DarkCurrent(SensorStage):
    """Dark charge mu_I T, part of what shot noise is drawn from.

    >>> warm = Camera.preset("imx250").with_figures(dark_current_e_s=900.0, system_gain_dn_per_e=1.0)
    >>> at = Resolved(warm, exposure_s=0.01, temperature_c=20.0, white_e=1000.0)
    >>> round(DARK_CURRENT.bound_dn(at), 2)  # 9 electrons and their shot noise of 3, root of the sum of squares
    9.49
    """

    name = "dark current"
    modelled = "in the mean that shot noise is drawn from"
    figures = ("dark_current_e_s",)
    spreads = True

    def apply(self, signal: Tensor, at: ReadoutFields) -> Tensor:
        return signal + at.dark_e

    def bound_dn(self, at: Resolved[float]) -> float:
        return within_range_dn(at.camera, math.hypot(at.dark_e, math.sqrt(at.dark_e)))


class PhotonTransfer(SensorStage):
    """The bend of the variance of shot noise over the mean, in the draw of shot noise.

    >>> bent = Camera.preset("imx250").with_figures(photon_transfer=((0.0, 1.0), (1.0, 0.81)))
    >>> at = Resolved(bent, 0.01, 20.0, white_e=bent.sensor.saturation_e)
    >>> round(PHOTON_TRANSFER.bound_dn(at) / SHOT_NOISE.bound_dn(at), 2)  # the root of .81 is a tenth less
    0.1
    """

    name = "photon transfer"
    draws = True
    figures = ("photon_transfer",)
    modelled = "in the draw of shot noise"

    def apply(self, signal: Tensor, at: ReadoutFields) -> Tensor:
        return signal

    def bound_dn(self, at: Resolved[float]) -> float:
        most_e, camera = signal_bound_e(at) + at.dark_e, at.camera
        # A piecewise linear factor is farthest from 1 at a point of it, or at the most that the picture reaches.
        places_e = [share * camera.sensor.saturation_e for share, _ in camera.sensor.photon_transfer]
        reached = [camera.sensor.variance_factor(min(place_e, most_e)) for place_e in (*places_e, most_e)]
        farthest = max(abs(math.sqrt(factor) - 1) for factor in reached)
        return within_range_dn(camera, farthest * math.sqrt(most_e))


class ShotNoise(SensorStage):
    """Poisson noise of photo-electrons and dark charge; under the law "merged" read noise is in the same draw.

    Pixels near the full well (:func:`nearly_full_e`) are drawn in two steps: the well clips before read noise comes.

    >>> camera = Camera.preset("imx250")
    >>> at = Resolved(camera, 0.01, 20.0, white_e=2500.0)
    >>> round(SHOT_NOISE.bound_dn(at) / camera.sensor.system_gain_dn_per_e, 2)  # electrons: the root of 2500
    50.0
    """

    name = "shot noise"
    draws = True

    def apply(self, signal: Tensor, at: ReadoutFields) -> Tensor:
        camera, bend = at.camera, variance_factor(signal, at.camera)
        if at.law == "exact":
            counts = rng.poisson(signal, at.seeds)
        elif at.normal is None:
            return signal
        elif at.law == "merged":
            drawn = noisy_electrons(signal, camera.sensor.read_noise_e, at.normal, bend)
            # Far below the well it never clips, so that one draw gives the same law.
            full = signal >= nearly_full_e(camera)
            if at.read is None or not bool(full.any()):
                return drawn
            charge = noisy_electrons(signal, 0.0, at.normal, bend).clamp(0.0, camera.sensor.well_limit_e)
            return torch.where(full, charge + camera.sensor.read_noise_e * at.read, drawn)
        elif at.law == "apart":
            return noisy_electrons(signal, 0.0, at.normal, bend).clamp(min=0.0)
        else:
            counts = rng.poisson_of_normal(signal, at.normal)
        return counts if bend is None else signal + bend.sqrt() * (counts - signal)

    def bound_dn(self, at: Resolved[float]) -> float:
        return within_range_dn(at.camera, math.sqrt(signal_bound_e(at) + at.dark_e))

    def how(self, camera: Camera, noisy: bool) -> str:
        if camera.sensor.read_noise_e >= MERGE_READ_NOISE_E:
            return "one corrected normal draw, with read noise"
        return "Poisson counts of one normal value per pixel: inversion below 10 e-, corrected normal above"


class FullWell(SensorStage):
    """The full well, where it ends below the converter's range: charge beyond it is lost. Later noises stay.

    >>> camera = Camera.preset("imx250")
    >>> FULL_WELL.essential, FULL_WELL.bound_dn(Resolved(camera, 0.01, 20.0, white_e=2500.0))
    (True, None)
    """

    name = "full well"
    essential = True

    def apply(self, signal: Tensor, at: ReadoutFields) -> Tensor:
        # Merged, read noise is in the signal already, and must not be clipped with the charge: shot noise did that.
        return signal if at.law == "merged" else signal.clamp(max=at.camera.sensor.well_limit_e)


class ReadNoise(SensorStage):
    """Normal noise of the read-out, where the draw of shot noise does not hold it already.

    >>> camera = Camera.preset("imx250")
    >>> at = Resolved(camera, 0.01, 20.0, white_e=2500.0)
    >>> READ_NOISE.bound_dn(at) == camera.sensor.system_gain_dn_per_e * camera.sensor.read_noise_e
    True
    """

    name = "read noise"
    draws = True
    figures = ("read_noise_e",)

    def apply(self, signal: Tensor, at: ReadoutFields) -> Tensor:
        if at.read is None or at.law == "merged":
            return signal
        return signal + at.camera.sensor.read_noise_e * at.read

    def bound_dn(self, at: Resolved[float]) -> float:
        return within_range_dn(at.camera, at.camera.sensor.read_noise_e)

    def dither_dn(self, at: Resolved[float]) -> float:
        return at.camera.sensor.system_gain_dn_per_e * at.camera.sensor.read_noise_e

    def how(self, camera: Camera, noisy: bool) -> str:
        merged = camera.sensor.read_noise_e >= MERGE_READ_NOISE_E and noisy
        drawn = "in the draw of shot noise" if merged else "a normal draw of its own"
        return f"{drawn}; measured at gains" if camera.sensor.gains else drawn


class Dsnu(SensorStage):
    """Dark-signal non-uniformity: a fixed offset of each pixel, with parts of its row and its column.

    >>> offset = torch.tensor([[[[2.0, -1.0]]]])
    >>> at = ReadoutFields(Camera.preset("imx250"), "none", offset, offset, [0], offset_e=offset)
    >>> DSNU.apply(torch.full((1, 1, 1, 2), 100.0), at).tolist()
    [[[[102.0, 99.0]]]]
    """

    name = "DSNU"
    modelled = "fixed field of offsets"
    figures = DSNU_FIGURES
    spreads = True

    def apply(self, signal: Tensor, at: ReadoutFields) -> Tensor:
        return signal if at.offset_e is None else signal + at.offset_e

    def bound_dn(self, at: Resolved[float]) -> float:
        return within_range_dn(at.camera, at.camera.sensor.dsnu_total_e)


class Gain(SensorStage):
    """System gain K and black level: electrons to digital numbers, not yet whole ones.

    >>> camera = Camera.preset("imx250").with_figures(system_gain_dn_per_e=0.5, black_level_dn=10.0)
    >>> at = ReadoutFields(camera, "none", torch.ones(1), torch.zeros(1), [0])
    >>> GAIN.apply(torch.tensor([0.0, 100.0]), at)  # 0.5 DN an electron, above black
    tensor([10., 60.])
    """

    name = "gain"
    essential = True

    def apply(self, signal: Tensor, at: ReadoutFields) -> Tensor:
        return signal * at.camera.sensor.system_gain_dn_per_e + at.camera.sensor.black_level_dn


class Quantisation(SensorStage):
    """Rounding to whole digital numbers. Gradients pass through unchanged, as the derivative of rounding is 0.

    >>> at = ReadoutFields(Camera.preset("imx250"), "none", torch.ones(1), torch.zeros(1), [0])
    >>> QUANTISATION.apply(torch.tensor([10.2, 10.5, 11.5]), at)  # halves to even
    tensor([10., 10., 12.])
    """

    name = "quantisation"
    modelled = "rounding: the result is digital numbers"
    essential = True

    def apply(self, signal: Tensor, at: ReadoutFields) -> Tensor:
        return signal + (torch.round(signal) - signal).detach() if at.quantised else signal

    def bound_dn(self, at: Resolved[float]) -> float:
        return 1 / math.sqrt(12)


class Limits(SensorStage):
    """The converter's: 0 and full scale.

    >>> at = ReadoutFields(Camera.preset("imx250"), "none", torch.ones(1), torch.zeros(1), [0])
    >>> LIMITS.apply(torch.tensor([-3.0, 5000.0]), at)  # 12 bits
    tensor([   0., 4095.])
    """

    name = "limits"
    essential = True

    def apply(self, signal: Tensor, at: ReadoutFields) -> Tensor:
        return signal.clamp(0.0, at.camera.sensor.full_scale_dn)


SPECTRAL_INTEGRATION, PRNU, DARK_CURRENT = SpectralIntegration(), Prnu(), DarkCurrent()
PHOTON_TRANSFER, SHOT_NOISE, FULL_WELL, READ_NOISE = PhotonTransfer(), ShotNoise(), FullWell(), ReadNoise()
DSNU, GAIN, QUANTISATION, LIMITS = Dsnu(), Gain(), Quantisation(), Limits()
LINEAR_MODEL: tuple[SensorStage, ...] = (
    SPECTRAL_INTEGRATION,
    PRNU,
    DARK_CURRENT,
    PHOTON_TRANSFER,
    SHOT_NOISE,
    FULL_WELL,
    READ_NOISE,
    *SHARED_NOISES,
    DSNU,
    GAIN,
    QUANTISATION,
    LIMITS,
)
"""The stages of EMVA 1288 and a camera's departures from it; the fast route implements all but the bend."""
STAGES: tuple[SensorStage, ...] = (*LINEAR_MODEL[:2], ROW_GAIN, *LINEAR_MODEL[2:])
"""All stages in causal order; insert one of your own likewise."""


def active(camera: Camera, without: frozenset[str] = frozenset(), *, noisy: bool = True) -> list[SensorStage]:
    """The stages that do something in this camera and are not left out, in order; of noise only if ``noisy``.

    >>> [stage.name for stage in active(Camera.preset("imx250"), noisy=False)]
    ['spectral integration', 'full well', 'gain', 'quantisation', 'limits']
    """
    asked = [stage for stage in STAGES if stage.name not in without and (noisy or not stage.draws)]
    return [
        stage for stage in asked if not stage.figures or any(camera.figure(name) for name in stage.figures)
    ]


def noisy_electrons(
    mean_e: Tensor, read_noise_e: float, normal: Tensor, bend: Tensor | None = None
) -> Tensor:
    """Shot and read noise in one draw: a normal corrected to the skewness of Poisson(mean) + N(0, read^2).

    x = mean + s z + k (z^2 - 1) with k = mean / (6 v), s^2 = v - 2 k^2, v = mean + read^2 (the first terms of Cornish
    and Fisher): mean and variance exact. After gain and rounding the total variation distance from the exact law is
    below 0.008, and 0.0005 from 100 electrons on, for a read noise of at least 1 electron. mean_e, normal: any shape.
    bend: :func:`variance_factor`, with whose root f the deviation of Poisson(mean) from its mean is multiplied.

    >>> mean_e, normal = torch.full((3,), 100.0), torch.tensor([-1.0, 0.0, 1.0])
    >>> noisy_electrons(mean_e, 0.0, normal).round().tolist()  # a deviation of 10, the root of 100
    [90.0, 100.0, 110.0]
    """
    # Without light and read noise there is no variance: the least of either keeps 0 / 0 and its derivative away.
    of_light = mean_e if bend is None else mean_e * bend
    variance = of_light + max(read_noise_e**2, 1e-6)
    # The deviation from the mean is multiplied by the root of the bend, so its third cumulant by bend^1.5.
    skew = (of_light if bend is None else of_light * bend.sqrt()) / variance / 6
    spread = variance - 2 * skew * skew
    if read_noise_e**2 < 1 / 18 or bend is not None:  # else v > 2 k^2 throughout
        spread = spread.clamp(min=1e-6)
    return mean_e - skew + (torch.sqrt(spread) + skew * normal) * normal


def variance_factor(charge_e: Tensor, camera: Camera) -> Tensor | None:
    """:meth:`blurnoise.Camera.variance_factor` of mean charges; None where the camera states no photon transfer.

    >>> bent = Camera.preset("imx250").with_figures(photon_transfer=((0.5, 1.0), (1.0, 0.6)))
    >>> charge_e = torch.tensor([0.25, 0.75]) * bent.sensor.saturation_e
    >>> variance_factor(charge_e, bent)
    tensor([1.0000, 0.8000])
    """
    if not camera.sensor.photon_transfer:
        return None
    shares, factors = np.array(camera.sensor.photon_transfer).T
    slopes = np.diff(factors) / np.diff(shares)
    share = charge_e / camera.sensor.saturation_e
    factor = torch.full_like(share, factors[0])
    for point, change in zip(shares.tolist(), np.diff(slopes, prepend=0.0, append=0.0).tolist(), strict=True):
        factor = factor + change * (share - point).clamp(min=0.0)  # straight lines, level beyond the ends
    return factor.clamp(min=1e-6)  # for the derivative of its root


def offsets_e(at: ReadoutFields) -> Tensor | None:
    """All offsets behind the full well together, electrons: DSNU and the noise that pixels share; None: none.

    >>> offset = torch.tensor([[[[2.0, -1.0]]]])
    >>> at = ReadoutFields(Camera.preset("imx250"), "none", offset, offset, [0], offset_e=offset)
    >>> offsets_e(at) is offset  # no rows or columns with noise of their own
    True
    """
    shared = [
        each.size_e(at.camera) * at.shared[each.name] for each in SHARED_NOISES if each.name in at.shared
    ]
    every = shared if at.offset_e is None else [at.offset_e, *shared]
    return sum(every[1:], start=every[0]) if every else None


def nearly_full_e(camera: Camera) -> float:
    """Mean electrons from which on the full well may clip: below, it is six deviations of shot noise away.

    >>> low_well = Camera.preset("imx250").with_figures(full_well_e=2500.0)
    >>> nearly_full_e(low_well)  # six times 50 below it
    2200.0
    """
    well_e, most = (
        camera.sensor.well_limit_e,
        max((factor for _, factor in camera.sensor.photon_transfer), default=1.0),
    )
    # Beyond six deviations lies one value in 1e9, less than one of a frame.
    return well_e if math.isinf(well_e) else well_e - 6 * math.sqrt(well_e * most)


@lru_cache(maxsize=64)
def _flat_curve_error(camera: Camera, illuminant: str | Curve) -> float:
    """Relative error of the signal if the sensor's curve were flat, at its mean over wavelengths."""
    curves, cut_nm = camera.sensor.quantum_efficiency, camera.lens.infrared_cut_nm
    if isinstance(curves, FilterCurves):
        even: Spectrum | FilterCurves = FilterCurves(
            **{x: flattened(curve, cut_nm) for x, curve in curves.items()}
        )
    else:
        even = flattened(curves, cut_nm)
    flat = electrons_per_lux_s(camera.with_figures(quantum_efficiency=even), illuminant)
    exact = electrons_per_lux_s(camera, illuminant)
    return abs(flat - exact) / exact if exact > 0 else 0.0
