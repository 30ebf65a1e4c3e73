"""Exports of an exposure program: a table of lights, libcamera's exposure mode, and all as JSON.

libcamera's format is that of the "rpi.agc" algorithm of a Raspberry Pi tuning file: "exposure_modes" maps a name to
"shutter", us, and "gain", lists of one length, two or more (src/ipa/rpi/controller/rpi/agc_channel.cpp,
``AgcExposureMode::read``; how they are walked, ``divideUpExposure``, is
:meth:`~blurnoise_eval.program.stages.Stages.divided`).
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from blurnoise_eval.program.optimise import Program
from blurnoise_eval.program.stages import Stages
from blurnoise_eval.system.files import write_whole
from blurnoise_eval.system.tables import csv_lines


def libcamera_mode(stages: Stages) -> dict[str, list[float]]:
    """One entry of "exposure_modes"; stages that us and four places cannot tell apart are one."""
    both = zip(stages.times_s, stages.gains, strict=True)
    rounded = [(max(1, round(1e6 * time)), round(gain, 4)) for time, gain in both]
    kept = list(dict.fromkeys(rounded))
    kept = kept if len(kept) > 1 else rounded[:2]
    return {"shutter": [shutter for shutter, _ in kept], "gain": [gain for _, gain in kept]}


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
    problem, inputs = program.problem, program.problem.inputs
    speeds = [{"speed": speed, "share": share} for speed, share in problem.scenario.speeds_px_s.items()]
    ways = {"": program.schedule, **program.baselines}
    ours, *others = ({"name": name, **schedule._asdict()} for name, schedule in ways.items())
    return {
        "run": run,
        "model": inputs.model,
        "criterion": inputs.criterion.row(),
        "camera": inputs.metering.camera.name,
        "mean_light": inputs.metering.mean_light,
        "scenario": {**asdict(problem.scenario), "speeds_px_s": speeds},
        "limits": problem.limits.words,
        "notes": list(notes),
        **{name: ours[name] for name in ("value", "worst_speed", "worst_light")},
        "value_low": program.low,
        "value_high": program.high,
        "regret_95": program.regret_95,
        "pictures": program.pictures,
        "stages": asdict(program.stages),
        "shortest_tested_s": program.tested_s,
        "nodes": rows(program),
        "without_stages": program.best.value,
        "best_fixed_s": program.best_fixed_s,
        "rivals": others,
    }


def write(program: Program, folder: Path, run: str, notes: Sequence[str] = ()) -> list[Path]:
    """Write program.csv, program.json and libcamera.json. Raises ``OSError``."""
    table = rows(program)
    modes = {"exposure_modes": {"custom": libcamera_mode(program.stages)}}
    libcamera = {"extrapolated_below_us": 1e6 * program.tested_s, "rpi.agc": modes}
    files = {
        "program.csv": "".join(csv_lines(list(table[0]), table)),
        "program.json": _json(document(program, run, notes)),
        "libcamera.json": _json(libcamera),
    }
    for name, text in files.items():
        write_whole(folder / name, text.encode())
    return [folder / name for name in files]


def _json(value: Any) -> str:
    return json.dumps(value, indent=1, allow_nan=False) + "\n"
