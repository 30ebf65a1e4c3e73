"""Radiometry: light on the scene to mean electrons in a pixel, and to the light behind a colour filter array.

Domain: lux, seconds, degC in; mean electrons per pixel out. Lin et al., Sensors 2024, 24, 5135, eq. 9-13; EMVA 1288.
Pictures of linear light, 1 is white; on a mosaic's one plane 1 is white behind the strongest filter. Linear sRGB
becomes camera colours by the inverse of the colour matrix; negative ones, outside the camera's gamut, are no light.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from functools import lru_cache, partial, reduce
from itertools import pairwise
from operator import add
from types import MappingProxyType
from typing import Any, TypeVar

import numpy as np
import torch
from torch import Tensor

from blurnoise._core.checks import an_instance, limited
from blurnoise._core.threads import plain
from blurnoise.camera import colour
from blurnoise.camera.camera import Camera
from blurnoise.camera.colour import FilterCurves, Row
from blurnoise.camera.spectra import (
    SILICON_NM,
    Curve,
    check_illuminant,
    check_infrared,
    counted_nm,
    ends_at,
    infrared_share,
    photons_per_lux_s_um2,
)

GREEN_NM = (490.0, 580.0)  # of a picture; blue is below, red above, the near infrared included
# Of clear: the difference that RCCB takes for green carries the noise of three filters, magnified by its inverse.
_LEAST_GREEN = 0.05
Number = TypeVar("Number", float, Tensor)
_MOST_DOUBLINGS, _MOST_E = 100.0, 1e15  # single precision holds their products


def photoelectrons(
    camera: Camera, illuminance_lux: float, exposure_s: float, illuminant: str | Curve = "D55"
) -> float:
    """Mean photo-electrons per pixel of a white (reflectance 1) surface; behind the strongest filter of a mosaic.

    E T p^2 tau / (4 N^2) * integral W Q lambda/(h c) dlambda / (683 integral W V dlambda): Lin et al., Sensors
    2024, 24, 5135, eq. 9-13, without the rounding of h. The first integral runs as far as light and quantum
    efficiency go, up to infrared_cut_nm of the lens; a plain number counts from 400 to 700 nm. A measured t_number of
    the lens stands for N / sqrt(tau). illuminance_lux and exposure_s >= 0; illuminant: a name or a curve (see
    :func:`blurnoise.camera.spectra.illuminant`). Raises ``TypeError`` or ``ValueError`` naming the argument.

    4 N^2 is that of a lens that obeys Abbe's sine condition, as photographic lenses do: the marginal ray meets the
    sensor at sin u = 1 / (2 N), and the sensor gets pi sin^2 u of the luminance. A disc without a lens, N diameters
    away, has tan u = 1 / (2 N), hence 1 + 4 N^2: the light of EMVA 1288's measurements, and the thin lens of pyBSM
    and ISETCam, which pass 11 % less at f/1.4 and 1.5 % less at f/4.

    >>> from blurnoise import Camera, photoelectrons
    >>> round(photoelectrons(Camera.preset("imx250"), illuminance_lux=50.0, exposure_s=0.001), 1)
    345.3
    """
    an_instance("camera", camera, Camera)
    lux, exposure = limited("illuminance_lux", illuminance_lux), limited("exposure_s", exposure_s)
    check_illuminant(illuminant)
    return lux * exposure * electrons_per_lux_s(camera, illuminant)


@lru_cache(maxsize=64)
def electrons_per_lux_s(camera: Camera, illuminant: str | Curve = "D55") -> float:
    """Electrons per pixel for one lux second on a white surface; see :func:`photoelectrons`.

    >>> camera = Camera.preset("imx250")
    >>> stopped_down = camera.with_figures(f_number=2 * camera.lens.f_number)
    >>> round(electrons_per_lux_s(camera) / electrons_per_lux_s(stopped_down), 3)  # the area of the aperture
    4.0
    """
    return max(filter_electrons(camera, illuminant).values())


@lru_cache(maxsize=64)
def filter_electrons(camera: Camera, illuminant: str | Curve = "D55") -> Mapping[str, float]:
    """Electrons per pixel for one lux second on a white surface, by the filter's letter; "" without a mosaic.

    >>> electrons = filter_electrons(Camera.preset("imx250c"))
    >>> {letter: round(number) for letter, number in electrons.items()}
    {'R': 2583, 'G': 2845, 'B': 1563}
    """
    # A lens of f-number N lights the sensor with E tau / (4 N^2); a pixel collects that over its area.
    lens = camera.lens
    tau, stop = (1.0, lens.t_number) if lens.t_number else (lens.transmission, lens.f_number)
    on_sensor_um2 = camera.sensor.pixel_pitch_um**2 * tau / (4 * stop**2)
    curves = camera.sensor.quantum_efficiency
    by_letter = {"": curves} if not isinstance(curves, FilterCurves) else {}
    if isinstance(curves, FilterCurves):
        by_letter = {letter: curves.of(letter) for letter in camera.sensor.cfa}
    photons = {
        letter: photons_per_lux_s_um2(illuminant, (curve,), counted_nm(curve, lens.infrared_cut_nm))
        for letter, curve in by_letter.items()
    }
    if text := infrared_text(camera, illuminant):  # once, as the result is kept
        warnings.warn(text, stacklevel=2)
    return MappingProxyType({letter: on_sensor_um2 * number for letter, number in photons.items()})


def infrared_text(camera: Camera, illuminant: str | Curve) -> str:
    """Note on near infrared that a camera without a filter sees, and its curve or the light's lacks; else "".

    >>> infrared_text(Camera.preset("imx250m"), "halogen")[:62]
    'imx250m: quantum_efficiency ends at 800 nm; this light has 1.2'
    """
    curves = camera.sensor.quantum_efficiency
    if isinstance(curves, FilterCurves) or camera.lens.infrared_cut_nm:
        return ""
    curve_nm, light_nm = min(counted_nm(curves)[1], SILICON_NM), ends_at(illuminant)
    if light_nm < curve_nm:
        light = f"the light's spectrum ends at {light_nm:g} nm, quantum_efficiency at {curve_nm:g} nm"
        return f"{camera.name}: {light}; infrared light between them is not counted"
    if camera.sensor.cfa != "mono" or (times := infrared_share(illuminant, curve_nm)) <= 1:
        return ""
    of = f"{times:.1f} times as many photons from there to 1000 nm as below, which are not counted"
    cut = "state infrared_cut_nm if the camera has such a filter"
    return f"{camera.name}: quantum_efficiency ends at {curve_nm:g} nm; this light has {of}; {cut}"


def check_sees(camera: Camera, infrared: str) -> None:
    """Raise ``ValueError`` for a camera that sees nothing of a lamp in near infrared.

    >>> check_sees(Camera.preset("imx250c"), "850:0.1")
    Traceback (most recent call last):
    ValueError: infrared = '850:0.1': imx250c sees nothing from 660 nm on; state quantum_efficiency there, and ...
    """
    lamp_nm, _ = check_infrared(infrared)
    curves, cut_nm = camera.sensor.quantum_efficiency, camera.lens.infrared_cut_nm
    each = [curve for _, curve in curves.items()] if isinstance(curves, FilterCurves) else [curves]
    end_nm = max(counted_nm(curve, cut_nm)[1] for curve in each)
    if end_nm <= lamp_nm:
        needs = "state quantum_efficiency there, and infrared_cut_nm: 0"
        raise ValueError(
            f"infrared = {infrared!r}: {camera.name} sees nothing from {end_nm:g} nm on; {needs}"
        )


@lru_cache(maxsize=64)
def colour_shares(camera: Camera, illuminant: str | Curve = "D55") -> tuple[float, float, float]:
    """Shares of red, green and blue in the electrons that white light makes without a colour filter.

    A colour picture is three bands of the spectrum that add up to white, divided at ``GREEN_NM`` (an assumption:
    boxes, as in Smits, An RGB-to-spectrum conversion for reflectances, 1999); what each makes follows from light and
    curve. Near infrared is part of red: leaves and many clothes are brighter in it.

    >>> [round(share, 2) for share in colour_shares(Camera.preset("imx250"))]
    [0.5, 0.42, 0.08]
    """
    curves = camera.sensor.quantum_efficiency
    curve = curves.of("C") if isinstance(curves, FilterCurves) else curves
    low, high = counted_nm(curve, camera.lens.infrared_cut_nm)
    ends = [min(max(low, nm), high) for nm in (low, *GREEN_NM, high)]
    blue, green, red = (photons_per_lux_s_um2(illuminant, (curve,), band) for band in pairwise(ends))
    total = red + green + blue
    return (red / total, green / total, blue / total) if total > 0 else (1 / 3, 1 / 3, 1 / 3)


@lru_cache(maxsize=64)
def clear_shares(camera: Camera, illuminant: str | Curve = "D55") -> tuple[float, float, float]:
    """Shares of red, green and blue in the electrons of clear pixels of an RCCB mosaic under white light.

    >>> red, blue = Curve((580.0, 700.0), (0.5, 0.5)), Curve((400.0, 490.0), (0.5, 0.5))
    >>> curves = FilterCurves(red=red, blue=blue, clear=0.5)
    >>> rccb = Camera.preset("imx250").with_figures(cfa="RCCB", quantum_efficiency=curves)
    >>> [round(share, 2) for share in clear_shares(rccb)]  # green is what red and blue leave of clear
    [0.46, 0.32, 0.23]
    """
    electrons = filter_electrons(camera, illuminant)
    red, blue, clear = (electrons[letter] for letter in "RBC")
    if not clear - red - blue > _LEAST_GREEN * clear:
        raise ValueError(
            f"quantum_efficiency: clear makes {clear:.4g} electrons per lux s, red {red:.4g}, blue {blue:.4g}; "
            f"cfa = 'RCCB' takes green from the difference, which must be at least {_LEAST_GREEN:.0%} of it"
        )
    return red / clear, (clear - red - blue) / clear, blue / clear


def dark_electrons(camera: Camera, exposure_s: Number, temperature_c: Number) -> Number:
    """Mean (and variance) of the dark charge: mu_I(ref) 2^((temp - ref)/doubling) T, EMVA 1288 eq. 14.

    >>> warm = Camera.preset("imx250").with_figures(dark_current_e_s=4.0)  # at 20 °C, doubling every 8
    >>> dark_electrons(warm, 0.5, 28.0)
    4.0
    """
    doublings = (temperature_c - camera.sensor.dark_reference_c) / camera.sensor.dark_doubling_c
    if isinstance(doublings, Tensor):
        factor = torch.exp2(doublings.clamp(max=_MOST_DOUBLINGS))
        return (camera.sensor.dark_current_e_s * factor * exposure_s).clamp(max=_MOST_E)
    return min(
        camera.sensor.dark_current_e_s * math.exp2(min(doublings, _MOST_DOUBLINGS)) * exposure_s, _MOST_E
    )


def planes(camera: Camera, colours: int) -> int:
    """Number of planes read out of pictures with so many colours. Raises ``ValueError`` naming the image.

    >>> planes(Camera.preset("imx250"), 3), planes(Camera.preset("imx250c"), 3)
    (3, 1)
    """
    if camera.sensor.cfa == "none":
        return colours
    if colours not in (1, 3):
        raise ValueError(
            f"image: has {colours} channels; cfa = {camera.sensor.cfa!r} needs 1 (grey) or 3 (RGB)"
        )
    return 1


def on_sensor(light: Tensor, camera: Camera, illuminant: str | Curve = "D55") -> Tensor:
    """Light (B, C, H, W) on the camera's pixels: (B, 1, H, W) of a mosaic or one plane, else ``light`` itself.

    >>> white = torch.ones(1, 3, 2, 2)
    >>> on_sensor(white, Camera.preset("imx250c"))[0, 0].round(decimals=2)  # R G / G B: green is the strongest
    tensor([[0.9100, 1.0000],
            [1.0000, 0.5500]])
    """
    if camera.sensor.cfa == "none":
        return light
    planes(camera, light.shape[1])
    quick = plain(light)  # NumPy wakes no threads
    source: Any = light.detach().numpy() if quick else light
    out = torch.empty_like(light[:, :1], requires_grad=False, memory_format=torch.contiguous_format)
    to: Any = out.numpy() if quick else out
    if camera.sensor.cfa == "mono":
        to[:, 0] = _weighted(source, weights(camera, illuminant)[0])
        return out
    pairs = -(-light.shape[-1] // 2)
    for y, sites in enumerate(np.array(weights(camera, illuminant)).reshape(2, 2, 3)):
        # Weights by column, so that rows are read as they are stored.
        by_column = np.tile(sites.T, pairs)[:, : light.shape[-1]]
        to[:, 0, y::2] = _weighted(source[..., y::2, :], by_column).clip(min=0.0)
    return out


@lru_cache(maxsize=64)
def weights(camera: Camera, illuminant: str | Curve = "D55") -> tuple[Row, ...]:
    """Weights of red, green and blue of linear sRGB in a plane: for each of the four sites, or for all pixels.

    >>> (of_all,) = weights(Camera.preset("imx250m"))  # one plane, infrared in red
    >>> [round(weight, 2) for weight in of_all]
    [0.61, 0.33, 0.06]
    """
    if camera.sensor.cfa == "mono":
        return (colour_shares(camera, illuminant),)
    electrons = filter_electrons(camera, illuminant)
    # White is 1 behind the strongest filter, whose pixels saturate first.
    most = max(electrons.values()) or 1.0
    red, green, blue = (np.array(row) for row in colour.inverse(camera.isp.ccm))
    rows = {"R": red, "G": green, "B": blue}
    if camera.sensor.cfa == "RCCB":
        rows["C"] = np.array(clear_shares(camera, illuminant)) @ np.array([red, green, blue])
    elif "C" in camera.sensor.cfa:
        rows["C"] = np.array(colour_shares(camera, illuminant))
    return tuple(colour.as_rows(rows[letter] * electrons[letter] / most for letter in camera.sensor.cfa))


def peak(camera: Camera, illuminant: str | Curve = "D55") -> float:
    """The largest value that pictures within [0, 1] can have on the plane, 1 without a mosaic.

    >>> peak(Camera.preset("imx250")), peak(Camera.preset("imx250c")) >= 1.0
    (1.0, True)
    """
    if camera.sensor.cfa in colour.PLANES:
        return 1.0
    return max(1.0, *(sum(max(0.0, weight) for weight in row) for row in weights(camera, illuminant)))


def _weighted(light: Any, row: Any) -> Any:
    """The weighted sum of the channels of (B, C, H, W), an array or a tensor; row: a number for each, or (3, W)."""
    of_kind = light.new_tensor if isinstance(light, Tensor) else partial(np.asarray, dtype=light.dtype)
    if light.shape[1] == 1:
        return light[:, 0] * of_kind(sum(row))
    parts = [light[:, channel] * of_kind(weight) for channel, weight in enumerate(row) if np.any(weight)]
    return reduce(add, parts)
