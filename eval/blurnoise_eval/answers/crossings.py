"""Crossings of a mean curve with a threshold, and how certain they are: one rule for windows and failure points.

A curve is known at increasing tested values x of an axis. Between them it is straight in the axis's coordinate, and
so is every cluster's part of it: logarithms on an axis that is drawn so and has no 0, else the values themselves.
Stretches of x are (first, last); one that holds at an end of the tested range ends there. A curve is surely at or
above a threshold where the low end of its mean's 95 % interval is, and possibly where the high end is. What a
measured curve does between two tested values nobody has seen: the interval of a window's end reaches from one tested
value to another.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from blurnoise_eval.answers import uncertainty
from blurnoise_eval.answers.plane import coordinate
from blurnoise_eval.answers.table import ScoreTable
from blurnoise_eval.grid.axes import axis
from blurnoise_eval.scoring.estimates import influence, ratio_of_sums

Array = NDArray[np.float64]
Stretch = tuple[float, float]
Bounds = tuple[float | None, float | None]
"""An interval; None at an end that lies outside the tested range, or is not known."""
_STEPS = 16  # between two tested values, at which the interval is known; between these its ends are straight
_UNKNOWN = 1e9  # where no interval is known, it reaches beyond every threshold


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

    windows: where its mean is. sure: where the low end of the mean's interval is; possible: where the high end is, so
    that it surely is not elsewhere; both at 95 % at each value of x, and each holds what stands before it. certain:
    there are clusters enough to say so; else nothing is sure and everything possible. predicted: the curve is known
    between the values of x, too.
    """

    x: tuple[float, ...]
    windows: tuple[Stretch, ...]
    sure: tuple[Stretch, ...]
    possible: tuple[Stretch, ...]
    certain: bool
    predicted: bool = False

    def around(self, end: float) -> Bounds:
        """The interval of a window's end: the stretch about it in which the curve is not sure to be above or below,
        as far as the tested values at which it is.

        Of an end of the tested range it is the other end of that stretch alone, if there is one: what lies beyond
        is unknown.
        """
        first, last = self.x[0], self.x[-1]
        if end in (first, last) and any(low <= end <= high for low, high in self.sure):
            return None, None
        turns = [turn for part in (*self.sure, *self.possible) for turn in part if first < turn < last]
        near = 1e-6 * (last - first)  # rounding, where an interval has no width
        below = [turn for turn in turns if turn <= end + near]
        above = [turn for turn in turns if turn >= end - near]
        return self._tested(max(below, default=None), min(above, default=None))

    @property
    def fails_between(self) -> Bounds:
        """The interval of where the curve falls below the threshold for good: from where it is surely above for the
        last time to where it may be for the last time, straight between the tested values. The first of x: it may be,
        or is, below throughout."""
        if not self.certain:
            return None, None
        ends = [stretches[-1][1] if stretches else self.x[0] for stretches in (self.sure, self.possible)]
        low, high = (None if end == self.x[-1] else end for end in ends)
        return low, high

    def _tested(self, low: float | None, high: float | None) -> Bounds:
        """The tested values just outside an interval; of a predicted curve the interval as it is."""
        if self.predicted:
            return low, high
        near = 1e-6 * (self.x[-1] - self.x[0])
        return (
            None if low is None else max((x for x in self.x if x <= low + near), default=self.x[0]),
            None if high is None else min((x for x in self.x if x >= high - near), default=self.x[-1]),
        )


