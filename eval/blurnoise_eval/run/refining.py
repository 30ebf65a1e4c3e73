"""Refining a sweep: further exposures where a window ends between two tested ones, and about the best for all.

The interval of a window's end is as wide as the gap between the tested exposures about it. Halving the gap about an
end to a quarter of a stop, and those in which its interval ends to half a stop, costs a few conditions of that light
and speed. The next conditions follow from the run's store, and are noted there before they are computed: a run that
was stopped goes on with the same ones.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from blurnoise_eval.answers.criterion import Criterion
from blurnoise_eval.answers.curves import Row
from blurnoise_eval.answers.exposure_window import answers
from blurnoise_eval.answers.recommendation import MOST_COMMON
from blurnoise_eval.plan.axes import AUTOMATIC, EXPOSURE
from blurnoise_eval.plan.conditions import Conditions
from blurnoise_eval.plan.plan import SweepPlan
from blurnoise_eval.run.computing import Outcome
from blurnoise_eval.run.run import Batch, ask, asked
from blurnoise_eval.run.score_tables import run_averages, score_tables, withheld_models
from blurnoise_eval.store.store import Store
from blurnoise_eval.system.progress import ProgressBar
from blurnoise_eval.system.terminal import say

STOPS, STOPS_OF_INTERVAL = 0.25, 0.5
"""The gap about a window's end, and those in which its interval ends, are halved until none is wider."""
MOST_GROUPS = 4
"""Of each model's target groups the windows of so many are refined, those with the most targets."""
_ROUNDED = 0.02  # stops: refined exposures are rounded to three digits


def refined(
    store: Store,
    plan: SweepPlan,
    criterion: Criterion,
    n_pictures: int,
    compute: Callable[[SweepPlan, ProgressBar], Outcome],
    outcome: Outcome,
    progress: bool | None,
) -> None:
    """Compute more exposures where windows end between two tested ones, those that the store has noted first."""

    def noted() -> tuple[Conditions, ...]:
        return tuple(at for batch in asked(store) for at in batch.conditions)

    def next_ones() -> tuple[Conditions, ...]:
        left = _left_to_refine(store, plan, criterion)
        if more := tuple(at for at in left if at not in noted()):
            ask(store, Batch(n_pictures, (), more))
        return more

    before, cells = noted(), n_pictures * plan.repeats
    more = before or next_ones()
    if not more:
        return
    if progress and not before:
        grid = f"beside the {cells * len(plan.conditions())} of the grid"
        say(f"refine: {cells * len(more)} cells or more {grid} (refine: false in a plan: none)", error=True)
    with ProgressBar("refine", cells * len(more), progress) as advance:
        while more:
            outcome.add(compute(replace(plan, only=more, examples=False), advance))
            more = next_ones()


def _left_to_refine(store: Store, plan: SweepPlan, criterion: Criterion) -> tuple[Conditions, ...]:
    """The conditions that are computed next, by all that the store holds; none where the camera sets the exposure."""
    tested = plan.values(EXPOSURE.name)
    if AUTOMATIC in tested:
        return ()
    monotone = store.about("manifest").get("trajectory") is None
    unfit = withheld_models(store, criterion.cluster)
    tables = [
        table
        for table in score_tables(store, criterion)
        if table.model not in unfit and not table.knows_too_little
    ]
    names = [name for name in plan.grid if name != EXPOSURE.name]
    wanted: list[tuple[tuple[float, ...], float]] = []
    for answer in _largest(each for table in tables for each in answers(table, criterion, monotone=monotone)):
        at = tuple(answer[name] for name in names)
        wanted += [(at, float(f"{math.sqrt(low * high):.3g}")) for low, high in _wide_gaps(answer)]
    models = run_averages(store, tables, criterion.level)
    every = list(product(*(plan.grid[name] for name in names)))
    for each in models:  # the exposures that promise to keep more on average, under all conditions
        measured = np.isfinite(each.value).all(axis=0).sum()
        if measured < len(tested) + MOST_COMMON * len(models) and (more := each.next_exposure()) is not None:
            wanted += [(at, more) for at in every]
    conditions = [Conditions(**dict(zip(names, at, strict=True)), exposure_s=more) for at, more in wanted]
    return tuple(dict.fromkeys(conditions))


def _wide_gaps(answer: Row) -> list[tuple[float, float]]:
    """The wide gaps between tested exposures in which a window ends, or an interval of its end. Where nothing is sure
    to work no gap matters."""
    x = answer["exposures_s"]
    bounds = zip(answer["windows_s"], answer["windows_low_s"], answer["windows_high_s"], strict=True)
    widest: dict[tuple[float, float], float] = {}
    for window, *intervals in bounds if answer["verdict"] == "works" else ():
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


def _largest(answers: Iterable[Row]) -> list[Row]:
    """The answers of each model's largest groups."""
    every = list(answers)
    sizes: dict[str, dict[str, int]] = {}
    for answer in every:
        own = sizes.setdefault(answer["model"], {})
        own[answer["group"]] = max(own.get(answer["group"], 0), answer["n_targets"])
    largest = {model: sorted(own, key=own.__getitem__, reverse=True) for model, own in sizes.items()}
    return [answer for answer in every if answer["group"] in largest[answer["model"]][:MOST_GROUPS]]


def exposures_of_grid(plan: dict[str, object]) -> Sequence[float]:
    """The exposures of a plan's grid, as :meth:`SweepPlan.to_dict` has it; none where there is no grid, or the camera
    sets them."""
    grid = plan.get("grid")
    exposures = grid.get(EXPOSURE.name, ()) if isinstance(grid, dict) else ()
    return () if AUTOMATIC in exposures else tuple(exposures)
