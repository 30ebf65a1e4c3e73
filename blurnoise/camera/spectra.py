"""Spectral curves, and from illuminance to photons.

Wavelengths in nm, curves piecewise linear between their samples and zero outside them. Data: the CIE 1924
photopic curve V (1 nm) and the D-series components S0, S1, S2 (10 nm), both of CIE 15, as CSV tables in
``data/``; spectra of lamps (5 nm) in ``data/illuminants/``, whose NOTICE.md has sources and licence. All integrals
are sums over a 1 nm grid (trapezoid), as far as both light and response go: CIE's daylight ends at 830 nm, its lamps
at 780 nm, Planck's law is taken to 1100 nm.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from importlib import resources
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from blurnoise._core.checks import in_range, limited, shown
from blurnoise._core.fields import check_fields
from blurnoise._core.files import read_samples

# Exact by the definitions of the SI, the 683 lm/W at 540 THz included.
PLANCK_J_S = 6.62607015e-34
LIGHT_M_S = 299_792_458.0
BOLTZMANN_J_K = 1.380649e-23
LUMENS_PER_WATT = 683.0
VISIBLE_NM = (400.0, 700.0)  # the band that a plain number (a quantum efficiency, a transmission) covers
SILICON_NM = 1000.0
"""Where silicon hardly sees any more."""
INFRARED_LAMPS_NM: Mapping[str, float] = {"850": 850.0, "940": 940.0}
"""Centroids of lamps in near infrared."""
_LAMP_NM = 30.0  # width of their light, at half its height
_INFRARED_NAME = re.compile(r"(led|ir|nir|infrared)?[- ]?(850|940)( ?nm)?", re.IGNORECASE)
_OVER = 0.05  # of the peak: a curve that ends above it was cut short, one that ends below has faded

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Curve:
    """A spectral curve: ``values`` at ``wavelengths_nm`` (increasing), linear between, zero outside.

    Raises ``TypeError`` or ``ValueError`` naming the field.

    >>> Curve((400.0, 700.0), (0.2, 0.8)).at(np.array([300.0, 550.0]))
    array([0. , 0.5])
    """

    wavelengths_nm: tuple[float, ...]
    values: tuple[float, ...]

    def __post_init__(self) -> None:
        check_fields(self)
        check_samples("wavelengths_nm", self.wavelengths_nm, self.values)
        limited("wavelengths_nm: the first", self.wavelengths_nm[0], "wavelength_nm")
        limited("values: the largest", max(map(abs, self.values)), "value")

    @classmethod
    def from_csv(cls, path: str | Path, column: int = 1) -> Curve:
        """Read a CSV of wavelengths in nm (column 0) and values (``column``), with or without a header.

        Raises ``ValueError`` that names the file and line when a row does not hold numbers.
        """
        return cls(*read_samples(path, column, "a wavelength in nm"))

    def at(self, nm: Floats) -> Floats:
        """Values at ``nm``, zero outside the curve."""
        return np.interp(nm, self.wavelengths_nm, self.values, left=0.0, right=0.0)


def check_samples(name: str, positions: Sequence[float], values: Sequence[float]) -> None:
    """Raise ``ValueError`` unless there are two samples or more, at positions from 0 to 1e6 that increase.

    >>> check_samples("heights", (0.0, 0.5, 0.5), (1.0, 0.9, 0.8))
    Traceback (most recent call last):
        ...
    ValueError: heights = (0.0, 0.5, 0.5): must be >= 0 and increase
    """
    if len(positions) != len(values) or len(positions) < 2:
        got = f"{len(positions)} and {len(values)}"
        raise ValueError(f"{name}, values: must be as many, at least 2, got {got}")
    if positions[0] < 0 or any(after <= before for before, after in pairwise(positions)):
        raise ValueError(f"{name} = {shown(positions)}: must be >= 0 and increase")
    in_range(f"{name}: the last", positions[-1], 0.0, 1e6, above=True)


Spectrum = float | Curve  # a number holds over the whole integration band
Band = tuple[float, float]


def check_shares(name: str, curve: Spectrum) -> None:
    """Raise ``TypeError`` or ``ValueError`` unless all values lie within [0, 1].

    >>> check_shares("quantum_efficiency", 0.6)  # raises beyond 1
    """
    for value in curve.values if isinstance(curve, Curve) else (curve,):
        in_range(name, value, 0.0, 1.0)


def planck(kelvin: float) -> Curve:
    """Relative radiance of a black body per wavelength, 300-1100 nm, 1 at 560 nm. Temperature in K.

    >>> planck(2856.0).at(np.array([450.0, 560.0])).round(3)
    array([0.331, 1.   ])
    """
    limited("kelvin", kelvin)
    nm = np.arange(300.0, 1101.0)
    metres = nm * 1e-9
    radiance = metres**-5 / np.expm1(PLANCK_J_S * LIGHT_M_S / (metres * BOLTZMANN_J_K * kelvin))
    return Curve(tuple(nm), tuple(radiance / radiance[nm == 560]))


def daylight(kelvin: float) -> Curve:
    """CIE D-series daylight of correlated colour temperature 4000-25000 K, 1 at 560 nm (CIE 15, eq. 3.3-3.7).

    The named illuminants carry the older value of c2, so D55 is 5500 * 1.4388 / 1.4380 K.

    >>> daylight(6504.0).at(np.array([450.0, 560.0])).round(3)
    array([1.17, 1.  ])
    """
    if not 4000.0 <= kelvin <= 25000.0:
        raise ValueError(f"kelvin = {kelvin!r}: must be within 4000 and 25000 for CIE daylight")
    u = 1e3 / kelvin
    if kelvin <= 7000.0:
        x = 0.244063 + 0.09911 * u + 2.9678 * u**2 - 4.6070 * u**3
    else:
        x = 0.237040 + 0.24748 * u + 1.9018 * u**2 - 2.0064 * u**3
    y = -3.000 * x**2 + 2.870 * x - 0.275
    m = 0.0241 + 0.2562 * x - 0.7341 * y
    m1 = round((-1.3515 - 1.7703 * x + 5.9114 * y) / m, 3)
    m2 = round((0.0300 - 31.4424 * x + 30.0717 * y) / m, 3)
    s0, s1, s2 = (_table("d_series.csv", column) for column in (1, 2, 3))
    spd = np.asarray(s0.values) + m1 * np.asarray(s1.values) + m2 * np.asarray(s2.values)
    return Curve(s0.wavelengths_nm, tuple(spd / 100.0))


def _d_series(hundreds: int) -> Curve:
    return daylight(hundreds * 100 * 1.4388 / 1.4380)


def _lamp(table: str, column: int) -> Curve:
    return _table(f"illuminants/{table}.csv", column)


def _sodium_line() -> Curve:
    """The one line at 590 nm that NIST's table of a low-pressure sodium lamp has at steps of 5 nm (CQS 7.4)."""
    return Curve((585.0, 590.0, 595.0), (0.0, 1.0, 0.0))


