"""Uncertainty of means over pictures: estimates with their intervals, and a bound on what a choice loses.

The unit is the cluster: a picture with its targets and noise fields, or the frames of one drive. Clusters are
numbered over a whole run, alike in every estimate, and are the first axis, n, of every array; NaN: not measured in
one. Their influence is what leaving each out makes of a value (the jackknife). Every level has its interval by
:func:`of_level`, every difference paired by cluster by :func:`of_difference`, every choice its bound by
:func:`regret_bound`; all are NaN below ``FEWEST`` clusters, and two-sided at 95 % unless another confidence is given.
A value that was chosen for being the highest is too high by its :func:`selection_bias`.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from blurnoise_eval.store.columns import WithInterval

FEWEST = 8
"""Clusters below which there is no interval and no verdict. Where sizes differ, counted as :func:`effective`."""
FEW = 20
"""Clusters below which an answer is flagged, counted alike."""
CONFIDENCE = 0.95
NORMAL = 1.96
"""Standard errors to either side of the mean that hold 95 % of a normal distribution."""
UNSEEN = 0.25
"""Weight of the unseen cluster at the bound, in clusters; with 0.1 the coverage is too low, with 0.5 too high."""
SURPASS = 2.5
"""So many times the best cluster's share of the score on the original pictures, or all of that, an unseen one may
keep; with 2 too few intervals of made-up photographs hold."""
DRAWS = 1000
MOST_CLUSTERS = 128
"""Further clusters are joined to these: leaving out a hundred groups in turn tells as much as leaving out each."""
Array = NDArray[np.float64]


class ClusterEstimate(NamedTuple):
    """A value, None where it is undefined, and the clusters' influence on it (n,), None where it is not known.

    cautious: the estimate corrected for upward bias at few pictures, where that is known; the interval extends to its
    lower end.

    >>> estimate = mean([1, 2, 3], [2, 4, 4])
    >>> estimate.value, round(float(estimate.pseudo_values.mean()), 6)
    (0.6, 0.6)
    """

    value: float | None
    influence: Array | None = None
    cautious: ClusterEstimate | None = None

    @property
    def pseudo_values(self) -> Array:
        """Of each cluster, (n,); their mean is the value (Tukey)."""
        away = np.asarray(self.influence, float)
        return np.asarray((self.value or 0.0) + away - np.nanmean(away))


def ratio_of_sums(sums: ArrayLike, counts: ArrayLike) -> Array:
    """Sum over clusters of ``sums`` (n, ...) by that of ``counts`` (n, ...), NaN where nothing was measured.

    >>> ratio_of_sums([1, 2], [2, 2]), ratio_of_sums([0, 0], [0, 0])
    (array(0.75), array(nan))
    """
    total, count = np.nansum(sums, axis=0), np.nansum(counts, axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.where(count > 0, total / count, np.nan))


def influence(sums: ArrayLike, counts: ArrayLike) -> Array:
    """What each cluster contributes to a ratio of sums, (n, ...), by leaving it out.

    NaN for clusters in which nothing is counted nor found: they say nothing of this ratio.

    >>> influence([1, 0], [1, 1])  # leaving the first out makes .5 of the mean 0
    array([ 0.5, -0.5])
    """
    total, count = np.asarray(sums, float), np.asarray(counts, float)
    with np.errstate(invalid="ignore", divide="ignore"):
        # Something may be found where nothing is counted: a kept share counts the score on the original picture.
        here = np.where((count > 0) | (total > 0), count, np.nan)
        others = (np.nansum(here, axis=0) - here) / (np.isfinite(here).sum(axis=0) - 1)
        away = (total - ratio_of_sums(total, count) * here) / others
        return np.asarray(np.where(others > 0, away, np.nan))


def mean(sums: ArrayLike, counts: ArrayLike) -> ClusterEstimate:
    """Sum over clusters of ``sums`` (n,), divided by that of ``counts`` (n,).

    >>> mean([1, 2], [2, 2]).value
    0.75
    """
    value = float(ratio_of_sums(sums, counts))
    return ClusterEstimate(None) if math.isnan(value) else ClusterEstimate(value, influence(sums, counts))


def left_out(values: ArrayLike, cautious: ArrayLike | None = None) -> ClusterEstimate:
    """The estimate of a measure (1 + n,) of all clusters, then without each of them; NaN where it is not defined.

    cautious: the same of the measure corrected for upward bias, which is clipped at 0.

    >>> left_out([0.5, 0.4, 0.6]).influence
    array([ 0.1, -0.1])
    """
    every = np.asarray(values, float)
    whole, without = float(every[0]), every[1:]
    if not math.isfinite(whole):
        return ClusterEstimate(None)
    lower = None if cautious is None else left_out(np.maximum(cautious, 0.0))
    # The correction is one for bias upwards: where it would raise the value, noise has it.
    kept = lower if lower is not None and lower.value is not None and lower.value < whole else None
    return ClusterEstimate(whole, (np.isfinite(without).sum() - 1) * (whole - without), kept)


def all_and_without(each: NDArray[Any]) -> NDArray[Any]:
    """Totals over clusters of numbers (n, ...), then the totals without each cluster, (1 + n, ...).

    >>> all_and_without(np.array([[1], [2], [4]])).ravel().tolist()
    [7, 6, 5, 3]
    """
    every = np.empty((1 + len(each), *each.shape[1:]), each.dtype)
    each.sum(axis=0, out=every[0])
    np.subtract(every[0], each, out=every[1:])
    return every


def mean_of(estimates: Sequence[ClusterEstimate]) -> ClusterEstimate:
    """Mean of estimates that are all defined; undefined of none.

    A cluster that has no say in one of them leaves that as it is.

    >>> mean_of([ClusterEstimate(0.4), ClusterEstimate(0.6)]).value
    0.5
    """
    if not estimates:
        return ClusterEstimate(None)
    value = float(np.mean([each.value for each in estimates if each.value is not None]))
    known = [each.influence for each in estimates if each.influence is not None]
    if len(known) < len(estimates):
        return ClusterEstimate(value)
    away = np.where(np.isfinite(known).any(axis=0), np.nan_to_num(known).mean(axis=0), np.nan)
    lower = [each.cautious or each for each in estimates] if any(each.cautious for each in estimates) else []
    return ClusterEstimate(value, away, mean_of(lower) if lower else None)


def ratio(one: ClusterEstimate, other: ClusterEstimate) -> ClusterEstimate:
    """One estimate by the other; undefined where that is 0. What is cautious in both cancels.

    >>> ratio(ClusterEstimate(0.45), ClusterEstimate(0.9)).value
    0.5
    """
    if one.value is None or not other.value:
        return ClusterEstimate(None)
    value = one.value / other.value
    if one.influence is None or other.influence is None:
        return ClusterEstimate(value)
    return ClusterEstimate(value, (one.influence - value * other.influence) / other.value)


class Ends(NamedTuple):
    """An interval: arrays of one shape, NaN where there is none."""

    low: Array
    high: Array


def student_t(n: ArrayLike, confidence: float = CONFIDENCE) -> Array:
    """Student's t for n clusters, two-sided; NaN below 2.

    >>> student_t([8, 1000]).round(2).tolist()
    [2.36, 1.96]
    """
    from scipy.special import stdtrit  # takes 0.1 s

    count = np.asarray(n, float)
    return np.asarray(np.where(count > 1, stdtrit(np.maximum(count - 1, 1), (1 + confidence) / 2), np.nan))


def effective(sizes: ArrayLike) -> Array:
    """How many clusters of equal size are worth these of ``sizes`` k (n, ...): (sum k)^2 / sum k^2 (Kish).

    >>> float(effective([1, 1, 1, 1])), float(effective([3, 1]))
    (4.0, 1.6)
    """
    size = np.asarray(sizes, float)
    square = (size**2).sum(axis=0)
    return np.asarray(np.where(square > 0, size.sum(axis=0) ** 2 / np.where(square > 0, square, 1.0), 0.0))


def enough(clusters: ArrayLike) -> NDArray[np.bool_]:
    """Whether so many clusters, counted or :func:`effective`, are enough for an interval.

    >>> enough([7, 8]).tolist()
    [False, True]
    """
    return np.asarray(np.asarray(clusters) >= FEWEST)


def pictures_needed(margin: float, spread: float, away: float, most: int) -> int:
    """How many clusters put the end of :func:`bounded` at most ``margin`` from the mean; ``most + 1``: more.

    They suffice in about half of such cases, since the mean itself is uncertain.

    spread: standard deviation of the clusters' influence. away: distance from the mean to the bound at that end.
    Of the clusters' random weights (exponential, n of them) the sum by their margins is taken for normal, of variance
    n (margin^2 + spread^2); against it pulls the unseen cluster, of weight Gamma(``UNSEEN``).

    >>> pictures_needed(margin=0.1, spread=0.3, away=0.7, most=9999), pictures_needed(0.2, 0.3, 0.7, 9999)
    (43, 15)
    """
    from scipy.special import gammaincinv, ndtr  # takes 0.1 s

    # Instead of random draws, so that the answer is the same every time.
    unseen = gammaincinv(UNSEEN, (np.arange(200) + 0.5) / 200)  # equally likely weights

    def suffices(n: int) -> bool:
        spare = margin * n - unseen * (away - margin)
        return float(ndtr(spare / (math.hypot(spread, margin) * math.sqrt(n))).mean()) >= (1 + CONFIDENCE) / 2

    return 1 + bisect_left(range(1, most + 1), True, key=suffices) if margin > 0 else most + 1


def of_level(
    mean: ArrayLike,
    influence: ArrayLike,
    most: ArrayLike = 1.0,
    sigma: ArrayLike = 0.0,
    clusters: ArrayLike = math.inf,
) -> Ends:
    """The interval of a mean (...) of values from 0 to ``most``, by the clusters' influence on it (n, ...).

    most: of a kept share 1 by the score in the original pictures, or infinite, see :func:`reach`. sigma: standard
    deviation (...) of a mean that is predicted, beside what clusters differ by; the squares of half-widths add.
    clusters: how many they are worth, where sizes differ, as :func:`effective`.

    >>> away = np.array([0.3, -0.3] * 10)
    >>> low, high = of_level(0.6, away)
    >>> 0.4 < float(low) < 0.6 < float(high) < 0.8
    True
    """
    middle, half = np.asarray(mean, float), NORMAL * np.asarray(sigma, float)
    known = enough(np.isfinite(np.asarray(influence, float)).sum(axis=0)) & enough(clusters)
    if not known.any():
        nowhere = np.full(np.broadcast(middle, known).shape, np.nan)
        return Ends(nowhere, nowhere)
    within = 0.0, reach(mean, influence, most)
    low, high = (np.where(known, end, np.nan) for end in bounded(mean, influence, within))
    if half.any():
        # What clusters differ by and what a prediction misses are independent: their squares add.
        low, high = middle - np.hypot(middle - low, half), middle + np.hypot(high - middle, half)
    return Ends(low.clip(0.0, most), high.clip(0.0, most))


def reach(mean: ArrayLike, influence: ArrayLike, most: ArrayLike) -> Array:
    """What an unseen cluster may have at most, where ``most`` is possible; arguments as of :func:`of_level`.

    A kept share may be as high as 1 by a score of .07 on the original pictures, which no picture keeps. There it is
    ``SURPASS`` times what the best cluster has, or 1.

    >>> away = np.array([0.3, -0.3] * 10)
    >>> reach(0.6, away, 1.0), reach(0.6, away, 14.0)
    (array(1.), array(2.5))
    """
    best = np.asarray(mean, float) + _centred(influence)[0].max(axis=0, initial=0.0)
    return np.asarray(np.minimum(most, SURPASS * np.maximum(1.0, best)))


def of_difference(mean: ArrayLike, influence: ArrayLike, confidence: float = CONFIDENCE) -> Ends:
    """Student's interval of a difference paired by cluster, or of what has no bounds.

    >>> low, high = of_difference(0.1, np.array([0.2, -0.2] * 10))
    >>> bool(low < 0.1 < high), round(float(high - 0.1), 3)  # t times .2 / sqrt(19)
    (True, 0.096)
    """
    n, error = _summary(influence)
    middle, half = np.asarray(mean, float), student_t(n, confidence) * error
    return Ends(*(np.where(enough(n), end, np.nan) for end in (middle - half, middle + half)))


def interval_of(estimate: ClusterEstimate, most: float | None) -> tuple[float | None, float | None]:
    """The 95 % interval of an estimate, None from too few clusters.

    most: the greatest value that it can have, as of :func:`of_level`; None of a difference.

    >>> interval_of(ClusterEstimate(0.5, np.zeros(7)), 1.0)  # seven clusters are too few
    (None, None)
    """
    value, away = estimate.value, estimate.influence
    if value is None or away is None or not math.isfinite(value):
        return None, None
    ends = of_difference(value, away) if most is None else of_level(value, away, most)
    low, high = (float(end) for end in ends)
    if not (math.isfinite(low) and math.isfinite(high)):
        return None, None
    cautious = None if estimate.cautious is None else interval_of(estimate.cautious, most)[0]
    return low if cautious is None else min(low, cautious), high


def with_interval(estimate: ClusterEstimate, most: float) -> WithInterval:
    """An estimate as rows have it.

    >>> with_interval(ClusterEstimate(0.5), 1.0)
    WithInterval(value=0.5, low=None, high=None)
    """
    return WithInterval(estimate.value, *interval_of(estimate, most))


def bounded(mean: ArrayLike, influence: ArrayLike, within: tuple[ArrayLike, ArrayLike]) -> Ends:
    """The interval of a mean of values that lie ``within`` two bounds, whatever the number of clusters.

    Of clusters that are all alike, or of which few stand out, Student sees no spread. So for either end an unseen
    cluster is added, which lies at that bound and counts ``UNSEEN`` of a cluster; the ends are quantiles of the mean
    with all clusters weighted at random (the Bayesian bootstrap, Rubin, Ann. Statist. 9 (1981) 130; of shares, and
    with half a cluster, it is Jeffreys' interval; with a whole one Gaffke's bound).
    """
    away, measured = _centred(influence)
    middle = np.asarray(mean, float)
    weight, unseen = _weights(len(away))
    unseen = unseen.reshape(len(weight), *(1,) * (away.ndim - 1))
    total = np.tensordot(weight, measured.astype(float), 1) + unseen
    moved = np.tensordot(weight, away, 1)
    side = (1 - CONFIDENCE) / 2
    ends = []
    for bound, share in zip(within, (side, 1 - side), strict=True):
        drawn = (moved + unseen * (np.asarray(bound, float) - middle)) / total
        end = middle + np.quantile(drawn, share, axis=0)
        ends.append(np.where(measured.any(axis=0), np.clip(end, *within), np.nan))
    return Ends(*ends)


def regret_bound(
    influence: ArrayLike, gain: ArrayLike, confidence: float = CONFIDENCE, *, sigma: ArrayLike = 0.0
) -> Array:
    """What a choice loses at most against the best of its rivals, at ``confidence`` (one-sided), at least 0.

    gain: (S,) mean of each rival less that of the choice. influence: (n, S) of the same differences, paired by
    cluster. sigma: (S,) standard error of the gains beside that of the influence. Multiple comparisons with the best
    (Hsu, Ann. Statist. 9 (1981) 1026) by the largest of the rivals' upper bounds, which hold together: with the
    quantile of the largest of S Student's t as correlated as the influence.
    """
    away, _ = _centred(influence)
    n, error = _summary(influence)
    known = enough(n)
    if not known.any():
        return np.asarray(np.nan)
    with np.errstate(invalid="ignore", divide="ignore"):
        alike = np.where(error > 0, away / (error * n), 0.0)[:, known]
    largest = (_normal(len(away)) @ alike).max(axis=1)
    fewest = int(n[known].min()) - 1
    scale = np.sqrt(np.random.default_rng(1).chisquare(fewest, len(largest)) / fewest)
    together = float(np.quantile(largest / scale, confidence))
    limit = np.maximum(student_t(n[known], 2 * confidence - 1), together)
    wide = np.hypot(error, sigma)[known]
    return np.asarray(max(0.0, float((np.asarray(gain, float)[known] + limit * wide).max())))


def selection_bias(
    mean: ArrayLike,
    influence: ArrayLike,
    chosen: int,
    choose: Callable[[Array], NDArray[np.int64]],
) -> Array:
    """How much too high N parts (N,) of a mean are because it was chosen for it among S: the winner's curse.

    mean: (S,). influence: (n, N, S) on the parts, of which it is the mean. choose: from means (..., S) to the places
    chosen, (...). The choice is repeated with the clusters weighted at random, as in :func:`bounded`; by how much
    those chosen there depart more than the chosen one is the bias (Sun and Bull, Genet. Epidemiol. 28 (2005) 352).
    As pictures exaggerate by how much the chosen one leads, leads g of standard error s are taken for
    g^3 / (g^2 + s^2). 0 where there is no choice; the error of predictions is not in it.

    >>> away = np.random.default_rng(0).normal(scale=0.3, size=(20, 1, 5))
    >>> none = selection_bias(np.zeros(1), away[..., :1], 0, lambda values: values.argmax(axis=-1))
    >>> some = selection_bias(np.zeros(5), away, 0, lambda values: values.argmax(axis=-1))
    >>> float(none[0]), bool(0.06 < some[0] < 0.09)  # the best of five that are alike, each known to .067
    (0.0, True)
    """
    value = np.asarray(mean, float)
    away, measured = _centred(influence)
    together, any_part = away.mean(axis=1), np.asarray(measured.any(axis=1))
    paired = np.where(any_part & any_part[:, [chosen]], together - together[:, [chosen]], np.nan)
    lead, error = value - value[chosen], _summary(paired)[1]
    square = lead**2 + error**2
    lead = np.where(square > 0, lead**3 / np.where(square > 0, square, 1.0), 0.0)
    weight = _weights(len(away))[0][: DRAWS // 2]  # a mean needs fewer draws than the ends of an interval
    total = weight @ any_part.astype(float)
    total[total == 0] = 1.0
    place = choose(value[chosen] + lead + weight @ together / total)
    picked = np.zeros((len(value), len(weight)))
    picked[place, np.arange(len(weight))] = 1.0
    picked[chosen] -= 1.0
    return np.asarray(np.einsum("sn,nps->p", (picked / total.T) @ weight / len(weight), away))


def sigma_of_differences(covariance: ArrayLike, chosen: int) -> Array:
    """Standard deviations (S,) of the differences of S values from the chosen one, by their covariance (S, S)."""
    of = np.asarray(covariance, float)
    own = np.diag(of)
    return np.asarray(np.sqrt(np.maximum(own + own[chosen] - 2 * of[chosen], 0.0)))


def behind_best(mean: ArrayLike, influence: ArrayLike) -> Ends:
    """Intervals (S,) of how much less each of S means is than the greatest of them.

    influence: (n, S), paired by cluster. The same clusters choose which mean is greatest: so the intervals are
    Student's of all differences of two means, together at 95 % (Bonferroni).
    """
    value, away = np.asarray(mean, float), np.asarray(influence, float)
    best, pairs = int(value.argmax()), max(len(value) * (len(value) - 1) // 2, 1)
    return of_difference(value[best] - value, away[:, [best]] - away, 1 - (1 - CONFIDENCE) / pairs)


@lru_cache(maxsize=4)
def _weights(clusters: int) -> tuple[Array, Array]:
    """Random weights of the clusters, (DRAWS, clusters), and of the unseen one, (DRAWS,)."""
    generator = np.random.default_rng(0)
    return generator.exponential(size=(DRAWS, clusters)), generator.gamma(UNSEEN, size=DRAWS)


@lru_cache(maxsize=4)
def _normal(clusters: int) -> Array:
    return np.random.default_rng(0).normal(size=(2 * DRAWS, clusters))


def _centred(influence: ArrayLike) -> tuple[Array, NDArray[np.bool_]]:
    """Return (centred influence, 0 where missing; mask of measured clusters), both (n, ...)."""
    away = np.asarray(influence, float)
    measured = np.isfinite(away)
    mean = np.where(measured, away, 0.0).sum(axis=0) / np.maximum(measured.sum(axis=0), 1)
    return np.where(measured, away - mean, 0.0), measured


def _summary(z: ArrayLike) -> tuple[Array, Array]:
    """Per column of z (n, ...): number and standard error."""
    away, measured = _centred(z)
    n = measured.sum(axis=0).astype(float)
    with np.errstate(invalid="ignore", divide="ignore"):
        error = np.sqrt((away**2).sum(axis=0) / np.maximum(n - 1, 1) / n)
    largest = np.abs(np.where(measured, np.asarray(z, float), 0.0)).max(axis=0, initial=1e-300)
    return n, np.where(error <= 1e-12 * largest, 0.0, error)  # equal values, up to rounding
