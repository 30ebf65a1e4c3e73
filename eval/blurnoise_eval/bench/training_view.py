"""Findings of the comparison of trainings, for the eye: curves of each arm, differences, tables, a page."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path
from textwrap import fill

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from rich.table import Table

from blurnoise.optics.radiometry import photoelectrons
from blurnoise_eval.bench.compared import FAILS, MOVING, THRESHOLD
from blurnoise_eval.bench.training import CAMERA, OURS, Bench, Difference
from blurnoise_eval.grid.conditions import Conditions
from blurnoise_eval.system.files import write_figure, write_whole

_COLOURS = ("#7a7a7a", "#d55e00", "#0072b2", "#009e73", "#cc79a7")
_GREY = "0.45"
_APART = 0.055  # of the axis: labels at the lines' ends stay legible
_NOTES = f"""\
AP50: COCO's average precision at an IoU of 0.5. mPC: its mean over all conditions but the clean one, each with
the same weight. Over blur: the mean from 0 to the longest blur, at {1e3 * MOVING[0]:g} ms and {MOVING[1]:g} lux
(area by trapezoids, divided by the range). At rest: the same over the logarithm of the exposure. Confidence: mean
over signs, 0 for a missed one. False positives: detections of at least {THRESHOLD:g}, per picture, that answer for
no sign. Fails: the blur from which the curve stays below {THRESHOLD:g}; ">" where it does not fail up to the longest
tested, which then stands in for it in the differences; "*" where it had been below before and come back.

Intervals: 95 %, Student's, over pictures (the same for every network, each left out in turn) and over seeds (of
each arm on its own), with the few degrees of freedom that few seeds leave. They leave out what all networks share:
the training scenes, the network's form, the simulator. About one interval in twenty misses the truth, so a single
small difference proves little.
"""


def chart(bench: Bench, part: str) -> Figure:
    """One set: AP50 over blur, over exposure in the darkest and the brightest light, and the differences."""
    facts = bench.sets[part]
    lights = facts["plan"]["grid"]["illuminance_lux"]
    exposure_s, lux = MOVING
    figure = Figure(figsize=(10.6, 8.0), layout="constrained")
    (moving, dark), (bright, differences) = figure.subplots(2, 2)
    _curves(
        moving, bench, part, lambda at: (at.exposure_s, at.illuminance_lux) == MOVING, lambda at: at.blur_px
    )
    moving.set_title(f"Moving: {1e3 * exposure_s:g} ms, {lux:g} lux", fontsize=10, loc="left")
    moving.set_xlabel("Motion blur / px", fontsize=9)
    for axes, light in ((dark, lights[0]), (bright, lights[-1])):
        _resting(axes, bench, part, light)
    _forest(differences, [d for d in bench.differences if d.part == part], bench.arms)
    figure.suptitle(
        f"One detector, {len(bench.arms)} trainings: {part}, {facts['pictures']} pictures, "
        f"{facts['targets']} signs. Lines: mean of {bench.seeds} seeds, bands: their range.",
        fontsize=11,
    )  # fmt: skip
    return figure


def write(bench: Bench, folder: Path) -> list[Path]:
    """Write training.md and a chart per set, training.png and training-SET.png; returns the charts' paths.

    Raises ``OSError`` where they cannot be written.
    """
    charts = []
    for part in bench.sets:
        charts.append(folder / _file(bench, part))
        write_figure(charts[-1], chart(bench, part), dpi=150)
    write_whole(folder / "training.md", page(bench).encode())
    return charts


def tables(bench: Bench) -> list[Table]:
    """A table per set of what the verdict speaks of, and failures: arms' values, differences with intervals."""
    made = []
    for part in bench.sets:
        rivals, differences = _differences(bench, part)
        table = Table(title=f"{part.capitalize()}; differences with 95 % intervals", title_justify="left")
        table.add_column("")
        for name in (*bench.arms, *(f"{OURS}\n- {rival}" for rival in rivals)):
            table.add_column(name, justify="right", no_wrap=True)
        for measure in _measured(bench, part):
            told = [differences[measure, rival] for rival in rivals]
            if measure in FAILS.values() or any(difference.measure.verdict for difference in told):
                values = [_value(bench, part, measure, arm) for arm in bench.arms]
                table.add_row(measure, *values, *(_difference(each, 2, "{}\n{} to {}") for each in told))
        made.append(table)
    return made


