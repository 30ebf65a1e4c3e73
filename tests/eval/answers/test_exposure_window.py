"""Exposure windows and what ends them: values worked out by hand, and what must hold for any curve."""

import math

import numpy as np
import pytest
from blurnoise_eval.answers.choosing import NEAR, recommended
from blurnoise_eval.answers.criterion import Criterion
from blurnoise_eval.answers.curves import windows
from blurnoise_eval.answers.exposure_window import answers
from blurnoise_eval.answers.limits import TestedLine, of_best, of_window
from hypothesis import given
from hypothesis import strategies as st
from made_tables import curve, table
from scipy import stats

DECADES_S = (0.001, 0.01, 0.1, 1.0)


@pytest.mark.parametrize(
    ("exposures_s", "confidence", "expected"),
    [
        # From 0.2 to 0.8 the line meets 0.6 two thirds of a decade on; from 0.8 to 0.4, half a decade on.
        (DECADES_S, (0.2, 0.8, 0.8, 0.4), [(10 ** (-3 + 2 / 3), 10**-0.5)]),
        (DECADES_S, (0.8, 0.4, 0.5, 0.9), [(0.001, 10**-2.5), (10**-0.75, 1.0)]),  # two windows, both open
        (DECADES_S, (0.5, 0.7, 0.5, 0.7), [(10**-2.5, 10**-1.5), (10**-0.5, 1.0)]),
        (DECADES_S, (0.9, 0.9, 0.6, 0.6), [(0.001, 1.0)]),  # at the threshold counts
        (DECADES_S, (0.59, 0.5, 0.4, 0.0), []),
        (DECADES_S, (0.0, 0.6, 0.0, 0.0), [(0.01, 0.01)]),  # touches it in one exposure
        ((0.02,), (0.7,), [(0.02, 0.02)]),
    ],
)
def test_windows_by_hand(exposures_s, confidence, expected):
    found = windows(exposures_s, confidence, 0.6)
    assert [pytest.approx(window, rel=1e-9) for window in found] == expected


def chosen(exposures_s, values, level):
    none, every = np.zeros(len(exposures_s)), np.ones(len(exposures_s), bool)
    return int(recommended(exposures_s, np.array(values), none, level, every))


def test_recommended_is_the_middle_of_what_is_equally_good():
    assert chosen(DECADES_S, (0.9, 0.9 - NEAR / 2, 0.897, 0.2), 0.6) == 1
    assert chosen(DECADES_S, (0.95, 0.9, 0.89, 0.2), 0.6) == 0  # clearly best: no
    assert chosen((0.02,), (0.7,), 0.6) == 0


curves = st.integers(1, 12).flatmap(
    lambda n: st.tuples(
        st.lists(st.floats(1e-5, 10.0), min_size=n, max_size=n, unique=True).map(sorted),
        st.lists(
            st.floats(0, 1) | st.sampled_from([0.0, 0.6, math.nextafter(0.6, 0), 1.0]), min_size=n, max_size=n
        ),
    )
)


@given(curves, st.sampled_from([0.0, 0.3, 0.6, 1.0]))
def test_windows_hold_exactly_the_exposures_that_work(drawn, threshold):
    exposures, confidence = drawn
    found = windows(exposures, confidence, threshold)
    ends = [end for window in found for end in window]
    assert ends == sorted(ends)
    assert all(exposures[0] <= end <= exposures[-1] for end in ends)
    for exposure, value in zip(exposures, confidence, strict=True):
        inside = any(low <= exposure <= high for low, high in found)
        # A crossing may fall on the neighbour itself where the two differ by less than rounding shows.
        assert inside if value >= threshold else not inside or exposure in ends
    assert confidence[chosen(exposures, confidence, threshold)] >= max(confidence) - NEAR


def answer(by_exposure, threshold=0.6, counts=1.0):
    values = np.array(list(by_exposure.values()), float).T[:, :, None]
    of = table(values * counts, list(by_exposure), counts=np.broadcast_to(counts, values.shape))
    (found,) = answers(of, Criterion(threshold, kept=False))
    return found


def spread(mean, sigma, pictures):
    """So many values of exactly this mean and standard deviation, evenly spaced."""
    values = np.linspace(-1, 1, pictures)
    return (mean + sigma * values / values.std(ddof=1)).tolist()


