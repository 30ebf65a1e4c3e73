"""The figures of maps: a score over metric and exposure or blur, its scatter on each metric, and the ranks of all.

Domain: scores as shares, exposures in ms, blur in px. Performance maps are those of Lin et al. 2024 (Sensors 24(16)
5135), Figs. 24-29: contours of the score over a metric and exposure, or blur. Between conditions they are means
weighted by a Gaussian of ``_REACH`` of either axis, and blank further than two of these from any. Each map says how
far conditions lie off it, since several of one metric and exposure may differ in light.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from blurnoise_eval.answers.plane import STILL_PX
from blurnoise_eval.maps.mapping import Maps, by_model
from blurnoise_eval.maps.nodes import Array
from blurnoise_eval.maps.ranking import FEWEST_NODES, Ranked, increasing
from blurnoise_eval.maps.scored import NodeScores
from blurnoise_eval.plots.style import legend_above, plain_numbers, small_multiples, tidy
from blurnoise_eval.quality.measure import METRICS, Metric
from blurnoise_eval.system.files import write_figure
from blurnoise_eval.system.terminal import plain

MOST_GROUPS = 3
"""Of a model that have figures, those with most targets."""
_COLUMNS, _REACH, _CELLS = 4, 0.07, 60
_COLOURS = "viridis"


def write(maps: Maps, score: str, folder: Path) -> list[Path]:
    """Write ranks.png, and for each group map-exposure, map-blur and scatter, of one score; raises ``OSError``.

    The model's name stands in the files' where there are several.
    """
    folder.mkdir(parents=True, exist_ok=True)
    models = by_model(maps.scores, score)
    written: list[Path] = []
    for model, groups in models:
        largest = sorted(groups, key=lambda each: -each.n_targets)[:MOST_GROUPS]
        shown = [each for each in groups if each in largest]
        prefix = f"{_slug(model)}-" if len(models) > 1 else ""
        drawn: dict[str, Figure] = {f"{prefix}ranks": ranks(maps, shown)}
        for each in shown:
            named = f"{prefix}{{}}-{_slug(each.group)}"
            drawn |= {
                named.format(name): figure
                for name, figure in (
                    ("map-exposure", over_exposure(maps, each)),
                    ("map-blur", over_blur(maps, each)),
                    ("scatter", scatter(maps, each)),
                )
            }
        for name, figure in drawn.items():
            written.append(folder / f"{name}.png")
            write_figure(written[-1], figure, dpi=110)
    return written


def over_exposure(maps: Maps, scores: NodeScores) -> Figure:
    """The score over each metric and exposure."""
    exposures_ms = np.array([1e3 * row["exposure_s"] for row in maps.plane.rows])
    return _maps(maps, scores, exposures_ms, "Exposure / ms", np.log2)


def over_blur(maps: Maps, scores: NodeScores) -> Figure:
    """The score over each metric and motion blur; below ``STILL_PX`` there is none."""
    blur_px = np.array([row_blur(row) for row in maps.plane.rows])
    return _maps(maps, scores, blur_px, f"Motion blur / px (none stands at {STILL_PX:g})", np.log2)


def row_blur(row: Mapping[str, Any]) -> float:
    """Motion of a condition during its exposure, px, as it is drawn."""
    speed = np.hypot(row["velocity_x_px_s"], row["velocity_y_px_s"])
    return max(float(speed * row["exposure_s"]), STILL_PX)


def scatter(maps: Maps, scores: NodeScores) -> Figure:
    """The score against each metric, a dot per node in the colour of its blur, and the increasing curve that fits."""
    figure, panels = _panels(maps, scores, "scatter, and the increasing curve that fits best")
    colour = Normalize(maps.plane.w.min(), max(maps.plane.w.max(), maps.plane.w.min() + 1))
    rows = {row.metric: row for row in maps.of(scores)}
    for axes, metric in panels:
        m, told = maps.metrics[metric.name], scores.told & np.isfinite(maps.metrics[metric.name])
        _dress(axes, metric, m[told], across=True)
        axes.set_ylim(-0.03, max(1.0, float(np.nanmax(scores.values))) * 1.27)  # above: words
        axes.axhline(scores.level, color="0.4", lw=0.8, ls=":")
        axes.scatter(
            m[told], scores.values[told], c=maps.plane.w[told], norm=colour, cmap="plasma", s=11, alpha=0.85, lw=0
        )  # fmt: skip
        if told.sum() >= FEWEST_NODES:
            axes.plot(*increasing(m[told], scores.values[told]), color="black", lw=1.3)
        _say(axes, _rank_text(rows[metric.name]), 0.02, 0.98)
    _colour_bar(figure, colour, "plasma", "Motion blur / px", [0.5, 1, 3, 10, 30, 100], np.log2)
    figure.supylabel(_value_name(scores), fontsize=9)
    return figure


def ranks(maps: Maps, groups: Sequence[NodeScores]) -> Figure:
    """Rank correlation of every metric with the score, with its interval, and along light or blur alone."""
    first = {row.metric: row.spearman for row in maps.of(groups[0])}
    order = sorted(METRICS, key=lambda metric: -2.0 if (r := first[metric.name]) is None else r)
    figure = Figure(figsize=(2.2 + 3.3 * len(groups), 5.6), layout="constrained")
    panels = figure.subplots(1, len(groups), sharey=True, squeeze=False)[0]
    for axes, scores in zip(panels, groups, strict=True):
        rows = {row.metric: row for row in maps.of(scores)}
        for place, metric in enumerate(order):
            row = rows[metric.name]
            if row.spearman is None:
                axes.text(0, place, "cannot tell", ha="center", va="center", fontsize=7.5, color="0.4")
                continue
            if row.low is not None and row.high is not None:
                axes.plot([row.low, row.high], [place, place], color="#2166ac", lw=2.2, alpha=0.6)
            axes.plot(row.spearman, place, "o", color="#2166ac", ms=5, zorder=4)
            for value, marker in ((row.along_light, ">"), (row.along_blur, "^")):
                if value is not None:
                    axes.plot(value, place, marker, mfc="none", mec="#b35806", ms=6, zorder=3)
            axes.text(
                1.03, place, f"{row.share_told:.0%}", va="center", fontsize=7.5, color="0.35",
                transform=axes.get_yaxis_transform(),
            )  # fmt: skip
        axes.set_xlim(-1.05, 1.05)
        axes.axvline(0, color="0.7", lw=0.8)
        axes.set_yticks(range(len(order)), [metric.title for metric in order], fontsize=8)
        axes.grid(axis="x", color="0.9", lw=0.6)
        axes.set_title(f"{plain(scores.group)}\n{int(scores.told.sum())} nodes", fontsize=9, parse_math=False)
        axes.tick_params(labelsize=8)
    label = "Rank correlation with the score (right: share of nodes at which the metric is told)"
    figure.supxlabel(label, fontsize=9)
    legend_above(
        figure,
        [
            Line2D([], [], color="#2166ac", marker="o", lw=2.2, label="over light and blur, 95 %"),
            Line2D([], [], color="#b35806", marker=">", mfc="none", ls="", label="along light alone"),
            Line2D([], [], color="#b35806", marker="^", mfc="none", ls="", label="along blur alone"),
        ],
        f"{plain(groups[0].model)}, {_value_name(groups[0])}",
        columns=3,
    )
    return figure


def _maps(maps: Maps, scores: NodeScores, x: Array, label: str, log: Callable[[Array], Array]) -> Figure:
    figure, panels = _panels(maps, scores, "performance maps")
    most = max(1.0, float(np.nanmax(scores.values, initial=0.0)))
    colour = Normalize(0, most)
    node_of = maps.plane.node_of
    for axes, metric in panels:
        m, y = maps.metrics[metric.name][node_of], scores.values[node_of]
        told = np.isfinite(m) & np.isfinite(y)
        _dress(axes, metric, m[told])
        axes.set_xscale("log")
        axes.set_xlim(x.min() / 1.15, x.max() * 1.15)
        plain_numbers(axes.xaxis, digits=(1, 3))
        if len(np.unique(x[told])) < 2 or len(np.unique(m[told])) < 2:
            _say(axes, "cannot tell: one value of an axis", 0.02, 0.98)
            continue
        logarithmic = axes.get_yscale() == "log"
        across, up = log(x[told]), np.log2(m[told]) if logarithmic else m[told]
        grid = [np.linspace(each.min(), each.max(), _CELLS) for each in (across, up)]
        surface, off = smoothed(across, up, y[told], *grid)
        places = 2.0 ** grid[0], 2.0 ** grid[1] if logarithmic else grid[1]
        axes.contourf(*places, surface, np.linspace(0, most, 21), norm=colour, cmap=_COLOURS, alpha=0.75)
        if np.nanmin(surface) < scores.level < np.nanmax(surface):
            axes.contour(*places, surface, [scores.level], colors="white", linewidths=1.6)
        axes.scatter(
            x[told], m[told], c=y[told], norm=colour, cmap=_COLOURS, s=12, edgecolors="black", linewidths=0.3,
            zorder=3,
        )  # fmt: skip
        _say(axes, f"conditions lie ±{off:.2f} off", 0.02, 0.98)
    figure.supxlabel(label, fontsize=9)
    _colour_bar(figure, colour, _COLOURS, f"{_value_name(scores)} (white: {scores.level:g})")
    return figure


def smoothed(x: Array, y: Array, value: Array, at_x: Array, at_y: Array) -> tuple[Array, float]:
    """Weighted means of scattered values on a grid (len(at_y), len(at_x)), NaN far from all; and how far the points
    lie off those of the others, RMS."""
    scale = [_REACH * max(float(np.ptp(each)), 1e-9) for each in (x, y)]

    def means(px: Array, py: Array, own: bool) -> tuple[Array, Array]:
        away = ((px[:, None] - x) / scale[0]) ** 2 + ((py[:, None] - y) / scale[1]) ** 2
        weight = np.exp(-away / 2)
        if own:
            np.fill_diagonal(weight, 0.0)
            np.fill_diagonal(away, np.inf)
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray(weight @ value / weight.sum(axis=1)), np.asarray(away.min(axis=1))

    across, up = np.meshgrid(at_x, at_y)
    surface, nearest = means(across.ravel(), up.ravel(), False)
    others, near = means(x, y, True)
    off = (others - value)[(near < 4) & np.isfinite(others)]
    surface = np.where(nearest < 4, surface, np.nan).reshape(across.shape)
    return surface, float(np.sqrt(np.mean(off**2))) if len(off) else float("nan")


def _panels(maps: Maps, scores: NodeScores, what: str) -> tuple[Figure, Iterator[tuple[Axes, Metric]]]:
    figure, panels = small_multiples(len(METRICS), _COLUMNS, (3.5, 2.6))
    title = f"{plain(scores.model)}, {plain(scores.group)}, {plain(maps.camera.name)}: {what}"
    figure.suptitle(title, fontsize=11).set_parse_math(False)
    return figure, zip(panels, METRICS, strict=True)


def _dress(axes: Axes, metric: Metric, values: Array, across: bool = False) -> None:
    unit = "" if metric.unit == "1" else f" / {metric.unit}"
    tidy(axes, title=f"{metric.title}{unit}")
    axes.grid(visible=False)
    if metric.log and len(values) and values.min() > 0:
        (axes.set_xscale if across else axes.set_yscale)("log")
        plain_numbers(axes.xaxis if across else axes.yaxis, digits=(1, 3))


def _rank_text(row: Ranked) -> str:
    if row.spearman is None:
        return f"cannot tell: {row.share_told:.0%} of {row.n_nodes} nodes told"
    r2 = (
        ""
        if row.r2_h is None or row.r2_l is None
        else f"\nR² held out: light {row.r2_h:.2f}, blur {row.r2_l:.2f}"
    )
    return f"rank {row.spearman:.2f}, {row.share_told:.0%} told{r2}"


def _say(axes: Axes, text: str, x: float, y: float) -> None:
    box = {"facecolor": "white", "alpha": 0.7, "edgecolor": "none", "pad": 1.0}
    axes.text(x, y, text, transform=axes.transAxes, fontsize=7.5, va="top", bbox=box, zorder=6)


def _value_name(scores: NodeScores) -> str:
    return scores.enough.title


def _colour_bar(
    figure: Figure,
    colour: Normalize,
    cmap: str,
    label: str,
    ticks: Sequence[float] | None = None,
    of: Callable[[Any], Any] = lambda value: value,
) -> None:
    from matplotlib.cm import ScalarMappable

    bar = figure.colorbar(ScalarMappable(colour, cmap), ax=figure.axes, shrink=0.5, pad=0.01, aspect=30)
    bar.set_label(label, fontsize=9)
    if ticks is not None:
        within = [tick for tick in ticks if colour.vmin <= of(tick) <= colour.vmax]
        bar.set_ticks([of(tick) for tick in within], labels=[f"{tick:g}" for tick in within])


def _slug(text: str) -> str:
    return re.sub(r"[^A-Za-z0-9]+", "-", text).strip("-").lower() or "targets"
