"""Crossings of a mean curve with a threshold, and how certain they are: one rule for windows and failure points.

A curve is known at increasing tested values x of an axis. Between them it is straight in the axis's coordinate, and
so is every cluster's part of it: logarithms on an axis that is drawn so and has no 0, else the values themselves.
Stretches of x are (first, last); one that holds at an end of the tested range ends there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from blurnoise_eval.scoring import certainty

Array = NDArray[np.float64]
Stretch = tuple[float, float]
Bounds = tuple[float | None, float | None]
"""An interval; None at an end that lies outside the tested range, or is not known."""
_STEPS = 16  # between two tested values at which the tests are looked at
_ROUNDS = 5  # of which each divides such a step into as many, to find where a test turns


def coordinate(x: ArrayLike, logarithmic: bool) -> Array:
    """Where the values x stand on their axis: straight lines are drawn there."""
    values = np.asarray(x, float)
    return np.log(values) if logarithmic and (values > 0).all() else values


def windows(
    x: Sequence[float], y: Sequence[float], threshold: float, logarithmic: bool = True
) -> list[Stretch]:
    """Stretches of x, increasing, in which y(x) is at or above ``threshold``."""
    at = coordinate(x, logarithmic)
    back = _back(x, logarithmic)
    found: list[Stretch] = []
    start: float | None = None
    for index, value in enumerate(y):
        above = value >= threshold
        if above == (start is not None):
            continue
        end = x[index]
        if index:
            share = (threshold - y[index - 1]) / (value - y[index - 1])
            end = float(back(at[index - 1] + share * (at[index] - at[index - 1])))
            end = min(max(end, x[index - 1]), x[index])  # exp(log x) may miss x by a rounding
        if above:
            start = end
        elif start is not None:
            found.append((start, end))
            start = None
    return found if start is None else [*found, (start, x[-1])]


@dataclass(frozen=True)
class Crossed:
    """Where a curve is at or above a threshold. x: the tested values, increasing.

    windows: where its mean is. sure: where it surely is; possible: where it may be, so that it surely is not
    elsewhere; both at 95 % at each value of x, and each holds what stands before it. certain: there are clusters
    enough to say so; else nothing is sure and everything possible.
    """

    x: tuple[float, ...]
    windows: tuple[Stretch, ...]
    sure: tuple[Stretch, ...]
    possible: tuple[Stretch, ...]
    certain: bool

    def around(self, end: float) -> Bounds:
        """The interval of a window's end: the stretch about it in which the curve is not sure to be above or below.

        Of an end of the tested range it is the other end of that stretch alone, if there is one: what lies beyond
        is unknown.
        """
        first, last = self.x[0], self.x[-1]
        if end in (first, last) and any(low <= end <= high for low, high in self.sure):
            return None, None
        turns = [turn for part in (*self.sure, *self.possible) for turn in part if first < turn < last]
        near = 1e-6 * (last - first)  # a test's turn is known to less than that
        below = [turn for turn in turns if turn <= end + near]
        above = [turn for turn in turns if turn >= end - near]
        return max(below, default=None), min(above, default=None)

    @property
    def fails_between(self) -> Bounds:
        """The interval of where the curve falls below the threshold for good: from where it is surely above for the
        last time to where it may be for the last time. The first of x: it may be, or is, below throughout."""
        if not self.certain:
            return None, None
        ends = [stretches[-1][1] if stretches else self.x[0] for stretches in (self.sure, self.possible)]
        low, high = (None if end == self.x[-1] else end for end in ends)
        return low, high


@dataclass(frozen=True, eq=False)
class Curve:
    """A mean over clusters along an axis.

    x: (N,) increasing. sums: (C, N) of the values in each cluster; counts: (C, N) how many they are.
    """

    x: tuple[float, ...]
    sums: Array
    counts: Array
    logarithmic: bool = False

    @cached_property
    def mean(self) -> Array:
        """(N,)."""
        return certainty.mean_of(self.sums, self.counts)

    @cached_property
    def departures(self) -> Array:
        """(C, N), as :func:`~blurnoise_eval.scoring.certainty.departures` has them."""
        return certainty.departures(self.sums, self.counts)

    @property
    def n_clusters(self) -> int:
        """How many clusters have a value anywhere."""
        return int((self.counts > 0).any(axis=1).sum())

    def interval(self, lowest: float = 0.0, highest: float = 1.0) -> certainty.Ends | None:
        """The 95 % interval of the mean, two of (N,), within what such values can be; None from too few clusters."""
        low, high = certainty.interval(self.mean, self.departures, within=(lowest, highest))
        if not np.isfinite(low).all():
            return None
        return certainty.Ends(np.clip(low, lowest, highest), np.clip(high, lowest, highest))

    def area(self) -> tuple[float, Bounds]:
        """Area under the mean, straight between the values of x, by the range of x; and its 95 % interval."""
        weights = np.zeros(len(self.x))
        steps = np.diff(self.x)
        weights[:-1] += steps / 2
        weights[1:] += steps / 2
        weights /= steps.sum()
        measured = np.isfinite(self.departures)
        part = np.where(measured, self.departures, 0.0) @ weights
        area = float(self.mean @ weights)
        low, high = certainty.interval(area, np.where(measured.any(axis=1), part, np.nan), within=(0.0, 1.0))
        return area, (None, None) if np.isnan(low) else (float(low.clip(0, 1)), float(high.clip(0, 1)))

    def above(self, threshold: float) -> Array:
        """(C, N): what each cluster contributes to the mean's distance above a threshold; their mean is that."""
        return np.asarray(self.departures + self.mean - threshold)

    def crossed(self, threshold: float) -> Crossed:
        """Where the curve is at or above the threshold: by its mean, surely, possibly."""
        within = (0.0, 1.0)

        def surely(mean: Array, parts: Array) -> NDArray[np.bool_]:
            low = certainty.interval(mean, parts, within=within).low
            return np.asarray(low >= threshold)

        def possibly(mean: Array, parts: Array) -> NDArray[np.bool_]:
            high = certainty.interval(mean, parts, within=within).high
            return np.asarray(~(high < threshold))

        return Crossed(
            self.x,
            tuple(windows(self.x, self.mean.tolist(), threshold, self.logarithmic)),
            tuple(self._where(surely)),
            tuple(self._where(possibly)),
            bool((np.isfinite(self.departures).sum(axis=0) >= certainty.FEWEST).any()),
        )

    def _where(self, holds: Callable[[Array, Array], NDArray[np.bool_]]) -> list[Stretch]:
        """Stretches in which something holds of the mean and of its departures, straight between the values of x."""
        z = np.concatenate([self.mean[None], self.departures])
        count = z.shape[1]
        place = np.arange((count - 1) * _STEPS + 1)
        segment, share = place // _STEPS, (place % _STEPS) / _STEPS

        def there_at(segment: NDArray[np.int64], share: Array) -> NDArray[np.bool_]:
            low, high = z[:, segment], z[:, np.minimum(segment + 1, count - 1)]
            between = np.where(share == 0, low, low + share * (high - low))
            return holds(between[0], between[1:])

        there = there_at(segment, share)
        turns = np.flatnonzero(there[1:] != there[:-1])
        segment, inside, width = segment[turns], share[turns], 1.0 / _STEPS
        for _ in range(_ROUNDS if len(turns) else 0):
            width /= _STEPS
            looked = inside[:, None] + width * np.arange(1, _STEPS)
            ahead = there_at(np.repeat(segment, _STEPS - 1), looked.ravel()).reshape(looked.shape)
            inside += width * np.logical_and.accumulate(ahead == there[turns, None], axis=1).sum(axis=1)
        at, back = coordinate(self.x, self.logarithmic), _back(self.x, self.logarithmic)
        step = at[np.minimum(segment + 1, count - 1)] - at[segment]
        ends = [
            *([self.x[0]] if there[0] else []),
            *back(at[segment] + inside * step).tolist(),
            *([self.x[-1]] if there[-1] else []),
        ]
        return list(zip(ends[::2], ends[1::2], strict=True))


def _back(x: ArrayLike, logarithmic: bool) -> Callable[[Any], Any]:
    """From :func:`coordinate` back to x."""
    return np.exp if logarithmic and (np.asarray(x, float) > 0).all() else np.asarray
