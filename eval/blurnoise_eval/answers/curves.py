"""Curves of a score over one axis: where they reach a level, how certain that is, and how long they hold.

A curve is known at increasing tested values x of an axis. Between them it is straight in the axis's coordinate, and
so is every cluster's part of it: logarithms on an axis that is drawn so and has no 0, else the values themselves.
Stretches of x are (first, last); one that holds at an end of the tested range ends there. A curve is surely at or
above a threshold where the low end of its mean's 95 % interval is, and possibly where the high end is. What a
measured curve does between two tested values is unknown: the interval of a window's end reaches from one tested
value to another.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.answers import uncertainty
from blurnoise_eval.answers.criterion import Criterion
from blurnoise_eval.answers.plane import coordinate, trapezoid_weights
from blurnoise_eval.answers.table import ScoreTable
from blurnoise_eval.grid.axes import NAMES, SETTING, axis
from blurnoise_eval.scoring.estimates import influence, ratio_of_sums

Array = NDArray[np.float64]
Row = dict[str, Any]
Stretch = tuple[float, float]
Bounds = tuple[float | None, float | None]
"""An interval; None at an end that lies outside the tested range, or is not known."""
BLUR = "blur_px"
_STEPS = 16  # between two tested values, at which the interval is known; between these its ends are straight
_UNKNOWN = 1e9  # where no interval is known, it reaches beyond every threshold


def windows(
    x: Sequence[float], y: Sequence[float], threshold: float, logarithmic: bool = True
) -> list[Stretch]:
    """Stretches of x, increasing, in which y(x) is at or above ``threshold``."""
    at, is_log = coordinate(x, logarithmic)
    above = np.asarray(y, float) >= threshold
    ends = [x[0]] if above[:1].any() else []
    for place in np.flatnonzero(above[1:] != above[:-1]).tolist():
        share = (threshold - y[place]) / (y[place + 1] - y[place])
        end = float(at[place] + share * (at[place + 1] - at[place]))
        end = float(np.exp(end)) if is_log else end
        ends.append(min(max(end, x[place]), x[place + 1]))  # exp(log x) may miss x by a rounding
    ends += [x[-1]] if above[-1:].any() else []
    return list(zip(ends[::2], ends[1::2], strict=True))


@dataclass(frozen=True)
class Crossed:
    """Where a curve is at or above a threshold. x: the tested values, increasing.

    windows: where its mean is. sure, possible: where the low and the high end of its 95 % interval are. certain:
    whether there are clusters enough for an interval; else nothing is sure and everything possible. predicted: the
    curve is known between the values of x, too.
    """

    x: tuple[float, ...]
    windows: tuple[Stretch, ...]
    sure: tuple[Stretch, ...]
    possible: tuple[Stretch, ...]
    certain: bool
    predicted: bool = False

    def around(self, end: float) -> Bounds:
        """The interval of a window's end: the stretch about it in which the curve is not sure to be above or below,
        as far as the tested values at which it is; beyond the tested range it is unknown."""
        first, last = self.x[0], self.x[-1]
        if end in (first, last) and any(low <= end <= high for low, high in self.sure):
            return None, None
        turns = [turn for part in (*self.sure, *self.possible) for turn in part if first < turn < last]
        near = 1e-6 * (last - first)  # rounding, where an interval has no width
        low = max((turn for turn in turns if turn <= end + near), default=None)
        high = min((turn for turn in turns if turn >= end - near), default=None)
        if self.predicted:
            return low, high
        return (
            None if low is None else max((x for x in self.x if x <= low + near), default=first),
            None if high is None else min((x for x in self.x if x >= high - near), default=last),
        )

    @property
    def fails_between(self) -> Bounds:
        """The interval of where the curve falls below the threshold for good: from where it is surely above for the
        last time to where it may be, straight between the tested values. The first of x: it may be, or is, below
        throughout."""
        if not self.certain:
            return None, None
        ends = [stretches[-1][1] if stretches else self.x[0] for stretches in (self.sure, self.possible)]
        low, high = (None if end == self.x[-1] else end for end in ends)
        return low, high


@dataclass(frozen=True, eq=False)
class Curve:
    """A mean over clusters along an axis.

    x: (N,) increasing. sums: (C, N) of the values in each cluster; counts: (C, N) how many they are, or of what
    they are shares. most: the greatest value of the mean; the least is 0. open: (N, N) covariance of a mean that is
    predicted, beside what clusters differ by. given: the interval in place of :attr:`ends`, where it is known.
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
        """How many clusters of one size they are worth: :func:`~blurnoise_eval.answers.uncertainty.effective`."""
        return float(uncertainty.effective(self.counts.sum(axis=1)))

    @cached_property
    def known(self) -> NDArray[np.bool_]:
        """(N,): whether clusters enough, as their sizes count, have a value there."""
        return uncertainty.enough(uncertainty.effective(self.counts))

    @property
    def _steps(self) -> int:
        """Between two values of x, at which the interval is known; predicted values are close enough."""
        return _STEPS if self.open is None else 1

    def _between(self, values: Array) -> Array:
        """Values (..., N), straight between the steps."""
        place = np.arange((len(self.x) - 1) * self._steps + 1)
        before, share = place // self._steps, (place % self._steps) / self._steps
        low, high = values[..., before], values[..., np.minimum(before + 1, len(self.x) - 1)]
        return np.asarray(np.where(share == 0, low, low + share * (high - low)))

    @cached_property
    def ends(self) -> uncertainty.Ends:
        """The 95 % interval of the mean, at every value of x and in steps between them; NaN where unknown."""
        if self.given is not None:
            return self.given
        sigma = 0.0 if self.open is None else self._between(np.sqrt(np.diag(self.open)))
        mean, away = self._between(self.mean), self._between(self.influence)
        ends = uncertainty.of_level(mean, away, self.most, sigma)
        known = self._between(self.known.astype(float)) == 1
        return uncertainty.Ends(*(np.where(known, end, np.nan) for end in ends))

    @cached_property
    def fine(self) -> Array:
        """The values of x at which the interval is known."""
        at, is_log = coordinate(self.x, self.logarithmic)
        fine = np.exp(self._between(at)) if is_log else self._between(at)
        fine[:: self._steps] = self.x
        return fine

    def interval(self) -> uncertainty.Ends | None:
        """The 95 % interval of the mean, two of (N,); None from too few clusters."""
        low, high = (end[:: self._steps] for end in self.ends)
        return uncertainty.Ends(low, high) if np.isfinite(low).all() else None

    def area(self) -> tuple[float, Bounds]:
        """Area under the mean, straight between the values of x, by the range of x; and its 95 % interval."""
        weights = trapezoid_weights(np.array(self.x))
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
        fine = self.fine.tolist()
        ends = np.nan_to_num(self.ends.low, nan=-_UNKNOWN), np.nan_to_num(self.ends.high, nan=_UNKNOWN)
        sure, possible = (windows(fine, end.tolist(), threshold, self.logarithmic) for end in ends)
        found = windows(self.x, self.mean.tolist(), threshold, self.logarithmic)
        certain = bool(self.known.any())
        return Crossed(
            self.x, tuple(found), tuple(sure), tuple(possible), certain, predicted=self.open is not None
        )


