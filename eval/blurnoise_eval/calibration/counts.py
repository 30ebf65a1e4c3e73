"""Counts of the converter, recovered from the digital numbers in files.

Drivers store 12 bits in 16 unchanged (arrays of pypylon), times 16 (Mono12 in TIFF and PNG of pylon 26), or stretched
to 65535 by repeating bits (PNG of IDS peak 1.18, gray12le of FFmpeg as gray16). All files of a folder must use one.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.calibration.formats import Plane
from blurnoise_eval.calibration.headers import refuse

_DEPTHS = (8, 10, 12, 14)
_SURE = (
    16  # bits: by chance, 16 numbers are all even once in 2^16, and 4 numbers all multiples of 16 as often
)
_EDGE = 32  # wrapped numbers are within this fraction of the range from its ends
_PILED = 5e-3  # share of the pixels
_OFTEN = 50  # pixels with a number, above which the next number cannot be missing by chance
_NEAR = 16  # largest gap between frequent numbers of one level
# many different numbers with a lower byte below _LOW: 14 bits or fewer, with bytes exchanged
_MANY, _LOW = 100, 64


class Scale(NamedTuple):
    """How counts are stored: times ``step``, or stretched from ``bits`` (0: not) to 16.

    >>> Scale(step=16).text
    'all numbers are multiples of 16 (counts at the top of the 16 bits?)'
    """

    step: int = 1
    bits: int = 0

    def counts(self, plane: Plane) -> Plane:
        """The counts of the converter.

        >>> Scale(step=16).counts(np.array([[160, 4080]], np.uint16)).tolist()
        [[10, 255]]
        """
        if self.bits:
            return np.asarray(np.rint(plane * ((2**self.bits - 1) / 65535)), np.uint16)
        return plane if self.step == 1 else np.asarray(plane // self.step, np.uint16)

    @property
    def text(self) -> str:
        """In words; "" for unchanged counts."""
        if self.bits:
            return f"numbers are {self.bits} bits stretched to 16, by repeated bits"
        top = " (counts at the top of the 16 bits?)" if self.step in (4, 16, 64, 256) else ""
        return f"all numbers are multiples of {self.step}{top}" if self.step > 1 else ""


class FrameNumbers(NamedTuple):
    """The different numbers of a frame in rising order, without the largest of the type, where drivers clip.

    >>> FrameNumbers.of("a.png", np.array([[16, 32], [16, 255]], np.uint8)).values.tolist()  # 255 may be clipped
    [16, 32]
    """

    name: str
    values: NDArray[np.uint16]

    @classmethod
    def of(cls, name: str, plane: Plane) -> FrameNumbers:
        """The numbers of a frame of this name."""
        top = np.iinfo(plane.dtype).max
        return cls(name, np.flatnonzero(np.bincount(plane.ravel())[:top]).astype(np.uint16))


def scale_of(frames: Sequence[FrameNumbers]) -> Scale:
    """The scale of all frames of one gain. Raises ``ValueError`` if their scales differ, or the bytes of
    their numbers are exchanged.

    >>> scale_of([FrameNumbers("a.png", np.arange(0, 65520, 16).astype(np.uint16))])
    Scale(step=16, bits=0)
    """
    every = np.unique(np.concatenate([frame.values for frame in frames]))
    swapped = len(every) > _MANY and 0 < (every & 255).max() < _LOW and every.max() > 255
    refuse(swapped, f"{frames[0].name}: numbers have their two bytes exchanged; must be little-endian")
    whole = _of(every)
    for frame in frames if not whole.bits else ():
        scale, count = _of(frame.values), len(frame.values)
        sure = count > 2 and (scale.bits or count * math.log2(scale.step) >= _SURE)
        if sure and (scale.step > whole.step or (scale.bits and not whole.bits)):
            other = next(one.name for one in frames if _of(one.values) != scale)
            must = "save all frames with one program in one format"
            raise ValueError(f"{frame.name}: {scale.text}, unlike those of {other}; {must}")
    return whole


def common_scale(scales: Iterable[Scale]) -> Scale:
    """The scale of all gains.

    >>> common_scale([Scale(step=16), Scale(step=64)])
    Scale(step=16, bits=0)
    """
    every = set(scales)
    bits = {scale.bits for scale in every}
    if len(bits) == 1 and 0 not in bits:
        return Scale(bits=bits.pop())
    return Scale(math.gcd(*(scale.step for scale in every)))


def _of(numbers: NDArray[np.uint16]) -> Scale:
    step = int(np.gcd.reduce(numbers)) if len(numbers) else 0
    if step == 1 and len(numbers) >= _SURE:
        values = numbers.astype(np.float64)
        for bits in _DEPTHS:
            full = 2**bits - 1
            # repeated bits are the share of 65535, rounded down; numbers of 16 bits are anywhere
            if (np.abs(values - np.rint(values * full / 65535) * 65535 / full) < 1).all():
                return Scale(bits=bits)
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
    never = possible = 0
    for level in counts:
        often = np.flatnonzero(level >= _OFTEN)
        gaps = np.diff(often)
        for start, gap in zip(often[:-1], gaps, strict=True):
            between = level[start + 1 : start + gap]
            never += int((between == 0).sum()) if gap <= _NEAR else 0
        possible += int(gaps[gaps <= _NEAR].sum())
    return never, possible
