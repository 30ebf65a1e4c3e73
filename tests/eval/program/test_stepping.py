"""Drivers' division of an exposure over stages, and what they reach beside what was promised."""

import math

import pytest
from blurnoise_eval.program.drivers import DRIVERS, Cap
from blurnoise_eval.program.scenario import ExposureLimits, half_stops
from blurnoise_eval.program.stepping import Division, apart, beside_promised, daylight, reached
from made_planes import METERING, made_problem

MODE = {"shutter": [100, 10000, 30000], "gain": [1.0, 2.0, 8.0]}


@pytest.mark.parametrize(
    ("total_ms", "time_ms", "gain"),
    [
        (0.01, 0.1, 1.0),  # never below the first stage
        (5.0, 5.0, 1.0),  # the time rises first
        (15.0, 10.0, 1.5),  # then the gain
        (50.0, 25.0, 2.0),
        (120.0, 30.0, 4.0),
        (1e3, 30.0, 8.0),  # never above the last
    ],
)
def test_it_starts_at_the_first_stage_and_goes_up(total_ms, time_ms, gain):
    reached = Division.read(MODE).divided(total_ms / 1e3)
    assert reached == pytest.approx((time_ms / 1e3, gain))


@pytest.mark.parametrize(("total_ms", "time_ms"), [(5.0, 5.0), (10.0, 10.0), (50.0, 20.0), (59.0, 20.0)])
def test_periods_are_cut_only_above_one(total_ms, time_ms):
    time_s, gain = Division.read(MODE, mains_hz=50.0).divided(total_ms / 1e3)
    assert (1e3 * time_s, 1e3 * time_s * gain) == pytest.approx((time_ms, total_ms))


@pytest.mark.parametrize("mode", [((20,), (1.0,)), ((20, 30), (1.0,))])
def test_what_libcamera_refuses(mode):
    with pytest.raises(ValueError, match=r"exposure mode: . shutters and 1 gains: must be as many of both"):
        Division(*mode)


def test_gain_stays_within_that_of_the_sensor():
    division = Division.read(MODE, gain_limits=(1.25, 4.0))
    assert division.divided(1e-5) == (1e-4, 1.25)
    assert division.divided(10.0) == (0.03, 4.0)


def rows_of(name, cap_ms=2.1, darkest_lux=50.0, **limits):
    """What a driver reaches with the words of a cap, which names the most gain that it needs."""
    problem = made_problem(ExposureLimits(**limits), lights_lux=half_stops(darkest_lux, 300.0))

    def promised(total_s):
        return problem.limits.settled(min(total_s, cap_ms / 1e3))

    gain_db = METERING.gain_db(darkest_lux, promised(problem.totals_s[0]))
    cap = Cap(cap_ms / 1e3, 20e-6, 10 ** (gain_db / 20), problem.limits.mains_hz, sensor_gains=(1.0, 3.5))
    return reached(problem, DRIVERS[name].division(cap), promised)


@pytest.mark.parametrize("name", ["picamera2", "libcamera", "realsense", "depthai", "spinnaker", "pylon"])
def test_a_cap_is_reached_as_promised(name):
    assert apart(rows_of(name)) == ""


def test_a_fixed_time_is_too_bright_in_daylight():
    stops = math.log2(2.1e-3 / METERING.total_s(20e3))
    assert apart(rows_of("v4l2")) == f"{stops:.1f} stops too bright at 20000 lux"


@pytest.mark.parametrize(("name", "most"), [("realsense", 15.5), ("depthai", 16.0), ("libcamera", 14.0)])
def test_gain_that_ends_leaves_the_dark_too_dark(name, most):
    """At 5 lux and 0.5 ms the camera has 48 dB to give."""
    dark = rows_of(name, cap_ms=0.5, darkest_lux=5.0)[0]
    assert dark.gain == most
    promised_db = METERING.gain_db(5.0, 0.5e-3)
    assert dark.stops == pytest.approx(math.log2(most) - promised_db / (20 * math.log10(2)))


def test_lamps_flicker_with_drivers_that_do_not_avoid_it():
    """DepthAI keeps whole periods when told; librealsense takes what the light asks for."""
    assert apart(rows_of("depthai", cap_ms=20.0, mains_hz=50.0)) == ""
    assert " ms in place of 10 ms at " in apart(rows_of("realsense", cap_ms=20.0, mains_hz=50.0))
    # also where its gain ends in the dark, which is further from what was promised
    said = apart(rows_of("realsense", cap_ms=20.0, darkest_lux=0.1, mains_hz=50.0))
    assert " stops too dark at 0.1 lux" in said
    assert " ms in place of 10 ms at " in said


def test_drivers_that_reach_the_same_are_named_together():
    said = beside_promised({name: rows_of(name) for name in ("pylon", "spinnaker", "v4l2")})
    assert said.startswith(
        "Stepped through light by light, up to daylight: pylon, spinnaker as promised within 0.0"
    )
    assert "; v4l2 " in said


def test_daylight_that_saturates_is_said():
    """1 ms: 20 000 lux are log2(20 000 / light of 1 ms) stops too bright."""
    stops = math.log2(20e3 * 1e-3 / METERING.total_s(1.0))
    said = daylight(made_problem(), 1e-3, "1 ms")
    assert said.startswith(f"Daylight saturates: 20000 lux are {stops:.1f} stops too bright at 1 ms. ")
    assert daylight(made_problem(), 20e-6, "0.02 ms") == ""
