"""Certainty of means over pictures: tests, intervals, and a bound on what a choice loses.

The unit is the cluster: a picture with its targets and noise fields, or the frames of one drive. n clusters stand
on the first axis of every array; what is not measured in one is NaN there and does not count. Tests and intervals
are of Student and of Hall (J. R. Statist. Soc. B 54 (1992) 221: Student's t with the skewness of the mean taken
out, monotone), joined: something counts as certain only where both say so. Two-sided at 95 % unless stated.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

FEWEST = 8
"""Clusters below which nothing is said about certainty: no interval, no verdict."""
FEW = 20
"""Clusters below which what is said is flagged."""
CONFIDENCE = 0.95
Array = NDArray[np.float64]


class Ends(NamedTuple):
    """An interval: arrays of one shape, NaN where there is none."""

    low: Array
    high: Array


class Test(NamedTuple):
    """Whether a mean is above or below 0. above: at least ``critical`` of it: surely above; below: at most minus
    that: surely below. Minus and plus infinity from fewer than ``FEWEST`` clusters: never sure."""

    above: Array
    below: Array


def critical(n: ArrayLike, confidence: float = CONFIDENCE) -> Array:
    """Student's t for n clusters, two-sided; NaN below 2."""
    from scipy.special import stdtrit  # takes 0.1 s

    count = np.asarray(n, float)
    return np.asarray(np.where(count > 1, stdtrit(np.maximum(count - 1, 1), (1 + confidence) / 2), np.nan))


def test(z: ArrayLike) -> Test:
    """Student's and Hall's statistics of the mean of ``z`` (n, ...) against 0, (...): the lesser and the greater."""
    n, mean, error, lean = _summary(z)
    with np.errstate(divide="ignore", invalid="ignore"):
        student = np.where(error > 0, mean / error, np.sign(mean) * np.inf)
        student = np.where((error == 0) & (mean == 0), 0.0, student)
        hall = student + lean * student**2 / 3 + lean**2 * student**3 / 27 + lean / 6
    hall = np.where(np.isfinite(hall), hall, student)
    known = n >= FEWEST
    return Test(
        np.where(known, np.minimum(student, hall), -np.inf),
        np.where(known, np.maximum(student, hall), np.inf),
    )


def mean_of(sums: ArrayLike, counts: ArrayLike) -> Array:
    """Sum over clusters of ``sums`` (n, ...) by that of ``counts`` (n, ...), NaN where nothing was measured."""
    total, count = np.nansum(sums, axis=0), np.nansum(counts, axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.where(count > 0, total / count, np.nan))


def departures(sums: ArrayLike, counts: ArrayLike) -> Array:
    """What each cluster contributes to the mean's departure, (n, ...): linearised, their mean is 0.

    NaN for clusters in which nothing is counted: they say nothing of this mean.
    """
    total, count = np.asarray(sums, float), np.asarray(counts, float)
    with np.errstate(invalid="ignore", divide="ignore"):
        here = np.where(count > 0, count, np.nan)
        each = np.nansum(here, axis=0) / np.isfinite(here).sum(axis=0)
        return np.asarray((total - mean_of(total, count) * here) / each)


def interval(centre: ArrayLike, departure: ArrayLike, confidence: float = CONFIDENCE) -> Ends:
    """The values of a mean that neither test rejects, from its estimate (...) and :func:`departures` (n, ...).

    NaN from fewer than ``FEWEST`` clusters.
    """
    n, _, error, lean = _summary(departure)
    middle, t = np.asarray(centre, float), critical(n, confidence)
    with np.errstate(invalid="ignore", divide="ignore"):
        steep = np.abs(lean) > 1e-6
        apart = np.where(steep, lean, 1.0)
        high, low = (  # Hall's statistic solved for Student's, at either critical value
            np.where(steep, 3 / apart * (np.cbrt(1 + apart * (-side - apart / 6)) - 1), -side)
            for side in (t, -t)
        )
    known = n >= FEWEST
    ends = (
        np.where(known, middle - np.maximum(t, low) * error, np.nan),
        np.where(known, middle - np.minimum(-t, high) * error, np.nan),
    )
    return Ends(*ends)


def regret_bound(departure: ArrayLike, gain: ArrayLike, confidence: float = CONFIDENCE) -> Array:
    """What a choice loses at most against the best of its rivals, at ``confidence`` (one-sided), at least 0.

    gain: (S,) mean of each rival less that of the choice. departure: (n, S) of the same differences, paired by
    cluster. Multiple comparisons with the best (Hsu, Ann. Statist. 9 (1981) 1026) by the largest of the rivals'
    upper bounds. NaN from fewer than ``FEWEST`` clusters.
    """
    n, _, error, _ = _summary(departure)
    bound = np.asarray(gain, float) + critical(n, 2 * confidence - 1) * error
    if not bound.size or not (n >= FEWEST).any():
        return np.asarray(np.nan)
    return np.asarray(max(0.0, float(np.nanmax(np.where(n >= FEWEST, bound, np.nan)))))


def _summary(z: ArrayLike) -> tuple[Array, Array, Array, Array]:
    """Per column of z (n, ...): number, mean, standard error, and skewness by the root of the number."""
    values: Any = np.asarray(z, float)
    measured = np.isfinite(values)
    n = measured.sum(axis=0).astype(float)
    filled = np.where(measured, values, 0.0)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = filled.sum(axis=0) / n
        away = np.where(measured, values - mean, 0.0)
        square = (away**2).sum(axis=0)
        error = np.sqrt(square / np.maximum(n - 1, 1) / n)
        lean = np.where(square > 0, (away**3).sum(axis=0) / n / (square / n) ** 1.5, 0.0) / np.sqrt(n)
    tiny = error <= 1e-12 * np.maximum(np.abs(mean), 1e-300)  # equal values, up to rounding
    return n, mean, np.where(tiny, 0.0, error), np.where(tiny, 0.0, lean)
