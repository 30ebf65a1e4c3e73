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
from blurnoise_eval.scoring.estimates import all_and_without
from blurnoise_eval.scoring.matching import MOST_DETECTIONS, RECALLS, overlaps
from blurnoise_eval.scoring.pairs import Targets, first_of, paired_overlaps, pairs, with_a_choice, xywh

IOUS = np.linspace(0.5, 0.95, 10)
_LIMITS = np.minimum(IOUS, 1 - 1e-10)
SIZES = ("all", "small", "medium", "large")
"""Of targets, by COCO."""
AREAS_PX2 = np.array([(0, 1e10), (0, 32**2), (32**2, 96**2), (96**2, 1e10)], float)
"""Of each of ``SIZES``: from, to."""
Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Places = NDArray[Any]
"""Whole numbers."""


class Precision(NamedTuple):
    """Average precision (1 + clusters, areas, IoUs) and recall (1 + clusters, IoUs), means over categories.

    First of all pictures, then without each cluster; areas: all, small, medium, large. NaN where there is no
    target of that size.
    """

    precision: Array
    recall: Array


class _Found(NamedTuple):
    """N detections of all pictures. right, ignored: (areas, IoUs, N)."""

    score: Array
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
    counted = np.zeros((clusters, len(AREAS_PX2), max(len(place_of), 1)))
    found = _matched(answers, cluster, places, targets, of_target, counted)
    order = np.lexsort((-found.score, found.category))
    parts: list[Any] = [part[..., order] for part in found]
    found = _Found(*parts)
    if ap50_only:
        counted = counted[:, :1]
        found = found._replace(right=found.right[:1, :1], ignored=found.ignored[:1, :1])
    hits = np.zeros((clusters, found.right.shape[1], counted.shape[2]))
    for place in range(hits.shape[1]):
        here = found.right[0, place] & ~found.ignored[0, place]
        np.add.at(hits[:, place], (found.cluster[here], found.category[here]), 1)
    return _averages(counted, _ranked(found, counted), hits)


def _averages(targets: Array, of_each: Array, hits: Array) -> Precision:
    """Means over the categories that have targets; of_each: (1 + clusters, areas, IoUs, categories)."""
    left = all_and_without(targets)
    some = left > 0
    with np.errstate(invalid="ignore", divide="ignore"):
        number = some.sum(axis=-1)[:, :, None].astype(float)
        mean = np.where(some[:, :, None], of_each, 0.0).sum(axis=-1) / number
        recall = (
            np.where(some[:, 0, None], all_and_without(hits) / left[:, 0, None], 0.0).sum(axis=-1)
            / number[:, 0]
        )
    return Precision(mean, recall)


def _matched(
    answers: Answers,
    clusters: NDArray[np.int64],
    places: NDArray[np.int64],
    targets: Targets,
    of_target: NDArray[np.int64],
    counted: Array,
) -> _Found:
    """Of all pictures; their targets, of the categories ``of_target``, are counted in ``counted``."""
    picture = answers.picture
    known = places[np.minimum(answers.class_ids, len(places) - 1)]
    order = np.lexsort((known, picture))  # of each category the highest scores first
    key = picture * (len(places) + counted.shape[2] + 1) + known + 1
    index = order[_rank(key[order]) < MOST_DETECTIONS]
    index = index[known[index] >= 0]
    category, picture = known[index], picture[index]
    boxes = answers.boxes_xyxy[index].astype(float)
    area = (boxes[:, 2:] - boxes[:, :2]).prod(axis=1)
    outside = (area < AREAS_PX2[:, :1]) | (area > AREAS_PX2[:, 1:])
    right = np.zeros((len(AREAS_PX2), len(IOUS), len(index)), bool)
    ignored = np.repeat(outside[:, None], len(IOUS), axis=1)
    sizes = targets.area_px2
    aside = targets.crowd | (sizes < AREAS_PX2[:, :1]) | (sizes > AREAS_PX2[:, 1:])
    for line, of_area in enumerate(aside):
        here = ~of_area
        np.add.at(counted[:, line], (clusters[targets.picture[here]], of_target[here]), 1)
    many = counted.shape[2]
    target_key = targets.picture * many + of_target
    detection, target = pairs(picture * many + category, target_key)
    sides = xywh(boxes)
    shared = paired_overlaps(sides[detection], targets.boxes_xywh[target], targets.crowd[target])
    near = shared >= _LIMITS[0]
    detection, target, shared = detection[near], target[near], shared[near]
    choice = with_a_choice(target_key[target], detection)
    alone = ~choice
    enough = shared[alone, None] >= _LIMITS
    own = enough & (targets.crowd[target[alone], None] | first_of(target[alone], enough))
    _note(right, ignored, detection[alone], own.T, own.T & aside[:, None, target[alone]])
    for number in np.unique(target_key[target[choice]]).tolist():
        rivals = np.flatnonzero(target_key == number)
        rows = np.unique(detection[target_key[target] == number])
        table = overlaps(boxes[rows], targets.boxes_xywh[rivals], targets.crowd[rivals])
        taken, beside = _pairs(table, targets.crowd[rivals], aside[:, rivals])
        _note(right, ignored, rows, taken, beside)
    return _Found(
        answers.scores[index].astype(float), category, clusters[picture].astype(np.int64), right, ignored
    )


