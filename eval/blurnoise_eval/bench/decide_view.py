"""Findings of the bench of searches, for the eye: errors of edges over calls, tables."""

from __future__ import annotations

from pathlib import Path

from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from rich.table import Table

from blurnoise_eval.bench.decide import GRID_EXPOSURES, METHODS, Bench, Row
from blurnoise_eval.system.files import write_figure

_COLOURS = dict(zip(METHODS, ("#0072b2", "#e69f00", "#000000", "#cc79a7"), strict=True))
_MARKS = dict(zip(METHODS, "osD^", strict=True))
_GREY = "0.45"
_LEAST = 1e-3  # stops that are drawn


def chart(bench: Bench) -> Figure:
    """A column per plane and scenario, over calls: above, what half of the edges are off by at most; below, stops of
    a line that are told wrongly. The search's own end is ringed."""
    columns = list(dict.fromkeys((row.plane, row.scenario) for row in bench.rows))
    figure = Figure(figsize=(1.2 + 3.6 * len(columns), 6.6), layout="constrained")
    panels = figure.subplots(2, len(columns), sharex="col", sharey="row", squeeze=False)
    for place, (plane, scenario) in enumerate(columns):
        for axes, name in zip(panels[:, place], ("median", "wrong"), strict=True):
            for method in METHODS:
                rows = sorted(_of(bench, plane, scenario, method), key=lambda row: row.share)
                shares = [row.share for row in rows]
                values = [max(getattr(row, name), _LEAST) for row in rows]
                axes.plot(shares, values, f"{_MARKS[method]}-", color=_COLOURS[method], ms=3.5, lw=1.4)
                ends = [(x, y) for x, y, row in zip(shares, values, rows, strict=True) if row.own_end]
                axes.plot(
                    *zip(*ends, strict=True), "o", mfc="none", color=_COLOURS[method], ms=9
                ) if ends else None
            axes.set_xscale("log")
            axes.set_yscale("log")
            axes.axvline(1, color=_GREY, lw=0.8, ls=(0, (4, 3)))
            axes.tick_params(labelsize=7)
            axes.spines[["top", "right"]].set_visible(False)
        panels[0, place].set_title(f"{plane}\n{scenario}", fontsize=8)
    panels[0, 0].set_ylabel("error of edges, median, stops", fontsize=8)
    panels[1, 0].set_ylabel("told wrongly, stops per line", fontsize=8)
    figure.supxlabel(
        f"Conditions asked, by those of the grid of {GRID_EXPOSURES} exposures (dashed). Ring: where the search "
        "ends by itself.",
        fontsize=8, color=_GREY,
    )  # fmt: skip
    handles = [
        Line2D([], [], color=_COLOURS[name], marker=_MARKS[name], ms=4, label=name) for name in METHODS
    ]
    figure.legend(handles=handles, loc="outside upper center", ncols=len(handles), fontsize=8, frameon=False)
    return figure


def write(bench: Bench, folder: Path) -> None:
    """Write the chart as decide.png; raises ``OSError``."""
    write_figure(folder / "decide.png", chart(bench), dpi=150)


def tables(bench: Bench) -> list[Table]:
    """Per plane and scenario a row per method and number of calls."""
    made = []
    for plane, scenario in dict.fromkeys((row.plane, row.scenario) for row in bench.rows):
        table = Table(title=f"{plane}: {scenario}; * where the search ends by itself", title_justify="left")
        for name in ("", "calls", "of the grid", "edges", "missed", "median", "90 %", "wrong", "error/sigma"):
            table.add_column(name, justify="right" if name else "left", no_wrap=True)
        for method in METHODS:
            for row in _of(bench, plane, scenario, method):
                misfit = "" if row.misfit is None else f"{row.misfit:.2f}"
                errors = (f"{value:.3f}" for value in (row.median, row.high, row.wrong))
                calls = f"{row.calls}{'*' if row.own_end else ''}"
                table.add_row(
                    method, calls, f"{row.share:.3f}", f"{row.edges}", f"{row.missed}", *errors, misfit
                )
            table.add_section()
        made.append(table)
    return made


def _of(bench: Bench, plane: str, scenario: str, method: str) -> list[Row]:
    return [row for row in bench.rows if (row.plane, row.scenario, row.method) == (plane, scenario, method)]
