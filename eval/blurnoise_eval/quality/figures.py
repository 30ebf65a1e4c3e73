"""Every metric of simulated charts against exposure (ms) and against motion blur (px), as small multiples.

A number that is withheld is a gap in its line, with a cross in the line's colour at the panel's foot.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, TypeVar

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from rich.table import Table

from blurnoise.metrics import Flag
from blurnoise_eval.grid.axes import SETTING, axis, setting_of, velocity_of, velocity_text
from blurnoise_eval.quality.measure import CLIPPED, METRICS, Metric, Row
from blurnoise_eval.report.figures import MAX_LINES
from blurnoise_eval.report.measured import line_colours, spread
from blurnoise_eval.system.files import write_figure
from blurnoise_eval.system.terminal import plain

L = TypeVar("L", bound=Hashable)
_SATURATED, _FAILED = "#f0a050", "0.55"
_NOISY = Flag.NOISE_DOMINATED.name.lower()
_SHADE = {_SATURATED: 0.22, _FAILED: 0.20}
_LEAST = 1e-12
"""Where a logarithmic axis draws the end of an interval at 0."""
_COLUMNS = 4
Ends = dict[float, tuple[float, float]]


def against_exposure(rows: Sequence[Row], camera: str, named: Sequence[str] = ("illuminance_lux",)) -> Figure:
    """Rows of one setting, whose axes ``named`` the title tells: a line per velocity over the exposure."""
    lines = spread(
        sorted({velocity_of(row.at) for row in rows}, key=lambda v: (math.hypot(*v), v)), MAX_LINES
    )
    return _figure(
        rows,
        dict(zip(lines, line_colours("viridis", len(lines)), strict=True)),
        line_of=lambda row: velocity_of(row.at),
        place=lambda row: 1e3 * row.at["exposure_s"],
        label=velocity_text,
        dress=_exposure_axis,
        title=f"{plain(camera)}, {_texts(rows[0], named)}: image quality against exposure",
        x_label="Exposure / ms",
        failure=_failure,
    )


def against_blur(rows: Sequence[Row], camera: str, named: Sequence[str] = ("illuminance_lux",)) -> Figure:
    """Rows of one setting, whose axes ``named`` the title tells: a line per exposure over the motion blur."""
    lines = spread(sorted({row.at["exposure_s"] for row in rows}), MAX_LINES)
    clipped = {row.at["exposure_s"] for row in rows if _clipped(row)}
    return _figure(
        rows,
        dict(zip(lines, line_colours("plasma", len(lines)), strict=True)),
        line_of=lambda row: row.at["exposure_s"],
        place=lambda row: row.blur_px,
        label=lambda exposure_s: (
            axis("exposure_s").text(exposure_s) + (" (saturated)" if exposure_s in clipped else "")
        ),
        dress=_blur_axis,
        title=f"{plain(camera)}, {_texts(rows[0], named)}: image quality against motion blur",
        x_label="Motion blur / px (linear below 1 px, logarithmic above)",
        failure=lambda row: None if row.estimate.told or _clipped(row) else _FAILED,
    )


def write(rows: Sequence[Row], camera: str, folder: Path) -> list[Path]:
    """Write exposure-LUXlux.png and, where speeds differ, blur-LUXlux.png per setting; raises ``OSError``.

    Axes beyond the light stand in the names where they vary.
    """
    folder.mkdir(parents=True, exist_ok=True)
    written: list[Path] = []
    named = _named(row.at for row in rows)
    for setting in sorted({setting_of(row.at) for row in rows}):
        alike = [row for row in rows if setting_of(row.at) == setting]
        figures = {"exposure": against_exposure(alike, camera, named)}
        if len({velocity_of(row.at) for row in alike}) > 1:
            figures["blur"] = against_blur(alike, camera, named)
        slug = "-".join(axis(name).slug(alike[0].at[name]) for name in named)
        for name, figure in figures.items():
            path = folder / f"{name}-{slug}.png"
            written.append(path if path not in written else folder / f"{name}-{slug}-{len(written)}.png")
            write_figure(written[-1], figure, dpi=120)
    return written


def table(best: Sequence[dict[str, Any]]) -> Table:
    """The exposure that tells most, per setting and velocity, as ``most_information`` gives it."""
    made = Table(title="Exposure with the highest information capacity (square)", title_justify="left")
    named = _named(best)
    for name in named:
        unit = axis(name).unit
        made.add_column(
            "lux" if name == "illuminance_lux" else f"{axis(name).title}{unit and f', {unit}'}",
            justify="right",
        )
    for head in ("motion", "exposure, ms", "blur, px", "bits/px (95 %)"):
        made.add_column(head, justify="left" if head == "motion" else "right")
    for row in best:
        told = ["none told", "-", "-"]
        if row["value"] is not None:
            bits = f"{row['value']:.2f} ({row['low']:.2f}-{row['high']:.2f})"
            told = [f"{1e3 * row['exposure_s']:g}", f"{row['blur_px']:.3g}", bits]
        setting = [f"{axis(name).shown(row[name]):g}" for name in named]
        made.add_row(*setting, velocity_text(velocity_of(row)), *told)
    return made


def _named(rows: Iterable[Mapping[str, Any]]) -> list[str]:
    """The light, and the other axes of a setting on which the rows differ."""
    settings = {setting_of(row) for row in rows}
    several = [len(set(column)) > 1 for column in zip(*settings, strict=True)]
    return [
        name for name, differ in zip(SETTING, several, strict=False) if differ or name == "illuminance_lux"
    ]


def _texts(row: Row, named: Sequence[str]) -> str:
    return ", ".join(axis(name).text(row.at[name]) for name in named)


def _figure(
    rows: Sequence[Row],
    colours: dict[L, str],
    *,
    line_of: Callable[[Row], L],
    place: Callable[[Row], float],
    label: Callable[[L], str],
    dress: Callable[[Axes, Sequence[float]], None],
    title: str,
    x_label: str,
    failure: Callable[[Row], str | None],
) -> Figure:
    """A panel per metric, a line per key of ``colours``; places at which any line fails are shaded."""
    count = -(-len(METRICS) // _COLUMNS)
    figure = Figure(figsize=(3.5 * _COLUMNS, 2.45 * count + 1.3), layout="constrained")
    places = sorted({place(row) for row in rows})
    panels = list(figure.subplots(count, _COLUMNS, sharex=True).flat)
    for axes in panels[len(METRICS) :]:
        axes.set_axis_off()
    for axes, metric in zip(panels, METRICS, strict=False):
        of = [row for row in rows if row.metric == metric.name and line_of(row) in colours]
        _dress(axes, metric)
        dress(axes, places)
        ends = _surroundings(places, axes)
        for colour in _SHADE:
            failing = {place(row) for row in of if failure(row) == colour}
            for low, high in _joined(ends[x] for x in sorted(failing)):
                axes.axvspan(low, high, color=colour, alpha=_SHADE[colour], lw=0, zorder=0)
        for row, (line, colour) in enumerate(colours.items()):
            mine = sorted((each for each in of if line_of(each) == line), key=place)
            _draw(axes, [place(each) for each in mine], mine, colour)
            lost = [place(each) for each in mine if not each.estimate.told and failure(each)]
            foot = [0.03 + 0.035 * row] * len(lost)
            across = axes.get_xaxis_transform()  # y in shares of the panel
            axes.plot(lost, foot, "x", color=colour, ms=4.5, mew=1.3, transform=across, zorder=5)
        drawn = [row.estimate.value for row in of if row.estimate.value > 0]
        if metric.log and drawn:
            axes.set_ylim(min(drawn) / 1.6, max(drawn) * 1.6)
    figure.supxlabel(x_label, fontsize=9)
    handles: list[Any] = [
        Line2D([], [], color=colour, marker="o", ms=3.5, lw=1.4, label=label(line))
        for line, colour in colours.items()
    ]
    shades = {failure(row) for row in rows}
    named = {_SATURATED: "a line saturates", _FAILED: "a line is lost in noise or blur"}
    handles += [
        Patch(color=colour, alpha=2 * _SHADE[colour], label=name)
        for colour, name in named.items()
        if colour in shades
    ]
    handles += [
        Line2D([], [], color="0.3", marker="x", ls="", ms=5, label="not told (its line)"),
        Line2D([], [], color="0.3", marker="o", mfc="white", ls="", ms=4.5, label="told, with a flag"),
        Patch(color="0.3", alpha=0.18, label="95 % interval"),
    ]
    legend = figure.legend(
        handles=handles, title=title, loc="outside upper center", ncols=min(len(handles), 8), fontsize=8.5,
        title_fontsize=11, frameon=False,
    )  # fmt: skip
    legend.get_title().set_parse_math(False)
    return figure


def _draw(axes: Axes, x: list[float], rows: list[Row], colour: str) -> None:
    estimates = [row.estimate for row in rows]
    least = _LEAST if axes.get_yscale() == "log" else -math.inf
    if not any(estimate.value > least for estimate in estimates):
        return
    axes.plot(x, [estimate.value for estimate in estimates], "o-", color=colour, ms=3, lw=1.4, zorder=3)
    low = [max(estimate.low, least) if math.isfinite(estimate.low) else math.nan for estimate in estimates]
    high = [estimate.high if math.isfinite(estimate.high) else math.nan for estimate in estimates]
    axes.fill_between(x, low, high, color=colour, alpha=0.18, lw=0, zorder=2)
    doubted = [index for index, estimate in enumerate(estimates) if estimate.told and estimate.flags]
    at, values = [x[index] for index in doubted], [estimates[index].value for index in doubted]
    axes.plot(at, values, "o", mfc="white", mec=colour, ms=4.2, zorder=4)


def _failure(row: Row) -> str | None:
    """The colour of what befell it: saturation, also where a number is told, or another loss, or noise."""
    if _clipped(row):
        return _SATURATED
    return _FAILED if not row.estimate.told or _NOISY in row.estimate.flags else None


def _clipped(row: Row) -> bool:
    return CLIPPED in row.estimate.flags


def _surroundings(places: Sequence[float], axes: Axes) -> Ends:
    """Each place's share of the axis, half-way to its neighbours as they are drawn."""
    there, back = axes.transData.transform, axes.transData.inverted().transform
    drawn = [float(there((x, 1.0))[0]) for x in places]
    middles = [float(back(((a + b) / 2, 0.0))[0]) for a, b in pairwise(drawn)]
    first, last = axes.get_xlim()
    return dict(zip(places, zip([first, *middles], [*middles, last], strict=True), strict=True))


