"""V4L2 controls of an exposure program: a ladder of total exposure, for a camera whose software sets them itself.

Sources: ``exposure_time_absolute`` counts 100 us (kernel, "Camera Control Reference"); ``exposure`` of a sensor's
driver counts lines, ``analogue_gain`` is a code of each sensor (libcamera, src/ipa/rpi/cam_helper), up to the gain
that its modes there use (src/ipa/rpi/vc4/data). Gain that a code cannot hold is left to digital gain.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

from blurnoise_eval.program.optimise import Program

UNIT_S = 100e-6
STEPS_PER_STOP = 2
_SLACK = 1e-6  # of a count, so that rounding takes none away
GAIN_CODES: dict[str, tuple[Callable[[float], float], float]] = {
    "imx219": (lambda gain: 256 - 256 / gain, 10.0),
    "imx296": (lambda gain: min(200 * math.log10(gain), 239), 16.0),
    "imx477": (lambda gain: 1024 - 1024 / gain, 16.0),
    "ov5647": (lambda gain: 16 * gain, 8.0),
}
"""Sensor -> its code for a gain, and the largest gain."""


def rows(program: Program) -> Iterator[dict[str, Any]]:
    """A row per half stop of total exposure, from the most light to the least.

    Lines are of the limits or the camera; of neither: nothing is said in lines. ``gain`` goes with the column of
    exposure before it, so that neither unit of time changes the total.
    """
    stages, limits, metering = program.stages, program.problem.limits, program.problem.metering
    line_s = limits.line_time_s or metering.camera.row_time_s
    low_s, high_s = (time * gain for time, gain in (stages.corners[0], stages.corners[-1]))
    steps = math.ceil(STEPS_PER_STOP * math.log2(high_s / low_s) - 1e-9)
    unity = metering.total_s(1.0)
    for step in range(steps + 1):
        total_s = low_s * (high_s / low_s) ** (step / steps)
        time_s = limits.settled(stages.divided(total_s)[0])
        units = _count(time_s, UNIT_S)
        lines = _count(time_s, line_s) if line_s else None
        for_codes = _gain(total_s, lines * line_s if lines else time_s)
        yield {
            "illuminance_lux": unity / total_s,
            "total_exposure_us": 1e6 * total_s,
            "exposure_time_absolute": units,
            "gain": _gain(total_s, units * UNIT_S),
            "exposure_lines": lines,
            "gain_with_lines": for_codes,
            **{f"analogue_gain_{name}": gain_code(name, for_codes) for name in GAIN_CODES},
            "extrapolated": int(program.extrapolates(time_s)),
        }


def gain_code(sensor: str, gain: float) -> int:
    """The value of ``analogue_gain`` that amplifies by no more than ``gain``."""
    code, most = GAIN_CODES[sensor]
    return math.floor(code(min(gain, most)) + _SLACK)


def _count(time_s: float, unit_s: float) -> int:
    return max(1, math.floor(time_s / unit_s + _SLACK))


def _gain(total_s: float, time_s: float) -> float:
    return max(1.0, total_s / time_s)
