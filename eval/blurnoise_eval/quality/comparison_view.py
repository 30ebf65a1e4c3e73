"""A comparison for the eye: a table of 80 columns, and a figure of noise over level and of both spectra."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from blurnoise_eval.quality.comparison import Compared

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.table import Table


def as_table(found: Compared) -> Table:
    """A row per quantity, within 80 columns."""
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False, padding=(0, 1, 0, 0))
    table.add_column("quantity")
    for head in ("simulated", "real", "chance"):
        table.add_column(head, justify="right")
    table.add_column("verdict")
    for each in found.quantities:
        scale, unit = (100, " %") if each.unit == "of full scale" else (1, "")
        chance = f"±{100 * each.chance:.2g} %" if math.isfinite(each.chance) else "-"
        numbers = (
            f"{scale * value:.4g}{unit}" if math.isfinite(value) else "-"
            for value in (each.simulated, each.real)
        )
        table.add_row(each.name, *numbers, chance, each.verdict)
    return table


def draw(found: Compared) -> Figure:
    """Noise over level, and the relative power spectra, of both pictures."""
    from matplotlib.figure import Figure

    from blurnoise_eval.plots.style import COLOURS, tidy

    figure = Figure(figsize=(11.4, 4.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    for column, label, mark, colour in ((1, "simulated", "o-", COLOURS[0]), (2, "real", "s--", COLOURS[1])):
        left.plot(
            100 * found.levels[:, 0],
            100 * found.levels[:, column],
            mark,
            ms=5,
            color=colour,
            label=label,
        )
        right.loglog(found.spectrum[0], found.spectrum[column], mark[1:], color=colour, lw=1.2, label=label)
    tidy(left, x="Level / % of full scale", y="Noise / % of full scale")
    tidy(right, x="Frequency / cycles per px", y="Power relative to mean² / px²")
    for axes in (left, right):
        axes.legend(fontsize=8.5, frameon=False)
    return figure
