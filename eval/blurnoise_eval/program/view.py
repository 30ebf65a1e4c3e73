"""An exposure program in words, of 80 columns, and as a figure."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from blurnoise_eval.grid.axes import milliseconds
from blurnoise_eval.plots.style import COLOURS, plain_numbers, spread, tidy
from blurnoise_eval.program.optimise import Baseline, Program
from blurnoise_eval.program.problem import Schedule
from blurnoise_eval.system.files import write_figure
from blurnoise_eval.system.terminal import PROSE, paragraph, plain, table_lines

_SHOWN = 12  # lights of the table
_EXTRAPOLATED = "extrapolated: shorter than tested"
_OURS, _GAIN, *_RIVALS = COLOURS
_DASHES = ((4, 1.5), (1, 1), (5, 1.5, 1, 1.5), (2, 2))
_BEST = {"marker": "o", "ls": "", "ms": 3.5, "mfc": "none", "color": "0.55"}


def lines(program: Program, width: int | None = None) -> Iterator[str]:
    """What the terminal shows, line by line, in so many columns."""
    prose = width and min(width, PROSE)
    yield from paragraph(sentence(program), prose)
    yield ""
    schedule, problem = program.schedule, program.problem
    kept = "keeps" if problem.inputs.criterion.kept else "reaches"
    rows = []
    for place in spread(range(len(problem.lights_lux)), _SHOWN):
        exposure_s = schedule.exposures_s[place]
        note = _EXTRAPOLATED * program.extrapolates(exposure_s)
        if schedule.lacks_gain[place]:
            note = "most gain: darker than metered"
        gain, value = f"{schedule.gains_db[place]:.1f}", _value(schedule.values[place])
        rows.append([_lux(problem.lights_lux[place]), milliseconds(exposure_s), gain, value, note])
    least_s, unity = program.stages.times_s[0], problem.inputs.metering.total_s(1.0)
    if program.extrapolates(least_s):
        rows.append([_lux(unity / least_s), milliseconds(least_s), "0.0", "-", _EXTRAPOLATED])
    heads = ["light, lux", "exposure, ms", "gain, dB", kept, ""]
    yield from table_lines(heads, rows, (True, True, True, True, False), width)
    yield ""
    both = zip(program.stages.times_s, program.stages.gains, strict=True)
    stages = "; ".join(f"{milliseconds(time)} ms, x{gain:.3g}" for time, gain in both)
    yield from paragraph(f"Stages (time first, then gain): {stages}.", prose)
    if program.extrapolates(least_s):
        yield from paragraph(
            f"Exposures below {milliseconds(program.tested_s)} ms, the shortest tested, are extrapolated: they are "
            f"for more than {_lux(unity / program.tested_s)} lux, and keep daylight from being overexposed.",
            prose,
        )
    limits = ", ".join(problem.limits.words)
    yield from paragraph(f"For {problem.scenario.text}. Limits: {limits}.", prose)
    yield from paragraph(
        f"Gain by metering to 18 % of full scale, {problem.inputs.metering.camera.name}, pictures of "
        f"{100 * problem.inputs.metering.mean_light:.1f} % of white on average.",
        prose,
    )
    yield ""
    compared = [
        _row("this program", schedule),
        _row("the best, without stages", program.best),
        *(_row(_named(each, program), each.schedule, each.reason) for each in program.baselines),
    ]
    heads = ["", kept, "worst speed", "worst light", ""]
    yield from table_lines(heads, compared, (False, True, True, True, False), width)


def sentence(program: Program) -> str:
    """What the program gives, what a fixed time and a stock program give, and what it may lose."""
    model, criterion, lights = (
        program.problem.inputs.model,
        program.problem.inputs.criterion,
        program.problem.lights_lux,
    )
    value = _value(program.schedule.value)
    if program.low is not None and program.high is not None:
        value += f" ({program.low:.3f}-{program.high:.3f})"
    does = f"gives {model} a {criterion.title} of {value}"
    if criterion.kept:
        does = f"keeps {value} of {model}'s {criterion.noun}"
    others = [
        f"{_named(each, program)} {_value(each.schedule.value)}"
        for each in program.baselines
        if each.schedule is not None and each.schedule.value is not None
    ]
    beside = f"; {', '.join(others)}" if others else ""
    told = f"From {lights[0]:.4g} to {lights[-1]:.4g} lux this program {does}{beside}."
    pictures = f"{program.pictures} picture{'s' * (program.pictures != 1)}"
    if program.regret_95 is None:
        return f"{told} From {pictures} it cannot be said what another program could gain."
    return f"{told} Another could gain at most {program.regret_95:.3f} (95 %, {pictures})."


def _named(baseline: Baseline, program: Program) -> str:
    """A baseline with its time."""
    if baseline.name == "best fixed time" and program.best_fixed_s is not None:
        return f"{baseline.name}, {milliseconds(program.best_fixed_s)} ms"
    return baseline.name


def _lux(light: float) -> str:
    """Four digits, and no exponent where people read none."""
    return f"{float(f'{light:.4g}'):.8g}"


def _value(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"


def _row(name: str, schedule: Schedule | None, reason: str = "") -> list[str]:
    if schedule is None or schedule.value is None:
        return [name, "-", "", "", reason]
    return [name, *map(_value, (schedule.value, schedule.worst_speed, schedule.worst_light)), ""]


def draw(program: Program, title: str, path: Path) -> Path:
    """Write a PNG, as camera people draw a program: time and gain against light, both logarithmic, stages marked;
    below it what the program gives, beside what else a camera may do. Raises ``OSError``."""
    figure = Figure(figsize=(7.6, 9.2), layout="constrained")
    time, gain, value = figure.subplots(3, 1, sharex=True, height_ratios=(3, 2.2, 3))
    problem, ours = program.problem, program.schedule
    lights = np.array(problem.lights_lux)
    finer = np.geomspace(lights[0], lights[-1], 600)
    taken = [problem.taken_s(program.stages, light) for light in finer]
    gains = [problem.inputs.metering.gain_db(light, each) for light, each in zip(finer, taken, strict=True)]
    time.plot(lights, _ms(program.best.exposures_s), **_BEST, label="best at each light")
    time.plot(finer, _ms(taken), color=_OURS, lw=2, label="program")
    gain.plot(lights, program.best.gains_db, **_BEST)
    gain.plot(finer, gains, color=_OURS, lw=2)
    _mark_stages(time, gain, program)
    for k, baseline in enumerate(program.baselines):
        if (schedule := baseline.schedule) is not None:
            style = {"color": _RIVALS[k % 4], "lw": 1.3, "dashes": _DASHES[k % 4]}
            label = _named(baseline, program) + (f": {schedule.value:.3f}" if schedule.value else "")
            time.plot(lights, _ms(schedule.exposures_s), **style)
            gain.plot(lights, schedule.gains_db, **style)
            value.plot(lights, np.array(schedule.values, float), **style, label=label)
    label = f"program: {_value(ours.value)}"
    value.plot(lights, np.array(ours.values, float), color=_OURS, lw=2, marker="o", ms=3.5, label=label)
    lacking = np.array(ours.lacks_gain)
    if lacking.any():
        at = lights[lacking], np.array(ours.gains_db)[lacking]
        gain.plot(*at, "x", ms=7, mew=1.6, color=_GAIN, label="most gain reached: darker than metered")
        gain.legend(fontsize=8, frameon=False, loc="best")
    time.set_yscale("log", base=2)
    time.set_xscale("log", base=2)
    for axis in (time.xaxis, time.yaxis):
        plain_numbers(axis)
        axis.set_major_locator(LogLocator(base=2, numticks=12))
    tidy(time, y="Exposure time / ms")
    tidy(gain, y="Gain / dB")
    tidy(value, x="Light on the scene / lux", y=title.split(": ")[-1])
    time.legend(fontsize=8, frameon=False, loc="lower left")
    value.legend(fontsize=8, frameon=False, loc="upper center", bbox_to_anchor=(0.5, -0.17), ncols=2)
    figure.suptitle(plain(title), fontsize=11, parse_math=False)
    write_figure(path, figure, dpi=150)
    return path


def _ms(exposures_s: object) -> np.ndarray:
    return 1e3 * np.array(exposures_s)


def _mark_stages(time: Axes, gain: Axes, program: Program) -> None:
    """A numbered line where a stage begins."""
    unity, lights = program.problem.inputs.metering.total_s(1.0), program.problem.lights_lux
    both = zip(program.stages.times_s, program.stages.gains, strict=True)
    top: Any = {
        "xycoords": ("data", "axes fraction"),
        "ha": "center",
        "va": "bottom",
        "fontsize": 8,
        "color": "0.4",
    }
    for number, (at_time, at_gain) in enumerate(both):
        light = unity / (at_time * at_gain)
        if lights[0] <= light <= lights[-1]:
            for axes in (time, gain):
                axes.axvline(light, color="0.75", lw=0.8, ls=":")
            time.annotate(f"stage {number}", (light, 1.0), **top)
