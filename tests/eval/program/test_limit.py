"""One cap of the exposure time: the best of all, with what it loses and saves; and its words."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from blurnoise_eval.program import limit_report
from blurnoise_eval.program.grounds import OneAxis
from blurnoise_eval.program.limit import best_limit, saturated_at, under_cap
from blurnoise_eval.program.optimise import optimise
from blurnoise_eval.program.scenario import ExposureLimits, Metering, half_stops
from made_planes import made_problem

from blurnoise.camera import PRESETS

FAST = {0.0: 0.5, 800.0: 0.5}


def problem_of(speeds=FAST, **limits):
    return made_problem(ExposureLimits(**limits), lights_lux=half_stops(1.0, 5e3), speeds_px_s=speeds)


@pytest.fixture(scope="module")
def limit():
    return best_limit(problem_of())


def test_no_other_cap_is_better(limit):
    problem = limit.problem
    values = [problem.schedule(under_cap(problem, cap)).value for cap in problem.times_s]
    # a decibel of gain has to earn a little, so the best value may be higher by that
    assert max(value for value in values if value is not None) == pytest.approx(
        limit.schedule.value, abs=0.005
    )
    assert limit.from_s <= limit.limit_s <= limit.to_s < limit.longest_s


def test_auto_exposure_takes_what_the_light_asks_for_up_to_the_cap(limit):
    for row, total_s in zip(limit.lights, limit.problem.totals_s, strict=True):
        assert row.exposure_s == pytest.approx(min(total_s, limit.limit_s))
        # the gain makes up for the rest
        assert row.exposure_s * 10 ** (row.gain_db / 20) == pytest.approx(total_s, rel=5e-3)


def test_pictures_darker_than_the_mean_have_gain_left(limit):
    """The run's pictures were metered one by one, up to the camera's gain; the mean asks for less."""
    most_db = limit.problem.inputs.metering.camera.sensor.gain_max_db
    assert max(limit.schedule.gains_db) < most_db - 1
    assert 20 * np.log10(limit_report.cap_of(limit).gain) == pytest.approx(most_db)


def test_pictures_of_unequal_weight_have_no_intervals(monkeypatch):
    """As in the run's report, which counts them as fewer."""
    problem = made_problem()
    at = problem.scenario.lights_lux, [0.005] * len(problem.scenario.lights_lux)
    assert 15 < problem.effective(*at) < 24  # weights of a gamma distribution of shape 3 count as 3/4
    monkeypatch.setattr(type(problem), "effective", lambda *_: 7.9)
    limit = best_limit(problem)
    assert (limit.low, limit.high) == (None, None)
    assert {(each.low, each.high) for each in limit.speeds} == {(None, None)}
    program = optimise(problem)
    assert (program.low, program.high, program.regret_95) == (None, None, None)


def test_the_longest_tested_exposure_is_no_limit_of_the_camera():
    problem = problem_of({0.0: 1.0})
    limit = best_limit(replace(problem, inputs=replace(problem.inputs, exposures_s=(0.0, 0.01))))
    said = limit_report.sentence(limit)
    assert said.startswith("No cap below 10 ms, the longest exposure tested, is better; longer ones may be.")
    assert "# No cap below 10 ms" in "\n".join(limit_report.text_lines(limit))


def test_it_loses_at_rest_and_saves_what_moves(limit):
    rest, fast = limit.speeds
    assert (rest.speed_px_s, fast.speed_px_s, rest.share) == (0.0, 800.0, 0.5)
    assert rest.low < rest.difference < rest.high < 0
    assert 0 < fast.low < fast.difference < fast.high
    both = limit.schedule.value - limit.uncapped.value
    assert 0.5 * rest.difference + 0.5 * fast.difference == pytest.approx(both)


def test_at_rest_no_cap_is_better():
    limit = best_limit(problem_of({0.0: 1.0}))
    assert limit.limit_s == limit.longest_s
    assert limit_report.sentence(limit).startswith("No cap below 33.3 ms, the longest exposure, is better.")
    assert "Against" not in limit_report.cost(limit, None, True)  # beside itself it loses and saves nothing


def test_a_single_light_is_no_range():
    limit = best_limit(made_problem(lights_lux=(50.0,), speeds_px_s=FAST))
    assert " At 50 lux auto exposure then" in limit_report.sentence(limit)


def test_faster_motion_has_a_shorter_cap(limit):
    assert best_limit(problem_of({0.0: 0.1, 800.0: 0.9})).limit_s < limit.limit_s


def test_the_program_is_no_worse(limit):
    assert optimise(limit.problem).schedule.value >= limit.schedule.value - 0.002


