"""Intervals of means over clusters: closed forms, SciPy, exact shares, and what they hold in simulation."""

from __future__ import annotations

import math

import numpy as np
import pytest
from blurnoise_eval.scoring import uncertainty
from blurnoise_eval.scoring.uncertainty import (
    FEWEST,
    Ends,
    Estimate,
    columns,
    interval_of,
    left_out,
    mean_of,
    ratio,
)
from scipy import stats


def sample(*shape: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).gamma(0.6, size=shape)


def test_students_interval_is_scipys() -> None:
    values = sample(13, 4)
    mean = values.mean(axis=0)
    low, high = uncertainty.of_difference(mean, values - mean)
    expected = stats.t.interval(0.95, 12, mean, stats.sem(values))
    np.testing.assert_allclose((low, high), expected)
    np.testing.assert_allclose(uncertainty.student_t([13, 2], 0.9), stats.t.ppf(0.95, [12, 1]))
    assert np.isnan(uncertainty.student_t(1))


def test_nothing_is_certain_below_the_fewest() -> None:
    values = sample(FEWEST - 1, 3)
    mean = values.mean(axis=0)
    for of in (uncertainty.of_difference, uncertainty.of_level):
        assert np.isnan(of(mean, values - mean)).all()
    assert np.isnan(uncertainty.regret_bound(values - mean, mean))


def test_missing_clusters_do_not_count() -> None:
    values = sample(12, 1)
    holes = np.concatenate([values, np.full((5, 1), np.nan)])
    mean = values.mean(axis=0)
    np.testing.assert_allclose(
        uncertainty.of_difference(mean, holes - mean), uncertainty.of_difference(mean, values - mean)
    )
    low, high = uncertainty.bounded(mean, holes - mean, (0.0, 20.0))
    alone = uncertainty.bounded(mean, values - mean, (0.0, 20.0))
    # Other weights are drawn; a 2.5 % quantile of 1000 draws is known to about 0.08 sigma, k = 5.
    sigma = values.std() / np.sqrt(12)
    assert abs(float(low[0] - alone.low[0])) < 0.4 * sigma
    assert abs(float(high[0] - alone.high[0])) < 5 * sigma  # where the unseen cluster is far off


@pytest.mark.parametrize(("found", "n"), [(0, 8), (8, 8), (0, 35), (4, 20), (19, 20)])
def test_bounded_interval_of_shares_is_that_of_beta_laws(found: int, n: int) -> None:
    """With clusters that are 0 or 1 the weighted mean is beta: for either end, k and n - k, one of them with the
    unseen cluster's share. A 2.5 % quantile of 1000 draws stands for 1.2 to 4.4 % (k = 4)."""
    values = np.arange(n) < found
    low, high = uncertainty.bounded(values.mean(), values - values.mean(), (0.0, 1.0))
    unseen = uncertainty.UNSEEN
    if found:
        assert 0.012 < stats.beta.cdf(low, found, n - found + unseen) < 0.044
    else:
        assert low == 0
    if found < n:
        assert 0.012 < stats.beta.sf(high, found + unseen, n - found) < 0.044
    else:
        assert high == 1


def test_clusters_of_unequal_size_count_as_fewer() -> None:
    assert uncertainty.effective([3] * 9) == 9
    assert uncertainty.effective([1, 2, 3]) == pytest.approx(36 / 14)
    np.testing.assert_allclose(uncertainty.effective([[1, 0], [1, 0], [0, 0]]), [2, 0])


@pytest.mark.parametrize(("mean", "spread", "threshold"), [(0.7, 0.2, 0.5), (0.3, 0.2, 0.4), (0.9, 0.0, 0.8)])
def test_as_many_clusters_as_are_asked_for_suffice(mean: float, spread: float, threshold: float) -> None:
    """Against trying. Hardly fewer: a tenth is what 1000 random weights leave open. And not many more: the normal law
    reaches further down than the weights' own."""
    above = mean > threshold

    def told(n: int) -> bool:
        values = np.linspace(-1, 1, n) * np.sqrt(3 * (n - 1) / (n + 1)) * spread
        ends = uncertainty.bounded(mean, values, (0.0, 1.0))
        return bool(ends.low >= threshold if above else ends.high < threshold)

    asked = uncertainty.pictures_needed(abs(mean - threshold), spread, mean if above else 1 - mean, 999)
    tried = next(n for n in range(2, 999) if all(told(n + more) for more in range(3)))
    assert 0.9 * tried <= asked <= 1.3 * tried + 1


