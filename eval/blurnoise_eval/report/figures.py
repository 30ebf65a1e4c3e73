"""The figures of a run for print: curves and latency.

Every function takes the run and returns a matplotlib ``Figure``. Figures hold at most ``MAX_PANELS`` panels and
``MAX_LINES`` lines each and say so when they leave some out.
Domain: scores in the criterion's unit, exposures in s (drawn in ms), speeds in px/s, blur in px, latency in ms per
picture.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from operator import itemgetter
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import NullLocator

from blurnoise_eval.answers.exposure_window import WORKS
from blurnoise_eval.grid.axes import velocity_of
from blurnoise_eval.plots.annotate import short_text
from blurnoise_eval.plots.style import (
    COLOURS,
    MAX_LINES,
    line_colours,
    plain_numbers,
    say_only,
    small_multiples,
    spread,
    tidy,
)
from blurnoise_eval.report.run import Place, Point, Row, RunData
from blurnoise_eval.report.views import EXPOSURES, View, common_windows, joined, ticks, views
from blurnoise_eval.report.words import title_text
from blurnoise_eval.system.tables import finite

MAX_PANELS, MAX_COLUMNS = 12, 4
MAX_TICKS = 8  # of an axis whose tested values are its ticks
_BAR, _BAR_STEP = 0.05, 0.045  # of the first window below zero, and from bar to bar
_TICKS = (0, 0.2, 0.4, 0.6, 0.8, 1.0)
Panel = tuple[str, str, Place]  # model, group, places on the axes that have panels


def figures_of(data: RunData) -> dict[str, Callable[[RunData], Figure]]:
    """The figures of this run by file name: one for each view that is printed, and what stands beside them."""
    found: dict[str, Callable[[RunData], Figure]]
    found = {view.file: partial(score_curves, view=view) for view in views(data) if view.file}
    if len(timed(data)) > 1:
        found["latency_robustness.png"] = latency_robustness
    return found


def score_curves(data: RunData, view: View) -> Figure:
    """The score in one view: a panel per model, group and setting, a line per value of the view's lines.

    Over exposure, bars below zero are the window of each velocity, pale where the pictures cannot tell, thin over
    the intervals of its ends, with a tick at the recommended exposure; the shaded range is surely in the window of
    every velocity tested there.
    """
    held, lines = view.held(data), data.axes[view.lines]
    panels: dict[Panel, dict[int, list[Point]]] = {}
    grid_alone = view.along != EXPOSURES  # beside the grid, exposures refine the curves over exposure only
    for point in data.points:
        at = point.at
        if grid_alone and at[EXPOSURES] >= data.axes[EXPOSURES].count:
            continue
        if all(at[axis] == place for axis, place in held.items()):
            key = point.model, point.group, tuple(at[axis] for axis in view.panels)
            panels.setdefault(key, {}).setdefault(at[view.lines], []).append(point)
    keys, columns = _chosen(data, list(panels))
    cell = (3.5 if columns < MAX_COLUMNS else 3.0, 2.7)
    around = max(5.0, cell[0] * columns) + 0.4 - cell[0] * columns
    figure, grid = small_multiples(max(1, len(keys)), columns, cell, (around, 1.5), sharey=True)
    if not keys:
        say_only(grid[0], "No targets in these pictures.")
        return figure
    tested = sorted({at for key in keys for at in panels[key]})
    shown = spread(tested, MAX_LINES)
    colours = line_colours("plasma" if view.lines == EXPOSURES else "viridis", len(shown))
    style = "o" if not joined(data, view) else "-" if data.manifest.get("searched") else "o-"
    for key, axes in zip(keys, grid, strict=True):
        for place, colour in zip(shown, colours, strict=True):
            line = [(view.x(data, p.at), p.y, p.low, p.high) for p in panels[key].get(place, ())]
            _draw_line(axes, line, style, colour, lines.texts[place], bands=view.bands)
        _frame(data, view, axes, key, max(point.n_targets for line in panels[key].values() for point in line))
        if view.along == EXPOSURES:
            _draw_windows(data, view, axes, key, dict(zip(shown, colours, strict=True)))
    texts = [data.axes[axis].texts[place] for axis, place in held.items() if data.axes[axis].count > 1]
    notes = [f"Held: {' · '.join(texts)}."] * bool(texts)
    for what, count, of in (("panels", len(keys), len(panels)), ("lines", len(shown), len(tested))):
        notes += [f"{count} of {of} {what} shown."] * (count < of)
    handles, title = grid[0].get_legend_handles_labels()[0], lines.axis.title
    if view.along == EXPOSURES:
        handles.append(Patch(color="0.5", alpha=0.2, label="surely in the window at every speed"))
        title += "; tick: the recommended exposure"
    figure.supxlabel("\n".join([view.title, *notes, view.reading]), fontsize=9)
    figure.supylabel(f"{title_text(data.criterion)} (dashed: the threshold)", fontsize=9)
    columns = min(len(handles), 3 if len(keys) == 1 else 6)
    figure.legend(
        handles=handles, title=title, loc="outside upper center", fontsize=8, ncols=columns, frameon=False
    )
    return figure


def _draw_line(
    axes: Axes, line: Sequence[Sequence[Any]], style: str, colour: str, label: str, *, bands: bool = True
) -> None:
    """Draw (x, y, low, high), with the intervals, where there are any, as a band or as bars."""
    line = sorted(line, key=itemgetter(0))
    axes.plot([p[0] for p in line], [p[1] for p in line], style, color=colour, ms=3.2, lw=1.4, label=label)
    if bounded := [p for p in line if None not in p]:
        x, _, low, high = zip(*bounded, strict=True)
        if bands:
            axes.fill_between(x, low, high, color=colour, alpha=0.16, lw=0)
        else:
            axes.vlines(x, low, high, color=colour, alpha=0.45, lw=0.8)


def _chosen(data: RunData, every: Sequence[Panel]) -> tuple[list[Panel], int]:
    """At most ``MAX_PANELS`` panels, a row for a model and one of the largest groups; how many stand in a row."""
    settings = spread(sorted({key[2] for key in every}), MAX_COLUMNS)
    known = {key[:2] for key in every}
    rows = [(name, group) for group in data.largest_groups(MAX_PANELS) for name in data.model_names]
    rows = [row for row in rows if row in known][: MAX_PANELS // max(1, len(settings))]
    rows.sort(key=lambda row: data.model_names.index(row[0]))
    keys = [(*row, setting) for row in rows for setting in settings if (*row, setting) in every]
    return keys, len(settings) if len(settings) > 1 else min(3, max(1, len(keys)))


def _frame(data: RunData, view: View, axes: Axes, key: Panel, n_targets: int) -> None:
    """Title, scales and level of one panel."""
    model, group, at = key
    texts = [data.axes[axis].texts[place] for axis, place in zip(view.panels, at, strict=True)]
    lines = [short_text(model, 36)] * (len(data.model_names) > 1)
    lines += [short_text(group, 36), f"{' · '.join([*texts, f'n = {n_targets}'])}"]
    tidy(axes, title="\n".join(lines))
    axes.set_ylim(-0.03, 1.03 * data.highest)
    axes.set_yticks(_TICKS)
    axes.axhline(data.criterion.level, color="0.25", lw=0.9, ls=(0, (4, 3)), zorder=1)
    if view.scale == "symlog":
        axes.set_xscale("symlog", linthresh=1)
        plain_numbers(axes.xaxis)
        axes.set_xlim(left=-0.08)
    elif (shown := ticks(data, view, MAX_TICKS)) is not None:
        axes.set_xscale(view.scale)
        axes.set_xticks([x for x, _ in shown], [text for _, text in shown])
    elif view.scale == "log":
        low, high = (1e3 * end(data.axes[EXPOSURES].values) for end in (min, max))
        axes.set_xscale("log")
        axes.set_xlim(low / 1.15, high * 1.15)
        plain_numbers(axes.xaxis, digits=(1, 2, 5) if high / low < 30 else (1, 3))
    axes.xaxis.set_minor_locator(NullLocator())


def _draw_windows(data: RunData, view: View, axes: Axes, key: Panel, colours: dict[int, str]) -> None:
    answers = [
        (place, answer)
        for answer in data.answers
        if (answer["model"], answer["group"]) == key[:2]
        for _, place, *setting in [data.at(answer, None, velocity_of(answer))]
        if tuple(setting) == key[2]
    ]
    for first, last in common_windows([answer["sure_windows_s"] for _, answer in answers]):
        axes.axvspan(1e3 * first, 1e3 * last, color="0.5", alpha=0.13, lw=0)
    for place, answer in answers:
        if place not in colours:
            continue
        y, colour = -_BAR - _BAR_STEP * list(colours).index(place), colours[place]
        first, last = answer["exposures_s"][0], answer["exposures_s"][-1]
        alpha = 0.75 if answer["verdict"] == WORKS else 0.25
        for low, high in answer["windows_s"]:
            axes.plot([1e3 * low, 1e3 * high], [y, y], color=colour, lw=3, alpha=alpha, solid_capstyle="butt")
        for low, high in (*answer["windows_low_s"], *answer["windows_high_s"]):
            if low is not None or high is not None:
                ends = first if low is None else low, last if high is None else high
                axes.plot([1e3 * end for end in ends], [y, y], color=colour, lw=1)
        if answer["recommended_s"] is not None:
            axes.plot(1e3 * answer["recommended_s"], y, "|", color="black", ms=6, mew=1.3)
    axes.set_ylim(bottom=-0.07 - _BAR_STEP * len(colours))


def pareto_front(points: Sequence[tuple[float, float]]) -> list[bool]:
    """For each (cost, gain), whether no other point costs no more, gains no less and betters it in one of both."""
    return [
        not any(c <= cost and g >= gain and (c, g) != (cost, gain) for c, g in points)
        for cost, gain in points
    ]


def timed(data: RunData) -> list[Row]:
    """The models that have both a latency and an mPC."""
    return [row for row in data.models if None not in (finite(row["latency_ms"]), finite(row["mpc"]))]


def latency_robustness(data: RunData) -> Figure:
    """mPC with its interval against the median latency per picture.

    Filled points, joined, are the Pareto front: no other model is faster and as robust, or as fast and more
    robust.
    """
    figure, (axes,) = small_multiples(1, 1, (6.0, 4.0), (0.0, 0.0))
    points = [(row["latency_ms"], row["mpc"]) for row in timed(data)]
    best = pareto_front(points)
    front = sorted(point for point, is_best in zip(points, best, strict=True) if is_best)
    axes.plot(*zip(*front, strict=True), "-", color="0.7", lw=1)
    for row, at, is_best in zip(timed(data), points, best, strict=True):
        colour = COLOURS[0] if is_best else "0.45"
        low, high = (finite(row.get(f"mpc_{end}")) for end in ("low", "high"))
        if low is not None and high is not None:
            axes.vlines(at[0], low, high, color=colour, lw=1, alpha=0.6)
        axes.plot(*at, "o", color=colour, mfc=colour if is_best else "white", ms=6)
        name = short_text(row["model"], 28)
        axes.annotate(name, at, (5, 6), fontsize=8, textcoords="offset points", parse_math=False)
    label = "Median latency of one picture / ms; filled: Pareto front"
    tidy(axes, x=label, y="mPC, with its 95 % interval")
    axes.margins(0.2)
    axes.set_xlim(left=0)
    return figure