ILLUMINANTS: Mapping[str, Callable[[], Curve]] = {
    **{f"D{hundreds}": partial(_d_series, hundreds) for hundreds in (50, 55, 65, 75)},
    "led-2700": partial(_lamp, "cie_led", 1),  # LED-B1, 2733 K
    "led-3000": partial(_lamp, "cie_led", 2),  # LED-B2, 2998 K
    "led-4000": partial(_lamp, "cie_led", 3),  # LED-B3, 4103 K
    "led-5000": partial(_lamp, "cie_led", 4),  # LED-B4, 5109 K
    "led-6500": partial(_lamp, "cie_led", 5),  # LED-B5, 6598 K
    "sodium": partial(_lamp, "cie_hp", 1),  # HP1, standard high-pressure sodium
    "metal-halide": partial(_lamp, "cie_hp", 2),  # HP3
    "low-pressure-sodium": _sodium_line,
    "halogen": partial(planck, 3200.0),
}
"""The named spectra, by name; each is made or read once it is needed."""
_BY_KEY = {name.lower(): name for name in ILLUMINANTS}
_ALLOWED = f"must be {', '.join(ILLUMINANTS)}, planck:KELVIN or a Curve"


@lru_cache(maxsize=64)
def illuminant(name: str | Curve) -> Curve:
    """An illuminant by name, an entry of ``ILLUMINANTS`` in any case, or "planck:KELVIN"; a curve is passed through.

    Raises ``TypeError``, or ``ValueError`` that lists the names.

    >>> illuminant("planck:3200") == illuminant("Halogen")
    True
    """
    found = check_illuminant(name)
    if isinstance(found, Curve):
        return found
    return ILLUMINANTS[found]() if found in ILLUMINANTS else planck(float(found.partition(":")[2]))


