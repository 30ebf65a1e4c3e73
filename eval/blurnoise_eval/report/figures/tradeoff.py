"""Latency against robustness, a point per model."""

from __future__ import annotations

from matplotlib.figure import Figure

from blurnoise_eval.drawing.annotate import short_text
from blurnoise_eval.report.data import RunData
from blurnoise_eval.report.tradeoff import ROBUSTNESS, comparable, trades


def latency_robustness(data: RunData) -> Figure:
    """A panel per measure of robustness: latency per picture (median, line to the 95th percentile) below it.

    Filled points, joined, are the Pareto front: no other model is faster and as robust, or as fast and more
    robust.
    """
    measures = comparable(data)
    figure = Figure(figsize=(max(5.0, 4.2 * len(measures)), 4.0), layout="constrained")
    grid = figure.subplots(1, max(1, len(measures)), squeeze=False)[0]
    if not measures:
        grid[0].set_axis_off()
        grid[0].text(0.5, 0.5, "No two models with latency and robustness.", ha="center")
        return figure
    for axes, measure in zip(grid, measures, strict=True):
        found = trades(data, measure)
        front = sorted((trade for trade in found if trade.best), key=lambda trade: trade.latency_ms)
        axes.plot(
            [trade.latency_ms for trade in front],
            [trade.robustness for trade in front],
            "-",
            color="0.7",
            lw=1,
        )
        for trade in found:
            colour = "#1f5f99" if trade.best else "0.45"
            if trade.p95_ms is not None:
                axes.plot(
                    [trade.latency_ms, trade.p95_ms], [trade.robustness] * 2, color=colour, lw=1, alpha=0.6
                )
            axes.plot(
                trade.latency_ms,
                trade.robustness,
                "o",
                color=colour,
                mfc=colour if trade.best else "white",
                ms=6,
            )
            axes.annotate(
                short_text(trade.model, 28), (trade.latency_ms, trade.robustness), (5, 6), fontsize=8,
                textcoords="offset points", parse_math=False,
            )  # fmt: skip
        axes.set_ylabel(ROBUSTNESS[measure], fontsize=9)
        axes.margins(y=0.2)
        axes.set_xlim(0, 1.3 * max(trade.p95_ms or trade.latency_ms for trade in found))
        axes.grid(color="0.9", lw=0.6)
        axes.set_axisbelow(True)
        axes.tick_params(labelsize=8)
        axes.spines[["top", "right"]].set_visible(False)
    threads = sorted({row["latency_threads"] for row in data.models if row["latency_threads"]})
    stated = f", {', '.join(map(str, threads))} thread{'s' if threads != [1] else ''}" if threads else ""
    figure.supxlabel(
        f"Latency of one picture / ms{stated}: median, line to the 95th percentile. Filled: Pareto front.",
        fontsize=9,
    )
    return figure
