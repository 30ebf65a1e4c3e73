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
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from blurnoise_eval.answers.criterion import Criterion
from blurnoise_eval.answers.rows import CurveRow
from blurnoise_eval.answers.table import ScoreTable
from blurnoise_eval.plan.axes import NAMES, SETTING, axis
from blurnoise_eval.scoring import uncertainty
from blurnoise_eval.store.columns import AxisValues
from blurnoise_eval.system.tables import finite

Array = NDArray[np.float64]
Stretch = tuple[float, float]
Bounds = tuple[float | None, float | None]
"""An interval; None at an end that lies outside the tested range, or is not known."""
BLUR = "blur_px"
_STEPS = 16  # between two tested values, at which the interval is known; between these its ends are straight
# Beyond any score, so that an unknown end neither shows that a level is reached nor that it is missed.
_UNKNOWN = 1e9  # where no interval is known, it reaches beyond every threshold


def windows(x: ArrayLike, y: ArrayLike, threshold: float, logarithmic: bool = True) -> list[Stretch]:
    """Stretches of x, increasing, in which y(x) is at or above ``threshold``.

    >>> stretches = windows([1.0, 2.0, 4.0, 8.0], [0.0, 1.0, 1.0, 0.0], threshold=0.5)
    >>> [(round(first, 2), round(last, 2)) for first, last in stretches]  # half-way in log x
    [(1.41, 5.66)]
    """
    tested, values = np.asarray(x, float).tolist(), np.asarray(y, float)
    (at, is_log), above = _coordinate(tested, logarithmic), values >= threshold
    ends = [tested[0]] if above[:1].any() else []
    for index in np.flatnonzero(above[1:] != above[:-1]).tolist():
        share = (threshold - values[index]) / (values[index + 1] - values[index])
        end = float(at[index] + share * (at[index + 1] - at[index]))
        end = float(np.exp(end)) if is_log else end
        ends.append(min(max(end, tested[index]), tested[index + 1]))  # exp(log x) may miss x by a rounding
    ends += [tested[-1]] if above[-1:].any() else []
    return list(zip(ends[::2], ends[1::2], strict=True))


@dataclass(frozen=True, eq=False)
class ScoreCurve:
    """A mean over clusters along an axis.

    line: a table whose N conditions are those of the tested values x, increasing. given: the interval in place of
    :attr:`ends`, where it is known.
    """

    line: ScoreTable
    x: tuple[float, ...]
    logarithmic: bool = False
    given: uncertainty.Ends | None = None

    @classmethod
    def over(cls, name: str, line: ScoreTable) -> ScoreCurve:
        """Of a line of a table over an axis."""
        return cls(line, tuple(line.conditions[name].tolist()), axis(name).logarithmic)

    @cached_property
    def known(self) -> NDArray[np.bool_]:
        """(N,): whether clusters enough, as their sizes count, have a value there."""
        return uncertainty.enough(self.line.effective)

    @property
    def predicted(self) -> bool:
        """Whether the curve is known between the values of x, too."""
        return self.line.prediction_cov is not None

    @cached_property
    def cov(self) -> Array:
        """(N, N) covariance of the prediction."""
        of = self.line.prediction_cov
        return np.zeros((len(self.x),) * 2) if of is None else of(np.arange(len(self.x)))

    @property
    def _steps(self) -> int:
        """Between two values of x, at which the interval is known; predicted values are close enough."""
        return 1 if self.predicted else _STEPS

    def _between(self, values: Array) -> Array:
        """Values (..., N), straight between the steps."""
        step = np.arange((len(self.x) - 1) * self._steps + 1)
        before, share = step // self._steps, (step % self._steps) / self._steps
        low, high = values[..., before], values[..., np.minimum(before + 1, len(self.x) - 1)]
        return np.asarray(np.where(share == 0, low, low + share * (high - low)))

    @cached_property
    def ends(self) -> uncertainty.Ends:
        """The 95 % interval of the mean, at every value of x and in steps between them; NaN where unknown."""
        if self.given is not None:
            return self.given
        every = self.line.mean, self.line.influence, np.sqrt(np.diag(self.cov)), self.known.astype(float)
        mean, away, sigma, known = map(self._between, every)
        # Between two values of x the interval is known only where it is at both.
        clusters = np.where(known == 1, np.inf, 0)
        return uncertainty.of_level(mean, away, self.line.most, sigma, clusters)

    @cached_property
    def fine(self) -> Array:
        """The values of x at which the interval is known."""
        at, is_log = _coordinate(self.x, self.logarithmic)
        fine = np.exp(self._between(at)) if is_log else self._between(at)
        fine[:: self._steps] = self.x
        return fine

    def interval(self) -> uncertainty.Ends | None:
        """The 95 % interval of the mean, two of (N,); None from too few clusters."""
        low, high = (end[:: self._steps] for end in self.ends)
        return uncertainty.Ends(low, high) if np.isfinite(low).all() else None

    def area(self) -> tuple[float, Bounds]:
        """Area under the mean, straight between the values of x, by the range of x; and its 95 % interval."""
        weights = _trapezoid_weights(np.array(self.x))
        area, measured = float(self.line.mean @ weights), np.isfinite(self.line.influence)
        part = np.where(measured, self.line.influence, 0.0) @ weights
        away = np.where(measured.any(axis=1), part, np.nan)
        sigma = math.sqrt(max(float(weights @ self.cov @ weights), 0.0))
        ends = uncertainty.of_level(area, away, self.line.most, sigma, self.line.n_effective)
        low, high = (finite(float(end)) for end in ends)
        return area, (low, high)

    def windows(self, level: float) -> list[Stretch]:
        """Where the mean is at or above a level."""
        return windows(self.x, self.line.mean, level, self.logarithmic)

    def sure(self, level: float) -> list[Stretch]:
        """Where the low end of the interval is; nothing from too few clusters."""
        return windows(self.fine, np.nan_to_num(self.ends.low, nan=-_UNKNOWN), level, self.logarithmic)

    def possible(self, level: float) -> list[Stretch]:
        """Where the high end of the interval is; everything from too few clusters."""
        return windows(self.fine, np.nan_to_num(self.ends.high, nan=_UNKNOWN), level, self.logarithmic)

    def around(self, end: float, level: float) -> Bounds:
        """The interval of a window's end: the stretch about it in which the curve is not sure to be above or below,
        as far as the tested values at which it is; beyond the tested range it is unknown."""
        first, last = self.x[0], self.x[-1]
        sure = self.sure(level)
        if end in (first, last) and any(low <= end <= high for low, high in sure):
            return None, None
        turns = [turn for part in (*sure, *self.possible(level)) for turn in part if first < turn < last]
        # Turns are computed from values on either side, so that the same turn may differ in its last digits.
        near = 1e-6 * (last - first)  # rounding, where an interval has no width
        low = max((turn for turn in turns if turn <= end + near), default=None)
        high = min((turn for turn in turns if turn >= end - near), default=None)
        if self.predicted:
            return low, high
        return (
            None if low is None else max((x for x in self.x if x <= low + near), default=first),
            None if high is None else min((x for x in self.x if x >= high - near), default=last),
        )

    def fails_between(self, level: float) -> Bounds:
        """The interval of where the curve falls below the level for good: from where it is surely above for the
        last time to where it may be, straight between the tested values. The first of x: it may be, or is, below
        throughout."""
        if not self.known.any():
            return None, None
        every = self.sure(level), self.possible(level)
        low, high = (stretches[-1][1] if stretches else self.x[0] for stretches in every)
        return None if low == self.x[-1] else low, None if high == self.x[-1] else high


