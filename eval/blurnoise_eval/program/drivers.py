"""A cap of the exposure time in each driver's own words.

Every driver that can cap its auto exposure takes whole microseconds, or 100 us; the cap is rounded down, so that it
is never exceeded. ``DRIVERS`` has everything about a driver: a new one is one entry more.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

LANGUAGES = ("python", "json", "shell")


@dataclass(frozen=True)
class Driver:
    """A driver's words. language: of ``words``, of :data:`LANGUAGES`. version: that the words were written for.

    words: with {us}, {hundred_us} and {mode} in the place of the cap in whole us, in whole 100 us, and of libcamera's
    exposure mode. about: what to know about them. source: where the name and the unit are documented.
    """

    name: str
    version: str
    language: str
    words: str
    about: str
    source: str

    def text(self, cap: Cap) -> str:
        """The words with this cap.

        >>> DRIVERS["depthai"].text(Cap(0.0021, shortest_s=20e-6, gain=8.0))
        'camera.initialControl.setAutoExposureLimit(2100)'
        """
        # not str.format: the words of JSON and Python have braces of their own
        filled = self.words.replace("{us}", str(cap.us)).replace("{hundred_us}", str(cap.hundred_us))
        return filled.replace("{mode}", json.dumps(cap.mode))

    def line(self, cap: Cap) -> str:
        """The one line of the words that holds the cap, in microseconds or hundreds of them.

        >>> DRIVERS["spinnaker"].line(Cap(0.0021, shortest_s=20e-6, gain=8.0))
        'camera.AutoExposureExposureTimeUpperLimit.SetValue(2100)'
        """
        own = next(line for line in self.words.splitlines() if "us}" in line)
        return replace(self, words=own).text(cap)


@dataclass(frozen=True)
class Cap:
    """A cap, s, with the shortest exposure of the sensor, s, and the most gain, a factor, that it needs.

    Raises ``ValueError`` for a cap below 1 us.

    >>> Cap(0.00219, shortest_s=20e-6, gain=7.96).mode
    {'shutter': [20, 2190], 'gain': [1.0, 8.0]}
    """

    limit_s: float
    shortest_s: float
    gain: float

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

    def lines(self, row_time_s: float) -> int:
        """Whole lines of a sensor, at least one, for whoever writes its registers.

        >>> Cap(0.0021, shortest_s=20e-6, gain=8.0).lines(14.8e-6)
        141
        """
        return max(1, math.floor(self.limit_s / row_time_s + 1e-9))


_PICAMERA2 = """\
from libcamera import controls
from picamera2 import Picamera2
tuning = Picamera2.load_tuning_file("SENSOR.json")
agc = Picamera2.find_tuning_algo(tuning, "rpi.agc")
for channel in agc.get("channels", [agc]):
    channel["exposure_modes"]["custom"] = {mode}
camera = Picamera2(tuning=tuning)
camera.set_controls({"AeExposureMode": controls.AeExposureModeEnum.Custom})"""

DRIVERS = {
    "picamera2": Driver(
        "picamera2", "0.3.38", "python", _PICAMERA2,
        "no control caps the auto exposure; an exposure mode of the tuning file does",
        "raspberrypi/picamera2, picamera2.py, and its thread 634",
    ),
    "libcamera": Driver(
        "libcamera", "0.7.1 of Raspberry Pi", "json", '{"exposure_modes": {"custom": {mode}}}',
        "in rpi.agc, in each channel, of a copy of the sensor's tuning file; --exposure custom",
        "raspberrypi/libcamera, src/ipa/rpi/controller/rpi/agc_channel.cpp, AgcExposureMode::read",
    ),
    "v4l2": Driver(
        "V4L2 (uvcvideo)", "Linux 6", "shell",
        "v4l2-ctl --set-ctrl=auto_exposure=1 --set-ctrl=exposure_time_absolute={hundred_us}",
        "UVC has no cap for auto exposure: this fixes the time, in 100 us; right where the light asks for more",
        "V4L2_CID_EXPOSURE_ABSOLUTE, Linux kernel, ext-ctrls-camera.rst",
    ),
    "realsense": Driver(
        "librealsense", "2.59.1", "python",
        "sensor.set_option(rs.option.auto_exposure_limit, {us})",
        "us; of the stereo module, where supports() says so; before streaming starts; turns the limit on itself",
        "IntelRealSense/librealsense, include/librealsense2/h/rs_option.h, RS2_OPTION_AUTO_EXPOSURE_LIMIT",
    ),
    "depthai": Driver(
        "DepthAI", "3.12.0", "python", "camera.initialControl.setAutoExposureLimit({us})",
        "us as int: a float is taken for seconds",
        "luxonis/depthai-core, CameraControl.hpp, setAutoExposureLimit",
    ),
    "spinnaker": Driver(
        "Spinnaker (PySpin)", "of Blackfly S; the version was not looked up", "python",
        "camera.ExposureAuto.SetValue(PySpin.ExposureAuto_Continuous)\n"
        "camera.GainAuto.SetValue(PySpin.GainAuto_Continuous)\n"
        "camera.AutoExposureExposureTimeUpperLimit.SetValue({us})",
        "us; Chameleon3 and older call it AutoExposureTimeUpperLimit; without GainAuto pictures go dark at the cap",
        "node AutoExposureExposureTimeUpperLimit of the camera's GenICam description",
    ),
    "pylon": Driver(
        "pylon (pypylon)", "26.9", "python",
        "camera.AutoExposureTimeUpperLimit.Value = {us}\ncamera.ExposureAuto.Value = 'Continuous'\n"
        "camera.GainAuto.Value = 'Continuous'",
        "us; GigE cameras before SFNC 2 call it AutoExposureTimeAbsUpperLimit; without GainAuto pictures go dark at "
        "the cap",
        "docs.baslerweb.com/exposure-auto",
    ),
}  # fmt: skip
"""By name."""


def document_lines(cap: Cap, row_time_s: float = 0.0) -> Iterator[str]:
    """The lines of limit.txt: the words of every driver, and lines of the sensor where the row time is known."""
    yield f"# Cap of the exposure time: {cap.us} us"
    for driver in DRIVERS.values():
        yield ""
        yield f"# {driver.name} {driver.version}: {driver.about}"
        yield from driver.text(cap).splitlines()
    if row_time_s:
        yield ""
        yield f"# registers: {cap.lines(row_time_s)} lines of {1e6 * row_time_s:.4g} us"
