"""The figures of a run for print: curves, what exposure makes of pictures, examples with boxes, latency.

Every function takes the run and returns a matplotlib ``Figure``. Figures hold at most ``MAX_PANELS`` panels and
``MAX_LINES`` lines each and say so when they leave some out.
Domain: confidences in [0, 1], exposures in s (drawn in ms), speeds in px/s, blur in px, latency in ms per picture.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import MultipleLocator

from blurnoise_eval.answers.exposure_window import WORKS
from blurnoise_eval.grid.axes import (
    BLUR,
    EXPOSURE,
    MOVES,
    SPEED,
    Axis,
    Coordinate,
    velocity_of,
    velocity_text,
)
from blurnoise_eval.plots.annotate import OTHER_SCORE, drawn_example, short_text
from blurnoise_eval.plots.style import (
    MAX_LINES,
    line_colours,
    plain_numbers,
    say_only,
    small_multiples,
    spread,
    tidy,
)
from blurnoise_eval.report.run import Point, RunData
from blurnoise_eval.report.settings import Setting, Settings, axis_label
from blurnoise_eval.report.words import outcome_text, title_text
from blurnoise_eval.system.tables import finite

MAX_PANELS, MAX_COLUMNS = 12, 4
MAX_EXAMPLES = 12
MAX_TICKS = 8  # of an axis whose tested values are its ticks
MOST_EXPOSURES, MOST_OF_MOVES = 3, 9  # of what moves: exposures side by side, panels in all
MOVES_AS = (
    ("all of the picture moves", "0.25"),
    ("targets move, the background is still", "#c23b22"),
    ("the camera tracks the targets: the background moves", "#1f77b4"),
)
ROBUSTNESS = {"auc_exposure": "AUC over exposure", "auc_blur": "AUC over blur", "rpc": "rPC"}
"""Columns of the table of models that latency is drawn against."""
_APART, _HIGHEST = 0.018, 1.5  # bars side by side, of the axis; intervals beyond that are cut off
_BAR, _BAR_STEP = 0.05, 0.045  # of the first window below zero, and from bar to bar
_OF_PICTURES = {
    "applied_gain_db": "Gain / dB",
    "snr_db": "SNR of the mean light / dB",
    "brightness": "Mean of the picture, 0-1",
    "saturated": "Share of saturated pixels",
}
Key = tuple[str, str, Setting]  # model, group, setting
Style = tuple[Any, str, str]  # of a line: the value that its points share, label, colour


def confidence_exposure(data: RunData) -> Figure:
    """Confidence against exposure on a log axis: one panel per model, group and setting, one line per velocity.

    Bars below zero are the exposure window of each velocity, pale where the pictures cannot tell, thin over the
    intervals of its ends, with a tick at the recommended exposure; the shaded range is surely in the window of every
    velocity tested there.
    """
    measured = {point.velocity_px_s for point in data.points}
    velocities = [velocity for velocity in data.velocities_px_s if velocity in measured]
    shown = _styles(velocities, velocity_text, "viridis")
    panels = _panels(data, data.settings)
    for key, axes, points in panels.with_points(data, lambda point: point[:3]):
        answers = [a for a in data.answers if (a["model"], a["group"], data.settings.of(a)) == key]
        for first, last in common_windows([answer["sure_windows_s"] for answer in answers]):
            axes.axvspan(1e3 * first, 1e3 * last, color="0.5", alpha=0.13, lw=0)
        lines = _draw_lines(
            data, axes, points, shown, attrgetter("velocity_px_s"), lambda p: 1e3 * p.exposure_s
        )
        for row, (line, (velocity, _, colour)) in enumerate(zip(lines, shown, strict=True)):
            bounds = [(1e3 * p.exposure_s, p.low, p.high) for p in line if None not in (p.low, p.high)]
            if bounds:
                x, low, high = zip(*bounds, strict=True)
                axes.fill_between(x, low, high, color=colour, alpha=0.16, lw=0)
            for answer in (a for a in answers if velocity_of(a) == velocity):
                _draw_window(axes, answer, -_BAR - _BAR_STEP * row, colour)
        axes.set_ylim(-0.07 - _BAR_STEP * len(shown), 1.03 * data.highest)
        _exposure_axis(axes, [p.exposure_s for p in data.points])
    return panels.finish(
        axis_label(EXPOSURE),
        "Speed; bars: exposure window (pale: cannot tell; thin: its ends' intervals), tick: recommended",
        _left_out(shown, velocities, "velocities"),
        [Patch(color="0.5", alpha=0.2, label="surely in the window at every speed")],
    )


def confidence_over(data: RunData, x: Axis | Coordinate) -> Figure:
    """Confidence against motion blur, speed, or an axis of the settings (at the middle velocity), line by exposure.

    One panel per model, group and setting, but for the axis that is drawn against; lines only where no two
    directions share a speed.
    """
    settings, points, notes, label = data.settings, data.points, list[str](), axis_label(x)
    at: Callable[[Point], float] = attrgetter(x.name)
    place: int | None = None
    if isinstance(x, Axis):
        place, settings = data.settings.axes.index(x), data.settings.without(x)
        velocity = data.velocities_px_s[len(data.velocities_px_s) // 2]
        points = [point for point in points if point.velocity_px_s == velocity]
        at = lambda point: x.shown(point.setting[place])  # noqa: E731
        if len(data.velocities_px_s) > 1:
            notes.append(f"At {velocity_text(velocity)}, one of {len(data.velocities_px_s)} velocities.")
    elif x is BLUR:
        label += " (linear below 1 px, logarithmic above)"
        notes.append(
            "Along a line only the speed changes; from one line to the next the light per picture changes too."
        )
    panels = _panels(data, settings)
    exposures = sorted({point.exposure_s for point in points}.intersection(data.exposures_s))
    shown = _styles(exposures, EXPOSURE.text, "plasma")
    joined = place is not None or data.one_velocity_per_speed
    values = [x.shown(value) for value in data.settings.values(x)] if isinstance(x, Axis) else []
    for _, axes, own in panels.with_points(data, lambda p: (*p[:2], _without(p.setting, place)), points):
        _draw_lines(data, axes, own, shown, attrgetter("exposure_s"), at, joined)
        if x is BLUR:
            axes.set_xscale("symlog", linthresh=1)
            plain_numbers(axes.xaxis)
            axes.set_xlim(left=-0.08)
        elif isinstance(x, Axis):
            if x.logarithmic and values[0] > 0:
                axes.set_xscale("log")
            plain_numbers(axes.xaxis)
            axes.set_xticks(spread(values, MAX_TICKS))
    return panels.finish(label, "Exposure", [*notes, *_left_out(shown, exposures, "exposures")])


def score_moves(data: RunData) -> Figure:
    """The score against speed, a line with its intervals for each of what moves: one panel per model, group and
    exposure, under the brightest light; a row for each model where there are several."""
    place, others = data.settings.axes.index(MOVES), data.settings.without(MOVES)
    exposures = spread(data.exposures_s, MOST_EXPOSURES)
    every = tuple((*others.every[-1], exposure_s) for exposure_s in exposures)
    panels = _panels(data, Settings((*others.axes, EXPOSURE), every, others.held), MOST_OF_MOVES)
    apart = _APART * max(point.speed_px_s for point in data.points)
    at: Callable[[Point], float] = lambda p: p.speed_px_s + apart * (p.setting[place] - 1)  # noqa: E731
    shown = [(value, *MOVES_AS[int(value)]) for value in data.settings.values(MOVES)]
    highest = data.highest
    for _, axes, points in panels.with_points(
        data, lambda p: (*p[:2], (*_without(p.setting, place), p.exposure_s))
    ):
        by: Callable[[Point], float] = lambda p: p.setting[place]  # noqa: E731
        lines = _draw_lines(data, axes, points, shown, by, at, data.one_velocity_per_speed)
        for line, (_, _, colour) in zip(lines, shown, strict=True):
            for point in line:
                if point.low is not None and point.high is not None:
                    axes.plot([at(point)] * 2, [point.low, point.high], color=colour, lw=2.4, alpha=0.35)
                    highest = max(highest, min(_HIGHEST, point.high))
        axes.set_ylim(-0.03, 1.03 * highest)
        axes.yaxis.set_major_locator(MultipleLocator(0.2))
    notes = ["Bars: 95 % intervals over pictures.", *_left_out(exposures, data.exposures_s, "exposures")]
    notes += _left_out(others.every[-1:], others.every, "settings")
    return panels.finish(axis_label(SPEED), MOVES.title, notes)


def common_windows(windows_s: Sequence[Sequence[Sequence[float]]]) -> list[tuple[float, float]]:
    """The ranges, in s, that lie inside a window of every list; empty where there is none."""
    common = [(low, high) for low, high in windows_s[0]] if windows_s else []
    for windows in windows_s[1:]:
        overlaps = [(max(a, c), min(b, d)) for a, b in common for c, d in windows]
        common = [(low, high) for low, high in overlaps if low <= high]
    return common


def _without(setting: Setting, place: int | None) -> Setting:
    return setting if place is None else setting[:place] + setting[place + 1 :]


def _styles(values: Sequence[Any], text: Callable[[Any], str], colours: str) -> list[Style]:
    """At most ``MAX_LINES`` lines."""
    shown = spread(values, MAX_LINES)
    return list(zip(shown, map(text, shown), line_colours(colours, len(shown)), strict=True))


def _draw_lines(
    data: RunData,
    axes: Axes,
    points: Sequence[Point],
    shown: Sequence[Style],
    by: Callable[[Point], Any],
    at: Callable[[Point], float],
    joined: bool = True,
) -> list[list[Point]]:
    """The points of each line, with a marker where something was measured: nowhere, where answers are predicted."""
    style = "o" if not joined else "-" if data.searched else "o-"
    lines = [sorted((point for point in points if by(point) == value), key=at) for value, _, _ in shown]
    for line, (_, label, colour) in zip(lines, shown, strict=True):
        y = [point.confidence for point in line]
        axes.plot(list(map(at, line)), y, style, color=colour, ms=3.2, lw=1.4, label=label)
    return lines


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


def _exposure_axis(axes: Axes, exposures_s: Iterable[float]) -> None:
    known = [
        exposure_s for exposure_s in exposures_s if math.isfinite(exposure_s)
    ]  # not those the camera sets
    if known:
        axes.set_xscale("log")
        axes.set_xlim(1e3 * min(known) / 1.15, 1e3 * max(known) * 1.15)
        narrow = max(known) / min(known) < 30
        plain_numbers(axes.xaxis, digits=(1, 2, 5) if narrow else (1, 3))


def _left_out(shown: Sequence[object], every: Sequence[object], what: str) -> list[str]:
    return [f"{len(shown)} of {len(every)} {what} shown."] if len(shown) < len(every) else []


@dataclass(frozen=True)
class _Panels:
    """A figure, its axes by (model, group, setting), what was left out, and what values are shown."""

    figure: Figure
    axes: dict[Key, Axes]
    notes: list[str]
    shown: str

    def with_points(
        self, data: RunData, key_of: Callable[[Point], Key], points: Sequence[Point] | None = None
    ) -> Iterator[tuple[Key, Axes, list[Point]]]:
        """Each panel with its points, of all by default."""
        own: dict[Key, list[Point]] = {}
        for point in data.points if points is None else points:
            own.setdefault(key_of(point), []).append(point)
        return ((key, axes, own.get(key, [])) for key, axes in self.axes.items())

    def finish(
        self, x_label: str, legend_title: str, notes: Sequence[str], entries: Sequence[Patch] = ()
    ) -> Figure:
        """The figure with its labels, its notes and one legend for all panels."""
        if not self.axes:
            return self.figure
        self.figure.supxlabel("\n".join([x_label, *self.notes, *notes]), fontsize=9)
        self.figure.supylabel(f"{self.shown} (dashed: what is asked)", fontsize=9)
        handles, _ = next(iter(self.axes.values())).get_legend_handles_labels()
        every = [*handles, *entries]
        self.figure.legend(
            handles=every, title=legend_title, loc="outside upper center", fontsize=8, title_fontsize=8,
            ncols=min(len(every), 3 if len(self.axes) == 1 else 6), frameon=False,
        )  # fmt: skip
        return self.figure


def _panels(data: RunData, settings: Settings, most: int = MAX_PANELS) -> _Panels:
    """At most so many empty panels: a row of settings per target group, model by model."""
    sizes: dict[tuple[str, str], int] = {}
    for answer in data.answers:
        key = answer["model"], answer["group"]
        sizes[key] = max(sizes.get(key, 0), answer["n_targets"])
    models = list(dict.fromkeys(model for model, _ in sizes))
    shown_models = models[:most]
    rows_left = most // max(1, len(shown_models))
    shown_settings = spread(settings.every, min(MAX_COLUMNS, rows_left) if rows_left > 1 else 1)
    groups = data.largest_groups(rows_left // max(1, len(shown_settings)))
    keys = [
        (model, group, at)
        for model in shown_models for group in groups for at in shown_settings if (model, group) in sizes
    ]  # fmt: skip
    columns = len(shown_settings) if len(shown_settings) > 1 else min(3, max(1, len(keys)))
    if len(shown_settings) == 1 < len(shown_models) and 1 < len(groups) <= MAX_COLUMNS:
        columns = len(groups)  # a row for each model
    wide = 3.5 if columns < MAX_COLUMNS else 3.0
    around = max(5.0, wide * columns) + 0.4 - wide * columns
    figure, grid = small_multiples(max(1, len(keys)), columns, (wide, 2.7), (around, 1.5), sharey=True)
    if not keys:
        say_only(grid[0], "No targets in these pictures.")
    notes = [
        *_left_out(shown_models, models, "models"),
        *_left_out(groups, sorted({group for _, group in sizes}), "target groups"),
        *_left_out(shown_settings, settings.every, "settings" if settings.further else "light levels"),
    ]
    if special := settings.held_text(unlike=data.manifest["camera"]):
        notes.append(f"Held: {special}.")
    if any(data.unseen_below(model, group) is not None for model, group, _ in keys):
        notes.append("Grey: below the lowest score that leaves the graph.")
    found = _Panels(figure, dict(zip(keys, grid, strict=False)), notes, title_text(data.criterion))
    for (model, group, at), axes in found.axes.items():
        between = "\n" if settings.further else ", "
        title = f"{short_text(group, 24)}{between}{settings.text(at)} (n = {sizes[model, group]})"
        tidy(axes, title=title if len(models) == 1 else f"{short_text(model, 36)}\n{title}")
        axes.set_ylim(-0.03, 1.03 * data.highest)
        axes.set_yticks([0, 0.2, 0.4, 0.6, 0.8, 1.0])
        if (unseen := data.unseen_below(model, group)) is not None:
            axes.axhspan(-0.03, unseen, color="0.88", lw=0, zorder=0)
        axes.axhline(data.criterion.level, color="0.25", lw=0.9, ls=(0, (4, 3)), zorder=1)
    return found


def gain_snr_brightness(data: RunData) -> Figure:
    """Gain, signal to noise and brightness over exposure, so that a dark picture can be told from a noisy one.

    A panel each, a line per setting, at the slowest motion: means over the pictures.
    """
    figure, grid = small_multiples(len(_OF_PICTURES), len(_OF_PICTURES), (3.3, 3.6), (0.0, 0.0))
    shown = spread(data.settings.every, MAX_LINES)
    slowest = data.velocities_px_s[:1]
    rows = [
        row
        for row in data.exposed_scores
        if row["model"] == data.model_names[0] and velocity_of(row) in slowest
    ]
    for axes, (name, label) in zip(grid, _OF_PICTURES.items(), strict=True):
        for setting, colour in zip(shown, line_colours("viridis", len(shown)), strict=True):
            own = (
                (row["exposure_s"], finite(row.get(name))) for row in rows if data.settings.of(row) == setting
            )
            line = sorted((1e3 * exposure_s, value) for exposure_s, value in own if value is not None)
            if line:
                text = data.settings.text(setting)
                axes.plot(*zip(*line, strict=True), "o-", ms=3, lw=1.4, color=colour, label=text)
        tidy(axes, title=label, x="Exposure / ms")
        _exposure_axis(axes, data.exposures_s)
    handles, labels = grid[0].get_legend_handles_labels()
    if handles:
        columns = min(4, len(labels))
        figure.legend(handles, labels, loc="outside lower center", ncols=columns, fontsize=8, frameon=False)
    return figure


def contact_sheet(data: RunData) -> Figure:
    """Example pictures with their boxes: green found, dashed orange missed, thin blue other detections."""
    threshold = data.found_from
    chosen = data.spread_examples(MAX_EXAMPLES)
    drawn = [drawn_example(example, 640, threshold) for example in chosen]
    tallest = max((each.shape[0] / each.shape[1] for each in drawn if each is not None), default=0.7)
    columns = min(MAX_COLUMNS, max(1, len(chosen)))
    figure, grid = small_multiples(max(1, len(chosen)), columns, (3.4, 3.4 * tallest + 0.5), (0.2, 0.4))
    grid[0].set_axis_off()
    for axes, example, picture in zip(grid, chosen, drawn, strict=False):
        axes.set_axis_off()
        if picture is None:
            say_only(axes, "picture file is missing")
        else:
            axes.imshow(picture, interpolation="antialiased")
        lines = [data.settings.condition_text(example), short_text(outcome_text(example, threshold), 52)]
        several = [short_text(example["model"], 52)] if len(data.model_names) > 1 else []
        axes.set_title("\n".join([*several, *lines]), fontsize=8, parse_math=False)
    legend = (
        f"green: target at or above {threshold:g}; dashed orange: target below; "
        f"thin blue: other detections from {OTHER_SCORE:g}"
    )
    if len(chosen) < len(data.examples):
        legend += f". {len(chosen)} of {len(data.examples)} examples shown"
    figure.supxlabel(legend if chosen else "No example pictures were kept.", fontsize=9)
    return figure


def comparable(data: RunData) -> dict[str, str]:
    """The measures of robustness, with their titles, that at least two models have beside a latency."""
    timed = [row for row in data.models if finite(row["latency_ms"]) is not None]
    count = {name: sum(finite(row[name]) is not None for row in timed) for name in ROBUSTNESS}
    return {name: title for name, title in ROBUSTNESS.items() if count[name] > 1}


def pareto_front(points: Sequence[tuple[float, float]]) -> list[bool]:
    """For each (cost, gain), whether no other point costs no more, gains no less and betters it in one of both."""
    return [
        not any(c <= cost and g >= gain and (c, g) != (cost, gain) for c, g in points)
        for cost, gain in points
    ]


def latency_robustness(data: RunData, measures: Sequence[str] | None = None) -> Figure:
    """A panel per measure of robustness, by default all: latency per picture (median, line to the 95th percentile).

    Filled points, joined, are the Pareto front: no other model is faster and as robust, or as fast and more
    robust.
    """
    measures = list(comparable(data)) if measures is None else measures
    columns = max(1, len(measures))
    figure, grid = small_multiples(columns, columns, (3.6, 2.9) if columns == 1 else (4.2, 4.0), (0.0, 0.0))
    if not measures:
        say_only(grid[0], "No two models with latency and robustness.")
        return figure
    for axes, measure in zip(grid, measures, strict=True):
        rows = [row for row in data.models if None not in (finite(row["latency_ms"]), finite(row[measure]))]
        points = [(row["latency_ms"], row[measure]) for row in rows]
        best = pareto_front(points)
        front = sorted(point for point, is_best in zip(points, best, strict=True) if is_best)
        axes.plot(*zip(*front, strict=True), "-", color="0.7", lw=1)
        for row, at, is_best in zip(rows, points, best, strict=True):
            colour, p95_ms = "#1f5f99" if is_best else "0.45", finite(row["latency_p95_ms"])
            if p95_ms is not None:
                axes.plot([at[0], p95_ms], [at[1]] * 2, color=colour, lw=1, alpha=0.6)
            axes.plot(*at, "o", color=colour, mfc=colour if is_best else "white", ms=6)
            name = short_text(row["model"], 28)
            axes.annotate(name, at, (5, 6), fontsize=8, textcoords="offset points", parse_math=False)
        tidy(axes, y=ROBUSTNESS[measure])
        axes.margins(y=0.2)
        axes.set_xlim(0, 1.3 * max(finite(row["latency_p95_ms"]) or row["latency_ms"] for row in rows))
    threads = sorted({row["latency_threads"] for row in data.models if row["latency_threads"]})
    given = f", {', '.join(map(str, threads))} thread{'s' if threads != [1] else ''}" if threads else ""
    reading = ": median, line to the 95th percentile. Filled: Pareto front." * (columns > 1)
    figure.supxlabel(f"Latency of one picture / ms{given}{reading}", fontsize=9)
    return figure
