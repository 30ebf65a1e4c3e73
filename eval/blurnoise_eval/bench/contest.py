"""A contest: contenders do the same work on the same cases, and every one has a time beside its error.

The first contender of a case is the reference that times are compared with. All are timed in turns, so that a change
of the machine's load meets them alike, and each result is held against the case's truth.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from rich.table import Table

from blurnoise_eval.bench.timing import in_turns_ms, machine
from blurnoise_eval.plots.style import plain_numbers, small_multiples, tidy
from blurnoise_eval.system.files import write_figure, write_records
from blurnoise_eval.system.threads import limited_threads

Progress = Callable[[float], object]
_COLOURS = (
    "#000000", "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#8c564b", "#777777", "#bcbd22",
)  # fmt: skip
_MARKERS = "osX^DPv<ph"
_COLUMNS = 3
_LEAST = 1e-6  # errors are drawn from here on


@dataclass(frozen=True)
class Contender:
    """One way to do the work of a case. call: does it once. ours: of blurnoise."""

    name: str
    call: Callable[[], Any]
    ours: bool = False


@dataclass(frozen=True)
class Case:
    """The same work for all contenders.

    error: of what a contender's call returns, in the contest's unit; None where there is no truth. units: in how many
    parts a call's time is divided, such as pictures. cost: of what the call returns, where a contest counts something
    else than time.
    """

    name: str
    contenders: Sequence[Contender]
    error: Callable[[Any], float] | None = None
    units: float = 1.0
    cost: Callable[[Any], float] | None = None


@dataclass(frozen=True)
class Contest:
    """What is compared: cases made one after the other, the title, and the units of cost and error.

    seconds: how long a contender of a case is timed, between 3 and 12 calls; a tenth of it where it is quick.
    """

    name: str
    title: str
    cases: Sequence[Callable[[], Case]]
    cost_unit: str = "ms"
    error_unit: str = ""
    seconds: float = 3.0


@dataclass(frozen=True)
class Row:
    """One contender in one case: the quartiles of its cost, that over the first contender's, and its error."""

    case: str
    contender: str
    ours: bool
    low: float
    cost: float
    high: float
    to_first: float
    error: float | None


