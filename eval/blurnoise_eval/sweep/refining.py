"""Refining a sweep: further exposures where a window ends between two tested ones, and about the best for all.

Between two tested exposures nobody has seen the score, so that the interval of a window's end is as wide as they
are. Halving the gap about an end to a quarter of a stop, and those in which its interval ends to half a stop, costs
a few conditions of that light and speed; a grid as fine everywhere would cost several times the sweep. What is
computed next follows from what the run's store holds, and is noted there before it is computed: a run that was
stopped goes on with the same conditions.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from blurnoise_eval.answers.criterion import Criterion
from blurnoise_eval.answers.curves import Row
from blurnoise_eval.answers.exposure_window import answers
from blurnoise_eval.answers.recommendation import MOST_COMMON, Averages
from blurnoise_eval.grid.axes import AUTOMATIC, EXPOSURE
from blurnoise_eval.grid.conditions import Conditions, SweepPlan
from blurnoise_eval.store.store import Store
from blurnoise_eval.sweep.run_scores import withheld_models
from blurnoise_eval.sweep.score_tables import run_averages, score_tables

STOPS, STOPS_OF_INTERVAL = 0.25, 0.5
"""The gap about a window's end, and those in which its interval ends, are halved until none is wider."""
MOST_GROUPS = 4
"""Of each model's target groups the windows of so many are refined, those with the most targets."""
_ROUNDED = 0.02  # stops: refined exposures are rounded to three digits


@dataclass(frozen=True)
class Refinement:
    """What is computed next: ``conditions``; ``ends``, how many ends of windows ask for them; ``at_most``, how many
    conditions it may take until no gap is wider than a quarter of a stop; ``rounds``, how often gaps are halved;
    ``common``, whether the exposure for all conditions is refined."""

    conditions: tuple[Conditions, ...]
    ends: int
    at_most: int
    rounds: int
    common: bool = False

    @property
    def about(self) -> str:
        """Where in words: 'about 3 ends of windows and the exposure to use'."""
        ends = [f"{self.ends} end{'' if self.ends == 1 else 's'} of windows"] if self.ends else []
        return f"about {' and '.join([*ends, *(['the exposure to use'] if self.common else [])])}"


def left_to_refine(store: Store, plan: SweepPlan, criterion: Criterion, cluster: str | None) -> Refinement:
    """What a run of this plan leaves to refine, by all that its store holds."""
    manifest = store.about("manifest")
    monotone = manifest.get("trajectory") is None
    unfit = withheld_models(store, cluster)
    told = [
        table
        for table in score_tables(store, criterion, cluster)
        if table.model not in unfit and not table.knows_too_little
    ]
    left = refinement(plan, [each for one in told for each in answers(one, criterion, monotone=monotone)])
    return _with_common(left, plan, run_averages(store, told, criterion.level))


def _with_common(left: Refinement, plan: SweepPlan, models: Iterable[Averages]) -> Refinement:
    """With the exposures that promise to keep more on average, under all conditions of the plan."""
    if AUTOMATIC in plan.values(EXPOSURE.name):
        return left
    names = [name for name in plan.grid if name != EXPOSURE.name]
    every = [dict(zip(names, at, strict=True)) for at in product(*(plan.grid[name] for name in names))]
    conditions, at_most = dict.fromkeys(left.conditions), left.at_most
    every_model = list(models)
    most = len(plan.values(EXPOSURE.name)) + MOST_COMMON * len(every_model)
    for of in every_model:
        tested = np.isfinite(of.value).all(axis=0).sum()
        wanted = of.next_exposure() if tested < most else None
        if wanted is not None:
            conditions |= dict.fromkeys(Conditions(**at, exposure_s=wanted) for at in every)
            at_most += MOST_COMMON * len(every)
    rounds = max(left.rounds, MOST_COMMON if at_most > left.at_most else 0)
    return Refinement(tuple(conditions), left.ends, at_most, rounds, at_most > left.at_most)


def refinement(plan: SweepPlan, answers: Iterable[Row]) -> Refinement:
    """What the answers of a run with this plan leave to refine; no conditions where every end is known as well as it
    is asked, or the camera sets the exposure."""
    gaps: dict[tuple[tuple[tuple[str, float], ...], float, float], int] = {}
    ends = 0
    for answer in _largest(answers) if AUTOMATIC not in plan.values(EXPOSURE.name) else ():
        at = tuple((name, answer[name]) for name in plan.grid if name != EXPOSURE.name)
        for found in gaps_of(answer):
            ends += bool(found)
            for gap, count in found.items():
                gaps[(at, *gap)] = max(count, gaps.get((at, *gap), 0))
    halvings = list(gaps.values())
    conditions = {
        Conditions(**dict(at), exposure_s=float(f"{math.sqrt(low * high):.3g}")): None
        for at, low, high in gaps
    }
    return Refinement(tuple(conditions), ends, sum(halvings), max(halvings, default=0))


def gaps_of(answer: Row) -> Iterator[dict[tuple[float, float], int]]:
    """Of each end of the windows inside the tested range the wide gaps between tested exposures about it, the one
    that it lies in and those in which its interval ends, and how often each is to be halved. Where nothing is sure to
    work no gap matters."""
    x = answer["exposures_s"]
    bounds = zip(answer["windows_s"], answer["windows_low_s"], answer["windows_high_s"], strict=True)
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
            halvings = {gap: _halvings(*gap, stops) for gap, stops in gaps.items()}
            yield {gap: count for gap, count in halvings.items() if count}


def _halvings(low: float, high: float, stops: float) -> int:
    """How often a gap is halved until no part of it is wider."""
    return max(0, math.ceil(math.log2(math.log2(high / low) / (stops + _ROUNDED))))


def _largest(answers: Iterable[Row]) -> list[Row]:
    """The answers of each model's largest groups."""
    every = list(answers)
    sizes: dict[tuple[str, str], int] = {}
    for answer in every:
        key = answer["model"], answer["group"]
        sizes[key] = max(sizes.get(key, 0), answer["n_targets"])

    def among(key: tuple[str, str]) -> bool:
        larger = sorted((other for other in sizes if other[0] == key[0]), key=lambda other: -sizes[other])
        return key in larger[:MOST_GROUPS]

    return [answer for answer in every if among((answer["model"], answer["group"]))]


def exposures_of_grid(plan: dict[str, object]) -> Sequence[float]:
    """The exposures of a plan's grid, as :meth:`SweepPlan.to_dict` has it; none where there is no grid, or the camera
    sets them."""
    grid = plan.get("grid")
    exposures = grid.get(EXPOSURE.name, ()) if isinstance(grid, dict) else ()
    return () if AUTOMATIC in exposures else tuple(exposures)
