"""Estimates: weighted means and ratios of them, their intervals."""

from __future__ import annotations

import math

import numpy as np
import pytest
from blurnoise_eval.answers import uncertainty
from blurnoise_eval.answers.uncertainty import columns, interval_of
from blurnoise_eval.scoring import estimates
from blurnoise_eval.scoring.estimates import Estimate, left_out, mean_of, ratio


def test_a_mean_of_estimates_is_the_estimate_of_the_means() -> None:
    values = np.random.default_rng(0).uniform(size=(3, 12))
    each = [estimates.mean(row, np.ones(12)) for row in values]
    found = estimates.mean_of(each)
    assert found.value == pytest.approx(values.mean())
    np.testing.assert_allclose(found.influence, values.mean(axis=0) - values.mean())
    expected = uncertainty.of_level(values.mean(), values.mean(axis=0) - values.mean())
    np.testing.assert_allclose(interval_of(found, 1.0), expected)
    assert estimates.mean_of([]) == Estimate(None)


def test_clusters_without_a_say_change_nothing_there() -> None:
    full, holes = np.full(9, 0.1), np.array([0.2] * 7 + [np.nan] * 2)
    found = estimates.mean_of([Estimate(0.5, full), Estimate(0.7, holes)])
    np.testing.assert_allclose(found.influence, [0.15] * 7 + [0.05] * 2)
    both = estimates.mean_of([Estimate(0.5, holes), Estimate(0.7, holes)])
    assert np.isnan(both.influence[-1])
    assert estimates.mean_of([Estimate(0.5, full), Estimate(0.7)]).influence is None


def test_departures_of_a_ratio_are_those_of_leaving_out() -> None:
    """To first order in 1/n: twenty clusters, 5 %."""
    rng = np.random.default_rng(1)
    above, below = rng.uniform(0.2, 0.4, 20), rng.uniform(0.6, 0.9, 20)
    one, other = (estimates.mean(each, np.ones(20)) for each in (above, below))
    found = estimates.ratio(one, other)
    whole = above.mean() / below.mean()
    without = [np.delete(above, place).mean() / np.delete(below, place).mean() for place in range(20)]
    assert found.value == pytest.approx(whole)
    np.testing.assert_allclose(found.influence, estimates.influence_of(whole, without), rtol=0.05, atol=1e-3)
    assert estimates.ratio(one, Estimate(0.0)).value is None
    assert estimates.ratio(one, Estimate(0.5)).influence is None


def test_columns() -> None:
    assert columns(Estimate(None), "p", math.inf) == {"p": None, "p_low": None, "p_high": None}
    assert columns(Estimate(0.3, np.zeros(5)), "p", math.inf) == {"p": 0.3, "p_low": None, "p_high": None}
    low = columns(Estimate(0.1, np.linspace(-1, 1, 9)), "p", math.inf)["p_low"]
    assert low == 0  # nothing here lies below


def test_no_alarm_at_all_is_not_certainly_none() -> None:
    """Ten pictures without one: up to about 1 - 0.025^(1/10) times what an unseen cluster counts."""
    low, high = interval_of(estimates.mean(np.zeros(10), np.ones(10)), math.inf)
    assert low == 0
    assert high is not None
    assert 0.03 < high < 0.4
    alarms = np.array([0.0] * 9 + [12.0])
    _, high = interval_of(estimates.mean(alarms, np.ones(10)), math.inf)
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
