"""Exports of an exposure program: a table of lights, libcamera's exposure mode, an AE route, V4L2, and all as JSON.

Formats, as read at their sources:

* libcamera, the "rpi.agc" algorithm of a Raspberry Pi tuning file: "exposure_modes" maps a name to "shutter", us, and
  "gain", lists of one length, two or more (src/ipa/rpi/controller/rpi/agc_channel.cpp, ``AgcExposureMode::read``; how
  they are walked, ``divideUpExposure``, is :meth:`~blurnoise_eval.program.stages.Stages.divided`).
* AE route of HiSilicon and Ascend image processors: at most 16 nodes of "int_time", whole us above 0, and "sys_gain",
  1024 for 1; products strictly rising, one component rising between neighbours (hiascend.com,
  ``hi_isp_ae_route_node``, ``hi_mpi_isp_set_ae_route_attr``).
* V4L2: ``exposure_time_absolute`` counts 100 us (kernel, "Camera Control Reference"); ``exposure`` of a sensor's
  driver counts lines, ``analogue_gain`` is a code of each sensor (libcamera, src/ipa/rpi/cam_helper), up to the gain
  that its modes there use (src/ipa/rpi/vc4/data). Gain that a code cannot hold is left to digital gain.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from blurnoise_eval.program.optimise import Baseline, Program
from blurnoise_eval.program.stages import Stages
from blurnoise_eval.system.files import write_whole
from blurnoise_eval.system.tables import csv_lines

MODES = ("normal", "short", "long", "custom")
"""Names by which libcamera's controls select an exposure mode (src/ipa/rpi/common/ipa_base.cpp)."""
MOST_NODES = 16
UNIT_GAIN = 1024
V4L2_UNIT_S = 100e-6
V4L2_STEPS_PER_STOP = 2
GAIN_CODES: dict[str, tuple[Callable[[float], float], float]] = {
    "imx219": (lambda gain: 256 - 256 / gain, 10.0),
    "imx296": (lambda gain: min(200 * math.log10(gain), 239), 16.0),
    "imx477": (lambda gain: 1024 - 1024 / gain, 16.0),
    "ov5647": (lambda gain: 16 * gain, 8.0),
}
"""Sensor -> its code for a gain, and the largest gain."""
_SLACK = 1e-6  # of a count, so that rounding takes none away


def libcamera_mode(stages: Stages) -> dict[str, list[float]]:
    """One entry of "exposure_modes"; stages that us and four places cannot tell apart are one."""
    both = zip(stages.times_s, stages.gains, strict=True)
    rounded = [(max(1, round(1e6 * time)), round(gain, 4)) for time, gain in both]
    kept = list(dict.fromkeys(rounded))
    kept = kept if len(kept) > 1 else rounded[:2]
    return {"shutter": [shutter for shutter, _ in kept], "gain": [gain for _, gain in kept]}


def how_to_use(mode: str) -> dict[str, list[str]]:
    """Two lines for each kind of file."""
    return {
        "libcamera": [
            f"copy {mode!r} of libcamera.json into exposure_modes of rpi.agc, in each channel, of a copy of "
            "the sensor's tuning file",
            f"rpicam-vid --tuning-file COPY --exposure {mode} (picamera2: AeExposureModeEnum.{mode.capitalize()})",
        ],
        "v4l2": [
            "with automatic exposure off, multiply total_exposure_us by 0.18 / the picture's mean (linear, "
            "white is 1) and take the nearest row of v4l2.csv",
            "USB camera: exposure_time_absolute and gain; sensor driver: exposure (lines) and its analogue_gain",
        ],
    }


def ae_route(stages: Stages) -> list[dict[str, int]]:
    """Nodes in whole us and 1/1024; corners that these cannot tell apart are one."""
    nodes: list[dict[str, int]] = []
    for time, gain in stages.corners:
        node = {"int_time": max(1, round(1e6 * time)), "sys_gain": max(UNIT_GAIN, round(UNIT_GAIN * gain))}
        if not nodes or math.prod(node.values()) > math.prod(nodes[-1].values()):
            nodes.append(node)
    return nodes


