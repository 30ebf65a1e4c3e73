"""Trajectories: where the scene goes in the picture over time, and the part of it that an exposure sees.

Convention: s and px, x right, y down; between its knots a trajectory is straight. Time 0 is mid-exposure (of the
middle row, where rows are read one after another). A picture shows each place where it is on average: labels stay.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blurnoise._core.checks import LIMITS, check_fields, in_range, limited, shown

Floats = NDArray[np.float64]
SIMPLIFIED_PX = 0.02
"""How far a simplified path may be from the path at any time: the error of its transfer function is at most 2 pi f
times that."""
_SAG_PX = 1e-3  # of curves between their knots
_MOST_KNOTS = 1 << 20
_SPAN = 4096  # knots simplified together


@dataclass(frozen=True)
class Polyline:
    """The part of a trajectory within an exposure: knots, px from the reference position, and shares of time."""

    x_px: tuple[float, ...]
    y_px: tuple[float, ...]
    shares: tuple[float, ...]

    @cached_property
    def knots(self) -> Floats:
        """(2, K), px."""
        return np.array((self.x_px, self.y_px))

    @cached_property
    def box(self) -> tuple[float, float, float, float]:
        """Smallest x and y, largest x and y, px."""
        return min(self.x_px), min(self.y_px), max(self.x_px), max(self.y_px)

    @cached_property
    def error(self) -> float:
        """RMS error, in units of white, of leaving it out: a bound for any picture within [0, 1].

        |1 - H(f)| is at most 2, and 2 pi f . c of the centroid c plus 2 pi^2 f . S f of the second moments S about
        it; the worst picture is a checkerboard, f = (1/2, 1/2) or (1/2, -1/2).
        """
        shares = np.array(self.shares)
        starts, ends = self.knots[:, :-1], self.knots[:, 1:]
        second = ((starts[:, None] * starts + ends[:, None] * ends) / 3 * shares).sum(-1)
        second += ((starts[:, None] * ends + ends[:, None] * starts) / 6 * shares).sum(-1)
        centroid = np.array(_mean(self.knots, shares))
        (a, c), (_, b) = second - np.outer(centroid, centroid)
        spread = 2 * math.pi**2 * max(0.0, float(a + b + 2 * abs(c))) / 4
        shifted = math.pi * float(np.abs(centroid).sum())
        return min(2.0, spread + shifted) / 2


@dataclass(frozen=True)
class Trajectory:
    """Knots of a trajectory: times, s, increasing, and places, px. Raises ``TypeError`` or ``ValueError``.

    An exposure that begins before the first knot or ends after the last is an error, where it is used.
    """

    time_s: tuple[float, ...]
    x_px: tuple[float, ...]
    y_px: tuple[float, ...]

    def __post_init__(self) -> None:
        check_fields(self)
        if not len(self.time_s) == len(self.x_px) == len(self.y_px) >= 2:
            counts = len(self.time_s), len(self.x_px), len(self.y_px)
            raise ValueError(f"time_s, x_px, y_px: got {counts} numbers; must be as many of each, at least 2")
        for before, after in pairwise(self.time_s):
            if not before < after:
                raise ValueError(f"time_s: {after!r} follows {before!r}; must increase")
        most = LIMITS["displacement_px"].high
        for name, values in (("x_px", self.x_px), ("y_px", self.y_px)):
            if max(values) - min(values) > most:
                raise ValueError(f"{name}: spans {max(values) - min(values):g} px; must be at most {most:g}")

    @classmethod
    def of(cls, time_s: Any, places_px: NDArray[Any]) -> Trajectory:
        """Trajectory from times (K,), s, and positions (2, K), px."""
        if np.ndim(time_s) != 1 or np.shape(places_px) != (2, len(time_s)):
            raise ValueError(
                f"time_s, places_px: shapes are {np.shape(time_s)}, {np.shape(places_px)}; must be (K,), (2, K)"
            )
        return cls(time_s, *places_px)

    @classmethod
    def straight(cls, velocity_px_s: tuple[float, float], duration_s: float) -> Trajectory:
        """Uniform motion, for exposures up to ``duration_s``."""
        half = in_range("duration_s", duration_s, 0.0, above=True) / 2
        x, y = _vector("velocity_px_s", velocity_px_s)
        return cls((-half, half), (-x * half, x * half), (-y * half, y * half))

    @classmethod
    def sinusoid(
        cls,
        amplitude_px: float,
        frequency_hz: float,
        duration_s: float,
        *,
        phase_rad: float = 0.0,
        direction_deg: float = 0.0,
    ) -> Trajectory:
        """Vibration a sin(2 pi f t + phase) along a direction, counter-clockwise as displayed, to 1e-3 px."""
        amplitude = in_range("amplitude_px", amplitude_px, 0.0, 1e4)
        omega = 2 * math.pi * limited("frequency_hz", frequency_hz)
        half = in_range("duration_s", duration_s, 0.0, above=True) / 2
        step = math.sqrt(8 * _SAG_PX / max(amplitude, _SAG_PX)) / omega
        count = math.ceil(2 * half / step) + 1
        if count > _MOST_KNOTS:
            raise ValueError(
                f"duration_s = {2 * half:g}: needs {count} knots; at most {_MOST_KNOTS} are allowed"
            )
        time = np.linspace(-half, half, max(2, count))
        angle = math.radians(limited("direction_deg", direction_deg))
        phase = limited("phase_rad", phase_rad)
        along = amplitude * np.sin(omega * time + phase)
        return cls.of(time, np.outer((math.cos(angle), -math.sin(angle)), along))

    def window(self, start_s: float, stop_s: float) -> tuple[Floats, Floats]:
        """Knots (2, K), px, and durations (K - 1,), s, between two times; one knot if these are equal.

        Raises ``ValueError`` unless the trajectory holds both.
        """
        first, last = self.time_s[0], self.time_s[-1]
        slack = 1e-6 * (last - first)  # of times that were rounded to single precision
        if not first - slack <= start_s <= stop_s <= last + slack:
            raise ValueError(
                f"trajectory: goes from {first:.6g} to {last:.6g} s; must hold the exposure, {start_s:.6g} to "
                f"{stop_s:.6g} s about mid-exposure"
            )
        time, x, y = self._arrays
        within = time[(time > start_s) & (time < stop_s)]
        at = np.concatenate([[start_s], within, [stop_s] if stop_s > start_s else []])
        return np.stack([np.interp(at, time, x), np.interp(at, time, y)]), np.diff(at)

    def seen(self, exposure_s: float, velocity_px_s: tuple[float, float] = (0.0, 0.0)) -> Polyline:
        """The part within an exposure, plus uniform motion, simplified to 0.02 px. Raises as :meth:`window` does."""
        x, y = _vector("velocity_px_s", velocity_px_s).tolist()
        return _seen(self, limited("exposure_s", exposure_s), (x, y))

    def origin_px(self, exposure_s: float) -> tuple[float, float]:
        """The mean position over an exposure."""
        return _mean(*self.window(-exposure_s / 2, exposure_s / 2))

    @cached_property
    def _arrays(self) -> tuple[Floats, Floats, Floats]:
        return np.array(self.time_s), np.array(self.x_px), np.array(self.y_px)


@lru_cache(maxsize=256)
def _seen(trajectory: Trajectory, exposure_s: float, velocity_px_s: tuple[float, float]) -> Polyline:
    knots, durations = trajectory.window(-exposure_s / 2, exposure_s / 2)
    if not len(durations):
        return Polyline((0.0,), (0.0,), ())
    time = sums(durations) - exposure_s / 2
    knots = knots + np.outer(velocity_px_s, time) - np.array(trajectory.origin_px(exposure_s))[:, None]
    kept = simplified(time, knots, SIMPLIFIED_PX)
    knots, shares = knots[:, kept], np.diff(time[kept]) / (time[-1] - time[0])
    x, y = (
        knots - np.array(_mean(knots, shares))[:, None]
    )  # its own mean: that of the path, to rounding and 0.02 px
    return Polyline(tuple(x.tolist()), tuple(y.tolist()), tuple(shares.tolist()))


def simplified(time: Floats, knots: Floats, tolerance_px: float) -> list[int]:
    """Indices of the knots (2, K) at times (K,) to keep, for an error of at most ``tolerance_px`` at any time.

    After Douglas and Peucker, but with places at equal times compared: speed counts, not shape alone.
    """
    ends = np.unique([*range(0, len(time), _SPAN), len(time) - 1])
    kept = [ends]
    firsts, lasts = ends[:-1], ends[1:]
    while True:  # all spans between two knots that are kept, at once
        inside = lasts - firsts > 1
        firsts, lasts = firsts[inside], lasts[inside]
        if not len(firsts):
            return [int(knot) for knot in np.unique(np.concatenate(kept))]
        counts = lasts - firsts - 1
        begins = np.cumsum(counts) - counts
        span = np.repeat(np.arange(len(counts)), counts)
        place = np.arange(len(span)) - begins[span] + firsts[span] + 1
        share = (time[place] - time[firsts[span]]) / (time[lasts] - time[firsts])[span]
        line = knots[:, firsts[span]] + share * (knots[:, lasts] - knots[:, firsts])[:, span]
        off = np.hypot(*(knots[:, place] - line))
        most = np.maximum.reduceat(off, begins)
        found = np.flatnonzero((off == most[span]) & (off > tolerance_px))
        found = found[np.unique(span[found], return_index=True)[1]]  # the first of equals
        middle, cut = place[found], span[found]
        kept.append(middle)
        firsts, lasts = np.concatenate([firsts[cut], middle]), np.concatenate([middle, lasts[cut]])


def sums(steps: Floats) -> Floats:
    """0, and the sum of the first step, the first two, ..., along the last axis."""
    return np.concatenate([np.zeros((*steps.shape[:-1], 1)), np.cumsum(steps, -1)], -1)


def _mean(knots: Floats, durations: Floats) -> tuple[float, float]:
    """The mean place over time of knots (2, K)."""
    if not len(durations):
        return float(knots[0, 0]), float(knots[1, 0])
    x, y = ((knots[:, :-1] + knots[:, 1:]) / 2 * durations).sum(-1) / durations.sum()
    return float(x), float(y)


def _vector(name: str, value: Iterable[float]) -> Floats:
    """Two numbers (x, y) within the limit of their name."""
    along = tuple(value)
    if len(along) != 2:
        raise ValueError(f"{name} = {shown(value)}: must be two numbers (x, y)")
    return np.array([limited(name, each) for each in along])


def per_picture(
    trajectory: Trajectory | Sequence[Trajectory | None] | None, batch: int
) -> tuple[Trajectory | None, ...]:
    """A trajectory or None for each picture of a batch; () if all are None. Raises ``TypeError``."""
    if trajectory is None:
        return ()
    each = (trajectory,) * batch if isinstance(trajectory, Trajectory) else tuple(trajectory)
    if any(one is not None and not isinstance(one, Trajectory) for one in each):
        raise TypeError("trajectory: must be a blurnoise.Trajectory, or one or None for each picture")
    if len(each) != batch:
        raise ValueError(f"trajectory: got {len(each)} for a batch of {batch}; must be one per picture")
    return each if any(each) else ()
