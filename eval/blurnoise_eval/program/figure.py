"""Figure of an exposure program, as camera people draw it: time and gain against light, both logarithmic, stages
marked; below it what the program gives, beside what else a camera may do."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from blurnoise_eval.plots.style import COLOURS, plain_numbers, tidy
from blurnoise_eval.program.optimise import Program
from blurnoise_eval.program.text import named
from blurnoise_eval.system.files import write_figure
from blurnoise_eval.system.terminal import plain

_OURS, _GAIN, *_RIVALS = COLOURS
_BEST = "0.55"
_DASHES = ((4, 1.5), (1, 1), (5, 1.5, 1, 1.5), (2, 2))


def write(program: Program, title: str, path: Path) -> Path:
    """Write :func:`draw`'s figure as PNG. Raises ``OSError``."""
    write_figure(path, draw(program, title), dpi=150)
    return path


def draw(program: Program, title: str) -> Figure:
    """Time, gain and value against light."""
    figure = Figure(figsize=(7.6, 9.2), layout="constrained")
    time, gain, value = figure.subplots(3, 1, sharex=True, height_ratios=(3, 2.2, 3))
    problem = program.problem
    lights = np.array(problem.lights_lux)
    finer = np.geomspace(lights[0], lights[-1], 600)
    taken = [problem.taken_s(program.stages, light) for light in finer]
    gains = [problem.metering.gain_db(light, each) for light, each in zip(finer, taken, strict=True)]
    time.plot(
        lights,
        1e3 * np.array(program.best.exposures_s),
        "o",
        ms=3.5,
        mfc="none",
        color=_BEST,
        label="best at each light",
    )
    time.plot(finer, 1e3 * np.array(taken), color=_OURS, lw=2, label="program")
    gain.plot(lights, program.best.gains_db, "o", ms=3.5, mfc="none", color=_BEST)
    gain.plot(finer, gains, color=_OURS, lw=2)
    _mark_stages(time, gain, program)
    for k, baseline in enumerate(program.baselines):
        if (schedule := baseline.schedule) is None:
            continue
        style = {"color": _RIVALS[k % 4], "lw": 1.3, "dashes": _DASHES[k % 4]}
        time.plot(lights, 1e3 * np.array(schedule.exposures_s), **style)
        gain.plot(lights, schedule.gains_db, **style)
        told = np.array([np.nan if each is None else each for each in schedule.values])
        mean = "" if schedule.value is None else f": {schedule.value:.3f}"
        value.plot(lights, told, **style, label=named(baseline, program) + mean)
    ours = [np.nan if each is None else each for each in program.schedule.values]
    value.plot(
        lights, ours, color=_OURS, lw=2, marker="o", ms=3.5, label=f"program: {program.schedule.value:.3f}"
    )
    lacking = np.array(program.schedule.lacks_gain)
    if lacking.any():
        gain.plot(
            lights[lacking], np.array(program.schedule.gains_db)[lacking], "x", ms=7, mew=1.6, color=_GAIN,
            label="most gain reached: darker than metered",
        )  # fmt: skip
        gain.legend(fontsize=8, frameon=False, loc="best")
    time.set_yscale("log", base=2)
    time.set_xscale("log", base=2)
    _ticks(time)
    time.set_ylabel("Exposure time / ms", fontsize=9)
    gain.set_ylabel("Gain / dB", fontsize=9)
    value.set_ylabel(title.split(": ")[-1], fontsize=9)
    value.set_xlabel("Light on the scene / lux", fontsize=9)
    time.legend(fontsize=8, frameon=False, loc="lower left")
    value.legend(fontsize=8, frameon=False, loc="upper center", bbox_to_anchor=(0.5, -0.17), ncols=2)
    tidy(time, gain, value)
    figure.suptitle(plain(title), fontsize=11, parse_math=False)
    return figure


def _mark_stages(time: Axes, gain: Axes, program: Program) -> None:
    """A numbered line where a stage begins."""
    unity, lights = program.problem.metering.total_s(1.0), program.problem.lights_lux
    for number, (at_time, at_gain) in enumerate(
        zip(program.stages.times_s, program.stages.gains, strict=True)
    ):
        light = unity / (at_time * at_gain)
        if not lights[0] <= light <= lights[-1]:
            continue
        for axes in (time, gain):
            axes.axvline(light, color="0.75", lw=0.8, ls=":")
        time.annotate(
            f"stage {number}", (light, 1.0), xycoords=("data", "axes fraction"), ha="center", va="bottom",
            fontsize=8, color="0.4",
        )  # fmt: skip


def _ticks(axes: Axes) -> None:
    for axis in (axes.xaxis, axes.yaxis):
        plain_numbers(axis)
        axis.set_major_locator(LogLocator(base=2, numticks=12))
