"""The cap in each driver's words: parsed, in the driver's unit; and by the drivers' own libraries where installed."""

import ast
import json
import re
import shlex
from types import SimpleNamespace
from unittest.mock import MagicMock

import pytest
from blurnoise_eval.program.drivers import DRIVERS, LANGUAGES, Cap, document_lines
from blurnoise_eval.program.stepping import LibcameraMode

CAP = Cap(0.0021759, shortest_s=20e-6, gain=7.96)


def run(name, **names):
    """The Python words of a driver, run with these names."""
    exec(compile(ast.parse(DRIVERS[name].text(CAP)), name, "exec"), names)


def test_every_text_is_of_its_language_and_has_the_cap():
    for name, driver in DRIVERS.items():
        text = driver.text(CAP)
        assert driver.language in LANGUAGES
        {"python": ast.parse, "json": json.loads, "shell": shlex.split}[driver.language](text)
        assert re.search(r"\b(2175|21)\b", text), name
        assert not re.search(r"\{(us|mode|hundred_us)\}", text)


@pytest.mark.parametrize("us", [1, 33, 2100, 2175.9, 33333.3])
def test_the_cap_is_never_exceeded(us):
    cap = Cap(us / 1e6, shortest_s=20e-6, gain=1.0)
    assert type(cap.us) is int
    assert us - 1 < cap.us <= us
    assert cap.hundred_us == max(1, int(us) // 100)


def test_a_cap_of_nothing_is_refused():
    with pytest.raises(ValueError, match=r"limit_s = 0\.0: must be from 1e-06 to 1000"):
        Cap(0.0, shortest_s=20e-6, gain=1.0)


def test_libcamera_never_takes_more_than_the_cap():
    mode = LibcameraMode.read(json.loads(DRIVERS["libcamera"].text(CAP))["exposure_modes"]["custom"])
    for total_s in (1e-5, 1e-3, 2e-3, 5e-3, 1.0):
        time_s, gain = mode.divided(total_s)
        assert time_s <= CAP.limit_s
        assert gain <= 8.0
    assert mode.divided(5e-3) == pytest.approx((2175e-6, 5e-3 / 2175e-6))


@pytest.mark.parametrize("channels", [False, True])
def test_picamera2_writes_the_mode_into_each_channel(monkeypatch, channels):
    made = [{"exposure_modes": {}}, {"exposure_modes": {}}]
    agc = {"channels": made} if channels else made[0]
    picamera2 = MagicMock()
    picamera2.Picamera2.find_tuning_algo.return_value = agc
    monkeypatch.setitem(__import__("sys").modules, "picamera2", picamera2)
    monkeypatch.setitem(__import__("sys").modules, "libcamera", MagicMock())
    run("picamera2")
    for channel in made if channels else made[:1]:
        assert channel["exposure_modes"]["custom"] == {"shutter": [20, 2175], "gain": [1.0, 8.0]}


def test_v4l2_has_steps_of_100_us():
    words = shlex.split(DRIVERS["v4l2"].text(CAP))
    assert words[-1] == "--set-ctrl=exposure_time_absolute=21"


def test_spinnaker_has_us():
    camera = MagicMock()
    run("spinnaker", camera=camera, PySpin=MagicMock())
    camera.AutoExposureExposureTimeUpperLimit.SetValue.assert_called_once_with(2175)


def test_registers_have_whole_lines():
    assert list(document_lines(CAP, 14.8e-6))[-1] == "# registers: 147 lines of 14.8 us"


def test_depthai_takes_us():
    depthai = pytest.importorskip("depthai")
    control = depthai.CameraControl()
    run("depthai", camera=SimpleNamespace(initialControl=control))
    assert "aeMaxExposureTimeUs: 2175\n" in str(control)


def test_librealsense_has_the_options():
    realsense = pytest.importorskip("pyrealsense2")
    sensor = MagicMock()
    run("realsense", rs=realsense, sensor=sensor)
    sensor.set_option.assert_called_with(realsense.option.auto_exposure_limit, 2175)


def test_pylon_has_us():
    """Basler's emulated camera has no such node, so a stand-in."""
    nodes = ("AutoExposureTimeUpperLimit", "ExposureAuto", "GainAuto")
    camera = SimpleNamespace(**{name: SimpleNamespace() for name in nodes})
    run("pylon", camera=camera)
    assert camera.AutoExposureTimeUpperLimit.Value == 2175
    # Without automatic gain nothing makes up for the time that the cap takes away.
    assert (camera.ExposureAuto.Value, camera.GainAuto.Value) == ("Continuous", "Continuous")


def test_spinnaker_turns_gain_on_as_well():
    camera, spinnaker = MagicMock(), MagicMock()
    run("spinnaker", camera=camera, PySpin=spinnaker)
    camera.AutoExposureExposureTimeUpperLimit.SetValue.assert_called_with(2175)
    camera.GainAuto.SetValue.assert_called_with(spinnaker.GainAuto_Continuous)
