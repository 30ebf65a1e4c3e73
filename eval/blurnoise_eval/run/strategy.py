"""Strategies: which conditions a run computes. A grid computes all of its plan; others choose more by the results.

:class:`Grid` is the simplest one, :class:`~blurnoise_eval.run.refine.Refine` adds exposures where windows end,
:class:`~blurnoise_eval.run.search.Search` looks for the exposures to use with as few conditions as it can, and
:class:`~blurnoise_eval.run.plane_search.PlaneSearch` for the ends of windows on a large grid.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from blurnoise.camera import Camera
from blurnoise_eval.plan.plan import SweepPlan
from blurnoise_eval.run.run import Run
from blurnoise_eval.run.search_space import SearchSpace


class Step(NamedTuple):
    """What is computed at a time: conditions of a plan. name: of the progress bar; note: a line ahead of it."""

    name: str
    plan: SweepPlan
    note: str = ""


class Strategy(Protocol):
    """Which conditions are computed, step by step.

    plan: what the run is known by; a run in the same folder must have the same one. search_space: what a search is
    asked for, and why it computes the full grid; None of other strategies.
    """

    @property
    def plan(self) -> SweepPlan:
        """The plan by which runs are told apart."""

    @property
    def search_space(self) -> SearchSpace | None:
        """What a search is asked for."""

    def steps(self, run: Run) -> Iterator[Step]:
        """Yield what to compute next, until nothing is left. What was yielded before is in the run by then.

        Which steps follow depends on the run alone, and they are noted in it (:meth:`Run.note`) before they are
        yielded: so a run that was stopped goes on to the same rows.
        """


StrategyOf = Callable[[SweepPlan, Camera], Strategy]
"""Makes the strategy of a plan and a camera: a class, or a function that chooses one."""


@dataclass(frozen=True)
class Grid:
    """Every condition of the plan.

    >>> plan = SweepPlan({"exposure_s": (0.001, 0.01), "illuminance_lux": (50.0,)})
    >>> [(step.name, len(step.plan.conditions())) for step in Grid(plan).steps(None)]
    [('sweep', 2)]
    """

    plan: SweepPlan
    camera: Camera | None = None
    search_space: SearchSpace | None = None

    def steps(self, run: Run | None) -> Iterator[Step]:
        """One step."""
        yield Step("sweep", self.plan)
