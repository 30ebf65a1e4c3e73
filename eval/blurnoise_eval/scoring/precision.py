"""COCO's average precision and recall, of all pictures and with each cluster of them left out.

Domain: boxes (left, top, right, bottom) px, areas px². Matching is COCO's; detections are matched once, and what a
cluster of pictures changes is read off the ranking, since pictures are matched one by one.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.detectors.records import Answers
from blurnoise_eval.scoring.boxes import xywh
from blurnoise_eval.scoring.matching import Targets, matched, rank
from blurnoise_eval.scoring.uncertainty import all_and_without

MOST_DETECTIONS = 100
"""Of one class and picture, highest scores first, that count for average precision: COCO's rule."""
RECALLS = np.linspace(0.0, 1.0, 101)  # at which COCO reads the precision
IOUS = np.linspace(0.5, 0.95, 10)
_LIMITS = np.minimum(IOUS, 1 - 1e-10)
SIZES = ("all", "small", "medium", "large")
"""Of targets, by COCO."""
AREAS_PX2 = np.array([(0, 1e10), (0, 32**2), (32**2, 96**2), (96**2, 1e10)], float)
"""Of each of ``SIZES``: from, to."""
BEYOND = 0.5
"""COCO's mean is over the categories that the pictures have, all alike, and one with few targets scores better there
than in many pictures: the false alarms of categories that are absent do not count. The mean weighted by the number of
targets has less of this; the cautious one is as far below it again, times ``BEYOND``. With 0.5 intervals that reach
down to its own hold in 89 to 100 % where COCO's alone did in 53 to 97 (12 to 35 pictures, 1 to 80 categories)."""
Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Places = NDArray[Any]
"""Whole numbers."""


class Precision(NamedTuple):
    """Average precision (1 + clusters, areas, IoUs) and recall (1 + clusters, IoUs), means over categories.

    First of all pictures, then without each cluster; areas: all, small, medium, large. NaN where there is no
    target of that size. cautious: as precision, of categories as they would score with many targets, see
    :data:`BEYOND`.
    """

    precision: Array
    recall: Array
    cautious: Array


def precision(
    answers: Answers,
    cluster: Places,
    targets: Targets,
    category_of: Mapping[int, int],
    clusters: int,
    *,
    ap50_only: bool = False,
) -> Precision:
    """Average precision and recall over categories of P pictures; ap50_only: of all sizes at the first IoU alone.

    cluster: (P,) the number of each picture's, of ``clusters``. targets: where they stand. category_of: a category's
    id by a class's number.
    """
    areas_px2, limits = (AREAS_PX2[:1], _LIMITS[:1]) if ap50_only else (AREAS_PX2, _LIMITS)
    every, categories = targets.category_of_class(category_of, answers.class_ids)
    index = np.flatnonzero(every >= 0)
    key = (answers.picture * categories + every)[index]
    by_key = np.argsort(key, kind="stable")  # of each category the highest scores first
    by_key = by_key[rank(key[by_key]) < MOST_DETECTIONS]
    index, key = index[by_key], key[by_key]
    boxes = xywh(answers.boxes_xyxy[index])
    aside = targets.crowd | _outside(targets.area_px2, areas_px2)
    target_key = targets.picture * categories + targets.category
    matches, beside = matched(key, boxes, target_key, targets, aside, limits)
    outside = _outside(boxes[:, 2] * boxes[:, 3], areas_px2)[:, None]
    right, wrong = matches & ~beside, ~(matches | outside)

    counted = np.zeros((clusters, len(areas_px2), categories))
    for area, ignored in enumerate(aside):
        np.add.at(counted[:, area], (cluster[targets.picture[~ignored]], targets.category[~ignored]), 1)
    # A cluster that is left out takes its targets along, so that recall has another denominator.
    number = all_and_without(counted)
    averages = np.zeros((len(number), *right.shape[:2], categories))
    hits = np.zeros((clusters, right.shape[1], categories))
    whose = cluster[answers.picture[index]]
    # Over all pictures together, unlike the matching, which goes picture by picture.
    by_score = np.lexsort((-answers.scores[index].astype(float), every[index]))
    for category in range(categories):
        of_category = by_score[every[index][by_score] == category]
        for area in range(len(right)):
            recalls = _reached(number[:, area, category])
            for iou in range(right.shape[1]):
                line = right[area, iou, of_category], wrong[area, iou, of_category]
                averages[:, area, iou, category] = _average(*line, whose[of_category], *recalls)
    for iou in range(right.shape[1]):
        np.add.at(hits[:, iou], (whose[right[0, iou]], every[index][right[0, iou]]), 1)
    return _over_categories(number, averages, all_and_without(hits))