def endurances(table: ScoreTable, criterion: Criterion, exposures_s: Collection[float] = ()) -> Iterator[Row]:
    """Of each setting every curve through at least two points, as :func:`_endurance` has it: over exposure, then over
    blur, at each exposure or, if there are any, those of ``exposures_s`` alone."""
    for setting in table.take(table.measured).split(SETTING):
        yield from _along(setting, "exposure_s", criterion)
        for at_once in setting.split(["exposure_s"]):
            exposure_s = float(at_once.conditions["exposure_s"][0])
            speeds, place = np.unique(at_once.speeds_px_s, return_inverse=True)
            if len(speeds) < 2 or (exposures_s and exposure_s not in exposures_s):
                continue
            # directions of one speed: one point
            alike = (np.arange(len(speeds)) == place[:, None]).astype(float)
            x = tuple((speeds * exposure_s).tolist())  # straight in px, since pictures at rest have none
            counts, cov = at_once.counts @ alike, None
            if at_once.prediction_cov is not None:
                shares = alike * at_once.counts.sum(axis=0)[:, None] / counts.sum(axis=0)
                cov = shares.T @ at_once.prediction_cov(np.arange(len(at_once))) @ shares
            curve = Curve(x, at_once.sums @ alike, counts, most=table.most, open=cov)
            yield _endurance(at_once, BLUR, ("exposure_s", *SETTING), curve, criterion)


def endurances_across(table: ScoreTable, criterion: Criterion) -> Iterator[Row]:
    """Every curve through at least two points over an axis of the setting on which a detector fails, at one exposure
    and velocity."""
    for name in SETTING:
        if axis(name).fails:
            yield from _along(table.take(table.measured), name, criterion)


def _along(table: ScoreTable, name: str, criterion: Criterion) -> Iterator[Row]:
    for line in table.along(name):
        if len(line) > 1:
            fixed = [each for each in NAMES if each != name]
            yield _endurance(line, name, fixed, Curve.of(line, name), criterion)


def _endurance(
    line: ScoreTable, over: str, fixed: Collection[str], curve: Curve, criterion: Criterion
) -> Row:
    """How one curve holds: mean confidence against one axis, or blur, all else staying as it is.

    axis: the name of an axis or "blur_px"; the axes have columns, None on those that are not ``fixed``. auc: area
    under the curve over the range of x, so the mean confidence over it. fails_at: where the curve falls below the
    criterion for good (x[0]: it is below throughout), None where it does not within the range. Intervals at 95 %
    over ``n_pictures`` clusters: auc_low, auc_high; fails_low, fails_high, None at an end that is not reached within
    the range, and from too few. non_monotonic: the curve had been below and come back.
    """
    at = {name: value if name in fixed else None for name, value in line.at(0).items()}
    first = {"illuminance_lux": at["illuminance_lux"], "axis": over}
    crossed, above = curve.crossed(criterion.level), curve.mean >= criterion.level
    end = crossed.windows[-1][1] if crossed.windows else curve.x[0]
    auc, (auc_low, auc_high) = curve.area()
    fails_low, fails_high = crossed.fails_between
    return {"model": line.model, "group": line.group, **first, **at} | {
        "x": curve.x,
        "confidence": tuple(curve.mean.tolist()),
        "auc": auc,
        "fails_at": None if above[-1] else end,
        "fails_low": fails_low,
        "fails_high": fails_high,
        "non_monotonic": bool((above[1:] & ~above[:-1]).any()),
        "auc_low": auc_low,
        "auc_high": auc_high,
        "n_pictures": curve.n_clusters,
        "few_pictures": curve.n_effective < uncertainty.FEW,
        "criterion": criterion.text,
    }
