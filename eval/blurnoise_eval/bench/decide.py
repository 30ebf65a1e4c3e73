"""Bench of searches: how many conditions each way of looking asks for, and how far off the edges are that it finds.

Domain: a dense plane of a real detector's scores stands for the truth, by a smooth interpolation between its nodes
that is none of those judged (Clough and Tocher's). Levels are kept shares of each group's clean confidence. Calls are
conditions, each asked with every picture; errors are in stops of exposure.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.bench.decide_planes import Planes
from blurnoise_eval.bench.timing import machine
from blurnoise_eval.bench.written import write_bench
from blurnoise_eval.deciding.kriging import Kriging
from blurnoise_eval.deciding.nodes import Line, lattice, places_of, same_places
from blurnoise_eval.deciding.search import Search
from blurnoise_eval.deciding.trend import USUAL, Trend
from blurnoise_eval.scoring.crossings import windows

Progress = Callable[[float], object]
EXPOSURES = (1e-3, 90e-3)
LEVELS = (0.8, 0.9)
GRID_EXPOSURES = 10
"""Of the grid whose calls are 1."""
GRIDS, BISECTED, SUBSETS = (4, 6, 10, 20), (0.5, 0.25), (18, 24, 30, 36, 42, 48, 60)
METHODS = ("search", "random nodes", "grid", "bisection")
_COARSE = 2.0  # stops at which a bisection begins
_PER_STOP = 24  # at which edges are looked for
_ALIKE = 1.0  # stops within which two edges are the same one
_NEAR = 0.15  # of a level, where sigma is held to the errors
_LEAST_CLEAN = 1.0  # sum of clean confidences below which a group is withheld
Array = NDArray[np.float64]


class Scenario(NamedTuple):
    """Lights, lux, and speeds along x, px/s, each with each."""

    name: str
    lights_lux: tuple[float, ...]
    speeds_px_s: tuple[float, ...]

    @property
    def lines(self) -> list[Line]:
        """All of them."""
        return [Line(lux, (speed, 0.0)) for lux in self.lights_lux for speed in self.speeds_px_s]


SCENARIOS = (
    Scenario("5 lights, 4 speeds", (2.0, 10.0, 45.0, 200.0, 1000.0), (0.0, 100.0, 400.0, 1600.0)),
    Scenario(
        "10 lights, 12 speeds",
        tuple(np.geomspace(2.0, 1000.0, 10).tolist()),
        (0.0, *np.geomspace(25.0, 1600.0, 11).tolist()),
    ),
)


@dataclass(frozen=True)
class Extent:
    """How much is compared. pictures: of the planes, where they are still to be made. draws: of random nodes."""

    pictures: int = 20
    scenarios: tuple[Scenario, ...] = SCENARIOS
    draws: int = 5


FULL = Extent()
QUICK = Extent(8, SCENARIOS[:1], 2)


@dataclass(frozen=True)
class Row:
    """One method on one plane and scenario.

    calls: conditions asked; share: by those of the grid of ``GRID_EXPOSURES``. edges: true ones; missed: without
    one within a stop. median, high: of the others' errors, half and nine tenths are smaller, stops. wrong: stops of a
    line on the wrong side of the level, on average. misfit: root mean square of errors by sigma near the levels; None
    where the method says none. own_end: whether the search stopped there itself.
    """

    plane: str
    scenario: str
    method: str
    calls: int
    share: float
    edges: int
    missed: int
    median: float
    high: float
    wrong: float
    misfit: float | None = None
    own_end: bool = False


@dataclass(frozen=True)
class Bench:
    """What was found, and how it was made."""

    rows: list[Row]
    extent: Extent
    machine: dict[str, Any]

    def losses(self) -> list[str]:
        """Where the search's own end asks more than a quarter of the grid's calls (0.05 of 10 x 12), or is farther
        off than 0.05 stops or the grid."""
        found = []
        for row in self.rows:
            if not row.own_end:
                continue
            grid = next(
                each
                for each in self.rows
                if (each.plane, each.scenario, each.method) == (row.plane, row.scenario, "grid")
                and each.share == 1
            )
            most = 0.25 if row.scenario == SCENARIOS[0].name else 0.05
            if row.share > most or row.median > min(0.05, grid.median) or row.missed > grid.missed:
                found.append(
                    f"{row.plane}, {row.scenario}: search asks {row.share:.3f} of the grid's calls, edges are off by "
                    f"{row.median:.3f} stops and {row.missed} missed; the grid's {grid.median:.3f} and {grid.missed}"
                )
        return found

    def document(self) -> dict[str, Any]:
        """Everything, ready for JSON."""
        return {
            "extent": asdict(self.extent),
            "machine": self.machine,
            "losses": self.losses(),
            "rows": [asdict(row) for row in self.rows],
        }


def nodes_of(extent: Extent) -> Array:
    """What a plane must hold: the lattice of all scenarios' lines, (N, 2)."""
    return lattice([line for scenario in extent.scenarios for line in scenario.lines], EXPOSURES)


