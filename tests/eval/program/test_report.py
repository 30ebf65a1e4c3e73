"""Exports, read back; libcamera's mode driven by a small model of its metering, from starlight to the sun."""

import json
import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from blurnoise_eval.program import report
from blurnoise_eval.program.optimise import EARLY_GAIN_DB, Stages, optimise
from blurnoise_eval.program.scenario import ExposureLimits, Metering
from made_planes import METERING, made_problem

from blurnoise.camera import PRESETS

LIMITS = ExposureLimits()
TARGET = 0.18
FAST = {0.0: 0.1, 1500.0: 0.9}
PIXELS = np.random.default_rng(2).gamma(
    1.2, 1 / 1.2, 4000
)  # linear light, mean 1, long tailed as pictures are


def mean_of(light_lux, total_s):
    return float(np.minimum(PIXELS * TARGET * total_s / METERING.total_s(light_lux), 1.0).mean())


class Libcamera:
    """Its metering of a scene at rest: gain to the target, damped, divided over the mode's stages."""

    def __init__(self, mode, least_s, period_s=0.0):
        assert len(mode["shutter"]) == len(mode["gain"]) >= 2
        self.times = [max(1e-6 * time, least_s) for time in mode["shutter"]]  # limitShutter
        self.gains, self.period_s = mode["gain"], period_s

    def settled(self, light_lux):
        """Time and gain after 80 frames."""
        time_s, gain, wanted = 1e-3, 1.0, 0.0  # its default start
        for frame in range(80):
            more = 1.0
            for _ in range(8):
                step = min(10.0, TARGET / (mean_of(light_lux, time_s * gain * more) + 0.001))
                more *= step
                if step < 1.01:
                    break
            target = min(time_s * gain * more, self.times[-1] * self.gains[-1])
            speed = 1.0 if frame <= 10 else 0.2
            wanted = speed * target + (1 - speed) * wanted
            time_s, gain = self.divided(wanted)
        return time_s, gain

    def divided(self, total_s):
        """With flicker avoidance, which cuts a time to whole periods, last."""
        time_s, gain = self.of_stages(total_s)
        periods = int(time_s / self.period_s + 1e-9) if self.period_s else 0
        if periods:
            gain = min(gain * time_s / (periods * self.period_s), self.gains[-1])
            time_s = periods * self.period_s
        return time_s, gain

    def of_stages(self, total_s):
        time_s, gain = self.times[0], self.gains[0]
        if time_s * gain < total_s:
            for stage in range(1, len(self.gains)):
                if self.times[stage] * gain >= total_s:
                    return total_s / gain, gain
                time_s = self.times[stage]
                if self.gains[stage] * time_s >= total_s:
                    return time_s, total_s / time_s
                gain = self.gains[stage]
        return time_s, gain


@pytest.fixture(scope="module", params=[None, FAST], ids=["slow", "fast"])
def program(request):
    more = {} if request.param is None else {"speeds_px_s": request.param}
    return optimise(made_problem(LIMITS, **more))


@pytest.fixture
def folder(program, tmp_path):
    report.write(program, tmp_path, "run")
    return tmp_path


def mode_of(folder):
    found = json.loads((folder / "libcamera.json").read_text())["rpi.agc"]["exposure_modes"]
    return found["custom"]


def lights(program):
    """From the darkest that the stages meet to the brightest, a third of a stop apart."""
    unity, stages = METERING.total_s(1.0), program.stages
    low, high = unity / (stages.times_s[-1] * stages.gains[-1]), unity / stages.times_s[0]
    yield from np.geomspace(low, high, math.ceil(3 * math.log2(high / low)) + 1).tolist()


def test_libcamera_meters_from_dark_to_daylight(program, folder):
    driver = Libcamera(mode_of(folder), LIMITS.least_exposure_s)
    for light in lights(program):
        time_s, gain = driver.settled(light)
        assert mean_of(light, time_s * gain) == pytest.approx(TARGET, rel=0.03), light
        taken = program.stages.divided(time_s * gain)
        assert (time_s, gain) == pytest.approx(taken, rel=2e-3, abs=1e-6), light


def test_stages_differ_and_gain_waits_for_time(folder):
    mode = mode_of(folder)
    stages = list(zip(mode["shutter"], mode["gain"], strict=True))
    assert all(before != after for before, after in pairwise(stages))
    assert stages[0] == (20, 1.0)
    longest = mode["shutter"][-1]
    assert all(20 * math.log10(gain) <= EARLY_GAIN_DB + 1e-3 for time, gain in stages if time < longest)