def test_departures_are_those_of_leaving_out() -> None:
    """Of a ratio of sums: (n - 1) (whole - without); clusters in which nothing is counted have none."""
    sums, counts = sample(9), np.array([1.0, 5, 2, 0, 3, 1, 1, 12, 2])
    sums[3] = 0
    whole = sums.sum() / counts.sum()
    expected = [
        7 * (whole - (sums.sum() - s) / (counts.sum() - c)) if c else np.nan
        for s, c in zip(sums, counts, strict=True)
    ]
    np.testing.assert_allclose(uncertainty.influence(sums, counts), expected)
    without = [
        (sums.sum() - s) / (counts.sum() - c) if c else np.nan for s, c in zip(sums, counts, strict=True)
    ]
    np.testing.assert_allclose(left_out([whole, *without]).influence, expected)
    assert uncertainty.ratio_of_sums(sums, counts) == pytest.approx(whole)
    assert np.isnan(uncertainty.ratio_of_sums([0.0], [0.0]))
    equal = uncertainty.influence(sums, np.ones(9))
    np.testing.assert_allclose(equal, sums - sums.mean())


def test_regret_of_one_rival_is_students_bound() -> None:
    """One-sided; the quantile of 2000 draws may lie a little above."""
    gaps = sample(12) - 0.6
    expected = stats.ttest_1samp(gaps, 0, alternative="less").confidence_interval(0.95).high
    found = float(uncertainty.regret_bound((gaps - gaps.mean())[:, None], gaps.mean()[None]))
    assert expected - 1e-12 <= found < expected + 0.15 * stats.sem(gaps)


def held(ends: Ends, truth: float) -> float:
    return float(np.mean((ends.low <= truth) & (truth <= ends.high)))


@pytest.mark.parametrize("n", [8, 20, 35])
@pytest.mark.parametrize(("a", "b"), [(0.2, 2.0), (0.5, 0.5), (2.0, 5.0), (3.0, 0.15)])
def test_bounded_intervals_of_beta_means_hold(n: int, a: float, b: float) -> None:
    """Beta laws from rare to saturated: at least 93 %, less 4 standard deviations of 2000 samples (2 %)."""
    values = np.random.default_rng(n).beta(a, b, size=(n, 2000))
    mean = values.mean(axis=0)
    share = held(uncertainty.of_level(mean, values - mean), a / (a + b))
    assert share > 0.93 - 0.02
    students = held(uncertainty.of_difference(mean, values - mean), a / (a + b))
    assert share > students - 0.02  # and never far less than Student's


def test_rare_events_are_what_student_misses() -> None:
    """One cluster in 25 is 1, the others 0: eight of them are mostly all 0, whose Student's interval is nothing."""
    values = (np.random.default_rng(0).uniform(size=(8, 2000)) < 0.04).astype(float)
    mean = values.mean(axis=0)
    assert held(uncertainty.of_difference(mean, values - mean), 0.04) < 0.6
    assert held(uncertainty.of_level(mean, values - mean), 0.04) > 0.93