def steps(planes: Sequence[Planes], extent: Extent) -> int:
    """What the shares told to ``progress`` add up to."""
    return len(planes) * len(extent.scenarios)


def measure(
    planes: Sequence[Planes], extent: Extent = FULL, threads: int = 1, progress: Progress = lambda share: None
) -> Bench:
    """Let every method ask the planes, and hold what it finds to them."""
    rows: list[Row] = []
    for plane in planes:
        truth = Truth(plane)
        for scenario in extent.scenarios:
            rows += _rows(truth, scenario, extent)
            progress(1)
    return Bench(rows, extent, machine(threads))


def write(bench: Bench, folder: Path) -> None:
    """Write decide.csv, a row per plane, scenario, method and calls, and decide.json."""
    write_bench("decide", [asdict(row) for row in bench.rows], bench.document(), folder)


class Truth:
    """A dense plane as what is to be found: kept shares of Q groups anywhere in it, and their standard errors."""

    def __init__(self, planes: Planes) -> None:
        told = planes.clean.sum(axis=1) >= _LEAST_CLEAN
        self.name = f"{planes.model}, gain {planes.gain}"
        self._sums, self._clean = planes.sums[told], planes.clean[told]
        from scipy.interpolate import CloughTocher2DInterpolator

        self._at = CloughTocher2DInterpolator(planes.places, np.moveaxis(self._sums, -1, 0))
        self._nearest = planes.places

    @property
    def questions(self) -> int:
        """How many groups can be told of."""
        return len(self._sums)

    def seen(self, places: Array) -> tuple[Array, Array]:
        """Kept shares and their standard errors over pictures at places (M, 2), (Q, M) each."""
        sums = np.moveaxis(np.asarray(self._at(self._within(places))), 0, -1)
        total = self._clean.sum(axis=1)[:, None]
        kept = sums.sum(axis=1) / total
        away = sums - kept[:, None] * self._clean[:, :, None]
        return kept, np.sqrt((away**2).sum(axis=1)) / total

    def _within(self, places: Array) -> Array:
        """The nearest node instead of a place beyond them all."""
        inside = np.isfinite(np.asarray(self._at(places)).reshape(len(places), -1)).all(axis=1)
        moved = places.copy()
        for index in np.flatnonzero(~inside):
            away = ((self._nearest - places[index]) ** 2).sum(axis=1)
            moved[index] = self._nearest[int(away.argmin())]
        return moved


class _Lines:
    """The lines of a scenario, finely, with the truth upon them."""

    def __init__(self, truth: Truth, scenario: Scenario) -> None:
        self.lines = scenario.lines
        low, high = EXPOSURES
        self.times = np.geomspace(low, high, 1 + int(np.ceil(_PER_STOP * np.log2(high / low))))
        self.places = np.concatenate([places_of(self.times, line) for line in self.lines])
        self.kept = self.shaped(truth.seen(self.places)[0])
        self.step = float(np.log2(self.times[1] / self.times[0]))

    def shaped(self, values: Array) -> Array:
        """Of each question on each line: (Q, L, T)."""
        return values.reshape(len(values), len(self.lines), len(self.times))

    def row(self, found: Array, **about: Any) -> Row:
        """What is told by curves (Q, L, T) beside the truth's."""
        errors: list[float] = []
        missed = 0
        for kept, own in zip(
            self.kept.reshape(-1, len(self.times)), found.reshape(-1, len(self.times)), strict=True
        ):
            for level in LEVELS:
                there = self._edges(own, level)
                for edge, rising in self._edges(kept, level):
                    near = [abs(edge - each) for each, up in there if up == rising]
                    nearest = min(near, default=np.inf)
                    missed += nearest > _ALIKE
                    errors += [nearest] if nearest <= _ALIKE else []
        wrong = np.mean([(self.kept >= level) != (found >= level) for level in LEVELS]) * np.log2(
            self.times[-1] / self.times[0]
        )
        median, high = np.quantile(errors, (0.5, 0.9)).tolist() if errors else (0.0, 0.0)
        return Row(
            edges=len(errors) + missed, missed=missed, median=median, high=high, wrong=float(wrong), **about
        )

    def _edges(self, values: Array, level: float) -> list[tuple[float, bool]]:
        """log2 of where windows begin (True) and end (False) within the range."""
        found = windows(tuple(self.times.tolist()), values.tolist(), level, True)
        ends = [(end, first) for window in found for end, first in zip(window, (True, False), strict=True)]
        first, last = self.times[0] * (1 + 1e-9), self.times[-1] * (1 - 1e-9)
        return [(float(np.log2(end)), rising) for end, rising in ends if first < end < last]


