"""Lines and codes of sensors, against the formulas of libcamera's helpers, inverted as they are there."""

import math

import pytest
from blurnoise_eval.program.registers import gain_limits, setting

from blurnoise.camera import PRESETS

CODES = {
    "imx219": lambda gain: 256 - 256 / gain,
    "imx296": lambda gain: 200 * math.log10(gain),
    "imx477": lambda gain: 1024 - 1024 / gain,
    "imx500": lambda gain: 1024 - 1024 / gain,
    "imx708": lambda gain: 1024 - 1024 / gain,
    "ov5647": lambda gain: 16 * gain,
}


@pytest.mark.parametrize("name", CODES)
@pytest.mark.parametrize("gain", [1.5, 3.1, 10.0])
def test_codes_are_those_of_libcamera(name, gain):
    found = setting(PRESETS[name], 0.01, gain)
    assert found.code == int(CODES[name](gain) + 1e-9)
    assert gain / 1.05 < found.gain <= gain * (1 + 1e-9)


@pytest.mark.parametrize(
    ("name", "least", "most"),
    [("imx219", 0, 232), ("imx296", 0, 480), ("imx477", 0, 978), ("imx708", 112, 960), ("ov5647", 16, 1023)],
)
def test_codes_end(name, least, most):
    assert [setting(PRESETS[name], 0.01, gain).code for gain in (1.0, 1e4)] == [least, most]


def test_a_gain_is_reached_whatever_its_last_digit():
    for code in range(979):
        assert setting(PRESETS["imx477"], 0.01, 1024 / (1024 - code) * (1 - 1e-12)).code == code


def test_lines_are_whole_and_no_longer_than_the_exposure():
    found = setting(PRESETS["imx477"], 0.0021, 1.0)
    assert (found.lines, found.exposure_s) == (63, pytest.approx(63 * 3.2895e-05))
    assert setting(PRESETS["imx477"], 0.0021, 1.0, row_time_s=1e-5).lines == 210
    assert setting(PRESETS["imx477"], 1e-6, 1.0).lines == 1


def test_imx296_adds_14_us_to_its_lines():
    found = setting(PRESETS["imx296"], 0.001, 1.0)
    assert found.exposure_s == pytest.approx(found.lines * 550 / 37.125e6 + 14.26e-6)
    assert found.lines == 66


def test_sensors_without_known_registers():
    assert setting(PRESETS["imx250"], 0.001, 2.0) == (None, 0.001, None, 2.0)
    assert gain_limits(PRESETS["imx250"])[1] == pytest.approx(
        10 ** (PRESETS["imx250"].sensor.analogue_gain_max_db / 20)
    )
