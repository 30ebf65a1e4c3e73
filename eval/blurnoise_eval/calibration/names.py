"""Names: the kind of a frame and its exposure, s, by the names of files and folders, and by headers' own words.

Capture programs write the kind as words of one name (``DARKFLAT``, ``Flat Field``, ``masterDark``), the exposure as a
number with its unit, by the computer's own decimal sign: ``0.10s``, ``0,1s``, ``60_secs``, ``EXPOSURE-0.001s``.
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
"""By word, the one that counts more first: a dark flat is dark, a flat through a filter called light a flat."""
_OF_WHAT = ("twilight", "dome", "sky", "panel", "frame", "field")  # as in SKYFLAT and Flat Field
_AVERAGED = ("master", "super", "stacked", "averaged", "average", "median", "mean", "avg")
_WORDS = rf"(?:{'|'.join([*_OF_WHAT, *_AVERAGED, *_KINDS])})"
_RUN = re.compile(rf"(?<![a-z])(?:{_WORDS}(?:es|s)?)+(?![a-z])")
_OFFSET = re.compile(r"(?<=[ _-])(?:offset|zero)[ _-]*\d")  # N.I.N.A.'s _offset50_, beside the kind
_UNITS = {"ns": 1e-9, "us": 1e-6, "μs": 1e-6, "usec": 1e-6, "ms": 1e-3, "msec": 1e-3, "s": 1.0, "sec": 1.0,
          "secs": 1.0, "second": 1.0, "seconds": 1.0, "min": 60.0}  # fmt: skip
_EXPOSURE = re.compile(
    r"(?:(?<![a-z\d.,])|(?<=exp)|(?<=exposure)|(?<=time))(?:(0|[1-9]\d{0,3})[_-](?=\d+[ _]?[a-zμ]))?"
    rf"(\d+(?:[.,]\d+)?(?:e[+-]?\d+)?)[ _]?({'|'.join(sorted(_UNITS, key=len, reverse=True))})(?![a-z\d])"
)
_FITS = 0.1  # spread of signal over exposure, below which exposures are those of the light
WAYS = ("number", "decimal", "fraction")


class Kind(NamedTuple):
    """What a name says: "dark", "flat", "light" (a picture of something) or "", and whether it is an average of
    frames. of_flats: a dark flat, a dark frame at the exposure of flat ones."""

    kind: str
    averaged: bool
    of_flats: bool


def kind_of(name: str) -> Kind:
    """The kind by the words of a name.

    >>> kind_of("Flat Dark").kind, kind_of("masterFlat_2").averaged, kind_of("flatfish").kind
    ('dark', True, '')
    """
    text = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", unicodedata.normalize("NFKC", name)).lower()
    words = {word for run in _RUN.finditer(text) for word in re.findall(_WORDS, run[0])}
    if {"dark", "bias", "flat", "light"} & words or _OFFSET.search(text):
        words -= {"offset", "zero"}
    kind = next((_KINDS[word] for word in _KINDS if word in words), "")
    return Kind(kind, bool(words & {*_AVERAGED}), {"dark", "flat"} <= words)


class Exposure(NamedTuple):
    """Readings of an exposure in a name, s, by ``WAYS``; digits: the step of its last digit, s.

    ``3_10ms`` is number 3 of 10 ms, or 3.10 ms; ``1_250s`` also 1/250 s.
    """

    readings: tuple[float, float, float]
    digits: float
    before: str

    @property
    def clear(self) -> bool:
        """Whether there is one reading only."""
        return not self.before

    def agrees(self, exposure_s: float) -> bool:
        """Whether a reading is this exposure, rounded to its digits."""
        return any(abs(each - exposure_s) <= max(self.digits, 0.01 * exposure_s) for each in self.readings)


def exposure_of(name: str) -> Exposure | None:
    """The exposure in a name, None without.

    >>> exposure_of("dark_0,1s_0").readings[0], exposure_of("flat_1_250s").readings[2]
    (0.1, 0.004)
    """
    found = _EXPOSURE.search(unicodedata.normalize("NFKC", name).lower())
    if not found:
        return None
    before, digits, unit = found.groups()
    digits, unit_s = digits.replace(",", "."), _UNITS[unit]
    last = 0.0 if "e" in digits else unit_s * 10.0 ** -len(digits.partition(".")[2])
    number = _times(digits, unit_s)
    if before is None or not digits.isdigit():
        return Exposure((number,) * 3, last, "")
    decimal = _times(f"{before}.{digits}", unit_s)
    whole = unit_s == 1 and before == "1" and number > 1
    return Exposure((number, decimal, 1 / number if whole else decimal), last, before)


def _times(digits: str, unit_s: float) -> float:
    return float(f"{float(digits) * unit_s:.12g}")


def way_of(exposures: Sequence[Exposure], signals: Sequence[float]) -> str | None:
    """The reading with which the light of flat frames grows with the exposure; None where there is none.

    signals: of flat frames that do not clip, DN above the dark ones; NaN of other frames. A number before that is the
    same in all names numbers nothing.
    """
    constant = len({each.before for each in exposures}) == 1
    light = np.asarray(signals)
    known = light > 0  # nor where it is NaN
    for way in ("decimal", "fraction", "number") if constant else WAYS:
        times = np.array([each.readings[WAYS.index(way)] for each in exposures])
        if (times > 0).all() and (not known.any() or np.log(light[known] / times[known]).std() < _FITS):
            return way
    return None
