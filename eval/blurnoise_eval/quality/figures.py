"""Every metric of simulated charts against exposure (ms) and against motion blur (px), as small multiples.

A number that is withheld is a gap in its line, with a cross in the line's colour at the panel's foot.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby, pairwise
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from blurnoise.metrics import Flag
from blurnoise_eval.grid.axes import axis, setting_of, velocity_of, velocity_text
from blurnoise_eval.plots import style
from blurnoise_eval.quality.measure import CLIPPED, METRICS, Metric, Row
from blurnoise_eval.quality.table import varying
from blurnoise_eval.system.files import write_figure
from blurnoise_eval.system.terminal import plain

SATURATED, FAILED = "#f0a050", "0.55"
_SHADES = {SATURATED: ("a line saturates", 0.22), FAILED: ("a line is lost in noise or blur", 0.20)}
_NOISY = Flag.NOISE_DOMINATED.name.lower()
_LEAST = 1e-12
"""Where a logarithmic axis draws the end of an interval at 0."""
_COLUMNS = 4


@dataclass(frozen=True)
class _Along:
    """The x axis of a figure. failure: the colour of a row's failure, None without; scale: sets the axis up."""

    title: str
    label: str
    colours: str
    x: Callable[[Row], float]
    failure: Callable[[Row], str | None]
    scale: Callable[[Axes, Sequence[float]], None]


def against_exposure(rows: Sequence[Row], camera: str, named: Sequence[str] = ("illuminance_lux",)) -> Figure:
    """Rows of one setting, whose axes ``named`` are in the title: a line per velocity over the exposure."""
    velocities = sorted({velocity_of(row.at) for row in rows}, key=lambda v: (math.hypot(*v), v))
    lines = {
        velocity_text(velocity): [row for row in rows if velocity_of(row.at) == velocity]
        for velocity in style.spread(velocities, style.MAX_LINES)
    }
    return _figure(rows, lines, _EXPOSURE, f"{plain(camera)}, {_texts(rows[0], named)}")


def against_blur(rows: Sequence[Row], camera: str, named: Sequence[str] = ("illuminance_lux",)) -> Figure:
    """Rows of one setting, whose axes ``named`` are in the title: a line per exposure over the motion blur."""
    lines = {}
    for exposure_s in style.spread(sorted({row.at["exposure_s"] for row in rows}), style.MAX_LINES):
        of = [row for row in rows if row.at["exposure_s"] == exposure_s]
        saturated = " (saturated)" if any(CLIPPED in row.estimate.flags for row in of) else ""
        lines[axis("exposure_s").text(exposure_s) + saturated] = of
    return _figure(rows, lines, _BLUR, f"{plain(camera)}, {_texts(rows[0], named)}")


def write(rows: Sequence[Row], camera: str, folder: Path) -> list[Path]:
    """Write exposure-LUXlux.png and, where speeds differ, blur-LUXlux.png per setting; raises ``OSError``.

    Axes beyond the light stand in the names where they vary.
    """
    folder.mkdir(parents=True, exist_ok=True)
    written: list[Path] = []
    named = varying(row.at for row in rows)
    for setting in sorted({setting_of(row.at) for row in rows}):
        alike = [row for row in rows if setting_of(row.at) == setting]
        figures = {"exposure": against_exposure(alike, camera, named)}
        if len({velocity_of(row.at) for row in alike}) > 1:
            figures["blur"] = against_blur(alike, camera, named)
        slug = "-".join(axis(name).slug(alike[0].at[name]) for name in named)
        for name, figure in figures.items():
            path = folder / f"{name}-{slug}.png"
            written.append(path if path not in written else folder / f"{name}-{slug}-{len(written)}.png")
            write_figure(written[-1], figure, dpi=120)
    return written


def _texts(row: Row, named: Sequence[str]) -> str:
    return ", ".join(axis(name).text(row.at[name]) for name in named)


def _figure(rows: Sequence[Row], lines: Mapping[str, list[Row]], along: _Along, of: str) -> Figure:
    """A panel per metric; places at which any line fails are shaded."""
    colours = dict(zip(lines, style.line_colours(along.colours, len(lines)), strict=True))
    places = sorted({along.x(row) for row in rows})
    figure, panels = style.small_multiples(len(METRICS), _COLUMNS, (3.5, 2.45), (0.0, 1.3), sharex=True)
    for axes, metric in zip(panels, METRICS, strict=True):
        drawn = {
            colours[label]: sorted((row for row in each if row.metric == metric.name), key=along.x)
            for label, each in lines.items()
        }
        _panel(axes, metric, drawn, along, places)
    figure.supxlabel(along.label, fontsize=9)
    failures = {along.failure(row) for row in rows}
    handles: list[Any] = [
        *(
            Line2D([], [], color=each, marker="o", ms=3.5, lw=1.4, label=label)
            for label, each in colours.items()
        ),
        *(
            Patch(color=c, alpha=2 * alpha, label=text)
            for c, (text, alpha) in _SHADES.items()
            if c in failures
        ),
        Line2D([], [], color="0.3", marker="x", ls="", ms=5, label="not told (its line)"),
        Line2D([], [], color="0.3", marker="o", mfc="white", ls="", ms=4.5, label="told, with a flag"),
        Patch(color="0.3", alpha=0.18, label="95 % interval"),
    ]
    style.legend_above(figure, handles, f"{of}: image quality against {along.title}")
    return figure


