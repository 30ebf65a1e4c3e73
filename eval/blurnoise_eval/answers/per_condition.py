"""What each model scores under each condition of a run: COCO's averages, false alarms, calibration, reading."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np

from blurnoise_eval.answers.clusters import cluster_of
from blurnoise_eval.answers.uncertainty import columns
from blurnoise_eval.scoring.boxes import MoveBoxes
from blurnoise_eval.scoring.estimates import MOST_CLUSTERS, Array, Estimate
from blurnoise_eval.scoring.judged import Judged, Truth
from blurnoise_eval.scoring.matching import FOUND_SCORE
from blurnoise_eval.scoring.scores import of_conditions
from blurnoise_eval.store import queries
from blurnoise_eval.store.schema import CONDITIONS
from blurnoise_eval.store.store import Store
from blurnoise_eval.store.target_columns import TargetColumns, target_columns

COUNTS = ("n_images", "n_targets", "errors")
PICTURES = ("applied_gain_db", "snr_db", "brightness", "saturated", "invented_share")
"""Means over the pictures of a condition; None of the untouched ones."""
MEANS = (
    "target_confidence", "detection_rate", "confidence_when_found", "target_confidence_swept",
    "detection_rate_swept", "read_confidence", "exact_match", "character_error_rate",
)  # fmt: skip

Moves = Callable[[Mapping[str, Any]], tuple[MoveBoxes | None, MoveBoxes | None]]
"""Where the conditions of a row have moved the truth's boxes, and what these sweep."""


class Scored(NamedTuple):
    """A row of scores, and the estimate that P, mPC and rPC are made of, its clusters those of every row; a score by
    the size of targets, if asked for, and how many of these there are."""

    row: dict[str, Any]
    performance: Estimate
    sizes: Mapping[str, Estimate]
    n_targets: Mapping[str, int]


def score_rows(
    store: Store,
    models: Sequence[str],
    truth_of: Callable[[str], Truth | None],
    progress: Callable[[int], None] = lambda rows: None,
    *,
    moves: Moves = lambda row: (None, None),
    cluster: str | None = None,
    by_size: str | None = None,
) -> Iterator[Scored]:
    """One row per model and condition, the untouched pictures first: three columns for each score of a condition.

    NAME, NAME_low and NAME_high: the value and its 95 % interval over clusters of pictures (all repeats of a
    picture are in one), None where it cannot be told. truth_of: a model's truth, None for a reader. cluster: a
    pattern on pictures' names, as of :func:`~blurnoise_eval.answers.clusters.cluster_of`. by_size: "ap" or "ap50" of
    the sizes, too. Where the camera has set the exposure, a row's is the mean over its pictures. Pictures that could
    not be read do not count; those on which the model failed count as answered by nothing.
    """
    clusters = numbered(queries.pictures_seen(store), cluster)
    for each in scored(store, asked(store, models, clusters), truth_of, moves, clusters, by_size):
        progress(1)
        yield each


class Asked(NamedTuple):
    """One condition of a model: its counts and means; these with the exposure that the camera has set, on average;
    and sums over clusters of what its targets have."""

    counted: dict[str, Any]
    as_set: dict[str, Any]
    sums: Mapping[str, tuple[Array, Array]]


def asked(store: Store, models: Sequence[str], clusters: Mapping[str, int]) -> Iterator[Asked]:
    """All conditions, model by model."""
    for model in models:
        every = _sums(target_columns(store, model), clusters)
        counted = queries.condition_counts(store, model)
        for row, as_set in zip(counted, queries.as_set(store, counted), strict=True):
            yield Asked(row, as_set, every.get(tuple(row[name] for name in CONDITIONS), {}))


def scored(
    store: Store,
    conditions: Iterable[Asked],
    truth_of: Callable[[str], Truth | None],
    moves: Moves,
    clusters: Mapping[str, int],
    by_size: str | None = None,
) -> Iterator[Scored]:
    """The row of each; arguments as of :func:`score_rows`."""
    for model, own in groupby(conditions, key=lambda each: str(each.counted["model"])):
        truth = truth_of(model)
        for row, as_set, sums in own:
            cells = () if truth is None else queries.answers_at(store, model, row)
            judged = Judged(sums, truth, cells, *((None, None) if row["clean"] else moves(as_set)), clusters)
            shared = {name: as_set[name] for name in ("model", *CONDITIONS, "blur_px", *COUNTS, *PICTURES)}
            scores: dict[str, float | None] = {}
            for score in of_conditions():
                scores |= columns(score.estimate(judged), score.name, score.most)
            of_run = judged.mean("exact_match") if truth is None else judged.coco["ap"]
            sizes = judged.precision_by_size(by_size) if by_size else {}
            yield Scored(shared | scores, of_run, sizes, judged.targets_by_size if by_size else {})


def numbered(pictures: Sequence[str], cluster: str | None) -> dict[str, int]:
    """The number of each picture's cluster; above ``MOST_CLUSTERS`` some share one."""
    numbers: dict[str, int] = {}
    return {
        name: numbers.setdefault(cluster_of(name, cluster), len(numbers)) % MOST_CLUSTERS for name in pictures
    }


def _sums(
    columns: TargetColumns, clusters: Mapping[str, int]
) -> dict[tuple[Any, ...], dict[str, tuple[Array, Array]]]:
    """Sums and numbers of what targets and readings have, per cluster, by condition and column."""
    size = 1 + max(clusters.values(), default=0)
    numbers = np.array([clusters[name] for name in columns.pictures], np.int64)
    # first of each picture, then of pictures, in their order
    picture = columns.condition.astype(np.int64) * max(len(columns.pictures), 1) + columns.picture
    first = np.flatnonzero(np.diff(picture, prepend=-1))
    of_picture = np.cumsum(np.diff(picture, prepend=-1) != 0) - 1
    place = columns.condition[first].astype(np.int64) * size + numbers[columns.picture[first]]
    shape = len(columns.conditions), size
    found: dict[str, tuple[Array, Array]] = {}
    for name, values in zip(MEANS, _values(columns), strict=True):
        known = ~np.isnan(values)
        per_picture = (
            np.bincount(of_picture, weights, len(first)) for weights in (np.where(known, values, 0.0), known)
        )
        sums, counts = (
            np.asarray(np.bincount(place, each, math.prod(shape)).reshape(shape), float)
            for each in per_picture
        )
        found[name] = sums, counts
    return {
        at: {name: (sums[number], counts[number]) for name, (sums, counts) in found.items()}
        for number, at in enumerate(columns.conditions)
    }


def _values(columns: TargetColumns) -> Iterator[Array]:
    """What ``MEANS`` are means of, NaN where there is none."""
    confidence, swept = columns.confidence, columns.confidence_swept
    found = confidence >= FOUND_SCORE
    yield confidence
    yield np.where(np.isnan(confidence), np.nan, found)
    yield np.where(found, confidence, np.nan)
    yield swept
    yield np.where(np.isnan(swept), np.nan, swept >= FOUND_SCORE)
    yield columns.read_confidence
    yield columns.exact
    yield columns.character_error_rate


def performance(row: Mapping[str, Any]) -> float | None:
    """The one number of a score row that P, mPC and rPC are made of: AP, or for a reader exact matches."""
    value = row["exact_match"] if row["ap"] is None else row["ap"]
    return None if value is None or math.isnan(value) else float(value)
