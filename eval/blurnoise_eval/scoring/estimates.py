"""Estimates with what each cluster of pictures contributes, so that whatever is made of them has an interval.

Domain: clusters are numbered over a whole run, alike in every estimate, and stand on the first axis of every array;
NaN: a cluster has no say in it. Their influence is what leaving each out makes of a value (the jackknife).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
MOST_CLUSTERS = 128
"""Further clusters are joined to these: leaving out a hundred groups in turn tells as much as leaving out each."""


class Estimate(NamedTuple):
    """A value, None where it is undefined, and the clusters' influence on it (n,), None where it is not known.

    cautious: a lower one, where the value is known to lie above what many pictures would give: the interval
    reaches down to its own.
    """

    value: float | None
    influence: Array | None = None
    cautious: Estimate | None = None

    @property
    def pseudo_values(self) -> Array:
        """Of each cluster, (n,); their mean is the value (Tukey)."""
        away = np.asarray(self.influence, float)
        return np.asarray((self.value or 0.0) + away - np.nanmean(away))


def ratio_of_sums(sums: ArrayLike, counts: ArrayLike) -> Array:
    """Sum over clusters of ``sums`` (n, ...) by that of ``counts`` (n, ...), NaN where nothing was measured."""
    total, count = np.nansum(sums, axis=0), np.nansum(counts, axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.where(count > 0, total / count, np.nan))


def influence(sums: ArrayLike, counts: ArrayLike) -> Array:
    """What each cluster contributes to a ratio of sums, (n, ...), by leaving it out.

    NaN for clusters in which nothing is counted nor found: they say nothing of this ratio.
    """
    total, count = np.asarray(sums, float), np.asarray(counts, float)
    with np.errstate(invalid="ignore", divide="ignore"):
        here = np.where((count > 0) | (total > 0), count, np.nan)
        others = (np.nansum(here, axis=0) - here) / (np.isfinite(here).sum(axis=0) - 1)
        found = (total - ratio_of_sums(total, count) * here) / others
        return np.asarray(np.where(others > 0, found, np.nan))


def influence_of(whole: ArrayLike, without: ArrayLike) -> Array:
    """Of each cluster (n, ...) on any measure, from its value (...) and those with each left out (n, ...).

    NaN where the measure is not defined without the cluster.
    """
    left = np.asarray(without, float)
    n = np.isfinite(left).sum(axis=0)
    return np.asarray((n - 1) * (np.asarray(whole, float) - left))


def mean(sums: ArrayLike, counts: ArrayLike) -> Estimate:
    """Sum over clusters of ``sums`` (n,) by that of ``counts`` (n,)."""
    value = float(ratio_of_sums(sums, counts))
    return Estimate(None) if math.isnan(value) else Estimate(value, influence(sums, counts))


def left_out(values: ArrayLike, cautious: ArrayLike | None = None) -> Estimate:
    """Of a measure (1 + n,): of all, then without each cluster; cautious: the same of a lower one, none below 0."""
    whole, *without = np.asarray(values, float).tolist()
    if not math.isfinite(whole):
        return Estimate(None)
    lower = None if cautious is None else left_out(np.maximum(cautious, 0.0))
    kept = lower if lower is not None and (lower.value or 0.0) < whole and lower.value is not None else None
    return Estimate(whole, influence_of(whole, without), kept)


def all_and_without(each: NDArray[Any]) -> NDArray[Any]:
    """Totals over clusters of numbers (n, ...), then those without each, (1 + n, ...)."""
    every = np.empty((1 + len(each), *each.shape[1:]), each.dtype)
    each.sum(axis=0, out=every[0])
    np.subtract(every[0], each, out=every[1:])
    return every


def mean_of(estimates: Sequence[Estimate]) -> Estimate:
    """Mean of estimates that are all defined; undefined of none.

    A cluster that has no say in one of them leaves that as it is.
    """
    if not estimates:
        return Estimate(None)
    value = float(np.mean([each.value for each in estimates if each.value is not None]))
    known = [each.influence for each in estimates if each.influence is not None]
    if len(known) < len(estimates):
        return Estimate(value)
    away = np.where(np.isfinite(known).any(axis=0), np.nan_to_num(known).mean(axis=0), np.nan)
    lower = [each.cautious or each for each in estimates] if any(each.cautious for each in estimates) else []
    return Estimate(value, away, mean_of(lower) if lower else None)


def ratio(one: Estimate, other: Estimate) -> Estimate:
    """One estimate by the other; undefined where that is 0. What is cautious in both cancels."""
    if one.value is None or not other.value:
        return Estimate(None)
    value = one.value / other.value
    if one.influence is None or other.influence is None:
        return Estimate(value)
    return Estimate(value, (one.influence - value * other.influence) / other.value)