def _panel(
    axes: Axes, metric: Metric, lines: Mapping[str, list[Row]], along: _Along, places: Sequence[float]
) -> None:
    """lines: by colour."""
    style.tidy(axes, title=metric.title if metric.unit == "1" else f"{metric.title} / {metric.unit}")
    if metric.log:
        axes.set_yscale("log")
        style.plain_numbers(axes.yaxis, digits=(1, 2, 5))
    if metric.share:
        axes.set_ylim(0, 1.05)
    along.scale(axes, places)
    every = [row for each in lines.values() for row in each]
    failures = {(along.x(row), along.failure(row)) for row in every}
    spans = _surroundings(places, axes)
    for colour, (_, alpha) in _SHADES.items():
        for fails, run in groupby(places, key=lambda x, of=colour: (x, of) in failures):  # type: ignore[misc]
            if fails:
                ends = [spans[x] for x in run]
                axes.axvspan(ends[0][0], ends[-1][1], color=colour, alpha=alpha, lw=0, zorder=0)
    for number, (colour, rows) in enumerate(lines.items()):
        _line(axes, [along.x(row) for row in rows], rows, colour)
        lost = [along.x(row) for row in rows if not row.estimate.told and along.failure(row)]
        foot = [0.03 + 0.035 * number] * len(lost)
        across = axes.get_xaxis_transform()  # y in shares of the panel
        axes.plot(lost, foot, "x", color=colour, ms=4.5, mew=1.3, transform=across, zorder=5)
    positive = [row.estimate.value for row in every if row.estimate.value > 0]
    if metric.log and positive:
        axes.set_ylim(min(positive) / 1.6, max(positive) * 1.6)


def _line(axes: Axes, x: list[float], rows: list[Row], colour: str) -> None:
    values, lows, highs = (
        np.array([getattr(row.estimate, end) for row in rows]) for end in ("value", "low", "high")
    )
    least = _LEAST if axes.get_yscale() == "log" else -math.inf
    if not (values > least).any():
        return
    axes.plot(x, values, "o-", color=colour, ms=3, lw=1.4, zorder=3)
    low = np.where(np.isfinite(lows), np.maximum(lows, least), math.nan)
    high = np.where(np.isfinite(highs), highs, math.nan)
    axes.fill_between(x, low, high, color=colour, alpha=0.18, lw=0, zorder=2)
    flagged = np.array([row.estimate.told and bool(row.estimate.flags) for row in rows])
    axes.plot(np.array(x)[flagged], values[flagged], "o", mfc="white", mec=colour, ms=4.2, zorder=4)


def _surroundings(places: Sequence[float], axes: Axes) -> dict[float, tuple[float, float]]:
    """Each place's share of the axis, half-way to its neighbours as they are drawn."""
    there, back = axes.transData.transform, axes.transData.inverted().transform
    drawn = [float(there((x, 1.0))[0]) for x in places]
    middles = [float(back(((a + b) / 2, 0.0))[0]) for a, b in pairwise(drawn)]
    first, last = axes.get_xlim()
    return dict(zip(places, pairwise([first, *middles, last]), strict=True))


def _exposure_failure(row: Row) -> str | None:
    """Saturation, also where a number is told, or another loss, or noise."""
    if CLIPPED in row.estimate.flags:
        return SATURATED
    return FAILED if not row.estimate.told or _NOISY in row.estimate.flags else None


def _blur_failure(row: Row) -> str | None:
    return None if row.estimate.told or CLIPPED in row.estimate.flags else FAILED


def _exposure_scale(axes: Axes, exposures_ms: Sequence[float]) -> None:
    axes.set_xscale("log")
    axes.set_xlim(exposures_ms[0] / 1.2, exposures_ms[-1] * 1.2)
    style.plain_numbers(axes.xaxis, digits=(1, 3))


def _blur_scale(axes: Axes, blurs_px: Sequence[float]) -> None:
    axes.set_xscale("symlog", linthresh=1)
    axes.set_xlim(-0.1, 1.2 * max(blurs_px[-1], 1))
    style.plain_numbers(axes.xaxis)


_EXPOSURE = _Along(
    "exposure", "Exposure / ms", "viridis", lambda row: 1e3 * row.at["exposure_s"], _exposure_failure,
    _exposure_scale,
)  # fmt: skip
_BLUR = _Along(
    "motion blur", "Motion blur / px (linear below 1 px, logarithmic above)", "plasma", lambda row: row.blur_px,
    _blur_failure, _blur_scale,
)  # fmt: skip
