"""The strategy of a search: which exposure to use, from few of the grid's conditions.

It measures where most may be gained over the exposures that would be recommended so far, a batch of conditions at a
time, until none may gain more than ``SETTLED``. So what it computes is a part of a sweep, and its answers are those
of a sweep from fewer conditions. Where conditions of equal lux-seconds and motion are one experiment and the grid is
large, :class:`~.plane_search.PlaneSearch` needs fewer.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from blurnoise.camera import Camera
from blurnoise_eval.plan.axes import EXPOSURE
from blurnoise_eval.plan.conditions import Conditions
from blurnoise_eval.plan.plan import SweepPlan
from blurnoise_eval.plan.typed import AUTOMATIC
from blurnoise_eval.report.words import counted
from blurnoise_eval.run.grid_cells import Cells, lines_of
from blurnoise_eval.run.outlook import most_promising, outlooks
from blurnoise_eval.run.plane_search import PlaneSearch
from blurnoise_eval.run.refine import Refine
from blurnoise_eval.run.run import Run
from blurnoise_eval.run.search_space import SearchSpace, spread
from blurnoise_eval.run.setup import Batch
from blurnoise_eval.run.strategy import Step, Strategy

BATCH = 6
"""Conditions at a time; half as many as there are lights and speeds, if these are more."""


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
        cells, noted = Cells.of(self.plan, self.camera, tables), set(_noted(run))
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
        cells = Cells.of(self.plan, self.camera, tables, between=between)
        batch = max(BATCH, len(self._lines) // 2)
        if not noted:
            tested = np.argwhere(np.broadcast_to(cells.of_grid, cells.shape))
            chosen = tested[spread(cells.places[tuple(tested.T)], batch)].tolist()
        else:
            of_models = outlooks(cells, self.camera, run.averages(tables), tables)
            chosen = most_promising(of_models, batch)
        return [self._conditions(cell, cells) for cell in chosen]

    @cached_property
    def _lines(self) -> list[dict[str, float]]:
        return lines_of(self.plan)

    def _conditions(self, cell: Sequence[int], cells: Cells) -> Conditions:
        n, e = cell
        return Conditions(**self._lines[n], exposure_s=cells.exposures_s[e])


def _grid(plan: SweepPlan) -> SearchSpace:
    return SearchSpace({name: plan.values(name) for name in plan.grid})


def _noted(run: Run) -> list[Conditions]:
    return [at for batch in run.setup.batches for at in batch.conditions]
