"""What a program's scores stand on: whether lux x seconds is one axis, and what no program is made of."""

from dataclasses import replace

import numpy as np
import pytest
from blurnoise_eval.plan.axes import EXPOSURE, LIGHT
from blurnoise_eval.program.grounds import OneAxis
from blurnoise_eval.program.problem import Problem
from blurnoise_eval.program.scenario import ExposureLimits
from made_planes import made_problem
from made_tables import table

LIGHTS = (10.0, 20.0, 40.0)


def sums_at_rest(of_light, times_s=(0.001, 0.002, 0.004), pictures=12):
    """A table at rest of every exposure under each light: all pictures found to the same share, which ``of_light``
    adds to, and each by a little of its own."""
    lights, times = (each.ravel() for each in np.meshgrid(LIGHTS, times_s, indexing="ij"))
    own = np.random.default_rng(3).normal(0.0, 0.02, (pictures, len(times)))
    made = table((0.5 + np.repeat(of_light, len(times_s)) + own)[..., None], np.ones(len(times)))
    made.conditions[LIGHT.name][:], made.conditions[EXPOSURE.name][:] = lights, times
    return made


def test_pairs_of_equal_lux_x_seconds_show_that_it_is_one_axis():
    """10 lux x 2 and 4 ms are 20 lux x 1 and 2; 20 x 2 and 4 are 40 x 1 and 2; 10 x 4 is 40 x 1."""
    shown = OneAxis.of([sums_at_rest([0.0, 0.0, 0.0])])
    assert shown.pairs == 5
    assert shown.low < 0.0 < shown.high
    assert abs(shown.difference) < 0.03
    assert ": in 5 pairs of equal ones at two lights they differ by 0.0" in shown.text


def test_the_largest_difference_of_all_pairs_and_kinds_of_target_is_said():
    """Brighter less darker, in an interval without 0."""
    shown = OneAxis.of([sums_at_rest([0.0, 0.0, 0.0]), sums_at_rest([0.0, 0.0, -0.2])])
    assert shown.difference == pytest.approx(-0.2, abs=0.03)
    assert shown.low < shown.difference < shown.high < 0
    assert "they differ by 0.2" in shown.text or "they differ by 0.1" in shown.text


def test_a_run_without_such_pairs_says_so():
    """Nearly equal exposures under one light are no pair, nor is what is a third of a stop apart under two."""
    shown = OneAxis.of([sums_at_rest([0.0, 0.0, 0.0], (0.001, 0.00101, 0.0016))])
    assert shown == OneAxis(0)
    assert shown.text.endswith("the run has no equal ones at two lights, which would show it")


def test_few_pictures_have_no_interval():
    shown = OneAxis.of([sums_at_rest([0.0, 0.0, 0.0], pictures=5)])
    assert (shown.low, shown.high) == (None, None)
    assert shown.text.endswith("at most")


def left_out(limits, lights_lux, exposures_s):
    problem = made_problem(limits)
    inputs = replace(problem.inputs, exposures_s=exposures_s)
    return str(Problem(inputs, problem.scenario, limits).nothing_left(lights_lux))


def test_a_tested_light_that_wants_less_than_the_shortest_exposure_is_named_with_both():
    text = left_out(ExposureLimits(), [2.0, 300.0], (0.02, 0.03))
    assert text == (
        "lux: test shorter exposures: at 300 lux the metering wants 4.65 ms, the shortest tested is 20 ms"
    )


def test_a_frame_that_ends_before_the_shortest_exposure_is_named():
    text = left_out(ExposureLimits(frame_rate_hz=100.0), [2.0], (0.02, 0.03))
    assert "at 2 lux the metering, with 100 frames/s, " in text
    assert text.endswith("wants 10 ms, the shortest tested is 20 ms")


def test_lamps_that_want_more_than_the_longest_exposure_are_named_with_both():
    text = left_out(ExposureLimits(mains_hz=50.0), [2.0, 10.0], (0.001, 0.004))
    assert text.startswith("lux: test longer exposures: at 10 lux the metering, with ")
    assert "whole periods of 50 Hz mains" in text
    assert text.endswith("wants 10 ms, the longest tested is 4 ms")


def test_a_limit_of_the_gain_wants_longer_exposures():
    text = left_out(ExposureLimits(gain_max_db=0.0), [2.0], (0.001, 0.03))
    assert text.startswith("lux: test longer exposures: at 2 lux the metering, with ")
    assert "gain up to 0 dB" in text


def test_a_light_that_was_not_tested_is_refused_as_before():
    assert left_out(ExposureLimits(), [5000.0], (0.02, 0.03)).startswith(
        "lux, speeds: at 5000 lux, no exposure"
    )
