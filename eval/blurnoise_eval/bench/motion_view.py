"""Findings of the bench of moving things, for the eye: a panel of time and error for each job, and tables."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter, NullLocator
from rich.table import Table

from blurnoise_eval.bench.motion import Bench
from blurnoise_eval.bench.motion_job import OURS, Job, Method
from blurnoise_eval.bench.motion_peers import FRAMES
from blurnoise_eval.system.files import write_figure

_MARKERS = {
    OURS: ("#000000", "o", "ours"),
    FRAMES: ("#0072b2", "s", "mean of N warped frames (N beside it)"),
    "naive blend": ("#d55e00", "X", "naive blend by the blurred matte"),
    "all blurred": ("#e69f00", "P", "the whole picture blurred alike"),
    "PSF": ("#009e73", "D", "point spread of the path, drawn on pixels"),
    "deepinv": ("#56b4e9", "h", "deepinv's trajectory PSF"),
    "kornia": ("#cc79a7", "^", "Kornia, one straight blur"),
    "albumentations": ("#777777", "p", "albumentations, one straight blur"),
    "cv2.remap": ("#8c564b", "v", "our blur, warped by OpenCV"),
    "one of the two": ("#bcbd22", "<", "skew or blur alone"),
    "one blur": ("#e69f00", ">", "our blur by the mean motion"),
}
"""Colour, marker and words for each family."""
_BELOW = ("1 px", "new", "cubic")
"""Marks that stand below their points, out of the way of others."""
_GREY = "0.45"
_COLUMNS = 3


def chart(bench: Bench) -> Figure:
    """A panel for each job: time against error, both logarithmic. Down and left is better.

    Ours as the library does it is filled, other settings of ours are hollow. Bars span the quartiles of the time; the
    dashed line is the error of the picture as it is at rest.
    """
    lines = -(-(len(bench.jobs) + 1) // _COLUMNS)
    figure = Figure(figsize=(12.6, 0.7 + 3.7 * lines), layout="constrained")
    panels = list(figure.subplots(lines, _COLUMNS, squeeze=False).flat)
    for axes, job in zip(panels, bench.jobs, strict=False):
        _draw(axes, bench, job)
    rest = panels[len(bench.jobs) :]
    for axes in rest:
        axes.set_axis_off()
    rest[0].legend(
        handles=_legend(bench), title="Things that move: down and left is better", loc="center",
        fontsize=8.5, title_fontsize=9.5, frameon=False, labelspacing=0.7,
    )  # fmt: skip
    for axes in panels[: len(bench.jobs) : _COLUMNS]:
        axes.set_ylabel("RMS error / 8-bit DN", fontsize=9)
    extent = bench.extent
    figure.supxlabel(
        f"3 x {extent.height_px} x {extent.width_px} float32, {bench.machine['threads']} threads, "
        f"{bench.machine['processor']}. Errors against at least {extent.moments // 2} sub-exposures.",
        fontsize=8, color=_GREY,
    )  # fmt: skip
    return figure


def write(bench: Bench, folder: Path) -> None:
    """Write the chart as motion.png; raises ``OSError``."""
    write_figure(folder / "motion.png", chart(bench), dpi=150)


def tables(bench: Bench) -> list[Table]:
    """One for each job: error, time, and time over ours."""
    return [_table(bench, job) for job in bench.jobs]


def _table(bench: Bench, job: Job) -> Table:
    rows = bench.of(job)
    table = Table(title=f"{job.name}: {job.title}", title_justify="left")
    table.add_column("method", no_wrap=True)
    for name in ("error, DN RMS", "ms", "ns/value", "time / ours"):
        table.add_column(name, justify="right", no_wrap=True)
    for row in rows:
        times = (row.ms.median, row.ns_per_value, row.to_ours)
        table.add_row(row.method, _digits(row.error_dn), *map(_digits, times))
    table.add_section()
    table.add_row("as at rest", _digits(rows[0].at_rest_dn), "", "", "")
    return table


def _digits(value: float) -> str:
    """Two or three that count, without an exponent."""
    return f"{value:.0f}" if value >= 100 else f"{value:.1f}" if value >= 10 else f"{value:.2f}"


def _draw(axes: Axes, bench: Bench, job: Job) -> None:
    rows = bench.of(job)
    axes.axhline(rows[0].at_rest_dn, color=_GREY, lw=1, ls=(0, (5, 3)), zorder=1)
    frames = []
    for method, row in zip(job.methods, rows, strict=True):
        look = _look(method)
        axes.plot([row.ms.low, row.ms.high], [row.error_dn] * 2, color=look["color"], lw=1.2, zorder=2)
        axes.plot(row.ms.median, row.error_dn, zorder=4 if method.family == OURS else 3, **look)
        if method.family == FRAMES:
            frames.append((row.ms.median, row.error_dn))
        if method.mark:
            below = method.family == FRAMES or method.mark in _BELOW
            axes.annotate(
                method.mark, (row.ms.median, row.error_dn), (5, -11 if below else 5), textcoords="offset points",
                fontsize=7.5, color=look["color"],
            )  # fmt: skip
    axes.plot(*zip(*frames, strict=True), color=_MARKERS[FRAMES][0], lw=0.8, alpha=0.6, zorder=2)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.margins(x=0.2, y=0.12)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(LogLocator(subs=(1, 2, 5) if axis is axes.xaxis else (1, 3)))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.set_minor_locator(NullLocator())
        axis.set_minor_formatter(NullFormatter())
    axes.set_title(job.title, fontsize=9.5, loc="left")
    axes.set_xlabel("Time / ms", fontsize=9)
    axes.grid(color="0.9", lw=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=8)
    axes.spines[["top", "right"]].set_visible(False)


def _legend(bench: Bench) -> list[Line2D]:
    here = {method.family for job in bench.jobs for method in job.methods}
    handles = [
        Line2D([], [], label=words, ls="", color=colour, marker=marker, ms=7, mec="white", mew=0.5)
        for family, (colour, marker, words) in _MARKERS.items()
        if family in here
    ]
    hollow = Line2D(
        [], [], label="ours, otherwise", ls="", marker="o", ms=7, mfc="none", mec="black", mew=1.2
    )
    at_rest = Line2D([], [], label="nothing done: the picture as at rest", color=_GREY, lw=1, ls=(0, (5, 3)))
    return [handles[0], hollow, *handles[1:], at_rest]


def _look(method: Method) -> dict[str, Any]:
    """The first of ours is filled, others of ours are rings."""
    colour, marker, _ = _MARKERS[method.family]
    if method.family == OURS and method.name != OURS:
        return {"color": colour, "marker": marker, "ms": 6.5, "mfc": "none", "mec": colour, "mew": 1.2}
    return {
        "color": colour,
        "marker": marker,
        "ms": 8 if method.family == OURS else 7,
        "mec": "white",
        "mew": 0.5,
    }
