"""Tone curve of a camera, from processed pictures: a bracket of one static scene, or the fields of a grey scale.

Domain: pictures of 8 bits (or the upper 8 of 16); light is relative, 1 at the value 255. In a bracket, pixel i in
picture j has g(z_ij) = ln E_i + ln T_j, where g is the logarithm of the light of value z: Debevec & Malik, Recovering
High Dynamic Range Radiance Maps from Photographs, SIGGRAPH 1997. All pixels are used, and their E_i are eliminated.
The difference of g to that of sRGB is smooth, by its second difference.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement, pairwise
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image
from scipy.interpolate import PchipInterpolator

from blurnoise._core.files import read_samples
from blurnoise.camera.colour import Points, linear_from_srgb
from blurnoise_eval.calibration.frames import Floats
from blurnoise_eval.calibration.headers import refuse
from blurnoise_eval.calibration.listing import table_reader, with_points
from blurnoise_eval.calibration.to_camera import Known
from blurnoise_eval.calibration.uncertain import Z
from blurnoise_eval.datasets import decode
from blurnoise_eval.system.files import inside

FEWEST = 3
FEWEST_FIELDS = 3
"""Fewest fields of a grey scale; two would be a straight line."""
_LIST, _SUFFIXES = "frames.csv", (".png", ".jpg", ".jpeg", ".tif", ".tiff")
_EXIF, _EXPOSURE, _F_NUMBER, _ISO = 0x8769, 33434, 33437, 34855
_DARKEST, _BRIGHTEST = 3, 254  # values that do not clip
_MOST = 200_000  # pixels, at equal distances
_SMOOTH = 12.0  # values over which the curve may bend
_ENDS = 16  # values at both ends that a bracket need not contain
_LEAST_COMMON = 128  # values of 256 that two pictures must share
_OFF = 0.05  # relative error of the light of a picture above which its exposure time is doubtful
_VALUES = np.arange(256.0)
# The fit is of the difference to sRGB, which cameras depart from smoothly.
_SRGB = np.log(np.maximum(linear_from_srgb(torch.from_numpy(_VALUES / 255)).numpy(), 1e-6))
_POINTS = np.unique([0, 1, 2, 3, 4, 6, 8, 12, *range(16, 256, 8), 255])  # values of the curve's points


Oecf = tuple[tuple[float, ...], tuple[float, ...]]
"""A camera's opto-electronic conversion function (ISO 14524), from the fields of a grey scale: digital numbers, and
light in any unit, 0 for none; both rising, straight in between."""


def read_oecf(path: Path) -> Oecf:
    """From a CSV file: a line per field, digital number and light; a first line may name the columns.

    Raises ``OSError``, and ``ValueError`` for other content.
    """
    numbers, light = read_samples(path, 1, "a digital number")
    for name, values in (("numbers", numbers), ("light", light)):
        rising = values[0] >= 0 and all(a < b for a, b in pairwise([*values, math.inf]))
        if not rising or len(values) < FEWEST_FIELDS:
            raise ValueError(f"oecf: {name} must be {FEWEST_FIELDS} or more, >= 0 and increasing")
    return tuple(numbers), tuple(light)


@dataclass(frozen=True)
class Tone:
    """A tone curve. points: (light, value). text: how it was measured, with its uncertainty. doubts: a line each."""

    points: Points
    text: str
    doubts: tuple[str, ...] = ()

    @property
    def known(self) -> Known:
        """The field of a camera, with its source."""
        return {"tone": (self.points, "; doubtful: ".join([self.text, *self.doubts]))}


def measure_tone(path: Path) -> Tone:
    """Measure a tone curve from a folder with a bracket, or from the CSV file of a grey scale (number, light).

    Raises ``ValueError`` for missing or wrong data, ``OSError`` as reading does.
    """
    return _of_bracket(path) if path.is_dir() else _of_scale(path)


def _of_scale(path: Path) -> Tone:
    """A curve through the fields, in the logarithm of light relative to sRGB; straight beyond them."""
    numbers, light = map(np.array, read_oecf(path))
    full = 255.0 if numbers[-1] < 256 else 65535.0
    values, lit = 255 * numbers / full, light > 0
    over = np.log(light[lit]) - np.interp(values[lit], _VALUES, _SRGB)
    at = np.clip(_VALUES, values[lit][0], values[lit][-1])
    black = float(values[~lit][-1]) if not lit.all() else 0.0
    smooth = PchipInterpolator(values[lit], over)
    logs = smooth(at) + smooth.derivative()(at) * (_VALUES - at) + _SRGB
    logs[black >= _VALUES] = -np.inf
    return Tone(
        _points(logs), f"measured: {len(numbers)} fields of the grey scale {path.name}, smooth between them"
    )


def _of_bracket(folder: Path) -> Tone:
    files, exposures = _listed(folder)
    order = np.argsort(exposures)
    files, times = [files[index] for index in order], np.log(exposures[order])
    different = len(np.unique(times))
    refuse(different < FEWEST, f"{folder}: {different} exposures; must be {FEWEST} or more")
    stack = _stack(files)
    logs, offsets, off = _fit(stack, times)
    shared = ((stack >= _DARKEST) & (stack <= _BRIGHTEST)).sum(
        0
    ) > 1  # pixels that two pictures show unclipped
    overlap = np.bincount(stack[:, shared].ravel(), minlength=256)
    common = np.flatnonzero(overlap[_DARKEST : _BRIGHTEST + 1]) + _DARKEST
    must = f"must be {_LEAST_COMMON} or more; use a scene with dark and bright areas"
    must += ", exposures one or two stops apart"
    few = f"{folder}: two pictures have {len(common)} of 256 values in common; {must}"
    refuse(len(common) < _LEAST_COMMON, few)
    text = f"measured: bracket of {len(files)} pictures, residual {off:.2g} of 255"
    if len(files) > FEWEST:
        others = [_fit(np.delete(stack, index, 0), np.delete(times, index))[0] for index in range(len(files))]
        spread = np.std(np.array(others)[:, common], axis=0) * math.sqrt(len(files) - 1)  # jackknife
        slope = np.gradient(logs)[common]
        text += f", 95 % within {Z * float((spread / slope).max()) / 255:.2g} of white by leaving each out"
    worst, doubts = int(np.abs(offsets).argmax()), list[str]()
    if abs(offsets[worst]) > _OFF:
        off_by = f"{math.expm1(offsets[worst]):+.0%}"
        doubts.append(f"{files[worst].name}: by the curve, its light is {off_by} off its exposure time")
    if common[0] > _ENDS or common[-1] < 255 - _ENDS:
        doubts.append(f"values below {common[0]} and above {common[-1]} are extrapolated")
    return Tone(_points(logs), text, tuple(doubts))


def _points(logs: Floats) -> Points:
    """Points (light, value) of the curve from the logarithm of light at each value."""
    light = np.maximum.accumulate(np.exp(logs - logs[-1]))
    light[0] = 0.0
    rising = [0]
    for value in _POINTS[1:]:
        if light[value] > light[rising[-1]]:
            rising.append(int(value))
    rising[-1] = 255
    return tuple((round(float(light[value]), 7), round(value / 255, 5)) for value in rising)


def _fit(stack: NDArray[np.uint8], times: Floats) -> tuple[Floats, Floats, float]:
    """The logarithm of light at each value, the logarithmic error of each exposure time, and the RMS residual.

    stack (J, N): values. Values that clip have no weight, and dark ones, where rounding dominates, have little.
    """
    weights = np.where((_VALUES >= _DARKEST) & (_VALUES <= _BRIGHTEST), (_VALUES / 255) ** 2, 0.0)
    weight = weights[stack]
    usable = (weight > 0).sum(0) > 1
    stack, weight = stack[:, usable], weight[:, usable]
    total = weight.sum(0)
    known = times[:, None] - _SRGB[stack]
    known -= (weight * known).sum(0) / total  # eliminates the light of the pixel
    matrix = np.diag(np.bincount(stack.ravel(), weight.ravel(), 256))
    wanted = np.bincount(stack.ravel(), (weight * known).ravel(), 256)
    for one, other in combinations_with_replacement(range(len(stack)), 2):
        pair = np.bincount(
            256 * stack[one].astype(int) + stack[other], weight[one] * weight[other] / total, 1 << 16
        )
        pair = pair.reshape(256, 256)
        matrix -= pair if one == other else pair + pair.T
    bend = np.diff(np.eye(256), 2, axis=0)
    smooth = float(np.trace(matrix)) / 256
    gauge = np.outer(weights, weights) * smooth  # fixes the arbitrary unit of light
    over = np.linalg.solve(matrix + smooth * _SMOOTH**4 / 256 * bend.T @ bend + gauge, wanted)
    logs = over + _SRGB
    left = over[stack] - known
    left -= (weight * left).sum(0) / total
    offsets = -(weight * left).sum(1) / weight.sum(1)
    slope = np.maximum(np.gradient(logs), 1e-6)
    off = math.sqrt(float((weight * (left / slope[stack]) ** 2).sum() / weight.sum()))
    return logs, offsets, off


def _stack(files: Sequence[Path]) -> NDArray[np.uint8]:
    """Values (J, N) of the same pixels, in all colours, of all pictures."""
    rows, shape = [], None
    for file in files:
        picture = decode(file)
        refuse(
            picture.shape != (shape or picture.shape),
            f"{file}: must have the size and the channels of the pictures before",
        )
        shape = picture.shape
        values = picture if picture.dtype == np.uint8 else np.rint(picture / 257).astype(np.uint8)
        rows.append(values.ravel()[:: max(1, values.size // _MOST)])
    return np.stack(rows)


def _listed(folder: Path) -> tuple[list[Path], Floats]:
    """Pictures and their exposures, s, from frames.csv (file, exposure_s), or from EXIF, with ISO and f-number."""
    if (folder / _LIST).is_file():
        reader = table_reader(folder / _LIST)
        names = [name.strip() for name in next(reader, [])]
        rows = [dict(zip(names, with_points(cells, reader), strict=False)) for cells in reader if any(cells)]
        try:
            taken = [(folder / inside(row["file"].strip()), float(row["exposure_s"])) for row in rows]
        except (KeyError, TypeError, ValueError, AttributeError):
            raise ValueError(
                f"{folder / _LIST}: must have the columns file and exposure_s (a number)"
            ) from None
    else:
        files = [path for path in sorted(folder.iterdir()) if path.suffix.lower() in _SUFFIXES]
        taken = [(path, _exposure_of(path)) for path in files]
    for path, exposure in taken:
        refuse(
            not 0 < exposure < math.inf,
            f"{path}: the exposure time is missing; add it to EXIF or to {_LIST} (file, exposure_s)",
        )
    return [path for path, _ in taken], np.array([exposure for _, exposure in taken])


def _exposure_of(path: Path) -> float:
    """Exposure time, times ISO over the squared f-number if EXIF has them; NaN without a time."""
    with Image.open(path) as picture:
        tags = picture.getexif().get_ifd(_EXIF)
    time = float(tags.get(_EXPOSURE, math.nan))
    return time * float(tags.get(_ISO) or 100) / 100 / float(tags.get(_F_NUMBER) or 1) ** 2