def check_illuminant(illuminant: object) -> str | Curve:
    """The name as ``ILLUMINANTS`` has it, "planck:KELVIN", or the curve. Raises ``TypeError`` or ``ValueError``.

    >>> check_illuminant("d65")
    'D65'
    >>> check_illuminant("moon")
    Traceback (most recent call last):
    ValueError: illuminant = 'moon': must be D50, D55, D65, ...
    """
    if isinstance(illuminant, Curve):
        _check_power(illuminant)
        return illuminant
    if not isinstance(illuminant, str):
        raise TypeError(f"illuminant = {shown(illuminant)}: {_ALLOWED}")
    refuse_infrared(illuminant)
    kind, _, kelvin = illuminant.lower().partition(":")
    if kind in _BY_KEY and not kelvin:
        return _BY_KEY[kind]
    if kind != "planck":
        raise ValueError(f"illuminant = {shown(illuminant)}: {_ALLOWED}")
    try:
        return f"planck:{limited('kelvin', float(kelvin)):.15g}"
    except ValueError as error:
        raise ValueError(f"illuminant = {shown(illuminant)}: {error}") from None


@lru_cache(maxsize=64)
def _check_power(light: Curve) -> None:
    """Raise ``ValueError`` for a spectrum with negative power, or without light that cameras see."""
    for nm, power in zip(light.wavelengths_nm, light.values, strict=True):
        if power < 0:
            raise ValueError(f"illuminant: power at {nm:g} nm = {power:g}: must be >= 0")
    if _integral((light, _table("v_lambda.csv", 1)), VISIBLE_NM) <= 0:
        raise ValueError(
            "illuminant: gives no visible light, 400-700 nm, so that lux cannot say how much it is"
        )


@lru_cache(maxsize=64)
def photons_per_lux_s_um2(
    source: str | Curve = "D55", responses: Sequence[Spectrum] = (), band_nm: Band = VISIBLE_NM
) -> float:
    """Photons per (lux s um^2) of illuminance on a surface, weighted by every one of ``responses``, a tuple.

    integral W R1 R2 ... lambda/(h c) dlambda / (683 integral W V dlambda): Lin et al., Sensors 2024, 24, 5135, eq.
    9-11. The first integral runs over ``band_nm``, the second over all of V, because a lux counts all visible light
    (the paper's tool cuts both at 650 nm and so counts 1.6 % more).

    >>> round(photons_per_lux_s_um2("D55"))
    10724
    """
    lit = illuminant(source)
    luminous = _integral((lit, _table("v_lambda.csv", 1)), (0.0, math.inf))
    if luminous <= 0:
        raise ValueError(f"illuminant = {source!r}: gives no visible light")
    photons = _integral((lit, *responses), band_nm, power_of_nm=1) * 1e-9 / (PLANCK_J_S * LIGHT_M_S)
    return photons / (LUMENS_PER_WATT * luminous) * 1e-12


