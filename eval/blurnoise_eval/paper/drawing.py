"""The figures of the page, as PNG: lines found here, shaded or marked what the paper says."""

from __future__ import annotations

import io
import math

from matplotlib.figure import Figure as Drawn

from blurnoise_eval.paper.item import Figure
from blurnoise_eval.plots.style import COLOURS, plain_numbers, tidy

_QUOTED = "#e8b000"


def png(figure: Figure) -> bytes:
    """The figure, 560 x 360 px at twice the density."""
    drawn = Drawn(figsize=(5.6, 3.6), layout="constrained")
    axes = drawn.subplots()
    for place, line in enumerate(figure.lines):
        colour = COLOURS[(place if line.colour is None else line.colour) % len(COLOURS)]
        style = "o" if figure.points else "--" if line.dashed else "o-"
        axes.plot(line.x, line.y, style, color=colour, ms=3.2, lw=1.4, label=line.label, zorder=3)
        lost = [x for x, y in zip(line.x, line.y, strict=True) if math.isnan(y)]
        foot = [0.03 + 0.03 * place] * len(lost)
        axes.plot(lost, foot, "x", color=colour, ms=4.5, mew=1.2, transform=axes.get_xaxis_transform())
    withheld = any(math.isnan(y) for line in figure.lines for y in line.y)
    if figure.logarithmic and not figure.points:
        axes.set_xscale("log")
        plain_numbers(axes.xaxis, digits=(1, 2, 5))
    for row, (low, high, what) in enumerate(figure.quoted):
        if high > low:
            axes.axvspan(low, high, color=_QUOTED, alpha=0.22, lw=0, zorder=0)
        else:
            axes.axvline(low, color=_QUOTED, lw=1.6, zorder=1)
        middle = (low * high) ** 0.5 if axes.get_xscale() == "log" else (low + high) / 2
        axes.annotate(
            what, (middle, 1.0), (0, 3 + 9 * (row % 3)), xycoords=("data", "axes fraction"),
            textcoords="offset points", fontsize=7.5, color="#7a5c00", ha="center",
        )  # fmt: skip
    if figure.level is not None:
        axes.axhline(figure.level, color="0.6", lw=0.9, zorder=1)
        axes.set_ylim(-0.04, 1.04)
    tidy(axes, x=figure.x_label, y=figure.y_label)
    if len(figure.lines) > 1:
        title = "cross at the foot: withheld" if withheld else None
        axes.legend(
            fontsize=7.5,
            frameon=False,
            title=title,
            title_fontsize=7.5,
            ncols=2 if len(figure.lines) > 5 else 1,
        )
    made = io.BytesIO()
    drawn.savefig(made, format="png", dpi=200)
    return made.getvalue()
