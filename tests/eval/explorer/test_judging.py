"""Judging one picture: what counts, what is enough, and which exposure keeps most."""

from __future__ import annotations

import math
from bisect import insort
from itertools import pairwise

import pytest
from blurnoise_eval.answers.criterion import MATCHES, Criterion
from blurnoise_eval.explorer import sentences
from blurnoise_eval.explorer.controls import control
from blurnoise_eval.explorer.judging import Point, Standard, finer, keeps_most, works
from blurnoise_eval.scoring.on_picture import NOTHING, Sight

from blurnoise import Camera

KEPT, ABSOLUTE = Criterion(0.9, kept=True), Criterion(0.6, kept=False)
ALONG = control("exposure_s", Camera.preset("imx250"))


def sight(*confidences: float) -> Sight:
    rows = tuple({"target_id": 2 * place, "confidence": held} for place, held in enumerate(confidences))
    return Sight(NOTHING, rows, 1.0, None, 0)


def strip(
    standard: Standard, best_ms: float, stops: float = 3.0, saturated_from: float = math.inf
) -> list[Point]:
    """A strip and what is tried after it: the kept share falls as a parabola of the logarithm."""

    def stop(value: float) -> Point:
        share = max(0.0, 1 - (math.log2(value / best_ms) / stops) ** 2)
        return Point(value, (0.5 * share,), 0.3 if value > saturated_from else 0.0)

    curve = [stop(value) for value in ALONG.places(15)]
    while (value := finer(curve, standard)) is not None:
        assert len(curve) < 15 + 18
        insort(curve, stop(value))
    return curve


def test_a_share_of_the_original_is_enough_and_what_is_missed_there_is_no_target() -> None:
    clean, seen = sight(0.8, 0.1, 0.4), sight(0.6, 0.9, 0.5)
    standard = Standard.of(KEPT, clean)
    assert standard.original == pytest.approx(0.6)
    assert standard.enough == pytest.approx(0.54)
    assert standard.scores(seen) == (0.6, 0.5)
    assert standard.value(0.54) == pytest.approx(0.9)
    assert standard.found_from == 0.25
    assert [row["target_id"] for row in standard.sight(seen).targets] == [0, 4]


def test_a_confidence_is_enough_where_a_run_asks_for_one_of_all_its_targets() -> None:
    standard = Standard.of(ABSOLUTE, sight(0.8, 0.1, 0.4))
    assert (standard.enough, standard.found_from, standard.value(0.3)) == (0.6, 0.6, 0.3)
    assert standard.scores(sight(0.6, 0.9, 0.5)) == (0.6, 0.9, 0.5)


def test_texts_are_read_or_not() -> None:
    def read(*texts: str) -> Sight:
        rows = (
            {"target_id": n, "confidence": 0.4, "text": each, "truth": "ab"} for n, each in enumerate(texts)
        )
        return Sight(NOTHING, tuple(rows), 1.0, None, 0)

    standard = Standard.of(Criterion(0.9, kept=True, score=MATCHES), read("ab", "cd", "ab"))
    assert standard.scores(read("ab", "ab", "cd")) == (1.0, 0.0)
    assert standard.enough == pytest.approx(0.9)


def test_a_weak_detector_that_keeps_all_works() -> None:
    """Whose confidences never reach 0.6, as those of real detectors on small targets."""
    standard = Standard.of(KEPT, sight(0.5))
    kept = works(strip(standard, 10.0), standard.enough, 10.0)
    assert kept is not None
    assert kept[0] < 10 < kept[1]


@pytest.mark.parametrize("best_ms", [3.0, 7.7, 21.0])
def test_a_window_ends_where_the_score_crosses_what_is_enough(best_ms: float) -> None:
    """Ninety per cent of a parabola in log2: the root of a tenth of its half width, to a tenth of a stop."""
    standard = Standard.of(KEPT, sight(0.5))
    for stops in (3.0, 8.0):
        kept = works(strip(standard, best_ms, stops), standard.enough, best_ms, logarithmic=True)
        assert kept is not None
        half = stops * math.sqrt(0.1)
        assert math.log2(kept[0] / best_ms) == pytest.approx(-half, abs=0.1)
        assert math.log2(kept[1] / best_ms) == pytest.approx(half, abs=0.1)


@pytest.mark.parametrize("best_ms", [3.0, 7.7, 21.0])
def test_the_exposure_that_keeps_most_is_found_between_the_places_of_a_strip(best_ms: float) -> None:
    """To a third of a stop; a strip's own places are about a stop apart."""
    standard = Standard.of(KEPT, sight(0.5))
    places = ALONG.places(15)
    assert min(b / a for a, b in pairwise(places)) > 1.9
    for stops in (1.0, 3.0, 8.0):
        most = keeps_most(strip(standard, best_ms, stops), standard)
        assert abs(math.log2(most.value / best_ms)) < 1 / 3


def test_a_saturated_exposure_is_used_only_where_no_other_works() -> None:
    standard = Standard.of(KEPT, sight(0.5))
    most = keeps_most(strip(standard, 20.0, saturated_from=15.0), standard)
    assert most.value <= 15
    all_saturated = keeps_most(strip(standard, 20.0, saturated_from=0.0), standard)
    assert abs(math.log2(all_saturated.value / 20)) < 1 / 3


def test_the_words_name_it() -> None:
    standard = Standard.of(KEPT, sight(0.5))
    told = sentences.window(strip(standard, 10.0), ALONG, 10.0, standard)
    assert told.startswith("Exposure: keeps 90 % or more from about ")
    assert "; most, 100 % at 9.96 ms" in told
    none = sentences.window([Point(5.0, (0.2,)), Point(10.0, (0.25,))], ALONG, 5.0, standard)
    assert none == "None of the 2 values of exposure tried keeps 90 %; most is 50 % at 10 ms."
    absolute = Standard.of(ABSOLUTE, sight(0.5))
    assert "the mean is 0.60 or more" in sentences.window([Point(5.0, (0.7,))], ALONG, 5.0, absolute)


def test_where_it_works() -> None:
    curve = [Point(float(x), (held,)) for x, held in enumerate((0.9, 0.2, 0.7, 0.8, 0.7, 0.1))]
    window = (1.8, 4 + 1 / 6)  # where straight lines cross 0.6
    assert works(curve, 0.6, 3.3) == pytest.approx(window)
    assert works(curve, 0.6, 0.0) == pytest.approx((0.0, 3 / 7))
    assert works(curve, 0.6, 5.5) == pytest.approx(window)
    along = [Point(1.0, (0.2,)), Point(4.0, (0.8,))]
    assert works(along, 0.5, 4.0, logarithmic=True) == pytest.approx((2.0, 4.0))
    assert works(curve, 0.95, 1.0) is None
    assert finer([Point(6.0, (0.5,))], Standard.of(KEPT, sight(0.5))) is None