def counted_nm(response: Spectrum, cut_nm: float = 0.0) -> Band:
    """The wavelengths that a response counts: a number's are ``VISIBLE_NM``, a curve's its own; cut_nm: of a filter.

    >>> counted_nm(0.5), counted_nm(Curve((350.0, 1000.0), (0.1, 0.1))), counted_nm(0.5, cut_nm=650.0)
    ((400.0, 700.0), (350.0, 1000.0), (400.0, 650.0))
    """
    nm = response.wavelengths_nm if isinstance(response, Curve) else VISIBLE_NM
    return nm[0], min(nm[-1], cut_nm or math.inf)


def flattened(response: Spectrum, cut_nm: float = 0.0) -> Spectrum:
    """The mean of a response's values: a number where it ends in ``VISIBLE_NM``, or a curve to where it counts.

    >>> flattened(Curve((400.0, 700.0), (0.2, 0.6))), flattened(Curve((400.0, 900.0), (0.2, 0.6))).values
    (0.4, (0.4, 0.4))
    """
    if not isinstance(response, Curve):
        return response
    mean, end_nm = sum(response.values) / len(response.values), counted_nm(response, cut_nm)[1]
    return mean if end_nm <= VISIBLE_NM[1] else Curve((VISIBLE_NM[0], end_nm), (mean, mean))


def infrared_share(source: str | Curve, from_nm: float = VISIBLE_NM[1]) -> float:
    """Photons of an illuminant from from_nm to ``SILICON_NM``, as a multiple of those from 400 nm on, by its table.

    >>> round(infrared_share("halogen"), 1), round(infrared_share("led-4000"), 2)
    (2.9, 0.04)
    """
    lit = illuminant(source)
    seen = _integral((lit,), (VISIBLE_NM[0], from_nm), power_of_nm=1)
    return _integral((lit,), (from_nm, SILICON_NM), power_of_nm=1) / seen if seen > 0 else math.inf


def ends_at(source: str | Curve) -> float:
    """The last wavelength, nm, of an illuminant that ends above 5 % of its peak; infinity for one that has faded.

    >>> ends_at("D55"), ends_at("led-4000")
    (830.0, inf)
    """
    lit = illuminant(source)
    return lit.wavelengths_nm[-1] if lit.values[-1] > _OVER * max(lit.values) else math.inf


def refuse_infrared(illuminant: str) -> None:
    """Raise ``ValueError`` for names of lamps in near infrared, such as led-850.

    >>> refuse_infrared("led-4000")
    """
    if lamp := _INFRARED_NAME.fullmatch(illuminant.strip()):
        beside = f"give it beside lux, as infrared = {lamp[2]}:IRRADIANCE in W/m2"
        raise ValueError(f"illuminant = {shown(illuminant)}: is infrared, which lux do not count; {beside}")


def check_infrared(infrared: str) -> tuple[float, float]:
    """Wavelength, nm, and irradiance on the scene, W/m^2, of a lamp in near infrared. Raises ``ValueError``.

    >>> check_infrared("850:0.1")
    (850.0, 0.1)
    """
    nm, _, irradiance = str(infrared).partition(":")
    try:
        lamp = INFRARED_LAMPS_NM[nm.strip()], in_range("infrared", float(irradiance), 0.0, 1e4, above=True)
    except (KeyError, ValueError):
        must = "must be NM:IRRADIANCE in W/m2 on the scene, of a lamp of 850 or 940 nm, such as 850:0.1"
        raise ValueError(f"infrared = {shown(infrared)}: {must}") from None
    return lamp