def _outside(area_px2: Array, areas_px2: Array) -> Flags:
    """Whether areas (N,) lie outside each of the ranges (areas, 2), (areas, N)."""
    return np.asarray((area_px2 < areas_px2[:, :1]) | (area_px2 > areas_px2[:, 1:]))


def _over_categories(targets: Array, averages: Array, hits: Array) -> Precision:
    """Means over the categories that have targets. targets: (1 + clusters, areas, categories); found: average
    precision (1 + clusters, areas, IoUs, categories); hits: of all areas, (1 + clusters, IoUs, categories)."""
    some = targets > 0
    with np.errstate(invalid="ignore", divide="ignore"):
        number = some.sum(axis=-1)[:, :, None].astype(float)
        mean = averages.sum(axis=-1) / number
        weighted = (averages * targets[:, :, None]).sum(axis=-1) / targets.sum(axis=-1)[:, :, None]
        recall = np.where(some[:, :1], hits / targets[:, :1], 0.0).sum(axis=-1) / number[:, 0]
    return Precision(mean, recall, weighted - BEYOND * (mean - weighted))


def _reached(targets: Array) -> tuple[Places, Places]:
    """How many of ``RECALLS`` are reached by 0, 1, ... right ones, none by none, of each different number of targets,
    as one row; and where that of each of ``targets`` (n,) begins in it, (n, 1)."""
    different, number = np.unique(np.maximum(targets, 1), return_inverse=True)
    right = np.arange(1 + int(different[-1]))
    table = np.searchsorted(RECALLS, right / different[:, None], side="right")
    table[:, 0] = 0
    return table.ravel().astype(np.int32), (number * len(right)).astype(np.int32)[:, None]


def _average(right: Flags, wrong: Flags, cluster: Places, reached: Places, begins: Places) -> Array:
    """Average precision of one category, of all and without each cluster, (1 + clusters,).

    right, wrong, cluster: of each detection, highest score first. reached, begins: of :func:`_reached`. Precision is
    read at the last right one before each wrong one: it grows down to there, whichever cluster is left out.
    """
    hit = np.flatnonzero(right)
    if not len(hit):
        return np.zeros(len(begins))
    miss = np.flatnonzero(wrong[: hit[-1]])
    next_hit = np.searchsorted(hit, miss)
    is_first = np.zeros(len(hit), bool)  # of right ones without a wrong one between
    is_first[next_hit] = True
    run = np.cumsum(is_first)
    shape = len(begins) - 1, int(run[-1]) + 1
    hits = _down_to(run, cluster[hit], shape)
    best = hits / np.maximum(hits + _down_to(run[next_hit], cluster[miss], shape), 1)
    # Precision at a recall is the best at that recall or a higher one, as COCO interpolates.
    np.maximum.accumulate(best[:, ::-1], axis=1, out=best[:, ::-1])
    steps = np.take(reached, hits + begins)
    steps[:, 1:] -= steps[:, :-1].copy()
    return np.asarray(np.einsum("cr,cr->c", best, steps) / len(RECALLS))


def _down_to(run: Places, cluster: Places, shape: tuple[int, int]) -> Places:
    """How many stand down to the end of each run, of all and without each cluster; shape: clusters, runs."""
    each = np.bincount(cluster * shape[1] + run, minlength=shape[0] * shape[1])
    return all_and_without(each.reshape(shape).cumsum(axis=1, dtype=np.int32))
