"""Flags of a slanted edge: what can be wrong with it, each by a name that travels with the numbers."""

from __future__ import annotations

from collections.abc import Iterable
from enum import Enum


class Flag(Enum):
    """A reason to doubt a measured edge; those of ``WITHHELD`` leave no number at all."""

    NOT_FINITE = "the region holds NaN or Inf"
    CLIPPED = "more than 0.5 % of the pixels stand at black or at full scale"
    NO_EDGE = "no step stands out of the noise"
    TWO_EDGES = "more than one edge, or other structure, beside the edge"
    EDGE_LEAVES_REGION = "the edge does not cross the region from end to end"
    REGION_TOO_SMALL = "no flat level beside the edge: the blur fills the region"
    TOO_FEW_PHASES = "the rows cut the edge at too few positions within a pixel"
    NEVER_REACHES_50 = "the response stays above 50 % up to 1 cycle/px"
    NOISE_DOMINATED = "noise moves MTF50 by more than 10 % (one standard deviation)"
    SHARPENED = "the edge overshoots its sides, or noise alternates, which no lens does: sharpening"
    TWO_HUMPS = "the line spread has two humps: two edges side by side, or motion that lingers"
    TOO_ABRUPT = "the edge is sharper than its pixels allow: clipped, or sharpened and cut"
    DISPLACED = "rows are displaced against each other: jitter, which lowers the response"
    SMOOTHED = (
        "the edge is noisier than its sides allow: denoised, compressed, clipped, or after a tone curve"
    )
    NOISE_CORRELATED = "noise is correlated over too many rows for its intervals: columns, or a strong filter"
    WINDOW_CUTS = "the standard's window cuts into the blur; the region should be wider"
    NON_LINEAR_SUSPECTED = (
        "the edge is lopsided, or its bright side quieter: clipping, a tone curve, shifted colours"
    )


WITHHELD = frozenset(
    {
        Flag.NOT_FINITE,
        Flag.CLIPPED,
        Flag.NO_EDGE,
        Flag.TWO_EDGES,
        Flag.EDGE_LEAVES_REGION,
        Flag.REGION_TOO_SMALL,
    }
)
"""With one of these the response cannot be told, and every number is NaN."""


def words(flags: Iterable[Flag]) -> frozenset[str]:
    """The flags' names as words_in_lower_case, as an :class:`~blurnoise.metrics.estimate.Estimate` holds them."""
    return frozenset(flag.name.lower() for flag in flags)
