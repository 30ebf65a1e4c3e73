"""Findings of the bench of sensor noise, for the eye: a chart of time and distance, and tables."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter, NullLocator
from rich.table import Table

from blurnoise_eval.bench.noise import YARDSTICK, Bench, Row
from blurnoise_eval.system.files import write_figure

_MARKERS = {
    "auto": ("#000000", "o"),
    "full": ("#0072b2", "s"),
    "torch.poisson": ("#d55e00", "^"),
    "numpy poisson": ("#e69f00", "v"),
    "plain normal": ("#009e73", "X"),
}
_GREY = "0.45"
_LEAST = 1e-6
"""Distances below are drawn here."""


def chart(bench: Bench) -> Figure:
    """A panel per mean: time against distance from the exact law. Down and left is better.

    Filled: the first read noise, hollow: the others. An arrow down: an exact sampler as far as n values show.
    """
    means = bench.extent.means_e
    columns = min(4, len(means))
    lines = -(-len(means) // columns)
    figure = Figure(figsize=(max(8.0, 3.0 * columns), 1.5 + 2.7 * lines), layout="constrained")
    panels = list(figure.subplots(lines, columns, sharex=True, sharey=True, squeeze=False).flat)
    for index, (axes, mean_e) in enumerate(zip(panels, means, strict=False)):
        _draw(axes, bench, mean_e)
        axes.set_title(f"{mean_e:g} e-", fontsize=9)
        if index % columns == 0:
            axes.set_ylabel("Total variation distance", fontsize=9)
        if index + columns >= len(means):
            axes.set_xlabel("Time / (ns per value)", fontsize=9)
            axes.tick_params(labelbottom=True)
    for axes in panels[len(means) :]:
        axes.remove()
    shape = " x ".join(map(str, bench.extent.shape))
    figure.supxlabel(
        f"{shape} float32, {bench.machine['threads']} threads, {bench.machine['processor']}. Bars: quartiles. "
        f"Vertical line: {YARDSTICK}. Arrows: no distance found, below what as many exact samples differ by.",
        fontsize=8, color=_GREY,
    )  # fmt: skip
    reads = bench.extent.read_noises_e
    handles = [Line2D([], [], label=s.name, ls="", **_look(s.name, filled=True)) for s in bench.samplers]
    handles += [
        Line2D([], [], label=f"read noise {read:g} e-", ls="", **_look("", filled=read == reads[0]))
        for read in reads
    ]
    figure.legend(
        handles=handles, title="Sensor noise: down and left is better", loc="outside upper center",
        fontsize=8, title_fontsize=9, ncols=len(handles) if columns > 2 else 4, frameon=False,
        columnspacing=1.4, handletextpad=0.3,
    )  # fmt: skip
    return figure


def write(bench: Bench, folder: Path) -> None:
    """Write the chart as noise.png; raises ``OSError``."""
    write_figure(folder / "noise.png", chart(bench), dpi=150)


def tables(bench: Bench) -> list[Table]:
    """Time, time over the yardstick's, and distance: samplers down, means across."""

    def number(value: float) -> str:
        return f"{value:.1f}" if value < 10 else f"{value:.0f}"

    def distance(row: Row) -> str:
        unseen = row.integrated is None and not bench.noticed(row)
        return f"<{number(1e4 * row.floor)}" if unseen else number(1e4 * row.distance)

    return [
        _table(bench, "Time, ns per value", lambda row: number(row.ns.median)),
        _table(bench, f"Time, times that of {YARDSTICK}", lambda row: number(row.to_randn)),
        _table(bench, "Total variation distance, 1e-4 (<: samples show none)", distance),
    ]


def _table(bench: Bench, title: str, cell: Callable[[Row], str]) -> Table:
    table = Table(title=title, title_justify="left")
    table.add_column("mean, e-", no_wrap=True)
    for mean_e in bench.extent.means_e:
        table.add_column(f"{mean_e:g}", justify="right")
    for read in bench.extent.read_noises_e:
        for sampler in bench.samplers:
            cells = [cell(bench.row(sampler.name, read, mean_e)) for mean_e in bench.extent.means_e]
            table.add_row(f"{sampler.name}, {read:g} e-", *cells)
        table.add_section()
    return table


def _draw(axes: Axes, bench: Bench, mean_e: float) -> None:
    rows = [row for row in bench.rows if row.mean_e == mean_e]
    axes.axvline(rows[0].ns.median / rows[0].to_randn, color=_GREY, lw=1, ls=(0, (1, 2)), zorder=1)
    for row in rows:
        look = _look(row.sampler, filled=row.read_noise_e == bench.extent.read_noises_e[0])
        unseen = row.integrated is None and not bench.noticed(row)
        height = max(row.floor if unseen else row.distance, _LEAST)
        axes.plot([row.ns.low, row.ns.high], [height, height], color=look["color"], lw=1.2, zorder=2)
        axes.plot(row.ns.median, height, zorder=3, **look)
        if unseen:
            axes.annotate(
                "", (row.ns.median, height / 5), (row.ns.median, height / 1.5), zorder=2,
                arrowprops={"arrowstyle": "->", "color": look["color"], "lw": 0.9},
            )  # fmt: skip
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_ylim(_LEAST / 2, 1)
    axes.yaxis.set_major_locator(LogLocator(numticks=10))
    axes.xaxis.set_major_locator(LogLocator(subs=(1, 3)))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_minor_locator(NullLocator())
        axis.set_minor_formatter(NullFormatter())
    axes.grid(color="0.9", lw=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=8)
    axes.spines[["top", "right"]].set_visible(False)


def _look(sampler: str, *, filled: bool) -> dict[str, Any]:
    colour, marker = _MARKERS.get(sampler, (_GREY, "o"))
    face = (
        {"mfc": colour, "mec": "white", "mew": 0.5} if filled else {"mfc": "none", "mec": colour, "mew": 1.2}
    )
    return {"color": colour, "marker": marker, "ms": 7 if filled else 6, **face}
