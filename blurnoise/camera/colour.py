"""Colour: filters before the pixels, the colour matrix, tone curves, and sRGB (IEC 61966-2-1).

Convention: a pattern names its filters in reading order, the first row's two and then the second row's: R red, G
green, B blue, C clear. Colours are linear, (red, green, blue), 1 is white. Tone curves lead from linear light to
coded values, both in [0, 1]: "srgb"; "filmic", 3 v^2 - 2 v^3 of the sRGB value v (Brooks et al., Unprocessing Images
for Learned Raw Denoising, CVPR 2019); "typical", measured (:data:`TYPICAL`); or one's own points (light, value), with
straight lines between them. A picture's own curve, which is taken out before it is exposed, may also be "linear".
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated, Any, Literal, cast

import cv2
import numpy as np
import torch
from annotated_types import Ge, Le, Len
from torch import Tensor

from blurnoise._core.checks import one_of, shown
from blurnoise._core.threads import in_pieces, plain
from blurnoise.camera.spectra import Curve, Floats, Spectrum, check_shares, cut_short

Cfa = Literal["none", "mono", "RGGB", "GRBG", "GBRG", "BGGR", "RCCB", "RCCC"]
Row = tuple[float, float, float]
Matrix = tuple[Row, Row, Row]
Points = Annotated[tuple[tuple[float, float], ...], Len(2)]
ToneCurve = Literal["srgb", "filmic", "typical"] | Points
PictureTone = Literal["linear"] | ToneCurve
_Gain = Annotated[float, Ge(0.01), Le(100)]
WhiteBalance = Literal["auto"] | tuple[_Gain, _Gain, _Gain]
# fmt: off
TYPICAL: Points = tuple((light, value / 255) for light, value in (
    (0.0, 0), (0.0021, 3), (0.0036, 6), (0.0067, 12), (0.0091, 16), (0.0142, 24), (0.0195, 32), (0.0312, 48),
    (0.0439, 64), (0.0591, 80), (0.0769, 96), (0.0974, 112), (0.1233, 128), (0.1539, 144), (0.1882, 160), (0.23, 176),
    (0.2872, 192), (0.3635, 208), (0.4633, 224), (0.6598, 240), (1.0, 255)))
# fmt: on
"""Tone curve of cameras' JPEG files: at each value, the median over fifteen cameras of the light relative to that of
the value 128. It has 3.8 stops between the values 128 and 16; the cameras have 3.2 to 4.4, sRGB has 5.4. Measured by
``blurnoise cameras fit --tone`` on 45 brackets (``tests/data/camera_tones.csv`` names them)."""
PLANES = ("none", "mono")
"""Without a mosaic: a sensor for each colour, or one plane of light."""
_CURVES = {"R": "red", "G": "green", "B": "blue", "C": "clear"}
_ROW_TOLERANCE = 0.002  # of a row's sum: three entries of three decimals each
_LARGEST_INVERSE = 100.0  # entries; a matrix near a singular one would turn rounding errors into colours


@dataclass(frozen=True)
class FilterCurves:
    """Electrons per photon behind each colour filter: a number over 400-700 nm, or a curve over its own range.

    A pattern needs those of its own filters. Raises ``TypeError`` or ``ValueError`` naming the filter.

    >>> FilterCurves(red=0.3, green=0.5, blue=0.4).of("G")
    0.5
    """

    red: Spectrum | None = None
    green: Spectrum | None = None
    blue: Spectrum | None = None
    clear: Spectrum | None = None

    def __post_init__(self) -> None:
        for name, curve in self.items():
            check_shares(name, curve)

    def items(self) -> Iterator[tuple[str, Spectrum]]:
        """Names and curves of the filters that are given."""
        for name in _CURVES.values():
            if (curve := getattr(self, name)) is not None:
                yield name, curve

    def of(self, letter: str) -> Spectrum:
        """The curve behind the filter with this letter of a pattern."""
        curve: Spectrum = getattr(self, _CURVES[letter])
        return curve


def marked(curves: Spectrum | FilterCurves) -> str:
    """Note on curves that are cut short (:func:`.spectra.cut_short`), with the filter's name; "" if none is.

    >>> marked(FilterCurves(red=Curve((470.0, 700.0), (0.5, 0.1))))
    'red begins at 470 nm with 100% of its peak, counted as 0 beyond, +33.5% of white if held'
    """
    each = curves.items() if isinstance(curves, FilterCurves) else [("", curves)]
    marks = [(name, cut_short(curve)) for name, curve in each if isinstance(curve, Curve)]
    return "; ".join(f"{name} {mark}".strip() for name, mark in marks if mark)


def check_filters(cfa: str, curves: Spectrum | FilterCurves) -> None:
    """Raise ``TypeError`` or ``ValueError`` unless each filter of the mosaic has a quantum efficiency.

    >>> check_filters("RGGB", FilterCurves(red=0.3, green=0.5))
    Traceback (most recent call last):
        ...
    ValueError: quantum_efficiency: cfa = 'RGGB' needs red, green, blue of its own; missing blue
    """
    curve_of = dict(curves.items()) if isinstance(curves, FilterCurves) else {}
    if not isinstance(curves, FilterCurves):
        check_shares("quantum_efficiency", curves)
    elif cfa in PLANES:
        raise ValueError(f"quantum_efficiency: states filters; cfa = {cfa!r} has none and needs one curve")
    needed = [] if cfa in PLANES else [_CURVES[letter] for letter in dict.fromkeys(cfa)]
    if missing := ", ".join(name for name in needed if name not in curve_of):
        must = f"needs {', '.join(needed)} of its own"
        raise ValueError(f"quantum_efficiency: cfa = {cfa!r} {must}; missing {missing}")


def check_balance(cfa: str, white_balance: WhiteBalance, ccm: Matrix | None) -> None:
    """Raise ``ValueError`` where the mosaic has no colours to balance or to correct, or the matrix is unusable.

    >>> check_balance("mono", (2.0, 1.0, 1.5), None)
    Traceback (most recent call last):
        ...
    ValueError: white_balance: cfa = 'mono' has no colours to balance; must be 'auto'
    """
    if white_balance != "auto" and cfa in PLANES:
        raise ValueError(f"white_balance: cfa = {cfa!r} has no colours to balance; must be 'auto'")
    if ccm is not None:
        _check_matrix(ccm, cfa)


def _check_matrix(ccm: Matrix, cfa: str) -> None:
    rows = np.array(ccm)
    for number, total in enumerate(rows.sum(1), start=1):
        if abs(total - 1) > _ROW_TOLERANCE:
            must = "each must sum to 1, so that white stays white"
            raise ValueError(f"ccm: row {number} sums to {total:g}; {must}")
    if cfa in (*PLANES, "RCCC"):
        raise ValueError(f"ccm: cfa = {cfa!r} has no colours of its own to correct; must be None")
    if abs(np.linalg.det(rows)) < 1e-6 or np.abs(np.linalg.inv(rows)).max() > _LARGEST_INVERSE:
        raise ValueError(f"ccm = {shown(ccm)}: must have an inverse")


def picture_tone(value: object, name: str = "encoding") -> PictureTone:
    """``value`` as a picture's tone curve, its points as tuples. Raises ``TypeError`` or ``ValueError``.

    >>> picture_tone([(0, 0), (1, 1)])
    ((0.0, 0.0), (1.0, 1.0))
    """
    if isinstance(value, str):
        return cast(PictureTone, one_of(name, value, ("srgb", "linear", "filmic", "typical")))
    try:
        points = tuple((float(light), float(coded)) for light, coded in cast(Any, value))
    except (TypeError, ValueError):
        must = "must be 'srgb', 'linear', 'filmic', 'typical' or points (light, value)"
        raise TypeError(f"{name} = {shown(value)}: {must}") from None
    check_points(name, points)
    return points


def check_points(name: str, points: Points) -> None:
    """Raise ``ValueError`` unless the points (light, value) are a tone curve.

    >>> check_points("tone", ((0.0, 0.0), (1.0, 0.7), (1.0, 1.0)))
    Traceback (most recent call last):
        ...
    ValueError: tone = (...): light must increase from 0 to 1, values lie in [0, 1] and never fall
    """
    light, values = np.array(points, float).reshape(-1, 2).T
    if len(light) < 2:
        raise ValueError(f"{name} = {shown(points)}: must be at least two points")
    inside = (values >= 0).all() and (values <= 1).all() and light[0] == 0 and light[-1] == 1
    if not (inside and (np.diff(light) > 0).all() and (np.diff(values) >= 0).all()):
        must = "light must increase from 0 to 1, values lie in [0, 1] and never fall"
        raise ValueError(f"{name} = {shown(points)}: {must}")


@lru_cache(maxsize=64)
def normalised(matrix: Matrix | None) -> Matrix:
    """The matrix with rows that sum to 1 but for the last digit; None: the identity.

    >>> matrix = normalised(((1.601, -0.4, -0.2), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)))
    >>> round(matrix[0][0], 4), round(sum(matrix[0]), 12)  # a row that summed to 1.001
    (1.5994, 1.0)
    """
    return as_rows(np.eye(3) if matrix is None else [row / row.sum() for row in np.array(matrix)])


@lru_cache(maxsize=64)
def inverse(matrix: Matrix | None) -> Matrix:
    """Linear sRGB to camera colours.

    >>> inverse(((2.0, -1.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)))[0]  # twice red less green, undone
    (0.5, 0.5, 0.0)
    """
    return as_rows(np.linalg.inv(np.array(normalised(matrix))))


def as_rows(rows: Iterable[Floats]) -> Matrix:
    """Plain numbers of NumPy's rows: hashable.

    >>> as_rows(np.eye(3)[:2])
    ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    """
    return cast(Matrix, tuple(tuple(row.tolist()) for row in rows))


def toned(light: Tensor, curve: ToneCurve) -> Tensor:
    """``light``, any shape, clamped to [0, 1] and coded; differentiable.

    >>> toned(torch.tensor([0.18]), "srgb")
    tensor([0.4614])
    >>> toned(torch.tensor([0.2]), ((0.0, 0.0), (0.5, 0.8), (1.0, 1.0)))
    tensor([0.3200])
    """
    curve = TYPICAL if curve == "typical" else curve
    if isinstance(curve, str):
        value = srgb_from_linear(light)
        return value if curve == "srgb" else value * value * (3 - 2 * value)
    # Linear interpolation by hand: torch has none, and this passes gradients to light and values.
    at, values = light.new_tensor(curve).unbind(-1)
    light = light.clamp(0.0, 1.0)
    last = torch.searchsorted(at[1:-1].contiguous(), light.detach().contiguous(), right=True)
    slope = values.diff() / at.diff()
    return values[last] + slope[last] * (light - at[last])


def untoned(coded: Tensor, curve: PictureTone) -> Tensor:
    """The light of coded values, any shape, in [0, 1]: the inverse of :func:`toned`; differentiable.

    Where a curve's points are level, it is the least light of that value.

    >>> untoned(torch.tensor([0.4614]), "srgb")
    tensor([0.1800])
    """
    if curve == "linear":
        return coded.clamp(0.0, 1.0)
    curve = TYPICAL if curve == "typical" else curve
    if isinstance(curve, str):
        if curve == "filmic":  # the root of 3 v^2 - 2 v^3 in [0, 1]
            coded = 0.5 - torch.sin(torch.asin((1 - 2 * coded).clamp(-1.0, 1.0)) / 3)
        return linear_from_srgb(coded)
    at, values = coded.new_tensor(curve).unbind(-1)
    coded = coded.clamp(float(values[0]), float(values[-1]))
    last = torch.searchsorted(values[1:-1].contiguous(), coded.detach().contiguous())
    rise = values.diff()
    slope = torch.where(rise > 0, at.diff() / rise.clamp_min(1e-12), 0.0)
    return at[last] + slope[last] * (coded - values[last])


Encoding = Literal["srgb", "linear"]


def linear_from_srgb(coded: Tensor) -> Tensor:
    """Linear light of sRGB-coded values, any shape; values outside [0, 1] are clamped.

    >>> linear_from_srgb(torch.tensor([0.5]))
    tensor([0.2140])
    """
    # torch's power rounds by a number's place in memory; exponential and logarithm do not, and take half the time.
    if not plain(coded):
        coded = coded.clamp(0.0, 1.0)
        power = torch.exp(2.4 * torch.log((coded + 0.055) / 1.055))
        return torch.where(coded <= 0.04045, coded / 12.92, power)
    flat = coded.detach().reshape(-1).numpy()
    light = np.empty_like(flat)

    def decode(piece: slice) -> None:  # NumPy wakes no threads of its own
        clamped, power = np.clip(flat[piece], 0.0, 1.0), light[piece]
        np.divide(np.add(clamped, 0.055, out=power), 1.055, out=power)
        np.exp(np.multiply(np.log(power, out=power), 2.4, out=power), out=power)
        # OpenCV's masked copy takes a fifth of NumPy's time, which guesses at each value.
        linear = (clamped <= 0.04045).view(np.uint8)
        cv2.copyTo(clamped[None] / 12.92, linear[None], power[None])

    in_pieces(decode, len(flat), torch.get_num_threads())
    return torch.from_numpy(light).view(coded.shape)


def srgb_from_linear(linear: Tensor) -> Tensor:
    """sRGB-coded values of linear light, any shape; values outside [0, 1] are clamped.

    >>> srgb_from_linear(torch.tensor([0.18]))
    tensor([0.4614])
    """
    linear = linear.clamp(0.0, 1.0)
    # Not torch's power, as above; the inner clamp keeps the unused branch's gradient finite at 0.
    power = torch.exp(torch.log(linear.clamp_min(1e-4)) / 2.4)
    return torch.where(linear <= 0.0031308, 12.92 * linear, 1.055 * power - 0.055)
