"""Radiometry: light on the scene to mean electrons in a pixel.

Domain: lux, seconds, degC in; mean electrons per pixel out. Lin et al., Sensors 2024, 24, 5135, eq. 9-13; EMVA 1288.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import TypeVar

import torch
from torch import Tensor

from blurnoise._core.checks import an_instance, in_range, real_tensor, shown
from blurnoise._core.limits import limited
from blurnoise.camera import Camera
from blurnoise.spectra import VISIBLE_NM, Curve, Spectrum, check_illuminant, photons_per_lux_s_um2

Number = TypeVar("Number", float, Tensor)
_MOST_DOUBLINGS, _MOST_E = (
    100.0,
    1e15,
)  # single precision holds their products; no well holds that many electrons


def photoelectrons(
    camera: Camera,
    illuminance_lux: float,
    exposure_s: float,
    illuminant: str | Curve = "D55",
    *,
    ir_cut: Spectrum = 1.0,
    band_nm: tuple[float, float] = VISIBLE_NM,
) -> float:
    """Mean photo-electrons per pixel of a white (reflectance 1) surface.

    E T p^2 tau / (4 N^2) * integral W Q I lambda/(h c) dlambda / (683 integral W V dlambda): Lin et al.,
    Sensors 2024, 24, 5135, eq. 9-13, without the rounding of h. illuminance_lux and exposure_s >= 0;
    illuminant: a name or a curve (see :func:`blurnoise.spectra.illuminant`); ir_cut: a transmission or a
    curve; band_nm: the wavelengths that count. Raises ``ValueError`` for values outside these ranges.
    """
    an_instance("camera", camera, Camera)
    lux, exposure = limited("illuminance_lux", illuminance_lux), limited("exposure_s", exposure_s)
    check_illuminant(illuminant)
    if not isinstance(ir_cut, Curve):
        ir_cut = in_range("ir_cut", ir_cut, 0.0, 1.0)
    ends = real_tensor("band_nm", band_nm)
    if ends.shape != (2,):
        raise ValueError(f"band_nm = {shown(band_nm)}: must be two increasing wavelengths in nm")
    low_nm, high_nm = ends.tolist()
    band_nm = (low_nm, high_nm)
    return lux * exposure * electrons_per_lux_s(camera, illuminant, ir_cut, band_nm)


@lru_cache(maxsize=64)
def electrons_per_lux_s(
    camera: Camera,
    illuminant: str | Curve = "D55",
    ir_cut: Spectrum = 1.0,
    band_nm: tuple[float, float] = VISIBLE_NM,
) -> float:
    """Electrons per pixel for one lux second on a white surface; see :func:`photoelectrons`."""
    on_sensor_um2 = camera.pixel_pitch_um**2 * camera.transmission / (4 * camera.f_number**2)
    responses = (camera.quantum_efficiency, ir_cut)
    return on_sensor_um2 * photons_per_lux_s_um2(illuminant, responses, band_nm)


@lru_cache(maxsize=64)
def mean_quantum_efficiency(camera: Camera, illuminant: str | Curve = "D55") -> float:
    """Electrons per photon of ``illuminant`` within 400-700 nm."""
    if not isinstance(camera.quantum_efficiency, Curve):
        return float(camera.quantum_efficiency)
    electrons = photons_per_lux_s_um2(illuminant, (camera.quantum_efficiency,), VISIBLE_NM)
    return electrons / photons_per_lux_s_um2(illuminant, (), VISIBLE_NM)


def dark_electrons(camera: Camera, exposure_s: Number, temperature_c: Number) -> Number:
    """Mean (and variance) of the dark charge: mu_I(ref) 2^((temp - ref)/doubling) T, EMVA 1288 eq. 14."""
    doublings = (temperature_c - camera.dark_reference_c) / camera.dark_doubling_c
    if isinstance(doublings, Tensor):
        factor = torch.exp2(doublings.clamp(max=_MOST_DOUBLINGS))
        return (camera.dark_current_e_s * factor * exposure_s).clamp(max=_MOST_E)
    return min(camera.dark_current_e_s * math.exp2(min(doublings, _MOST_DOUBLINGS)) * exposure_s, _MOST_E)
