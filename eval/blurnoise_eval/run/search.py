"""The strategy of a search: which exposure to use, from few of the grid's conditions.

It measures where most may be gained over the exposures that would be recommended so far, a batch of conditions at a
time, until none may gain more than ``SETTLED``. So what it computes is a part of a sweep, and its answers are those
of a sweep from fewer conditions. Where conditions of equal lux-seconds and motion are one experiment and the grid is
large, :class:`~.plane_search.PlaneSearch` needs fewer.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain, pairwise, product

import numpy as np
from numpy.typing import NDArray

from blurnoise.camera import Camera
from blurnoise_eval.answers.plane import direction_of, places_of
from blurnoise_eval.answers.recommendation import WIDE
from blurnoise_eval.answers.table import ScoreTable
from blurnoise_eval.plan.axes import EGO, EXPOSURE, LIGHT, SETTING, setting_of, velocity_of
from blurnoise_eval.plan.conditions import Conditions
from blurnoise_eval.plan.plan import SweepPlan
from blurnoise_eval.plan.typed import AUTOMATIC
from blurnoise_eval.report.words import counted
from blurnoise_eval.run.outlook import Cells, Outlook, most_promising
from blurnoise_eval.run.plane_search import PlaneSearch
from blurnoise_eval.run.refine import Refine
from blurnoise_eval.run.run import Run
from blurnoise_eval.run.search_space import SearchSpace, spread
from blurnoise_eval.run.setup import Batch
from blurnoise_eval.run.strategy import Step, Strategy
from blurnoise_eval.run.surface import Trend

BATCH = 6
"""Conditions at a time; half as many as there are lights and speeds, if these are more."""
_LEAST_LUX = 0.01
_PX_S_OF_KMH = 10.0  # a sign 5 m beside and 12.5 m ahead, in a picture of 1280 px over 60 degrees
_BESIDE = (
    0.25  # stops by which a stop of light counts that lux x seconds does not tell: cameras nearly obey it
)
Array = NDArray[np.float64]


def search(plan: SweepPlan, camera: Camera) -> Strategy:
    """A search over a plan's grid: over the plane where that holds and needs less, else over its conditions."""
    exposures = plan.values(EXPOSURE.name)
    if AUTOMATIC in exposures or len(exposures) == 1:
        because = "the camera sets the exposure itself" if AUTOMATIC in exposures else "there is one exposure"
        space = replace(_grid(plan), because=[because])
        return Refine(plan, camera, search_space=space, note=f"decide: {because}")
    return PlaneSearch.of(plan, camera, SearchSpace(plan.spanned)) or Search(plan, camera)


