"""Radiometry: light on the scene to mean electrons in a pixel.

Domain: lux, seconds, degC in; mean electrons per pixel out. Lin et al., Sensors 2024, 24, 5135, eq. 9-13; EMVA 1288.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import lru_cache
from types import MappingProxyType
from typing import TypeVar

import torch
from torch import Tensor

from blurnoise._core.checks import an_instance, limited
from blurnoise.optics.camera import Camera
from blurnoise.optics.colour import FilterCurves
from blurnoise.optics.spectra import Curve, check_illuminant, photons_per_lux_s_um2

BANDS_NM = ((580.0, 700.0), (490.0, 580.0), (400.0, 490.0))
"""Red, green and blue of a picture, as bands of the spectrum."""
_LEAST_GREEN = 0.05
Number = TypeVar("Number", float, Tensor)
_MOST_DOUBLINGS, _MOST_E = 100.0, 1e15  # single precision holds their products


def photoelectrons(
    camera: Camera, illuminance_lux: float, exposure_s: float, illuminant: str | Curve = "D55"
) -> float:
    """Mean photo-electrons per pixel of a white (reflectance 1) surface; behind the strongest filter of a mosaic.

    E T p^2 tau / (4 N^2) * integral W Q lambda/(h c) dlambda / (683 integral W V dlambda): Lin et al.,
    Sensors 2024, 24, 5135, eq. 9-13, without the rounding of h. illuminance_lux and exposure_s >= 0;
    illuminant: a name or a curve (see :func:`blurnoise.optics.spectra.illuminant`). Raises ``TypeError`` or
    ``ValueError`` naming the argument.
    """
    an_instance("camera", camera, Camera)
    lux, exposure = limited("illuminance_lux", illuminance_lux), limited("exposure_s", exposure_s)
    check_illuminant(illuminant)
    return lux * exposure * electrons_per_lux_s(camera, illuminant)


@lru_cache(maxsize=64)
def electrons_per_lux_s(camera: Camera, illuminant: str | Curve = "D55") -> float:
    """Electrons per pixel for one lux second on a white surface; see :func:`photoelectrons`."""
    return max(filter_electrons(camera, illuminant).values())


@lru_cache(maxsize=64)
def filter_electrons(camera: Camera, illuminant: str | Curve = "D55") -> Mapping[str, float]:
    """Electrons per pixel for one lux second on a white surface, by the filter's letter; "" without a mosaic."""
    on_sensor_um2 = camera.pixel_pitch_um**2 * camera.transmission / (4 * camera.f_number**2)
    curves = camera.quantum_efficiency
    each = (
        {letter: curves.of(letter) for letter in camera.cfa}
        if isinstance(curves, FilterCurves)
        else {"": curves}
    )
    photons = {letter: photons_per_lux_s_um2(illuminant, (curve,)) for letter, curve in each.items()}
    return MappingProxyType({letter: on_sensor_um2 * each for letter, each in photons.items()})


@lru_cache(maxsize=64)
def colour_shares(camera: Camera, illuminant: str | Curve = "D55") -> tuple[float, float, float]:
    """Shares of red, green and blue in the electrons that white light makes without a colour filter.

    A colour picture is three bands of the spectrum, ``BANDS_NM``, that add up to white (an assumption: boxes, as in
    Smits, An RGB-to-spectrum conversion for reflectances, 1999); what each makes follows from light and curve.
    """
    curves = camera.quantum_efficiency
    curve = curves.of("C") if isinstance(curves, FilterCurves) else curves
    red, green, blue = (photons_per_lux_s_um2(illuminant, (curve,), band) for band in BANDS_NM)
    total = red + green + blue
    return (red / total, green / total, blue / total) if total > 0 else (1 / 3, 1 / 3, 1 / 3)


@lru_cache(maxsize=64)
def clear_shares(camera: Camera, illuminant: str | Curve = "D55") -> tuple[float, float, float]:
    """Shares of red, green and blue in what clear pixels beside red and blue ones (RCCB) collect of white light.

    Green is what clear has more than both. Raises ``ValueError`` where that is less than a twentieth of it.
    """
    electrons = filter_electrons(camera, illuminant)
    red, blue, clear = (electrons[letter] for letter in "RBC")
    if not clear - red - blue > _LEAST_GREEN * clear:
        raise ValueError(
            f"quantum_efficiency: clear makes {clear:.4g} electrons per lux s, red {red:.4g}, blue {blue:.4g}; "
            f"cfa = 'RCCB' makes green of what clear has more, at least {_LEAST_GREEN:.0%} of it"
        )
    return red / clear, (clear - red - blue) / clear, blue / clear


def dark_electrons(camera: Camera, exposure_s: Number, temperature_c: Number) -> Number:
    """Mean (and variance) of the dark charge: mu_I(ref) 2^((temp - ref)/doubling) T, EMVA 1288 eq. 14."""
    doublings = (temperature_c - camera.dark_reference_c) / camera.dark_doubling_c
    if isinstance(doublings, Tensor):
        factor = torch.exp2(doublings.clamp(max=_MOST_DOUBLINGS))
        return (camera.dark_current_e_s * factor * exposure_s).clamp(max=_MOST_E)
    return min(camera.dark_current_e_s * math.exp2(min(doublings, _MOST_DOUBLINGS)) * exposure_s, _MOST_E)
