"""The captures of an HDR picture: when each is taken, and how much light it gathers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Annotated

from blurnoise._core.checks import shown
from blurnoise._core.fields import Figure, check_fields, within

_ROUNDING = 1e-9  # of the first exposure: windows that meet do not overlap


@dataclass(frozen=True)
class Capture:
    """One capture of an HDR picture; the first capture, the most sensitive one, is the reference.

    exposure_ratio: T_1 / T_k. sensitivity: electrons per light and time, relative to the camera (split pixels).
    gain_db: analogue, see :meth:`Camera.at_gain`. start_s: from the start of the first capture; None: at the end of
    the previous one. Raises ``TypeError`` or ``ValueError``.

    >>> Capture(exposure_ratio=16)
    Capture(exposure_ratio=16.0, sensitivity=1.0, gain_db=0.0, start_s=None)
    """

    exposure_ratio: Annotated[Figure, within("exposure_ratio")] = 1.0
    sensitivity: Annotated[Figure, within("sensitivity")] = 1.0
    gain_db: Annotated[Figure, within("gain_db")] = 0.0
    start_s: Annotated[Figure, within("start_s")] | None = None

    def __post_init__(self) -> None:
        check_fields(self)


def staggered(*ratios: float) -> tuple[Capture, ...]:
    """A capture followed by shorter ones, by exposure ratio: ``staggered(16)``, ``staggered(16, 256)``.

    >>> [capture.exposure_ratio for capture in staggered(16, 256)]
    [1.0, 16.0, 256.0]
    """
    return (Capture(), *(Capture(exposure_ratio=ratio) for ratio in ratios))


def factors(captures: Sequence[Capture]) -> list[float]:
    """R_k = T_1 s_1 / (T_k s_k) of every capture: electrons of the first for one of capture k.

    >>> factors(staggered(16, 256))
    [1.0, 16.0, 256.0]
    """
    first = captures[0].exposure_ratio / captures[0].sensitivity
    return [one.exposure_ratio / one.sensitivity / first for one in captures]


def longest_first_s(captures: Sequence[Capture], within_s: float) -> float:
    """Longest exposure of the first capture, s, so that all captures end in ``within_s``; that without captures.

    >>> longest_first_s(staggered(16), 0.017)
    0.016
    """
    longest_s, start_s, lasts = within_s, 0.0, 0.0
    for capture in captures:
        if capture.start_s is not None:
            start_s, lasts = capture.start_s, 0.0
        lasts += captures[0].exposure_ratio / capture.exposure_ratio
        longest_s = min(longest_s, (within_s - start_s) / lasts)
    return longest_s


def windows(captures: Sequence[Capture], exposure_s: float) -> list[tuple[float, float]]:
    """Start and duration of each capture, s. Raises ``ValueError`` for captures that overlap.

    >>> windows(staggered(16), 0.016)
    [(0.0, 0.016), (0.016, 0.001)]
    """
    times: list[tuple[float, float]] = []
    for capture in captures:
        duration_s = exposure_s * captures[0].exposure_ratio / capture.exposure_ratio
        follows_s = sum(times[-1]) if times else 0.0
        times.append((follows_s if capture.start_s is None else capture.start_s, duration_s))
    if times and times[0][0] != 0:
        raise ValueError(f"captures: start_s of the first is {shown(times[0][0])}; must be 0")
    for (first, (begun_s, lasted_s)), (second, (start_s, taken_s)) in combinations(enumerate(times), 2):
        allowed = (start_s, taken_s) == (begun_s, lasted_s)  # one exposure, read at two gains
        allowed |= captures[second].sensitivity != captures[first].sensitivity
        gap_s = max(start_s - begun_s - lasted_s, begun_s - start_s - taken_s)
        # A pixel gathers light for one capture at a time.
        if not allowed and gap_s < -_ROUNDING * exposure_s:
            raise ValueError(
                f"captures: number {second + 1}, {1e3 * start_s:g} to {1e3 * (start_s + taken_s):g} ms, overlaps "
                f"number {first + 1}, {1e3 * begun_s:g} to {1e3 * (begun_s + lasted_s):g} ms; must follow it, "
                "have the same start and duration (two gains) or another sensitivity (split pixels)"
            )
    return times
