"""Findings of the bench of intervals, for the eye: coverage and width over the number of pictures, tables."""

from __future__ import annotations

from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import NullLocator, PercentFormatter
from rich.table import Table

from blurnoise_eval.bench.intervals import CANDIDATES, QUANTITIES, WANTED, Bench, taken
from blurnoise_eval.bench.simulated import POPULATIONS
from blurnoise_eval.scoring.certainty import CONFIDENCE, FEWEST
from blurnoise_eval.system.files import write_figure

_COLOURS = dict(zip(CANDIDATES, ("#cc79a7", "#e69f00", "#56b4e9", "#0072b2", "#000000"), strict=True))
_GREY = "0.45"
_LOWEST = 0.45  # coverage that is drawn


def chart(bench: Bench) -> Figure:
    """Per population two rows: coverage, with the band that is wanted, and width; a column per quantity.

    The candidate that is taken of a quantity is drawn thick.
    """
    figure = Figure(figsize=(2.6 * len(QUANTITIES), 9.6), layout="constrained")
    panels = figure.subplots(2 * len(POPULATIONS), len(QUANTITIES), sharex=True)
    for place, population in enumerate(POPULATIONS):
        for column, quantity in enumerate(QUANTITIES):
            above, below = panels[2 * place, column], panels[2 * place + 1, column]
            above.axhspan(*WANTED, color="0.88", lw=0)
            above.axhline(CONFIDENCE, color=_GREY, lw=0.8)
            for candidate in CANDIDATES:
                rows = [bench.row(population.name, quantity, n, candidate) for n in bench.extent.pictures]
                look = {"color": _COLOURS[candidate], "ms": 3.5}
                look["lw"] = 2.6 if candidate == taken(quantity) else 1.1
                n = [row.pictures for row in rows]
                above.plot(n, [max(row.coverage, _LOWEST) for row in rows], "o-", **look)
                below.plot(n, [row.width for row in rows], "o-", **look)
            above.set_ylim(_LOWEST, 1.005)
            above.yaxis.set_major_formatter(PercentFormatter(1, decimals=0))
            below.set_ylim(bottom=0)
            above.set_title(quantity, fontsize=9)
            for axes in (above, below):
                _dress(axes, bench)
        panels[2 * place, 0].set_ylabel(f"{population.name}\nholds the truth", fontsize=9)
        panels[2 * place + 1, 0].set_ylabel("width (stops for windows)", fontsize=9)
    figure.supxlabel(
        f"Pictures; {bench.extent.replications} samples of each number, nominal {100 * CONFIDENCE:g} %. Thick: "
        f"the one that is taken, from {FEWEST} pictures on (dashed).",
        fontsize=8, color=_GREY,
    )  # fmt: skip
    handles = [Line2D([], [], color=_COLOURS[name], label=name, lw=2) for name in CANDIDATES]
    figure.legend(handles=handles, loc="outside upper center", ncols=len(handles), fontsize=9, frameon=False)
    return figure


def write(bench: Bench, folder: Path) -> None:
    """Write the chart as intervals.png; raises ``OSError``."""
    write_figure(folder / "intervals.png", chart(bench), dpi=150)


def tables(bench: Bench) -> list[Table]:
    """Per population a row per quantity and number of pictures: coverage of each candidate, width of the taken."""
    made = []
    for population in POPULATIONS:
        title = f"{population.name.capitalize()}: intervals that hold the truth, %; * the one taken, and its width"
        table = Table(title=title, title_justify="left")
        for name in ("", "n", "boot", *CANDIDATES[1:], "width"):
            table.add_column(name, justify="right" if name else "left", no_wrap=True)
        for quantity in QUANTITIES:
            for n in bench.extent.pictures:
                rows = [bench.row(population.name, quantity, n, each) for each in CANDIDATES]
                told = [n >= FEWEST and row.candidate == taken(quantity) for row in rows]
                cells = [
                    f"{100 * row.coverage:.1f}{'*' if it else ''}" for row, it in zip(rows, told, strict=True)
                ]
                width = "".join(f"{row.width:.3f}" for row, it in zip(rows, told, strict=True) if it)
                table.add_row(quantity if n == bench.extent.pictures[0] else "", f"{n}", *cells, width)
            table.add_section()
        made.append(table)
    return made


def _dress(axes: Axes, bench: Bench) -> None:
    axes.set_xscale("log")
    axes.set_xticks(bench.extent.pictures, [f"{n}" for n in bench.extent.pictures])
    axes.xaxis.set_minor_locator(NullLocator())
    axes.axvline(FEWEST, color=_GREY, lw=0.8, ls=(0, (4, 3)))
    axes.tick_params(labelsize=7)
    axes.spines[["top", "right"]].set_visible(False)
