"""The figures of maps: a score over metric and exposure or blur, and its scatter on each metric.

Domain: scores as shares, exposures in ms, blur in px. Performance maps are those of Lin et al. 2024 (Sensors 24(16)
5135), Figs. 24-29: contours of the score over a metric and exposure, or blur. Between conditions they are means
weighted by a Gaussian of ``_REACH`` of either axis, and blank further than two of these from any. Each map gives how
far conditions lie off it, since several of one metric and exposure may differ in light.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colorbar import Colorbar
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from blurnoise_eval.answers.plane import STILL_PX
from blurnoise_eval.grid.axes import blur_px
from blurnoise_eval.maps.maps import Map, Maps
from blurnoise_eval.maps.nodes import Array
from blurnoise_eval.maps.ranking import FEWEST_NODES, Ranked, increasing
from blurnoise_eval.plots.style import plain_numbers, small_multiples, tidy
from blurnoise_eval.quality.measure import METRICS
from blurnoise_eval.quality.metrics import Metric
from blurnoise_eval.system.files import write_figure
from blurnoise_eval.system.terminal import plain

_COLUMNS, _REACH, _CELLS = 4, 0.07, 60
_TICKS_PX = np.array([0.5, 1, 3, 10, 30, 100])


def write(maps: Maps, folder: Path) -> list[Path]:
    """Write map-exposure, map-blur and scatter of each group; raises ``OSError``.

    The model's name stands in the files' where there are several.
    """
    folder.mkdir(parents=True, exist_ok=True)
    exposures_ms = np.array([1e3 * row["exposure_s"] for row in maps.nodes.rows])
    blurs_px = np.array([max(blur_px(row), STILL_PX) for row in maps.nodes.rows])
    blur = f"Motion blur / px (none stands at {STILL_PX:g})"
    written: list[Path] = []
    for model, groups in maps.largest:
        prefix = f"{_slug(model)}-" if len(maps.largest) > 1 else ""
        for each in groups:
            drawn = {
                "map-exposure": performance(maps, each, exposures_ms, "Exposure / ms"),
                "map-blur": performance(maps, each, blurs_px, blur),
                "scatter": scatter(maps, each),
            }
            for name, figure in drawn.items():
                written.append(folder / f"{prefix}{name}-{_slug(each.scores.table.group)}.png")
                write_figure(written[-1], figure, dpi=110)
    return written


def scatter(maps: Maps, of: Map) -> Figure:
    """The score against each metric, a dot per node in the colour of its blur, and the increasing curve that fits."""
    scores, (_, w) = of.scores, maps.nodes.places.T
    figure, panels = _panels(maps, of, "scatter, and the increasing curve that fits best")
    colour = Normalize(w.min(), max(w.max(), w.min() + 1))
    for axes, metric, row in zip(panels, METRICS, of.ranks, strict=True):
        m = maps.metrics[metric.name]
        known = scores.known & np.isfinite(m)
        _dress(axes, metric, m[known], across=True)
        axes.set_ylim(-0.03, max(1.0, float(np.nanmax(scores.values))) * 1.27)  # above: words
        axes.axhline(scores.enough.level, color="0.4", lw=0.8, ls=":")
        dots: Any = {"c": w[known], "norm": colour, "cmap": "plasma"}
        axes.scatter(m[known], scores.values[known], s=11, alpha=0.85, lw=0, **dots)
        if known.sum() >= FEWEST_NODES:
            rising, fitted = increasing(metric.sign * m[known], scores.values[known])
            axes.plot(metric.sign * rising, fitted, color="black", lw=1.3)
        _say(axes, _rank_text(row))
    bar = _colour_bar(figure, colour, "plasma", "Motion blur / px")
    ticks = _TICKS_PX[(np.log2(_TICKS_PX) >= colour.vmin) & (np.log2(_TICKS_PX) <= colour.vmax)]
    bar.set_ticks(np.log2(ticks).tolist(), labels=[f"{tick:g}" for tick in ticks])
    figure.supylabel(scores.enough.title, fontsize=9)
    return figure


def performance(maps: Maps, of: Map, x: Array, label: str) -> Figure:
    """The score over each metric and x, a value above 0 for each of the run's conditions."""
    scores, node_of = of.scores, maps.nodes.node_of
    figure, panels = _panels(maps, of, "performance maps")
    most = max(1.0, float(np.nanmax(scores.values, initial=0.0)))
    colour = Normalize(0, most)
    y = scores.values[node_of]
    for axes, metric in zip(panels, METRICS, strict=True):
        m = maps.metrics[metric.name][node_of]
        known = np.isfinite(m) & np.isfinite(y)
        logarithmic = _dress(axes, metric, m[known])
        axes.set_xscale("log")
        axes.set_xlim(x.min() / 1.15, x.max() * 1.15)
        plain_numbers(axes.xaxis, digits=(1, 3))
        if len(np.unique(x[known])) < 2 or len(np.unique(m[known])) < 2:
            _say(axes, "cannot tell: one value of an axis")
            continue
        across, up = np.log2(x[known]), np.log2(m[known]) if logarithmic else m[known]
        at_x, at_y = (np.linspace(each.min(), each.max(), _CELLS) for each in (across, up))
        surface, off = smoothed(across, up, y[known], at_x, at_y)
        places = 2.0**at_x, 2.0**at_y if logarithmic else at_y
        axes.contourf(*places, surface, np.linspace(0, most, 21), norm=colour, cmap="viridis", alpha=0.75)
        if np.nanmin(surface) < scores.enough.level < np.nanmax(surface):
            axes.contour(*places, surface, [scores.enough.level], colors="white", linewidths=1.6)
        dots: Any = {"c": y[known], "norm": colour, "cmap": "viridis"}
        axes.scatter(x[known], m[known], s=12, edgecolors="black", linewidths=0.3, zorder=3, **dots)
        _say(axes, f"conditions lie ±{off:.2f} off")
    figure.supxlabel(label, fontsize=9)
    _colour_bar(figure, colour, "viridis", f"{scores.enough.title} (white: {scores.enough.level:g})")
    return figure


