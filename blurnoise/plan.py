"""How much of the chain a scene needs: what each stage would contribute, which may be left out, and why.

Unit: DN RMS, at the brightest a white surface gets under the conditions. Contributions are bounds that hold
for any picture within [0, 1], so what is left out stays within the tolerance for all of them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

from blurnoise import transfer
from blurnoise._core.checks import non_negative, positive
from blurnoise.camera import Camera
from blurnoise.sensor import readout as sensor
from blurnoise.spectra import Curve

_FIELDS = {
    "defocus": "defocus_radius_px",
    "PRNU": "prnu",
    "DSNU": "dsnu_e",
    "dark current": "dark_current_e_s",
    "read noise": "read_noise_e",
}
"""The camera's field without which a stage does nothing."""
TOLERANCE_DN = 0.1
"""Default of what may be left out, DN RMS: a third of what rounding to digital numbers does anyway."""


@dataclass(frozen=True)
class Stage:
    """One stage: its contribution in DN RMS, whether it is modelled, and how or why not."""

    name: str
    contribution_dn: float
    kept: bool
    how: str


@dataclass(frozen=True)
class Plan:
    """The stages in the order of the physics, and what follows from them.

    camera: with what is left out set to 0. moves: whether motion is modelled; noisy: whether any noise is.
    left_out_dn: RMS of all that is left out, at most tolerance_dn.
    """

    stages: tuple[Stage, ...]
    camera: Camera
    moves: bool
    noisy: bool
    left_out_dn: float
    tolerance_dn: float


@lru_cache(maxsize=1024)
def plan(
    camera: Camera,
    *,
    exposure_s: float,
    illuminance_lux: float,
    displacement_px: tuple[float, float] = (0.0, 0.0),
    temperature_c: float = 25.0,
    illuminant: str | Curve = "D55",
    tolerance_dn: float = TOLERANCE_DN,
) -> Plan:
    """Keep the smallest set of stages whose absence stays within ``tolerance_dn`` (> 0), DN RMS.

    Stages leave in the order of what they contribute, smallest first, for as long as the root of the sum of
    their squares is within the tolerance. displacement_px: motion during the exposure; the other arguments as
    in :func:`blurnoise.simulate`, for one picture.
    Raises ``ValueError`` that names the argument.
    """
    positive("tolerance_dn", tolerance_dn)
    exposure, lux = non_negative("exposure_s", exposure_s), non_negative("illuminance_lux", illuminance_lux)
    contributions = _contributions(camera, exposure, lux, displacement_px, temperature_c, illuminant)
    budget = tolerance_dn**2
    left_out: set[str] = set()
    for name, contribution in sorted(contributions.items(), key=lambda item: item[1]):
        free = (
            name in ("spectral integration", "quantisation") and contribution > 0
        )  # leaving them out saves nothing
        if free or contribution**2 > budget:
            continue
        budget -= contribution**2
        left_out.add(name)
    if "shot noise" not in left_out and camera.read_noise_e >= sensor.MERGE_READ_NOISE_E:
        left_out.discard("read noise")  # it shares shot noise's draw and costs nothing
    reduced = _without(camera, frozenset(left_out & set(_FIELDS)))
    noisy = "shot noise" not in left_out or reduced.read_noise_e > 0
    how = _methods(reduced, displacement_px, noisy)
    stages = tuple(
        Stage(name, value, name not in left_out, _why_not(value) if name in left_out else how[name])
        for name, value in contributions.items()
    )
    total = math.sqrt(sum(stage.contribution_dn**2 for stage in stages if not stage.kept))
    return Plan(stages, reduced, "motion" not in left_out, noisy, total, tolerance_dn)


@lru_cache(maxsize=64)
def _without(camera: Camera, stages: frozenset[str]) -> Camera:
    """The camera whose ``stages`` do nothing."""
    nothing: dict[str, Any] = {_FIELDS[stage]: 0.0 for stage in stages}
    return replace(camera, **nothing)


def _contributions(
    camera: Camera,
    exposure_s: float,
    lux: float,
    displacement_px: tuple[float, float],
    temperature_c: float,
    illuminant: str | Curve,
) -> dict[str, float]:
    """DN RMS of each stage, bounds; in the order of the physics."""
    gain, full_dn = camera.system_gain_dn_per_e, camera.clip_dn
    white_e = lux * exposure_s * sensor.electrons_per_lux_s(camera, illuminant)
    signal_e = min(white_e, 2 * camera.saturation_e)  # noise beyond the clip does not show
    doublings = (temperature_c - camera.dark_reference_c) / camera.dark_doubling_c
    dark_e = camera.dark_current_e_s * 2**doublings * exposure_s
    length_px = math.hypot(*displacement_px)

    def of_picture(error: float) -> float:  # an error in units of white cannot exceed the range
        return min(error * gain * white_e, full_dn)

    return {
        "spectral integration": of_picture(_spectral_error(camera, illuminant)),
        "defocus": of_picture(_defocus_error(camera)),
        "motion": of_picture(transfer.motion_error(length_px)),
        "PRNU": min(gain * camera.prnu * signal_e, full_dn),
        "dark current": min(gain * math.hypot(dark_e, math.sqrt(dark_e)), full_dn),
        "shot noise": min(gain * math.sqrt(signal_e), full_dn),
        "read noise": min(gain * camera.read_noise_e, full_dn),
        "DSNU": min(gain * camera.dsnu_e, full_dn),
        "quantisation": 1 / math.sqrt(12),
    }


def _defocus_error(camera: Camera) -> float:
    if camera.defocus_counts_pixel:  # areas of the disc in the pixels: none up to half a pixel
        return 0.0 if camera.defocus_radius_px <= 0.5 else 0.5
    return camera.optics.error


def _spectral_error(camera: Camera, illuminant: str | Curve) -> float:
    """Relative error of the signal if the sensor's curve were flat, at its mean over wavelengths."""
    curve = camera.quantum_efficiency
    if not isinstance(curve, Curve):
        return 0.0
    mean = sum(curve.values) / len(curve.values)
    flat = sensor.electrons_per_lux_s(replace(camera, quantum_efficiency=mean), illuminant)
    exact = sensor.electrons_per_lux_s(camera, illuminant)
    return abs(flat - exact) / exact if exact > 0 else 0.0


def _methods(camera: Camera, displacement_px: tuple[float, float], noisy: bool) -> dict[str, str]:
    merged = camera.read_noise_e >= sensor.MERGE_READ_NOISE_E
    counts = "Poisson counts of one normal value per pixel: inversion below 10 e-, corrected normal above"
    length = math.hypot(*displacement_px)
    area = camera.defocus_counts_pixel
    together = camera.defocus_radius_px > 0 and not area
    return {
        "spectral integration": "once per camera and light",
        "defocus": f"areas of a disc, {camera.defocus_radius_px:g} px" if area else "transfer function",
        "motion": f"transfer function, {length:.3g} px" + (", with the lens's" if together else ""),
        "PRNU": "fixed field of factors",
        "dark current": "in the mean that shot noise is drawn from",
        "shot noise": "one corrected normal draw, with read noise" if merged else counts,
        "read noise": "in the draw of shot noise" if merged and noisy else "a normal draw of its own",
        "DSNU": "fixed field of offsets",
        "quantisation": "rounding: the result is digital numbers",
    }


def _why_not(contribution_dn: float) -> str:
    return "none here" if contribution_dn == 0 else "left out: within the tolerance"