def page(bench: Bench) -> str:
    """Verdicts, tables with every interval, and what the words mean, as Markdown."""
    lines = ["# Does training with the exposure augmentation help?", ""]
    lines += [line for verdict in bench.verdicts() for line in (verdict, "")]
    for part, facts in bench.sets.items():
        rivals, differences = _differences(bench, part)
        heading = ["", *bench.arms, *(f"{OURS} - {rival}" for rival in rivals)]
        lines += [f"## {part.capitalize()}", ""]
        lines += [
            f"{facts['pictures']} pictures, {facts['targets']} signs, {bench.seeds} seeds per arm.",
            "",
        ]
        lines += [_line(heading), _line(["---"] + ["---:"] * (len(heading) - 1))]
        for measure in _measured(bench, part):
            values = [_value(bench, part, measure, arm, interval=True) for arm in bench.arms]
            told = [_difference(differences[measure, rival], 3, "{} ({} to {})") for rival in rivals]
            lines.append(_line([measure, *values, *told]))
        lines += ["", f"![Curves]({_file(bench, part)})", ""]
        if facts["unread"]:
            lines += [f"Could not be read: {', '.join(facts['unread'])}.", ""]
    lines += [
        _NOTES,
        f"Camera {CAMERA.name}; {bench.machine['processor']}, {bench.machine['threads']} threads.",
        "",
    ]
    return "\n".join(lines)


def _file(bench: Bench, part: str) -> str:
    return "training.png" if part == next(iter(bench.sets)) else f"training-{part}.png"


def _differences(bench: Bench, part: str) -> tuple[list[str], dict[tuple[str, str], Difference]]:
    """The rivals, and the differences of a set by measure and rival."""
    found = {(d.measure.name, d.rival): d for d in bench.differences if d.part == part}
    return list(dict.fromkeys(rival for _, rival in found)), found


def _measured(bench: Bench, part: str) -> list[str]:
    return list(dict.fromkeys(summary.measure for summary in bench.summaries if summary.part == part))


def _value(bench: Bench, part: str, measure: str, arm: str, *, interval: bool = False) -> str:
    value, low, high = bench.summary(part, measure, arm)
    if value is None:
        return "-"
    failure = bench.failure(part, measure, arm)
    text = f"{value:.3f}"
    if failure is not None:
        text = f"> {failure.longest_px:g}" if failure.at_px is None else f"{value:.1f}"
        text += "*" if failure.returned else ""
    if not interval or low is None or high is None:
        return text
    places = 3 if failure is None else 1
    return f"{text} ({low:.{places}f} to {high:.{places}f})"


def _difference(difference: Difference, places: int, shape: str) -> str:
    value, low, high = difference.estimate
    if value is None or low is None or high is None:
        return "-"
    if difference.measure.name in FAILS.values():
        places = 1
    return shape.format(*(f"{number:+.{places}f}" for number in (value, low, high)))


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _curves(
    axes: Axes,
    bench: Bench,
    part: str,
    shown: Callable[[Conditions], bool],
    x: Callable[[Conditions], float],
) -> None:
    """AP50 of each arm, its seeds' mean and range; each line is named at its end."""
    ends = {}
    for arm, colour in zip(bench.arms, _COLOURS, strict=False):
        rows = [row for row in bench.rows if (row.part, row.arm) == (part, arm)]
        along: dict[float, list[float]] = {}
        for row in rows:
            if row.at is not None and shown(row.at):
                along.setdefault(x(row.at), []).append(row.precision.ap50)
        where = sorted(along)
        mean = [float(np.mean(along[at])) for at in where]
        axes.fill_between(
            where, [min(along[at]) for at in where], [max(along[at]) for at in where], color=colour, alpha=0.18, lw=0
        )  # fmt: skip
        axes.plot(where, mean, "o-", color=colour, ms=4, lw=1.8)
        ends[arm] = (where[-1], mean[-1], colour)
    for arm, height in zip(ends, apart([value for _, value, _ in ends.values()]), strict=True):
        at, _, colour = ends[arm]
        axes.annotate(
            arm, (at, height), (8, 0), textcoords="offset points", color=colour, fontsize=9, va="center",
            fontweight="bold" if arm == OURS else "normal", annotation_clip=False,
        )  # fmt: skip
    axes.set_ylim(-0.02, 1.02)
    axes.set_ylabel("AP50", fontsize=9)
    axes.grid(color="0.92", lw=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=8)
    axes.spines[["top", "right"]].set_visible(False)


