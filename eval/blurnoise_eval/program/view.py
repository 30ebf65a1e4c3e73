"""An exposure program in words, of 80 columns, and as a figure."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from blurnoise_eval.grid.axes import milliseconds
from blurnoise_eval.plots.style import COLOURS, plain_numbers, spread, tidy
from blurnoise_eval.program.optimise import Program
from blurnoise_eval.system.files import write_figure
from blurnoise_eval.system.terminal import PROSE, paragraph, plain, table_lines

_SHOWN = 12  # lights of the table
_EXTRAPOLATED = "extrapolated: shorter than tested"
_OURS: dict[str, Any] = {"color": COLOURS[0], "lw": 2, "marker": "o", "ms": 3.5}
_BEST: dict[str, Any] = {"color": "0.55", "ls": "", "marker": "o", "ms": 3.5, "mfc": "none"}
_DASHES = ((4, 1.5), (1, 1), (5, 1.5, 1, 1.5))


def lines(program: Program, width: int | None = None) -> Iterator[str]:
    """What the terminal shows, line by line, in so many columns."""
    prose = width and min(width, PROSE)
    yield from paragraph(sentence(program), prose)
    yield ""
    schedule, problem, inputs = program.schedule, program.problem, program.problem.inputs
    reached = "keeps" if inputs.criterion.kept else "reaches"
    rows = []
    for place in spread(range(len(problem.lights_lux)), _SHOWN):
        exposure_s = schedule.exposures_s[place]
        note = _EXTRAPOLATED * program.extrapolates(exposure_s)
        if schedule.lacks_gain[place]:
            note = "most gain: darker than metered"
        gain, value = f"{schedule.gains_db[place]:.1f}", _value(schedule.values[place])
        rows.append([_lux(problem.lights_lux[place]), milliseconds(exposure_s), gain, value, note])
    least_s, unity = program.stages.times_s[0], inputs.metering.total_s(1.0)
    if program.extrapolates(least_s):
        rows.append([_lux(unity / least_s), milliseconds(least_s), "0.0", "-", _EXTRAPOLATED])
    heads = ["light, lux", "exposure, ms", "gain, dB", reached, ""]
    yield from table_lines(heads, rows, (True, True, True, True, False), width)
    yield ""
    both = zip(program.stages.times_s, program.stages.gains, strict=True)
    stages = "; ".join(f"{milliseconds(time)} ms, x{gain:.3g}" for time, gain in both)
    yield from paragraph(f"Stages (time first, then gain): {stages}.", prose)
    yield from paragraph(
        f"For {problem.scenario.text}. Limits: {', '.join(problem.limits.words)}. Gain by metering to 18 % of full "
        f"scale, {inputs.metering.camera.name}, pictures of {100 * inputs.metering.mean_light:.1f} % of white on "
        "average.",
        prose,
    )
    yield ""
    ways = {"this program": schedule, "the best, without stages": program.best, **program.baselines}
    compared = [
        [name, *map(_value, (way.value, way.worst_speed, way.worst_light))] for name, way in ways.items()
    ]
    yield from table_lines(
        ["", reached, "worst speed", "worst light"], compared, (False, True, True, True), width
    )


def sentence(program: Program) -> str:
    """What the program gives, what a fixed time and a stock program give, and what it may lose."""
    inputs, lights = program.problem.inputs, program.problem.lights_lux
    value = _value(program.schedule.value)
    if program.low is not None and program.high is not None:
        value += f" ({program.low:.3f}-{program.high:.3f})"
    does = f"gives {inputs.model} a {inputs.criterion.title} of {value}"
    if inputs.criterion.kept:
        does = f"keeps {value} of {inputs.model}'s {inputs.criterion.noun}"
    others = [f"{name} {way.value:.3f}" for name, way in program.baselines.items() if way.value is not None]
    beside = f"; {', '.join(others)}" if others else ""
    start = f"From {lights[0]:.4g} to {lights[-1]:.4g} lux this program {does}{beside}."
    pictures = f"{program.pictures} picture{'s' * (program.pictures != 1)}"
    if program.regret_95 is None:
        return f"{start} From {pictures} it cannot be said what another program could gain."
    return f"{start} Another could gain at most {program.regret_95:.3f} (95 %, {pictures})."


def _lux(light: float) -> str:
    """Four digits, and no exponent where people read none."""
    return f"{float(f'{light:.4g}'):.8g}"


def _value(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"


def draw(program: Program, title: str, path: Path) -> Path:
    """Write a PNG: time, gain and value of the program over the light, beside what else a camera may do, with a line
    where a stage begins. Raises ``OSError``."""
    figure = Figure(figsize=(7.6, 9.2), layout="constrained")
    panels = list(figure.subplots(3, 1, sharex=True))
    lights = np.array(program.problem.lights_lux)
    dashed = [{"color": each, "dashes": dash} for each, dash in zip(COLOURS[1:], _DASHES, strict=False)]
    ways = {"best at each light": program.best, "program": program.schedule, **program.baselines}
    for (name, way), style in zip(ways.items(), (_BEST, _OURS, *dashed), strict=True):
        of_panels = 1e3 * np.array(way.exposures_s), way.gains_db, np.array(way.values, float)
        for axes, values in zip(panels, of_panels, strict=True):
            axes.plot(lights, values, **style, label=f"{name}: {_value(way.value)}")
    unity = program.problem.inputs.metering.total_s(1.0)
    for time, gain in zip(program.stages.times_s, program.stages.gains, strict=True):
        for axes in panels:
            if lights[0] <= unity / (time * gain) <= lights[-1]:
                axes.axvline(unity / (time * gain), color="0.75", lw=0.8, ls=":")
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