@dataclass(frozen=True)
class Result:
    """What was measured, and on which machine."""

    contest: Contest
    rows: list[Row]
    machine: dict[str, Any]

    def losses(self) -> list[str]:
        """Where a contender that is not ours beats every one of ours in cost or in error, by 2 % or more."""
        found = []
        for row in self.rows:
            own = [each for each in self.rows if each.case == row.case and each.ours]
            if row.ours or not own:
                continue
            faster = row.cost < 0.98 * min(each.cost for each in own)
            errors = [each.error for each in own if each.error is not None]
            closer = row.error is not None and bool(errors) and row.error < 0.98 * min(errors)
            if faster or closer:
                what = " and ".join(word for word, true in (("costs", faster), ("errs", closer)) if true)
                found.append(f"{row.case}: {row.contender} {what} less, {self._figures(row)}")
        return found

    def _figures(self, row: Row) -> str:
        error = "" if row.error is None else f", error {digits(row.error)} {self.contest.error_unit}"
        return f"{row.to_first:.2f} of the first's {self.contest.cost_unit}{error}"

    def write(self, folder: Path) -> None:
        """Write NAME.csv, a row per contender and case, NAME.json and NAME.png; raises ``OSError``."""
        name = self.contest.name
        write_records(name, [asdict(row) for row in self.rows], self.document(), folder)
        write_figure(folder / f"{name}.png", self.chart(), dpi=150)

    def document(self) -> dict[str, Any]:
        """Everything, ready for JSON."""
        return {
            "title": self.contest.title,
            "cost_unit": self.contest.cost_unit,
            "error_unit": self.contest.error_unit,
            "machine": self.machine,
            "losses": self.losses(),
            "rows": [asdict(row) for row in self.rows],
        }

    def table(self) -> Table:
        """A line per contender, under each case's own."""
        table = Table(title=self.contest.title, title_justify="left")
        with_errors = any(row.error is not None for row in self.rows)
        table.add_column("", no_wrap=True)
        for name in (self.contest.cost_unit, "to first", *([self.contest.error_unit] * with_errors)):
            table.add_column(name, justify="right")
        last = ""
        for row in self.rows:
            if row.case != last:
                table.add_section()
                table.add_row(f"{row.case}:")
                last = row.case
            error = [] if not with_errors else ["" if row.error is None else digits(row.error)]
            table.add_row(row.contender, digits(row.cost), f"{row.to_first:.2f}", *error)
        return table

    def chart(self) -> Figure:
        """A panel per case: cost against error, both logarithmic; down and left is better. Without errors, cost."""
        cases = list(dict.fromkeys(row.case for row in self.rows))
        names = list(dict.fromkeys(row.contender for row in self.rows))
        columns = min(_COLUMNS, len(cases) + 1)
        figure, panels = small_multiples(len(cases) + 1, columns, (4.2, 3.4), (0.0, 0.6))
        for axes, case in zip(panels, cases, strict=False):
            self._draw(axes, [row for row in self.rows if row.case == case], names)
            axes.set_title(case, fontsize=9.5, loc="left")
        panels[-1].set_axis_off()
        points = [
            panels[-1].plot([], [], ls="", label=name, **_look(index))[0] for index, name in enumerate(names)
        ]
        panels[-1].legend(handles=points, loc="center", fontsize=8.5, frameon=False)
        better = "left" if self.rows[0].error is None else "down and left"
        figure.suptitle(f"{self.contest.title}: {better} is better", fontsize=10)
        threads = self.machine["threads"]
        figure.supxlabel(
            f"{threads} thread{'s' * (threads != 1)}, {self.machine['processor']}", fontsize=8, color="0.45"
        )
        return figure

    def _draw(self, axes: Axes, rows: Sequence[Row], names: Sequence[str]) -> None:
        for row in rows:
            look = _look(names.index(row.contender))
            place = -names.index(row.contender) if row.error is None else max(row.error, _LEAST)
            axes.plot([row.low, row.high], [place, place], color=look["color"], lw=1.2, zorder=2)
            axes.plot(row.cost, place, zorder=4 if row.ours else 3, **look)
        axes.set_xscale("log")
        plain_numbers(axes.xaxis, digits=(1, 2, 5))
        if rows[0].error is None:
            axes.set_yticks([])
        else:
            axes.set_yscale("log")
            plain_numbers(axes.yaxis, digits=(1,))
        axes.margins(0.15)
        tidy(axes, x=self.contest.cost_unit, y=self.contest.error_unit if rows[0].error is not None else None)


def run(
    contest: Contest, *, quick: bool = False, threads: int = 2, progress: Progress = lambda share: None
) -> Result:
    """Let all contenders do all cases; ``progress`` receives each finished share of a case."""
    facts, rows = machine(threads), list[Row]()
    seconds = contest.seconds / (10 if quick else 1)
    with limited_threads(threads):
        for make in contest.cases:
            rows += _rows(make(), seconds, progress)
    return Result(contest, rows, facts)


def _rows(case: Case, seconds: float, progress: Progress) -> list[Row]:
    results = {each.name: each.call() for each in case.contenders}
    costs = {name: [case.cost(result)] for name, result in results.items()} if case.cost else {}
    if case.cost is None:
        turns = in_turns_ms(
            {each.name: each.call for each in case.contenders},
            fewest=3,
            most=12,
            seconds=seconds,
            progress=lambda share: progress(share / len(case.contenders)),
        )
        costs = {name: [value / case.units for value in times] for name, times in turns.items()}
    else:
        progress(1)
    spreads = {name: np.quantile(values, (0.25, 0.5, 0.75)).tolist() for name, values in costs.items()}
    rows, first = [], spreads[case.contenders[0].name][1]
    for each in case.contenders:
        low, cost, high = spreads[each.name]
        error = None if case.error is None else case.error(results[each.name])
        rows.append(Row(case.name, each.name, each.ours, low, cost, high, cost / first, error))
    return rows


def digits(value: float) -> str:
    """Two or three digits that count."""
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}"


def _look(index: int) -> dict[str, Any]:
    colour, marker = _COLOURS[index % len(_COLOURS)], _MARKERS[index % len(_MARKERS)]
    return {"color": colour, "marker": marker, "ms": 7, "mec": "white", "mew": 0.5}