@pytest.mark.parametrize(
    ("means", "pictures", "verdict"),
    [
        # Error of the mean 0.1 / 4 = 0.025, t(15) = 2.13: 0.053 away. At 0.68 a quarter of a picture of 0 beside 16
        # pulls by up to 0.1 x 0.68 (Beta(0.25, 16) at 97.5 %), at 0.54 one of 1 by 0.046: together 0.08 and 0.06.
        ((0.2, 0.69, 0.3), 16, "works"),
        ((0.2, 0.67, 0.3), 16, "cannot tell"),
        ((0.2, 0.55, 0.3), 16, "cannot tell"),
        ((0.2, 0.53, 0.3), 16, "no exposure works"),
        ((0.2, 0.69, 0.3), 7, "cannot tell"),
    ],
)
def test_verdicts(means, pictures, verdict):
    found = answer({0.001 * 10**place: spread(mean, 0.1, pictures) for place, mean in enumerate(means)})
    assert found.verdict == verdict
    assert (found.pictures_needed is None) == (verdict != "cannot tell")


@pytest.mark.parametrize(("value", "threshold", "needed"), [(0.95, 0.9, 33), (0.0, 0.05, 34)])
def test_pictures_all_alike_are_not_certain(value, threshold, needed):
    """That eight are alike does not show that all are. Beta(0.25, n) at 97.5 % is 0.05 / 0.95 at some 33, and
    0.05 at some 34 pictures."""
    found = answer({0.01: [value] * 8, 0.1: [value] * 8}, threshold)
    assert (found.verdict, found.sure_windows_s) == ("cannot tell", [])
    assert stats.beta(0.25, needed).ppf(0.975) == pytest.approx(0.05 / max(value, 1 - value), rel=0.04)
    assert found.pictures_needed == pytest.approx(needed, abs=1)
    found = answer({0.01: [value] * 40, 0.1: [value] * 40}, threshold)
    assert found.verdict == ("works" if value > threshold else "no exposure works")


some = st.sampled_from([0.0, 0.5, 0.6, 1.0]) | st.floats(0, 1)


@given(
    st.lists(st.lists(some, min_size=24, max_size=24), min_size=1, max_size=3),
    st.sampled_from([0.0, 0.05, 0.5, 0.6, 0.9, 1.0]),
    st.lists(st.integers(1, 4), min_size=8, max_size=24),
)
def test_no_verdict_contradicts_its_interval(samples, threshold, sizes):
    by_exposure = {0.001 * 4**place: values[: len(sizes)] for place, values in enumerate(samples)}
    found = answer(by_exposure, threshold, np.array(sizes, float)[:, None, None])
    weighed = sum(sizes) ** 2 / sum(k * k for k in sizes)
    assert found.few_pictures == (weighed < 20)
    assert (found.low is None) == (weighed < 8)
    if found.low is None or found.high is None:
        assert found.verdict == "cannot tell"
        return
    # What was chosen is corrected for that, which no exposure gains by.
    bias = max(0.0, max(found.confidence) - found.best_score.value)
    if min(abs(low - bias - threshold) for low in found.low) > 1e-9:
        assert (found.verdict == "works") == (max(found.low) - bias >= threshold)
    if found.verdict == "no exposure works":
        assert max(found.high) < threshold
    if found.verdict == "cannot tell" and len(samples) == 1:
        assert max(found.high) >= threshold
    for exposure_s, low in zip(found.exposures_s, found.low, strict=True):
        if abs(low - bias - threshold) > 1e-9:
            assert (low - bias >= threshold) == any(a <= exposure_s <= b for a, b in found.sure_windows_s)


@pytest.mark.slow
@pytest.mark.parametrize("pictures", [12, 20])
def test_pictures_asked_for_tell_as_often_as_said(pictures):
    """Of 250 cases that cannot be told, the true mean anywhere about the threshold: in 30 to 75 %."""
    rng = np.random.default_rng(pictures)
    told = cases = 0
    while cases < 250:
        mean = rng.uniform(0.45, 0.75)
        values = rng.beta(6 * mean, 6 * (1 - mean), 9999)
        found = answer({0.01: values[:pictures]})
        count = found.pictures_needed
        if found.verdict != "cannot tell" or count is None or count > 3000:
            continue
        cases += 1
        low, high = (float(end[0]) for end in curve(values[:count, None], (0.01,)).ends)
        told += low >= 0.6 or high < 0.6
    assert 0.3 < told / cases < 0.75


def test_an_end_that_was_refined_at_one_speed_is_limited_by_blur():
    """Where it ends, rest was not tested, but it works on both sides; more of the picture saturates there, too."""
    x = np.array([0.001, 0.01, 0.03, 0.1])
    still, moved = np.array([0.9, 0.9, np.nan, 0.9]), np.array([0.9, 0.8, 0.3, 0.1])
    values = np.tile(np.stack([still, moved], axis=1), (9, 1, 1))
    share, known = np.repeat(x[:, None], 2, axis=1), np.isfinite(values).astype(float)
    of = table(np.nan_to_num(values), x, [(0.0, 0.0), (300.0, 0.0)], known, saturated=share)
    _, found = answers(of, Criterion(0.6, kept=False))
    assert found.window_to_limited_by == "blur"


