"""Where a curve crosses a level: by hand, how often the intervals hold, and what a prediction leaves open."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from blurnoise_eval.answers.criterion import Criterion
from blurnoise_eval.answers.curves import Curve, windows
from blurnoise_eval.scoring import uncertainty
from blurnoise_eval.scoring.uncertainty import Ends
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


def truth() -> tuple[Array, tuple[float, float]]:
    """Mean at each exposure over all pictures there could be, and where its straight lines cross the threshold."""
    down, up = np.random.default_rng(99).normal(0, PICTURE_DECADES, (2, 200_000, 1))
    mean = np.array([logistic(np.array([[x]]), down, up).mean() for x in EXPOSURES_S])
    (ends,) = windows(EXPOSURES_S, mean.tolist(), THRESHOLD)
    return mean, ends


def test_one_rule_for_windows_and_failure_points() -> None:
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
    assert low is not None
    assert high is not None
    assert alike.around(end, THRESHOLD) == outside(low, high) == (0.02, 0.045)


def test_what_is_sure_lies_in_the_window_and_that_in_what_is_possible() -> None:
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
@pytest.mark.parametrize("falls_at_s", [0.0102, 0.012, 0.0188, 0.0199])
def test_an_end_lies_between_the_tested_exposures_about_it(falls_at_s: float, steep: float) -> None:
    """Forty pictures, all alike, lose their target within 0.02 or 0.08 decades: straight lines between 10 and 20 ms
    cross at about 14 ms wherever it is, and the interval about 14 ms held nothing of it."""
    x = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05)
    mean = 1 / (1 + np.exp((np.log10(x) - np.log10(falls_at_s)) / steep))
    of = curve(np.tile(mean, (40, 1)), x)
    low, high = of.around(of.windows(THRESHOLD)[-1][1], THRESHOLD)
    assert low is not None
    assert high is not None
    assert low <= falls_at_s <= high
    assert {low, high} <= set(x)


@pytest.mark.parametrize("pictures", [1, 2, 7])
def test_below_eight_pictures_nothing_is_known(pictures: int) -> None:
    of = curve(np.tile(logistic(np.array(EXPOSURES_S), np.zeros(1), np.zeros(1)), (pictures, 1)), EXPOSURES_S)
    assert of.sure(THRESHOLD) == []
    assert of.possible(THRESHOLD) == [(EXPOSURES_S[0], EXPOSURES_S[-1])]
    assert of.fails_between(THRESHOLD) == (None, None)
    assert [of.around(end, THRESHOLD) for end in of.windows(THRESHOLD)[0]] == [(None, None)] * 2
    assert of.interval() is None
    assert of.area()[1] == (None, None)


def test_the_size_of_pictures_counts() -> None:
    """Ten pictures, of which one has ninety targets, say as much as 99^2 / 8109 = 1.2 of one size; where all have
    one, as ten."""
    counts = np.ones((10, 2))
    counts[0, 1] = 90
    of = curve(np.full((10, 2), 0.9), (1.0, 2.0), counts, logarithmic=False)
    assert of.known.tolist() == [True, False]
    assert of.line.n_effective == pytest.approx((91 + 9 * 2) ** 2 / (91**2 + 9 * 2**2))
    assert of.interval() is None
    assert of.area()[1] == (None, None)
    assert of.sure(0.5) == [pytest.approx((1.0, 1.0), abs=1e-6)]
    assert of.possible(0.5) == [(1.0, 2.0)]


def between(x: tuple[float, ...], low: list[float], high: list[float]) -> Curve:
    """A curve whose interval is known at x, straight between."""
    of = curve(
        np.full((9, len(x)), 0.5),
        x,
        logarithmic=False,
        prediction_cov=lambda those: np.zeros((len(those),) * 2),
    )
    return Curve(
        replace(of.line, prediction_cov=None), x, given=Ends(*(of_steps(x, end) for end in (low, high)))
    )


def of_steps(x: tuple[float, ...], end: list[float]) -> Array:
    fine = np.concatenate([np.linspace(a, b, 16, endpoint=False) for a, b in pairwise(x)] + [[x[-1]]])
    return np.interp(fine, x, end)


def test_an_end_of_the_tested_range_is_no_edge() -> None:
    """Sure at the last exposure: nothing is said of what lies beyond. Unsure there: from where on it is unsure."""
    sure = between((1.0, 3.0, 10.0), [0.0, 0.5, 0.9], [0.2, 0.9, 1.0])
    assert sure.around(10.0, 0.5) == sure.fails_between(0.5) == (None, None)
    unsure = between((1.0, 3.0, 8.0, 10.0), [0.0, 0.5, 0.5, 0.2], [0.2, 0.9, 0.9, 0.8])
    assert unsure.around(10.0, 0.5) == unsure.fails_between(0.5) == (8.0, None)


def test_a_dip_that_may_be_one_widens_the_failure_point_not_the_first_window() -> None:
    """Surely above until 2, surely below from 4 to 4.5, perhaps above until 6: it fails for good at 2 or at 6."""
    x = (0.0, 2.0, 4.0, 4.25, 4.5, 6.0, 9.0)
    of = between(x, [0.9, 0.5, 0.1, 0.1, 0.1, 0.1, 0.1], [1.0, 0.9, 0.5, 0.4, 0.5, 0.5, 0.2])
    assert of.fails_between(0.5) == pytest.approx((2.0, 6.0))
    assert of.around(3.0, 0.5) == (2.0, 4.0)
    assert of.around(5.5, 0.5) == (4.5, 6.0)


def test_area_has_the_interval_of_the_pictures_own_areas() -> None:
    """The area is linear: pictures counted alike, it is their mean, and its interval theirs."""
    down, up = np.random.default_rng(2).normal(0, PICTURE_DECADES, (2, 20, 1))
    values = logistic(np.array(EXPOSURES_S), down, up)
    area, (low, high) = curve(values, EXPOSURES_S).area()
    own = np.trapezoid(values, EXPOSURES_S) / (EXPOSURES_S[-1] - EXPOSURES_S[0])
    assert area == pytest.approx(own.mean())
    assert low is not None
    assert high is not None
    width = 2 * 2.093 * own.std(ddof=1) / np.sqrt(20)  # Student's t of 19
    assert low < area < high
    # Of 20 the interval by random weights is Student's within a few per cent, and what no picture showed widens it.
    assert width * 0.96 <= high - low <= 1.3 * width


@pytest.mark.slow
@pytest.mark.parametrize("pictures", [8, 20, 35])
@pytest.mark.parametrize("targets", [1, 20])
def test_intervals_of_edges_and_areas_hold(pictures: int, targets: int) -> None:
    """Nominally in 95 %, of 400 replications: the fraction itself is known to 1.1 %, so three of these below 93 %.

    Pictures shift both edges by 0.25 decade; targets of one picture share that, with 0.1 decade of their own.
    """
    rng = np.random.default_rng(pictures + targets)
    mean, (start, end) = truth()
    area = np.trapezoid(mean, EXPOSURES_S) / (EXPOSURES_S[-1] - EXPOSURES_S[0])
    held = np.zeros(4)
    replications = 400
    for _ in range(replications):
        shift = rng.normal(0, PICTURE_DECADES, (2, pictures, 1, 1))
        if targets > 1:  # the same spread in all
            own = rng.normal(0, 0.1, (2, pictures, targets, 1))
            shift = shift * np.sqrt(1 - (0.1 / PICTURE_DECADES) ** 2) + own
        values = logistic(np.array(EXPOSURES_S), *shift)
        of = curve(values.mean(axis=1), EXPOSURES_S, values.shape[1])
        start_at, end_at = of.windows(THRESHOLD)[0][0], of.windows(THRESHOLD)[-1][1]
        bounds = [of.around(start_at, THRESHOLD), of.around(end_at, THRESHOLD)]
        bounds += [of.fails_between(THRESHOLD), of.area()[1]]
        for place, ((low, high), true) in enumerate(zip(bounds, (start, end, end, area), strict=True)):
            held[place] += (low is None or low <= true) and (high is None or true <= high)
    assert (held / replications > 0.93 - 3 * 0.011).all(), held / replications


@pytest.mark.slow
@pytest.mark.parametrize("pictures", [12, 20])
def test_ends_of_windows_that_surely_work_hold_the_population_s(pictures: int) -> None:
    """Noise of its own in every picture and exposure, 24 exposures: 300 samples, of those that surely work 93 % at
    least, less three standard errors (1.2 %), against the population's crossings on 200 exposures."""
    dense, fine = np.geomspace(1e-3, 0.09, 24), np.geomspace(1e-3, 0.09, 200)
    rng = np.random.default_rng(pictures)

    def drawn(at: Array, count: int) -> Array:
        down, up = rng.normal(0, PICTURE_DECADES, (2, count, 1))
        noise = SLOPE * rng.normal(0, 0.8, (count, len(at)))
        return logistic(at, down - noise, up + noise)

    mean = np.mean([drawn(fine, 2000).mean(axis=0) for _ in range(10)], axis=0)
    ((start, end),) = windows(tuple(fine.tolist()), mean.tolist(), THRESHOLD)
    held, cases = np.zeros(2), 0
    for _ in range(300):
        of = curve(drawn(dense, pictures), tuple(dense.tolist()))
        if of.sure(THRESHOLD):
            cases += 1
            window = max(of.windows(THRESHOLD), key=lambda each: each[1] / each[0])
            for place, true in enumerate((start, end)):
                low, high = of.around(window[place], THRESHOLD)
                held[place] += (low is None or low <= true) and (high is None or true <= high)
    assert cases > 250
    assert (held / cases > 0.93 - 0.036).all(), held / cases


