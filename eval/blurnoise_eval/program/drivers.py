"""A cap of the exposure time in each driver's own words.

Every driver that can cap its auto exposure takes whole microseconds, or 100 us; the cap is rounded down, so that it
is never exceeded. ``DRIVERS`` has everything about a driver: a new one is one entry more.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

from blurnoise_eval.program.stepping import Division, period_us
from blurnoise_eval.system.terminal import paragraph


@dataclass(frozen=True)
class Driver:
    """A driver's words, in Python, JSON or a shell's language. version: that the words were written for.

    words: with {us}, {hundred_us} and {mode} in the place of the cap in whole us, in whole 100 us, and of libcamera's
    exposure mode; {flicker} and {banding} in that of libcamera's and DepthAI's flicker avoidance. about: what to know
    about them. source: where names, units and the metering are documented. The time rises to the cap before the gain,
    to most_gain, a factor, or to most_digital times what the camera's sensor has. avoids_flicker: whether times can
    be cut to whole periods of lamps. fixes_time: whether the words fix the time, whatever the light.
    """

    name: str
    version: str
    words: str
    about: str
    source: str
    most_gain: float = math.inf
    most_digital: float = math.inf
    avoids_flicker: bool = False
    fixes_time: bool = False

    def text(self, cap: Cap) -> str:
        """The words with this cap.

        >>> DRIVERS["realsense"].text(Cap(0.0021, shortest_s=20e-6, gain=8.0))
        'sensor.set_option(rs.option.auto_exposure_limit, 2100)'
        """
        # not str.format: the words of JSON and Python have braces of their own
        filled = self.words.replace("{us}", str(cap.us)).replace("{hundred_us}", str(cap.hundred_us))
        filled = filled.replace("{mode}", json.dumps(cap.mode))
        avoided = _FLICKER.replace("{period_us}", f"{period_us(cap.mains_hz):.0f}") if cap.mains_hz else ""
        banding = f"MAINS_{cap.mains_hz:.0f}_HZ" if cap.mains_hz else "OFF"
        return filled.replace("{flicker}", avoided).replace("{banding}", banding)

    def line(self, cap: Cap) -> str:
        """The one line of the words that holds the cap, in microseconds or hundreds of them.

        >>> DRIVERS["spinnaker"].line(Cap(0.0021, shortest_s=20e-6, gain=8.0))
        'camera.AutoExposureExposureTimeUpperLimit.SetValue(2100)'
        """
        own = next(line for line in self.words.splitlines() if "us}" in line)
        return replace(self, words=own).text(cap)

    def division(self, cap: Cap) -> Division:
        """How the camera's metering divides time x gain up once it has these words.

        >>> DRIVERS["v4l2"].division(Cap(0.0021, shortest_s=20e-6, gain=8.0))
        Division(shutter_us=(2100, 2100), gains=(1.0, 8.0), period_us=0.0)
        """
        mode: dict[str, list[float]] = dict(cap.mode)
        if self.fixes_time:
            mode["shutter"] = [100 * cap.hundred_us] * 2
        limits = 1.0, self.most_gain
        if self.most_digital < math.inf:
            limits = cap.sensor_gains[0], self.most_digital * cap.sensor_gains[1]
        return Division.read(mode, cap.mains_hz if self.avoids_flicker else 0.0, limits)


@dataclass(frozen=True)
class Cap:
    """A cap, s, with the shortest exposure of the sensor, s, and the most gain, a factor.

    mains_hz: of the lamps whose flicker is to be avoided, 0 for none. sensor_gains: the least and the most gain of
    the sensor itself.
    Raises ``ValueError`` for a cap below 1 us.

    >>> Cap(0.00219, shortest_s=20e-6, gain=7.96).mode
    {'shutter': [20, 2190], 'gain': [1.0, 8.0]}
    """

    limit_s: float
    shortest_s: float
    gain: float
    mains_hz: float = 0.0
    sensor_gains: tuple[float, float] = (1.0, math.inf)

    def __post_init__(self) -> None:
        if not 1e-6 <= self.limit_s <= 1000.0:
            raise ValueError(f"limit_s = {self.limit_s!r}: must be from 1e-06 to 1000")

    @property
    def us(self) -> int:
        """Whole microseconds, as ``int``: DepthAI takes a float for seconds."""
        return math.floor(1e6 * self.limit_s + 1e-6)

    @property
    def hundred_us(self) -> int:
        """Whole steps of 100 us, at least one."""
        return max(1, self.us // 100)

    @property
    def mode(self) -> dict[str, list[float]]:
        """libcamera's exposure mode: the time rises up to the cap, then the gain."""
        first_us = max(1, min(round(1e6 * self.shortest_s), self.us))
        return {
            "shutter": [first_us, self.us],
            "gain": [1.0, math.ceil(10 * max(self.gain, 1.0) - 1e-6) / 10],
        }


_PICAMERA2 = """\
from libcamera import controls
from picamera2 import Picamera2
tuning = Picamera2.load_tuning_file("SENSOR.json")
agc = Picamera2.find_tuning_algo(tuning, "rpi.agc")
mode = {mode}
for channel in agc.get("channels", [agc]):
    channel["exposure_modes"]["custom"] = mode
camera = Picamera2(tuning=tuning)
camera.set_controls({"AeExposureMode": controls.AeExposureModeEnum.Custom}){flicker}"""
_FLICKER = """
manual = controls.AeFlickerModeEnum.Manual
camera.set_controls({"AeFlickerMode": manual, "AeFlickerPeriod": {period_us}})"""

