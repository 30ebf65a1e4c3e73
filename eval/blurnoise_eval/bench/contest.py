"""A contest: contenders do the same work on the same cases; each has a time and an error.

The first contender of a case is the reference of the times. All are timed in turns, so that a change of the machine's
load meets them alike, and each result is compared with the case's truth.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from blurnoise_eval.plots.style import legend_above, plain_numbers, small_multiples, tidy
from blurnoise_eval.system.files import write_figure, write_records
from blurnoise_eval.system.machine import hardware, limited_threads, versions
from blurnoise_eval.system.terminal import table_lines

Progress = Callable[[float], object]
FEWEST, MOST = 3, 12
"""Timed rounds of a case."""
_MARKERS = "osX^DPv<ph"


@dataclass(frozen=True)
class Contender:
    """One way to do the work of a case. call: does it once. ours: of blurnoise."""

    name: str
    call: Callable[[], Any]
    ours: bool = False


@dataclass(frozen=True)
class Case:
    """The same work for all contenders.

    error: of a result, in the contest's unit; None without a truth, or of a contender that has none. units: the time
    of a call is divided by it, such as a number of pictures. at: where the case stands ``along`` the contest; cases
    of one name then share a panel.
    """

    name: str
    contenders: Sequence[Contender]
    error: Callable[[Any], float | None] | None = None
    units: float = 1.0
    at: float | None = None


@dataclass(frozen=True)
class Contest:
    """What is compared: functions that make the cases, the title, and the units of time and error.

    seconds: how long each contender of a case is timed; a tenth of it in a quick contest. along: what the cases
    differ in; the chart then has time against it.
    """

    name: str
    title: str
    cases: Sequence[Callable[[], Case]]
    unit: str = "ms"
    error_unit: str = ""
    seconds: float = 3.0
    along: str = ""


@dataclass(frozen=True)
class ContestRow:
    """A contender in a case: the quartiles of its time, the median relative to that of the first one, its error.

    cpu: median of the CPU time of all threads and of worker processes that ended, which other processes disturb less;
    cpu_to_first, as to_first. at: as in the case.
    """

    case: str
    contender: str
    ours: bool
    low: float
    time: float
    high: float
    to_first: float
    cpu: float
    cpu_to_first: float
    error: float | None
    at: float | None = None


@dataclass(frozen=True)
class Result:
    """What was measured, and on which machine."""

    contest: Contest
    rows: list[ContestRow]
    machine: dict[str, Any]

    def write(self, folder: Path) -> None:
        """Write NAME.csv, a row per contender and case, NAME.json and NAME.png; raises ``OSError``."""
        name = self.contest.name
        write_records(name, [asdict(row) for row in self.rows], self.document(), folder)
        write_figure(folder / f"{name}.png", self.chart(), dpi=150)

    def document(self) -> dict[str, Any]:
        """Everything, ready for JSON."""
        about = {name: getattr(self.contest, name) for name in ("title", "unit", "error_unit")}
        return {**about, "machine": self.machine, "rows": [asdict(row) for row in self.rows]}

    def table(self) -> list[str]:
        """A line per case and contender."""
        heads = ("case", "method", self.contest.unit, "to first", "CPU", "to first", self.contest.error_unit)
        rows = [
            (
                *(row.case if row.at is None else f"{row.case}, {row.at:g}", row.contender),
                *(digits(row.time), f"{row.to_first:.2f}"),
                *(digits(row.cpu), f"{row.cpu_to_first:.2f}", digits(row.error)),
            )
            for row in self.rows
        ]
        return list(table_lines(heads, rows, (False, False, *[True] * 5)))

    def chart(self) -> Figure:
        """A panel per case: time against error, both logarithmic; down and left is better. Without errors, time.

        Along something: a panel per name of cases, the time against it; down is better.
        """
        if self.contest.along:
            return self._lines()
        names = list(dict.fromkeys(row.contender for row in self.rows))
        cases = {case: list(rows) for case, rows in groupby(self.rows, lambda row: row.case)}
        columns = min(3, len(cases) + 1)
        figure, (*panels, last) = small_multiples(len(cases) + 1, columns, (4.2, 3.4), (0.0, 0.6))
        for axes, (case, rows) in zip(panels, cases.items(), strict=True):
            with_errors = any(row.error is not None for row in rows)
            for row in rows:
                number = names.index(row.contender)
                if with_errors and row.error is None:
                    axes.axvline(row.time, color=f"C{number}", lw=1.2, ls=":")
                    continue
                # A logarithmic axis has no 0.
                place = -number if row.error is None else max(row.error, 1e-6)
                axes.plot([row.low, row.high], [place, place], color=f"C{number}", lw=1.2, zorder=2)
                axes.plot(row.time, place, zorder=4 if row.ours else 3, **_look(number))
            axes.set(xscale="log", yscale="log" if with_errors else "linear")
            plain_numbers(axes.xaxis, digits=(1, 2, 5))
            if with_errors:
                plain_numbers(axes.yaxis, digits=(1,))
            else:
                axes.set_yticks([])
            axes.margins(0.15)
            tidy(axes, x=self.contest.unit, y=self.contest.error_unit if with_errors else None)
            axes.set_title(case, fontsize=9.5, loc="left")
        last.set_axis_off()
        points = [last.plot([], [], ls="", label=name, **_look(n))[0] for n, name in enumerate(names)]
        last.legend(handles=points, loc="center", fontsize=8.5, frameon=False)
        better = "left" if all(row.error is None for row in self.rows) else "down and left"
        figure.suptitle(f"{self.contest.title}: {better} is better", fontsize=10)
        self._say_where(figure)
        return figure

    def _lines(self) -> Figure:
        names = list(dict.fromkeys(row.contender for row in self.rows))
        panels = list(dict.fromkeys(row.case for row in self.rows))
        figure, grid = small_multiples(len(panels), len(panels), (4.2, 3.4), (0.0, 1.2), sharey=True)
        for axes, panel in zip(grid, panels, strict=True):
            of_panel = [row for row in self.rows if row.case == panel]
            for name in dict.fromkeys(row.contender for row in of_panel):
                some = [row for row in of_panel if row.contender == name]
                look = {**_look(names.index(name)), "lw": 2.0 if some[0].ours else 1.0, "ms": 5}
                axes.plot([row.at or 0.0 for row in some], [row.cpu for row in some], label=name, **look)
            axes.set(xscale="log", yscale="log")
            axes.set_xticks(sorted({row.at for row in of_panel if row.at is not None}), minor=False)
            plain_numbers(axes.xaxis)
            plain_numbers(axes.yaxis, digits=(1, 2, 5))
            tidy(axes, x=self.contest.along, y=f"CPU {self.contest.unit}")
            axes.set_title(panel, fontsize=9.5, loc="left")
        lines = [line for axes in grid for line in axes.lines]
        legend_above(figure, lines, f"{self.contest.title}: down is better", columns=4)
        self._say_where(figure)
        return figure

    def _say_where(self, figure: Figure) -> None:
        where = f"threads: {self.machine['threads']}, {self.machine['processor']}"
        figure.supxlabel(where, fontsize=8, color="0.45")


def _look(number: int) -> dict[str, Any]:
    return {"color": f"C{number}", "marker": _MARKERS[number], "ms": 7, "mec": "white", "mew": 0.5}


def run(
    contest: Contest, *, quick: bool = False, threads: int = 2, progress: Progress = lambda share: None
) -> Result:
    """Let all contenders do all cases; ``progress`` receives each finished share of a case."""
    machine = {**hardware(), "threads": threads, "versions": versions()}
    rows = list[ContestRow]()
    for make in contest.cases:
        with limited_threads(threads):
            case = make()
        with limited_threads(threads):  # again: packages that a case imports may change it
            rows += _rows(case, contest.seconds / (10 if quick else 1), progress)
    return Result(contest, rows, machine)


def _rows(case: Case, seconds: float, progress: Progress) -> list[ContestRow]:
    # The first call, which may compile or fill caches, gives the result and is not timed.
    results = {each.name: each.call() for each in case.contenders}
    times_ms = in_turns_ms({each.name: each.call for each in case.contenders}, seconds, progress)
    first = np.median(times_ms[case.contenders[0].name], axis=0)
    rows = []
    for each in case.contenders:
        quartiles = np.quantile(times_ms[each.name], (0.25, 0.5, 0.75), axis=0)
        to_first, cpu_to_first = (quartiles[1] / first).tolist()
        error = None if case.error is None else case.error(results[each.name])
        (low, _), (time_ms, cpu_ms), (high, _) = (quartiles / case.units).tolist()
        times = low, time_ms, high, to_first, cpu_ms, cpu_to_first
        rows.append(ContestRow(case.name, each.name, each.ours, *times, error, case.at))
    return rows


def in_turns_ms(
    calls: Mapping[str, Callable[[], object]], seconds: float, progress: Progress
) -> dict[str, list[tuple[float, float]]]:
    """Times of each call, wall and CPU ms, in rounds of all of them, as many as fit into ``seconds`` for each on
    average, from ``FEWEST`` to ``MOST``, after one that does not count. ``progress`` receives each round's share."""
    first_ms = sum(_time_ms(call)[0] for call in calls.values())
    rounds = int(np.clip(1e3 * seconds * len(calls) / first_ms, FEWEST, MOST))
    times: dict[str, list[tuple[float, float]]] = {name: [] for name in calls}
    for _ in range(rounds):
        for name, call in calls.items():
            times[name].append(_time_ms(call))
        progress(1 / rounds)
    return times


def _time_ms(call: Callable[[], object]) -> tuple[float, float]:
    started, cpu_s = time.perf_counter(), _cpu_s()
    call()
    return 1e3 * (time.perf_counter() - started), 1e3 * (_cpu_s() - cpu_s)


def _cpu_s() -> float:
    """Of this process, and of its children that ended."""
    of_all = os.times()
    return time.process_time() + of_all.children_user + of_all.children_system


def digits(value: float | None) -> str:
    """Two or three digits that count; "-" for none."""
    return "-" if value is None else f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}"
