"""Exports of an exposure program: a table of lights, libcamera's exposure mode, an AE route, V4L2, and all as JSON.

Formats, as read at their sources:

* libcamera, the "rpi.agc" algorithm of a Raspberry Pi tuning file: "exposure_modes" maps a name to "shutter", us, and
  "gain", lists of one length, two or more (src/ipa/rpi/controller/rpi/agc_channel.cpp, ``AgcExposureMode::read``; how
  they are walked, ``divideUpExposure``, is :meth:`~blurnoise_eval.program.stages.Stages.divided`).
* AE route of HiSilicon and Ascend image processors: at most 16 nodes of "int_time", whole us above 0, and "sys_gain",
  1024 for 1; products strictly rising, one component rising between neighbours (hiascend.com,
  ``hi_isp_ae_route_node``, ``hi_mpi_isp_set_ae_route_attr``).
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from blurnoise_eval.program import v4l2
from blurnoise_eval.program.optimise import Baseline, Program
from blurnoise_eval.program.stages import Stages
from blurnoise_eval.program.text import objective_text
from blurnoise_eval.system.files import write_whole
from blurnoise_eval.system.tables import csv_lines

MODES = ("normal", "short", "long", "custom")
"""Names by which libcamera's controls select an exposure mode (src/ipa/rpi/common/ipa_base.cpp)."""
MOST_NODES = 16
UNIT_GAIN = 1024


def libcamera_mode(stages: Stages) -> dict[str, list[float]]:
    """One entry of "exposure_modes"; stages that us and four places cannot tell apart are one."""
    rounded = [
        (max(1, round(1e6 * time)), round(gain, 4))
        for time, gain in zip(stages.times_s, stages.gains, strict=True)
    ]
    kept = [each for before, each in zip([None, *rounded], rounded, strict=False) if each != before]
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
        if not nodes or _product(node) > _product(nodes[-1]):
            nodes.append(node)
    return nodes


def rows(program: Program) -> list[dict[str, Any]]:
    """A row per light: what the program takes there, whether that is shorter than was tested, and the best without
    stages."""
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
    problem = program.problem
    scenario = problem.response.scenario
    return {
        "run": run,
        "model": problem.model,
        "criterion": problem.criterion.row(),
        "camera": problem.metering.camera.name,
        "mean_light": problem.metering.mean_light,
        "scenario": {
            "lights_lux": list(scenario.lights_lux),
            "speeds_px_s": [
                {"speed": speed, "share": share} for speed, share in scenario.speeds_px_s.items()
            ],
            "targets": dict(scenario.targets),
            "objective": objective_text(scenario),
        },
        "limits": problem.limits.words,
        "notes": list(notes),
        "value": program.schedule.value,
        "value_low": program.low,
        "value_high": program.high,
        "regret_95": program.regret_95,
        "pictures": program.pictures,
        "worst_speed": program.schedule.worst_speed,
        "worst_light": program.schedule.worst_light,
        "stages": {"times_s": list(program.stages.times_s), "gains": list(program.stages.gains)},
        "shortest_tested_s": program.tested_s,
        "nodes": rows(program),
        "without_stages": program.best.value,
        "best_fixed_s": program.best_fixed_s,
        "rivals": [_baseline(each) for each in program.baselines],
    }


def write(
    program: Program, folder: Path, run: str, notes: Sequence[str] = (), mode: str = "custom"
) -> list[Path]:
    """Write program.csv, program.json, libcamera.json, ae_route.json and v4l2.csv. Raises ``OSError``.

    mode: the name of libcamera's exposure mode, one of its :data:`MODES`.
    """
    how = how_to_use(mode)
    table, controls = rows(program), list(v4l2.rows(program))
    route = ae_route(program.stages)
    below = {"extrapolated_below_us": 1e6 * program.tested_s}
    libcamera = {"exposure_modes": {mode: libcamera_mode(program.stages)}}
    files = {
        "program.csv": "".join(csv_lines(list(table[0]), table)),
        "program.json": _text({**document(program, run, notes), "how_to_use": how}),
        "libcamera.json": _text({"how_to_use": how["libcamera"], **below, "rpi.agc": libcamera}),
        "ae_route.json": _text({"total_num": len(route), "route_node": route, **below}),
        "v4l2.csv": "".join(csv_lines(list(controls[0]), controls)),
    }
    for name, text in files.items():
        write_whole(folder / name, text.encode())
    return [folder / name for name in files]


def _baseline(baseline: Baseline) -> dict[str, Any]:
    there = baseline.schedule
    return {
        "name": baseline.name,
        "value": there and there.value,
        "worst_speed": there and there.worst_speed,
        "worst_light": there and there.worst_light,
        "exposures_s": there and list(there.exposures_s),
        "gains_db": there and list(there.gains_db),
        "values": there and list(there.values),
        "reason": baseline.reason,
    }


def _product(node: dict[str, int]) -> int:
    return math.prod(node.values())


def _text(value: Any) -> str:
    return json.dumps(value, indent=1, allow_nan=False) + "\n"
