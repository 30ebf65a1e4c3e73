"""The measured picture with its numbered regions, and of the first few the edge, ESF, LSF and SFR.

Domain: :class:`Linear` pictures and what :func:`measure` says of them; frequencies in cycles/px, distances in px.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from blurnoise.optics.colour import srgb_from_linear
from blurnoise_eval.plots.style import COLOURS, GREY, tidy
from blurnoise_eval.quality.picture import Linear, Measured

MOST_EDGES = 4
_LINE, _USABLE, _NOT = COLOURS[0], COLOURS[2], COLOURS[1]
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
    whole = figure.add_subplot(grid[0, :], xticks=[], yticks=[])
    whole.imshow(coded, interpolation="nearest" if max(coded.shape) < 400 else "antialiased")
    for region in measured:
        left, top, width, height = region.roi
        colour = _USABLE if region.edge.sfr.numel() else _NOT
        whole.add_patch(Rectangle((left - 0.5, top - 0.5), width, height, fill=False, ec=colour, lw=1.5))
        tag = {"boxstyle": "round,pad=0.2", "fc": colour, "ec": "none"}
        middle = left + width / 2, top + height / 2
        whole.text(*middle, str(region.number), color="white", fontsize=9, ha="center", va="center", bbox=tag)
    whole.set_title(f"regions: {len(measured)}; below: 1 to {len(shown)}", fontsize=10)
    notes = []
    for row, region in enumerate(shown, start=1):
        left, top, width, height = region.roi
        crop = figure.add_subplot(grid[row, 0], xticks=[], yticks=[])
        crop.imshow(coded[top : top + height, left : left + width], interpolation="nearest")
        crop.set_title(f"{region.number}: {width} x {height} px", fontsize=9)
        if region.edge.sfr.numel():
            _draw_edge([figure.add_subplot(grid[row, column]) for column in (1, 2, 3)], region, light.unit)
        else:
            figure.add_subplot(grid[row, 1:]).set_axis_off()
        notes += [f"{region.number}: {doubt}" for doubt in region.doubts]
    figure.supxlabel("\n".join(notes), fontsize=9)
    return figure


def _draw_edge(panels: Sequence[Axes], region: Measured, unit: str) -> None:
    """Edge spread, line spread and response of one region."""
    edge, (esf, lsf, response) = region.edge, panels
    for axes, values, title in (
        (esf, edge.esf, f"edge spread, {unit} above black"),
        (lsf, edge.lsf, "line spread, 1/px"),
    ):
        axes.plot(edge.distance_px, values, color=_LINE, lw=1.3)
        tidy(axes, title=title, x="distance from the edge, px")
    for level in (edge.dark, edge.bright):
        esf.axhline(level, color=GREY, lw=0.8, ls=":")
    if edge.resamples is not None:
        ends = torch.tensor([0.025, 0.975], dtype=torch.float64)
        low, high = torch.quantile(edge.resamples.power, ends, dim=0).clamp_min(0).sqrt().numpy()
        response.fill_between(edge.frequencies.numpy(), low, high, color=_LINE, alpha=0.25, lw=0)
    response.plot(edge.frequencies, edge.sfr, color=_LINE, lw=1.3)
    response.plot([0, edge.mtf50, edge.mtf50], [0.5, 0.5, 0], color=GREY, lw=0.8, ls="--")
    response.set(xlim=(0, 1), ylim=(0, max(1.05, 1.05 * float(edge.sfr.max()))))
    flagged = " (flagged)" if region.doubts else ""
    tidy(response, title=f"SFR, 95 %; MTF50 {edge.mtf50:.4g}{flagged}", x="frequency, cycles/px")
