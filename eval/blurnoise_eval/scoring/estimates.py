"""Estimates with what each cluster of pictures contributes, so that whatever is made of them has an interval.

Domain: clusters are numbered over a whole run, alike in every estimate; NaN: a cluster has no say in it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from blurnoise_eval.scoring import certainty

Array = NDArray[np.float64]
MOST_CLUSTERS = 128
"""Further clusters are joined to these: leaving out a hundred groups in turn tells as much as leaving out each."""


class Estimate(NamedTuple):
    """A value, None where it is undefined, and the clusters' departures (n,), None where none are known.

    cautious: a lower one, where the value is known to lie above what many pictures would give: the interval
    reaches down to its own.
    """

    value: float | None
    departures: Array | None = None
    cautious: Estimate | None = None

    def interval(self, within: tuple[float, float | None] | None) -> tuple[float | None, float | None]:
        """Its 95 % interval, None below :data:`~blurnoise_eval.scoring.certainty.FEWEST` clusters.

        within: the least and the greatest value it can have; None for one without both. Without a greatest a
        cluster nobody has seen counts as the worst that was seen, or as 1: no alarm in ten pictures is not none.
        """
        if self.value is None or self.departures is None or not math.isfinite(self.value):
            return None, None
        bounds = None
        if within is not None:
            most = self.value + float(np.nanmax(self.departures, initial=0.0))
            bounds = within[0], max(1.0, most) if within[1] is None else within[1]
        low, high = (float(end) for end in certainty.interval(self.value, self.departures, within=bounds))
        if not (math.isfinite(low) and math.isfinite(high)):
            return None, None
        least = None if self.cautious is None else self.cautious.interval(within)[0]
        return low if least is None else min(low, least), high

    def columns(self, name: str, within: tuple[float, float | None] | None) -> dict[str, float | None]:
        """As columns of a table: NAME, NAME_low, NAME_high; nothing here lies below 0."""
        low, high = self.interval(within)
        low = low if low is None else max(low, 0.0)
        return {name: self.value, f"{name}_low": low, f"{name}_high": high}


def mean(sums: ArrayLike, counts: ArrayLike) -> Estimate:
    """Sum over clusters of ``sums`` (n,) by that of ``counts`` (n,)."""
    value = float(certainty.mean_of(sums, counts))
    return Estimate(None) if math.isnan(value) else Estimate(value, certainty.departures(sums, counts))


def left_out(values: ArrayLike, cautious: ArrayLike | None = None) -> Estimate:
    """Of a measure (1 + n,): of all, then without each cluster; cautious: the same of a lower one, none below 0."""
    every = np.asarray(values, float)
    if not math.isfinite(every[0]):
        return Estimate(None)
    lower = None if cautious is None else left_out(np.maximum(cautious, 0.0))
    if lower is not None and not (lower.value is not None and lower.value < every[0]):
        lower = None
    return Estimate(float(every[0]), certainty.jackknife(every[0], every[1:]), lower)


def all_and_without(counts: ArrayLike) -> Array:
    """Totals over clusters (n, ...), then those without each, (1 + n, ...)."""
    each = np.asarray(counts, float)
    total = each.sum(axis=0, keepdims=True)
    return np.concatenate([total, total - each])


def through(estimates: Sequence[Estimate], of: Callable[[Sequence[float]], float | None]) -> Estimate:
    """A linear function ``of`` the estimates' values, such as a weighted mean; all of them are defined."""
    value = of([float(np.nan if each.value is None else each.value) for each in estimates])
    lower = None
    if any(each.cautious for each in estimates):
        lower = through([each.cautious or each for each in estimates], of)
    known = [each.departures for each in estimates if each.departures is not None]
    if value is None or len(known) < len(estimates) or not known:
        return Estimate(value)
    table = np.array(known)
    said = np.asarray(np.isfinite(table).any(axis=0))
    filled = np.where(np.isfinite(table), table, 0.0)  # without that cluster nothing would change
    found = [
        of(column.tolist()) if there else None for column, there in zip(filled.T, said.tolist(), strict=True)
    ]
    return Estimate(value, np.array([np.nan if each is None else each for each in found], float), lower)


def mean_of(estimates: Sequence[Estimate]) -> Estimate:
    """Mean of estimates, all of which are defined."""
    return through(estimates, lambda values: float(np.mean(values))) if estimates else Estimate(None)


def ratio(one: Estimate, other: Estimate) -> Estimate:
    """One estimate by the other; undefined where that is 0. What is cautious in both cancels."""
    if one.value is None or not other.value:
        return Estimate(None)
    value = one.value / other.value
    if one.departures is None or other.departures is None:
        return Estimate(value)
    return Estimate(value, (one.departures - value * other.departures) / other.value)
