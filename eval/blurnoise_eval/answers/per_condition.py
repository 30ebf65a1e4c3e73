"""What each model scores under each condition of a run: COCO's averages, false alarms, calibration, reading."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np

from blurnoise_eval.answers.clusters import cluster_of
from blurnoise_eval.scoring.boxes import MoveBoxes
from blurnoise_eval.scoring.evaluated import NO_ANSWERS, NO_TRUTH, Evaluated, Truth
from blurnoise_eval.scoring.precision import SIZES
from blurnoise_eval.scoring.scores import of_conditions
from blurnoise_eval.scoring.uncertainty import MOST_CLUSTERS, Array, ClusterEstimate, with_interval
from blurnoise_eval.store import queries
from blurnoise_eval.store.columns import AxisValues
from blurnoise_eval.store.queries import TargetColumns, target_columns
from blurnoise_eval.store.rows import ScoreRow
from blurnoise_eval.store.store import Store

Moves = Callable[[AxisValues], tuple[MoveBoxes | None, MoveBoxes | None]]
"""Where conditions have moved the truth's boxes, and what these sweep."""
Sums = dict[str, tuple[Array, Array]]
"""Sums and numbers per cluster, by column."""


class Scored(NamedTuple):
    """A row of scores, and the estimate that P, mPC and rPC are made of, its clusters those of every row; a score by
    the size of targets, if asked for, and how many of these there are."""

    row: ScoreRow
    performance: ClusterEstimate
    sizes: Mapping[str, ClusterEstimate]
    n_targets: Mapping[str, int]

    def document(self) -> dict[str, Any]:
        """As JSON has it, which knows no NaN: a cluster that was not measured is null."""
        return {
            "row": self.row.stored(),
            "scores": [*self.row.scores],
            "performance": _estimate_document(self.performance),
            "sizes": {size: _estimate_document(estimate) for size, estimate in self.sizes.items()},
            "n_targets": self.n_targets,
        }

    @classmethod
    def of_document(cls, document: Mapping[str, Any]) -> Scored:
        """The inverse of :meth:`document`."""
        sizes = {size: _estimate_of(estimate) for size, estimate in document["sizes"].items()}
        row = ScoreRow.of_columns(document["row"], document["scores"])
        return cls(row, _estimate_of(document["performance"]), sizes, document["n_targets"])


def _estimate_document(of: ClusterEstimate) -> list[Any]:
    influence = None
    if of.influence is not None:
        influence = [None if math.isnan(away) else away for away in of.influence.tolist()]
    return [of.value, influence, None if of.cautious is None else _estimate_document(of.cautious)]


def _estimate_of(document: Sequence[Any]) -> ClusterEstimate:
    value, influence, cautious = document
    away = None if influence is None else np.array(influence, float)
    return ClusterEstimate(value, away, None if cautious is None else _estimate_of(cautious))


class Condition(NamedTuple):
    """One condition of a model: its row without scores, its values on the axes with the mean exposure where the
    camera sets it, and the scores of its targets."""

    row: ScoreRow
    as_set: AxisValues
    sums: Sums


def conditions_of(
    store: Store, models: Sequence[str], clusters: Mapping[str, int], *, original_only: bool = False
) -> Iterator[Condition]:
    """All conditions, model by model, the original pictures first."""
    for model in models:
        every = _sums(target_columns(store, model), clusters)
        counted = [
            row
            for row in queries.condition_counts(store, model)
            if row.conditions.original or not original_only
        ]
        as_set = queries.as_set(store, [row.conditions for row in counted])
        for row, conditions in zip(counted, as_set, strict=True):
            yield Condition(row, conditions, every.get(row.conditions, {}))


def scored(
    store: Store,
    conditions: Iterable[Condition],
    truth_of: Callable[[str], Truth | None],
    moves: Moves,
    clusters: Mapping[str, int],
    by_size: str | None = None,
) -> Iterator[Scored]:
    """A row of each condition: its columns, and three for each score.

    NAME, NAME_low and NAME_high: the value and its 95 % interval over clusters of pictures (all repeats of a picture
    are in one), None where it is unknown. truth_of: a model's truth, None for a reader. by_size: a score of the
    sizes, too. Pictures that could not be read do not count; those on which the model failed count as answered
    by nothing.
    """
    of_sizes = next((score.by_size for score in of_conditions() if score.name == by_size), None)
    for model, every in groupby(conditions, key=lambda each: each.row.model):
        truth = truth_of(model)
        for row, as_set, sums in every:
            boxes = (None, None) if as_set.original else moves(as_set)
            answers = NO_ANSWERS if truth is None else queries.answers_at(store, model, row.conditions)
            evaluated = Evaluated(sums, truth or NO_TRUTH, answers, *boxes, clusters)
            scores = {
                score.name: with_interval(score.estimate(evaluated), score.most) for score in of_conditions()
            }
            filled = replace(row, conditions=as_set, scores=scores)
            performance = evaluated.mean("exact_match") if truth is None else evaluated.average()
            sizes = {size: of_sizes(evaluated, size) for size in SIZES} if of_sizes else {}
            if any(estimate.value is not None and estimate.influence is None for estimate in sizes.values()):
                must = "must return the influence of each cluster, as uncertainty.left_out does"
                raise ValueError(f"score {by_size!r}: by_size {must}")
            yield Scored(filled, performance, sizes, evaluated.targets_by_size if of_sizes else {})


def numbered(pictures: Sequence[str], cluster: str | None) -> dict[str, int]:
    """The number of each picture's cluster; above ``MOST_CLUSTERS`` some share one."""
    numbers: dict[str, int] = {}
    return {
        name: numbers.setdefault(cluster_of(name, cluster), len(numbers)) % MOST_CLUSTERS for name in pictures
    }


def _sums(rows: TargetColumns, clusters: Mapping[str, int]) -> dict[AxisValues, Sums]:
    """Of scores of targets and readings, by condition."""
    shape = len(rows.conditions), 1 + max(clusters.values(), default=0)
    numbers = np.array([clusters[name] for name in rows.pictures], np.int64)
    # first of each picture, then of pictures, in their order
    # One number for condition and picture: rows of the same pair stand together, and a step tells where one begins.
    picture = rows.condition.astype(np.int64) * max(len(rows.pictures), 1) + rows.picture
    begins = np.diff(picture, prepend=-1) != 0
    first, of_picture = np.flatnonzero(begins), np.cumsum(begins) - 1
    bin_of = rows.condition[first].astype(np.int64) * shape[1] + numbers[rows.picture[first]]

    def per_cluster(weights: Array) -> Array:
        per_picture = np.bincount(of_picture, weights, len(first))
        return np.asarray(np.bincount(bin_of, per_picture, math.prod(shape)).reshape(shape), float)

    by_score = {}
    for score in of_conditions():
        if score.of_targets is not None:
            values = score.of_targets(rows)
            known = ~np.isnan(values)
            by_score[score.name] = per_cluster(np.where(known, values, 0.0)), per_cluster(known)
    return {
        at: {name: (sums[number], counts[number]) for name, (sums, counts) in by_score.items()}
        for number, at in enumerate(rows.conditions)
    }