X = tuple((0.001 * 2.0 ** np.linspace(0, 6, 13)).tolist())
_DRAWN = np.random.default_rng(3).uniform(-0.2, 0.2, (30, 1)) + np.linspace(0.4, 0.8, 13)
COV = 0.02**2 * np.exp(-np.abs(np.subtract.outer(np.arange(13), np.arange(13))) / 4)


def of_cov(cov: Array | None) -> Callable[[NDArray[np.int64]], Array] | None:
    return None if cov is None else lambda those: cov[np.ix_(those, those)]


def predicted(cov: Array | None) -> Curve:
    return curve(_DRAWN, X, prediction_cov=of_cov(cov))


def test_half_widths_of_a_prediction_add_as_squares() -> None:
    """And where nothing is open it is as measured, but for steps between the values."""
    known, unsure, measured = (predicted(cov).interval() for cov in (0 * COV, COV, None))
    assert known is not None
    assert unsure is not None
    assert measured is not None
    mean = predicted(None).line.mean
    np.testing.assert_allclose(known, measured)
    for one, other in zip(known, unsure, strict=True):
        assert np.abs(other - mean) == pytest.approx(np.hypot(one - mean, 1.96 * 0.02))
    assert predicted(COV).sure(0.6)[0][0] > predicted(None).sure(0.6)[0][0]
    assert predicted(COV).possible(0.6)[0][0] < predicted(None).possible(0.6)[0][0]
    of = predicted(COV)  # known between its values, too
    assert of.around(of.windows(0.6)[0][0], 0.6) == (of.possible(0.6)[0][0], of.sure(0.6)[0][0])


