"""Exposure windows against values worked out by hand, and what must hold for any curve."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from blurnoise_eval.scoring import exposure_window as optimum
from blurnoise_eval.scoring.curves import surfaces
from blurnoise_eval.scoring.exposure_window import NEAR_BEST, Answer, recommend, windows
from hypothesis import given
from hypothesis import strategies as st
from plans import OWN

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
    assert recommend((0.02,), (0.7,), 0.6) == (0.02, 0.7)


def test_recommended_has_stops_to_spare() -> None:
    """All equally good: the middle of the window, though the best by a hair lies at its edge."""
    confidence = (0.9, 0.9 - NEAR_BEST / 2, 0.89, 0.2)
    assert recommend(DECADES_S, confidence, 0.6) == (0.01, confidence[1])
    assert recommend(DECADES_S, (0.95, 0.9, 0.89, 0.2), 0.6) == (0.001, 0.95)  # clearly best: no


def test_recommended_comes_from_the_window_of_the_best() -> None:
    confidence = (0.7, 0.3, 0.9, 0.3)
    assert recommend(DECADES_S, confidence, 0.6) == (0.1, 0.9)


def test_no_exposure_works() -> None:
    assert recommend(DECADES_S, (0.1, 0.2, 0.3, 0.59), 0.6) is None


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
    choice = recommend(exposures, confidence, threshold)
    if choice is None:
        assert max(confidence) < threshold
        return
    exposure, value = choice
    assert value == confidence[exposures.index(exposure)]
    assert threshold <= value
    assert value >= max(confidence) - NEAR_BEST
    assert any(low <= exposure <= high for low, high in windows(exposures, confidence, threshold))


def answers(table: list[dict[str, Any]], threshold: float) -> list[Answer]:
    """The answers of rows in any order, each a picture of its own."""
    exposed = [
        {"model": "m", "image": f"p{place}", "repeat": 0, "target_id": 0, **row}
        for place, row in enumerate(table)
        if not row["clean"]
    ]
    exposed.sort(key=lambda row: (row["group"], row["illuminance_lux"]))
    generator = np.random.default_rng(0)
    return [
        answer for surface in surfaces(exposed) for answer in optimum.answers(surface, threshold, generator)
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
    assert list(answer.row())[:6] == ["model", "group", *list(answer.at)[:4]]
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


def test_answers_keep_groups_lights_and_speeds_apart() -> None:
    table = [
        *rows({0.01: [0.9], 0.1: [0.3]}, group="a"),
        *rows({0.01: [0.1], 0.1: [0.2]}, group="b"),
        *rows({0.01: [0.4], 0.1: [0.8]}, group="a", lux=5.0),
        *rows({0.01: [0.7], 0.1: [0.7]}, group="a", speed=200.0),
    ]
    found = {(a.group, a.at["illuminance_lux"], a.at["velocity_x_px_s"]): a for a in answers(table, 0.6)}
    assert {key: answer.recommended_s for key, answer in found.items()} == {
        ("a", 5.0, 0.0): 0.1,
        ("a", 50.0, 0.0): 0.01,
        ("a", 50.0, 200.0): 0.01,
        ("b", 50.0, 0.0): None,
    }
    assert found["b", 50.0, 0.0].windows_s == ()
    assert (found["b", 50.0, 0.0].open_low, found["b", 50.0, 0.0].open_high) == (False, False)


def test_only_clean_rows_give_no_answer() -> None:
    assert answers([CLEAN], 0.6) == []


def test_no_interval_below_three_samples() -> None:
    (answer,) = answers(rows({0.01: [0.4, 0.6], 0.1: [0.5, 0.5]}), 0.6)
    assert answer.low is None
    assert answer.high is None


def test_interval_has_the_width_of_the_mean_s_spread() -> None:
    """400 normal samples of sigma 0.1: +-1.96 x 0.1 / sqrt(400) = +-0.0098.

    A 2.5 % quantile of 400 resampled means has a standard error of sqrt(p q / n) / density(1.96) =
    0.0078 / 0.0584 = 0.134 sigma of the mean, the sample's own sigma one of 1 / sqrt(800) = 0.035: within
    5 x sqrt(2) x 0.14 of a full width of 3.92, so within 25 %.
    """
    samples = np.random.default_rng(3).normal(0.5, 0.1, 400).tolist()
    (answer,) = answers(rows({0.01: samples}), 0.6)
    assert answer.low is not None
    assert answer.high is not None
    assert answer.high[0] - answer.low[0] == pytest.approx(2 * 0.0098, rel=0.25)
    assert answer.low[0] < answer.confidence[0] < answer.high[0]


@given(st.lists(st.lists(st.floats(0, 1), min_size=3, max_size=40), min_size=1, max_size=4))
def test_intervals_cover_the_mean(samples: list[list[float]]) -> None:
    curve = {0.001 * 2**index: values for index, values in enumerate(samples)}
    (answer,) = answers(rows(curve), 0.6)
    assert answer.low is not None
    assert answer.high is not None
    for low, mean, high in zip(answer.low, answer.confidence, answer.high, strict=True):
        assert 0 <= low <= mean <= high <= 1


def test_same_rows_same_answer() -> None:
    table = rows({0.01: [0.1, 0.9, 0.4, 0.5], 0.1: [0.2, 0.8, 0.6, 0.7]})
    assert answers(table, 0.6) == answers(table, 0.6)
