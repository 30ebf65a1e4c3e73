"""The one rule of recommendation against values worked out by hand, and against a search by brute force."""

from dataclasses import replace

import numpy as np
import pytest
from blurnoise_eval.answers.criterion import Criterion
from blurnoise_eval.answers.exposure_window import answers
from blurnoise_eval.answers.recommendation import CANNOT_TELL, FAILS, SURE, averages, recommendations
from made_tables import table


def kept_table(
    values, lux=50.0, group="sign", *, gain_db=0.0, pictures=40, spread=0.02, saturated=None, counts=1.0
):
    """values: mean by speed and exposure, about which ``pictures`` are spread evenly."""
    speeds, exposures = sorted(values), sorted(next(iter(values.values())))
    mean = np.array([[values[speed][each] for speed in speeds] for each in exposures])
    each = mean + np.linspace(-spread, spread, pictures)[:, None, None]
    share = np.array([[(saturated or {}).get(each, 0.0)] * len(speeds) for each in exposures])
    velocities = [(speed, 0.0) for speed in speeds]
    own = {"group": group, "clean": 0.9, "at": {"illuminance_lux": lux, "gain_db": gain_db}}
    return table(counts * each, exposures, velocities, counts, saturated=share, **own)


def rows(*every, level=0.9):
    found = recommendations(averages(list(every), level))
    return {(row.conditions["illuminance_lux"], row.speed): row for row in found}


def test_the_exposure_that_keeps_most_on_average_wins_over_the_one_that_is_surest():
    """1 ms is sure at one light; 3 ms keeps more on average. Another light at which only the average counts."""
    bright = kept_table({0.0: {0.001: 0.96, 0.003: 0.95, 0.01: 0.60}}, 1000.0)
    dim = kept_table({0.0: {0.001: 0.40, 0.003: 0.85, 0.01: 0.88}}, 2.0)
    found = rows(bright, dim)
    whole = found[None, None]
    assert whole.exposure_s == 0.003
    assert whole.score.value == pytest.approx((0.95 + 0.85) / 2)
    assert whole.regret == pytest.approx((0.01 + 0.03) / 2)
    assert (whole.n_works, whole.n_fails, whole.n_conditions) == (1, 1, 2)
    assert (found[2.0, None].exposure_s, found[2.0, None].verdict) == (0.01, FAILS)
    assert (found[1000.0, None].exposure_s, found[1000.0, None].verdict) == (0.001, SURE)
    assert found[2.0, None].score_at_overall_exposure == pytest.approx(0.85)


def test_what_saturates_a_tenth_is_not_used_while_another_works():
    values = {0.0: {0.001: 0.92, 0.01: 0.99}}
    assert rows(kept_table(values))[None, None].exposure_s == 0.01
    bright = kept_table(values, saturated={0.01: 0.95})
    assert rows(bright)[None, None].exposure_s == 0.001
    weak = kept_table({0.0: {0.001: 0.5, 0.01: 0.99}}, saturated={0.01: 0.95})
    assert rows(weak)[None, None].exposure_s == 0.01  # nothing else works
    assert rows(weak)[None, None].saturated_share == pytest.approx(0.95)
    every = kept_table(values, saturated={0.001: 0.3, 0.01: 0.9})
    assert rows(every)[None, None].exposure_s == 0.001  # all that work saturate: the least of them


@pytest.mark.parametrize(("darker", "expected_s"), [(0.48, 0.001), (0.46, 0.01)])
def test_where_none_works_saturation_decides_between_those_that_score_alike(darker, expected_s):
    """Within 0.03 of one that burns a third of the picture."""
    weak = kept_table({0.0: {0.001: darker, 0.01: 0.5}}, saturated={0.01: 0.33})
    assert rows(weak)[None, None].exposure_s == expected_s


def test_tables_name_the_exposure_that_the_page_does():
    """3 ms, of a refinement, scores 0.008 more than those of the grid: not enough to be named instead of one."""
    of = kept_table({0.0: {0.001: 0.93, 0.003: 0.938, 0.01: 0.7}})
    (answer,) = answers(of, Criterion(0.9, kept=False), grid_s=(0.001, 0.01))
    page = recommendations(averages([of], 0.9, grid_s=(0.001, 0.01)))[0]
    assert answer.recommended_s == page.exposure_s == 0.001
    assert answers(of, Criterion(0.95, kept=False))[0].recommended_s is None


def test_saturation_is_averaged_as_the_values_are():
    """14 % at one of three lights is not a tenth of what this exposure sees."""
    lights = [kept_table({0.0: {0.001: 0.90, 0.003: 0.96}}, lux) for lux in (2.0, 50.0)]
    bright = kept_table({0.0: {0.001: 0.91, 0.003: 0.95}}, 1000.0, saturated={0.003: 0.14})
    assert rows(*lights, bright)[None, None].exposure_s == 0.003
    assert rows(*lights, bright)[1000.0, None].exposure_s == 0.001


