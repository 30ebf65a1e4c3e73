"""The light that a sensor for each colour is worth, compared with one sensor behind a Bayer pattern.

Domain: cameras with ``cfa="none"``. Noise is that of the luminance (Rec. 709) of a developed white or grey surface
(white balance and colour matrix, without their clipping), per area, at spatial frequencies far below the pattern's.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from blurnoise._core.luminance import LUMINANCE
from blurnoise.optics.camera import Camera
from blurnoise.optics.colour import Cfa, FilterCurves, normalised
from blurnoise.optics.radiometry import filter_electrons
from blurnoise.optics.spectra import Curve, Spectrum

_PATTERN: Cfa = "RGGB"
_GENERIC_NM = {"red": (600.0, 40.0), "green": (535.0, 40.0), "blue": (460.0, 30.0)}


class Stops(NamedTuple):
    """How much more light the Bayer camera needs for the same noise of brightness, in stops.

    in_the_dark: where read noise dominates. in_the_light: where shot noise does.
    """

    in_the_dark: float
    in_the_light: float


def behind_bayer(camera: Camera) -> Camera:
    """The same sensor, one for all colours, behind a Bayer pattern, with the colour matrix of ``imx250c``.

    A curve of quantum efficiency gets the filters of :func:`behind_generic_filters`. A number is
    taken as measured behind filters already, as those of the presets are. Raises ``ValueError`` for a camera with
    a mosaic or one plane of light.
    """
    own = camera.quantum_efficiency
    if camera.cfa != "none" or isinstance(own, FilterCurves):
        raise ValueError(f"camera: cfa = {camera.cfa!r}: must be 'none', a sensor for each colour")
    filtered = behind_generic_filters(own) if isinstance(own, Curve) else FilterCurves(own, own, own)
    ccm = Camera.preset("imx250c").ccm
    return replace(camera, cfa=_PATTERN, quantum_efficiency=replace(filtered, clear=None), ccm=ccm)


def behind_generic_filters(bare: Spectrum) -> FilterCurves:
    """A sensor's own curve, held beyond its samples, behind colour filters as they might be, for want of measured.

    Gaussians about 600, 535 and 460 nm (standard deviations 40, 40, 30 nm), 90 % at the peak; nothing from 660 nm on,
    nor behind clear pixels.
    """
    nm = np.arange(400.0, 651.0, 10.0)
    own = (
        np.interp(nm, bare.wavelengths_nm, bare.values) if isinstance(bare, Curve) else np.full(len(nm), bare)
    )

    def curve(transmission: float | NDArray[np.float64]) -> Curve:
        return Curve((*nm, 660.0), (*np.round(own * transmission, 4), 0.0))

    each = {
        name: curve(0.9 * np.exp(-(((nm - centre_nm) / spread_nm) ** 2) / 2))
        for name, (centre_nm, spread_nm) in _GENERIC_NM.items()
    }
    return FilterCurves(**each, clear=curve(1.0))


def behind_one_filter(camera: Camera) -> Camera:
    """The camera as if the strongest filter of its mosaic, under D55, were before every pixel; itself without any."""
    curves, electrons = camera.quantum_efficiency, filter_electrons(camera)
    if isinstance(curves, FilterCurves):
        curves = curves.of(max(electrons, key=lambda letter: electrons[letter]))
    return replace(camera, cfa="none", quantum_efficiency=curves, white_balance="auto", ccm=None)


def worth(camera: Camera, illuminant: str | Curve = "D55") -> Stops:
    """The light that the camera's three sensors save, see :func:`behind_bayer`; 0 stops if they collect nothing.

    A filter before a share s of the pixels collects e electrons of white where a whole sensor collects E. White
    balance divides by e and the matrix M mixes, so shot noise has the variance sum(w^2 / (s e)), w = Y M, where
    three sensors have sum(Y^2 / E); read noise has sum(w^2 / (s e^2)) where they have sum(Y^2 / E^2).
    """
    bayer = behind_bayer(camera)
    whole_e, each_e = filter_electrons(camera, illuminant)[""], filter_electrons(bayer, illuminant)
    electrons = np.array([each_e[letter] for letter in "RGB"])
    if not whole_e > 0 or not electrons.all():
        return Stops(0.0, 0.0)
    share = np.array([_PATTERN.count(letter) / len(_PATTERN) for letter in "RGB"])
    mixed = (np.array(LUMINANCE) @ np.array(normalised(bayer.ccm))) ** 2 / np.dot(LUMINANCE, LUMINANCE)
    relative = electrons / whole_e
    shot, read = (mixed / (share * relative)).sum(), (mixed / (share * relative**2)).sum()
    return Stops(math.log2(read) / 2, math.log2(shot))
