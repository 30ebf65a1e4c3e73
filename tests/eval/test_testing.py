"""Assertions about runs: which rows count, what fails, and what is said of it."""

from types import SimpleNamespace

import pytest
from blurnoise_eval import assert_works


def run(*verdicts, low=0.3):
    """A run of one model with these verdicts at 5, 20, 80 lux ..."""
    rows = [
        {
            "model": "m", "group": "all", "illuminance_lux": 5.0 * 4**place, "velocity_x_px_s": 300.0,
            "velocity_y_px_s": 0.0, "verdict": verdict, "best_s": 0.002, "best_score": 0.41, "best_score_low": low,
            "best_score_high": 0.5, "criterion": "kept share 0.8",
        }
        for place, verdict in enumerate(verdicts)
    ]  # fmt: skip
    return SimpleNamespace(answers=rows)


FAILS = "no exposure works"


def test_a_run_that_works_passes():
    assert_works(run("works", "works"), sure=True)


def test_a_light_without_an_exposure_that_works_fails_with_its_score():
    with pytest.raises(AssertionError) as raised:
        assert_works(run("works", FAILS, "works"))
    assert str(raised.value) == (
        "kept share 0.8 is not reached in 1 of 3:\n"
        "  m, all, illuminance_lux 20, velocity_x_px_s 300: no exposure works, at best 0.41 (0.30 to 0.50) with 2 ms"
    )


def test_too_few_pictures_for_an_interval_print_none():
    with pytest.raises(AssertionError, match=r"at best 0.41 with 2 ms$"):
        assert_works(run(FAILS, low=None))


def test_pictures_that_are_too_few_to_ever_tell_fail():
    with pytest.raises(AssertionError, match=r"m, all, illuminance_lux 5.*: cannot tell, at best 0\.41"):
        assert_works(run("cannot tell", low=None))


@pytest.mark.parametrize("sure", [False, True])
def test_what_the_pictures_cannot_tell_fails_where_it_must_be_sure(sure):
    open_run = run("works", "cannot tell")
    if not sure:
        assert_works(open_run)
        return
    with pytest.raises(AssertionError, match="not reached in 1 of 2"):
        assert_works(open_run, sure=True)


def test_conditions_select_the_rows_that_count():
    assert_works(run("works", FAILS, "works"), illuminance_lux=[5, 80], model="m")


def test_a_list_of_lights_fails_if_one_of_them_does():
    with pytest.raises(AssertionError, match="1 of 2"):
        assert_works(run("works", FAILS, "works"), illuminance_lux=[5, 20])


@pytest.mark.parametrize(
    ("where", "text"),
    [
        ({"illuminance_lux": 7}, r"illuminance_lux = 7: the run has 20.0, 5.0"),
        ({"illuminance_lux": [5, 7]}, r"illuminance_lux = 7: the run has 20.0, 5.0"),
        ({"lux": 5}, "column"),
    ],
)
def test_what_a_run_does_not_have_is_an_error_and_no_pass(where, text):
    with pytest.raises(ValueError, match=text):
        assert_works(run("works", "works"), **where)
