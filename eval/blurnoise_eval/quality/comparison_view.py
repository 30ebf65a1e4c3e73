"""A comparison for the eye: a table of 80 columns, and a figure of noise over level and of both spectra."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

from blurnoise_eval.quality.comparison import Compared
from blurnoise_eval.system.files import write_figure

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

    figure = Figure(figsize=(11.4, 4.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    for column, label, mark, colour in ((1, "simulated", "o-", "#0072b2"), (2, "real", "s--", "#d55e00")):
        left.plot(
            100 * found.levels[:, 0],
            100 * found.levels[:, column],
            mark,
            ms=5,
            color=colour,
            label=label,
        )
        right.loglog(found.spectrum[0], found.spectrum[column], mark[1:], color=colour, lw=1.2, label=label)
    left.set_xlabel("Level / % of full scale", fontsize=9)
    left.set_ylabel("Noise / % of full scale", fontsize=9)
    right.set_xlabel("Frequency / cycles per px", fontsize=9)
    right.set_ylabel("Power relative to mean² / px²", fontsize=9)
    for axes in (left, right):
        axes.grid(color="0.92", lw=0.6)
        axes.legend(fontsize=8.5, frameon=False)
    return figure


def write(found: Compared, path: Path) -> None:
    """Write :func:`draw`'s figure as PNG, SVG or PDF. Raises ``OSError``."""
    write_figure(path, draw(found), dpi=150)