def smoothed(x: Array, y: Array, value: Array, at_x: Array, at_y: Array) -> tuple[Array, float]:
    """Weighted means of scattered values on a grid (len(at_y), len(at_x)), NaN far from all; and how far the points
    lie off those of the others, RMS."""
    scale = [_REACH * max(float(np.ptp(each)), 1e-9) for each in (x, y)]

    def means(px: Array, py: Array, others: bool) -> tuple[Array, Array]:
        away = ((px[:, None] - x) / scale[0]) ** 2 + ((py[:, None] - y) / scale[1]) ** 2
        if others:
            np.fill_diagonal(away, np.inf)
        weight = np.exp(-away / 2)
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray(weight @ value / weight.sum(axis=1)), np.asarray(away.min(axis=1))

    across, up = np.meshgrid(at_x, at_y)
    surface, nearest = means(across.ravel(), up.ravel(), False)
    others, near = means(x, y, True)
    off = (others - value)[(near < 4) & np.isfinite(others)]
    surface = np.where(nearest < 4, surface, np.nan).reshape(across.shape)
    return surface, float(np.sqrt(np.mean(off**2))) if len(off) else float("nan")


def _panels(maps: Maps, of: Map, what: str) -> tuple[Figure, list[Axes]]:
    """One for each of ``METRICS``."""
    figure, panels = small_multiples(len(METRICS), _COLUMNS, (3.5, 2.6))
    title = f"{plain(of.name)}, {plain(maps.nodes.camera.name)}: {what}"
    figure.suptitle(title, fontsize=11).set_parse_math(False)
    return figure, panels


def _dress(axes: Axes, metric: Metric[Any, Any], values: Array, across: bool = False) -> bool:
    """Title and scale of a metric's panel; whether the metric's axis is logarithmic."""
    tidy(axes, title=metric.label)
    axes.grid(visible=False)
    logarithmic = bool(metric.scale == "log" and len(values) and values.min() > 0)
    if logarithmic:
        (axes.set_xscale if across else axes.set_yscale)("log")
        plain_numbers(axes.xaxis if across else axes.yaxis, digits=(1, 3))
    return logarithmic


def _rank_text(row: Ranked) -> str:
    if row.spearman is None:
        return f"cannot tell: {row.share_told:.0%} of {row.n_nodes} nodes told"
    text = f"rank {row.spearman:.2f}, {row.share_told:.0%} told"
    if row.r2_h is None or row.r2_l is None:
        return text
    return f"{text}\nR² held out: light {row.r2_h:.2f}, blur {row.r2_l:.2f}"


def _say(axes: Axes, text: str) -> None:
    box = {"facecolor": "white", "alpha": 0.7, "edgecolor": "none", "pad": 1.0}
    axes.text(0.02, 0.98, text, transform=axes.transAxes, fontsize=7.5, va="top", bbox=box, zorder=6)


def _colour_bar(figure: Figure, colour: Normalize, cmap: str, label: str) -> Colorbar:
    bar = figure.colorbar(ScalarMappable(colour, cmap), ax=figure.axes, shrink=0.5, pad=0.01, aspect=30)
    bar.set_label(label, fontsize=9)
    return bar


def _slug(text: str) -> str:
    return re.sub(r"[^A-Za-z0-9]+", "-", text).strip("-").lower() or "targets"
