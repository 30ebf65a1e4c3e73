"""A camera's tone curve, of processed pictures: a bracket of one scene at rest, or the fields of a grey scale.

Domain: pictures of 8 bits (or 16, of which the upper 8 count); light is relative, 1 where the value is 255. Of a
bracket, pixel i in picture j has g(z_ij) = ln E_i + ln T_j with g the logarithm of the light of value z: Debevec &
Malik, Recovering High Dynamic Range Radiance Maps from Photographs, SIGGRAPH 1997, over all pixels, whose E_i are
eliminated. What is smooth is g less that of sRGB, by its second difference.
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
from blurnoise_eval.calibration.frames import Floats, refuse
from blurnoise_eval.calibration.listing import reader_of, with_points
from blurnoise_eval.calibration.structure import Z
from blurnoise_eval.calibration.to_camera import Known
from blurnoise_eval.datasets import decode
from blurnoise_eval.system.files import inside

FEWEST = 3
FEWEST_FIELDS = 3
"""Of a grey scale: two make a straight line."""
_LIST, _SUFFIXES = "frames.csv", (".png", ".jpg", ".jpeg", ".tif", ".tiff")
_EXIF, _EXPOSURE, _F_NUMBER, _ISO = 0x8769, 33434, 33437, 34855
_DARKEST, _BRIGHTEST = 3, 254  # values that are not clipped
_MOST = 200_000  # pixels, evenly chosen
_SMOOTH = 12.0  # values over which the curve may bend
_DARK = 16  # values at both ends that a bracket need not show
_LEAST_SEEN = 128  # values of 256 that two pictures must share
_OFF = 0.05  # of a picture's light, from which its exposure time is doubtful
_VALUES = np.arange(256.0)
_SRGB = np.log(np.maximum(linear_from_srgb(torch.from_numpy(_VALUES / 255)).numpy(), 1e-6))
_AT = np.unique([0, 1, 2, 3, 4, 6, 8, 12, *range(16, 256, 8), 255])  # values of the points


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
    """points: (light, value). text: how they were measured, with what they are known to. doubts: a line each."""

    points: Points
    text: str
    doubts: tuple[str, ...] = ()

    @property
    def known(self) -> Known:
        """As the camera's field."""
        return {"tone": (self.points, "; doubtful: ".join([self.text, *self.doubts]))}


def of(path: Path) -> Tone:
    """The tone curve of a folder with a bracket, or of a grey scale's CSV file (number, light).

    Raises ``ValueError`` naming what is missing or does not fit, ``OSError`` as reading does.
    """
    return _of_bracket(path) if path.is_dir() else _of_scale(path)


def _of_scale(path: Path) -> Tone:
    """Through the fields, in the logarithm of light over sRGB's; beyond them straight."""
    numbers, light = (np.array(each) for each in read_oecf(path))
    full = 255.0 if numbers[-1] < 256 else 65535.0
    values, seen = 255 * numbers / full, light > 0
    over = np.log(light[seen]) - np.interp(values[seen], _VALUES, _SRGB)
    at = np.clip(_VALUES, values[seen][0], values[seen][-1])
    black = float(values[~seen][-1]) if not seen.all() else 0.0
    smooth = PchipInterpolator(values[seen], over)
    logs = smooth(at) + smooth.derivative()(at) * (_VALUES - at) + _SRGB
    logs[black >= _VALUES] = -np.inf
    return Tone(
        _points(logs), f"measured: {len(numbers)} fields of the grey scale {path.name}, smooth between them"
    )


