"""Every metric of simulated charts against exposure (ms) and against motion blur (px), as small multiples.

A number that is not available is a gap in its line, with a cross in the line's colour at the panel's foot.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from blurnoise_eval.grid.axes import EXPOSURE, axis, setting_of, velocity_of, velocity_text
from blurnoise_eval.plots import style
from blurnoise_eval.quality.measure import CLIPPED, METRICS, Row, varying
from blurnoise_eval.system.files import write_figure
from blurnoise_eval.system.terminal import plain

SATURATED = "#f0a050"
_LEAST = 1e-12
"""Where a logarithmic axis draws the end of an interval at 0."""
_COLUMNS = 4


def write(rows: Sequence[Row], camera: str, folder: Path) -> list[Path]:
    """Write exposure-LUXlux.png and, where speeds differ, blur-LUXlux.png per setting; raises ``OSError``.

    Axes beyond the light stand in the names where they vary.
    """
    folder.mkdir(parents=True, exist_ok=True)
    written: list[Path] = []
    named = [axis(name) for name in varying(row.at for row in rows)]
    for setting in sorted({setting_of(row.at) for row in rows}):
        alike = [row for row in rows if setting_of(row.at) == setting]
        at = alike[0].at
        title = f"{plain(camera)}, {', '.join(each.text(at[each.name]) for each in named)}"
        figures = {"exposure": against_exposure(alike, title)}
        if len({velocity_of(row.at) for row in alike}) > 1:
            figures["blur"] = against_blur(alike, title)
        slug = "-".join(each.slug(at[each.name]) for each in named)
        for name, figure in figures.items():
            path = folder / f"{name}-{slug}.png"
            written.append(path if path not in written else folder / f"{name}-{slug}-{len(written)}.png")
            write_figure(written[-1], figure, dpi=120)
    return written


def against_exposure(rows: Sequence[Row], title: str) -> Figure:
    """Rows of one setting: a line per velocity over the exposure."""
    velocities = sorted({velocity_of(row.at) for row in rows}, key=lambda v: (math.hypot(*v), v))
    lines = {
        velocity_text(velocity): [row for row in rows if velocity_of(row.at) == velocity]
        for velocity in style.spread(velocities, style.MAX_LINES)
    }
    title = f"{title}: image quality against exposure"
    return _figure(lines, lambda row: 1e3 * row.at["exposure_s"], "Exposure / ms", title)


def against_blur(rows: Sequence[Row], title: str) -> Figure:
    """Rows of one setting: a line per exposure over the motion blur."""
    lines = {}
    for exposure_s in style.spread(sorted({row.at["exposure_s"] for row in rows}), style.MAX_LINES):
        of = [row for row in rows if row.at["exposure_s"] == exposure_s]
        saturated = " (saturated)" if any(CLIPPED in row.estimate.flags for row in of) else ""
        lines[EXPOSURE.text(exposure_s) + saturated] = of
    label = "Motion blur / px (linear below 1 px, logarithmic above)"
    return _figure(lines, lambda row: row.blur_px, label, f"{title}: image quality against motion blur")


def _figure(lines: Mapping[str, Sequence[Row]], x: Callable[[Row], float], label: str, title: str) -> Figure:
    """A panel per metric; exposures at which any line saturates are shaded."""
    exposures = label.startswith("Exposure")
    colours = style.line_colours("viridis" if exposures else "plasma", len(lines))
    figure, panels = style.small_multiples(len(METRICS), _COLUMNS, (3.5, 2.45), (0.0, 1.3), sharex=True)
    for axes, metric in zip(panels, METRICS, strict=True):
        style.tidy(axes, title=metric.label)
        if metric.scale == "log":
            axes.set_yscale("log")
            style.plain_numbers(axes.yaxis, digits=(1, 2, 5))
        elif metric.scale == "share":
            axes.set_ylim(0, 1.05)
        shown = [sorted((row for row in rows if row.metric == metric.name), key=x) for rows in lines.values()]
        places = sorted({x(row) for rows in shown for row in rows})
        if exposures:
            axes.set_xscale("log")
            _shade(axes, {x(row) for rows in shown for row in rows if CLIPPED in row.estimate.flags}, places)
        else:
            axes.set_xscale("symlog", linthresh=1)
            axes.set_xlim(-0.1, 1.2 * max(places[-1], 1))
        style.plain_numbers(axes.xaxis, digits=(1, 3) if exposures else None)
        for number, (colour, rows) in enumerate(zip(colours, shown, strict=True)):
            _line(axes, [x(row) for row in rows], rows, colour, foot=0.03 + 0.035 * number)
        positive = [row.estimate.value for rows in shown for row in rows if row.estimate.value > 0]
        if metric.scale == "log" and positive:
            axes.set_ylim(min(positive) / 1.6, max(positive) * 1.6)
    figure.supxlabel(label, fontsize=9)
    handles: list[Any] = [
        *(
            Line2D([], [], color=c, marker="o", ms=3.5, lw=1.4, label=of)
            for c, of in zip(colours, lines, strict=True)
        ),
        *([Patch(color=SATURATED, alpha=0.4, label="a line saturates")] if exposures else []),
        Line2D([], [], color="0.3", marker="x", ls="", ms=5, label="not available"),
        Line2D([], [], color="0.3", marker="o", mfc="white", ls="", ms=4.5, label="with a flag"),
        Patch(color="0.3", alpha=0.18, label="95 % interval"),
    ]
    style.legend_above(figure, handles, title)
    return figure


def _shade(axes: Axes, saturated: set[float], places: Sequence[float]) -> None:
    """Shade these of the places of a logarithmic axis, half-way to their neighbours."""
    ends = np.array([places[0] / 1.44, *places, places[-1] * 1.44])
    ends = np.sqrt(ends[1:] * ends[:-1])
    axes.set_xlim(ends[0], ends[-1])
    for place, low, high in zip(places, ends[:-1], ends[1:], strict=True):
        if place in saturated:
            axes.axvspan(low, high, color=SATURATED, alpha=0.22, lw=0, zorder=0)


def _line(axes: Axes, x: list[float], rows: Sequence[Row], colour: str, foot: float) -> None:
    available = np.array([row.estimate.told for row in rows])
    lost = np.array(x)[~available]
    axes.plot(
        lost,
        np.full(len(lost), foot),
        "x",
        color=colour,
        ms=4.5,
        mew=1.3,
        transform=axes.get_xaxis_transform(),
    )
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
    flagged = available & [bool(row.estimate.flags) for row in rows]
    axes.plot(np.array(x)[flagged], values[flagged], "o", mfc="white", mec=colour, ms=4.2, zorder=4)