def test_regret_goes_by_what_is_open_of_differences() -> None:
    """What is off alike at every exposure changes no choice."""
    noisy = _DRAWN + np.random.default_rng(4).normal(0, 0.05, _DRAWN.shape)

    def lost(cov: Array | None) -> float:
        (answer,) = answers(
            table(noisy[:, :, None], X, prediction_cov=of_cov(cov)), Criterion(0.6, kept=False)
        )
        assert answer.regret_95 is not None
        return float(answer.regret_95)

    assert lost(np.full((13, 13), 0.05**2)) == pytest.approx(lost(None))
    assert lost(0.05**2 * np.eye(13)) > lost(None) + 0.05


def test_the_covariance_goes_with_the_conditions() -> None:
    counted = np.arange(1, 14.0)[None, :, None]
    made = table(counted, X, counts=counted, saturated=counted[0], prediction_cov=of_cov(COV))
    some = made.take(np.isin(made.conditions["exposure_s"], X[::4])).take([3, 1])
    assert some.sums[0].tolist() == some.saturated.tolist() == [13, 5]
    assert some.prediction_cov is not None
    assert some.prediction_cov(np.arange(2)) == pytest.approx(COV[np.ix_([12, 4], [12, 4])])
    assert made.sigma == pytest.approx(np.full(13, 0.02))
    merged = made.merged(np.array([0, 0, *range(1, 12)]))
    assert (len(merged), merged.saturated[0]) == (12, 1.5)
    assert merged.prediction_cov is not None
    share = np.array([1, 2]) / 3
    assert merged.prediction_cov(np.array([0]))[0, 0] == pytest.approx(share @ COV[:2, :2] @ share)