@pytest.mark.parametrize("n", [8, 20])
@pytest.mark.parametrize(
    "rivals", [1, 5, pytest.param(10, marks=pytest.mark.slow), pytest.param(78, marks=pytest.mark.slow)]
)
@pytest.mark.parametrize("alike", [False, True])
def test_regret_is_bounded(n: int, rivals: int, alike: bool) -> None:
    """The best by the sample's mean, of rivals with errors of their own or alike in their neighbours, of which one is
    better by about a standard error, loses more than its bound in at most 5 % of 500 samples, give or take 2 standard
    deviations (2 %). Without regard to how many there are it would in up to 24 % (20 pictures, 78 rivals)."""
    rng, missed, bounds = np.random.default_rng(n), 0, []
    place = np.linspace(-1, 1, rivals + 1)
    truth = 0.7 + 0.03 * (np.arange(rivals + 1) == rivals // 2)
    smooth = np.linalg.cholesky(
        np.exp(-(np.subtract.outer(place, place) ** 2) / 0.2) + 1e-8 * np.eye(rivals + 1)
    )
    for _ in range(500):
        own = rng.normal(size=(n, rivals + 1))
        values = truth + 0.2 * rng.normal(size=(n, 1)) + 0.06 * (own @ smooth.T if alike else own)
        chosen = int(values.mean(axis=0).argmax())
        away = values - values[:, [chosen]]
        bound = float(uncertainty.regret_bound(away - away.mean(axis=0), away.mean(axis=0)))
        missed += truth.max() - truth[chosen] > bound
        bounds.append(bound)
    assert missed / 500 <= 0.05 + 0.02
    assert 0 < np.median(bounds) < 0.15
    assert uncertainty.regret_bound(np.zeros((n, 1)), np.array([-0.3])) == 0


def test_of_a_number_without_a_bound_the_worst_that_was_seen_bounds() -> None:
    for values, best in ((np.linspace(0.7, 1.3, 13), 1.3), (np.linspace(0.2, 0.8, 13), 1.0)):
        away = values - values.mean()
        expected = uncertainty.bounded(values.mean(), away, (0.0, best))
        np.testing.assert_allclose(uncertainty.of_level(values.mean(), away, np.inf), expected)
    assert uncertainty.of_level(1.15, np.linspace(-0.1, 0.1, 9), 1.2).high <= 1.2


def test_intervals_behind_the_best_of_two_are_students() -> None:
    values = sample(12, 2)
    best = int(values.mean(axis=0).argmax())
    found = uncertainty.behind_best(values.mean(axis=0), values - values.mean(axis=0))
    gaps = values[:, best] - values[:, 1 - best]
    expected = stats.ttest_1samp(gaps, 0).confidence_interval(0.95)
    assert (found.low[1 - best], found.high[1 - best]) == pytest.approx((expected.low, expected.high))
    assert found.low[best] == found.high[best] == 0


def test_a_mean_of_estimates_is_the_estimate_of_the_means() -> None:
    values = np.random.default_rng(0).uniform(size=(3, 12))
    each = [uncertainty.mean(row, np.ones(12)) for row in values]
    found = uncertainty.mean_of(each)
    assert found.value == pytest.approx(values.mean())
    np.testing.assert_allclose(found.influence, values.mean(axis=0) - values.mean())
    expected = uncertainty.of_level(values.mean(), values.mean(axis=0) - values.mean())
    np.testing.assert_allclose(interval_of(found, 1.0), expected)
    assert uncertainty.mean_of([]) == Estimate(None)


def test_clusters_without_a_say_change_nothing_there() -> None:
    full, holes = np.full(9, 0.1), np.array([0.2] * 7 + [np.nan] * 2)
    found = uncertainty.mean_of([Estimate(0.5, full), Estimate(0.7, holes)])
    np.testing.assert_allclose(found.influence, [0.15] * 7 + [0.05] * 2)
    both = uncertainty.mean_of([Estimate(0.5, holes), Estimate(0.7, holes)])
    assert np.isnan(both.influence[-1])
    assert uncertainty.mean_of([Estimate(0.5, full), Estimate(0.7)]).influence is None


def test_departures_of_a_ratio_are_those_of_leaving_out() -> None:
    """To first order in 1/n: twenty clusters, 5 %."""
    rng = np.random.default_rng(1)
    above, below = rng.uniform(0.2, 0.4, 20), rng.uniform(0.6, 0.9, 20)
    one, other = (uncertainty.mean(each, np.ones(20)) for each in (above, below))
    found = uncertainty.ratio(one, other)
    whole = above.mean() / below.mean()
    without = [np.delete(above, place).mean() / np.delete(below, place).mean() for place in range(20)]
    assert found.value == pytest.approx(whole)
    np.testing.assert_allclose(found.influence, left_out([whole, *without]).influence, rtol=0.05, atol=1e-3)
    assert uncertainty.ratio(one, Estimate(0.0)).value is None
    assert uncertainty.ratio(one, Estimate(0.5)).influence is None


def test_columns() -> None:
    assert columns(Estimate(None), "p", math.inf) == {"p": None, "p_low": None, "p_high": None}
    assert columns(Estimate(0.3, np.zeros(5)), "p", math.inf) == {"p": 0.3, "p_low": None, "p_high": None}
    low = columns(Estimate(0.1, np.linspace(-1, 1, 9)), "p", math.inf)["p_low"]
    assert low == 0  # nothing here lies below


def test_no_alarm_at_all_is_not_certainly_none() -> None:
    """Ten pictures without one: up to about 1 - 0.025^(1/10) times what an unseen cluster counts."""
    low, high = interval_of(uncertainty.mean(np.zeros(10), np.ones(10)), math.inf)
    assert low == 0
    assert high is not None
    assert 0.03 < high < 0.4
    alarms = np.array([0.0] * 9 + [12.0])
    _, high = interval_of(uncertainty.mean(alarms, np.ones(10)), math.inf)
    assert high is not None
    assert 2 < high < 12  # beyond 1, and below the worst seen


def test_interval_reaches_down_to_that_of_the_cautious_estimate() -> None:
    values = np.random.default_rng(0).uniform(0.3, 0.9, 20)
    without = [np.delete(values, n).mean() for n in range(20)]
    whole = np.array([values.mean(), *without])
    plain, lower = left_out(whole), left_out(whole - 0.1)
    given = left_out(whole, whole - 0.1)
    assert given.value == plain.value
    assert interval_of(given, 1.0) == (interval_of(lower, 1.0)[0], interval_of(plain, 1.0)[1])
    assert left_out(whole, whole + 0.1).cautious is None
    both = mean_of([given, plain])
    assert both.cautious is not None
    assert both.cautious.value == pytest.approx(values.mean() - 0.05)
    assert ratio(given, given).cautious is None
