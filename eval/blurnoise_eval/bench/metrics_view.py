"""Findings of the bench of slanted edges, for the eye: a chart of errors, biases and times, and tables."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from rich.table import Table

from blurnoise_eval.bench.edge_methods import ARRAYS, EXACT, ISO, ROWS, WITH_INTERVALS
from blurnoise_eval.bench.metrics import BIAS_LIMITS, LIMITS, MTF_MAPPER, SIC_LIMITS, Bench, Row, limit_of
from blurnoise_eval.system.files import write_figure

_LOOKS = {
    EXACT: ("#000000", "o"),
    WITH_INTERVALS: ("#009e73", "D"),
    ISO: ("#0072b2", "s"),
    ARRAYS: ("#d55e00", "^"),
    ROWS: ("#e69f00", "v"),
    "MTF Mapper 0.7.38, recorded": ("#cc79a7", "*"),
}
_GREY = "0.45"
_LEAST = 1e-6
"""Errors below are drawn here."""
_VARIED = {
    "sigma": "Gaussian sigma / px",
    "motion": "Motion / px",
    "angle": "Angle of the edge / degrees",
}


def chart(bench: Bench) -> Figure:
    """Errors without noise above; biases with it, and time against error, below. Down is better."""
    figure = Figure(figsize=(12, 7.6), layout="constrained")
    panels = figure.subplots(2, 3)
    for axes, (varied, label) in zip(panels[0], _VARIED.items(), strict=True):
        _draw_errors(axes, bench, varied)
        axes.set_xlabel(label, fontsize=9)
    panels[0, 0].set_ylabel("Error of MTF50, share", fontsize=9)
    _draw_biases(panels[1, 0], bench, "cnr, sharp", "bias", BIAS_LIMITS, "Bias of MTF50, sigma 0.5 px")
    _draw_biases(panels[1, 1], bench, "cnr, moved", "sic_bias", SIC_LIMITS, "Bias of SIC, 6 px of motion")
    _draw_times(panels[1, 2], bench)
    handles = [Line2D([], [], label=name, ls="", **_look(name)) for name in _LOOKS]
    handles.append(Line2D([], [], color=_GREY, lw=1, ls=(0, (4, 3)), label="wanted"))
    figure.legend(
        handles=handles, title="Slanted edges of known response: down and left is better", ncols=len(handles),
        loc="outside upper center", fontsize=8.5, title_fontsize=10, frameon=False, handletextpad=0.3,
    )  # fmt: skip
    figure.supxlabel(
        f"Closed-form edges of 100 x 100 px or more; batches of {bench.extent.batch}; "
        f"{bench.machine['threads']} thread(s), {bench.machine['processor']}. Bars: 2 standard errors, quartiles.",
        fontsize=8, color=_GREY,
    )  # fmt: skip
    return figure


def write(bench: Bench, folder: Path) -> None:
    """Write the chart as metrics.png; raises ``OSError``."""
    write_figure(folder / "metrics.png", chart(bench), dpi=150)


def tables(bench: Bench) -> list[Table]:
    """Errors of MTF50 and the curve, then biases, coverage, and times: methods across."""
    methods = (EXACT, ISO, ARRAYS)
    clean = Table(title="Without noise: error of MTF50, largest error of the curve", title_justify="left")
    noisy = Table(title="With noise: mean over its pictures ± its standard error", title_justify="left")
    clean.add_column("edge")
    for name in ("CNR, blur", "number"):
        noisy.add_column(name)
    for table in (clean, noisy):
        for method in methods:
            table.add_column(method, justify="right")
    for varied in _VARIED:
        columns = [(bench.of(varied, "mtf50_error", m), bench.of(varied, "curve_error", m)) for m in methods]
        for index, row in enumerate(columns[0][0]):
            cells = (f"{errors[index].number:+.3%} {curves[index].number:.4f}" for errors, curves in columns)
            clean.add_row(f"{varied} {row.value:g}", *cells)
        clean.add_section()
    for varied in ("cnr, sharp", "cnr, moved"):
        for quantity, name in (("bias", "MTF50"), ("sic_bias", "SIC"), ("coverage", "intervals that hold")):
            for index, row in enumerate(bench.of(varied, quantity, EXACT)):
                found = [bench.of(varied, quantity, method) for method in methods]
                shown = ("-" if not rows else _mean_text(rows[index], quantity) for rows in found)
                noisy.add_row(f"{row.value:g}, {varied[5:]}", name, *shown)
        noisy.add_section()
    times = Table(title=f"Time per region in a batch of {bench.extent.batch}", title_justify="left")
    for head in ("method", "ms", f"times faster than {ROWS}"):
        times.add_column(head, justify="left" if head == "method" else "right")
    for method in (EXACT, WITH_INTERVALS, ISO, ARRAYS, ROWS):
        times.add_row(method, f"{bench.ms(method):.2f}", f"{bench.ms(ROWS) / bench.ms(method):.1f}")
    return [clean, noisy, times]


def _mean_text(row: Row, quantity: str) -> str:
    sign = "" if quantity == "coverage" else "+"
    return f"{row.number:{sign}.1%} ± {row.error or 0:.1%}{' !' if row.flags else ''}"


def _draw_errors(axes: Axes, bench: Bench, varied: str) -> None:
    for method in (EXACT, ISO, ARRAYS):
        rows = bench.of(varied, "mtf50_error", method)
        heights = [max(abs(row.number), _LEAST) for row in rows]
        axes.plot([row.value for row in rows], heights, lw=1, **_look(method))
    mapper = [(value, abs(error)) for (of, value), error in MTF_MAPPER.items() if of == varied]
    axes.plot(*zip(*mapper, strict=True), ls="", **_look("MTF Mapper 0.7.38, recorded"))
    values = [row.value for row in bench.of(varied, "mtf50_error", EXACT)]
    if varied != "angle":
        axes.set_xscale("log")
    axes.step(
        values, [limit_of(varied, value) for value in values], where="mid", color=_GREY, lw=1, ls=(0, (4, 3))
    )
    axes.set_yscale("log")
    axes.set_ylim(_LEAST / 1.5, 0.3)
    axes.set_title(f"MTF50 without noise, {varied}", fontsize=9)
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    if varied != "angle":
        axes.xaxis.set_major_locator(LogLocator(subs=(1, 3)))
    _dress(axes)


def _draw_biases(
    axes: Axes, bench: Bench, varied: str, quantity: str, limits: dict[float, float], title: str
) -> None:
    for method in (EXACT, ISO, ARRAYS):
        rows = [row for row in bench.of(varied, quantity, method) if math.isfinite(row.number)]
        axes.errorbar(
            [row.value for row in rows], [row.number for row in rows],
            [2 * (row.error or 0) for row in rows], lw=1, elinewidth=1, **_look(method),
        )  # fmt: skip
    for cnr, limit in limits.items():
        for side in (-limit, limit):
            axes.plot([cnr / 1.15, cnr * 1.15], [side, side], color=_GREY, lw=1.2, ls=(0, (2, 1)))
    axes.axhline(0, color=_GREY, lw=0.7)
    axes.set_xscale("log")
    axes.set_yscale("symlog", linthresh=0.02)
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:+.0%}" if value else "0"))
    axes.set_xticks(bench.extent.cnrs, [f"{cnr:g}" for cnr in bench.extent.cnrs])
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_xlabel("CNR", fontsize=9)
    axes.set_title(title, fontsize=9)
    _dress(axes)


def _draw_times(axes: Axes, bench: Bench) -> None:
    for method in (EXACT, WITH_INTERVALS, ISO, ARRAYS, ROWS):
        errors_of = {WITH_INTERVALS: EXACT, ROWS: ARRAYS}.get(method, method)
        errors = [abs(row.number) for varied in _VARIED for row in bench.of(varied, "mtf50_error", errors_of)]
        (time,) = bench.of("time", "ms", method)
        height = max(*errors, _LEAST)
        axes.errorbar([time.number], [height], xerr=[time.error or 0], elinewidth=1, **_look(method))
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.axhline(LIMITS["few phases"], color=_GREY, lw=1, ls=(0, (4, 3)))
    axes.set_xlabel("Time / (ms per region of 100 x 100 px)", fontsize=9)
    axes.set_title("Largest error of MTF50 in the panels above", fontsize=9)
    _dress(axes)


def _dress(axes: Axes) -> None:
    axes.grid(color="0.9", lw=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=8)
    axes.spines[["top", "right"]].set_visible(False)


def _look(name: str) -> dict[str, Any]:
    colour, marker = _LOOKS[name]
    size = 9 if marker == "*" else 5.5
    return {"color": colour, "marker": marker, "ms": size, "mec": "white", "mew": 0.5}
