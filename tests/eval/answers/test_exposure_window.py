"""Exposure windows against values worked out by hand, and what must hold for any curve."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from blurnoise_eval.answers import exposure_window as optimum
from blurnoise_eval.answers.criterion import Criterion
from blurnoise_eval.answers.curves import windows
from blurnoise_eval.answers.exposure_window import flat, recommended
from blurnoise_eval.answers.recommendation import NEAR
from hypothesis import given
from hypothesis import strategies as st
from made_tables import Named, curve, tables
from plans import OWN
from scipy import stats

DECADES_S = (0.001, 0.01, 0.1, 1.0)


@pytest.mark.parametrize(
    ("confidence", "expected"),
    [
        # From 0.2 to 0.8 the line meets 0.6 two thirds of a decade on; from 0.8 to 0.4, half a decade on.
        ((0.2, 0.8, 0.8, 0.4), [(10 ** (-3 + 2 / 3), 10**-0.5)]),
        ((0.8, 0.4, 0.5, 0.9), [(0.001, 10**-2.5), (10**-0.75, 1.0)]),  # two windows, both open
        ((0.5, 0.7, 0.5, 0.7), [(10**-2.5, 10**-1.5), (10**-0.5, 1.0)]),
        ((0.9, 0.9, 0.6, 0.6), [(0.001, 1.0)]),  # at the threshold counts
        ((0.59, 0.5, 0.4, 0.0), []),
        ((0.0, 0.6, 0.0, 0.0), [(0.01, 0.01)]),  # touches it in one exposure
    ],
)
def test_windows_by_hand(confidence: tuple[float, ...], expected: list[tuple[float, float]]) -> None:
    found = windows(DECADES_S, confidence, 0.6)
    assert len(found) == len(expected)
    for window, ends in zip(found, expected, strict=True):
        assert window == pytest.approx(ends, rel=1e-9)


def test_one_exposure() -> None:
    assert windows((0.02,), (0.7,), 0.6) == [(0.02, 0.02)]
    assert windows((0.02,), (0.5,), 0.6) == []
    assert recommended((0.02,), (0.7,), 0.6, None) == 0


def test_recommended_is_the_middle_of_what_is_equally_good() -> None:
    """Though the best by a hair lies at its edge."""
    confidence = (0.9, 0.9 - NEAR / 2, 0.897, 0.2)
    assert recommended(DECADES_S, confidence, 0.6, None) == 1
    assert recommended(DECADES_S, (0.95, 0.9, 0.89, 0.2), 0.6, None) == 0  # clearly best: no


curves = st.integers(1, 12).flatmap(
    lambda count: st.tuples(
        st.lists(
            st.floats(1e-5, 10.0), min_size=count, max_size=count, unique=True
        ).map(sorted),
        st.lists(
            st.floats(0, 1) | st.sampled_from([0.0, 0.6, math.nextafter(0.6, 0), 1.0]),
            min_size=count,
            max_size=count,
        ),
    )
)  # fmt: skip


@given(curves, st.sampled_from([0.0, 0.3, 0.6, 1.0]))
def test_windows_hold_exactly_the_exposures_that_work(
    curve: tuple[list[float], list[float]], threshold: float
) -> None:
    exposures, confidence = curve
    found = windows(exposures, confidence, threshold)
    ends = [end for window in found for end in window]
    assert ends == sorted(ends)
    assert all(exposures[0] <= end <= exposures[-1] for end in ends)
    for exposure, value in zip(exposures, confidence, strict=True):
        inside = any(low <= exposure <= high for low, high in found)
        # A crossing may fall on the neighbour itself where the two differ by less than rounding shows.
        assert inside if value >= threshold else not inside or exposure in ends


@given(curves, st.sampled_from([0.0, 0.3, 0.6, 1.0]))
def test_recommended_is_inside_a_window_and_works(
    curve: tuple[list[float], list[float]], threshold: float
) -> None:
    exposures, confidence = curve
    choice = recommended(exposures, confidence, threshold, None)
    if choice is None:
        assert max(confidence) < threshold
        return
    exposure, value = exposures[choice], confidence[choice]
    assert threshold <= value
    assert value >= max(confidence) - NEAR
    assert any(low <= exposure <= high for low, high in windows(exposures, confidence, threshold))


def answers(table: list[dict[str, Any]], threshold: float) -> list[Named]:
    """The answers of rows in any order, each a picture of its own."""
    exposed = [{"model": "m", "repeat": 0, "target_id": 0, **row} for row in table if not row["clean"]]
    exposed.sort(key=lambda row: (row["group"], row["illuminance_lux"]))
    return [
        Named(answer)
        for each in tables(exposed)
        for answer in optimum.answers(each, Criterion(threshold, kept=False))
    ]


def rows(
    curve: dict[float, list[float]], group: str = "sign", lux: float = 50.0, speed: float = 0.0
) -> list[dict[str, Any]]:
    """Target rows as the store gives them: one per exposure and sample."""
    at = {"group": group, "illuminance_lux": lux, "velocity_x_px_s": speed, "velocity_y_px_s": 0.0, **OWN}
    return [
        {**at, "clean": False, "exposure_s": exposure, "confidence": value, "image": f"p{place}"}
        for exposure, values in curve.items()
        for place, value in enumerate(values)
    ]


CLEAN = {"clean": True, "confidence": 0.99, "group": "sign", "illuminance_lux": None, "exposure_s": None}


def test_answers_by_hand() -> None:
    table = rows({0.1: [0.9, 0.5, 0.7, 0.7], 0.001: [0.1, 0.3, 0.2, 0.2], 0.01: [0.8, 0.8, 0.8, 0.8]})
    (answer,) = answers([CLEAN, *table], 0.6)
    assert (answer.group, answer.at) == (
        "sign",
        {"illuminance_lux": 50.0, "velocity_x_px_s": 0.0, "velocity_y_px_s": 0.0, **OWN},
    )
    assert list(answer)[:6] == ["model", "group", *list(answer.at)[:4]]
    assert answer.exposures_s == (0.001, 0.01, 0.1)
    assert answer.confidence == pytest.approx((0.2, 0.8, 0.7))
    assert answer.n_targets == 4
    assert len(answer.windows_s) == 1
    assert answer.windows_s[0] == pytest.approx((10 ** (-3 + 2 / 3), 0.1))
    assert (answer.open_low, answer.open_high) == (False, True)
    assert (answer.recommended_s, answer.confidence_at_recommended) == (0.01, pytest.approx(0.8))


@pytest.mark.parametrize(
    ("curve", "expected"),
    [
        ((0.2, 0.8, 0.3), (False, False)),
        ((0.6, 0.8, 0.3), (True, False)),
        ((0.2, 0.8, 0.6), (False, True)),
        ((0.7, 0.2, 0.7), (True, True)),
        ((0.1, 0.2, 0.1), (False, False)),
    ],
)
def test_open_ends_are_told(curve: tuple[float, ...], expected: tuple[bool, bool]) -> None:
    (answer,) = answers(rows({10.0**-index: [value] for index, value in enumerate(reversed(curve))}), 0.6)
    assert (answer.open_low, answer.open_high) == expected


@pytest.mark.parametrize("pictures", [1, 3, 7])
def test_below_eight_pictures_no_interval_and_no_verdict(pictures: int) -> None:
    """However clear it looks."""
    (answer,) = answers(rows({0.01: [0.9] * pictures, 0.1: [0.1] * pictures}), 0.6)
    assert answer.verdict == "cannot tell"
    assert (answer.low, answer.high, answer.recommended_low, answer.regret_95) == (None,) * 4
    assert answer.windows_high_s == [[None, None]]
    assert answer.sure_windows_s == []
    assert (answer.n_pictures, answer.few_pictures) == (pictures, True)
    assert answer.recommended_s == 0.01  # the best guess


def spread(mean: float, sigma: float, pictures: int) -> list[float]:
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
def test_verdicts(means: tuple[float, ...], pictures: int, verdict: str) -> None:
    by_exposure = {0.001 * 10**place: spread(mean, 0.1, pictures) for place, mean in enumerate(means)}
    (answer,) = answers(rows(by_exposure), 0.6)
    assert answer.verdict == verdict
    assert (answer.pictures_to_tell is None) == (verdict != "cannot tell")


@pytest.mark.parametrize(("value", "threshold", "needed"), [(0.95, 0.9, 33), (0.0, 0.05, 34)])
def test_pictures_all_alike_are_not_certain(value: float, threshold: float, needed: int) -> None:
    """That eight are alike does not show that all are. Beta(0.25, n) at 97.5 % is 0.05 / 0.95 at some 33, and
    0.05 at some 34 pictures."""
    (answer,) = answers(rows({0.01: [value] * 8, 0.1: [value] * 8}), threshold)
    assert answer.verdict == "cannot tell"
    assert answer.sure_windows_s == []
    assert stats.beta(0.25, needed).ppf(0.975) == pytest.approx(0.05 / max(value, 1 - value), rel=0.04)
    assert answer.pictures_to_tell == pytest.approx(needed, abs=1)
    (answer,) = answers(rows({0.01: [value] * 40, 0.1: [value] * 40}), threshold)
    assert answer.verdict == ("works" if value > threshold else "no exposure works")


@given(
    st.lists(st.lists(st.sampled_from([0.0, 0.5, 0.6, 1.0]) | st.floats(0, 1), min_size=8, max_size=24), min_size=1,
             max_size=3),
    st.sampled_from([0.0, 0.05, 0.5, 0.6, 0.9, 1.0]),
    st.lists(st.integers(1, 4), min_size=8, max_size=24),
)  # fmt: skip
def test_no_verdict_contradicts_its_interval(
    samples: list[list[float]], threshold: float, targets: list[int]
) -> None:
    fewest = min(*map(len, samples), len(targets))
    table = [
        row | {"target_id": target}
        for row in rows({0.001 * 4**place: values[:fewest] for place, values in enumerate(samples)})
        for target in range(targets[int(row["image"][1:])])
    ]
    (answer,) = answers(table, threshold)
    sizes = targets[:fewest]
    assert (answer.low is None) == (sum(sizes) ** 2 / sum(k * k for k in sizes) < 8)
    if answer.low is None or answer.high is None:
        assert answer.verdict == "cannot tell"
        return
    assert (answer.verdict == "works") == (max(answer.low) >= threshold)
    if answer.verdict == "no exposure works":
        assert max(answer.high) < threshold
    if answer.verdict == "cannot tell" and len(samples) == 1:
        assert max(answer.high) >= threshold
    for exposure_s, low in zip(answer.exposures_s, answer.low, strict=True):
        assert (low >= threshold) == any(a <= exposure_s <= b for a, b in answer.sure_windows_s)


def test_few_pictures_are_told_by_what_they_weigh() -> None:
    """Of 24 pictures four have six targets, the others one: 44^2 / 164 = 11.8 of one size."""
    table = [
        row | {"target_id": target}
        for row in rows({0.01: spread(0.9, 0.05, 24)})
        for target in range(6 if int(row["image"][1:]) < 4 else 1)
    ]
    (answer,) = answers(table, 0.5)
    assert (answer.verdict, answer.n_pictures, answer.few_pictures) == ("works", 24, True)
    (answer,) = answers(rows({0.01: spread(0.9, 0.05, 24)}), 0.5)
    assert not answer.few_pictures


@pytest.mark.parametrize("mean", [0.64, 0.56])
def test_as_many_pictures_as_are_asked_for_tell(mean: float) -> None:
    """The same mean and spread in the number asked for: then it is told, and not with a quarter fewer."""
    curves = {n: {0.01: spread(mean, 0.1, n), 0.1: spread(0.3, 0.1, n)} for n in range(8, 60)}
    (answer,) = answers(rows(curves[16]), 0.6)
    needed = answer.pictures_to_tell
    assert needed is not None
    assert answers(rows(curves[needed]), 0.6)[0].verdict != "cannot tell"
    assert answers(rows(curves[needed * 3 // 4]), 0.6)[0].verdict == "cannot tell"


def test_regret_bounds_what_the_choice_loses() -> None:
    """Paired: pictures differ by 0.1, but each loses 0.004 -+ 0.002 from the best exposure to the chosen one.

    t(0.95, 24) = 1.711 x 0.002 / 5 above the mean loss (skewness may add a little), though the
    means' own intervals are 0.04 wide.
    """
    level, own = np.array(spread(0.8, 0.1, 25)), np.array(spread(0.0, 0.002, 25))
    own = np.random.default_rng(0).permutation(own)
    by_exposure = {0.008: (level - 0.0008).tolist(), 0.01: level.tolist()}
    by_exposure |= {0.0125: (level + 0.004 + own).tolist(), 0.06: [0.1] * 25}
    (answer,) = answers(rows(by_exposure), 0.6)
    assert answer.recommended_s == 0.01
    assert answer.regret_95 is not None
    assert 0.9999 * 1.711 * 0.002 / 5 <= answer.regret_95 - 0.004 <= 1.3 * 1.711 * 0.002 / 5
    assert answer.low is not None
    assert answer.recommended_low == answer.low[1]


def test_flat_row_has_the_window_of_the_recommended_exposure() -> None:
    by_exposure = {
        0.001: spread(0.8, 0.05, 9),
        0.01: spread(0.3, 0.05, 9),
        0.1: spread(0.9, 0.05, 9),
        1.0: spread(0.3, 0.05, 9),
    }
    (answer,) = answers(rows(by_exposure), 0.6)
    row = flat(answer)
    assert row["n_windows"] == 2
    assert row["window_from_s"] == answer.windows_s[1][0]
    ends = [row[f"window_{end}_s"] for end in ("from_low", "from", "from_high", "to_low", "to", "to_high")]
    assert ends == [0.01, pytest.approx(0.0316, rel=0.2), 0.1, 0.1, pytest.approx(0.316, rel=0.2), 1.0]
    assert not any(isinstance(value, (list, tuple)) for value in row.values())


@pytest.mark.slow
@pytest.mark.parametrize("pictures", [12, 20])
def test_pictures_asked_for_tell_as_often_as_said(pictures: int) -> None:
    """Of 250 cases that cannot be told, the true mean anywhere about the threshold: in 30 to 75 %."""
    rng = np.random.default_rng(pictures)
    told = cases = 0
    while cases < 250:
        mean = rng.uniform(0.45, 0.75)
        values = rng.beta(6 * mean, 6 * (1 - mean), 9999)
        (answer,) = answers(rows({0.01: values[:pictures].tolist()}), 0.6)
        count = answer.pictures_to_tell
        if answer.verdict != "cannot tell" or count is None or count > 3000:
            continue
        cases += 1
        low, high = (float(end[0]) for end in curve(values[:count, None], (0.01,)).ends)
        told += low >= 0.6 or high < 0.6
    assert 0.3 < told / cases < 0.75


def test_an_end_that_was_refined_at_one_speed_is_limited_by_blur() -> None:
    """Where it ends, rest was not tested, but it works on both sides; more of the picture saturates there, too."""
    still = rows({0.001: [0.9] * 9, 0.01: [0.9] * 9, 0.1: [0.9] * 9})
    moved = rows({0.001: [0.9] * 9, 0.01: [0.8] * 9, 0.03: [0.3] * 9, 0.1: [0.1] * 9}, speed=300.0)
    table = [{**row, "saturated": row["exposure_s"], "brightness": 0.4} for row in still + moved]
    _, answer = answers(table, 0.6)
    assert answer.limited_high == "blur"
