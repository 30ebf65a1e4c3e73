"""Pooling over speeds: against isotonic regression by other means, and what it does to verdicts and intervals."""

from itertools import pairwise, product

import numpy as np
import pytest
from blurnoise_eval.answers.criterion import Criterion
from blurnoise_eval.answers.exposure_window import answers
from blurnoise_eval.answers.monotone import is_uniform, pooled
from made_tables import over, table
from scipy.optimize import minimize

SPEEDS = ((0.0, 0.0), (100.0, 0.0), (300.0, 0.0), (1000.0, 0.0))
RANK = {"no exposure works": 0, "cannot tell": 1, "works": 2}


def made(values, velocities=SPEEDS, counts=None, **at):
    """A table of values (C, E, V), each of so many targets."""
    counts = np.ones_like(values) if counts is None else counts
    exposures = [2.0**e / 1e3 for e in range(values.shape[1])]
    return table(values * counts, exposures, velocities, counts, at=at, brightness=1.0)


def means(of):
    """(E, V)."""
    return over(of, of.mean)


def noisy(rng, pictures, slope, exposures=3):
    """Confidences about .85 that fall by ``slope`` over the speeds, (pictures, exposures, 4)."""
    own = rng.beta(8, 1.5, (pictures, 1, 1)) - np.linspace(0, slope, len(SPEEDS))
    return np.asarray(np.clip(own + rng.normal(0, 0.2, (pictures, exposures, len(SPEEDS))), 0, 1))


@pytest.mark.parametrize("seed", range(4))
def test_means_are_the_nearest_that_fall_along_every_direction(seed):
    """Against a quadratic programme: two directions and rest, unequal weights, velocities in no order."""
    rng = np.random.default_rng(seed)
    velocities = ((300.0, 0.0), (0.0, -50.0), (0.0, 0.0), (100.0, 0.0), (0.0, -400.0), (20.0, 0.0))
    pairs = [(2, 5), (5, 3), (3, 0), (2, 1), (1, 4)]
    counts = np.tile(rng.integers(1, 9, (1, 1, 6)).astype(float), (8, 1, 1))
    made_one = made(rng.uniform(size=(8, 1, 6)), velocities, counts)
    mean, weight = means(made_one)[0], counts.sum(axis=0)[0]
    falls = [{"type": "ineq", "fun": lambda x, s=s, f=f: x[s] - x[f]} for s, f in pairs]
    found = minimize(lambda x: weight @ (x - mean) ** 2, mean, constraints=falls, options={"ftol": 1e-13})
    np.testing.assert_allclose(means(pooled(made_one))[0], found.x, atol=1e-5)


def test_only_pictures_that_move_as_a_whole_are_pooled():
    """Targets that are tracked before a background that moves, or a camera that drives, may do better with speed."""
    values = np.tile(np.array([[0.5, 0.6, 0.7, 0.9]]), (20, 1, 1))
    assert is_uniform(made(values))
    assert not is_uniform(made(values, moves=2.0))
    assert not is_uniform(made(values, ego_speed_m_s=10.0))
    assert not is_uniform(made(values[:, :, :1], SPEEDS[:1]))
    criterion = Criterion(0.65, kept=False)
    for made_one, monotone in ((made(values, moves=2.0), True), (made(values), False)):
        given = [answer.confidence[0] for answer in answers(made_one, criterion, monotone=monotone)]
        assert given == pytest.approx([0.5, 0.6, 0.7, 0.9])
    assert [answer.confidence[0] for answer in answers(made(values), criterion)] == pytest.approx([0.675] * 4)


@pytest.mark.parametrize("seed", range(6))
def test_no_answer_is_better_at_a_higher_speed(seed):
    rng = np.random.default_rng(seed)
    made_one = made(noisy(rng, 12, 0.0))
    raw = answers(made_one, Criterion(0.75, kept=False), monotone=False)
    found = answers(made_one, Criterion(0.75, kept=False))
    for slower, faster in pairwise(found):
        assert RANK[slower.verdict] >= RANK[faster.verdict]
        for name in ("confidence", "low", "high"):
            assert (np.array(getattr(slower, name)) >= np.array(getattr(faster, name)) - 1e-12).all()
        for low, high in faster.windows_s:
            assert any(first <= low and high <= last for first, last in slower.windows_s)
    for answer in found:
        assert (np.array(answer.low) <= answer.confidence).all()
        assert (np.array(answer.confidence) <= answer.high).all()
    assert any((np.diff([each.confidence[e] for each in raw]) > 0).any() for e in range(3))  # it was needed


@pytest.mark.slow
@pytest.mark.parametrize(("pictures", "slope"), list(product((12, 35), (0.0, 0.1))))
def test_pooled_intervals_hold(pictures, slope):
    """95 % of 400 samples' intervals hold the mean of the population, less three standard errors (1.1 %); none at any
    speed in less than 2 % below that."""
    truth = np.mean(
        [noisy(np.random.default_rng(s), 4000, slope).mean(axis=(0, 1)) for s in range(20)], axis=0
    )
    rng, held = np.random.default_rng(pictures), np.zeros((3, len(SPEEDS)))
    for _ in range(400):
        found = answers(made(noisy(rng, pictures, slope)), Criterion(0.75, kept=False))
        low, high = (np.array([getattr(each, name) for each in found]).T for name in ("low", "high"))
        held += (low <= truth) & (truth <= high)
    assert held.min() / 400 > 0.93 - 0.033
    assert 0.93 < held.mean() / 400 < 0.985