def v4l2_rows(program: Program) -> Iterator[dict[str, Any]]:
    """A row per half stop of total exposure, from the most light to the least.

    Lines are of the limits or the camera; of neither: nothing is said in lines. ``gain`` goes with the column of
    exposure before it, so that neither unit of time changes the total.
    """
    stages, limits, metering = program.stages, program.problem.limits, program.problem.inputs.metering
    line_s = limits.line_time_s or metering.camera.row_time_s
    low_s, high_s = (time * gain for time, gain in (stages.corners[0], stages.corners[-1]))
    steps = math.ceil(V4L2_STEPS_PER_STOP * math.log2(high_s / low_s) - 1e-9)
    unity = metering.total_s(1.0)
    for step in range(steps + 1):
        total_s = low_s * (high_s / low_s) ** (step / steps)
        time_s = limits.settled(stages.divided(total_s)[0])
        units, lines = _count(time_s, V4L2_UNIT_S), _count(time_s, line_s) if line_s else None
        for_codes = max(1.0, total_s / (lines * line_s if lines else time_s))
        yield {
            "illuminance_lux": unity / total_s,
            "total_exposure_us": 1e6 * total_s,
            "exposure_time_absolute": units,
            "gain": max(1.0, total_s / (units * V4L2_UNIT_S)),
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


def rows(program: Program) -> list[dict[str, Any]]:
    """A row per light: the program there, whether it is shorter than was tested, and the best without stages."""
    ours, best = program.schedule, program.best
    return [
        {
            "illuminance_lux": light,
            "exposure_s": ours.exposures_s[place],
            "gain_db": ours.gains_db[place],
            "gain_limited": int(ours.lacks_gain[place]),
            "extrapolated": int(program.extrapolates(ours.exposures_s[place])),
            "value": ours.values[place],
            "best_exposure_s": best.exposures_s[place],
            "best_gain_db": best.gains_db[place],
            "best_value": best.values[place],
        }
        for place, light in enumerate(program.problem.lights_lux)
    ]


def document(program: Program, run: str, notes: Sequence[str]) -> dict[str, Any]:
    """Everything. run: where it comes from; notes: what was left out or assumed."""
    problem, ours = program.problem, program.schedule
    scenario = problem.scenario
    speeds = [{"speed": speed, "share": share} for speed, share in scenario.speeds_px_s.items()]
    return {
        "run": run,
        "model": problem.inputs.model,
        "criterion": problem.inputs.criterion.row(),
        "camera": problem.inputs.metering.camera.name,
        "mean_light": problem.inputs.metering.mean_light,
        "scenario": {
            "lights_lux": list(scenario.lights_lux),
            "speeds_px_s": speeds,
            "targets": dict(scenario.targets),
            "objective": scenario.objective_text,
        },
        "limits": problem.limits.words,
        "notes": list(notes),
        "value": ours.value,
        "value_low": program.low,
        "value_high": program.high,
        "regret_95": program.regret_95,
        "pictures": program.pictures,
        "worst_speed": ours.worst_speed,
        "worst_light": ours.worst_light,
        "stages": {"times_s": list(program.stages.times_s), "gains": list(program.stages.gains)},
        "shortest_tested_s": program.tested_s,
        "nodes": rows(program),
        "without_stages": program.best.value,
        "best_fixed_s": program.best_fixed_s,
        "rivals": [_baseline(each) for each in program.baselines],
    }


def _baseline(of: Baseline) -> dict[str, Any]:
    names = ("value", "worst_speed", "worst_light", "exposures_s", "gains_db", "values")
    schedule = {name: of.schedule and getattr(of.schedule, name) for name in names}
    return {"name": of.name, **schedule, "reason": of.reason}


def write(
    program: Program, folder: Path, run: str, notes: Sequence[str] = (), mode: str = "custom"
) -> list[Path]:
    """Write program.csv, program.json, libcamera.json, ae_route.json and v4l2.csv. Raises ``OSError``.

    mode: the name of libcamera's exposure mode, one of its :data:`MODES`.
    """
    how = how_to_use(mode)
    route = ae_route(program.stages)
    below = {"extrapolated_below_us": 1e6 * program.tested_s}
    libcamera = {"exposure_modes": {mode: libcamera_mode(program.stages)}}
    files = {
        "program.csv": _csv(rows(program)),
        "program.json": _json({**document(program, run, notes), "how_to_use": how}),
        "libcamera.json": _json({"how_to_use": how["libcamera"], **below, "rpi.agc": libcamera}),
        "ae_route.json": _json({"total_num": len(route), "route_node": route, **below}),
        "v4l2.csv": _csv(list(v4l2_rows(program))),
    }
    for name, text in files.items():
        write_whole(folder / name, text.encode())
    return [folder / name for name in files]


def _csv(table: list[dict[str, Any]]) -> str:
    return "".join(csv_lines(list(table[0]), table))


def _json(value: Any) -> str:
    return json.dumps(value, indent=1, allow_nan=False) + "\n"
