"""The measured picture with its numbered regions, and of the first few the edge, ESF, LSF and SFR.

Domain: :class:`Linear` pictures and what :func:`measure` says of them; frequencies in cycles/px, distances in px.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from blurnoise.optics.colour import srgb_from_linear
from blurnoise_eval.plots.style import tidy
from blurnoise_eval.quality.picture import Linear, Measured

MOST_EDGES = 4
_USABLE, _WITHHELD, _LINE, _GREY = "#1b9e4b", "#d1495b", "#1f5fa8", "0.55"
_WIDTH_IN, _ROW_IN, _TALLEST_IN = 12.0, 2.5, 7.0


def draw(light: Linear, measured: Sequence[Measured]) -> Figure:
    """The picture, its brightest white, above a row of panels for each of the first ``MOST_EDGES`` regions."""
    shown = measured[:MOST_EDGES]
    above = (light.picture - light.black_level).clamp_min(0)
    white = srgb_from_linear(above / above.max().clamp_min(1e-12))
    coded = np.asarray(white.expand(3, -1, -1).permute(1, 2, 0), np.float32)
    picture_in = min(_TALLEST_IN, 0.85 * _WIDTH_IN * coded.shape[0] / coded.shape[1])
    heights = [picture_in + 0.4] + [_ROW_IN] * len(shown)
    figure = Figure(figsize=(_WIDTH_IN, sum(heights) + 0.3), layout="constrained")
    grid = figure.add_gridspec(len(heights), 4, height_ratios=heights)
    whole = figure.add_subplot(grid[0, :])
    whole.imshow(coded, interpolation="nearest" if max(coded.shape) < 400 else "antialiased")
    _draw_regions(whole, measured, len(shown))
    notes = []
    for row, region in enumerate(shown, start=1):
        left, top, width, height = region.roi
        crop = figure.add_subplot(grid[row, 0], xticks=[], yticks=[])
        crop.imshow(coded[top : top + height, left : left + width], interpolation="nearest")
        angle = "" if region.edge.orientation is None else f", {region.edge.angle_deg:.2f}°"
        crop.set_title(f"{region.number}: {width} x {height} px{angle}", fontsize=9)
        if region.edge.sfr.numel():
            esf, lsf, sfr = (figure.add_subplot(grid[row, column]) for column in (1, 2, 3))
            _draw_shape(esf, lsf, region, "DN above black" if light.unit == "DN" else light.unit)
            _draw_response(sfr, region)
            notes += [f"{region.number}: {doubt}" for doubt in region.doubts]
        else:
            axes, reasons = figure.add_subplot(grid[row, 1:]), "\n".join(["no numbers:", *region.doubts])
            axes.set_axis_off()
            axes.text(0.5, 0.5, reasons, ha="center", va="center", fontsize=9, color=_WITHHELD)
    figure.supxlabel("\n".join(notes), fontsize=9)
    return figure


def _draw_regions(axes: Axes, measured: Sequence[Measured], drawn: int) -> None:
    for region in measured:
        left, top, width, height = region.roi
        colour = _USABLE if region.edge.sfr.numel() else _WITHHELD
        axes.add_patch(Rectangle((left - 0.5, top - 0.5), width, height, fill=False, ec=colour, lw=1.5))
        axes.text(
            left + width / 2, top + height / 2, str(region.number), color="white", fontsize=9, ha="center",
            va="center", bbox={"boxstyle": "round,pad=0.2", "fc": colour, "ec": "none"},
        )  # fmt: skip
    withheld = sum(not region.edge.sfr.numel() for region in measured)
    more = f", {withheld} of them (red) without numbers" if withheld else ""
    below = f"; below: 1 to {drawn}" if drawn < len(measured) else ""
    regions = f"{len(measured)} region{'s' if len(measured) > 1 else ''}"
    axes.set_title(f"{regions}{more}{below}", fontsize=10)
    axes.set(xticks=[], yticks=[])


def _draw_shape(esf: Axes, lsf: Axes, region: Measured, unit: str) -> None:
    edge = region.edge
    for axes, values, title in (
        (esf, edge.esf, f"edge spread, {unit}"),
        (lsf, edge.lsf, "line spread, 1/px"),
    ):
        axes.plot(edge.distance_px, values, color=_LINE, lw=1.3)
        tidy(axes, title=title, x="distance from the edge, px")
    esf.axhline(edge.dark, color=_GREY, lw=0.8, ls=":")
    esf.axhline(edge.bright, color=_GREY, lw=0.8, ls=":")


def _draw_response(axes: Axes, region: Measured) -> None:
    edge = region.edge
    frequency = edge.frequencies.numpy()
    if edge.resamples is not None:
        ends = torch.tensor([0.025, 0.975], dtype=torch.float64)
        low, high = torch.quantile(edge.resamples.power, ends, dim=0).clamp_min(0).sqrt().numpy()
        axes.fill_between(frequency, low, high, color=_LINE, alpha=0.25, lw=0)
    axes.plot(frequency, edge.sfr, color=_LINE, lw=1.3)
    axes.axvline(0.5, color=_GREY, lw=0.8, ls=":")
    axes.text(0.51, 1.02, "Nyquist", fontsize=7, color="0.4", va="top")
    title = "SFR, 95 %"
    if math.isfinite(edge.mtf50):
        axes.plot([0, edge.mtf50, edge.mtf50], [0.5, 0.5, 0], color=_GREY, lw=0.8, ls="--")
        title += f"; MTF50 {edge.mtf50:.4g}"
    axes.set(xlim=(0, 1), ylim=(0, max(1.05, 1.05 * float(edge.sfr.max()))))
    tidy(axes, title=title + (" (flagged)" if region.doubts else ""), x="frequency, cycles/px")