def _of_bracket(folder: Path) -> Tone:
    files, exposures = _listed(folder)
    order = np.argsort(exposures)
    files, times = [files[place] for place in order], np.log(exposures[order])
    refuse(
        len(np.unique(times)) < FEWEST,
        f"{folder}: {len(np.unique(times))} exposures; must be {FEWEST} or more",
    )
    stack = _stack(files)
    logs, offsets, off = _fitted(stack, times)
    overlap = np.bincount(
        stack[:, ((stack >= _DARKEST) & (stack <= _BRIGHTEST)).sum(0) > 1].ravel(), minlength=256
    )
    held = np.flatnonzero(overlap[_DARKEST : _BRIGHTEST + 1]) + _DARKEST
    must = f"must be {_LEAST_SEEN} or more; use a scene with dark and bright areas, exposures one or two stops apart"
    refuse(
        len(held) < _LEAST_SEEN, f"{folder}: two pictures have {len(held)} of 256 values in common; {must}"
    )
    text = f"measured: bracket of {len(files)} pictures, residual {off:.2g} of 255"
    if len(files) > FEWEST:
        others = [
            _fitted(np.delete(stack, place, 0), np.delete(times, place))[0] for place in range(len(files))
        ]
        spread = np.std(np.array(others)[:, held], axis=0) * math.sqrt(len(files) - 1)  # jackknife
        slope = np.gradient(logs)[held]
        text += f", 95 % within {Z * float((spread / slope).max()) / 255:.2g} of white by leaving each out"
    worst, doubts = int(np.abs(offsets).argmax()), list[str]()
    if abs(offsets[worst]) > _OFF:
        off_by = f"{math.expm1(offsets[worst]):+.0%}"
        doubts.append(f"{files[worst].name}: by the curve, its light is {off_by} off its exposure time")
    if held[0] > _DARK or held[-1] < 255 - _DARK:
        doubts.append(f"values below {held[0]} and above {held[-1]} are extrapolated")
    return Tone(_points(logs), text, tuple(doubts))


def _points(logs: Floats) -> Points:
    """Points of the logarithm of light at each value."""
    light = np.maximum.accumulate(np.exp(logs - logs[-1]))
    light[0] = 0.0
    kept = [0]
    for place in _AT[1:]:
        if light[place] > light[kept[-1]]:
            kept.append(int(place))
    kept[-1] = 255
    return tuple((round(float(light[each]), 7), round(each / 255, 5)) for each in kept)


def _fitted(stack: NDArray[np.uint8], times: Floats) -> tuple[Floats, Floats, float]:
    """The logarithm of light at each value, of each picture what it is brighter than its time says, and the residual.

    stack (J, N): values; those that clip do not count, and dark ones, which rounding rules, count little.
    """
    weights = np.where((_VALUES >= _DARKEST) & (_VALUES <= _BRIGHTEST), (_VALUES / 255) ** 2, 0.0)
    each = weights[stack]
    usable = (each > 0).sum(0) > 1
    stack, each = stack[:, usable], each[:, usable]
    total = each.sum(0)
    known = times[:, None] - _SRGB[stack]
    known -= (each * known).sum(0) / total  # the light of a pixel is eliminated
    matrix = np.diag(np.bincount(stack.ravel(), each.ravel(), 256))
    wanted = np.bincount(stack.ravel(), (each * known).ravel(), 256)
    for one, other in combinations_with_replacement(range(len(stack)), 2):
        pair = np.bincount(
            256 * stack[one].astype(int) + stack[other], each[one] * each[other] / total, 1 << 16
        )
        pair = pair.reshape(256, 256)
        matrix -= pair if one == other else pair + pair.T
    bend = np.diff(np.eye(256), 2, axis=0)
    smooth = float(np.trace(matrix)) / 256
    gauge = np.outer(weights, weights) * smooth  # the light's unit is free
    over = np.linalg.solve(matrix + smooth * _SMOOTH**4 / 256 * bend.T @ bend + gauge, wanted)
    logs = over + _SRGB
    left = over[stack] - known
    left -= (each * left).sum(0) / total
    offsets = -(each * left).sum(1) / each.sum(1)
    slope = np.maximum(np.gradient(logs), 1e-6)
    off = math.sqrt(float((each * (left / slope[stack]) ** 2).sum() / each.sum()))
    return logs, offsets, off


def _stack(files: Sequence[Path]) -> NDArray[np.uint8]:
    """The values (J, N) of the same pixels, all colours, of each picture."""
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
    """Pictures and their exposures, s: by frames.csv (file, exposure_s), else by EXIF, with ISO and f-number."""
    if (folder / _LIST).is_file():
        reader = reader_of(folder / _LIST)
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
    """Time times ISO over the square of the f-number, as far as EXIF has them; NaN without a time."""
    with Image.open(path) as picture:
        tags = picture.getexif().get_ifd(_EXIF)
    time = float(tags.get(_EXPOSURE, math.nan))
    return time * float(tags.get(_ISO) or 100) / 100 / float(tags.get(_F_NUMBER) or 1) ** 2