@pytest.mark.parametrize(
    "how", [{"mains_hz": 50.0}, {"mains_hz": 60.0, "row_time_s": 30e-6}, {"led": True}, {}], ids=str
)
def test_daylight_is_as_bright_as_a_room(tmp_path, how):
    """With 1/100 s as the first shutter 20 000 lux were 6.3 stops too bright; in lamps' light periods are whole."""
    limits = ExposureLimits(**how)
    program = optimise(made_problem(limits))
    report.write(program, tmp_path, "run")
    period_s = 1 / (2 * limits.mains_hz) if limits.mains_hz else 0.0
    driver = Libcamera(mode_of(tmp_path), 1e-6, period_s)
    assert driver.times[0] == pytest.approx(max(20e-6, limits.row_time_s), rel=1e-3)
    for light in (20.0, 300.0, 2e3, 20e3):
        time_s, gain = driver.settled(light)
        assert mean_of(light, time_s * gain) == pytest.approx(TARGET, rel=0.03), light
        if period_s and light < 0.9 * METERING.total_s(1.0) / period_s:
            # files have whole us
            assert time_s / period_s == pytest.approx(round(time_s / period_s), abs=1e-4), light


def test_what_is_too_bright_is_named():
    """A period of 10 ms; LEDs need 11.1 ms."""
    unity = METERING.total_s(1.0)
    mains, led = (
        report.brightest(optimise(made_problem(ExposureLimits(**how))))
        for how in ({"mains_hz": 50.0}, {"led": True})
    )
    assert (
        f"Above {100 * unity:.3g} lux 10 ms are too long: exposures are shorter, and lamps flicker" in mains
    )
    assert f"Above {90 * unity:.3g} lux 11.1 ms are too long" in led
    for text in (mains, led):
        assert text.endswith(
            f"Above {float(f'{unity / 20e-6:.3g}'):.8g} lux pictures are too bright at the first stage, 0.02 ms."
        )


def test_what_libcamera_reaches_is_printed_beside_what_was_promised(program):
    lines = [*report.lines(program)]
    promised, reached = (
        line.split()[-2] for line in lines if line.startswith(("this program", "libcamera with "))
    )
    assert float(reached) == pytest.approx(float(promised), abs=0.001)
    assert "daylight: libcamera with libcamera.json as promised within 0.0" in " ".join(lines)


def with_imx219(program):
    inputs = replace(program.problem.inputs, metering=Metering(PRESETS["imx219"], 0.2))
    return replace(program, problem=replace(program.problem, inputs=inputs))


@pytest.mark.parametrize("most_db", [120.0, 30.0])
def test_pictures_darker_than_the_mean_have_gain_left(most_db):
    """The run's pictures were metered one by one, up to the camera's gain; the mean asks for less."""
    program = optimise(made_problem(ExposureLimits(gain_max_db=most_db), speeds_px_s={0.0: 1.0}))
    most_db = min(most_db, METERING.camera.sensor.gain_max_db)
    assert max(program.schedule.gains_db) < most_db - 3
    last = report.libcamera_mode(program.stages)["gain"][-1]
    assert 20 * math.log10(last) == pytest.approx(most_db, abs=0.01)


def test_gain_that_libcamera_does_not_have_is_said(program):
    """imx219 has 10.67 of its own, times 4 digitally."""
    dark = replace(with_imx219(program), stages=Stages((20e-6, 1e-3), (1.0, 251.0)))
    assert "stops too dark at 2 lux (gain 32.6 dB)" in report.beside_libcamera(dark)


def test_rows_have_registers_where_they_are_known(program):
    for row in report.rows(with_imx219(program)):
        assert row.lines == max(1, int(row.exposure_s / 1.9144e-5 + 1e-9))
        assert row.gain_code == min(232, int(256 - 256 / 10 ** (row.gain_db / 20) + 1e-6))
    assert {(row.lines, row.gain_code) for row in report.rows(program)} == {(None, None)}


def test_daylight_that_saturates_is_said_and_is_in_the_file(tmp_path):
    """First stage 1 ms: pictures are too bright above the light of 1 ms."""
    limits = ExposureLimits(least_exposure_s=1e-3)
    program = optimise(made_problem(limits))
    report.write(program, tmp_path, "run")
    from_lux = METERING.total_s(1.0) / 1e-3
    written = json.loads((tmp_path / "libcamera.json").read_text())
    assert written["too_bright_above_lux"] == pytest.approx(from_lux)
    said = " ".join(" ".join(report.lines(program)).split())
    assert "stops too bright at the first stage, 1 ms, also in libcamera.json." in said


def test_limits_that_leave_one_program_are_said(program):
    """'No other program is better by more than 0.000' was all that 50 Hz left."""
    said = report.sentence(replace(program, regret_95=0.0))
    assert said.endswith("No other program within these limits is better (95 %, 24 pictures).")