@dataclass(frozen=True, eq=False)
class Curve:
    """A mean over clusters along an axis.

    x: (N,) increasing. sums: (C, N) of the values in each cluster; counts: (C, N) how many they are, or of what
    they are shares. most: the greatest value of the mean; the least is 0. open: (N, N) covariance of what is not
    known of a mean that is predicted, beside what clusters differ by; the squares of half-widths add. given: the
    interval, as :attr:`ends` has it, where more is known of it than the clusters say.
    """

    x: tuple[float, ...]
    sums: Array
    counts: Array
    logarithmic: bool = False
    most: float = 1.0
    open: Array | None = None
    given: uncertainty.Ends | None = None

    @classmethod
    def of(cls, line: ScoreTable, over: str) -> Curve:
        """Of a line of a table over an axis."""
        of = line.prediction_cov
        cov = None if of is None else of(np.arange(len(line)))
        x = tuple(line.conditions[over].tolist())
        return cls(x, line.sums, line.counts, axis(over).logarithmic, line.most, cov)

    @cached_property
    def mean(self) -> Array:
        """(N,)."""
        return ratio_of_sums(self.sums, self.counts)

    @cached_property
    def influence(self) -> Array:
        """(C, N), as :func:`~blurnoise_eval.scoring.estimates.influence` has it."""
        return influence(self.sums, self.counts)

    @property
    def n_clusters(self) -> int:
        """How many clusters have a value anywhere."""
        return int(((self.counts > 0) | (self.sums > 0)).any(axis=1).sum())

    @property
    def n_effective(self) -> float:
        """How many clusters of one size would say as much: :func:`~blurnoise_eval.answers.uncertainty.effective`."""
        return float(uncertainty.effective(self.counts.sum(axis=1)))

    @cached_property
    def told(self) -> NDArray[np.bool_]:
        """(N,): whether clusters enough, as their sizes count, have a value there."""
        return uncertainty.enough(uncertainty.effective(self.counts))

    @property
    def _steps(self) -> int:
        """Between two values of x, at which the interval is known; what is predicted stands close enough."""
        return _STEPS if self.open is None else 1

    @cached_property
    def ends(self) -> uncertainty.Ends:
        """The 95 % interval of the mean, at every value of x and in steps between them; NaN where unknown."""
        if self.given is not None:
            return self.given
        count = len(self.x)
        place = np.arange((count - 1) * self._steps + 1)
        before, share = place // self._steps, (place % self._steps) / self._steps
        after = np.where(share == 0, before, np.minimum(before + 1, count - 1))

        def between(values: Array) -> Array:
            low, high = values[..., before], values[..., after]
            return np.asarray(np.where(share == 0, low, low + share * (high - low)))

        mean = between(self.mean)
        sigma = 0.0 if self.open is None else between(np.sqrt(np.diag(self.open)))
        ends = uncertainty.of_level(mean, between(self.influence), self.most, sigma)
        told = self.told[before] & self.told[after]
        return uncertainty.Ends(*(np.where(told, end, np.nan) for end in ends))

    @cached_property
    def fine(self) -> Array:
        """The values of x at which the interval is known."""
        at = coordinate(self.x, self.logarithmic)
        place = np.arange((len(at) - 1) * self._steps + 1) / self._steps
        fine = np.asarray(_back(self.x, self.logarithmic)(np.interp(place, np.arange(len(at)), at)), float)
        fine[:: self._steps] = self.x
        return fine

    def interval(self) -> uncertainty.Ends | None:
        """The 95 % interval of the mean, two of (N,); None from too few clusters."""
        low, high = (end[:: self._steps] for end in self.ends)
        return uncertainty.Ends(low, high) if np.isfinite(low).all() else None

    def area(self) -> tuple[float, Bounds]:
        """Area under the mean, straight between the values of x, by the range of x; and its 95 % interval."""
        weights = np.zeros(len(self.x))
        steps = np.diff(self.x)
        weights[:-1] += steps / 2
        weights[1:] += steps / 2
        weights /= steps.sum()
        measured = np.isfinite(self.influence)
        part = np.where(measured, self.influence, 0.0) @ weights
        area = float(self.mean @ weights)
        away = np.where(measured.any(axis=1), part, np.nan)
        sigma = 0.0 if self.open is None else math.sqrt(max(float(weights @ self.open @ weights), 0.0))
        low, high = (float(end) for end in uncertainty.of_level(area, away, self.most, sigma))
        known = uncertainty.enough(self.n_effective) and math.isfinite(low)
        return area, (low, high) if known else (None, None)

    def crossed(self, threshold: float) -> Crossed:
        """Where the curve is at or above the threshold: by its mean, surely, possibly."""
        fine = self.fine
        low = np.nan_to_num(self.ends.low, nan=-_UNKNOWN)
        high = np.nan_to_num(self.ends.high, nan=_UNKNOWN)
        return Crossed(
            self.x,
            tuple(windows(self.x, self.mean.tolist(), threshold, self.logarithmic)),
            tuple(windows(fine.tolist(), low.tolist(), threshold, self.logarithmic)),
            tuple(windows(fine.tolist(), high.tolist(), threshold, self.logarithmic)),
            bool(self.told.any()),
            predicted=self.open is not None,
        )


def _back(x: ArrayLike, logarithmic: bool) -> Callable[[Any], Any]:
    """From :func:`coordinate` back to x."""
    return np.exp if logarithmic and (np.asarray(x, float) > 0).all() else np.asarray
