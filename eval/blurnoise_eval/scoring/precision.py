"""COCO's average precision and recall, of all pictures and with each cluster of them left out.

Domain: boxes (left, top, right, bottom) px, areas px². Matching is COCO's; detections are matched once, and what a
cluster of pictures changes is read off the ranking, since pictures are matched one by one.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.detectors.records import Answers
from blurnoise_eval.scoring.boxes import xywh
from blurnoise_eval.scoring.estimates import all_and_without
from blurnoise_eval.scoring.matching import Targets, matched

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


class _Found(NamedTuple):
    """N detections of all pictures, by category, highest score first. right, ignored: (areas, IoUs, N)."""

    category: NDArray[np.int64]
    cluster: NDArray[np.int64]
    right: Flags
    ignored: Flags


def precision(
    answers: Answers,
    cluster: NDArray[np.int64],
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
    place_of = {category: place for place, category in enumerate(sorted(set(category_of.values())))}
    seen, first = np.unique(targets.category, return_index=True)
    for place in seen[np.argsort(first)].tolist():
        place_of.setdefault(targets.categories[place], len(place_of))
    places = np.full(max(category_of, default=0) + 2, -1)  # by a class's number; the last: none
    for number, category in category_of.items():
        places[number] = place_of[category]
    own = np.array([place_of.get(category, -1) for category in targets.categories], np.int64)
    of_target = own[targets.category] if len(own) else targets.category
    areas_px2, limits = (AREAS_PX2[:1], _LIMITS[:1]) if ap50_only else (AREAS_PX2, _LIMITS)
    counted = np.zeros((clusters, len(areas_px2), max(len(place_of), 1)))
    found = _matched(answers, cluster, places, targets, of_target, counted, (areas_px2, limits))
    hits = np.zeros((clusters, len(limits), counted.shape[2]))
    for place, here in enumerate(found.right[0] & ~found.ignored[0]):
        np.add.at(hits[:, place], (found.cluster[here], found.category[here]), 1)
    return _averages(counted, _ranked(found, counted), hits)


def _averages(targets: Array, of_each: Array, hits: Array) -> Precision:
    """Means over the categories that have targets; of_each: (1 + clusters, areas, IoUs, categories)."""
    left = all_and_without(targets)
    some = left > 0
    with np.errstate(invalid="ignore", divide="ignore"):
        number = some.sum(axis=-1)[:, :, None].astype(float)
        every = np.where(some[:, :, None], of_each, 0.0)
        mean = every.sum(axis=-1) / number
        weighted = (every * left[:, :, None]).sum(axis=-1) / left.sum(axis=-1)[:, :, None]
        recall = (
            np.where(some[:, 0, None], all_and_without(hits) / left[:, 0, None], 0.0).sum(axis=-1)
            / number[:, 0]
        )
    return Precision(mean, recall, weighted - BEYOND * (mean - weighted))


def _matched(
    answers: Answers,
    clusters: NDArray[np.int64],
    places: NDArray[np.int64],
    targets: Targets,
    of_target: NDArray[np.int64],
    counted: Array,
    asked: tuple[Array, Array],
) -> _Found:
    """Of all pictures; their targets, of the categories ``of_target``, are counted in ``counted``. asked: areas and
    IoUs."""
    areas_px2, limits = asked
    picture = answers.picture
    known = places[np.minimum(answers.class_ids, len(places) - 1)]
    order = np.lexsort((known, picture))  # of each category the highest scores first
    key = picture * (len(places) + counted.shape[2] + 1) + known + 1
    index = order[_rank(key[order]) < MOST_DETECTIONS]
    index = index[known[index] >= 0]
    category, picture = known[index], picture[index]
    boxes = answers.boxes_xyxy[index].astype(float)
    area = (boxes[:, 2:] - boxes[:, :2]).prod(axis=1)
    outside = (area < areas_px2[:, :1]) | (area > areas_px2[:, 1:])
    aside = targets.crowd | (targets.area_px2 < areas_px2[:, :1]) | (targets.area_px2 > areas_px2[:, 1:])
    for line, of_area in enumerate(aside):
        here = ~of_area
        np.add.at(counted[:, line], (clusters[targets.picture[here]], of_target[here]), 1)
    many = counted.shape[2]
    target_key = targets.picture * many + of_target
    right, beside = matched(picture * many + category, xywh(boxes), target_key, targets, aside, limits)
    ignored = np.where(right, beside, outside[:, None])
    score = answers.scores[index].astype(float)
    order = np.lexsort((-score, category))
    return _Found(category[order], clusters[picture[order]], right[..., order], ignored[..., order])


def _rank(ordered: NDArray[np.int64]) -> NDArray[np.int64]:
    """The place of each among its equals."""
    starts = np.flatnonzero(np.diff(ordered, prepend=-2))
    return np.arange(len(ordered)) - np.repeat(starts, np.diff(starts, append=len(ordered)))


def _ranked(found: _Found, targets: Array) -> Array:
    """Average precision of each category, (1 + clusters, areas, IoUs, categories); 0 where there is none.

    One ranking for each area, IoU and category: a row of all that is right, and one without each cluster.
    """
    clusters, _, categories = targets.shape
    areas, ious, count = found.right.shape
    right = (found.right & ~found.ignored).reshape(areas * ious, count)
    wrong = ~(found.right | found.ignored).reshape(areas * ious, count)
    left = all_and_without(targets)
    result = np.zeros((1 + clusters, areas * ious, categories))
    ends = np.searchsorted(found.category, np.arange(categories + 1)).tolist()
    for category, (start, stop) in enumerate(pairwise(ends)):
        cluster = found.cluster[start:stop]
        for area in range(areas):
            lines = range(area * ious, (area + 1) * ious)
            hits = [np.flatnonzero(right[line, start:stop]) for line in lines]
            table, begins = _reached(left[:, area, category], max(map(len, hits)) + 1)
            for line, hit in zip(lines, hits, strict=True):
                if len(hit):
                    miss = np.flatnonzero(wrong[line, start:stop])
                    result[:, line, category] = _average(cluster, hit, miss, clusters, table, begins)
    return result.reshape(1 + clusters, areas, ious, categories)


def _average(
    cluster: Places, hit: Places, miss: Places, clusters: int, table: Places, begins: Places
) -> Array:
    """Average precision of one ranking, of all and without each cluster, (1 + clusters,).

    cluster: of every detection, highest score first; hit, miss: places of the right ones, some, and of the wrong.
    table, begins: of :func:`_reached`. Along right ones without a wrong one between them precision grows, whichever
    cluster is left out: the last of each such run stands for all.
    """
    follows = np.searchsorted(hit, miss)  # the right one after each wrong one
    told = follows < len(hit)
    follows, miss = follows[told], miss[told]
    begun = np.zeros(len(hit), bool)
    begun[follows] = True
    begun[0] = False
    run = np.cumsum(begun)
    length = int(run[-1]) + 1
    right = _down_to(run, cluster[hit], clusters, length)
    share = _down_to(run[follows], cluster[miss], clusters, length)
    share += right
    best = right / np.maximum(share, 1, out=share)
    np.maximum.accumulate(best[:, ::-1], axis=1, out=best[:, ::-1])
    right += begins[:, None]
    steps = np.take(table, right, mode="clip")
    steps[:, 1:] -= steps[:, :-1].copy()
    return np.asarray(np.einsum("cr,cr->c", best, steps) / len(RECALLS))


def _down_to(run: Places, cluster: Places, clusters: int, length: int) -> Places:
    """How many stand down to the end of each run, of all and without each cluster, (1 + clusters, length)."""
    number = np.empty((1 + clusters, length), np.int32)
    own = np.bincount(cluster * length + run, minlength=clusters * length).reshape(clusters, length)
    number[0] = own.sum(axis=0)
    np.subtract(number[0], own, out=number[1:], casting="unsafe")
    return np.cumsum(number, axis=1, dtype=np.int32)


def _reached(targets: Array, most: int) -> tuple[Places, Places]:
    """How many of ``RECALLS`` each number of hits below ``most`` reaches, none of no hit, for each number of targets
    (n,); and where those of each begin in it, (n,)."""
    different, number = np.unique(targets, return_inverse=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        recall = np.nan_to_num(np.arange(most) / different[:, None])
    table = np.searchsorted(RECALLS, recall, side="right")
    table[:, 0] = 0
    return table.ravel().astype(np.int32), (number * most).astype(np.int32)
