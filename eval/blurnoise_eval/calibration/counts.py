"""Counts: a converter's numbers, told from the numbers that a file holds, and which of those can occur.

Drivers store 12 bits in 16 as they are (pypylon's arrays), times 16 (Mono12 in the TIFF and PNG of pylon 26), or
stretched to 65535 by repeating bits (IDS peak 1.18's PNG, FFmpeg's gray12le as gray16). A folder has one of these.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.calibration.formats import Plane, refuse

_DEPTHS = (8, 10, 12, 14)
_SURE = 16  # bits of chance: of 16 numbers one in 2^16 has only even ones, of 4 only multiples of 16
_EDGE = 32  # part of the range that a wrapped number is from its end
_PILED = 5e-3
_OFTEN = 50  # pixels that hold a number, from which on the next one cannot be missing
_NEAR = 16
_MANY, _LOW = (
    100,
    64,
)  # unlike numbers whose lower byte is below this: 14 bits or fewer with their bytes exchanged


class Scale(NamedTuple):
    """How counts are stored: times ``step``, or stretched from ``bits`` to 16, 0 where they are not."""

    step: int = 1
    bits: int = 0

    def counts(self, plane: Plane) -> Plane:
        """The converter's counts of a file's numbers."""
        if self.bits:
            return np.asarray(np.rint(plane * ((2**self.bits - 1) / 65535)), np.uint16)
        return plane if self.step == 1 else np.asarray(plane // self.step, np.uint16)

    @property
    def text(self) -> str:
        """For a note or an error; "" for counts as they are."""
        if self.bits:
            return f"numbers are {self.bits} bits stretched to 16, by repeated bits"
        top = " (counts at the top of the 16 bits?)" if self.step in (4, 16, 64, 256) else ""
        return f"all numbers are multiples of {self.step}{top}" if self.step > 1 else ""


class Numbers(NamedTuple):
    """The numbers that a frame holds, rising, but for the greatest of its type, at which drivers clip."""

    name: str
    values: NDArray[np.uint16]

    @classmethod
    def by(cls, name: str, plane: Plane) -> Numbers:
        """Of a frame."""
        top = np.iinfo(plane.dtype).max
        return cls(name, np.flatnonzero(np.bincount(plane.ravel())[:top]).astype(np.uint16))


def scale_of(frames: Sequence[Numbers]) -> Scale:
    """The scale of frames at one gain. Raises ``ValueError`` where some are stored in another one, or their bytes are
    in the wrong order."""
    every = np.unique(np.concatenate([frame.values for frame in frames]))
    swapped = len(every) > _MANY and 0 < (every & 255).max() < _LOW and every.max() > 255
    refuse(swapped, f"{frames[0].name}: numbers have their two bytes exchanged; must be little-endian")
    whole = _of(every)
    for frame in frames if not whole.bits else ():
        own, count = _of(frame.values), len(frame.values)
        own = own if count > 2 and (own.bits or count * math.log2(own.step) >= _SURE) else whole
        if own.step > whole.step or (own.bits and not whole.bits):
            other = next(each.name for each in frames if _of(each.values) != own)
            must = "save all frames with one program in one format"
            raise ValueError(f"{frame.name}: {own.text}, unlike those of {other}; {must}")
    return whole


def together(scales: Iterable[Scale]) -> Scale:
    """The one of all gains."""
    every = set(scales)
    bits = {scale.bits for scale in every}
    return (
        Scale(bits=bits.pop())
        if len(bits) == 1 and 0 not in bits
        else Scale(math.gcd(*(scale.step for scale in every)))
    )


def _of(numbers: NDArray[np.uint16]) -> Scale:
    step = int(np.gcd.reduce(numbers)) if len(numbers) else 0
    if step == 1 and len(numbers) >= _SURE:
        values = numbers.astype(np.float64)
        for bits in _DEPTHS:
            full = 2**bits - 1
            # repeated bits are the share of 65535, cut; numbers of all 16 bits lie anywhere
            if (np.abs(values - np.rint(values * full / 65535) * 65535 / full) < 1).all():
                return Scale(bits=bits)
    return Scale(max(1, step))


def check_wrapped(name: str, plane: Plane) -> None:
    """Raise ``ValueError`` for a dark frame whose numbers below 0 have wrapped to the greatest."""
    top = np.iinfo(plane.dtype).max
    below, above = plane < top // _EDGE, plane > top - top // _EDGE
    low, high = np.mean(below), np.mean(above & (plane < top))  # at the top itself are hot pixels
    wrapped = min(low, high) > _PILED and np.mean(below | above) > 1 - _PILED
    must = f"{high:.2g} of its numbers wrap around below 0; must be raw, without a dark frame subtracted"
    refuse(wrapped, f"{name}: {must}")


def missing(counts: Sequence[NDArray[np.int64]]) -> tuple[int, int]:
    """How many numbers never occur, and how many could, between those that ``_OFTEN`` pixels of a level hold.

    counts: pixels by number, of each level, whose numbers lie around one mean.
    """
    never = could = 0
    for each in counts:
        often = np.flatnonzero(each >= _OFTEN)
        gaps = np.diff(often)
        for start, gap in zip(often[:-1], gaps, strict=True):
            inside = each[start + 1 : start + gap]
            never += int((inside == 0).sum()) if gap <= _NEAR else 0
        could += int(gaps[gaps <= _NEAR].sum())
    return never, could
