"""The figures of a run: confidence against exposure, blur and speed, and example pictures with boxes.

Domain: confidences in [0, 1], exposures in s (drawn in ms), light in lux, speeds in px/s, boxes in px of
the picture. Every function takes the run and returns a matplotlib ``Figure``; none keeps global state.
Figures hold at most ``MAX_PANELS`` panels and ``MAX_LINES`` lines each and say so when they leave some out.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from blurnoise_eval.pictures import (
    OTHER_SCORE,
    condition_text,
    drawn_example,
    exposure_text,
    outcome_text,
    short_text,
    velocity_of,
    velocity_text,
)

if TYPE_CHECKING:
    from blurnoise_eval.report import RunData

MAX_PANELS = 12
MAX_COLUMNS = 4
MAX_LINES = 10
MAX_EXAMPLES = 12
T = TypeVar("T", bound=Hashable)


class Point(NamedTuple):
    """Mean confidence of one target group in one condition, with its 95 % interval where there is one."""

    group: str
    illuminance_lux: float
    velocity_px_s: tuple[float, float]
    exposure_s: float
    blur_px: float | None
    confidence: float
    low: float | None
    high: float | None
    n_targets: int

    @property
    def speed_px_s(self) -> float:
        """Length of the velocity."""
        return math.hypot(*self.velocity_px_s)


def points(data: RunData) -> list[Point]:
    """The measured points of all answers, blur looked up in the cells; none where nothing was measured."""
    blurs = {
        (cell["exposure_s"], cell["velocity_x_px_s"], cell["velocity_y_px_s"]): cell["blur_px"]
        for cell in data.cells
        if not cell["clean"]
    }
    found = []
    for answer in data.answers:
        velocity = velocity_of(answer)
        unknown = [None] * len(answer["exposures_s"])
        means = answer["exposures_s"], answer["confidence"]
        bounds = answer["low"] or unknown, answer["high"] or unknown
        for exposure_s, confidence, low, high in zip(*means, *bounds, strict=True):
            if (mean := _finite(confidence)) is None:
                continue
            blur = _finite(blurs.get((exposure_s, *velocity)))
            where = (answer["group"], answer["illuminance_lux"], velocity, exposure_s, blur)
            found.append(Point(*where, mean, _finite(low), _finite(high), answer["n_targets"]))
    return found


def confidence_exposure(data: RunData) -> Figure:
    """Confidence against exposure on a log axis: one panel per group and light, one line per velocity.

    Bars below zero are the exposure window of each velocity, with a tick at the recommended exposure; the
    shaded range is in the window of every velocity tested there.
    """
    figure, panels, notes = _panels(data)
    measured = points(data)
    shown = spread(sorted({point.velocity_px_s for point in measured}, key=_by_speed), MAX_LINES)
    colours = line_colours("viridis", len(shown))
    for (group, lux), axes in panels.items():
        answers = [a for a in data.answers if (a["group"], a["illuminance_lux"]) == (group, lux)]
        for low, high in common_windows([answer["windows_s"] for answer in answers]):
            axes.axvspan(1e3 * low, 1e3 * high, color="0.5", alpha=0.13, lw=0)
        for row, (velocity, colour) in enumerate(zip(shown, colours, strict=True)):
            line = [p for p in measured if p[:3] == (group, lux, velocity)]
            _draw_line(axes, [1e3 * p.exposure_s for p in line], line, colour, velocity_text(velocity))
            for answer in (a for a in answers if velocity_of(a) == velocity):
                _draw_window(axes, answer, -0.05 - 0.045 * row, colour)
        axes.set_ylim(-0.07 - 0.045 * len(shown), 1.03)
        _exposure_axis(axes, [p.exposure_s for p in measured])
    entries = [Patch(color="0.5", alpha=0.2, label="window at every speed")] if panels else []
    labels = "Speed; bars: exposure window, tick: recommended"
    return _finish(figure, panels, "Exposure / ms", labels, notes + _left_out(shown, measured, 2), entries)


def confidence_blur(data: RunData) -> Figure:
    """Confidence against motion blur in px: one panel per group and light, one line per exposure."""
    figure, panels, notes = _panels(data)
    notes.append(
        "Along a line only the speed changes; from one line to the next the light per picture changes too."
    )
    notes += _draw_exposure_lines(data, panels, [(p, p.blur_px) for p in points(data)])
    for axes in panels.values():
        axes.set_xscale("symlog", linthresh=1)
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axes.set_xlim(left=-0.08)
    return _finish(
        figure, panels, "Motion blur / px (linear below 1 px, logarithmic above)", "Exposure", notes
    )


def confidence_speed(data: RunData) -> Figure:
    """Confidence against speed in px/s: one panel per group and light, one line per exposure."""
    figure, panels, notes = _panels(data)
    notes += _draw_exposure_lines(data, panels, [(p, p.speed_px_s) for p in points(data)])
    return _finish(figure, panels, "Speed / (px/s)", "Exposure", notes)


def contact_sheet(data: RunData) -> Figure:
    """Example pictures with their boxes: green found, dashed orange missed, thin blue other detections."""
    threshold = data.manifest["threshold"]
    chosen = spread(range(len(data.examples)), MAX_EXAMPLES)
    drawn = [drawn_example(data.examples[index], 640, threshold) for index in chosen]
    columns = min(MAX_COLUMNS, max(1, len(chosen)))
    rows = max(1, math.ceil(len(chosen) / columns))
    tallest = max(
        (picture.shape[0] / picture.shape[1] for picture in drawn if picture is not None), default=0.7
    )
    figure = Figure(figsize=(3.4 * columns + 0.2, (3.4 * tallest + 0.5) * rows + 0.4), layout="constrained")
    grid = list(figure.subplots(rows, columns, squeeze=False).flat)
    for axes in grid:
        axes.set_axis_off()
    for axes, index, picture in zip(grid, chosen, drawn, strict=False):
        if picture is None:
            axes.text(0.5, 0.5, "picture file is missing", ha="center", transform=axes.transAxes)
        else:
            axes.imshow(picture, interpolation="antialiased")
        example = data.examples[index]
        axes.set_title(f"{condition_text(example)}\n{outcome_text(example, threshold)}", fontsize=8)
    legend = (
        f"green: target at or above {threshold:g}; dashed orange: target below; "
        f"thin blue: other detections from {OTHER_SCORE:g}"
    )
    if len(chosen) < len(data.examples):
        legend += f". {len(chosen)} of {len(data.examples)} examples shown"
    figure.supxlabel(legend if chosen else "No example pictures were kept.", fontsize=9)
    return figure


def spread(values: Iterable[T], count: int) -> list[T]:
    """At most ``count`` of the values, evenly spread, the first and the last among them."""
    every = list(values)
    if len(every) <= count:
        return every
    return [every[round(i)] for i in np.linspace(0, len(every) - 1, count)]


def largest_groups(data: RunData, count: int) -> list[str]:
    """At most ``count`` target groups, those with most targets, in the order of the answers."""
    sizes: dict[str, int] = {}
    for answer in data.answers:
        sizes[answer["group"]] = max(sizes.get(answer["group"], 0), answer["n_targets"])
    kept = set(sorted(sizes, key=lambda group: -sizes[group])[:count])
    return [group for group in sizes if group in kept]


def common_windows(windows_s: Sequence[Sequence[Sequence[float]]]) -> list[tuple[float, float]]:
    """The ranges, in s, that lie inside a window of every list; empty where there is none."""
    if not windows_s:
        return []
    common = [(low, high) for low, high in windows_s[0]]
    for windows in windows_s[1:]:
        overlaps = [(max(a, c), min(b, d)) for a, b in common for c, d in windows]
        common = [(low, high) for low, high in overlaps if low <= high]
    return common


def line_colours(name: str, count: int) -> list[str]:
    """``count`` hex colours from dark to bright of a perceptually even map, its brightest sixth left out."""
    even = matplotlib.colormaps[name](np.linspace(0, 0.84, count) if count > 1 else [0.35])
    return [str(matplotlib.colors.to_hex(colour)) for colour in even]


def _panels(data: RunData) -> tuple[Figure, dict[tuple[str, float], Axes], list[str]]:
    """An empty figure, its axes by (group, lux), and what was left out."""
    lights = sorted({answer["illuminance_lux"] for answer in data.answers})
    shown_lights = spread(lights, MAX_COLUMNS)
    groups = largest_groups(data, MAX_PANELS // max(1, len(shown_lights)))
    keys = [(group, lux) for group in groups for lux in shown_lights]
    columns = len(shown_lights) if len(shown_lights) > 1 else min(3, max(1, len(keys)))
    rows = max(1, math.ceil(len(keys) / columns))
    figure = Figure(figsize=(max(5.0, 3.5 * columns) + 0.4, 2.7 * rows + 1.5), layout="constrained")
    grid = list(figure.subplots(rows, columns, squeeze=False, sharey=True).flat)
    for axes in grid[len(keys) :]:
        axes.set_axis_off()
    if not keys:
        grid[0].text(0.5, 0.5, "No targets in these pictures.", ha="center", transform=grid[0].transAxes)
    every_group = len({answer["group"] for answer in data.answers})
    notes = []
    if len(groups) < every_group:
        notes.append(f"{len(groups)} of {every_group} target groups shown (those with most targets).")
    if len(shown_lights) < len(lights):
        notes.append(f"{len(shown_lights)} of {len(lights)} light levels shown.")
    panels = dict(zip(keys, grid, strict=False))
    for (group, lux), axes in panels.items():
        n_targets = max(a["n_targets"] for a in data.answers if a["group"] == group)
        axes.set_title(
            f"{short_text(group, 24)}, {lux:g} lux (n = {n_targets})", fontsize=9, parse_math=False
        )
        axes.axhline(data.manifest["threshold"], color="0.25", lw=0.9, ls=(0, (4, 3)), zorder=1)
        axes.set_ylim(-0.03, 1.03)
        axes.set_yticks([0, 0.2, 0.4, 0.6, 0.8, 1.0])
        axes.grid(color="0.9", lw=0.6)
        axes.set_axisbelow(True)
        axes.tick_params(labelsize=8)
        axes.spines[["top", "right"]].set_visible(False)
    return figure, panels, notes


def _draw_exposure_lines(
    data: RunData, panels: dict[tuple[str, float], Axes], placed: list[tuple[Point, float | None]]
) -> list[str]:
    """One line per exposure over the given abscissae; lines only where speeds share no two directions."""
    measured = [point for point, _ in placed]
    shown = spread(sorted({point.exposure_s for point in measured}), MAX_LINES)
    joined = one_velocity_per_speed(measured)
    for (group, lux), axes in panels.items():
        for exposure_s, colour in zip(shown, line_colours("plasma", len(shown)), strict=True):
            line = sorted(
                (
                    (x, p)
                    for p, x in placed
                    if x is not None and p[:2] == (group, lux) and p.exposure_s == exposure_s
                ),
                key=lambda pair: pair[0],
            )
            where, what = [x for x, _ in line], [p for _, p in line]
            _draw_line(axes, where, what, colour, exposure_text(exposure_s), band=False, joined=joined)
    return _left_out(shown, measured, 3)


def one_velocity_per_speed(measured: Sequence[Point]) -> bool:
    """Whether no two velocities share a speed, so that a line over speed is one line."""
    velocities = {point.velocity_px_s for point in measured}
    return len(velocities) == len({math.hypot(*velocity) for velocity in velocities})


def _draw_line(
    axes: Axes,
    x: list[float],
    line: list[Point],
    colour: str,
    label: str,
    band: bool = True,
    joined: bool = True,
) -> None:
    axes.plot(
        x, [p.confidence for p in line], "o-" if joined else "o", color=colour, ms=3.2, lw=1.4, label=label
    )
    bounded = [(at, p.low, p.high) for at, p in zip(x, line, strict=True) if None not in (p.low, p.high)]
    if band and bounded:
        at, low, high = zip(*bounded, strict=True)
        axes.fill_between(at, low, high, color=colour, alpha=0.16, lw=0)


def _draw_window(axes: Axes, answer: dict[str, Any], y: float, colour: str) -> None:
    for low, high in answer["windows_s"]:
        axes.plot([1e3 * low, 1e3 * high], [y, y], color=colour, lw=3, alpha=0.75, solid_capstyle="butt")
    if answer["recommended_s"] is not None:
        axes.plot(1e3 * answer["recommended_s"], y, "|", color="black", ms=6, mew=1.3)


def _exposure_axis(axes: Axes, exposures_s: Sequence[float]) -> None:
    axes.set_xscale("log")
    axes.set_xlim(1e3 * min(exposures_s) / 1.15, 1e3 * max(exposures_s) * 1.15)
    narrow = max(exposures_s) / min(exposures_s) < 30
    axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5) if narrow else (1, 3)))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())


def _finish(
    figure: Figure,
    panels: dict[tuple[str, float], Axes],
    x_label: str,
    legend_title: str,
    notes: list[str],
    entries: Sequence[Patch] = (),
) -> Figure:
    figure.supxlabel("\n".join([x_label, *notes]) if panels else "", fontsize=9)
    if panels:
        figure.supylabel("Mean confidence (dashed: threshold)", fontsize=9)
        handles, _ = next(iter(panels.values())).get_legend_handles_labels()
        every = [*handles, *entries]
        figure.legend(
            handles=every, title=legend_title, loc="outside upper center", fontsize=8, title_fontsize=8,
            ncols=min(len(every), 3 if len(panels) == 1 else 6), frameon=False,
        )  # fmt: skip
    return figure


def _left_out(shown: Sequence[Any], measured: Sequence[Point], column: int) -> list[str]:
    every = {point[column] for point in measured}
    what = {2: "velocities", 3: "exposures"}[column]
    return [f"{len(shown)} of {len(every)} {what} shown."] if len(shown) < len(every) else []


def _by_speed(velocity_px_s: tuple[float, float]) -> tuple[float, tuple[float, float]]:
    return math.hypot(*velocity_px_s), velocity_px_s


def _finite(value: float | None) -> float | None:
    return float(value) if value is not None and math.isfinite(value) else None
