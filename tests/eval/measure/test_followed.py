"""Objects over exposure: which count, where their confidence falls to half, and how far that is shifted."""

import numpy as np
import pytest
from blurnoise_eval.detectors.records import Detections
from blurnoise_eval.measure.followed import confidences, half, median, objects, shifts

STOPS = np.arange(8.0)
HERE, THERE = [0.0, 0.0, 40.0, 20.0], [100.0, 50.0, 130.0, 90.0]


def seen(*found):
    return Detections(
        [box for box, _, _ in found], [score for _, score, _ in found], [name for *_, name in found]
    )


def test_an_object_is_found_twice_and_has_its_surest_box():
    near = [1.0, 0.0, 41.0, 20.0]
    pictures = [
        seen((HERE, 0.4, 0), (THERE, 0.9, 1)),
        seen((near, 0.7, 0)),
        seen((HERE, 0.2, 0), (HERE, 0.35, 1)),
    ]
    found, once = objects(pictures, ["car", "dog"])
    assert [(one.label, list(one.box_xyxy)) for one in found] == [("car", near)]
    assert once == 2  # the dog there, and the dog where the car is
    np.testing.assert_allclose(confidences(pictures, found).T, [[0.4, 0.7, 0.2]], rtol=1e-6)


def test_two_names_of_one_thing_are_two_objects_of_one_thing():
    pictures = [seen((HERE, 0.6, 0), (HERE, 0.5, 1), (THERE, 0.4, 0))] * 2
    found, _ = objects(pictures, ["chair", "couch"])
    assert [(one.label, one.thing) for one in found] == [("chair", 0), ("couch", 0), ("chair", 2)]


def test_without_detections_there_is_no_object():
    found, once = objects([seen(), seen()], ["car"])
    assert (found, once) == ([], 0)
    assert confidences([seen(), seen()], found).shape == (2, 0)


@pytest.mark.parametrize(
    ("values", "dark", "bright"),
    [
        ([0, 0, 0.8, 0.8, 0.8, 0.8, 0.2, 0], (1.5, True), (5 + 2 / 3, True)),
        (
            [0, 0.2, 0.1, 0.8, 0.8, 0.8, 0.8, 0.8],
            (2 + 0.25 / 0.65, True),
            (7.0, False),
        ),  # 0.2 and 0.1 are pooled
        ([0.8, 0.8, 0.8, 0.4, 0.1, 0, 0, 0], (0.0, False), (3.0, True)),
        ([0.1, 0.1, 0.3, 0.1, 0, 0, 0, 0], None, None),
    ],
)
def test_half_is_where_confidence_falls_through_the_level(values, dark, bright):
    for side, expected in (("dark", dark), ("bright", bright)):
        found = half(STOPS, values, 0.4, side)
        assert (found if found is None else tuple(found)) == (expected and pytest.approx(expected))


def bell(centre, width, top=0.8):
    """Confidence that is half of its top ``width`` stops from the centre."""
    return top * 0.5 ** (((STOPS - centre) / width) ** 4)


@pytest.mark.parametrize("by", [-0.75, 0.0, 0.75])
def test_shifts_are_those_of_curves_that_were_shifted(by):
    """Either side by the same, of two objects; the level is that of the captured curve, so a lower top does count."""
    captured = np.stack([bell(3.5, 2.0), bell(4.0, 1.5, 0.5)], 1)
    simulated = np.stack([bell(3.5 + by, 2.0), bell(4.0 + by, 1.5, 0.5)], 1)
    for side in ("dark", "bright"):
        found, beyond = shifts(STOPS, captured, simulated, side)
        np.testing.assert_allclose(found, by, atol=0.25)  # straight lines between stops
        assert not beyond.any()
    lower, _ = shifts(STOPS, captured, 0.7 * captured, "dark")
    # of the second, 0.35 at most, half of 0.5 is at 1.5 log2(1.4)^(1/4) = 1.25 stops in place of 1.5
    np.testing.assert_allclose(lower, [0.33, 0.25], atol=0.1)


def test_what_never_falls_in_simulated_pictures_counts_with_the_last_exposure():
    captured = np.stack([bell(3.5, 2.0), np.full(8, 0.8), np.zeros(8), bell(3.5, 2.0)], 1)
    simulated = np.stack([np.full(8, 0.8), bell(3.5, 2.0), bell(3.5, 2.0), np.zeros(8)], 1)
    found, beyond = shifts(STOPS, captured, simulated, "dark")
    # never half in captured pictures: not known; never found in simulated ones: too late by all exposures
    np.testing.assert_allclose(found, [0 - 1.5, np.nan, np.nan, 7 - 1.5], atol=0.05)
    assert beyond.tolist() == [True, False, False, True]


def test_intervals_draw_things_not_names():
    """Nine names of one thing are no nine observations."""
    values = np.array([0.0, 0.5, 1.0] + [0.5] * 8)
    alone = median(values, range(11))
    together = median(values, [0, 1, 2] + [1] * 8)
    assert alone.value == together.value == 0.5
    assert together.high - together.low == 1.0
    assert alone.high - alone.low < 0.6
    assert not np.isfinite(median([0.1, 0.2], [0, 1]).low)
    assert not median([np.nan], [0]).available


def test_the_interval_covers_the_median_of_what_it_is_drawn_from():
    """Of 200 samples of 15; a bootstrapped interval of a median covers 90 to 97 %, which 200 samples know to 2 %."""
    random, inside = np.random.default_rng(5), 0
    for number in range(200):
        drawn = random.normal(size=15)
        interval = median(drawn, range(15), seed=number)
        inside += interval.low <= 0 <= interval.high
    assert 0.88 <= inside / 200 <= 0.99