def _note(right: Flags, ignored: Flags, places: NDArray[np.int64], taken: Flags, beside: Flags) -> None:
    """Which detections, at these places, answer for a target, and for one set aside, (areas, IoUs, n)."""
    right[:, :, places] = taken
    ignored[:, :, places] = np.where(taken, beside, ignored[:, :, places])


def _rank(ordered: NDArray[np.int64]) -> NDArray[np.int64]:
    """The place of each among its equals."""
    starts = np.flatnonzero(np.diff(ordered, prepend=-2))
    return np.arange(len(ordered)) - np.repeat(starts, np.diff(starts, append=len(ordered)))


def _pairs(shared: Array, crowd: Flags, aside: Flags) -> tuple[Flags, Flags]:
    """Which detections answer for a target, and for one set aside, both (areas, IoUs, detections).

    shared: overlaps (detections, targets), highest score first. aside: (areas, targets).
    """
    taken = np.zeros((len(aside), len(_LIMITS), len(shared)), bool)
    beside = np.zeros_like(taken)
    for area, of_area in enumerate(aside):
        order = np.argsort(of_area, kind="stable")
        table = shared[:, order].tolist()
        set_aside, many = of_area[order].tolist(), crowd[order].tolist()
        for place, limit in enumerate(_LIMITS.tolist()):
            free = [True] * len(order)
            for index, row in enumerate(table):
                best, chosen = limit, -1
                for target, value in enumerate(row):
                    if not free[target] and not many[target]:
                        continue
                    if chosen >= 0 and not set_aside[chosen] and set_aside[target]:
                        break  # one that counts goes before those set aside
                    if value >= best:
                        best, chosen = value, target
                if chosen >= 0:
                    free[chosen] = False
                    taken[area, place, index] = True
                    beside[area, place, index] = set_aside[chosen]
    return taken, beside


def _ranked(found: _Found, targets: Array) -> Array:
    """Average precision of each category, (1 + clusters, areas, IoUs, categories); 0 where there is none.

    One ranking for each area, IoU and category, a segment of all that are right; then without each cluster in turn,
    what it counts taken off.
    """
    clusters, _, categories = targets.shape
    areas, ious, count = found.right.shape
    right = (found.right & ~found.ignored).reshape(areas * ious, count)
    wrong = ~(found.right | found.ignored).reshape(areas * ious, count)
    left = np.repeat(all_and_without(targets), ious, axis=1).reshape(1 + clusters, -1)
    result = np.zeros(left.shape)
    line, hit = np.nonzero(right)
    if len(hit):
        ranking = _Ranking.of(found, categories, line, hit, right, wrong)
        table, places = _reached(left, int(ranking.hits.max()) + 1)
        own_hits, own_misses = (
            _by_cluster(clusters, cluster, place)
            for cluster, place in (
                (found.cluster[hit], np.arange(len(hit))),
                (ranking.miss_cluster, ranking.miss_place),
            )
        )
        nothing = np.zeros(0, np.int64)
        for row in range(1 + clusters):
            away = (own_hits[row - 1], own_misses[row - 1]) if row else (nothing, nothing)
            result[row, ranking.segments] = ranking.averages(*away, table, places[row, ranking.segments])
    return result.reshape(1 + clusters, areas, ious, categories)


