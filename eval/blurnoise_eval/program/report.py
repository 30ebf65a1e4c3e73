"""An exposure program in words, as a figure, and as files: a table, libcamera's exposure mode, and JSON.

libcamera's format is that of the "rpi.agc" algorithm of a Raspberry Pi tuning file: "exposure_modes" maps a name to
"shutter", us, and "gain", lists of one length, two or more (src/ipa/rpi/controller/rpi/agc_channel.cpp,
``AgcExposureMode::read``, of libcamera 0.7.1; its ``divideUpExposure`` is
:meth:`~blurnoise_eval.program.optimise.Stages.divided`). No exposure is below the first "shutter".
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from blurnoise_eval.plan.axes import milliseconds
from blurnoise_eval.plots.style import COLOURS, plain_numbers, spread, tidy
from blurnoise_eval.program import registers
from blurnoise_eval.program.drivers import DRIVERS
from blurnoise_eval.program.optimise import Program, Stages
from blurnoise_eval.program.stepping import Division, beside_promised, daylight, reached, stepped
from blurnoise_eval.program.words import lights_text, lux_text, score_text, too_few
from blurnoise_eval.report.words import counted, keeps, reached_text
from blurnoise_eval.system.files import write_figure, write_whole
from blurnoise_eval.system.tables import csv_lines
from blurnoise_eval.system.terminal import PROSE, paragraph, plain, table_lines

_LEAST_SHOWN = 0.0005  # in three decimals
_SHOWN = 12  # lights of the table
_EXTRAPOLATED = " (extrapolated: shorter than any tested)"
_PROGRAM: dict[str, Any] = {"color": COLOURS[0], "lw": 2, "marker": "o", "ms": 3.5}
_BEST: dict[str, Any] = {"color": "0.55", "ls": "", "marker": "o", "ms": 3.5, "mfc": "none"}
_DASHES = ((4, 1.5), (1, 1), (5, 1.5, 1, 1.5))


def lines(program: Program, width: int | None = None) -> Iterator[str]:
    """The lines for a terminal of ``width`` columns: sentence, table, stages, assumptions and comparison."""
    prose = width and min(width, PROSE)
    yield from paragraph(sentence(program), prose)
    yield ""
    schedule, problem, inputs = program.schedule, program.problem, program.problem.inputs
    kept = keeps(inputs.criterion)
    cells = [
        [
            lux_text(row.illuminance_lux),
            milliseconds(row.exposure_s),
            f"{row.gain_db:.1f}",
            score_text(row.value),
        ]
        for row in spread(rows(program), _SHOWN)
    ]
    yield from table_lines(["light, lux", "exposure, ms", "gain, dB", kept], cells, (True,) * 4, width)
    yield ""
    stages = [
        f"{milliseconds(time)} ms{_EXTRAPOLATED * program.extrapolates(time)}, x{gain:.3g}"
        for time, gain in zip(program.stages.times_s, program.stages.gains, strict=True)
    ]
    yield from paragraph(f"Stages (the time rises first, then the gain): {'; '.join(stages)}.", prose)
    yield from paragraph(brightest(program), prose)
    first_s = program.stages.times_s[0]
    if warning := daylight(
        problem, first_s, f"the first stage, {milliseconds(first_s)} ms, also in libcamera.json"
    ):
        yield from paragraph(warning, prose)
    yield from paragraph(
        f"Speeds and targets: {problem.scenario.text}. Limits: {', '.join(problem.limits.words)}. The gain of "
        f"{inputs.metering.camera.name} meters to 18 % of full scale; {inputs.metering.pictures}.",
        prose,
    )
    yield ""
    schedules = {
        "this program": schedule,
        "libcamera with libcamera.json": stepped(problem, libcamera(program)),
        "with any number of stages": program.best,
        **program.baselines,
    }
    compared = [[name, score_text(of.value), score_text(of.worst_speed)] for name, of in schedules.items()]
    yield from table_lines(["", kept, "worst speed"], compared, (False, True, True), width)
    yield from paragraph(beside_libcamera(program), prose)


def libcamera(program: Program) -> Division:
    """How libcamera divides an exposure up with libcamera.json."""
    least, most = registers.gain_limits(program.problem.inputs.metering.camera)
    limits = least, most * DRIVERS["libcamera"].most_digital
    return Division.read(libcamera_mode(program.stages), program.problem.limits.mains_hz, limits)


def beside_libcamera(program: Program) -> str:
    """How near libcamera comes to the program, stepped through light by light."""
    settled, divided = program.problem.limits.settled, program.stages.divided
    rows = reached(program.problem, libcamera(program), lambda total_s: settled(divided(total_s)[0]))
    return beside_promised({"libcamera with libcamera.json": rows})


def sentence(program: Program) -> str:
    """The score of the program, and its regret."""
    problem, lights = program.problem, program.problem.scenario.lights_lux
    value = score_text(program.schedule.value)
    if program.low is not None and program.high is not None:
        value += f" ({program.low:.3f}-{program.high:.3f})"
    does = reached_text(value, problem.inputs.criterion)
    start = f"{lights_text(lights)} this program {does}."
    pictures = counted(len(problem.clusters), "picture")
    if program.regret_95 is None:
        return f"{start} {too_few(len(problem.clusters))} to say how much better another program could be."
    if program.regret_95 < _LEAST_SHOWN:
        return f"{start} No other program within these limits is better (95 %, {pictures})."
    return f"{start} No other program is better by more than {program.regret_95:.3f} (95 %, {pictures})."


def brightest(program: Program) -> str:
    """The light above which lamps flicker, and the light above which pictures are too bright."""
    limits, metering = program.problem.limits, program.problem.inputs.metering

    def lux(exposure_s: float) -> str:
        """The light at which this exposure needs no gain."""
        return f"{lux_text(metering.lux_at(exposure_s), 3)} lux"

    first_s, lamps_s = program.stages.times_s[0], limits.shortest_s
    long = f"Above {lux(lamps_s)} {milliseconds(lamps_s)} ms are too long: exposures are shorter, and lamps flicker"
    flickers = f"{long}. " if (limits.mains_hz or limits.led) and first_s < lamps_s else ""
    return f"{flickers}Above {lux(first_s)} pictures are too bright at the first stage, {milliseconds(first_s)} ms."


def too_bright_above_lux(program: Program) -> float:
    """The light above which pictures are too bright at the first stage."""
    return program.problem.inputs.metering.lux_at(program.stages.times_s[0])


def draw(program: Program, title: str, path: Path) -> Path:
    """Write a PNG: time, gain and score of the program over the light, with the alternatives. Raises ``OSError``."""
    figure = Figure(figsize=(7.6, 9.2), layout="constrained")
    panels = list(figure.subplots(3, 1, sharex=True))
    lights = np.array(program.problem.scenario.lights_lux)
    dashed = [{"color": colour, "dashes": dash} for colour, dash in zip(COLOURS[1:], _DASHES, strict=False)]
    schedules = {"any number of stages": program.best, "program": program.schedule, **program.baselines}
    for (name, schedule), style in zip(schedules.items(), (_BEST, _PROGRAM, *dashed), strict=True):
        drawn = 1e3 * np.array(schedule.exposures_s), schedule.gains_db, np.array(schedule.values, float)
        for axes, values in zip(panels, drawn, strict=True):
            axes.plot(lights, values, **style, label=f"{name}: {score_text(schedule.value)}")
    for axes, y in zip(panels, ("Exposure time / ms", "Gain / dB", title.split(": ")[-1]), strict=True):
        tidy(axes, y=y)
    tidy(panels[-1], x="Light on the scene / lux")
    panels[0].set_yscale("log", base=2)
    panels[0].set_xscale("log", base=2)
    for axis in (panels[0].xaxis, panels[0].yaxis):
        plain_numbers(axis)
        axis.set_major_locator(LogLocator(base=2, numticks=12))
    panels[-1].legend(fontsize=8, frameon=False, loc="upper center", bbox_to_anchor=(0.5, -0.17), ncols=2)
    figure.suptitle(plain(title), fontsize=11, parse_math=False)
    write_figure(path, figure, dpi=150)
    return path


def libcamera_mode(stages: Stages) -> dict[str, list[float]]:
    """An entry of "exposure_modes", in whole us and gains of four decimals; stages that round to the same are one.

    >>> libcamera_mode(Stages((20e-6, 0.01, 0.033), (1.0, 1.0, 8.0)))
    {'shutter': [20, 10000, 33000], 'gain': [1.0, 1.0, 8.0]}
    """
    rounded = [
        (max(1, round(1e6 * time)), round(gain, 4))
        for time, gain in zip(stages.times_s, stages.gains, strict=True)
    ]
    different = list(dict.fromkeys(rounded))
    different = different if len(different) > 1 else rounded[:2]  # libcamera wants two or more
    return {"shutter": [shutter for shutter, _ in different], "gain": [gain for _, gain in different]}


@dataclass(frozen=True)
class LightRow:
    """A row of program.csv, whose columns are these fields: the program at one light, and the best program of any
    number of stages there.

    gain_limited: 1 where the camera's gain is at its limit. lines, gain_code: of the sensor, None where not known.
    extrapolated: 1 where the exposure is shorter than any tested. value, best_value: the objective, None where it was
    not tested.
    """

    illuminance_lux: float
    exposure_s: float
    gain_db: float
    gain_limited: int
    lines: int | None
    gain_code: int | None
    extrapolated: int
    value: float | None
    best_exposure_s: float
    best_gain_db: float
    best_value: float | None


def rows(program: Program) -> list[LightRow]:
    """A row for each light of the scenario."""
    schedule, best, problem = program.schedule, program.best, program.problem
    camera, row_time_s = problem.inputs.metering.camera, problem.limits.row_time_s
    settings = [
        registers.setting(camera, exposure_s, 10 ** (gain_db / 20), row_time_s)
        for exposure_s, gain_db in zip(schedule.exposures_s, schedule.gains_db, strict=True)
    ]
    columns = (
        problem.scenario.lights_lux, schedule.exposures_s, schedule.gains_db, map(int, schedule.lacks_gain),
        (each.lines for each in settings), (each.code for each in settings),
        (int(program.extrapolates(exposure_s)) for exposure_s in schedule.exposures_s), schedule.values,
        best.exposures_s, best.gains_db, best.values,
    )  # fmt: skip
    return [LightRow(*values) for values in zip(*columns, strict=True)]


def document(program: Program, run: str, notes: Sequence[str]) -> dict[str, Any]:
    """The contents of program.json. run: the run's folder. notes: what was left out or assumed."""
    problem, inputs = program.problem, program.problem.inputs
    speeds = [{"speed": speed, "share": share} for speed, share in problem.scenario.speeds_px_s.items()]
    return {
        "run": run,
        "model": inputs.model,
        "criterion": inputs.criterion.row(),
        "camera": inputs.metering.camera.name,
        "mean_light": inputs.metering.mean_light,
        "scenario": {**asdict(problem.scenario), "speeds_px_s": speeds},
        "limits": problem.limits.words,
        "notes": list(notes),
        "one_axis": inputs.one_axis and inputs.one_axis._asdict(),
        "value": program.schedule.value,
        "worst_speed": program.schedule.worst_speed,
        "value_low": program.low,
        "value_high": program.high,
        "regret_95": program.regret_95,
        "pictures": len(problem.clusters),
        "stages": asdict(program.stages),
        "shortest_tested_s": program.tested_s,
        "too_bright_above_lux": too_bright_above_lux(program),
        "libcamera_value": stepped(problem, libcamera(program)).value,
        "nodes": list(map(asdict, rows(program))),
        "without_stages": program.best.value,
        "best_fixed_s": program.best_fixed_s,
        "rivals": [{"name": name, **of._asdict()} for name, of in program.baselines.items()],
    }


def write(program: Program, folder: Path, run: str, notes: Sequence[str] = ()) -> list[Path]:
    """Write program.csv, program.json and libcamera.json. Raises ``OSError``."""
    columns = [field.name for field in fields(LightRow)]
    modes = {"exposure_modes": {"custom": libcamera_mode(program.stages)}}
    libcamera = {
        "extrapolated_below_us": 1e6 * program.tested_s,
        "too_bright_above_lux": too_bright_above_lux(program),
        "rpi.agc": modes,
    }
    files = {
        "program.csv": "".join(csv_lines(columns, map(asdict, rows(program)))),
        "program.json": _json(document(program, run, notes)),
        "libcamera.json": _json(libcamera),
    }
    for name, text in files.items():
        write_whole(folder / name, text.encode())
    return [folder / name for name in files]


def _json(value: Any) -> str:
    return json.dumps(value, indent=1, allow_nan=False) + "\n"