DRIVERS = {
    "picamera2": Driver(
        "picamera2", "0.3.38", _PICAMERA2,
        "no control caps the auto exposure; an exposure mode of the tuning file does",
        "raspberrypi/picamera2, picamera2.py, and its thread 634",
        most_digital=4.0, avoids_flicker=True,
    ),
    "libcamera": Driver(
        "libcamera", "0.7.1 of Raspberry Pi", '{"exposure_modes": {"custom": {mode}}}',
        "in rpi.agc, in each channel, of a copy of the sensor's tuning file; --exposure custom, and --flicker-period "
        "10000us against lamps at 50 Hz, 8333us at 60 Hz; more than 4 times the sensor's own gain takes a "
        "max_digital_gain beside it",
        "raspberrypi/libcamera, src/ipa/rpi/controller/rpi/agc_channel.cpp, AgcExposureMode::read, limitGain",
        most_digital=4.0, avoids_flicker=True,
    ),
    "v4l2": Driver(
        "V4L2 (uvcvideo)", "Linux 6",
        "v4l2-ctl --set-ctrl=auto_exposure=1\nv4l2-ctl --set-ctrl=exposure_time_absolute={hundred_us}",
        "UVC has no cap for auto exposure: this fixes the time, in 100 us; in more light a loop of your own has to "
        "shorten it. auto_exposure=3 with exposure_dynamic_framerate=0 caps the time at that of a frame",
        "V4L2_CID_EXPOSURE_ABSOLUTE, V4L2_CID_EXPOSURE_AUTO, Linux kernel, ext-ctrls-camera.rst",
        fixes_time=True,
    ),
    "realsense": Driver(
        "librealsense", "2.59.1",
        "sensor.set_option(rs.option.auto_exposure_limit, {us})",
        "us; of the stereo module, where supports() says so; before streaming starts; turns the limit on itself",
        "IntelRealSense/librealsense, include/librealsense2/h/rs_option.h, RS2_OPTION_AUTO_EXPOSURE_LIMIT; 1 to "
        "200000 us: thread 10771; auto_gain_limit up to 248, assumed to be in 1/16; time before gain: assumed, after "
        "thread 3925",
        most_gain=248 / 16,
    ),
    "depthai": Driver(
        "DepthAI", "3.12.0",
        "camera.initialControl.setAutoExposureLimit({us})\n"
        "banding = depthai.CameraControl.AntiBandingMode.{banding}\n"
        "camera.initialControl.setAntiBandingMode(banding)",
        "us as int: a float is taken for seconds; unless it is told, it keeps whole periods of lamps at 50 Hz",
        "luxonis/depthai-core, CameraControl.hpp, setAutoExposureLimit, setAntiBandingMode; time before ISO, 100 to "
        "1600: its threads 926 and 433, setManualExposure",
        most_gain=16.0, avoids_flicker=True,
    ),
    "spinnaker": Driver(
        "Spinnaker (PySpin)", "of Blackfly S; the version was not looked up",
        "camera.ExposureAuto.SetValue(PySpin.ExposureAuto_Continuous)\n"
        "camera.GainAuto.SetValue(PySpin.GainAuto_Continuous)\n"
        "gain_last = PySpin.AutoExposureControlPriority_Gain\n"
        "camera.AutoExposureControlPriority.SetValue(gain_last)\n"
        "camera.AutoExposureExposureTimeUpperLimit.SetValue({us})",
        "us; Chameleon3 and older call it AutoExposureTimeUpperLimit; without GainAuto pictures go dark at the cap; "
        "the priority Gain holds 0 dB until the time is at the cap",
        "nodes AutoExposureExposureTimeUpperLimit and AutoExposureControlPriority of Spinnaker's Camera.h",
    ),
    "pylon": Driver(
        "pylon (pypylon)", "26.9",
        "camera.AutoExposureTimeUpperLimit.Value = {us}\ncamera.ExposureAuto.Value = 'Continuous'\n"
        "camera.GainAuto.Value = 'Continuous'\ncamera.AutoFunctionProfile.Value = 'MinimizeGain'",
        "us; GigE cameras before SFNC 2 call it AutoExposureTimeAbsUpperLimit and the profile GainMinimum; without "
        "GainAuto pictures go dark at the cap",
        "docs.baslerweb.com/exposure-auto, docs.baslerweb.com/auto-function-profile",
    ),
}  # fmt: skip
"""By name."""


def document_lines(cap: Cap, notes: Mapping[str, str]) -> Iterator[str]:
    """The words of every driver, as lines of limit.txt. notes: more to know about some, by their keys."""
    for key, driver in DRIVERS.items():
        yield ""
        about = f"{driver.name} {driver.version}: {driver.about}"
        yield from comment(f"{about}. Reached: {notes[key]}" if key in notes else about)
        yield from driver.text(cap).splitlines()


def comment(text: str) -> Iterator[str]:
    """Lines of a comment in at most 79 columns."""
    yield from (f"# {line}" for line in paragraph(text, 77, whole=True))