class _Ranking(NamedTuple):
    """H right detections, segment after segment.

    starts, lengths, segments: (S,) of these; number: (H,) which one; hits, shown: (H,) right, and all that count, of
    the segment down to each. miss_place: the right one that follows each wrong one.
    """

    starts: Places
    lengths: Places
    segments: Places
    number: Places
    hits: Places
    shown: Places
    miss_place: Places
    miss_cluster: Places
    apart: Array
    scratch: tuple[Places, Places, Array, Places]

    @classmethod
    def of(
        cls,
        found: _Found,
        categories: int,
        line: NDArray[np.int64],
        hit: NDArray[np.int64],
        right: Flags,
        wrong: Flags,
    ) -> _Ranking:
        segment = line * categories + found.category[hit]
        following = np.cumsum(right.ravel(), dtype=np.int64).reshape(right.shape)
        wrong_line, miss = np.nonzero(wrong)
        after = following[wrong_line, miss]
        there = after < len(hit)
        there[there] &= segment[after[there]] == (wrong_line * categories + found.category[miss])[there]
        place = after[there]
        starts = np.flatnonzero(np.diff(segment, prepend=-1))
        lengths = np.diff(starts, append=len(hit))
        number = np.repeat(np.arange(len(starts)), lengths)
        hits = (np.arange(len(hit)) - starts[number] + 1).astype(np.int32)
        before = np.cumsum(np.bincount(place, minlength=len(hit)))
        missed = np.bincount(number[place], minlength=len(starts))
        shown = (hits + before - (np.cumsum(missed) - missed)[number]).astype(np.int32)
        scratch = np.empty_like(hits), np.empty_like(hits), np.empty(len(hit)), np.empty_like(hits)
        apart: Any = 2.0 * (len(starts) - 1 - number)  # so that the best further down is of the same segment
        own: Any = starts, lengths, segment[starts], number, hits, shown
        every: list[Any] = [*own, place, found.cluster[miss[there]], apart, scratch]
        return cls(*every)

    def averages(
        self,
        hits: NDArray[np.int64],
        misses: NDArray[np.int64],
        table: NDArray[np.int64],
        places: NDArray[np.int64],
    ) -> Array:
        """Average precision of each segment without these hits, and without misses before these.

        table: how many of ``RECALLS`` are reached by numbers of hits, those of a segment from its place on.
        """
        right, shown, share, reached = self.scratch
        self._less(hits, hits[:0], self.hits, right)
        self._less(hits, misses, self.shown, shown)
        np.divide(right, np.maximum(shown, 1, out=shown), out=share)
        share += self.apart
        np.maximum.accumulate(share[::-1], out=share[::-1])
        share -= self.apart
        right += np.take(places, self.number, out=shown, mode="clip")
        np.take(table, right, out=reached, mode="clip")
        np.subtract(reached[1:], reached[:-1], out=shown[1:])
        shown[self.starts] = reached[self.starts]
        share *= shown
        return np.asarray(np.add.reduceat(share, self.starts) / len(RECALLS))

    def _less(self, hits: Places, misses: Places, numbers: Places, into: Places) -> None:
        """The numbers (H,), each segment's less what of it is away down to each."""
        change = np.zeros_like(numbers)
        change[hits] = 1
        np.add.at(change, misses, 1)
        away = np.bincount(self.number[hits], minlength=len(self.starts))
        away += np.bincount(self.number[misses], minlength=len(self.starts))
        change[self.starts[1:]] -= away[:-1].astype(change.dtype)
        np.subtract(numbers, np.cumsum(change, out=into, dtype=into.dtype), out=into)


def _by_cluster(
    clusters: int, cluster: NDArray[np.int64], place: NDArray[np.int64]
) -> list[NDArray[np.int64]]:
    """The places of each cluster."""
    order = np.argsort(cluster, kind="stable")
    return np.split(place[order], np.cumsum(np.bincount(cluster, minlength=clusters))[:-1])


def _reached(targets: Array, most: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """How many of ``RECALLS`` each number of hits below ``most`` reaches, none of no hit, for each number of targets;
    and where the numbers of ``targets`` begin in it."""
    different, number = np.unique(targets, return_inverse=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        recall = np.nan_to_num(np.arange(most) / different[:, None])
    table = np.searchsorted(RECALLS, recall, side="right")
    table[:, 0] = 0
    return table.ravel().astype(np.int32), (number.reshape(targets.shape) * most).astype(np.int32)
