"""The strategy of a search over the plane: which exposures work, from few conditions of a large grid.

It chooses nodes of the plane of lux-seconds and pixels, a batch at a time; the scores of a batch decide which nodes
come next. So a run that was stopped can go on, and a wider question starts with the existing nodes. The nodes are as
many for ten lights as for a hundred; :class:`~.search.Search`, which measures at every light and speed, needs more.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from blurnoise.camera import Camera
from blurnoise_eval.answers.recommendation import MOST_COMMON
from blurnoise_eval.answers.table import ScoreTable
from blurnoise_eval.plan.conditions import Conditions
from blurnoise_eval.plan.plan import SweepPlan
from blurnoise_eval.run.edge_search import CHECKED, MOST_NODES, EdgeSearch
from blurnoise_eval.run.run import Run
from blurnoise_eval.run.search_space import (
    SearchSpace,
    conditions_at,
    direction_of_all,
    lattice,
    what_breaks,
)
from blurnoise_eval.run.setup import Batch, Place
from blurnoise_eval.run.strategy import Step
from blurnoise_eval.run.surface import Trend

SHARE = 0.22
"""Of the grid's conditions, the most that a search over the plane may need to be worth its predictions."""
_SAME_PLACE = 1e-4  # stops: conditions are rounded
Array = NDArray[np.float64]


@dataclass(frozen=True)
class PlaneSearch:
    """Nodes that lead to the ends of the exposure windows, then the recommended exposure under all conditions.

    plan: of the nodes, with a direction in place of the grid. note: a line ahead of the first step.
    """

    plan: SweepPlan
    camera: Camera
    search_space: SearchSpace
    note: str = ""

    @classmethod
    def of(cls, plan: SweepPlan, camera: Camera, space: SearchSpace) -> PlaneSearch | None:
        """The search of a plan; None where the plane does not hold, or the search is not worth its predictions."""
        if what_breaks(camera, space, plan.trajectory, pulsed=plan.pulsed):
            return None
        most, grid = (
            min(MOST_NODES + CHECKED, len(lattice(space.lines, space.exposures_s))),
            space.grid_conditions,
        )
        if most > SHARE * grid:
            return None
        further = {name: (value,) for name, value in space.further.items()}
        direction = direction_of_all(space.lines)
        nodes = replace(plan, grid=further, light=(), only=(), direction=direction, vehicle=None)
        return cls(
            nodes, camera, space, f"decide: a search over at most {most} conditions; the grid has {grid}"
        )

    def steps(self, run: Run) -> Iterator[Step]:
        """What was noted before, then batch by batch until nothing is left to measure."""
        batches = run.setup.batches
        if batches:  # until the run was stopped, or of a narrower question
            yield self._step(run, [at for batch in batches for at in batch.conditions])
        yield from self._find_edges(run)
        while common := self._common(run):
            yield self._noted(run, (), common)

    def _step(self, run: Run, conditions: Sequence[Conditions]) -> Step:
        first = len(run.setup.batches) == 1
        plan = replace(self.plan, only=tuple(conditions), examples=first)
        return Step(f"{len(conditions)} nodes", plan, self.note * first)

    def _noted(self, run: Run, places: Sequence[Place], conditions: Sequence[Conditions]) -> Step:
        run.note(Batch(run.setup.manifest["images"]["count"], tuple(places), tuple(conditions)))
        return self._step(run, conditions)

    def _find_edges(self, run: Run) -> Iterator[Step]:
        """Nodes until the search is done, or no group of targets has a score that means something.

        The search is given each batch once; where the groups become others it begins anew with all of them.
        """
        edges, n_used, n_planes = self._edge_search(run), 0, 0
        while not edges.done:
            batches = [batch for batch in run.setup.batches if batch.places]
            if n_used == len(batches):
                places = [(u, w) for u, w in edges.ask().tolist()]
                space = self.search_space
                of = space.lines, space.exposures_s, space.further
                yield self._noted(run, places, [conditions_at(place, *of) for place in places])
                continue
            planes = [plane for table in run.tables_with_answers() for plane in table.on_plane()]
            if not planes:
                return
            if len(planes) != n_planes:
                edges, n_used, n_planes = self._edge_search(run), 0, len(planes)
            for batch in batches[n_used:]:
                values, errors = zip(*(_at(plane, batch.places) for plane in planes), strict=True)
                edges.tell(batch.places, np.array(values), np.array(errors))
            n_used = len(batches)

    def _edge_search(self, run: Run) -> EdgeSearch:
        space, trend = self.search_space, Trend.of(self.camera)
        level = run.criterion.level
        return EdgeSearch(space.lines, space.exposures_s, level, most_nodes=MOST_NODES, trend=trend)

    def _common(self, run: Run) -> tuple[Conditions, ...]:
        """The next batch: all lights and speeds at the recommended exposure, unless a close one was measured there.

        Nothing where each model has one, or ``MOST_COMMON`` exposures.
        """
        models, space = run.averages(run.tables_with_answers()), self.search_space
        common = [at for batch in run.setup.batches if not batch.places for at in batch.conditions]
        measured = {at.exposure_s for at in common}
        wanted = [each for each in (model.unmeasured(measured) for model in models) if each is not None]
        if not wanted or len(measured) >= MOST_COMMON * len(models):
            return ()
        exposure_s = float(np.clip(wanted[0], *space.exposures_s))
        return tuple(Conditions(exposure_s=exposure_s, **space.further, **line.axes) for line in space.lines)


def _at(plane: ScoreTable, places: Sequence[Place]) -> tuple[Array, Array]:
    """The mean and its standard error over clusters at nodes as they were asked, (N,); NaN where nothing is known."""
    distances = np.abs(np.array(places)[:, None] - plane.places).max(axis=-1)
    nearest, measured = distances.argmin(axis=1), distances.min(axis=1) <= _SAME_PLACE
    mean, error = (np.where(measured, of[nearest], np.nan) for of in (plane.mean, plane.standard_error))
    return mean, error