def test_the_interval_of_an_average_is_paired_by_picture():
    """The same pictures in two lights: their mean varies as each does, and as a Student interval says."""
    lights = [kept_table({0.0: {0.001: 0.6}}, lux, pictures=50, spread=0.2) for lux in (2.0, 50.0)]
    (whole,) = [row for row in recommendations(averages(lights, 0.5)) if row.scope == "all"]
    spread = np.linspace(-0.2, 0.2, 50).std(ddof=1) / np.sqrt(50)
    assert whole.score.value - whole.score.low == pytest.approx(2.01 * spread, rel=0.15)


def test_what_is_sure_at_a_speed_is_at_slower_ones_too():
    """At rest the level is missed by a hair; a faster speed has it surely, so that rest has."""
    some = [kept_table({0.0: {0.001: 0.92}, 600.0: {0.001: 0.97}, 900.0: {0.001: 0.2}})]
    verdicts = [
        [
            row.verdict
            for row in recommendations(averages(some, 0.9, monotone=pooled))
            if row.scope == "condition"
        ]
        for pooled in (False, True)
    ]
    assert verdicts == [[CANNOT_TELL, SURE, FAILS], [SURE, SURE, FAILS]]


HILL = {each: 0.9 - 0.1 * np.log2(each / 0.005) ** 2 for each in (0.001, 0.003, 0.01, 0.03)}


@pytest.mark.parametrize(
    ("kept", "saturated", "further"),
    [
        (HILL, {}, 0.005),  # the top of the parabola in log exposure
        (HILL | {0.005: 0.9}, {}, 0.00707),  # which was tested: the middle of the wider gap
        ({0.001: 0.949, 0.004: 0.95, 0.016: 0.949}, {}, None),  # a plateau
        ({0.0118: 0.85, 0.016: 0.9}, {}, None),  # near enough
        ({0.016: 0.9}, {}, None),
        ({0.001: 0.5, 0.004: 0.7, 0.016: 0.9}, {}, 0.008),  # at an end: the gap beside it is halved
        ({0.001: 0.90, 0.004: 0.95, 0.016: 0.99}, {0.016: 0.5}, 0.008),  # towards saturation, too
    ],
)
def test_the_next_exposure(kept, saturated, further):
    of = averages([kept_table({0.0: kept}, lux, saturated=saturated) for lux in (2.0, 50.0)], 0.9)
    assert of.next_exposure() == (None if further is None else pytest.approx(further, rel=0.005))


def paired(first, second, spread, pictures=20, **fields):
    """Two exposures; pictures differ by 0.2 in both alike, and by ``spread`` in the difference."""
    half = np.linspace(-1, 1, pictures)
    sums = np.stack([first + 0.2 * half, second + 0.2 * half + spread * half[::-1].copy() ** 3], axis=1)
    return table(sums[:, :, None], (0.001, 0.002), clean=0.9, **fields)


def test_an_exposure_is_settled_by_pictures_that_cannot_tell_whether_it_works():
    """The pictures differ alike at both exposures: this widens the interval of the level and not of the gain."""
    (row, *_) = recommendations(averages([paired(0.70, 0.68, 0.05)], 0.7))
    assert (row.verdict, row.settled, row.exposure_s, row.rival_s) == (CANNOT_TELL, True, 0.001, 0.002)
    spread = 0.05 * (np.linspace(-1, 1, 20) ** 3).std(ddof=1) / np.sqrt(20)
    assert row.rival_gain_95 == pytest.approx(-0.02 + 1.729 * spread, abs=1e-4)  # Student's t, one-sided


def test_an_exposure_that_another_may_beat_by_more_is_not_settled():
    (row, *_) = recommendations(averages([paired(0.70, 0.69, 0.3)], 0.7))
    assert (row.settled, row.rival_s) == (False, 0.002)
    (more, *_) = recommendations(
        averages([paired(0.70, 0.69, 0.3, pictures=2 * row.pictures_to_settle)], 0.7)
    )
    assert more.settled


@pytest.mark.parametrize("pictures", [7, 8])
def test_few_pictures_settle_nothing(pictures):
    (row, *_) = recommendations(averages([paired(0.70, 0.5, 0.01, pictures)], 0.7))
    assert row.settled is (None if pictures < 8 else True)


def test_an_exposure_that_saturates_is_no_rival():
    own = {"saturated": np.array([[0.0], [0.9]])}
    (row, *_) = recommendations(averages([paired(0.70, 0.95, 0.01, **own)], 0.6))
    assert (row.exposure_s, row.settled, row.rival_s) == (0.001, None, None)


