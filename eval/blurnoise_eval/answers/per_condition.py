"""What each model scores under each condition of a run: COCO's averages, false alarms, calibration, reading."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np

from blurnoise_eval.answers.clusters import cluster_of
from blurnoise_eval.scoring.boxes import MoveBoxes
from blurnoise_eval.scoring.evaluated import NO_ANSWERS, NO_TRUTH, Evaluated, Truth
from blurnoise_eval.scoring.precision import SIZES
from blurnoise_eval.scoring.scores import of_conditions
from blurnoise_eval.scoring.uncertainty import MOST_CLUSTERS, Array, Estimate, columns
from blurnoise_eval.store import queries
from blurnoise_eval.store.queries import TargetColumns, target_columns
from blurnoise_eval.store.schema import CONDITIONS
from blurnoise_eval.store.store import Store

COUNTS = ("n_pictures", "n_targets", "errors")
PICTURES = ("applied_gain_db", "snr_db", "brightness", "saturated_share", "inpainted_share")
"""Means over the pictures of a condition; None of the original ones."""
OF_LAMPS = ("missed_pulse_share",)
"""Another, of runs with a pulsed lamp: how many pictures miss it."""

Moves = Callable[[Mapping[str, Any]], tuple[MoveBoxes | None, MoveBoxes | None]]
"""Where the conditions of a row have moved the truth's boxes, and what these sweep."""
Sums = dict[str, tuple[Array, Array]]
"""Sums and numbers per cluster, by column."""


class Scored(NamedTuple):
    """A row of scores, and the estimate that P, mPC and rPC are made of, its clusters those of every row; a score by
    the size of targets, if asked for, and how many of these there are."""

    row: dict[str, Any]
    performance: Estimate
    sizes: Mapping[str, Estimate]
    n_targets: Mapping[str, int]


class Condition(NamedTuple):
    """One condition of a model: its counts and means; these with the exposure that the camera has set, on average;
    and its targets' scores."""

    counted: dict[str, Any]
    as_set: dict[str, Any]
    sums: Sums


def conditions_of(
    store: Store, models: Sequence[str], clusters: Mapping[str, int], *, original_only: bool = False
) -> Iterator[Condition]:
    """All conditions, model by model, the original pictures first."""
    for model in models:
        every = _sums(target_columns(store, model), clusters)
        counted = [row for row in queries.condition_counts(store, model) if row["clean"] or not original_only]
        for row, as_set in zip(counted, queries.as_set(store, counted), strict=True):
            yield Condition(row, as_set, every.get(tuple(row[name] for name in CONDITIONS), {}))


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
    for model, every in groupby(conditions, key=lambda each: str(each.counted["model"])):
        truth = truth_of(model)
        for row, as_set, sums in every:
            boxes = (None, None) if row["clean"] else moves(as_set)
            answers = NO_ANSWERS if truth is None else queries.answers_at(store, model, row)
            evaluated = Evaluated(sums, truth or NO_TRUTH, answers, *boxes, clusters)
            found = {name: as_set[name] for name in ("model", *CONDITIONS, "blur_px", *COUNTS, *PICTURES)}
            found |= {name: as_set[name] for name in OF_LAMPS if name in as_set}
            for score in of_conditions():
                found |= columns(score.estimate(evaluated), score.name, score.most)
            performance = evaluated.mean("exact_match") if truth is None else evaluated.average()
            sizes = {size: of_sizes(evaluated, size) for size in SIZES} if of_sizes else {}
            yield Scored(found, performance, sizes, evaluated.targets_by_size if of_sizes else {})


def numbered(pictures: Sequence[str], cluster: str | None) -> dict[str, int]:
    """The number of each picture's cluster; above ``MOST_CLUSTERS`` some share one."""
    numbers: dict[str, int] = {}
    return {
        name: numbers.setdefault(cluster_of(name, cluster), len(numbers)) % MOST_CLUSTERS for name in pictures
    }


def _sums(rows: TargetColumns, clusters: Mapping[str, int]) -> dict[tuple[Any, ...], Sums]:
    """Of scores of targets and readings, by condition."""
    shape = len(rows.conditions), 1 + max(clusters.values(), default=0)
    numbers = np.array([clusters[name] for name in rows.pictures], np.int64)
    # first of each picture, then of pictures, in their order
    picture = rows.condition.astype(np.int64) * max(len(rows.pictures), 1) + rows.picture
    begins = np.diff(picture, prepend=-1) != 0
    first, of_picture = np.flatnonzero(begins), np.cumsum(begins) - 1
    place = rows.condition[first].astype(np.int64) * shape[1] + numbers[rows.picture[first]]

    def per_cluster(weights: Array) -> Array:
        per_picture = np.bincount(of_picture, weights, len(first))
        return np.asarray(np.bincount(place, per_picture, math.prod(shape)).reshape(shape), float)

    found = {}
    for score in of_conditions():
        if score.of_targets is not None:
            values = score.of_targets(rows)
            known = ~np.isnan(values)
            found[score.name] = per_cluster(np.where(known, values, 0.0)), per_cluster(known)
    return {
        at: {name: (sums[number], counts[number]) for name, (sums, counts) in found.items()}
        for number, at in enumerate(rows.conditions)
    }
