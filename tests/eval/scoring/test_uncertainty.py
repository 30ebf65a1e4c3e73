"""Intervals of means over clusters: closed forms, SciPy, exact shares, and what they hold in simulation."""

import math

import numpy as np
import pytest
from blurnoise_eval.scoring import uncertainty
from blurnoise_eval.scoring.uncertainty import interval_of, left_out, mean_of, ratio
from scipy import stats


def sample(*shape, seed=0):
    return np.random.default_rng(seed).gamma(0.6, size=shape)


def test_students_interval_is_scipys():
    values = sample(13, 4)
    mean = values.mean(axis=0)
    low, high = uncertainty.of_difference(mean, values - mean)
    expected = stats.t.interval(0.95, 12, mean, stats.sem(values))
    np.testing.assert_allclose((low, high), expected)
    np.testing.assert_allclose(uncertainty.student_t([13, 2], 0.9), stats.t.ppf(0.95, [12, 1]))
    assert np.isnan(uncertainty.student_t(1))


@pytest.mark.parametrize(("found", "n"), [(0, 8), (8, 8), (0, 35), (4, 20), (19, 20)])
def test_bounded_interval_of_shares_is_that_of_beta_laws(found, n):
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


def test_departures_are_those_of_leaving_out():
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


@pytest.mark.parametrize("n", [8, 20])
@pytest.mark.parametrize(
    "rivals", [1, 5, pytest.param(10, marks=pytest.mark.slow), pytest.param(78, marks=pytest.mark.slow)]
)
@pytest.mark.parametrize("alike", [False, True])
def test_regret_is_bounded(n, rivals, alike):
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


def test_interval_reaches_down_to_that_of_the_cautious_estimate():
    values = np.random.default_rng(0).uniform(0.3, 0.9, 20)
    without = [np.delete(values, n).mean() for n in range(20)]
    whole = np.array([values.mean(), *without])
    plain, lower = left_out(whole), left_out(whole - 0.1)
    given = left_out(whole, whole - 0.1)
    assert given.value == plain.value
    assert interval_of(given, 1.0) == (interval_of(lower, 1.0)[0], interval_of(plain, 1.0)[1])
    assert left_out(whole, whole + 0.1).cautious is None
    both = mean_of([given, plain])
    assert both.cautious.value == pytest.approx(values.mean() - 0.05)
    assert ratio(given, given).cautious is None


@pytest.mark.parametrize(("best", "least", "at_most"), [(0.3, 0.6, 0.7), (2.0, 0.9, 1.05)])
def test_an_unseen_picture_keeps_no_more_than_one_can_believe(best, least, at_most):
    """Kept shares of 20 pictures, .47 on average, of a detector that scores .07 on the original ones: an unseen
    picture might keep 14 times that. One keeps ``best`` more than that mean, the others as much less."""
    away = np.full(20, -best / 19)
    away[0] = best
    high = float(uncertainty.of_level(0.47, away, most=14.0).high)
    assert least < high < at_most
    assert high == float(uncertainty.of_level(0.47, away, most=math.inf).high)
    bounded = uncertainty.of_level(0.47, away.clip(max=0.53), most=1.0).high
    assert bounded == uncertainty.bounded(0.47, away.clip(max=0.53), (0.0, 1.0)).high  # a score cannot pass 1
