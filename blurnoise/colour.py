"""Colour filters before the pixels: patterns, the quantum efficiency behind each, and the colour matrix.

Convention: a pattern names its filters in reading order, the first row's two and then the second row's: R red, G
green, B blue, C clear. Colours are linear, (red, green, blue), 1 is white.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from blurnoise._core.checks import in_range, shown
from blurnoise.spectra import Curve, Spectrum, cut_short

Cfa = Literal["none", "mono", "RGGB", "GRBG", "GBRG", "BGGR", "RCCB", "RCCC"]
Row = tuple[float, float, float]
Matrix = tuple[Row, Row, Row]
PLANES = ("none", "mono")
"""Without a mosaic: a sensor for each colour, or one plane of light."""
_CURVES = {"R": "red", "G": "green", "B": "blue", "C": "clear"}
_ROW_TOLERANCE = 0.002  # what three figures of three decimals leave
_GENERIC_NM = {"red": (600.0, 40.0), "green": (535.0, 40.0), "blue": (460.0, 30.0)}
_LARGEST_INVERSE = 100.0
IDENTITY: Matrix = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
NO_GAINS: Row = (1.0, 1.0, 1.0)


@dataclass(frozen=True)
class FilterCurves:
    """Electrons per photon behind each colour filter, IR-cut included: a number over 400-700 nm or a curve.

    A pattern needs those of its own filters. Raises ``TypeError`` or ``ValueError`` naming the filter.
    """

    red: Spectrum | None = None
    green: Spectrum | None = None
    blue: Spectrum | None = None
    clear: Spectrum | None = None

    def __post_init__(self) -> None:
        for name, curve in self.stated():
            for value in curve.values if isinstance(curve, Curve) else (curve,):
                in_range(f"quantum_efficiency.{name}", value, 0.0, 1.0)

    def stated(self) -> Iterator[tuple[str, Spectrum]]:
        """Name and curve of each that is stated."""
        for name in _CURVES.values():
            if (curve := getattr(self, name)) is not None:
                yield name, curve

    def of(self, letter: str) -> Spectrum:
        """The curve behind the filter with this letter of a pattern, which must be stated."""
        curve: Spectrum = getattr(self, _CURVES[letter])
        return curve


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


def marked(curves: Spectrum | FilterCurves) -> str:
    """Where curves are cut short (:func:`blurnoise.spectra.cut_short`), a filter's by its name; "" if none is."""
    if isinstance(curves, Curve):
        return cut_short(curves)
    stated = curves.stated() if isinstance(curves, FilterCurves) else ()
    marks = {name: cut_short(curve) for name, curve in stated if isinstance(curve, Curve)}
    return "; ".join(f"{name} {mark}" for name, mark in marks.items() if mark)


def check_filters(cfa: str, quantum_efficiency: object) -> None:
    """Raise ``ValueError`` unless there is one curve without a mosaic, and one for each filter of a mosaic."""
    if cfa in PLANES:
        if isinstance(quantum_efficiency, FilterCurves):
            raise ValueError(
                f"quantum_efficiency: states filters; cfa = {cfa!r} has none and needs one curve"
            )
        return
    needed = [_CURVES[letter] for letter in dict.fromkeys(cfa)]
    stated = dict(quantum_efficiency.stated()) if isinstance(quantum_efficiency, FilterCurves) else {}
    if missing := [name for name in needed if name not in stated]:
        raise ValueError(
            f"quantum_efficiency: cfa = {cfa!r} needs {', '.join(needed)} of its own; missing {', '.join(missing)}"
        )


def checked_matrix(value: object, cfa: str) -> Matrix | None:
    """A colour matrix, camera colours to linear sRGB, as numbers; None stays.

    Raises ``TypeError`` or ``ValueError`` unless it is 3 x 3 with an inverse, its rows sum to 1, so that white stays
    white, and the pattern has colours.
    """
    if value is None:
        return None
    try:
        rows = np.array(value, dtype=float)
    except (TypeError, ValueError, OverflowError):
        raise TypeError(f"ccm = {shown(value)}: must be three rows of three numbers") from None
    if rows.shape != (3, 3) or not np.isfinite(rows).all():
        raise ValueError(f"ccm = {shown(value)}: must be three rows of three finite numbers")
    for place, total in enumerate(rows.sum(1), start=1):
        if abs(total - 1) > _ROW_TOLERANCE:
            raise ValueError(
                f"ccm: row {place} sums to {total:g}; each must sum to 1, so that white stays white"
            )
    if cfa in (*PLANES, "RCCC"):
        raise ValueError(f"ccm: cfa = {cfa!r} has no colours of its own to correct; must be None")
    if abs(np.linalg.det(rows)) < 1e-6 or np.abs(np.linalg.inv(rows)).max() > _LARGEST_INVERSE:
        raise ValueError(f"ccm = {shown(value)}: must have an inverse")
    first, second, third = (_row(row) for row in rows)
    return first, second, third


def checked_gains(value: object, cfa: str) -> Literal["auto"] | Row:
    """White-balance gains of red, green (or clear) and blue, or "auto". Raises ``TypeError`` or ``ValueError``."""
    if isinstance(value, str):
        if value != "auto":
            raise ValueError(f"white_balance = {shown(value)}: must be 'auto' or three gains")
        return "auto"
    try:
        gains = np.array(value, dtype=float)
    except (TypeError, ValueError, OverflowError):
        raise TypeError(f"white_balance = {shown(value)}: must be 'auto' or three gains") from None
    if gains.shape != (3,) or not ((gains >= 0.01) & (gains <= 100)).all():
        raise ValueError(f"white_balance = {shown(value)}: must be 'auto' or three gains from 0.01 to 100")
    if cfa in PLANES:
        raise ValueError(f"white_balance: cfa = {cfa!r} has no colours to balance; must be 'auto'")
    return _row(gains)


@lru_cache(maxsize=64)
def normalised(matrix: Matrix | None) -> Matrix:
    """The matrix with rows that sum to 1 but for the last digit; None: the identity."""
    if matrix is None:
        return IDENTITY
    rows = np.array(matrix)
    first, second, third = (_row(row / row.sum()) for row in rows)
    return first, second, third


@lru_cache(maxsize=64)
def inverse(matrix: Matrix | None) -> Matrix:
    """Linear sRGB to camera colours."""
    first, second, third = (_row(row) for row in np.linalg.inv(np.array(normalised(matrix))))
    return first, second, third


def product(left: Matrix, right: Matrix) -> Matrix:
    """The matrix product."""
    first, second, third = (_row(row) for row in np.array(left) @ np.array(right))
    return first, second, third


def _row(values: object) -> Row:
    red, green, blue = (float(value) for value in values)  # type: ignore[attr-defined]
    return red, green, blue