def test_lamps_get_whole_periods():
    limit = best_limit(problem_of(mains_hz=50.0))
    assert round(1e3 * limit.limit_s, 6) in (10.0, 20.0, 30.0)


def test_saturated_shares_are_those_of_the_nearest():
    saturated = saturated_at(np.array([1.0, 1.0, 2.0, 4.0]), np.array([0.1, 0.3, np.nan, 0.5]))
    assert saturated(1.1) == pytest.approx(0.2)
    assert saturated(3.0) == 0.5
    assert saturated(2.0) is None  # not known, and half a stop is all that is looked for


def test_words_say_cap_shares_and_gain(limit):
    text = " ".join(" ".join(limit_report.lines(limit, limit.schedule.value + 0.01, True)).split())
    assert text.startswith(f"Cap the exposure time at {1e3 * limit.limit_s:.3g} ms")
    assert (
        "Shares of the speeds: 0 px/s 0.5, 800 px/s 0.5 (equal because none were given; see --speeds)" in text
    )
    gain = f"At 1 lux the gain is then {limit.lights[0].gain_db:.1f} dB"
    assert f"{gain} for a picture of mean brightness, and more for darker ones." in text
    assert "A program, with times for each light, reaches 0.010 more." in text
    assert f"setAutoExposureLimit({int(1e6 * limit.limit_s)})" in text


def test_the_screen_has_the_cap_of_each_driver(limit):
    lines = [*limit_report.lines(limit, None, True)]
    cap = limit_report.cap_of(limit)
    for driver in ("librealsense", "DepthAI", "Spinnaker", "pylon", "V4L2"):
        (line,) = (each for each in lines if re.match(rf"{driver}( \(\w+\))?: ", each))
        assert re.search(rf"\b({cap.us}|{cap.hundred_us})\b", line), line


def test_too_few_pictures_tell_no_caps_apart(limit):
    few = replace(limit, low=None, high=None)
    assert (
        limit_report.sentence(few)
        .split(". ")[0]
        .endswith("; 24 pictures of unequal weight are too few to tell caps apart")
    )
    wide = replace(limit, from_s=0.001, to_s=0.03)
    assert "; the pictures cannot tell caps from 1 to 30 ms apart." in limit_report.sentence(wide)


def test_a_program_that_is_not_better_is_said(limit):
    assert "A program, with times for each light, is not better." in limit_report.cost(limit, 0.1, False)


def test_files_have_the_cap_in_whole_us(limit, tmp_path):
    limit_report.write(limit, None, tmp_path, "run", [])
    written = json.loads((tmp_path / "limit.json").read_text())
    assert written["limit_us"] == int(1e6 * limit.limit_s)
    assert f"# Cap of the exposure time: {written['limit_us']} us" in (tmp_path / "limit.txt").read_text()


def test_the_document_has_what_shows_that_lux_x_seconds_is_one_axis(limit):
    shown = OneAxis(3, 0.01, -0.02, 0.04)
    problem = replace(limit.problem, inputs=replace(limit.problem.inputs, one_axis=shown))
    written = limit_report.document(replace(limit, problem=problem), None, "run")["one_axis"]
    assert written == {"pairs": 3, "difference": 0.01, "low": -0.02, "high": 0.04}


def with_camera(limit, name, **limits):
    inputs = replace(limit.problem.inputs, metering=Metering(PRESETS[name], 0.2))
    return replace(limit, problem=replace(limit.problem, inputs=inputs, limits=ExposureLimits(**limits)))


def test_registers_have_a_line_for_each_light(limit):
    text = [*limit_report.text_lines(with_camera(limit, "imx219"))]
    heads = next(at for at, line in enumerate(text) if line.startswith("# light, lux"))
    lights = text[heads + 2 :]
    assert len(lights) == len(limit.lights)
    row, gain = limit.lights[-1], 10 ** (limit.lights[-1].gain_db / 20)
    _, _, _, lines, _, _, code, _ = lights[-1].split()
    assert (int(lines), int(code)) == (int(row.exposure_s / 1.9144e-5), int(256 - 256 / gain + 1e-9))
    assert not any(line.startswith("# light, lux") for line in limit_report.text_lines(limit))


def test_no_file_is_written_without_what_drivers_reach_and_daylight(limit):
    text = " ".join(limit_report.text_lines(with_camera(limit, "imx250", least_exposure_s=1e-3)))
    text = text.replace("# ", "")
    assert "Reached: " in text.partition("V4L2 (uvcvideo) Linux")[2].partition("v4l2-ctl")[0]
    assert "stops too bright at the shortest exposure, 1 ms, with every driver." in text
