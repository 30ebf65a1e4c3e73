"""Tone curve of a camera, from processed pictures: a bracket of one static scene, or the fields of a grey scale.

Domain: pictures of 8 bits (or the upper 8 of 16); light is relative, 1 where pictures clip. A bracket's curve is
fitted by :mod:`.response`. Pictures that moved (:mod:`.steady`) or do not fit their exposure are left out by name.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from blurnoise._core.files import read_samples
from blurnoise.camera.colour import Points
from blurnoise_eval.calibration.bracket import listed
from blurnoise_eval.calibration.frames import Floats
from blurnoise_eval.calibration.headers import refuse
from blurnoise_eval.calibration.response import (
    BRIGHTEST,
    DARKEST,
    SRGB,
    VALUES,
    ToneResponse,
    Values,
    fit_response,
)
from blurnoise_eval.calibration.steady import MOST_PX, displacements_px
from blurnoise_eval.calibration.to_camera import Known
from blurnoise_eval.calibration.uncertain import Z
from blurnoise_eval.datasets import decode

FEWEST = 3
FEWEST_FIELDS = 3
"""Fewest fields of a grey scale; two would be a straight line."""
_MOST = 20_000  # values of a picture, at equal distances
_ENDS = 16  # values at both ends that a bracket need not contain
_LEAST_COMMON = 128  # values of 256 that two pictures must share
_OFF = 0.05  # relative error of the light of a picture above which its exposure time is doubtful
_MOST_OFF = 0.25  # above which there is no curve
_MOST_RESIDUAL = 8.0  # values; JPEG files of real cameras have 1 to 4
_MOST_SPREAD_EV, _WIDE_SPREAD_EV = (
    1.0,
    0.4,
)  # refused, doubted: of the interval of the stops between 128 and 16
_DARK, _MIDDLE = 16, 128
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
    """A tone curve. points: (light, value). text: how it was measured, with its uncertainty. doubts: a line each.

    Of a bracket also: names of the pictures that count, in rising order of exposure, which those of ``response``
    (with the residual of each) are; left_out: a line for each picture that does not count, and why.
    """

    points: Points
    text: str
    doubts: tuple[str, ...] = ()
    response: ToneResponse | None = None
    names: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()

    @property
    def known(self) -> Known:
        """The field of a camera, with its source."""
        notes = "; ".join([self.text, *(f"left out: {each}" for each in self.left_out)])
        return {"tone": (self.points, "; doubtful: ".join([notes, *self.doubts]))}


def measure_tone(path: Path) -> Tone:
    """Measure a tone curve from a folder with a bracket, or from the CSV file of a grey scale (number, light).

    Raises ``ValueError`` for missing or wrong data, ``OSError`` as reading does.
    """
    if not path.is_dir():
        return _of_scale(path)
    shots, pictures, shape = listed(path), [], None
    for shot in shots:
        picture = decode(shot.file)
        must = "must have the size and the channels of the pictures before"
        refuse(picture.shape != (shape or picture.shape), f"{shot.file}: {must}")
        shape = picture.shape
        pictures.append(np.rint(picture / (1 if picture.dtype == np.uint8 else 257)).astype(np.uint8))
    exposures = np.array([shot.exposure for shot in shots])
    return fit_tone(pictures, exposures, [shot.name for shot in shots], str(path))


def _of_scale(path: Path) -> Tone:
    """A curve through the fields, in the logarithm of light relative to sRGB; straight beyond them."""
    numbers, light = map(np.array, read_oecf(path))
    full = 255.0 if numbers[-1] < 256 else 65535.0
    values, lit = 255 * numbers / full, light > 0
    over = np.log(light[lit]) - np.interp(values[lit], VALUES, SRGB)
    at = np.clip(VALUES, values[lit][0], values[lit][-1])
    black = float(values[~lit][-1]) if not lit.all() else 0.0
    smooth = PchipInterpolator(values[lit], over)
    logs = smooth(at) + smooth.derivative()(at) * (VALUES - at) + SRGB
    logs[black >= VALUES] = -np.inf
    return Tone(
        _points(logs), f"measured: {len(numbers)} fields of the grey scale {path.name}, smooth between them"
    )


def fit_tone(
    pictures: Sequence[NDArray[np.uint8]],
    exposures: Floats | Sequence[float],
    names: Sequence[str],
    about: str = "bracket",
) -> Tone:
    """Fit a tone curve to pictures (H, W) or (H, W, 3) of 8 bits of one still scene, in any order.

    Of colours green counts: in bright ones, cameras pull red and blue towards white. exposures: of each picture, in
    any unit (time times ISO over the squared f-number). names: of the pictures, for what is said of them. about: the
    bracket's name in errors. A picture that has moved (:mod:`.steady`), or whose light does not fit its exposure
    while that of the others does, is left out. Raises ``ValueError`` where too little is left, and where residual or
    interval allow no curve.
    """
    order = np.argsort(exposures, kind="stable")
    times = np.log(np.asarray(exposures, float)[order])
    pictures, names = [pictures[index] for index in order], [names[index] for index in order]
    different = len(np.unique(times))
    refuse(different < FEWEST, f"{about}: {different} exposures; must be {FEWEST} or more")
    planes = [picture if picture.ndim == 2 else picture[..., 1] for picture in pictures]
    stack = np.stack([plane.ravel()[:: max(1, plane.size // _MOST)] for plane in planes])
    fit = fit_response(stack, times)
    _check_common(about, stack, fit.top)
    moved = np.abs(displacements_px(planes, fit)).max(1)
    still = moved <= MOST_PX
    gone = [f"{names[index]}: moved by {moved[index]:.0f} px" for index in np.flatnonzero(~still)]
    must = "must stand still; a tripod is needed"
    refuse(2 * len(gone) >= len(names) or still.sum() < FEWEST, f"{about}: {', '.join(gone)}; {must}")
    keep = np.flatnonzero(still)
    if gone:
        fit = fit_response(stack[keep], times[keep])
    keep, fit, wrong = _without_wrong(stack, times, keep, fit)
    gone += [f"{names[index]}: its light is {off:+.0%} off its exposure time" for index, off in wrong]
    tone = replace(_checked(about, fit, len(keep)), names=tuple(names[index] for index in keep))
    low, high = _common(stack[keep], fit.top)
    doubts = list(tone.doubts)
    if low > _ENDS or high < fit.top - _ENDS:
        doubts.append(f"values below {low} and above {high} are extrapolated")
    return replace(tone, doubts=tuple(doubts), left_out=tuple(gone))


def _without_wrong(
    stack: Values, times: Floats, keep: NDArray[Any], fit: ToneResponse
) -> tuple[NDArray[Any], ToneResponse, list[tuple[int, float]]]:
    """Leave out pictures whose light does not fit their exposure, one by one: those without which the others fit.

    Returns the pictures that are left, their response, and (picture, relative error of its light) of the others.
    """
    wrong: list[tuple[int, float]] = []
    while np.nanmax(np.abs(fit.offsets)) > _OFF and len(keep) > FEWEST and 4 * len(wrong) < len(times):
        fits = [
            fit_response(*(np.delete(each[keep], out, 0) for each in (stack, times)), spread=False)
            for out in range(len(keep))
        ]
        most = max(_OFF, float(np.nanmax(np.abs(fit.offsets))) / 3)
        agree = [out for out, each in enumerate(fits) if np.nanmax(np.abs(each.offsets)) <= most]
        if not agree:
            break
        # Offsets agree without a right neighbour, too: the curve then bends to the wrong picture, which leaves more.
        out = min(agree, key=lambda each: float(np.nanmedian(fits[each].residuals)))
        index, keep = int(keep[out]), np.delete(keep, out)
        fit = fit_response(stack[keep], times[keep])
        alone = fit.light_of(stack[index : index + 1], times[index : index + 1])
        off = np.nanmedian(alone - fit.light_of(stack[keep], times[keep]))
        wrong.append((index, math.expm1(off)))
    return keep, fit, wrong


def _checked(about: str, fit: ToneResponse, pictures: int) -> Tone:
    """The tone curve of a response. Raises ``ValueError`` where it is none."""
    residual, off = float(np.nanmedian(fit.residuals)), float(np.nanmax(np.abs(fit.offsets)))
    must = "must be pictures of one still scene under one light, with one tone curve and their own exposure times"
    refuse(residual > _MOST_RESIDUAL, f"{about}: residual {residual:.2g} of 255; {must}")
    refuse(
        off > _MOST_OFF, f"{about}: light and exposure times differ by up to {math.expm1(off):.0%}; {must}"
    )
    spread = _ev(Z * fit.spread[_DARK])
    few = "use more exposures, one or two stops apart"
    refuse(spread > _MOST_SPREAD_EV, f"{about}: the curve is known to {spread:.1f} stops only; {few}")
    stops = _ev(fit.logs[_MIDDLE] - fit.logs[_DARK])
    text = f"measured: bracket of {pictures} pictures, residual {residual:.2g} of 255, {stops:.2f}"
    text += f" ± {spread:.2f} stops" if math.isfinite(spread) else " stops"
    text += f" from value {_MIDDLE} to {_DARK}"
    if fit.top < BRIGHTEST:
        text += f", clipped areas from value {fit.top + 1} on left out"
    wide = f"the curve is known to {spread:.1f} stops only; {few}"
    doubts = [wide] if spread > _WIDE_SPREAD_EV else []
    doubts += [f"light and exposure times differ by up to {math.expm1(off):.0%}"] if off > _OFF else []
    return Tone(_points(fit.logs, fit.top, fit.clip), text, tuple(doubts), fit)


def _ev(logs: float) -> float:
    return float(logs / math.log(2))


def _common(stack: Values, top: int) -> tuple[int, int]:
    """The lowest and the highest value that pixels have which two pictures show unclipped."""
    counts = np.flatnonzero(_shared(stack, top)[DARKEST : top + 1]) + DARKEST
    return int(counts[0]), int(counts[-1])


def _check_common(about: str, stack: Values, top: int) -> None:
    count = np.count_nonzero(_shared(stack, top)[DARKEST : top + 1])
    must = f"must be {_LEAST_COMMON} or more; use a scene with dark and bright areas"
    must += ", exposures one or two stops apart"
    refuse(count < _LEAST_COMMON, f"{about}: two pictures have {count} of 256 values in common; {must}")


def _shared(stack: Values, top: int) -> NDArray[Any]:
    """How often each value (256,) occurs among pixels that two pictures show unclipped."""
    twice = ((stack >= DARKEST) & (stack <= top)).sum(0) > 1
    return np.bincount(stack[:, twice].ravel(), minlength=256)


def _points(logs: Floats, top: int = BRIGHTEST, clip: float = 255.0) -> Points:
    """Points (light, value) of the curve from the logarithm of light at each value up to top; 1 is light of clip."""
    light = np.maximum.accumulate(np.exp(np.minimum(logs - (0.0 if top < BRIGHTEST else logs[-1]), 0.0)))
    light[0] = 0.0
    rising = [0]
    for value in _POINTS[1:]:
        if light[value] > light[rising[-1]] and value <= top and light[value] < 1:
            rising.append(int(value))
    points = [(round(float(light[value]), 7), round(value / 255, 5)) for value in rising]
    return (*points, (1.0, round(clip / 255, 5)))
