"""Names of files and folders, and words in headers: the kind of a frame and its exposure, s.

Capture programs write the kind as words in a name (``DARKFLAT``, ``Flat Field``, ``masterDark``), the exposure as a
number with its unit, with the decimal sign of the computer: ``0.10s``, ``0,1s``, ``60_secs``, ``EXPOSURE-0.001s``.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

_KINDS: Mapping[str, str] = {
    "dark": "dark", "bias": "dark", "flat": "flat", "light": "light", "science": "light",
    "offset": "dark", "zero": "dark",
}  # fmt: skip
"""Kind by word; earlier words count more: a dark flat is dark, a flat through a filter called light is a flat."""
_OF_WHAT = ("twilight", "dome", "sky", "panel", "frame", "field")  # as in SKYFLAT and Flat Field
_AVERAGED = ("master", "super", "stacked", "averaged", "average", "median", "mean", "avg")
_WORDS = rf"(?:{'|'.join([*_OF_WHAT, *_AVERAGED, *_KINDS])})"
_RUN = re.compile(rf"(?<![a-z])(?:{_WORDS}(?:es|s)?)+(?![a-z])")
_OFFSET = re.compile(
    r"(?<=[ _-])(?:offset|zero)[ _-]*\d"
)  # such as _offset50_ of N.I.N.A., in addition to the kind
_UNITS = {"ns": 1e-9, "us": 1e-6, "μs": 1e-6, "usec": 1e-6, "ms": 1e-3, "msec": 1e-3, "s": 1.0, "sec": 1.0,
          "secs": 1.0, "second": 1.0, "seconds": 1.0, "min": 60.0}  # fmt: skip
_EXPOSURE = re.compile(
    r"(?:(?<![a-z\d.,])|(?<=exp)|(?<=exposure)|(?<=time))(?:(0|[1-9]\d{0,3})[_-](?=\d+[ _]?[a-zμ]))?"
    rf"(\d+(?:[.,]\d+)?(?:e[+-]?\d+)?)[ _]?({'|'.join(sorted(_UNITS, key=len, reverse=True))})(?![a-z\d])"
)
_FITS = 0.1  # spread of signal over exposure, below which the light is constant
_NUMBER, _DECIMAL, _FRACTION = range(3)  # the readings of a name


class NamedKind(NamedTuple):
    """Kind of a frame by a name: "dark", "flat", "light" (a picture of something) or "".

    averaged: whether it is an average of frames. of_flats: a dark flat, a dark frame at the exposure of flat ones.

    >>> kind_of("masterDark"), kind_of("portrait").kind
    (NamedKind(kind='dark', averaged=True, of_flats=False), '')
    """

    kind: str
    averaged: bool
    of_flats: bool


def kind_of(name: str) -> NamedKind:
    """The kind by the words of a name.

    >>> kind_of("Flat Dark").kind, kind_of("masterFlat_2").averaged, kind_of("flatfish").kind
    ('dark', True, '')
    """
    text = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", unicodedata.normalize("NFKC", name)).lower()
    words = {word for run in _RUN.finditer(text) for word in re.findall(_WORDS, run[0])}
    if {"dark", "bias", "flat", "light"} & words or _OFFSET.search(text):
        words -= {"offset", "zero"}
    kind = next((_KINDS[word] for word in _KINDS if word in words), "")
    return NamedKind(kind, bool(words & {*_AVERAGED}), {"dark", "flat"} <= words)


class NamedExposure(NamedTuple):
    """An exposure in a name, s: as a number behind another, as a decimal, and as a fraction.

    ``3_10ms`` is number 3 of 10 ms, or 3.10 ms; ``1_250s`` also 1/250 s. digits: the step of the last digit, s.

    >>> exposure_of("flat_10ms").clear, exposure_of("flat_10ms").agrees(0.01)
    (True, True)
    """

    readings: tuple[float, float, float]
    digits: float
    before: str

    @property
    def clear(self) -> bool:
        """Whether there is only one reading."""
        return not self.before

    def agrees(self, exposure_s: float) -> bool:
        """Whether a reading is this exposure, to the precision of its digits."""
        return any(abs(time - exposure_s) <= max(self.digits, 0.01 * exposure_s) for time in self.readings)


def exposure_of(name: str) -> NamedExposure | None:
    """The exposure in a name, or None.

    >>> exposure_of("dark_0,1s_0").readings[0], exposure_of("flat_1_250s").readings[2]
    (0.1, 0.004)
    """
    match = _EXPOSURE.search(unicodedata.normalize("NFKC", name).lower())
    if not match:
        return None
    before, digits, unit = match.groups()
    digits, unit_s = digits.replace(",", "."), _UNITS[unit]
    last = 0.0 if "e" in digits else unit_s * 10.0 ** -len(digits.partition(".")[2])
    number = _times(digits, unit_s)
    if before is None or not digits.isdigit():
        return NamedExposure((number,) * 3, last, "")
    decimal = _times(f"{before}.{digits}", unit_s)
    whole = unit_s == 1 and before == "1" and number > 1
    return NamedExposure((number, decimal, 1 / number if whole else decimal), last, before)


def _times(digits: str, unit_s: float) -> float:
    return float(f"{float(digits) * unit_s:.12g}")


def fitting_reading(exposures: Sequence[NamedExposure], signals: Sequence[float]) -> int | None:
    """Index of the reading with which the light of flat frames is proportional to the exposure, or None.

    signals: of flat frames that do not clip, DN above the dark ones; NaN for other frames. If the number in front is
    the same in all names, it does not count the frames, so it is tried as part of the exposure first.

    >>> exposures = [exposure_of(f"flat_{number}_{number * 10}ms") for number in (1, 2, 3)]
    >>> fitting_reading(exposures, [100.0, 200.0, 300.0])  # the numbers count: 10, 20 and 30 ms
    0
    """
    # A counter differs from frame to frame; a decimal's whole part may be the same in all.
    constant = len({exposure.before for exposure in exposures}) == 1
    light = np.asarray(signals)
    known = light > 0  # nor where it is NaN
    for reading in (_DECIMAL, _FRACTION, _NUMBER) if constant else (_NUMBER, _DECIMAL, _FRACTION):
        times = np.array([exposure.readings[reading] for exposure in exposures])
        if (times > 0).all() and (not known.any() or np.log(light[known] / times[known]).std() < _FITS):
            return reading
    return None
