"""The figures of a run for print: the score in each view of the page.

Figures hold at most ``MAX_PANELS`` panels and ``MAX_LINES`` lines each and say so when they leave some out.
Domain: as of :mod:`.charts`, whose numbers they draw.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from operator import itemgetter
from textwrap import wrap
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import NullLocator

from blurnoise_eval.plots.annotate import short_text
from blurnoise_eval.plots.style import (
    MAX_LINES,
    legend_above,
    plain_numbers,
    say_only,
    small_multiples,
    spread,
    tidy,
)
from blurnoise_eval.report.charts import EXPOSURES, VELOCITIES, Row, x_of
from blurnoise_eval.report.run import RunData

MAX_PANELS, MAX_COLUMNS = 12, 4
_BAR, _BAR_STEP = 0.05, 0.045  # of the first window below zero, and from bar to bar
_LETTERS_PER_INCH = 12  # of a caption
_LINE_IN = 0.15  # height of a line of 9 points
_TICKS = (0, 0.2, 0.4, 0.6, 0.8, 1.0)
Panel = tuple[int, int, tuple[int, ...]]  # model, group, places on the axes that have panels


def figures_of(data: RunData, groups: Sequence[str], numbers: Row) -> dict[str, Callable[[], Figure]]:
    """The figures of this run by file name, one for each view."""
    return {view["file"]: partial(score_curves, data, groups, numbers, view) for view in numbers["views"]}


def score_curves(data: RunData, groups: Sequence[str], numbers: Row, view: Row) -> Figure:
    """The score in one view: a panel per model, group and setting, a line per value of the view's lines.

    Over exposure, bars below zero are the window of each velocity, pale where the pictures cannot tell, thin over
    the intervals of its ends, with a tick at the recommended exposure; the shaded range is surely in the window of
    every velocity tested there.
    """
    tested = numbers["axes"]
    drawn = {view["along"], view["lines"], *view["panels"]}
    held = {axis: each["count"] // 2 for axis, each in enumerate(tested) if axis not in drawn}
    of_grid = tested[EXPOSURES]["count"]  # exposures beyond it refine the curves over exposure only
    panels: dict[Panel, dict[int, list[Any]]] = {}
    for measure, model, group, _, rows in numbers["series"]:
        for place, *values in rows if measure == 0 else ():
            at = numbers["conditions"][place]
            if view["along"] != EXPOSURES and at[EXPOSURES] >= of_grid:
                continue
            if all(at[axis] == middle for axis, middle in held.items()):
                key = model, group, tuple(at[axis] for axis in view["panels"])
                line = panels.setdefault(key, {}).setdefault(at[view["lines"]], [])
                line.append((x_of(view, tested, at), *values))
    keys, columns = _chosen(list(panels))
    cell = (3.5 if columns < MAX_COLUMNS else 3.0, 2.7)
    around = max(5.0, cell[0] * columns) + 0.4 - cell[0] * columns
    figure, grid = small_multiples(max(1, len(keys)), columns, cell, (around, 1.5), sharey=True)
    if not keys:
        say_only(grid[0], "No targets in these pictures.")
        return figure
    every = sorted({at for key in keys for at in panels[key]})
    shown, of_lines = spread(every, MAX_LINES), tested[view["lines"]]
    colours = {place: of_lines["colours"][place] for place in shown}
    style = "o" if not view["joined"] else "-" if data.manifest.get("predicted") else "o-"
    lowest = -0.03
    if view["along"] == EXPOSURES:
        lowest = -0.07 - _BAR_STEP * len(colours)
    # Once, for all panels share it.
    grid[0].set_ylim(lowest, 1.03 * numbers["measures"][0]["most"])
    grid[0].set_yticks(_TICKS)
    for key, axes in zip(keys, grid, strict=True):
        for place, colour in colours.items():
            line = sorted(panels[key].get(place, ()), key=itemgetter(0))
            _draw_line(axes, line, style, colour, of_lines["texts"][place], bands=view["bands"])
        model, group, at = key
        texts = [tested[axis]["short"][place] for axis, place in zip(view["panels"], at, strict=True)]
        n_targets = max(point[-1] for line in panels[key].values() for point in line)
        titles = [short_text(data.model_names[model], 36)] * (len(data.model_names) > 1)
        titles += [short_text(groups[group], 36), " · ".join([*texts, f"n = {n_targets}"])]
        _frame(axes, view, numbers, "\n".join(titles))
        if view["along"] == EXPOSURES:
            _draw_windows(axes, numbers, key, colours)
    texts = [tested[axis]["texts"][place] for axis, place in held.items() if tested[axis]["count"] > 1]
    notes = [f"At {' · '.join(texts)}."] * bool(texts)
    width = int(_LETTERS_PER_INCH * figure.get_size_inches()[0])
    for index, axis in enumerate(view["panels"]):
        drawn_there = sorted({key[2][index] for key in keys})
        long, short = ([tested[axis][form][place] for place in drawn_there] for form in ("texts", "short"))
        notes += wrap(f"{'; '.join(long)}.", width) * (long != short)
    known = {answer.group for answer in data.answers}
    parts = ("groups of targets", len(groups), len(known)), ("panels", len(keys), len(panels))
    for what, count, of in (*parts, ("lines", len(shown), len(every))):
        notes += [f"{count} of {of} {what} shown."] * (count < of)
    handles, title = grid[0].get_legend_handles_labels()[0], of_lines["word"].capitalize()
    if view["along"] == EXPOSURES:
        handles.append(Patch(color="0.5", alpha=0.2, label="works at every speed"))
    reading = wrap(view["reading"], width)
    caption, across = [view["title"], *notes, *reading], 3 if len(keys) == 1 else 6
    figure.supxlabel("\n".join(caption), fontsize=9)
    figure.supylabel(f"{numbers['measures'][0]['name']} (dashed: the criterion)", fontsize=9)
    legend_above(figure, handles, title, across)
    _make_room(figure, (-(-len(keys) // columns), columns), cell[1], len(caption), -(-len(handles) // across))
    return figure


def _make_room(
    figure: Figure, panels: tuple[int, int], panel_in: float, caption_lines: int, legend_rows: int
) -> None:
    """Set height and margins, in inches, by the lines of text. A constrained layout draws all panels twice more to
    measure these, which takes longer than to draw the figure."""
    (rows, columns), width = panels, float(figure.get_size_inches()[0])
    gap = 0.38 + _LINE_IN * (1 + max(axes.get_title().count("\n") for axes in figure.axes))
    above, below = gap + 0.05 + 0.18 * legend_rows, 0.4 + _LINE_IN * caption_lines
    height = above + below + rows * panel_in - gap
    figure.set_layout_engine(None)
    figure.set_figheight(height)
    wide, high = (width - 0.85 + 0.2) / columns - 0.2, panel_in - gap
    figure.subplots_adjust(
        0.7 / width, below / height, 1 - 0.15 / width, 1 - above / height, 0.2 / wide, gap / high
    )


def _draw_line(axes: Axes, line: Sequence[Any], style: str, colour: str, label: str, *, bands: bool) -> None:
    """Draw (x, y, low, high, count), with the intervals, where there are any, as a band or as bars."""
    axes.plot([p[0] for p in line], [p[1] for p in line], style, color=colour, ms=3.2, lw=1.4, label=label)
    if bounded := [p for p in line if None not in p]:
        x, _, low, high, _ = zip(*bounded, strict=True)
        if bands:
            axes.fill_between(x, low, high, color=colour, alpha=0.16, lw=0)
        else:
            axes.vlines(x, low, high, color=colour, alpha=0.45, lw=0.8)


def _chosen(every: Sequence[Panel]) -> tuple[list[Panel], int]:
    """At most ``MAX_PANELS`` panels, a row for a model and group; how many stand in a row."""
    settings = spread(sorted({key[2] for key in every}), MAX_COLUMNS)
    rows = sorted({key[:2] for key in every}, key=lambda row: row[::-1])
    rows = sorted(rows[: MAX_PANELS // max(1, len(settings))])
    keys = [(*row, setting) for row in rows for setting in settings if (*row, setting) in every]
    return keys, len(settings) if len(settings) > 1 else min(3, max(1, len(keys)))


def _frame(axes: Axes, view: Row, numbers: Row, title: str) -> None:
    """Title, scales and level of one panel."""
    tidy(axes, title=title)
    axes.axhline(numbers["threshold"], color="0.25", lw=0.9, ls=(0, (4, 3)), zorder=1)
    low, high = view["range"]
    if view["scale"] == "log":
        axes.set_xscale("log")
        low, high = 10**low, 10**high
        plain_numbers(axes.xaxis, digits=(1, 2, 5) if high / low < 40 else (1, 3))
    if view["ticks"] is not None:
        axes.set_xticks(*zip(*view["ticks"], strict=True))
    axes.set_xlim(low, high)
    axes.xaxis.set_minor_locator(NullLocator())


def _draw_windows(axes: Axes, numbers: Row, key: Panel, colours: dict[int, str]) -> None:
    of_panel = [row for row in numbers["windows"] if (row[0], row[1], tuple(row[2][2:])) == key]
    for first, last in common_windows([sure for *_, sure, _ in of_panel]):
        axes.axvspan(1e3 * first, 1e3 * last, color="0.5", alpha=0.13, lw=0)
    for *_, at, works, chosen_s, _, bars in of_panel:
        if at[VELOCITIES] not in colours:
            continue
        y = -_BAR - _BAR_STEP * list(colours).index(at[VELOCITIES])
        colour = colours[at[VELOCITIES]]
        for low, high, *bounds in bars:
            alpha = 0.75 if works else 0.25
            axes.plot([1e3 * low, 1e3 * high], [y, y], color=colour, lw=3, alpha=alpha, solid_capstyle="butt")
            for ends in bounds:
                if any(end is not None for end in ends):
                    axes.plot(_ends_ms(ends, numbers["axes"][EXPOSURES]["x"]), [y, y], color=colour, lw=1)
        if chosen_s is not None:
            axes.plot(1e3 * chosen_s, y, "|", color="black", ms=6, mew=1.3)


def _ends_ms(ends_s: Sequence[float | None], tested_ms: Sequence[float]) -> list[float]:
    """An interval up to the tested exposures where it has no end."""
    return [
        end(tested_ms) if each is None else 1e3 * each for each, end in zip(ends_s, (min, max), strict=True)
    ]


def common_windows(windows_s: Iterable[Sequence[Sequence[float]]]) -> list[tuple[float, float]]:
    """The ranges, in s, that lie inside a window of every list; empty where there is none."""
    first, *others = [[(low, high) for low, high in windows] for windows in windows_s] or [[]]
    for windows in others:
        overlaps = [(max(a, c), min(b, d)) for a, b in first for c, d in windows]
        first = [(low, high) for low, high in overlaps if low <= high]
    return first