def _rows(truth: Truth, scenario: Scenario, extent: Extent) -> Iterator[Row]:
    on = _Lines(truth, scenario)
    calls = GRID_EXPOSURES * len(on.lines)

    def about(method: str, count: int) -> dict[str, Any]:
        return {
            "plane": truth.name, "scenario": scenario.name, "method": method,
            "calls": count, "share": count / calls,
        }  # fmt: skip

    for count in GRIDS:
        yield on.row(
            _between(truth, on, np.geomspace(*EXPOSURES, count)), **about("grid", count * len(on.lines))
        )
    for width in BISECTED:
        found, asked = _bisected(truth, on, width)
        yield on.row(found, **about("bisection", asked))
    nodes = lattice(on.lines, EXPOSURES)
    generator = np.random.default_rng(0)
    for count in SUBSETS:
        if count <= len(nodes):
            drawn = [
                on.row(
                    _surfaces(truth, on, nodes[generator.permutation(len(nodes))[:count]])[0], **about("", 0)
                )
                for _ in range(extent.draws)
            ]
            yield _median_of(drawn, **about("random nodes", count))
    yield from _searched(truth, on, about)


def _searched(truth: Truth, on: _Lines, about: Callable[[str, int], dict[str, Any]]) -> Iterator[Row]:
    """After each batch of the search, until its own end."""
    search = Search(on.lines, EXPOSURES, LEVELS)
    while not search.done:
        places = search.ask()
        search.tell(places, *truth.seen(places))
        found, sigma = _surfaces(truth, on, search.nodes)
        near = np.min([np.abs(on.kept - level) for level in LEVELS], axis=0) < _NEAR
        off = ((found - on.kept) / np.maximum(sigma, 1e-9))[near]
        misfit = float(np.sqrt(np.mean(off**2))) if near.any() else None
        row = on.row(found, **about("search", len(search.nodes)), misfit=misfit, own_end=search.done)
        yield row


def _surfaces(truth: Truth, on: _Lines, nodes: Array, trend: Trend | None = USUAL) -> tuple[Array, Array]:
    """Kept shares and sigmas on the lines, each (Q, L, T), by surfaces through the nodes."""
    different, which = same_places(on.places)
    kept, sigmas = [], []
    for values in truth.seen(nodes)[0]:
        surface = Kriging.fit(nodes, values, trend)
        kept.append((surface.weights(different) @ values)[which])
        sigmas.append(surface.sigma(different)[which])
    return on.shaped(np.array(kept)), on.shaped(np.array(sigmas))


def _between(truth: Truth, on: _Lines, exposures_s: Array) -> Array:
    """Straight between some exposures of each line."""
    at = np.concatenate([places_of(exposures_s, line) for line in on.lines])
    kept = truth.seen(at)[0].reshape(-1, len(on.lines), len(exposures_s))
    x, known = np.log2(on.times), np.log2(exposures_s)
    return np.array([[np.interp(x, known, values) for values in group] for group in kept])


def _bisected(truth: Truth, on: _Lines, width: float) -> tuple[Array, int]:
    """Straight between exposures of each line, halved wherever a level lies between; and how many were asked."""
    low, high = np.log2(EXPOSURES)
    found = np.zeros_like(on.kept)
    asked = 0
    for place, line in enumerate(on.lines):
        times = np.linspace(low, high, 1 + int(np.ceil((high - low) / _COARSE)))
        while True:
            kept = truth.seen(places_of(2.0**times, line))[0]
            above = np.concatenate([kept >= level for level in LEVELS])
            open_ = (above[:, 1:] != above[:, :-1]).any(axis=0) & (np.diff(times) > width)
            if not open_.any():
                break
            times = np.sort(np.concatenate([times, (times[1:][open_] + times[:-1][open_]) / 2]))
        asked += len(times)
        for group, values in enumerate(kept):
            found[group, place] = np.interp(np.log2(on.times), times, values)
    return found, asked


def _median_of(rows: Sequence[Row], **about: Any) -> Row:
    """Of the same method drawn several times."""
    middle = {
        name: float(np.median([getattr(row, name) for row in rows])) for name in ("median", "high", "wrong")
    }
    missed = int(np.median([row.missed for row in rows]))
    return Row(edges=rows[0].edges, missed=missed, **middle, **about)