def apart(values: Sequence[float]) -> list[float]:
    """Heights for labels of these values in [0, 1], in their order, moved apart so that none covers another."""
    order = sorted(range(len(values)), key=lambda index: values[index])
    raised, lowered = list(values), list(values)
    for below, above in pairwise(order):
        raised[above] = max(raised[above], raised[below] + _APART)
    for above, below in pairwise(reversed(order)):
        lowered[below] = min(lowered[below], lowered[above] - _APART)
    heights = [(high + low) / 2 for high, low in zip(raised, lowered, strict=True)]
    ceiling = 1.0
    for index in reversed(order):
        heights[index] = min(heights[index], ceiling)
        ceiling = heights[index] - _APART
    return heights


def _resting(axes: Axes, bench: Bench, part: str, lux: float) -> None:
    """AP50 over exposure at rest in one light; exposures that saturate white are shaded."""
    _curves(
        axes, bench, part,
        lambda at: at.illuminance_lux == lux and at.blur_px == 0, lambda at: 1e3 * at.exposure_s,
    )  # fmt: skip
    axes.set_xscale("log")
    tested = [1e3 * exposure_s for exposure_s in bench.sets[part]["plan"]["grid"]["exposure_s"]]
    axes.set_xticks(tested, [f"{exposure_ms:g}" for exposure_ms in tested])
    axes.minorticks_off()
    axes.set_xlabel("Exposure / ms", fontsize=9)
    axes.set_title(f"At rest: {lux:g} lux", fontsize=10, loc="left")
    low, high = axes.get_xlim()
    full_ms = 1e3 * CAMERA.saturation_e / photoelectrons(CAMERA, lux, 1.0)
    if full_ms < high:
        axes.axvspan(max(full_ms, low), high, color="0.5", alpha=0.12, lw=0)
        axes.annotate(
            "white saturates", (max(full_ms, low), 0.02), (4, 0), textcoords="offset points", fontsize=8, color=_GREY
        )  # fmt: skip
        axes.set_xlim(low, high)


def _forest(axes: Axes, differences: Sequence[Difference], arms: Sequence[str]) -> None:
    """Differences of AP50 with their intervals; hollow where the interval holds 0."""
    shown = [d for d in differences if d.measure.verdict and d.measure.higher_is_better]
    names = list(dict.fromkeys(str(d.measure.verdict) for d in shown))
    rivals = list(dict.fromkeys(d.rival for d in shown))
    for difference in shown:
        value, low, high = difference.estimate
        if value is None or low is None or high is None:
            continue
        turn = rivals.index(difference.rival)
        y = names.index(str(difference.measure.verdict)) + 0.3 * (turn - (len(rivals) - 1) / 2)
        colour = _COLOURS[arms.index(difference.rival)]
        axes.plot([low, high], [y, y], color=colour, lw=2)
        sure = difference.outcome != "undecided"
        axes.plot(value, y, "o", ms=6, color=colour, mfc=colour if sure else "white")
    axes.axvline(0, color="0.25", lw=0.9)
    axes.set_yticks(range(len(names)), [fill(name, 16) for name in names], fontsize=8)
    axes.set_ylim(len(names) - 0.4, -0.6)
    axes.set_xlabel(f"Difference of AP50, 95 % interval; right of 0: {OURS} is better", fontsize=9)
    axes.set_title("Paired differences (hollow: may be chance)", fontsize=10, loc="left")
    handles = [
        Line2D([], [], color=_COLOURS[arms.index(rival)], marker="o", lw=2, label=f"{OURS} - {rival}")
        for rival in rivals
    ]
    if handles:
        axes.legend(handles=handles, fontsize=8, frameon=False, loc="best")
    axes.grid(axis="x", color="0.92", lw=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=8)
    axes.spines[["top", "right"]].set_visible(False)