@lru_cache(maxsize=256)
def with_infrared(source: str | Curve, illuminance_lux: float, infrared: str) -> Curve:
    """The spectrum of an illuminant at these lux with a lamp in near infrared beside it, W/(m^2 nm) on the scene.

    The lamp is a triangle, 30 nm wide at half its height, as LEDs for surveillance are (OSRAM SFH 4715S; assumed for
    940 nm). Lux do not count it: photons of infrared are E t A lambda/(h c), that is 50.34 photons per um^2, ms,
    uW/cm^2 and um of wavelength, EMVA 1288 release 4 linear, section 2.2.

    Raises ``ValueError`` for less than 1e-6 lux: the spectrum's scale is that of its visible light.

    >>> lit = with_infrared("D55", 0.01, "850:0.1")  # starlight, and a lamp
    >>> round(photons_per_lux_s_um2(lit, (), (800.0, 900.0)) * 0.01 * 1e-3 / (50.34 * 0.85 * 10), 3)  # of 1 ms
    1.0
    """
    lamp_nm, irradiance = check_infrared(infrared)
    lux = in_range("illuminance_lux, beside infrared", illuminance_lux, 1e-6, math.inf)
    lit = illuminant(source)
    lamp = Curve((lamp_nm - _LAMP_NM, lamp_nm, lamp_nm + _LAMP_NM), (0.0, irradiance / _LAMP_NM, 0.0))
    watts = lux / (LUMENS_PER_WATT * _integral((lit, _table("v_lambda.csv", 1)), (0.0, math.inf)))
    # Daylight's table does not fade: it ends at once.
    ends = lit.wavelengths_nm[0] - 1e-3, lit.wavelengths_nm[-1] + 1e-3
    nm = np.unique([*lit.wavelengths_nm, *ends, *lamp.wavelengths_nm])
    return Curve(tuple(nm.tolist()), tuple((watts * lit.at(nm) + lamp.at(nm)).tolist()))


@lru_cache(maxsize=64)
def cut_short(response: Curve) -> str:
    """Note on a response that ends inside ``VISIBLE_NM`` above 5 % of its peak, with the D55 light that it misses.

    >>> cut_short(Curve((470.0, 700.0), (0.5, 0.1)))
    'begins at 470 nm with 100% of its peak, counted as 0 beyond, +33.5% of white if held'
    """
    nm, values, peak = response.wavelengths_nm, response.values, max(response.values)
    ends: list[str] = []
    extended = dict(zip(nm, values, strict=True))
    low, high = VISIBLE_NM
    if nm[0] > low and values[0] > _OVER * peak:
        extended[low] = values[0]
        ends.append(f"begins at {nm[0]:g} nm with {values[0] / peak:.0%} of its peak")
    if nm[-1] < high and values[-1] > _OVER * peak:
        extended[high] = values[-1]
        ends.append(f"ends at {nm[-1]:g} nm with {values[-1] / peak:.0%} of its peak")
    if not ends:
        return ""
    whole = Curve(tuple(sorted(extended)), tuple(extended[nm] for nm in sorted(extended)))
    counted, possible = (photons_per_lux_s_um2("D55", (curve,)) for curve in (response, whole))
    more = f", +{possible / counted - 1:.1%} of white if held" if counted > 0 else ""
    return f"{' and '.join(ends)}, counted as 0 beyond{more}"


def _integral(factors: Sequence[Spectrum], band_nm: Band, power_of_nm: int = 0) -> float:
    """Integrate a product over the wavelengths that all curves cover, in steps of at most 1 nm."""
    curves = [factor for factor in factors if isinstance(factor, Curve)]
    low = max(band_nm[0], *(curve.wavelengths_nm[0] for curve in curves))
    high = min(band_nm[1], *(curve.wavelengths_nm[-1] for curve in curves))
    if low >= high:
        return 0.0
    # A grid of its own for each band, so that ends between two whole nm count to the full.
    nm = np.linspace(low, high, math.ceil(high - low) + 1)
    product = nm**power_of_nm
    for factor in factors:
        product = product * (factor.at(nm) if isinstance(factor, Curve) else float(factor))
    return float(np.trapezoid(product, nm))


@lru_cache(maxsize=8)
def _table(name: str, column: int) -> Curve:
    with resources.as_file(resources.files("blurnoise.camera") / "data" / name) as path:
        return Curve.from_csv(path, column)
