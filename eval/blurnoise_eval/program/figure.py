"""Figure of an exposure program, as camera people draw it: time and gain against light, both logarithmic, stages
marked; below it what the program gives, beside what else a camera may do."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from blurnoise_eval.program.limits import Limits
from blurnoise_eval.program.making import Program
from blurnoise_eval.program.metering import Metering
from blurnoise_eval.program.scenario import Scenario
from blurnoise_eval.program.text import named
from blurnoise_eval.system.files import write_figure
from blurnoise_eval.system.terminal import plain

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_OURS, _BEST, _GAIN = "#0072b2", "0.55", "#d55e00"
_RIVALS = ("#009e73", "#cc79a7", "#e69f00", "#56b4e9")
_DASHES = ((4, 1.5), (1, 1), (5, 1.5, 1, 1.5), (2, 2))


def write(
    program: Program, scenario: Scenario, limits: Limits, metering: Metering, title: str, path: Path
) -> Path:
    """Write :func:`draw`'s figure as PNG. Raises ``OSError``."""
    write_figure(path, draw(program, scenario, limits, metering, title), dpi=150)
    return path


def draw(program: Program, scenario: Scenario, limits: Limits, metering: Metering, title: str) -> Figure:
    """Time, gain and value against light."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.6, 9.2), layout="constrained")
    time, gain, value = figure.subplots(3, 1, sharex=True, height_ratios=(3, 2.2, 3))
    lights = np.array(scenario.lights_lux)
    finer = np.geomspace(lights[0], lights[-1], 600)
    taken = [limits.settled(program.stages.divided(metering.total_s(light))[0]) for light in finer]
    gains = [metering.gain_db(light, each) for light, each in zip(finer, taken, strict=True)]
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
    _mark_stages(time, gain, program, metering, lights)
    drawn = [(rival, k) for k, rival in enumerate(program.rivals) if rival.course is not None]
    for rival, k in drawn:
        if rival.course is None:
            continue
        style = {"color": _RIVALS[k % 4], "lw": 1.3, "dashes": _DASHES[k % 4]}
        time.plot(lights, 1e3 * np.array(rival.course.exposures_s), **style)
        gain.plot(lights, rival.course.gains_db, **style)
        told = np.array([np.nan if each is None else each for each in rival.course.values])
        mean = "" if rival.course.value is None else f": {rival.course.value:.3f}"
        value.plot(lights, told, **style, label=named(rival, program) + mean)
    ours = [np.nan if each is None else each for each in program.course.values]
    value.plot(
        lights, ours, color=_OURS, lw=2, marker="o", ms=3.5, label=f"program: {program.course.value:.3f}"
    )
    lacking = np.array(program.course.lacks_gain)
    if lacking.any():
        gain.plot(
            lights[lacking], np.array(program.course.gains_db)[lacking], "x", ms=7, mew=1.6, color=_GAIN,
            label="most gain reached: darker than metered",
        )  # fmt: skip
        gain.legend(fontsize=8, frameon=False, loc="best")
    time.set_yscale("log", base=2)
    time.set_xscale("log", base=2)
    _ticks(time, lights)
    time.set_ylabel("Exposure time / ms", fontsize=9)
    gain.set_ylabel("Gain / dB", fontsize=9)
    value.set_ylabel(title.split(": ")[-1], fontsize=9)
    value.set_xlabel("Light on the scene / lux", fontsize=9)
    time.legend(fontsize=8, frameon=False, loc="lower left")
    value.legend(fontsize=8, frameon=False, loc="upper center", bbox_to_anchor=(0.5, -0.17), ncols=2)
    for axes in (time, gain, value):
        axes.grid(color="0.92", lw=0.6)
        axes.set_axisbelow(True)
        axes.tick_params(labelsize=8)
        axes.spines[["top", "right"]].set_visible(False)
    figure.suptitle(plain(title), fontsize=11, parse_math=False)
    return figure


def _mark_stages(
    time: Axes, gain: Axes, program: Program, metering: Metering, lights: np.typing.NDArray[np.float64]
) -> None:
    """A numbered line where a stage begins."""
    unity = metering.total_s(1.0)
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


def _ticks(axes: Axes, lights: np.typing.NDArray[np.float64]) -> None:
    from matplotlib.ticker import FuncFormatter, LogLocator

    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(LogLocator(base=2, numticks=12))
        axis.set_major_formatter(FuncFormatter(lambda value, place: f"{value:.4g}"))
