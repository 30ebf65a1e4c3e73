"""Where a curve crosses a level: by hand, how often the intervals hold, and what a prediction leaves open."""

from collections.abc import Callable

import numpy as np
import pytest
from blurnoise_eval.answers.criterion import Criterion
from blurnoise_eval.answers.curves import Curve, windows
from blurnoise_eval.scoring import uncertainty
from made_tables import answers, curve, table
from numpy.typing import NDArray
from scipy import stats

EXPOSURES_S = tuple(ms / 1e3 for ms in (1, 2, 5, 10, 15, 20, 30, 45, 60, 90))
THRESHOLD = 0.5
PICTURE_DECADES = 0.25  # by which a picture shifts both edges, one sigma each
SLOPE = 0.12  # of a picture's logistic curve, decades
Array = NDArray[np.float64]


def logistic(exposure_s: Array, down: Array, up: Array) -> Array:
    """Rises at 3 ms and falls at 27.48 ms, each shifted by so many decades."""
    at = np.log10(exposure_s)
    rise, fall = at - np.log10(0.003) - up, np.log10(0.02748) + down - at
    return np.asarray(1 / (1 + np.exp(-rise / SLOPE)) / (1 + np.exp(-fall / SLOPE)))


def test_one_rule_for_windows_and_failure_points():
    """A logistic in log exposure that falls at 27.48 ms, read between 20 and 30 ms: 27.71 where the line is straight
    over the exposure itself, within 0.2 ms where it is straight over its logarithm.

    Eight pictures all alike, of mean m: the low end of the interval is (1 - q) m and the high end q + (1 - q) m, q
    the quantile of what a quarter of a picture nobody has seen weighs beside eight, Beta(0.25, 8). So the ends are
    where m meets 0.5 / (1 - q) and (0.5 - q) / (1 - q).
    """
    at = np.array(EXPOSURES_S)
    values = np.tile(logistic(at, np.zeros(1), np.zeros(1)), (8, 1))
    alike = curve(values, EXPOSURES_S)
    end = alike.windows(THRESHOLD)[-1][1]
    assert end == pytest.approx(0.02748, abs=2e-4)
    low, high = alike.fails_between(THRESHOLD)
    q = float(uncertainty.of_level(0.0, np.zeros(8)).high)
    assert q == pytest.approx(stats.beta(0.25, 8).ppf(0.975), rel=0.1)  # of 1000 random weights
    levels = THRESHOLD / (1 - q), (THRESHOLD - q) / (1 - q)
    expected = [windows(EXPOSURES_S, values[0].tolist(), level)[-1][1] for level in levels]
    assert (low, high) == pytest.approx(expected, rel=0.02)  # of 10 % in q
    assert alike.around(end, THRESHOLD) == outside(low, high) == (0.02, 0.045)


def test_what_is_sure_lies_in_the_window_and_that_in_what_is_possible():
    down, up = np.random.default_rng(1).normal(0, PICTURE_DECADES, (2, 12, 1))
    of = curve(logistic(np.array(EXPOSURES_S), down, up), EXPOSURES_S)
    (sure,), (window,), (possible,) = of.sure(THRESHOLD), of.windows(THRESHOLD), of.possible(THRESHOLD)
    assert possible[0] < window[0] < sure[0] < sure[1] < window[1] < possible[1]
    assert of.around(window[0], THRESHOLD) == outside(possible[0], sure[0])
    assert of.around(window[1], THRESHOLD) == outside(sure[1], possible[1])
    assert of.fails_between(THRESHOLD) == (sure[1], possible[1])


def outside(low: float, high: float) -> tuple[float, float]:
    """The longest tested exposure not above ``low``, and the shortest not below ``high``."""
    return max(x for x in EXPOSURES_S if x <= low), min(x for x in EXPOSURES_S if x >= high)


@pytest.mark.parametrize("steep", [0.02, 0.08])
@pytest.mark.parametrize("falls_at_s", [0.0102, 0.0199])
def test_an_end_lies_between_the_tested_exposures_about_it(falls_at_s, steep):
    """Forty pictures, all alike, lose their target within 0.02 or 0.08 decades: straight lines between 10 and 20 ms
    cross at about 14 ms wherever it is, and the interval about 14 ms held nothing of it."""
    x = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05)
    mean = 1 / (1 + np.exp((np.log10(x) - np.log10(falls_at_s)) / steep))
    of = curve(np.tile(mean, (40, 1)), x)
    low, high = of.around(of.windows(THRESHOLD)[-1][1], THRESHOLD)
    assert low <= falls_at_s <= high
    assert {low, high} <= set(x)


X = tuple((0.001 * 2.0 ** np.linspace(0, 6, 13)).tolist())
_DRAWN = np.random.default_rng(3).uniform(-0.2, 0.2, (30, 1)) + np.linspace(0.4, 0.8, 13)
COV = 0.02**2 * np.exp(-np.abs(np.subtract.outer(np.arange(13), np.arange(13))) / 4)


def of_cov(cov: Array | None) -> Callable[[NDArray[np.int64]], Array] | None:
    return None if cov is None else lambda those: cov[np.ix_(those, those)]


def predicted(cov: Array | None) -> Curve:
    return curve(_DRAWN, X, prediction_cov=of_cov(cov))


def test_half_widths_of_a_prediction_add_as_squares():
    """And where nothing is open it is as measured, but for steps between the values."""
    known, unsure, measured = (predicted(cov).interval() for cov in (0 * COV, COV, None))
    mean = predicted(None).line.mean
    np.testing.assert_allclose(known, measured)
    for one, other in zip(known, unsure, strict=True):
        assert np.abs(other - mean) == pytest.approx(np.hypot(one - mean, 1.96 * 0.02))
    assert predicted(COV).sure(0.6)[0][0] > predicted(None).sure(0.6)[0][0]
    assert predicted(COV).possible(0.6)[0][0] < predicted(None).possible(0.6)[0][0]
    of = predicted(COV)  # known between its values, too
    assert of.around(of.windows(0.6)[0][0], 0.6) == (of.possible(0.6)[0][0], of.sure(0.6)[0][0])


def test_regret_goes_by_what_is_open_of_differences():
    """What is off alike at every exposure changes no choice."""
    noisy = _DRAWN + np.random.default_rng(4).normal(0, 0.05, _DRAWN.shape)

    def lost(cov: Array | None) -> float:
        (answer,) = answers(
            table(noisy[:, :, None], X, prediction_cov=of_cov(cov)), Criterion(0.6, kept=False)
        )
        return float(answer.regret_95)

    assert lost(np.full((13, 13), 0.05**2)) == pytest.approx(lost(None))
    assert lost(0.05**2 * np.eye(13)) > lost(None) + 0.05
