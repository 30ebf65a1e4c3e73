"""Counts of the converter, recovered from the digital numbers in files.

Drivers store 12 bits in 16 unchanged (arrays of pypylon), times 16 (Mono12 in TIFF and PNG of pylon 26), or stretched
to 65535 by repeating bits (PNG of IDS peak 1.18, gray12le of FFmpeg as gray16). All files of a folder must use one.
Numbers that were stretched by a table or a factor that is no integer stay as they are; they have steps of their own.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.calibration.formats import Plane
from blurnoise_eval.calibration.headers import refuse

_DEPTHS = (8, 10, 12, 14)
_STRETCHED = (16, 14, 12, 10)
_SURE = (
    16  # bits: by chance, 16 numbers are all even once in 2^16, and 4 numbers all multiples of 16 as often
)
_EDGE = 32  # wrapped numbers are within this fraction of the range from its ends
_PILED = 5e-3  # share of the pixels
_OFTEN = 50  # pixels with a number, above which the next number cannot be missing by chance
_NEAR = 16  # largest gap between frequent numbers of one level, unless half of its pixels lie further apart
_DIGITAL = 1.05  # a digital gain may exceed the difference of the gains by this, for rounded dB
MOST_MISSING = 0.05  # share of the numbers between frequent ones that never occur
# many different numbers with a lower byte below _LOW: 14 bits or fewer, with bytes exchanged
_MANY, _LOW = 100, 64


class Scale(NamedTuple):
    """How counts are stored: times ``step``, or stretched from ``bits`` (0: not) to ``of_bits``.

    >>> Scale(step=16).text
    'all numbers are multiples of 16 (counts at the top of the 16 bits?)'
    """

    step: int = 1
    bits: int = 0
    of_bits: int = 16

    def counts(self, plane: Plane) -> Plane:
        """The counts of the converter.

        >>> Scale(step=16).counts(np.array([[160, 4080]], np.uint16)).tolist()
        [[10, 255]]
        """
        if self.bits:
            return np.asarray(np.rint(plane * ((2**self.bits - 1) / (2**self.of_bits - 1))), np.uint16)
        return plane if self.step == 1 else np.asarray(plane // self.step, np.uint16)

    @property
    def apart(self) -> float:
        """Distance of neighbouring numbers, at most."""
        return math.ceil((2**self.of_bits - 1) / (2**self.bits - 1)) if self.bits else self.step

    @property
    def text(self) -> str:
        """In words; "" for unchanged counts."""
        if self.bits:
            return f"numbers are {self.bits} bits stretched to {self.of_bits}, by repeated bits"
        top = " (counts at the top of the 16 bits?)" if self.step in (4, 16, 64, 256) else ""
        return f"all numbers are multiples of {self.step}{top}" if self.step > 1 else ""


class FrameNumbers(NamedTuple):
    """The different numbers of a frame in rising order, without the largest of the type, where drivers clip.

    apart: the least difference of numbers that ``_OFTEN`` pixels have, 0 if there are not two of them.

    >>> FrameNumbers.of("a.png", np.array([[16, 32], [16, 255]], np.uint8)).values.tolist()  # 255 may be clipped
    [16, 32]
    """

    name: str
    values: NDArray[np.uint16]
    apart: int = 0

    @classmethod
    def of(cls, name: str, plane: Plane) -> FrameNumbers:
        """The numbers of a frame of this name."""
        counts = np.bincount(plane.ravel())[: np.iinfo(plane.dtype).max]
        often = np.diff(np.flatnonzero(counts >= _OFTEN))
        return cls(
            name, np.flatnonzero(counts).astype(np.uint16), int(often.min(initial=1 << 16)) % (1 << 16)
        )


def scale_of(frames: Sequence[FrameNumbers]) -> Scale:
    """The scale of all frames of one gain. Raises ``ValueError`` if their scales differ, or the bytes of
    their numbers are exchanged (or 8 bits were widened, as by FFmpeg for colours: 255 is 65283).

    >>> scale_of([FrameNumbers("a.png", np.arange(0, 65520, 16).astype(np.uint16))])
    Scale(step=16, bits=0, of_bits=16)
    """
    every = np.unique(np.concatenate([frame.values for frame in frames]))
    swapped = len(every) > _MANY and 0 < (every & 255).max() < _LOW and every.max() > 255
    seen = "numbers have their two bytes exchanged, or are 8 bits widened to about 256 times their value"
    refuse(swapped, f"{frames[0].name}: {seen}; must be little-endian, 8 bits as they were")
    whole = _of(every)
    # Bright numbers of a table are further apart than dark ones, never nearer.
    finest = max(whole.apart, min(int(np.diff(frame.values).min(initial=65535)) for frame in frames))
    for frame in frames:
        scale, count = _of(frame.values), len(frame.values)
        sure = count > 2 and (scale.bits or count * math.log2(scale.step) >= _SURE)
        sure = sure or frame.apart == scale.step  # noise has all numbers between two frequent ones
        if sure and (scale.step > finest or (scale.bits and not whole.bits)):
            other = next((one.name for one in frames if _of(one.values) != scale), "others")
            must = "save all frames with one program in one format"
            raise ValueError(f"{frame.name}: {scale.text}, unlike those of {other}; {must}")
    return whole


def common_scale(scales: Mapping[float, Scale]) -> Scale:
    """The scale of all gains, by gain in dB. A digital gain multiplies the steps of the frames with more gain.

    Raises ``ValueError`` where the steps differ by more than the gains do.

    >>> common_scale({0.0: Scale(step=16), 12.0: Scale(step=64)})
    Scale(step=16, bits=0, of_bits=16)
    """
    every = set(scales.values())
    if len(every) == 1:
        return every.pop()
    common, lowest_db = math.gcd(*(scale.step for scale in every)), min(scales)
    for gain_db, scale in scales.items():
        gained = _DIGITAL * 10 ** ((gain_db - lowest_db) / 20)
        other = next(at for at in scales if scales[at] != scale)
        unlike = f"frames at {gain_db:g} dB: {scale.text}, unlike those at {other:g} dB"
        refuse(
            scale.bits or scale.step > common * gained,
            f"{unlike}; save all frames with one program in one format",
        )
    return Scale(common)


def _of(numbers: NDArray[np.uint16]) -> Scale:
    step = int(np.gcd.reduce(numbers)) if len(numbers) else 0
    if step == 1 and len(numbers) >= _SURE:
        values = numbers.astype(np.float64)
        for bits, of_bits in product(_DEPTHS, _STRETCHED):
            full, top = 2**bits - 1, 2**of_bits - 1
            # repeated bits are the share of the largest number, rounded down; other numbers are anywhere
            near = np.abs(values - np.rint(values * full / top) * top / full) < 1
            if of_bits - bits > 1 and numbers[-1] <= top and near.all():
                return Scale(bits=bits, of_bits=of_bits)
    return Scale(max(1, step))


def check_wrapped(name: str, plane: Plane) -> None:
    """Raise ``ValueError`` for a dark frame whose numbers below 0 have wrapped to the largest.

    >>> check_wrapped("dark.png", np.full((8, 8), 100, np.uint16))  # raises where numbers below 0 have wrapped
    """
    top = np.iinfo(plane.dtype).max
    below, above = plane < top // _EDGE, plane > top - top // _EDGE
    low, high = np.mean(below), np.mean(above & (plane < top))  # hot pixels are at the top itself
    wrapped = min(low, high) > _PILED and np.mean(below | above) > 1 - _PILED
    must = f"{high:.2g} of its numbers wrap around below 0; must be raw, without a dark frame subtracted"
    refuse(wrapped, f"{name}: {must}")


def missing_numbers(counts: Sequence[NDArray[np.int64]]) -> tuple[int, int]:
    """How many numbers never occur, and how many could, between numbers that ``_OFTEN`` pixels of a level have.

    counts: pixels by number, of each level; the numbers of a level lie around one mean.

    >>> missing_numbers([np.array([0, 90, 0, 90, 0, 90])])  # only odd numbers
    (2, 4)
    """
    gaps = np.concatenate([_gaps(level)[1] for level in counts])
    return int((gaps - 1).sum()), int(gaps.sum())


def step_of(counts: NDArray[np.int64]) -> float:
    """How far the numbers of a level are apart, RMS over its pixels; 1 unless numbers are missing.

    counts: pixels by number.

    >>> step_of(np.array([0, 90, 0, 0, 200, 0, 0, 90, 0]))
    3.0
    """
    numbers, gaps = _gaps(counts)
    if (gaps - 1).sum() <= MOST_MISSING * gaps.sum():
        return 1.0
    pixels = counts[numbers] + counts[numbers + gaps]
    return math.sqrt(float((pixels * gaps**2).sum() / pixels.sum()))


def _gaps(counts: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The numbers of a level that occur, between frequent ones, and how far the next one is."""
    often, occurs, total = np.flatnonzero(counts >= _OFTEN), np.flatnonzero(counts), np.cumsum(counts)
    half = int(np.diff(np.searchsorted(total, (total[-1] / 4, 3 * total[-1] / 4)))[0])
    near = np.diff(often) <= max(_NEAR, half)
    following = np.searchsorted(often, occurs[:-1], "right")  # the frequent number above, by its place
    between = (following > 0) & (following < len(often))
    between[between] &= near[following[between] - 1]
    return occurs[:-1][between], np.diff(occurs)[between]
