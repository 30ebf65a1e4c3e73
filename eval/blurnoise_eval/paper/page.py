"""The page of the rerun, one HTML file that works offline, and paper.csv."""

from __future__ import annotations

import base64
import io
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from matplotlib.figure import Figure as Drawn

from blurnoise_eval.paper.item import COLUMNS, NOT_RUN, VERDICTS, Figure, Outcome
from blurnoise_eval.paper.items import NOT_COMPARED
from blurnoise_eval.plots.style import COLOURS, plain_numbers, tidy
from blurnoise_eval.report.page import write_page
from blurnoise_eval.system.files import write_whole
from blurnoise_eval.system.tables import csv_lines


def write(outcomes: Sequence[Outcome], how: str, folder: Path) -> None:
    """Write paper.csv and paper.html; raises ``OSError``."""
    folder.mkdir(parents=True, exist_ok=True)
    write_whole(folder / "paper.csv", (line.encode() for line in csv_lines(COLUMNS, rows_of(outcomes))))
    shown = {"outcomes": outcomes, "summary": summary(outcomes), "not_compared": NOT_COMPARED}
    template = Path(__file__).parent / "templates" / "paper.html.j2"
    write_page(folder / "paper.html", template, how=how, png=png, **shown)


def rows_of(outcomes: Sequence[Outcome]) -> list[dict[str, str]]:
    """The rows of paper.csv."""
    return [row for outcome in outcomes for row in outcome.rows]


def summary(outcomes: Sequence[Outcome]) -> str:
    """'30 of 32 statements of the paper agree; differ: 2; items not run: 1.'"""
    count = Counter(row["verdict"] for row in rows_of(outcomes))
    agree, differ, missing = (count[verdict] for verdict in (VERDICTS[True], VERDICTS[False], NOT_RUN))
    text = f"{agree} of {agree + differ} statements of the paper agree"
    text += f"; differ: {differ}" if differ else ""
    text += f"; items not run: {missing}" if missing else ""
    return f"{text}."


def png(figure: Figure) -> str:
    """The figure in base64, 560 x 360 px at twice the density: lines found here, yellow what the paper says."""
    drawn = Drawn(figsize=(5.6, 3.6), layout="constrained")
    axes = drawn.subplots()
    for place, (label, curve) in enumerate(figure.lines.items()):
        axes.plot(*zip(*curve.items(), strict=True), "o-", color=COLOURS[place], ms=3.2, lw=1.4, label=label)
    if min(x for curve in figure.lines.values() for x in curve) > 0:
        axes.set_xscale("log")
        plain_numbers(axes.xaxis, digits=(1, 2, 5))
    for row, (low, high, what) in enumerate(figure.published):
        axes.axvspan(low, high, color="#e8b000", alpha=0.35, lw=1.6, zorder=0)
        axes.annotate(
            what, (low, 1.0), (0, 3 + 9 * row), xycoords=("data", "axes fraction"),
            textcoords="offset points", fontsize=7.5, color="#7a5c00",
        )  # fmt: skip
    drawn.suptitle(figure.title, fontsize=9)
    tidy(axes, x=figure.x_label, y=figure.y_label)
    axes.legend(fontsize=7.5, frameon=False)
    made = io.BytesIO()
    drawn.savefig(made, format="png", dpi=200)
    return base64.b64encode(made.getvalue()).decode("ascii")