X_S = (0.001, 0.004, 0.016, 0.064)
AIMED = (0.4, 0.4, 0.4, 0.4)
WHITE = (0.0, 0.0, 0.0, 0.5)
UNKNOWN = (np.nan,) * 4


def line(value, slower=None, *, moves=True, saturated=(0.0,) * 4, brightness=AIMED):
    n = len(value)
    shown = {"saturated": np.array(saturated[:n])[:, None], "brightness": np.array(brightness[:n])[:, None]}
    of = table(np.array(value)[None, :, None], X_S[:n], [(100.0 * moves, 0.0)], **shown)
    return TestedLine(of, None if slower is None else np.array(slower))


HILL = (0.2, 0.9, 0.95, 0.3)
HELD = (0.2, 0.9, 0.96, 0.97)


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        (line(HILL, HELD), ("noise", "blur")),
        (line(HILL, HELD, saturated=WHITE), ("noise", "blur")),  # at rest it works, white as it may be
        (line(HILL, HILL, saturated=WHITE), ("noise", "saturation")),
        (line(HILL, HILL), ("noise", None)),
        (line(HILL, moves=False, saturated=WHITE), ("noise", "saturation")),
        (line(HILL, saturated=WHITE), ("noise", None)),  # one of the two
        (line(HILL, saturated=UNKNOWN), ("noise", None)),
        # white at its best, too
        (line(HILL, HILL, saturated=(0.0, 0.01, 0.9, 0.9)), ("noise", "saturation")),
        (line(HILL, HELD, brightness=(0.32, *AIMED[1:])), ("darkness", "blur")),
        (line(HILL, HELD, brightness=(0.34, 0.1, 0.1, 0.1)), ("noise", "blur")),  # where it fails counts
        (line(HILL, HELD, brightness=UNKNOWN), (None, "blur")),
        (line((0.9, 0.9, 0.9, 0.9), HELD), (None, None)),
    ],
)
def test_ends_of_a_window(given, expected):
    works = [place for place, value in enumerate(given.of.mean) if value >= 0.8]
    window = X_S[works[0]] * (0.5 if works[0] else 1.0), X_S[works[-1]] * (2.0 if works[-1] < 3 else 1.0)
    found = of_window(given, window, 0.8)
    assert (found.low, found.high) == expected
    assert found.by is None


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        (line((0.2, 0.5, 0.4, 0.1), (0.2, 0.6, 0.8, 0.9)), "blur and noise"),
        (line((0.2, 0.6, 0.4, 0.1), (0.2, 0.6, 0.8, 0.9)), "blur and noise"),  # blur keeps from more light
        (line((0.1, 0.3, 0.5, 0.6), (0.1, 0.3, 0.5, 0.6), brightness=(0.1,) * 4), "darkness"),  # as at rest
        (line((0.1, 0.3, 0.5, 0.6), (0.1, 0.3, 0.6, 0.61), brightness=(0.1,) * 4), None),
        (line((0.2, 0.5, 0.4, 0.1), (0.2, 0.6, 0.8, 0.9), brightness=(0.1,) * 4), "blur and darkness"),
        (line((0.2, 0.5, 0.1, 0.1), (0.2, 0.7, 0.7, 0.7)), "blur"),
        (line((0.1, 0.5, 0.1, 0.1), (0.6, 0.5, 0.5, 0.5)), "saturation"),
        (line((0.1, 0.5, 0.5, 0.1), moves=False, saturated=WHITE), "noise"),
        (line((0.1, 0.4, 0.5, 0.1), moves=False, saturated=WHITE), "noise and saturation"),
        (line((0.1, 0.4, 0.5, 0.1)), "noise and blur"),
        (line((0.5, 0.5, 0.5, 0.5), moves=False), None),
        # saturated from the shortest on, as at rest
        (line((0.5, 0.3, 0.1, 0.1), (0.5, 0.3, 0.1, 0.1), saturated=(0.2, 0.5, 0.9, 0.9)), "saturation"),
        # one exposure: what is wrong at rest, and what motion adds
        (line((0.3,), moves=False), "noise"),
        (line((0.3,), (0.4,), saturated=(0.9,)), "blur and saturation"),
        (line((0.3,), (0.3,), brightness=(0.1,)), "darkness"),
        (line((0.3,), (0.85,)), "blur"),
    ],
)
def test_what_holds_the_best_back(given, expected):
    found = of_best(given, int(given.of.mean.argmax()), 0.8)
    assert found.by == expected
