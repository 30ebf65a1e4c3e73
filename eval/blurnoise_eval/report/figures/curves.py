"""Mean confidence against exposure (ms, logarithmic), motion blur (px), speed (px/s) and what else varies."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, LogLocator, MultipleLocator, NullFormatter

from blurnoise_eval.grid.axes import EXPOSURE, MOVES, SPEED, Axis, velocity_of, velocity_text
from blurnoise_eval.report.data import RunData, by_speed
from blurnoise_eval.report.figures.panels import MAX_LINES, Key, Panels, panels
from blurnoise_eval.report.measured import (
    Point,
    common_windows,
    line_colours,
    one_velocity_per_speed,
    points,
    spread,
)
from blurnoise_eval.report.settings import Settings, axis_label
from blurnoise_eval.report.words import WORKS

MOVE_COLOURS = ("0.25", "#c23b22", "#1f77b4")  # all, targets, background
MOVE_LABELS = (
    "all of the picture moves",
    "targets move, the background is still",
    "the camera tracks the targets: the background moves",
)
_APART, _HIGHEST = 0.018, 1.5  # bars side by side, of the axis; intervals beyond that are cut off
MOST_EXPOSURES = 3  # side by side
MOST_OF_MOVES = 9  # panels: of several models the largest group, of one model three
MAX_TICKS = 8  # of an axis whose tested values are its ticks


def confidence_exposure(data: RunData) -> Figure:
    """Confidence against exposure on a log axis: one panel per model, group and setting, one line per velocity.

    Bars below zero are the exposure window of each velocity, pale where the pictures cannot tell, thin over the
    intervals of its ends, with a tick at the recommended exposure; the shaded range is surely in the window of every
    velocity tested there.
    """
    grid, measured = panels(data, data.settings), points(data)
    velocities = sorted({point.velocity_px_s for point in measured}, key=by_speed)
    shown = spread(velocities, MAX_LINES)
    colours = line_colours("viridis", len(shown))
    for key, axes in grid:
        answers = [a for a in data.answers if (a["model"], a["group"], data.settings.of(a)) == key]
        for low, high in common_windows([answer["sure_windows_s"] for answer in answers]):
            axes.axvspan(1e3 * low, 1e3 * high, color="0.5", alpha=0.13, lw=0)
        for row, (velocity, colour) in enumerate(zip(shown, colours, strict=True)):
            line = [p for p in measured if p[:4] == (*key, velocity)]
            x = [1e3 * p.exposure_s for p in line]
            _draw_line(axes, x, line, colour, velocity_text(velocity), _style(data))
            for answer in (a for a in answers if velocity_of(a) == velocity):
                _draw_window(axes, answer, -0.05 - 0.045 * row, colour)
        axes.set_ylim(-0.07 - 0.045 * len(shown), 1.03 * data.highest)
        _exposure_axis(axes, [p.exposure_s for p in measured])
    return grid.finish(
        axis_label(EXPOSURE),
        "Speed; bars: exposure window (pale: cannot tell; thin: its ends' intervals), tick: recommended",
        _left_out(shown, velocities, "velocities"),
        [Patch(color="0.5", alpha=0.2, label="surely in the window at every speed")],
    )


def confidence_blur(data: RunData) -> Figure:
    """Confidence against motion blur in px: one panel per model, group and setting, one line per exposure."""
    grid = panels(data, data.settings)
    notes = [
        "Along a line only the speed changes; from one line to the next the light per picture changes too."
    ]
    notes += _draw_exposure_lines(data, grid, points(data), lambda point: point.blur_px)
    for _, axes in grid:
        axes.set_xscale("symlog", linthresh=1)
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axes.set_xlim(left=-0.08)
    return grid.finish("Motion blur / px (linear below 1 px, logarithmic above)", "Exposure", notes)


def confidence_speed(data: RunData) -> Figure:
    """Confidence against speed in px/s: one panel per model, group and setting, one line per exposure."""
    grid = panels(data, data.settings)
    notes = _draw_exposure_lines(data, grid, points(data), lambda point: point.speed_px_s)
    return grid.finish(axis_label(SPEED), "Exposure", notes)


def confidence_axis(data: RunData, axis: Axis) -> Figure:
    """Confidence against an axis of the settings, at the middle velocity: one line per exposure.

    One panel per model, group and setting of the other axes.
    """
    settings, place = data.settings.without(axis), data.settings.axes.index(axis)
    grid, velocities = panels(data, settings), data.velocities_px_s
    velocity = velocities[len(velocities) // 2]
    notes = (
        [f"At {velocity_text(velocity)}, one of {len(velocities)} velocities."] if len(velocities) > 1 else []
    )
    notes += _draw_exposure_lines(
        data,
        grid,
        [point for point in points(data) if point.velocity_px_s == velocity],
        lambda point: axis.shown(point.setting[place]),
        lambda point: (point.model, point.group, point.setting[:place] + point.setting[place + 1 :]),
    )
    values = [axis.shown(value) for value in data.settings.values(axis)]
    for _, axes in grid:
        if axis.logarithmic and values[0] > 0:
            axes.set_xscale("log")
            axes.xaxis.set_minor_formatter(NullFormatter())
        axes.set_xticks(spread(values, MAX_TICKS))
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    return grid.finish(axis_label(axis), "Exposure", notes)


def score_moves(data: RunData) -> Figure:
    """The score against speed, a line with its intervals for each of what moves: one panel per model, group and
    exposure, under the brightest light; a row for each model where there are several."""
    place, others = data.settings.axes.index(MOVES), data.settings.without(MOVES)
    exposures = spread(data.exposures_s, MOST_EXPOSURES)
    settings = Settings(
        (*others.axes, EXPOSURE), tuple((*others.every[-1], at) for at in exposures), others.held
    )
    grid, measured = panels(data, settings, MOST_OF_MOVES), points(data)
    style = _style(data) if one_velocity_per_speed(data.velocities_px_s) else "o"
    apart = _APART * max(point.speed_px_s for point in measured)
    highest = data.highest
    for (model, group, setting), axes in grid:
        *rest, exposure_s = setting
        for value in data.settings.values(MOVES):
            own = (model, group, (*rest[:place], value, *rest[place:]))
            line = [p for p in measured if p[:3] == own and p.exposure_s == exposure_s]
            line.sort(key=lambda point: point.speed_px_s)
            x, colour = [point.speed_px_s + apart * (value - 1) for point in line], MOVE_COLOURS[int(value)]
            _draw_line(axes, x, line, colour, MOVE_LABELS[int(value)], style, band=False)
            for at, point in zip(x, line, strict=True):
                if point.low is not None and point.high is not None:
                    axes.plot([at, at], [point.low, point.high], color=colour, lw=2.4, alpha=0.35)
                    highest = max(highest, min(_HIGHEST, point.high))
        axes.set_ylim(-0.03, 1.03 * highest)
        axes.yaxis.set_major_locator(MultipleLocator(0.2))
    notes = ["Bars: 95 % intervals over pictures.", *_left_out(exposures, data.exposures_s, "exposures")]
    notes += _left_out(others.every[-1:], others.every, "settings")
    return grid.finish(axis_label(SPEED), MOVES.title, notes)


def _draw_exposure_lines(
    data: RunData,
    grid: Panels,
    measured: Sequence[Point],
    place: Callable[[Point], float],
    key_of: Callable[[Point], Key] = lambda point: point[:3],
) -> list[str]:
    """One line per exposure, points at ``place``; lines only where speeds share no two directions."""
    exposures = sorted({point.exposure_s for point in measured}.intersection(data.exposures_s))
    shown = spread(exposures, MAX_LINES)
    joined = one_velocity_per_speed(point.velocity_px_s for point in measured)
    style = _style(data) if joined else "o"
    for key, axes in grid:
        own = [point for point in measured if key_of(point) == key]
        for exposure_s, colour in zip(shown, line_colours("plasma", len(shown)), strict=True):
            line = sorted((point for point in own if point.exposure_s == exposure_s), key=place)
            x = [place(point) for point in line]
            _draw_line(axes, x, line, colour, EXPOSURE.text(exposure_s), style, band=False)
    return _left_out(shown, exposures, "exposures")


def _style(data: RunData) -> str:
    """A line with a marker where something was measured."""
    return "-" if data.searched else "o-"


def _draw_line(
    axes: Axes,
    x: list[float],
    line: list[Point],
    colour: str,
    label: str,
    style: str,
    band: bool = True,
) -> None:
    axes.plot(x, [p.confidence for p in line], style, color=colour, ms=3.2, lw=1.4, label=label)
    bounded = [(at, p.low, p.high) for at, p in zip(x, line, strict=True) if None not in (p.low, p.high)]
    if band and bounded:
        at, low, high = zip(*bounded, strict=True)
        axes.fill_between(at, low, high, color=colour, alpha=0.16, lw=0)


def _draw_window(axes: Axes, answer: dict[str, Any], y: float, colour: str) -> None:
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


def _exposure_axis(axes: Axes, exposures_s: Sequence[float]) -> None:
    axes.set_xscale("log")
    axes.set_xlim(1e3 * min(exposures_s) / 1.15, 1e3 * max(exposures_s) * 1.15)
    narrow = max(exposures_s) / min(exposures_s) < 30
    axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5) if narrow else (1, 3)))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())


def _left_out(shown: Sequence[object], every: Sequence[object], what: str) -> list[str]:
    return [f"{len(shown)} of {len(every)} {what} shown."] if len(shown) < len(every) else []
