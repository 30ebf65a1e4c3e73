"""The cap in each driver's words: parsed, in the driver's unit; and by the drivers' own libraries where installed."""

import ast
import json
import re
import shlex
from dataclasses import replace
from types import SimpleNamespace
from unittest.mock import MagicMock

import pytest
from blurnoise_eval.program.drivers import DRIVERS, Cap, document_lines
from blurnoise_eval.program.stepping import Division

CAP = Cap(0.0021759, shortest_s=20e-6, gain=7.96)


def run(name, **names):
    """The Python words of a driver, run with these names."""
    exec(compile(ast.parse(DRIVERS[name].text(CAP)), name, "exec"), names)


def test_every_text_is_of_its_language_and_has_the_cap():
    for name, driver in DRIVERS.items():
        text = driver.text(CAP)
        {"libcamera": json.loads, "v4l2": shlex.split}.get(name, ast.parse)(text)  # all others: Python
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
    mode = Division.read(json.loads(DRIVERS["libcamera"].text(CAP))["exposure_modes"]["custom"])
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


def test_lines_fit_a_terminal():
    """Words stay whole: a line that is copied is not broken."""
    for line in document_lines(CAP, {"v4l2": "6.3 stops too bright at 20000 lux"}):
        assert len(line) < 80, line


@pytest.mark.parametrize("mains_hz", [0, 50, 60])
def test_depthai_takes_us(mains_hz):
    """Version 3.12.0. Its message has no field for the mode; 50 Hz is its default."""
    depthai = pytest.importorskip("depthai")
    control = depthai.CameraControl()
    words = DRIVERS["depthai"].text(replace(CAP, mains_hz=mains_hz))
    made = {"depthai": depthai, "camera": SimpleNamespace(initialControl=control)}
    exec(words, made)
    assert "aeMaxExposureTimeUs: 2175\n" in str(control)
    modes = depthai.CameraControl.AntiBandingMode
    assert made["banding"] == {0: modes.OFF, 50: modes.MAINS_50_HZ, 60: modes.MAINS_60_HZ}[mains_hz]


def test_picamera2_avoids_flicker_where_it_was_asked_to():
    words = DRIVERS["picamera2"].text(replace(CAP, mains_hz=60.0))
    assert words.endswith('{"AeFlickerMode": manual, "AeFlickerPeriod": 8333})')
    assert "AeFlicker" not in DRIVERS["picamera2"].text(CAP)


def test_librealsense_has_the_options():
    realsense = pytest.importorskip("pyrealsense2")
    sensor = MagicMock()
    run("realsense", rs=realsense, sensor=sensor)
    sensor.set_option.assert_called_with(realsense.option.auto_exposure_limit, 2175)


def test_pylon_has_us():
    """Basler's emulated camera has no such node, so a stand-in."""
    nodes = ("AutoExposureTimeUpperLimit", "ExposureAuto", "GainAuto", "AutoFunctionProfile")
    camera = SimpleNamespace(**{name: SimpleNamespace() for name in nodes})
    run("pylon", camera=camera)
    assert camera.AutoExposureTimeUpperLimit.Value == 2175
    # Without automatic gain nothing makes up for the time that the cap takes away.
    assert (camera.ExposureAuto.Value, camera.GainAuto.Value) == ("Continuous", "Continuous")
    assert camera.AutoFunctionProfile.Value == "MinimizeGain"


def test_spinnaker_turns_gain_on_as_well():
    camera, spinnaker = MagicMock(), MagicMock()
    run("spinnaker", camera=camera, PySpin=spinnaker)
    camera.AutoExposureExposureTimeUpperLimit.SetValue.assert_called_with(2175)
    camera.GainAuto.SetValue.assert_called_with(spinnaker.GainAuto_Continuous)
    priority = spinnaker.AutoExposureControlPriority_Gain
    camera.AutoExposureControlPriority.SetValue.assert_called_with(priority)


_ENUMERATION = """<Enumeration Name="{name}">
  <EnumEntry Name="Other"><Value>0</Value></EnumEntry><EnumEntry Name="{entry}"><Value>1</Value></EnumEntry>
  <Value>0</Value></Enumeration>"""
_FLOAT = '<Float Name="{name}"><Value>15000</Value><Min>20</Min><Max>1000000</Max><Unit>us</Unit></Float>'
_ID = "00000000-0000-0000-0000-000000000000"
_SCHEMA = """<RegisterDescription ModelName="made" VendorName="made" StandardNameSpace="None" SchemaMajorVersion="1"
  SchemaMinorVersion="1" SchemaSubMinorVersion="0" MajorVersion="1" MinorVersion="0" SubMinorVersion="0" ToolTip=""
  ProductGuid="{id}" VersionGuid="{id}" xmlns="http://www.genicam.org/GenApi/Version_1_1">{nodes}</RegisterDescription>"""


class Feature:
    """A node of the library, by the methods of PySpin and pypylon."""

    def __init__(self, node):
        self.node = node

    def SetValue(self, value):
        self.node.value = value

    Value = property(None, SetValue)


@pytest.mark.parametrize(
    ("driver", "limit", "entries"),
    [
        ("spinnaker", "AutoExposureExposureTimeUpperLimit", {"AutoExposureControlPriority": "Gain"}),
        ("pylon", "AutoExposureTimeUpperLimit", {"AutoFunctionProfile": "MinimizeGain"}),
    ],
)
def test_genicam_takes_the_words(driver, limit, entries):
    """genicam 1.6.0 of harvesters 1.4.3: a node map refuses names, entries and values that it does not have.

    No public description of a camera has these nodes (aravis' and pypylon's were looked at), so one is made of their
    documented names.
    """
    genapi = pytest.importorskip("genicam.genapi")
    entries = {"ExposureAuto": "Continuous", "GainAuto": "Continuous", **entries}
    made = [_ENUMERATION.format(name=name, entry=entry) for name, entry in entries.items()]
    nodes = genapi.NodeMap()
    nodes.load_xml_from_string(_SCHEMA.format(id=_ID, nodes="".join([*made, _FLOAT.format(name=limit)])))

    class Camera:
        def __getattr__(self, name):
            return Feature(getattr(nodes, name))

    class Enums:  # PySpin.GainAuto_Continuous
        def __getattr__(self, name):
            return name.rpartition("_")[2]

    run(driver, camera=Camera(), PySpin=Enums())
    assert {name: getattr(nodes, name).value for name in entries} == entries
    assert getattr(nodes, limit).value == 2175
