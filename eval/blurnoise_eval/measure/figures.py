"""Figures: metrics of simulated charts against exposure (ms) as small multiples, and the measured edges of a picture.

A missing value is a gap in the line, with a cross in its colour at the bottom of the panel. The figure of a picture
shows the numbered regions, and ESF, LSF and SFR of the first few; frequencies in cycles/px.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle

from blurnoise.camera.colour import srgb_from_linear
from blurnoise_eval.measure.charts import CLIPPED, MetricRow, metrics_in
from blurnoise_eval.measure.edges import MeasuredEdge
from blurnoise_eval.measure.linear import LinearPicture
from blurnoise_eval.plan.axes import SETTING, axis, setting_of, velocity_of, velocity_text
from blurnoise_eval.plots import style
from blurnoise_eval.system.files import write_figure
from blurnoise_eval.system.terminal import plain

SATURATED = "#f0a050"
_LEAST = 1e-12
"""Drawn in place of 0, the lower end of some intervals, on a logarithmic axis."""
_COLUMNS = 4
MOST_EDGES = 4
_LINE, _USABLE, _NOT = style.COLOURS[0], style.COLOURS[2], style.COLOURS[1]
_WIDTH_IN, _ROW_IN, _TALLEST_IN = 12.0, 2.5, 7.0


def write(rows: Sequence[MetricRow], camera: str, folder: Path) -> list[Path]:
    """Write exposure-LUXlux.png for each setting; further axes that vary are in the name. Raises ``OSError``."""
    folder.mkdir(parents=True, exist_ok=True)
    written: list[Path] = []
    lights = [
        name for name in SETTING if name == "illuminance_lux" or len({row.at[name] for row in rows}) > 1
    ]
    for setting in sorted({setting_of(row.at) for row in rows}):
        alike = [row for row in rows if setting_of(row.at) == setting]
        values = [(axis(name), alike[0].at[name]) for name in lights]
        title = f"{plain(camera)}, {', '.join(of.text(at) for of, at in values)}"
        figure = against_exposure(alike, title)
        path = folder / f"exposure-{'-'.join(of.slug(at) for of, at in values)}.png"
        written.append(path if path not in written else path.with_stem(f"{path.stem}-{len(written)}"))
        write_figure(written[-1], figure, dpi=120)
    return written


def against_exposure(rows: Sequence[MetricRow], title: str) -> Figure:
    """A panel per metric and a line per velocity for the rows of one setting; saturated exposures are shaded."""
    velocities = sorted({velocity_of(row.at) for row in rows}, key=lambda v: (math.hypot(*v), v))
    velocities = style.spread(velocities, style.MAX_LINES)
    colours = style.line_colours("viridis", len(velocities))
    metrics = metrics_in(rows)
    figure, panels = style.small_multiples(len(metrics), _COLUMNS, (3.5, 2.45), (0.0, 1.3), sharex=True)
    for axes, metric in zip(panels, metrics, strict=True):
        style.tidy(axes, title=metric.label)
        axes.set(xscale="log", yscale="log" if metric.scale == "log" else "linear")
        style.plain_numbers(axes.xaxis, digits=(1, 3))
        of_metric = (row for row in rows if row.metric == metric.name)
        measured = sorted(of_metric, key=lambda row: row.at["exposure_s"])
        _shade(axes, measured)
        for number, velocity in enumerate(velocities):
            _line(axes, [row for row in measured if velocity_of(row.at) == velocity], colours[number], number)
        positive = [row.estimate.value for row in measured if row.estimate.value > 0]
        if metric.scale == "log":
            style.plain_numbers(axes.yaxis, digits=(1, 2, 5))
            axes.set_ylim(min(positive, default=0.1) / 1.6, max(positive, default=1) * 1.6)
        elif metric.scale == "share":
            axes.set_ylim(0, 1.05)
    figure.supxlabel("Exposure / ms", fontsize=9)
    lines = zip(colours, map(velocity_text, velocities), strict=True)
    handles: list[Any] = [Line2D([], [], color=c, marker="o", ms=3.5, lw=1.4, label=of) for c, of in lines]
    handles += [
        Patch(color=SATURATED, alpha=0.4, label="a line saturates"),
        Line2D([], [], color="0.3", marker="x", ls="", ms=5, label="not available"),
        Line2D([], [], color="0.3", marker="o", mfc="white", ls="", ms=4.5, label="with a flag"),
        Patch(color="0.3", alpha=0.18, label="95 % interval"),
    ]
    style.legend_above(figure, handles, f"{title}: image quality against exposure")
    return figure


def _shade(axes: Axes, rows: Sequence[MetricRow]) -> None:
    """Shade the exposures at which a row saturates, up to half-way to their neighbours."""
    exposures = sorted({1e3 * row.at["exposure_s"] for row in rows})
    saturated = {1e3 * row.at["exposure_s"] for row in rows if CLIPPED in row.estimate.flags}
    # Half-way on a logarithmic axis is the geometric mean; the outermost reach 1.2 times beyond.
    ends = np.array([exposures[0] / 1.44, *exposures, exposures[-1] * 1.44])
    ends = np.sqrt(ends[1:] * ends[:-1])
    axes.set_xlim(ends[0], ends[-1])
    for exposure, low, high in zip(exposures, ends[:-1], ends[1:], strict=True):
        if exposure in saturated:
            axes.axvspan(low, high, color=SATURATED, alpha=0.22, lw=0, zorder=0)


def _line(axes: Axes, rows: Sequence[MetricRow], colour: str, number: int) -> None:
    x = np.array([1e3 * row.at["exposure_s"] for row in rows])
    ends = [(row.estimate.value, row.estimate.low, row.estimate.high) for row in rows]
    values, low, high = np.reshape(ends, (-1, 3)).T
    available = np.isfinite(values)
    # Crosses of several velocities stand above each other, not on each other.
    foot = np.full((~available).sum(), 0.03 + 0.035 * number)
    across = axes.get_xaxis_transform()  # y in shares of the panel
    axes.plot(x[~available], foot, "x", color=colour, ms=4.5, mew=1.3, transform=across, zorder=5)
    axes.plot(x, np.where(available, values, math.nan), "o-", color=colour, ms=3, lw=1.4, zorder=3)
    if axes.get_yscale() == "log":
        low = np.where(np.isfinite(low), np.maximum(low, _LEAST), math.nan)
    high = np.where(np.isfinite(high), high, math.nan)
    axes.fill_between(x, low, high, color=colour, alpha=0.18, lw=0, zorder=2)
    flagged = available & [bool(row.estimate.flags) for row in rows]
    axes.plot(x[flagged], values[flagged], "o", mfc="white", mec=colour, ms=4.2, zorder=4)


def draw_regions(picture: LinearPicture, measured: Sequence[MeasuredEdge]) -> Figure:
    """The picture, scaled to its brightest pixel, above three panels for each of the first ``MOST_EDGES`` regions."""
    shown = measured[:MOST_EDGES]
    above = (picture.picture - picture.black_level).clamp_min(0)
    white = srgb_from_linear(above / above.max().clamp_min(1e-12))
    coded = np.asarray(white.expand(3, -1, -1).permute(1, 2, 0), np.float32)
    picture_in = min(_TALLEST_IN, 0.85 * _WIDTH_IN * coded.shape[0] / coded.shape[1])
    heights = [picture_in + 0.4] + [_ROW_IN] * len(shown)
    figure = Figure(figsize=(_WIDTH_IN, sum(heights) + 0.3), layout="constrained")
    grid = figure.add_gridspec(len(heights), 3, height_ratios=heights)
    whole = figure.add_subplot(grid[0, :], xticks=[], yticks=[])
    whole.imshow(coded, interpolation="nearest" if max(coded.shape) < 400 else "antialiased")
    for region in measured:
        left, top, width, height = region.roi
        colour = _USABLE if region.edge.sfr.numel() else _NOT
        whole.add_patch(Rectangle((left - 0.5, top - 0.5), width, height, fill=False, ec=colour, lw=1.5))
        tag: Any = {"color": "white", "fontsize": 9, "ha": "center", "va": "center"}
        tag["bbox"] = {"boxstyle": "round,pad=0.2", "fc": colour, "ec": "none"}
        whole.text(left + width / 2, top + height / 2, str(region.number), **tag)
    whole.set_title(f"regions: {len(measured)}; below: 1 to {len(shown)}", fontsize=10)
    for row, region in enumerate(shown, start=1):
        _draw_edge([figure.add_subplot(grid[row, column]) for column in range(3)], region, picture.unit)
    return figure


def _draw_edge(panels: Sequence[Axes], region: MeasuredEdge, unit: str) -> None:
    """Edge spread, line spread and response of one region, or the reason why they are missing."""
    edge, (esf, lsf, response) = region.edge, panels
    if not edge.sfr.numel():
        for axes in panels:
            axes.set_axis_off()
        text = f"{region.number}: {'; '.join(region.doubts)}"
        esf.text(0, 0.5, text, fontsize=9, transform=esf.transAxes).set_in_layout(False)
        return
    for axes, values, title in (
        (esf, edge.esf, f"edge spread, {unit}"),
        (lsf, edge.lsf, "line spread, 1/px"),
    ):
        axes.plot(edge.distance_px, values, color=_LINE, lw=1.3)
        style.tidy(axes, title=f"{region.number}: {title}", x="distance from the edge, px")
    if edge.resamples is not None:
        ends = torch.tensor([0.025, 0.975], dtype=torch.float64)
        low, high = torch.quantile(edge.resamples.power, ends, dim=0).clamp_min(0).sqrt().numpy()
        response.fill_between(edge.frequencies.numpy(), low, high, color=_LINE, alpha=0.25, lw=0)
    response.plot(edge.frequencies, edge.sfr, color=_LINE, lw=1.3)
    response.set(xlim=(0, 1), ylim=(0, max(1.05, 1.05 * float(edge.sfr.max()))))
    flagged = " (flagged)" if region.doubts else ""
    style.tidy(response, title=f"SFR, 95 %; MTF50 {edge.mtf50:.4g}{flagged}", x="frequency, cycles/px")
