"""Latency against robustness: which models are beaten by none in both, and the figure of them.

Domain: latency in ms per picture, robustness as a fraction (area under a curve over its range, or rPC).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from matplotlib.figure import Figure

from blurnoise_eval.plots.annotate import short_text
from blurnoise_eval.plots.style import say_only, small_multiples, tidy
from blurnoise_eval.report.run import RunData
from blurnoise_eval.system.tables import finite

ROBUSTNESS = {"auc_exposure": "AUC over exposure", "auc_blur": "AUC over blur", "rpc": "rPC"}
"""Columns of the table of models that latency is drawn against."""


class Trade(NamedTuple):
    """One model's place: median latency, its 95th percentile, a robustness; ``best``: on the Pareto front."""

    model: str
    latency_ms: float
    p95_ms: float | None
    robustness: float
    best: bool


def trades(data: RunData, measure: str) -> list[Trade]:
    """Every model with a latency and this robustness (a key of ``ROBUSTNESS``), in the run's order."""
    front = pareto_front([(row["latency_ms"], row[measure]) for row in data.models])
    return [
        Trade(row["model"], latency, finite(row["latency_p95_ms"]), robustness, best)
        for row, best in zip(data.models, front, strict=True)
        if (latency := finite(row["latency_ms"])) is not None
        and (robustness := finite(row[measure])) is not None
    ]


def pareto_front(points: Sequence[tuple[float | None, float | None]]) -> list[bool]:
    """For each (cost, gain), whether no other point costs no more, gains no less and betters it in one of both.

    Equal points stand on the front together. A point that lacks a value, or whose value is not finite, is
    not on it and keeps none off it.
    """
    known = [(finite(cost), finite(gain)) for cost, gain in points]
    whole = [(cost, gain) for cost, gain in known if cost is not None and gain is not None]
    return [
        cost is not None
        and gain is not None
        and not any(c <= cost and g >= gain and (c, g) != (cost, gain) for c, g in whole)
        for cost, gain in known
    ]


def comparable(data: RunData) -> list[str]:
    """The measures of robustness by which at least two models can be compared."""
    return [measure for measure in ROBUSTNESS if len(trades(data, measure)) > 1]


def latency_robustness(data: RunData, measures: Sequence[str] | None = None) -> Figure:
    """A panel per measure of robustness, by default all: latency per picture (median, line to the 95th percentile).

    Filled points, joined, are the Pareto front: no other model is faster and as robust, or as fast and more
    robust.
    """
    measures = comparable(data) if measures is None else measures
    columns = max(1, len(measures))
    figure, grid = small_multiples(columns, columns, (3.6, 2.9) if columns == 1 else (4.2, 4.0), (0.0, 0.0))
    if not measures:
        say_only(grid[0], "No two models with latency and robustness.")
        return figure
    for axes, measure in zip(grid, measures, strict=True):
        found = trades(data, measure)
        front = sorted((trade for trade in found if trade.best), key=lambda trade: trade.latency_ms)
        axes.plot([t.latency_ms for t in front], [t.robustness for t in front], "-", color="0.7", lw=1)
        for trade in found:
            at, colour = (trade.latency_ms, trade.robustness), "#1f5f99" if trade.best else "0.45"
            if trade.p95_ms is not None:
                axes.plot([at[0], trade.p95_ms], [at[1]] * 2, color=colour, lw=1, alpha=0.6)
            axes.plot(*at, "o", color=colour, mfc=colour if trade.best else "white", ms=6)
            axes.annotate(
                short_text(trade.model, 28),
                at,
                (5, 6),
                fontsize=8,
                textcoords="offset points",
                parse_math=False,
            )
        tidy(axes, y=ROBUSTNESS[measure])
        axes.margins(y=0.2)
        axes.set_xlim(0, 1.3 * max(trade.p95_ms or trade.latency_ms for trade in found))
    threads = sorted({row["latency_threads"] for row in data.models if row["latency_threads"]})
    stated = f", {', '.join(map(str, threads))} thread{'s' if threads != [1] else ''}" if threads else ""
    reading = ": median, line to the 95th percentile. Filled: Pareto front." * (columns > 1)
    figure.supxlabel(f"Latency of one picture / ms{stated}{reading}", fontsize=9)
    return figure
