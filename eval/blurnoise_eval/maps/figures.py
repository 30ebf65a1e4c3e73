"""The figures of maps: a score over light and motion, and its scatter on each metric.

Domain: scores in the criterion's unit, light in lux seconds, motion during the exposure in px.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure

from blurnoise_eval.answers.plane import STILL_PX, same_places
from blurnoise_eval.maps.maps import Map, Maps
from blurnoise_eval.measure.charts import METRICS
from blurnoise_eval.plots.style import plain_numbers, small_multiples, tidy
from blurnoise_eval.system.files import write_figure
from blurnoise_eval.system.terminal import plain

_MOTION = f"Motion blur / px (at rest: {STILL_PX:g})"


def write(maps: Maps, folder: Path) -> None:
    """Write map-MODEL.png, and scatter-MODEL-GROUP.png for its groups; raises ``OSError``."""
    folder.mkdir(parents=True, exist_ok=True)
    drawn: dict[str, Figure] = {}
    for model, groups in maps.shown.items():
        drawn[f"map-{_slug(model)}.png"] = performance(maps, groups)
        for each in groups:
            drawn[f"scatter-{_slug(model)}-{_slug(each.table.group)}.png"] = scatter(maps, each)
    for name, figure in drawn.items():
        write_figure(folder / name, figure, dpi=110)


def performance(maps: Maps, groups: list[Map]) -> Figure:
    """The score over light and motion, a panel for each group; nodes at one place as their mean."""
    figure, panels = small_multiples(len(groups), len(groups), (3.6, 3.2), (0.9, 0.5))
    most = max(1.0, *(float(np.nanmax(each.table.mean, initial=0.0)) for each in groups))
    colour = Normalize(0, most)
    for axes, each in zip(panels, groups, strict=True):
        known = np.isfinite(each.table.mean)
        places, which = same_places(maps.nodes.places[known])
        score = np.bincount(which, each.table.mean[known]) / np.bincount(which)
        x, y = 2.0**places.T
        tidy(axes, title=each.table.group, x="Illuminance x exposure / lux s")
        axes.set_xscale("log")
        axes.set_yscale("log")
        spread = places - places.mean(axis=0)
        if np.linalg.matrix_rank(spread, tol=1e-6) == 2:  # else all lie on one line
            axes.tricontourf(x, y, score, np.linspace(0, most, 21), norm=colour, cmap="viridis", alpha=0.75)
            if score.min() < maps.criterion.level < score.max():
                axes.tricontour(x, y, score, [maps.criterion.level], colors="white", linewidths=1.6)
        dots: Any = {"c": score, "norm": colour, "cmap": "viridis", "edgecolors": "black"}
        axes.scatter(x, y, s=16, linewidths=0.4, zorder=3, clip_on=False, **dots)
        plain_numbers(axes.xaxis, axes.yaxis, digits=(1,))
    panels[0].set_ylabel(_MOTION, fontsize=9)
    label = f"{maps.criterion.title} (white: {maps.criterion.level:g})"
    _finish(figure, maps, groups[0].table.model, ScalarMappable(colour, "viridis"), label)
    return figure


def scatter(maps: Maps, of: Map) -> Figure:
    """The score against each metric, a dot per node in the colour of its motion."""
    score, motion_px = of.table.mean, 2.0 ** maps.nodes.places[:, 1]
    figure, panels = small_multiples(len(METRICS), 4, (3.5, 2.6))
    colour = LogNorm(motion_px.min(), max(motion_px.max(), 2 * motion_px.min()))
    top = max(1.0, float(np.nanmax(score, initial=0.0))) * 1.27  # room for words
    for axes, metric, row in zip(panels, METRICS, of.ranks, strict=True):
        m = maps.metrics[metric.name]
        known = np.isfinite(score) & np.isfinite(m)
        tidy(axes, title=metric.label)
        if metric.scale == "log" and known.any() and m[known].min() > 0:
            axes.set_xscale("log")
            plain_numbers(axes.xaxis, digits=(1, 3))
        axes.set_ylim(-0.03, top)
        axes.axhline(maps.criterion.level, color="0.4", lw=0.8, ls=":")
        axes.scatter(m[known], score[known], s=11, c=motion_px[known], norm=colour, cmap="plasma")
        axes.text(0.02, 0.98, f"rank: {row.text}", transform=axes.transAxes, fontsize=8, va="top")
    figure.supylabel(maps.criterion.title, fontsize=9)
    name = f"{of.table.model}, {of.table.group}"
    _finish(figure, maps, name, ScalarMappable(colour, "plasma"), _MOTION)
    return figure


def _finish(figure: Figure, maps: Maps, name: str, colours: ScalarMappable, label: str) -> None:
    """Title and colour bar."""
    title = f"{plain(name)}, {plain(maps.nodes.camera.name)}"
    figure.suptitle(title, fontsize=11).set_parse_math(False)
    bar = figure.colorbar(colours, ax=figure.axes, shrink=0.7, pad=0.01, aspect=30)
    bar.set_label(label, fontsize=9, parse_math=False)
    plain_numbers(bar.ax.yaxis)


def _slug(text: str) -> str:
    return re.sub(r"[^A-Za-z0-9]+", "-", text).strip("-").lower() or "targets"
