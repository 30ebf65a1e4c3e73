"""Findings of the bench of motion blur, for the eye: charts of time and error, and tables."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter, NullLocator
from rich.table import Table

from blurnoise_eval.bench.blur import EXACT, NO_BLUR, Bench
from blurnoise_eval.bench.contenders import BASELINE
from blurnoise_eval.system.files import write_figure

_MARKERS = {
    "auto": ("#000000", "o"),
    "transfer": ("#0072b2", "s"),
    "tiles": ("#56b4e9", "D"),
    "kernel": ("#009e73", "P"),
    "kornia": ("#d55e00", "^"),
    "kornia bilinear": ("#e69f00", "v"),
    "opencv": ("#cc79a7", "X"),
    "albumentations": ("#777777", "p"),
}
_DASHES: dict[str, Any] = {EXACT: (0, (5, 3)), NO_BLUR: (0, (1, 2))}
_GREY = "0.45"


def chart(bench: Bench) -> Figure:
    """Above, time against RMS error for each length both timed and judged; below, both over the length.

    Down and left is better. Bars span the quartiles of the time.
    """
    lengths = [length for length in bench.extent.timed_px if length in bench.extent.judged_px]
    count = max(1, len(lengths))
    figure = Figure(figsize=(max(8.0, 2.9 * count), 7.6), layout="constrained")
    grid = figure.add_gridspec(2, 2 * count)
    above = [figure.add_subplot(grid[0, 2 * index : 2 * index + 2]) for index in range(len(lengths))]
    left, right = figure.add_subplot(grid[1, :count]), figure.add_subplot(grid[1, count:])
    for axes, length in zip(above, lengths, strict=True):
        _draw_pairs(axes, bench, length)
    _draw_over_length(left, bench, bench.extent.timed_px, bench.median)
    _draw_over_length(right, bench, bench.extent.judged_px, bench.error_dn)
    _share_scales(above)
    for axes in [*above, left, right]:
        _dress(axes)
    if above:
        above[0].set_ylabel("RMS error / 8-bit DN", fontsize=9)
    left.set_ylabel("Time / (ms per megapixel)", fontsize=9)
    right.set_ylabel("RMS error / 8-bit DN", fontsize=9)
    batch, channels, height, width = bench.extent.shape
    threads, processor = bench.machine["threads"], bench.machine["processor"]
    figure.supxlabel(
        f"Times: {batch} x {channels} x {height} x {width} float32, an angle each, {threads} threads, {processor}. "
        f"Errors: over {len(bench.extent.scenes)} scenes and {len(bench.extent.angles_deg)} angles.",
        fontsize=8, color=_GREY,
    )  # fmt: skip
    handles = [Line2D([], [], label=method.name, ls="", **_look(method.name)) for method in bench.methods]
    handles += [Line2D([], [], label=name, color=_GREY, lw=1, ls=dash) for name, dash in _DASHES.items()]
    figure.legend(
        handles=handles, title="Motion blur: down and left is better", loc="outside upper center",
        fontsize=8, title_fontsize=9, ncols=len(handles) if count > 2 else 5, frameon=False,
        columnspacing=1.4, handletextpad=0.5,
    )  # fmt: skip
    return figure


def write(bench: Bench, folder: Path) -> None:
    """Write the chart as blur.png; raises ``OSError``."""
    write_figure(folder / "blur.png", chart(bench), dpi=150)


def tables(bench: Bench) -> list[Table]:
    """Time, speed beside Kornia's, RMS error and worst MTF50 error: methods down, lengths across."""

    def time(method: str, length: float) -> str:
        value = bench.median(method, length)
        return "" if value is None else f"{value:.3g}" if value < 100 else f"{value:.0f}"

    def speed(method: str, length: float) -> str:
        ratio = bench.ratio(method, length)
        return "" if ratio is None else f"{1 / ratio:.2g}"

    def error(method: str, length: float) -> str:
        value = bench.error_dn(method, length)
        return "" if value is None else f"{value:.2f}"

    def mtf50(method: str, length: float) -> str:
        value = bench.mtf50_error(method, length)
        return "none" if value is None else f"{round(100 * value, 2) + 0.0:+.2f}"  # no -0.00

    names = [method.name for method in bench.methods]
    timed, judged = bench.extent.timed_px, bench.extent.judged_px
    return [
        _table("Time, ms per megapixel", names, timed, time),
        _table(f"Speed, times that of {BASELINE}", names, timed, speed),
        _table("RMS error, 8-bit DN, over scenes and angles", [*names, EXACT, NO_BLUR], judged, error),
        _table("MTF50 against the closed form, worst angle, %", names, judged, mtf50),
    ]


def _table(
    title: str, methods: Sequence[str], lengths: Sequence[float], cell: Callable[[str, float], str]
) -> Table:
    table = Table(title=title, title_justify="left")
    table.add_column("length, px", no_wrap=True)
    for length in lengths:
        table.add_column(f"{length:g}", justify="right")
    for method in methods:
        table.add_row(method, *(cell(method, length) for length in lengths))
    return table


def _draw_pairs(axes: Axes, bench: Bench, length: float) -> None:
    for name, dash in _DASHES.items():
        axes.axhline(bench.error_dn(name, length) or 0.0, color=_GREY, lw=1, ls=dash, zorder=1)
    for method in bench.methods:
        time, error = bench.time(method.name, length), bench.error_dn(method.name, length)
        if time is None or error is None:
            continue
        axes.plot([time.low, time.high], [error, error], color=_look(method.name)["color"], lw=1.2, zorder=2)
        axes.plot(time.median, error, zorder=3, **_look(method.name))
    ratio = bench.ratio("auto", length)
    compared = "" if ratio is None else f": auto {1 / ratio:.2g}× {BASELINE}'s speed"
    axes.set_title(f"{length:g} px{compared}", fontsize=9)
    axes.set_xlabel("Time / (ms per megapixel)", fontsize=9)


def _draw_over_length(
    axes: Axes, bench: Bench, lengths: Sequence[float], value: Callable[[str, float], float | None]
) -> None:
    for name in [*(method.name for method in bench.methods), *_DASHES]:
        line = [(length, found) for length in lengths if (found := value(name, length)) is not None]
        look = (
            {"color": _GREY, "ls": _DASHES[name], "lw": 1} if name in _DASHES else {**_look(name), "lw": 1.4}
        )
        axes.plot(*zip(*line, strict=True), **look)
    axes.set_xlabel("Length of the motion / px", fontsize=9)


def _share_scales(panels: Sequence[Axes]) -> None:
    for axes in panels[1:]:
        axes.sharex(panels[0])
        axes.sharey(panels[0])
        axes.tick_params(labelleft=False)


def _dress(axes: Axes) -> None:
    axes.set_xscale("log")
    axes.set_yscale("log")
    for axis in (axes.xaxis, axes.yaxis):
        _plain_numbers(axis)
    axes.grid(color="0.9", lw=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=8)
    axes.spines[["top", "right"]].set_visible(False)


def _plain_numbers(axis: Axis) -> None:
    axis.set_major_locator(LogLocator(subs=(1, 3)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_locator(NullLocator())
    axis.set_minor_formatter(NullFormatter())


def _look(method: str) -> dict[str, Any]:
    """``auto`` is a ring around the method it chose."""
    colour, marker = _MARKERS[method]
    ring = {"ms": 11, "mfc": "none", "mec": colour, "mew": 1.3}
    return {
        "color": colour,
        "marker": marker,
        **(ring if method == "auto" else {"ms": 6.5, "mec": "white", "mew": 0.5}),
    }
