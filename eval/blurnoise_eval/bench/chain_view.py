"""Findings of the bench of the whole chain, for the eye: bars with their stages, and tables."""

from __future__ import annotations

from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from rich.table import Table

from blurnoise_eval.bench.chain import BLUR, NOISE, PAPERS_TOOL_S, PICTURE, WHOLE, Bench, Case
from blurnoise_eval.system.files import write_figure

_COLOURS = {"blur": "#0072b2", "noise": "#e69f00", "rest": "#999999", "other libraries": "#d55e00"}
_GREY = "0.45"


def chart(bench: Bench) -> Figure:
    """A panel per case: a bar per way, ours in its stages (to scale where these alone take longer)."""
    cases = bench.extent.cases
    bars = max(sum(row.case == case.name for row in bench.rows) for case in cases)
    figure = Figure(figsize=(11.0, 1.2 + 0.42 * bars * len(cases)), layout="constrained")
    panels = figure.subplots(len(cases), 1, squeeze=False)[:, 0]
    for axes, case in zip(panels, cases, strict=True):
        _draw(axes, bench, case)
    panels[-1].set_xlabel(
        "Time / ms for all pictures of the case; beside it, times that of torch.randn", fontsize=9
    )
    figure.supxlabel(
        f"{bench.machine['threads']} threads, {bench.machine['processor']}. Whiskers: quartiles.",
        fontsize=8, color=_GREY,
    )  # fmt: skip
    figure.legend(
        handles=[Patch(color=colour, label=name) for name, colour in _COLOURS.items()],
        loc="outside upper center", fontsize=8, ncols=len(_COLOURS), frameon=False,
    )  # fmt: skip
    return figure


def write(bench: Bench, folder: Path) -> None:
    """Write the chart as simulate.png; raises ``OSError``."""
    write_figure(folder / "simulate.png", chart(bench), dpi=150)


def tables(bench: Bench) -> list[Table]:
    """A table per case: times for all its pictures, and over one ``torch.randn`` of their shape."""
    made = []
    for case in bench.extent.cases:
        table = Table(title=_title(case), title_justify="left")
        table.add_column("", no_wrap=True)
        for heading in ("ms", "quartiles", "x randn", "ns/value"):
            table.add_column(heading, justify="right")
        for row in bench.rows:
            if row.case == case.name:
                low, median, high = row.ms
                cells = (f"{median:.1f}", f"{low:.0f} to {high:.0f}", f"{row.to_randn:.2f}")
                table.add_row(row.name, *cells, f"{1e6 * median / case.values:.1f}")
        if case == PICTURE:
            median = bench.row(case.name, WHOLE["auto"]).ms.median
            table.caption = f"{1e3 * PAPERS_TOOL_S / median:.0f} times as fast as the tool of Lin et al. 2024"
        made.append(table)
    return made


def _title(case: Case) -> str:
    shape = " x ".join(map(str, case.shape))
    lens = f", defocus {case.camera.defocus_radius_px:g} px" if case.camera.defocus_radius_px else ""
    return f"{case.name}: {shape} float32, {case.encoding}, motion {case.length_px:g} px{lens}"


def _draw(axes: Axes, bench: Bench, case: Case) -> None:
    rows = [row for row in bench.rows if row.case == case.name]
    fidelities = {name: fidelity for fidelity, name in WHOLE.items()}
    for place, row in enumerate(rows):
        if row.name in fidelities:
            parts = {
                "blur": bench.row(case.name, BLUR).ms.median,
                "noise": bench.row(case.name, NOISE[fidelities[row.name]]).ms.median,
                "rest": max(0.0, bench.rest_ms(case.name, fidelities[row.name])),
            }
        else:
            stage = "noise" if row.name in NOISE.values() else "blur"
            parts = {{"stage": stage, "other": "other libraries"}.get(row.kind, "rest"): row.ms.median}
        scale, left = row.ms.median / sum(parts.values()), 0.0
        for part, width in parts.items():
            axes.barh(place, scale * width, left=left, height=0.62, color=_COLOURS[part])
            left += scale * width
        axes.plot([row.ms.low, row.ms.high], [place, place], color="black", lw=1.2)
        end = max(row.ms.high, row.ms.median)
        axes.annotate(
            f"{row.ms.median:.0f} ms, {row.to_randn:.1f} x", (end, place), (5, 0), textcoords="offset points",
            va="center", fontsize=8,
        )  # fmt: skip
    axes.set_yticks(range(len(rows)), [row.name for row in rows], fontsize=8)
    axes.invert_yaxis()
    axes.set_title(_title(case), fontsize=9, loc="left")
    axes.set_xlim(0, 1.15 * max(row.ms.high for row in rows))
    axes.grid(axis="x", color="0.9", lw=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=8)
    axes.spines[["top", "right"]].set_visible(False)
