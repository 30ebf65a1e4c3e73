"""Findings of the bench of deceitful edges, for the eye: a chart of shares, and tables."""

from __future__ import annotations

import math
from pathlib import Path

from matplotlib.figure import Figure
from rich.table import Table

from blurnoise_eval.bench.edges import CAUGHT, NOISE_CNR, SETTINGS, SPARED, Bench
from blurnoise_eval.system.files import write_figure

_WITHHELD, _FLAGGED = "#d1495b", "#f0a050"


def chart(bench: Bench) -> Figure:
    """A bar per case, the deceitful ones above: what share is withheld, what share flagged; a panel per setting."""
    count = len(bench.rows) // len(SETTINGS)
    figure = Figure(figsize=(13, 0.22 * count + 1.2), layout="constrained")
    for axes, setting in zip(figure.subplots(1, len(SETTINGS), sharey=True), SETTINGS, strict=True):
        rows = [row for row in bench.rows if row.setting == setting]
        place = range(len(rows))
        axes.barh(place, [row.withheld for row in rows], color=_WITHHELD, label="withheld")
        axes.barh(
            place,
            [row.flagged for row in rows],
            left=[row.withheld for row in rows],
            color=_FLAGGED,
            label="flagged",
        )
        for share in (CAUGHT, SPARED):
            axes.axvline(share, color="0.45", lw=1, ls=(0, (4, 3)))
        axes.axhline(sum(row.deceives for row in rows) - 0.5, color="0.2", lw=1)
        axes.set_yticks(place, [row.case for row in rows], fontsize=8)
        axes.set(xlim=(0, 1), ylim=(len(rows) - 0.4, -0.6), title=f"{setting} setting")
        axes.tick_params(labelsize=8)
    figure.axes[0].legend(loc="lower right", fontsize=8)
    figure.supxlabel("Share of pictures; above the line edges that deceive, below honest ones", fontsize=9)
    return figure


def write(bench: Bench, folder: Path) -> None:
    """Write the chart as edges.png; raises ``OSError``."""
    write_figure(folder / "edges.png", chart(bench), dpi=130)


def tables(bench: Bench) -> list[Table]:
    """Shares by case, the settings side by side, and what noise that is not white does to intervals and NEQ(0)."""
    pictures = bench.extent.pictures
    shares = Table(
        title=f"Withheld + flagged, and plain wrong, % of {pictures}; median error of MTF50",
        title_justify="left",
    )
    shares.add_column("edge")
    for setting in SETTINGS:
        shares.add_column(setting, justify="right")
        shares.add_column("wrong", justify="right")
        shares.add_column("error", justify="right")
    by_case: dict[str, list[str]] = {}
    for row in bench.rows:
        error = f"{row.error:+.1%}" if math.isfinite(row.error) else "-"
        by_case.setdefault(row.case, []).extend(
            [f"{100 * row.withheld:.0f} + {100 * row.flagged:.0f}", f"{100 * row.wrong:.0f}", error]
        )
    last = [row.case for row in bench.rows if row.deceives][-1]
    for case, cells in by_case.items():
        shares.add_row(case, *cells, end_section=case == last)
    noises = Table(title=f"Noise that is not white, CNR {NOISE_CNR:g}", title_justify="left")
    for head in ("noise", "intervals that hold", "flagged", "NEQ(0) / truth", "NEQ(0) flagged"):
        noises.add_column(head, justify="left" if head == "noise" else "right")
    for kind in bench.noises:
        ratio = f"{kind.neq_0:.2f}" if math.isfinite(kind.neq_0) else "-"
        noises.add_row(
            kind.noise, f"{kind.coverage:.0%}", f"{kind.flagged:.0%}", ratio, f"{kind.neq_0_flagged:.0%}"
        )
    return [shares, noises]