def _joined(spans: Iterable[tuple[float, float]]) -> list[tuple[float, float]]:
    joined: list[tuple[float, float]] = []
    for low, high in spans:
        if joined and joined[-1][1] == low:
            joined[-1] = (joined[-1][0], high)
        else:
            joined.append((low, high))
    return joined


def _dress(axes: Axes, metric: Metric) -> None:
    unit = "" if metric.unit == "1" else f" / {metric.unit}"
    axes.set_title(f"{metric.title}{unit}", fontsize=9, parse_math=False)
    if metric.log:
        axes.set_yscale("log")
        axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axes.yaxis.set_minor_formatter(NullFormatter())
    if metric.share:
        axes.set_ylim(0, 1.05)
    axes.grid(color="0.9", lw=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=8)
    axes.spines[["top", "right"]].set_visible(False)


def _exposure_axis(axes: Axes, exposures_ms: Sequence[float]) -> None:
    axes.set_xscale("log")
    axes.set_xlim(exposures_ms[0] / 1.2, exposures_ms[-1] * 1.2)
    axes.xaxis.set_major_locator(LogLocator(subs=(1, 3)))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())


def _blur_axis(axes: Axes, blurs_px: Sequence[float]) -> None:
    axes.set_xscale("symlog", linthresh=1)
    axes.set_xlim(-0.1, 1.2 * max(blurs_px[-1], 1))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
