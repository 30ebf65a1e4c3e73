"""Intervals of differences over pictures and seeds, and what they say."""

from __future__ import annotations

import numpy as np
import pytest
from blurnoise_eval.bench import compared
from blurnoise_eval.bench.compared import Interval, Measure, designs, interval
from scipy import stats


def test_designs_leave_each_picture_out_and_take_each_seed_alone() -> None:
    pictures, seeds = designs(5, 2, 3)
    assert pictures.shape == (1 + 5 + 3, 5)
    assert seeds.shape == (1 + 5 + 3, 2, 3)
    assert pictures[0].tolist() == [1] * 5
    assert pictures[1:6].tolist() == (1 - np.eye(5)).tolist()
    assert (pictures[6:] == 1).all()
    np.testing.assert_allclose(seeds[:6], 1 / 3)
    for arm in range(2):
        assert seeds[6:, arm].tolist() == np.eye(3).tolist()


def test_many_pictures_are_left_out_in_groups(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compared, "MOST_CLUSTERS", 4)
    pictures, _ = designs(10, 1, 1)
    assert pictures.shape == (1 + 4 + 1, 10)
    assert (1 - pictures[1:5]).sum(axis=0).tolist() == [1] * 10  # each in one group
    assert (1 - pictures[1:5]).sum(axis=1).tolist() == [3, 3, 2, 2]


def told(y: np.ndarray, *, differs: bool) -> Interval:
    """Of the mean over pictures of y (arms, seeds, pictures), of the first arm or of what it is above the second."""
    pictures, seeds = designs(y.shape[2], 2, y.shape[1])
    means = np.einsum("dp,asp->das", pictures, y) / pictures.sum(axis=1)[:, None, None]
    first, second = (means * seeds).sum(axis=-1).T
    return interval(first, y.shape[1], second if differs else None)


def test_pictures_alone_give_students_interval() -> None:
    """One seed: scipy's interval of the mean of paired differences."""
    y = np.random.default_rng(0).normal(size=(2, 1, 12))
    gaps = (y[0] - y[1])[0]
    expected = stats.t.interval(0.95, 11, gaps.mean(), stats.sem(gaps))
    assert told(y, differs=True) == pytest.approx((gaps.mean(), *expected))


def test_seeds_alone_give_welchs_interval() -> None:
    """Pictures that are all alike: scipy's interval of the difference of two means with unequal variances."""
    seeds = np.random.default_rng(1).normal(size=(2, 4)) * [[1.0], [3.0]]
    found = told(np.repeat(seeds[:, :, None], 9, axis=2), differs=True)
    expected = stats.ttest_ind(*seeds, equal_var=False).confidence_interval(0.95)
    assert found[1:] == pytest.approx((expected.low, expected.high))


@pytest.mark.slow
@pytest.mark.parametrize("spread", [0.0, 0.02, 0.05, 0.2])
@pytest.mark.parametrize("pictures", [8, 35, 120])
def test_intervals_of_differences_hold_with_three_seeds(pictures: int, spread: float) -> None:
    """93 to 98 % at nominal 95, give or take 2 standard deviations of 1500 tries (1.1 %).

    Pictures differ, and differently for arm and network; seeds by ``spread``, from nothing to all there is.
    """
    rng, held, tries = np.random.default_rng([pictures, int(100 * spread)]), 0, 1500
    for _ in range(tries):
        shared = 0.25 * rng.normal(size=pictures) + 0.1 * rng.normal(size=(2, 1, pictures))
        seeds = spread * rng.normal(size=(2, 3, 1))
        y = np.array([0.1, 0])[:, None, None] + shared + seeds + 0.15 * rng.normal(size=(2, 3, pictures))
        _, low, high = told(y, differs=True)
        held += low <= 0.1 <= high  # type: ignore[operator]
    assert 0.93 - 0.011 <= held / tries <= 0.98 + 0.011


def test_interval_of_nothing() -> None:
    assert interval(np.array([np.nan, 0.1, 0.2, 0.3]), 1) == (None, None, None)
    assert interval(np.array([0.3, np.nan, 0.1, 0.1]), 1) == (None, None, None)  # one picture has a target
    assert interval(np.array([0.3, 0.3, 0.3, np.nan, 0.3]), 1) == (0.3, 0.3, 0.3)
    assert interval(np.array([1e-17, -1e-17, 2e-17, 0]), 1) == (0, 0, 0)  # rounding decides nothing


@pytest.mark.parametrize(
    ("low", "high", "higher", "lower"),
    [
        (0.1, 0.2, "better", "worse"),
        (-0.2, -0.1, "worse", "better"),
        (-0.1, 0.1, "undecided", "undecided"),
        (0.0, 0.2, "undecided", "undecided"),
        (None, None, "undecided", "undecided"),
    ],
)
def test_outcome(low: float | None, high: float | None, higher: str, lower: str) -> None:
    for better, expected in ((True, higher), (False, lower)):
        asked = Measure("m", lambda scores: scores["ap50"], "m", better)
        assert asked.outcome(Interval(0.0, low, high)) == expected
