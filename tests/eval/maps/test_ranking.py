"""Ranks of metrics: against SciPy, pairs counted by hand, and curves whose fit is known."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from blurnoise_eval.maps import ranking
from made_maps import plane, scores_at
from scipy import stats

PLANE = plane()
U, W = PLANE.places.T
N = len(PLANE)
RNG = np.random.default_rng(1)


@pytest.mark.parametrize("digits", [1, 6])  # with ties, and without
def test_rank_correlation_is_scipys(digits: int) -> None:
    m, y = RNG.normal(size=40).round(digits), RNG.normal(size=(3, 40)).round(digits)
    y[1] += m
    expected = [stats.spearmanr(m, each).statistic for each in y]
    assert ranking.spearman(m, y) == pytest.approx(expected, abs=1e-12)


def test_nothing_is_told_of_what_never_changes() -> None:
    m = np.arange(30.0)
    assert np.isnan(ranking.spearman(m, np.ones(30)))
    assert np.isnan(ranking.spearman(np.ones(30), m))
    assert np.isnan(ranking.spearman(m, np.where(m == 3, np.nan, m)))


def test_the_increasing_curve_pools_what_falls() -> None:
    """By hand: 3, 1 pool to 2; equal places are one, of their mean; what rises is left alone."""
    places, fitted = ranking.increasing(np.array([1, 2, 3, 4, 4, 5.0]), np.array([0, 3, 1, 4, 6, 9.0]))
    assert places.tolist() == [1, 2, 3, 4, 5]
    assert fitted == pytest.approx([0, 2, 2, 5, 9])
    weighed = ranking.increasing(np.array([1, 1, 1, 2.0]), np.array([4, 4, 4, 0.0]))[1]
    assert weighed == pytest.approx([3, 3])  # three nodes of the one place against one


def test_blocks_are_stretches_that_share_no_value() -> None:
    along = RNG.integers(0, 11, 60).astype(float)
    held = ranking.blocks(along)
    assert len(held) == ranking.MOST_BLOCKS
    assert (np.sum(held, axis=0) == 1).all()
    for one, other in pairwise(held):
        assert along[one].max() < along[other].min()
    assert len(ranking.blocks(np.ones(5))) == 1


def test_held_out_blocks_know_nothing_of_themselves() -> None:
    """A step in the last block alone: its nodes get the highest value of the others, not their own."""
    m = np.arange(20.0)
    y = np.where(m >= 16, 1.0, 0.25)
    told = ranking.increasing_held_out(m, y, ranking.blocks(m))
    assert told is not None
    assert told[16:] == pytest.approx([0.25] * 4)
    assert ranking.increasing_held_out(m, y, [m >= 0]) is None


def test_share_explained_is_one_less_the_errors_share() -> None:
    y = np.array([0.0, 1.0, 2.0, 3.0])
    assert ranking.explained(y, y + 0.5) == pytest.approx(1 - 4 * 0.25 / 5)
    assert ranking.explained(np.ones(4), y) is None
    assert ranking.explained(y, None) is None


def test_telling_what_keeps_the_level_counts_pairs() -> None:
    m, kept = RNG.integers(0, 6, 30).astype(float), RNG.random(30) > 0.6
    pairs = [(a > b) + (a == b) / 2 for a in m[kept] for b in m[~kept]]
    assert ranking.auc(m, kept) == pytest.approx(np.mean(pairs))
    assert ranking.auc(m, m >= 0) is None
    assert ranking.auc(m, m < 0) is None


def test_a_metric_of_light_alone_is_flattered_along_light() -> None:
    """Over both axes it misses all that blur does; the score itself misses nothing."""
    y = (U - U.min()) / np.ptp(U) * 0.5 + 0.5 * (W.max() - W) / np.ptp(W)
    rows = list(ranking.ranked(PLANE, {"light": U, "itself": y**3}, scores_at(PLANE, y)))
    light, itself = rows
    at_rest = W.min() == W
    assert ranking.along_lines(U[at_rest], y[at_rest], W[at_rest]) == pytest.approx(1)
    assert light.along_light == pytest.approx(1)
    assert light.spearman == pytest.approx(stats.spearmanr(U, y).statistic)
    assert light.spearman is not None
    assert light.spearman < 0.8
    assert itself.spearman == pytest.approx(1)
    assert itself.r2_h is not None
    assert itself.r2_h > 0.9
    assert ranking.best(rows) is itself
    assert ranking.most_flattered(rows) is light
    assert ranking.most_flattered([itself]) is None


def test_the_interval_is_the_jackknifes_and_needs_eight_clusters() -> None:
    y = np.clip(U, -3, 3) / 3 - W / 9
    m = {"light": U + 0.3 * W}
    (twelve,) = ranking.ranked(PLANE, m, scores_at(PLANE, y, 12))
    (seven,) = ranking.ranked(PLANE, m, scores_at(PLANE, y, 7))
    assert twelve.low is not None
    assert twelve.high is not None
    assert twelve.spearman is not None
    assert twelve.low < twelve.spearman < twelve.high
    without = [float(ranking.spearman(m["light"], each)) for each in scores_at(PLANE, y, 12).without]
    error = np.sqrt(
        11 / 12 * np.sum((np.array(without) - np.mean(without)) ** 2)
    )  # Efron and Tibshirani, 11.5
    width = twelve.high - twelve.low
    assert width >= 2 * stats.t.ppf(0.975, 11) * error * (1 - 1e-9)  # Student's, and what Hall adds to it
    assert width <= 4 * stats.t.ppf(0.975, 11) * error
    assert (seven.low, seven.high) == (None, None)


def test_few_nodes_cannot_tell_and_the_share_is_of_those_with_a_score() -> None:
    y = U / 10 + 1
    few = np.where(np.arange(N) < ranking.FEWEST_NODES - 1, U, np.nan)
    enough = np.where(np.arange(N) < ranking.FEWEST_NODES, U, np.nan)
    silent, told = ranking.ranked(PLANE, {"few": few, "enough": enough}, scores_at(PLANE, y))
    assert silent.spearman is None
    assert silent.auc is None
    assert silent.share_told == (ranking.FEWEST_NODES - 1) / N
    assert told.spearman == pytest.approx(1)
    assert ranking.best([silent]) is None
    unscored = np.where(np.arange(N) < 30, y, np.nan)
    (half,) = ranking.ranked(PLANE, {"light": U}, scores_at(PLANE, unscored))
    assert (half.n_nodes, half.share_told) == (30, 1.0)