@dataclass(frozen=True)
class Search:
    """The conditions of a plan's grid that decide which exposure to use, and some of exposures between its own."""

    plan: SweepPlan
    camera: Camera

    @property
    def search_space(self) -> SearchSpace:
        """The grid."""
        return _grid(self.plan)

    def steps(self, run: Run) -> Iterator[Step]:
        """What the run has, then batch by batch until nothing is to gain."""
        tables = run.score_tables()
        cells, noted = self._cells(tables), set(_noted(run))
        here = [self._conditions(cell, cells) for cell in np.argwhere(cells.measured(tables)).tolist()]
        if others := [at for at in here if at not in noted]:  # of a sweep in the same folder
            self._note(run, others)
        if computed := _noted(run):
            yield self._step(computed, first=True)
        while more := self._next(run):
            self._note(run, more)
            yield self._step(more, first=len(more) == len(_noted(run)))

    def _note(self, run: Run, conditions: Sequence[Conditions]) -> None:
        run.note(Batch(run.setup.manifest["images"]["count"], (), tuple(conditions)))

    def _step(self, conditions: Sequence[Conditions], *, first: bool) -> Step:
        grid = self.search_space.grid_conditions
        note = f"decide: {counted(grid, 'condition')} in the grid, {len(conditions)} at first"
        plan = replace(self.plan, only=tuple(conditions), examples=self.plan.examples and first)
        return Step(counted(len(conditions), "condition"), plan, note * first)

    def _next(self, run: Run) -> list[Conditions]:
        """The conditions that are computed next, by all that the run has."""
        noted, tables = _noted(run), run.tables_with_answers()
        # Once it has computed as much as the grid, only what it has begun is completed.
        between = len(noted) < self.search_space.grid_conditions
        cells, batch = self._cells(tables, between=between), max(BATCH, len(self._lines) // 2)
        if not noted:
            tested = np.argwhere(np.broadcast_to(cells.of_grid, cells.shape))
            chosen = tested[spread(cells.places[tuple(tested.T)], batch)].tolist()
        else:
            trend = Trend.of(self.camera)
            outlooks = [
                Outlook(of, cells, _ceiling([table for table in tables if table.model == of.model]), trend)
                for of in run.averages(tables)
            ]
            chosen = most_promising(outlooks, batch)
        return [self._conditions(cell, cells) for cell in chosen]

    @cached_property
    def _lines(self) -> list[dict[str, float]]:
        """Of each line its values by axis, those of its named light included."""
        names = [name for name in self.plan.grid if name != EXPOSURE.name]
        combined = product(*(self.plan.grid[name] for name in names))
        return [self.plan.of_light(dict(zip(names, values, strict=True))) for values in combined]

    def _conditions(self, cell: Sequence[int], cells: Cells) -> Conditions:
        n, e = cell
        return Conditions(**self._lines[n], exposure_s=cells.exposures_s[e])

    def _cells(self, tables: Iterable[ScoreTable], *, between: bool = True) -> Cells:
        """The cells of the grid, of all exposures that were measured, and of others between those of the grid."""
        grid = self.plan.values(EXPOSURE.name)
        measured = chain.from_iterable(table.conditions[EXPOSURE.name].tolist() for table in tables)
        exposures = sorted({*grid, *(_between(grid) if between else ()), *measured})
        rows = [Conditions(**line, exposure_s=grid[0]).on(self.camera) for line in self._lines]
        return Cells(
            settings=tuple(map(setting_of, rows)),
            velocities_px_s=tuple(map(velocity_of, rows)),
            exposures_s=tuple(exposures),
            of_grid=np.isin(exposures, grid),
            places=_places(rows, exposures),
            # Where only a part of the picture moves, or the camera drives, a speed may undo another motion.
            monotone=not (self.plan.trajectory or self.plan.cuts or any(self.plan.values(EGO.name))),
        )


def _grid(plan: SweepPlan) -> SearchSpace:
    return SearchSpace({name: plan.values(name) for name in plan.grid})


def _noted(run: Run) -> list[Conditions]:
    return [at for batch in run.setup.batches for at in batch.conditions]


def _between(exposures_s: Sequence[float]) -> Iterator[float]:
    """Exposures that leave no gap wider than ``WIDE`` between those of a grid, to three digits.

    >>> list(_between((0.001, 0.002)))
    [0.00141]
    """
    for low, high in pairwise(exposures_s):
        parts = math.ceil(math.log2(high / low) / WIDE - 0.1)
        yield from (float(f"{low * (high / low) ** (k / parts):.3g}") for k in range(1, parts))


def _ceiling(tables: Sequence[ScoreTable]) -> float:
    """The mean score on the original pictures, in the criterion's unit: what simulated ones hardly surpass."""
    return float(np.mean([1.0 if table.kept or table.clean is None else table.clean for table in tables]))


def _places(rows: Sequence[Mapping[str, float]], exposures_s: Sequence[float]) -> Array:
    """(N, E, D) in stops, of N lines at E exposures: light on the sensor, motion during the exposure, and beside them
    what may tell experiments of equal light and motion apart: the exposure time, and all other axes by rank."""
    lux = np.array([max(row[LIGHT.name], _LEAST_LUX) for row in rows])[:, None]
    speeds = [math.hypot(*velocity_of(row)) + _PX_S_OF_KMH * float(EGO.shown(row[EGO.name])) for row in rows]
    on_plane = places_of(np.array(exposures_s), lux, np.array(speeds)[:, None])
    beside = [_BESIDE * np.log2(lux[:, 0])]
    for name in SETTING:
        if name not in (LIGHT.name, EGO.name):
            beside.append(np.unique([row[name] for row in rows], return_inverse=True)[1].astype(float))
    directions = [direction_of(velocity_of(row)) for row in rows]
    if len(set(directions) - {None}) > 1:
        beside += np.array([each or (0.0, 0.0) for each in directions]).T.tolist()
    varied = np.array([each for each in beside if np.ptp(each) > 0] or [np.zeros(len(rows))]).T
    further = np.broadcast_to(varied[:, None], (*on_plane.shape[:2], varied.shape[1]))
    return np.concatenate([on_plane, further], axis=-1)