@pytest.mark.parametrize(("untested", "settled"), [(None, True), (0.02, True), (0.04, None)])
def test_what_a_search_did_not_test_must_not_promise_more(untested, settled):
    of = averages([paired(0.70, 0.60, 0.05)], 0.7)
    (row, *_) = recommendations(replace(of, untested_gain=lambda *about: untested))
    assert (row.settled, row.untested_gain, row.rival_s) == (settled, untested, 0.002)


def test_the_search_alone_settles_an_exposure_without_a_tested_rival():
    """The other one was tested by none of these pictures at this light."""
    alone = kept_table({0.0: {0.001: 0.9}})
    for untested, settled in ((0.02, True), (0.04, None)):
        of = replace(averages([alone], 0.7), untested_gain=lambda *about, gain=untested: gain)
        assert recommendations(of)[0].settled is settled
    few = replace(
        averages([kept_table({0.0: {0.001: 0.9}}, pictures=7)], 0.7), untested_gain=lambda *about: 0.0
    )
    assert recommendations(few)[0].settled is None


def test_a_search_is_asked_for_the_conditions_and_the_exposure_of_each_row():
    asked = []
    of = averages([kept_table({0.0: {0.001: 0.9}}, lux) for lux in (10.0, 100.0)], 0.7)
    recommendations(replace(of, untested_gain=lambda *about: asked.append(about)))
    lights = [sorted(each[0] for each in settings) for settings, _, _ in asked]
    whole, *_ = lights
    assert len(whole) == 2
    assert sorted(map(len, lights)) == [1, 1, 1, 1, 2, 2]
    assert {exposure_s for _, _, exposure_s in asked} == {0.001}


@pytest.mark.parametrize(("between", "chosen"), [(0.909, 0.001), (0.911, 0.002)])
def test_an_exposure_between_those_of_the_grid_must_score_clearly_more(between, chosen):
    lines = [kept_table({0.0: {0.001: 0.90, 0.002: between, 0.004: 0.8}})]
    (row, *_) = recommendations(averages(lines, 0.7, grid_s=(0.001, 0.004)))
    assert row.exposure_s == chosen
    (alike, *_) = recommendations(averages(lines, 0.7))
    assert alike.exposure_s == 0.002


def test_the_middle_of_a_plateau_of_the_grid_is_not_moved_by_one_between():
    values = {0.001: 0.90, 0.0015: 0.892, 0.002: 0.90, 0.003: 0.891, 0.004: 0.90, 0.008: 0.5}
    (row, *_) = recommendations(
        averages([kept_table({0.0: values})], 0.7, grid_s=(0.001, 0.002, 0.004, 0.008))
    )
    assert row.exposure_s == 0.002


@pytest.mark.parametrize(
    ("values", "alike"),
    [
        ((0.80, 0.90, 0.95, 0.93, 0.91), (0.003, 0.004, False, False)),
        ((0.93, 0.94, 0.95, 0.93, 0.93), (0.001, 0.005, True, True)),
        ((0.93, 0.80, 0.95, 0.80, 0.93), (0.003, 0.003, False, False)),  # a worse one between
        ((0.80, 0.925, 0.95, 0.0, 0.0), (0.002, 0.003, False, False)),
    ],
)
def test_what_scores_alike_lies_next_to_the_chosen_exposure(values, alike):
    line = kept_table({0.0: dict(zip((0.001, 0.002, 0.003, 0.004, 0.005), values, strict=True))})
    (row, *_) = recommendations(averages([line], 0.7))
    assert row.exposure_s == 0.003
    assert (row.alike_from_s, row.alike_to_s, row.alike_from_open, row.alike_to_open) == alike


@pytest.mark.parametrize(
    ("grid_s", "is_open"), [((0.001, 0.002, 0.004, 0.008), True), ((0.001, 0.004, 0.008), False)]
)
def test_what_scores_alike_may_go_on_where_the_next_of_the_grid_was_not_tested(grid_s, is_open):
    """2 ms was tested at another light alone; so was it where a window was refined, which says nothing here."""
    here = kept_table({0.0: {0.001: 0.5, 0.004: 0.95, 0.008: 0.8}}, 10.0)
    there = kept_table({0.0: {0.001: 0.5, 0.002: 0.9, 0.004: 0.95, 0.008: 0.8}}, 100.0)
    found = {
        row.conditions["illuminance_lux"]: row
        for row in recommendations(averages([here, there], 0.7, grid_s=grid_s))
    }
    assert (found[10.0].alike_from_s, found[10.0].alike_from_open) == (0.004, is_open)
    assert not found[10.0].alike_to_open
    assert not found[100.0].alike_from_open
