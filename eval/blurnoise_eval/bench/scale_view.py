"""Findings of the bench of scale, for the eye: cells/s over cores, measured and on paper; a table."""

from __future__ import annotations

from pathlib import Path

from matplotlib.figure import Figure
from rich.table import Table

from blurnoise_eval.bench.scale import CELL_S, CORES, Bench
from blurnoise_eval.system.files import write_figure

_COLOURS = ("#0072b2", "#009e73", "#e69f00", "#cc79a7")
_GREY = "0.45"


def chart(bench: Bench) -> Figure:
    """A panel per engine: cells/s over workers. Lines: on paper, with the driver's limit; dots: measured."""
    figure = Figure(figsize=(4.2 * len(bench.engines), 3.6), layout="constrained")
    panels = figure.subplots(1, len(bench.engines), sharex=True, sharey=True, squeeze=False)[0]
    for axes, engine in zip(panels, bench.engines, strict=True):
        for colour, cell_s in zip(_COLOURS, CELL_S, strict=True):
            turn = bench.most_rate(engine) * cell_s  # cores from which on the driver is full
            cores = sorted({*CORES, min(max(turn, CORES[0]), CORES[-1])})
            rates = [bench.paper(engine, cell_s, each) for each in cores]
            axes.plot(cores, rates, color=colour, label=f"{1e3 * cell_s:g} ms a cell")
        axes.axhline(bench.most_rate(engine), color=_GREY, lw=0.8, ls=(0, (4, 3)))
        rows = [row for row in bench.rows if row.engine == engine and row.cell_s]
        axes.plot([row.workers for row in rows], [row.rate for row in rows], "o", color="black", ms=3.5)
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_title(f"{engine}: at most {bench.most_rate(engine):.0f} cells/s", fontsize=9)
        axes.set_xlabel("cores")
        axes.spines[["top", "right"]].set_visible(False)
    panels[0].set_ylabel("cells/s")
    panels[-1].legend(fontsize=8, frameon=False)
    return figure


def write(bench: Bench, folder: Path) -> None:
    """Write the chart as scale.png; raises ``OSError``."""
    write_figure(folder / "scale.png", chart(bench), dpi=150)


def tables(bench: Bench) -> list[Table]:
    """A row per engine, number of workers and cell."""
    title = (
        "Engines over workers and ms that a cell sleeps: cells/s, % of what it allows, ms of the driver a cell (the "
        f"store's {bench.store_ms:.2f} not among them), s to the first answer, MB of the driver, MB of a worker"
    )
    table = Table(title=title, title_justify="left")
    for name in ("", "workers", "ms", "cells/s", "%", "driver", "start", "MB", "each"):
        table.add_column(name, justify="right" if name else "left", no_wrap=True)
    for row in bench.rows:
        of_ideal = "" if row.ideal is None else f"{100 * row.rate / row.ideal:.0f}"
        worker_mb = "" if row.worker_mb is None else f"{row.worker_mb:.0f}"
        table.add_row(
            row.engine, f"{row.workers}", f"{1e3 * row.cell_s:g}", f"{row.rate:.0f}", of_ideal,
            f"{row.driver_ms:.2f}", f"{row.start_s:.1f}", f"{row.driver_mb:.0f}", worker_mb,
        )  # fmt: skip
    return [table]
