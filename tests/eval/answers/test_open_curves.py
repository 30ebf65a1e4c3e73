"""Curves of predicted means: what is not known of them widens intervals and what a choice may lose."""

from __future__ import annotations

import numpy as np
import pytest
from blurnoise_eval.answers import uncertainty
from blurnoise_eval.answers.criterion import Criterion
from blurnoise_eval.answers.curves import Curve
from made_tables import answers, table

X = tuple((0.001 * 2.0 ** np.linspace(0, 6, 13)).tolist())
_DRAWN = np.random.default_rng(3).uniform(-0.2, 0.2, (30, 1)) + np.linspace(0.4, 0.8, 13)
OPEN = 0.02**2 * np.exp(-np.abs(np.subtract.outer(np.arange(13), np.arange(13))) / 4)


def curve(not_known: np.ndarray | None) -> Curve:  # type: ignore[type-arg]
    return Curve(X, _DRAWN, np.ones_like(_DRAWN), logarithmic=True, open=not_known)


def test_half_widths_add_as_squares() -> None:
    known, unsure = curve(None).interval(), curve(OPEN).interval()
    assert known is not None
    assert unsure is not None
    mean = curve(None).mean
    for one, other in zip(known, unsure, strict=True):
        assert np.abs(other - mean) == pytest.approx(np.hypot(one - mean, 1.96 * 0.02))


def test_where_nothing_is_open_it_is_as_measured() -> None:
    """But for steps between the values, which what is predicted does without."""
    measured, predicted = curve(None), curve(np.zeros((13, 13)))
    for one, other in zip(measured.interval() or (), predicted.interval() or (), strict=True):
        assert other == pytest.approx(one)
    assert measured.crossed(0.6).windows == predicted.crossed(0.6).windows


def test_a_window_is_less_sure() -> None:
    sure = [curve(not_known).crossed(0.6).sure[0][0] for not_known in (None, OPEN)]
    possible = [curve(not_known).crossed(0.6).possible[0][0] for not_known in (None, OPEN)]
    assert sure[1] > sure[0]
    assert possible[1] < possible[0]


def test_regret_goes_by_what_is_open_of_differences() -> None:
    """What is off alike at every exposure changes no choice."""
    noisy = _DRAWN + np.random.default_rng(4).normal(0, 0.05, _DRAWN.shape)

    def lost(not_known: np.ndarray | None) -> float:  # type: ignore[type-arg]
        cov = None if not_known is None else lambda those: not_known[np.ix_(those, those)]
        (answer,) = answers(table(noisy[:, :, None], X, prediction_cov=cov), Criterion(0.6, kept=False))
        assert answer.regret_95 is not None
        return answer.regret_95

    assert lost(np.full((13, 13), 0.05**2)) == pytest.approx(lost(None))
    assert lost(0.05**2 * np.eye(13)) > lost(None) + 0.05


def test_bound_with_what_is_open_is_the_wider_of_both() -> None:
    away = np.random.default_rng(5).normal(0, 0.1, (40, 3))
    gain = np.zeros(3)
    without, some = (float(uncertainty.regret_bound(away, gain, sigma=sigma)) for sigma in (0.0, 0.1))
    error = away.std(axis=0, ddof=1).max() / np.sqrt(40)
    assert some / without == pytest.approx(np.hypot(error, 0.1) / error, rel=0.1)


def test_the_covariance_goes_with_the_conditions() -> None:
    counted = np.arange(13.0)[None, :, None]
    made = table(counted, X, saturated=counted[0], prediction_cov=lambda those: OPEN[np.ix_(those, those)])
    some = made.take(np.isin(made.conditions["exposure_s"], X[::4])).take([3, 1])
    assert some.sums[0].tolist() == some.saturated.tolist() == [12, 4]
    assert some.prediction_cov is not None
    assert some.prediction_cov(np.arange(2)) == pytest.approx(OPEN[np.ix_([12, 4], [12, 4])])
