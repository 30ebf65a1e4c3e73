"""Registers of a sensor, for whoever writes them: an exposure in lines, and a gain as the code of the sensor.

Domain: s; gains as factors >= 1. Gains and imx296's lines are those of libcamera 0.7.1 of Raspberry Pi, src/ipa/rpi/
cam_helper/cam_helper_NAME.cpp; the least and the highest code those of Raspberry Pi's Linux drivers NAME.c. Other
lines are as long as the camera file says. The codes of imx296 go on into its digital gain.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable
from typing import NamedTuple

from blurnoise.camera import Camera

_GAINS: dict[str, tuple[range, Callable[[int], float]]] = {
    "imx219": (range(232 + 1), lambda code: 256 / (256 - code)),
    "imx296": (range(480 + 1), lambda code: 10 ** (code / 200)),
    "imx477": (range(978 + 1), lambda code: 1024 / (1024 - code)),
    "imx500": (range(978 + 1), lambda code: 1024 / (1024 - code)),
    "imx708": (range(112, 960 + 1), lambda code: 1024 / (1024 - code)),
    "ov5647": (range(16, 1023 + 1), lambda code: code / 16),
}
_IMX296_LINE_S, _IMX296_MORE_S = 550 / 37.125e6, 14.26e-6
_ROUNDING = 1e-9


class Registers(NamedTuple):
    """Lines and code, None where unknown, with the exposure, s, and the gain that they give."""

    lines: int | None
    exposure_s: float
    code: int | None
    gain: float


def line_time_s(camera: Camera, row_time_s: float = 0.0) -> float:
    """The time of a line: the given one, or the camera's; 0 where it is not known."""
    own_s = _IMX296_LINE_S if camera.name == "imx296" else camera.sensor.row_time_s
    return row_time_s or own_s


def setting(camera: Camera, exposure_s: float, gain: float, row_time_s: float = 0.0) -> Registers:
    """The most lines and the highest code that exceed neither the exposure nor the gain; at least one line.

    >>> setting(Camera.preset("imx219"), 0.001, 7.9, row_time_s=2e-5)
    Registers(lines=50, exposure_s=0.001, code=223, gain=7.757575757575758)
    """
    line_s, lines = line_time_s(camera, row_time_s), None
    if line_s:
        more_s = _IMX296_MORE_S if camera.name == "imx296" else 0.0
        lines = max(1, math.floor((exposure_s - more_s) / line_s + _ROUNDING))
        exposure_s = lines * line_s + more_s
    if camera.name not in _GAINS:
        return Registers(lines, exposure_s, None, gain)
    codes, gain_of = _GAINS[camera.name]
    code = codes[max(0, bisect_right(codes, gain * (1 + _ROUNDING), key=gain_of) - 1)]
    return Registers(lines, exposure_s, code, gain_of(code))


def gain_limits(camera: Camera) -> tuple[float, float]:
    """The least and the most gain of the sensor itself.

    >>> gain_limits(Camera.preset("ov5647"))
    (1.0, 63.9375)
    """
    if camera.name not in _GAINS:
        return 1.0, 10 ** (camera.sensor.analogue_gain_max_db / 20)
    codes, gain_of = _GAINS[camera.name]
    return gain_of(codes[0]), gain_of(codes[-1])
