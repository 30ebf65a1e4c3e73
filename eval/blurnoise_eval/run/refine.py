"""Refining a grid: further exposures where a window ends between two tested ones, and near the best for all.

The interval of a window's end is as wide as the gap between the tested exposures around it. Halving the gap around an
end to a quarter of a stop, and those in which its interval ends to half a stop, costs a few conditions of that light
and speed.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from blurnoise.camera import Camera
from blurnoise_eval.answers.exposure_window import answers
from blurnoise_eval.answers.recommendation import MOST_COMMON
from blurnoise_eval.answers.rows import AnswerRow
from blurnoise_eval.plan.axes import EXPOSURE
from blurnoise_eval.plan.conditions import Conditions
from blurnoise_eval.plan.plan import SweepPlan
from blurnoise_eval.plan.typed import AUTOMATIC
from blurnoise_eval.run.run import Run
from blurnoise_eval.run.search_space import SearchSpace
from blurnoise_eval.run.setup import Batch
from blurnoise_eval.run.strategy import Step

STOPS, STOPS_OF_INTERVAL = 0.25, 0.5
"""The gap around a window's end, and those in which its interval ends, are halved until none is wider."""
MOST_GROUPS = 4
"""The windows of so many target groups of each model are refined, those with the most targets."""
_ROUNDED = 0.02  # stops: refined exposures are rounded to three digits


@dataclass(frozen=True)
class Refine:
    """Every condition of the plan, then more exposures where windows end between two tested ones.

    search_space: of a search that computes the full grid instead. note: a line ahead of the first step.
    """

    plan: SweepPlan
    camera: Camera | None = None
    search_space: SearchSpace | None = None
    note: str = ""

    def steps(self, run: Run) -> Iterator[Step]:
        """The grid, then batches of conditions until no wide gap is left."""
        yield Step("sweep", self.plan, self.note)
        n_pictures = run.setup.manifest["images"]["count"]
        noted = tuple(at for batch in run.setup.batches for at in batch.conditions)
        if noted:  # until the run was stopped
            yield self._step(noted)
        while more := self._next(run):
            n_cells = n_pictures * self.plan.repeats
            grid = f"beside the {n_cells * len(self.plan.conditions())} of the grid"
            note = f"refine: {n_cells * len(more)} cells or more {grid} (refine: false in a plan: none)"
            first = not run.setup.batches
            run.note(Batch(n_pictures, (), more))
            yield self._step(more, note * first)

    def _step(self, conditions: tuple[Conditions, ...], note: str = "") -> Step:
        return Step("refine", replace(self.plan, only=conditions, examples=False), note)

    def _next(self, run: Run) -> tuple[Conditions, ...]:
        """The conditions that are computed next, by all that the run has; none where the camera sets the exposure."""
        tested = self.plan.values(EXPOSURE.name)
        # Nothing to refine: the camera chooses, and there are no exposures between two tested ones.
        if AUTOMATIC in tested:
            return ()
        tables, monotone = run.tables_with_answers(), run.setup.monotone
        names = [name for name in self.plan.grid if name != EXPOSURE.name]
        wanted: list[tuple[tuple[float, ...], float]] = []
        every = [row for table in tables for row in answers(table, run.criterion, monotone=monotone)]
        for answer in _largest(every):
            at = tuple(answer.conditions[name] for name in names)
            # Half-way in stops, to three digits, which a caption can show.
            wanted += [(at, float(f"{math.sqrt(low * high):.3g}")) for low, high in _wide_gaps(answer)]
        models = run.averages(tables)
        for model in models:  # the exposures that promise to keep more on average, under all conditions
            measured = np.isfinite(model.value).all(axis=0).sum()
            most = len(tested) + MOST_COMMON * len(models)
            if measured < most and (exposure_s := model.next_exposure()) is not None:
                wanted += [(at, exposure_s) for at in product(*(self.plan.grid[name] for name in names))]
        chosen = [
            Conditions(**self.plan.of_light(dict(zip(names, at, strict=True))), exposure_s=exposure_s)
            for at, exposure_s in wanted
        ]
        noted = {at for batch in run.setup.batches for at in batch.conditions}
        return tuple(at for at in dict.fromkeys(chosen) if at not in noted)


def _wide_gaps(answer: AnswerRow) -> list[tuple[float, float]]:
    """The wide gaps between tested exposures in which a window ends, or an interval of its end. Where nothing is sure
    to work no gap matters."""
    x = answer.exposures_s
    bounds = zip(answer.windows_s, answer.windows_low_s, answer.windows_high_s, strict=True)
    widest: dict[tuple[float, float], float] = {}
    for window, *intervals in bounds if answer.verdict == "works" else ():
        for end, (low, high) in zip(window, intervals, strict=True):
            if not x[0] < end < x[-1]:
                continue
            place = bisect_left(x, end)
            gaps: dict[tuple[float, float], float] = {}
            if low is not None and low < x[-1]:
                gaps[low, x[bisect_left(x, low) + 1]] = STOPS_OF_INTERVAL
            if high is not None and high > x[0]:
                gaps[x[bisect_left(x, high) - 1], high] = STOPS_OF_INTERVAL
            if x[place] != end:
                gaps[x[place - 1], x[place]] = STOPS
            for gap, stops in gaps.items():
                widest[gap] = min(stops, widest.get(gap, stops))
    return [(low, high) for (low, high), stops in widest.items() if math.log2(high / low) > stops + _ROUNDED]


def _largest(answers: Iterable[AnswerRow]) -> list[AnswerRow]:
    """The answers of each model's largest groups."""
    every = list(answers)
    sizes: dict[str, dict[str, int]] = {}
    for answer in every:
        own = sizes.setdefault(answer.model, {})
        own[answer.group] = max(own.get(answer.group, 0), answer.n_targets)
    largest = {model: sorted(own, key=own.__getitem__, reverse=True) for model, own in sizes.items()}
    return [answer for answer in every if answer.group in largest[answer.model][:MOST_GROUPS]]