def endurances(
    table: ScoreTable, criterion: Criterion, exposures_s: Collection[float] = ()
) -> Iterator[CurveRow]:
    """Of each setting every curve through at least two points, as :func:`_endurance` has it: over exposure, then over
    blur, at each exposure or, if there are any, those of ``exposures_s`` alone."""
    for setting in table.take(table.measured).split(SETTING):
        yield from _along(setting, "exposure_s", criterion)
        for at_once in setting.split(["exposure_s"]):
            exposure_s = float(at_once.conditions["exposure_s"][0])
            speeds, index = np.unique(at_once.speeds_px_s, return_inverse=True)
            if len(speeds) < 2 or (exposures_s and exposure_s not in exposures_s):
                continue
            merged = at_once.merged(index)  # directions of one speed: one point
            x = tuple((speeds * exposure_s).tolist())  # straight in px, since pictures at rest have none
            yield _endurance(ScoreCurve(merged, x), BLUR, ("exposure_s", *SETTING), criterion)


def endurances_across(table: ScoreTable, criterion: Criterion) -> Iterator[CurveRow]:
    """Every curve through at least two points over an axis of the setting on which a detector fails, at one exposure
    and velocity."""
    for name in SETTING:
        if axis(name).fails:
            yield from _along(table.take(table.measured), name, criterion)


def _along(table: ScoreTable, name: str, criterion: Criterion) -> Iterator[CurveRow]:
    for line in table.along(name):
        if len(line) > 1:
            fixed = [each for each in NAMES if each != name]
            yield _endurance(ScoreCurve.over(name, line), name, fixed, criterion)


def _endurance(curve: ScoreCurve, over: str, fixed: Collection[str], criterion: Criterion) -> CurveRow:
    """How one curve holds: the score against one axis, or blur, all ``fixed`` axes staying as they are.

    fails_at: x[0] where the curve is below the criterion throughout. Ends of intervals are None where they are not
    reached within the range.
    """
    line, windows = curve.line, curve.windows(criterion.level)
    at = AxisValues.of({name: value for name, value in line.at(0).items() if name in fixed})
    above = line.mean >= criterion.level
    auc, (auc_low, auc_high) = curve.area()
    fails_low, fails_high = curve.fails_between(criterion.level)
    return CurveRow(
        model=line.model,
        group=line.group,
        illuminance_lux=at["illuminance_lux"],
        axis=over,
        conditions=at,
        x=curve.x,
        confidence=tuple(line.mean.tolist()),
        auc=auc,
        fails_at=None if above[-1] else windows[-1][1] if windows else curve.x[0],
        fails_low=fails_low,
        fails_high=fails_high,
        non_monotonic=bool((above[1:] & ~above[:-1]).any()),
        auc_low=auc_low,
        auc_high=auc_high,
        n_pictures=line.sizes["n_pictures"],
        few_pictures=line.sizes["few_pictures"],
        criterion=criterion.text,
    )


def _coordinate(x: ArrayLike, logarithmic: bool) -> tuple[Array, bool]:
    """Where the values x are on their axis, and whether these are logarithms: lines are straight there."""
    values = np.asarray(x, float)
    is_log = logarithmic and bool((values > 0).all())
    return np.log(values) if is_log else values, is_log


def _trapezoid_weights(x: Array) -> Array:
    """Weights (N,) of values at increasing x in their mean over the range, straight between them."""
    if len(x) < 2 or not np.isfinite(x).all():  # a value that the camera sets has no place on its axis
        return np.full(len(x), 1 / max(len(x), 1))
    steps = np.diff(x, prepend=x[0], append=x[-1])
    return np.asarray((steps[:-1] + steps[1:]) / 2 / (x[-1] - x[0]))
