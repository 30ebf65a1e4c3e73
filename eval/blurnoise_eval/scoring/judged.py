"""Answers under one condition, held against the truth: all that a score is made of.

Domain: fractions in [0, 1]; boxes (left, top, right, bottom) px. A detection counts as an alarm, and in the
calibration error, from ``FOUND_SCORE`` on.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.detectors.records import Answers, Detections
from blurnoise_eval.scoring.boxes import MoveBoxes, swept_within, xywh, xyxy
from blurnoise_eval.scoring.estimates import Array, Estimate, left_out, mean
from blurnoise_eval.scoring.matching import FOUND_SCORE, MATCH_IOU, Targets, matched
from blurnoise_eval.scoring.precision import AREAS_PX2, SIZES, Precision, precision

COCO_SCORES = {"ap": 0, "ap50": 1, "ap75": 2, "ap_small": 3, "ap_medium": 4, "ap_large": 5, "ar100": 8}
"""Names, and their places in COCO's summary."""
_BINS = 10  # of confidence, for the calibration error


@dataclass(frozen=True)
class Truth:
    """What is in the pictures, as a COCO data set, and what a model calls it.

    coco: annotations and categories as COCO's instances file has them. image_ids: by picture name.
    category_of: a category's id by the model's number for it; other classes are not judged. sizes_px: width and
    height by image id.
    """

    coco: Mapping[str, Any]
    image_ids: Mapping[str, int]
    category_of: Mapping[int, int]
    sizes_px: Mapping[int, tuple[int, int]] = field(default_factory=dict)

    @cached_property
    def targets(self) -> Targets:
        """The annotations, picture by picture in the order of :attr:`places`."""
        pictures: list[list[Mapping[str, Any]]] = [[] for _ in self.places]
        for each in self.coco["annotations"]:
            pictures[self.places[each["image_id"]]].append(each)
        return Targets.of(pictures)

    @cached_property
    def places(self) -> Mapping[int, int]:
        """A place for the id of each picture."""
        annotated = (each["image_id"] for each in self.coco["annotations"])
        return {
            number: place
            for place, number in enumerate(dict.fromkeys([*self.image_ids.values(), *annotated]))
        }

    @cached_property
    def in_places(self) -> NDArray[np.int64]:
        """The annotations in the order of :attr:`targets`."""
        places = np.array([self.places[each["image_id"]] for each in self.coco["annotations"]], np.int64)
        return np.argsort(places, kind="stable")

    @cached_property
    def corners(self) -> NDArray[np.float64]:
        """(N, 4) of the annotations' boxes."""
        return xyxy([each["bbox"] for each in self.coco["annotations"]])

    @cached_property
    def sizes(self) -> NDArray[np.float64]:
        """Width and height of each annotation's picture, (N, 2); NaN where it is not known."""
        return _sizes(self)

    @cached_property
    def labels(self) -> Sequence[str]:
        """The class of each annotation."""
        names = {category["id"]: category["name"] for category in self.coco["categories"]}
        return [names[each["category_id"]] for each in self.coco["annotations"]]


class Alarms(NamedTuple):
    """Of N detections: scores, whether each is right, its cluster; pictures: their number per cluster, (n,)."""

    scores: Array
    right: NDArray[np.bool_]
    cluster: NDArray[np.int64]
    pictures: Array

    @property
    def false_per_image(self) -> Estimate:
        """Wrong ones per picture; undefined without pictures."""
        wrong = np.bincount(self.cluster[~self.right], minlength=len(self.pictures))
        return mean(wrong, self.pictures)

    @property
    def calibration_error(self) -> Estimate:
        """Expected calibration error: |mean score - share of right ones|, over ten bins, weighted by number.

        Of detections, hence without the misses (Küppers et al. 2020, confidence alone). Undefined without any. It is
        biased upwards, the more the better a model is calibrated, so no interval of ours would hold: it has none.
        """
        if not len(self.scores):
            return Estimate(None)
        place = np.minimum((self.scores * _BINS).astype(int), _BINS - 1)
        gaps = np.bincount(place, self.scores - self.right, _BINS)  # n_b · (mean score - precision)
        return Estimate(float(np.abs(gaps).sum() / len(self.scores)))


@dataclass(frozen=True)
class Judged:
    """A model's answers under one condition.

    sums: of its targets' and readings' columns: sums over clusters, and what they are sums of, both (n,). truth:
    None for a reader. found: (picture name, repeat, detections), or all as arrays. move_boxes: to where the truth's
    boxes stand here; None: they stay. sweep_boxes: to what these cover in the course of the exposure; None: no more
    than that. cluster_of: the number of a picture's cluster; without, each is its own.
    """

    sums: Mapping[str, tuple[Array, Array]]
    truth: Truth | None = None
    found: Sequence[tuple[str, int, Detections]] | Answers = ()
    move_boxes: MoveBoxes | None = None
    sweep_boxes: MoveBoxes | None = None
    cluster_of: Mapping[str, int] | None = None

    def mean(self, column: str) -> Estimate:
        """Of targets or readings; undefined where there is none of them."""
        return mean(*self.sums[column]) if column in self.sums else Estimate(None)

    @cached_property
    def coco(self) -> dict[str, Estimate]:
        """COCO's averages by the names of ``COCO_SCORES``."""
        if self.truth is None or not self._annotations:
            return dict.fromkeys(COCO_SCORES, Estimate(None))
        found = self._at_middle
        averages = {
            **{name: (0, ious) for name, ious in (("ap", slice(None)), ("ap50", [0]), ("ap75", [5]))},
            **{f"ap_{size}": (place, slice(None)) for place, size in enumerate(SIZES[1:], start=1)},
        }
        scores = {
            name: left_out(*(each[:, area, ious].mean(axis=1) for each in (found.precision, found.cautious)))
            for name, (area, ious) in averages.items()
        }
        return scores | {"ar100": left_out(found.recall.mean(axis=1))}

    def precision_by_size(self, score: str) -> dict[str, Estimate]:
        """ "ap" or "ap50" of the targets of each of ``SIZES``."""
        if self.truth is None or not self._annotations:
            return dict.fromkeys(SIZES, Estimate(None))
        found = self._at_middle.precision
        values = found[:, :, 0] if score == "ap50" else found.mean(axis=2)
        return {size: left_out(values[:, place]) for place, size in enumerate(SIZES)}

    @property
    def targets_by_size(self) -> dict[str, int]:
        """How many targets of each of ``SIZES`` the pictures have, each once; crowds are none."""
        own = self._own_targets(np.unique(self._places), None)
        areas = np.zeros(0) if own is None else own.area_px2[~own.crowd]
        return {
            size: int(((low <= areas) & (areas <= high)).sum())
            for size, (low, high) in zip(SIZES, AREAS_PX2.tolist(), strict=True)
        }

    @cached_property
    def _at_middle(self) -> Precision:
        return self._precision(self._moved)

    @cached_property
    def swept_ap50(self) -> Estimate:
        """COCO's AP50 with the boxes that the motion sweeps; where these are the boxes at mid-exposure, that."""
        swept = self._swept
        if swept is None:
            return self.coco["ap50"]
        found = self._precision(swept, ap50_only=True)
        return left_out(found.precision[:, 0, 0], found.cautious[:, 0, 0])

    @cached_property
    def alarms(self) -> Alarms | None:
        """Detections that count as alarms; None without a truth to hold them against."""
        return self.alarms_from(FOUND_SCORE)

    def alarms_from(self, least: float) -> Alarms | None:
        """Those of at least this confidence."""
        if self.truth is None:
            return None
        answers, cluster = self._answers, self._cluster_of_picture
        pictures = np.bincount(cluster, minlength=self._count).astype(float)
        certain = np.flatnonzero((answers.scores >= least) & answers.leads)
        known = np.full(max(self.truth.category_of, default=0) + 2, -1)  # the last: none
        targets = self._own_targets(self._places, self._moved)
        places = {category: place for place, category in enumerate(targets.categories)}
        for number, category in self.truth.category_of.items():
            known[number] = places.setdefault(category, len(places))
        picture, class_ids = answers.picture, answers.class_ids
        certain = certain[known[np.minimum(class_ids[certain], len(known) - 1)] >= 0]
        many = len(places)
        taken, beside = matched(
            picture[certain] * many + known[class_ids[certain]],
            xywh(answers.boxes_xyxy[certain]),
            targets.picture * many + targets.category,
            targets,
            targets.crowd[None],
            np.array([MATCH_IOU]),
        )
        judged = ~beside[0, 0]  # in a crowd they are neither right nor wrong
        right = taken[0, 0]
        return Alarms(
            answers.scores[certain][judged].astype(float),
            right[judged],
            cluster[picture[certain]][judged],
            pictures,
        )

    def _precision(self, boxes_xywh: Array | None, *, ap50_only: bool = False) -> Precision:
        """Of what was found, with the annotations there as the truth."""
        truth = self.truth or Truth({"annotations": []}, {}, {})
        # of equal scores: COCO's
        numbers = np.array([truth.image_ids[name] for name in self._answers.names])
        order = np.lexsort((numbers, np.array(self._answers.repeats)))
        return precision(
            self._answers.in_order(order),
            self._cluster_of_picture[order],
            self._own_targets(self._places[order], boxes_xywh),
            truth.category_of,
            self._count,
            ap50_only=ap50_only,
        )

    @cached_property
    def _answers(self) -> Answers:
        return self.found if isinstance(self.found, Answers) else Answers.of(self.found)

    @cached_property
    def _cluster_of_picture(self) -> NDArray[np.int64]:
        return np.array([self._clusters[name] for name in self._answers.names], np.int64)

    @cached_property
    def _places(self) -> NDArray[np.int64]:
        """The place of each picture in the truth."""
        truth = self.truth
        names = () if truth is None else self._answers.names
        return np.array([truth.places[truth.image_ids[name]] for name in names if truth], np.int64)

    def _own_targets(self, places: NDArray[np.int64], boxes_xywh: Array | None) -> Targets:
        """The truth's targets in pictures at these places; boxes: (N, 4) of all annotations, None: their own."""
        truth = self.truth or Truth({"annotations": []}, {}, {})
        every = truth.targets if boxes_xywh is None else truth.targets.at(boxes_xywh[truth.in_places])
        return every.of_pictures(places, len(truth.places))

    @cached_property
    def _clusters(self) -> Mapping[str, int]:
        if self.cluster_of is not None:
            return self.cluster_of
        return {name: place for place, name in enumerate(dict.fromkeys(self._answers.names))}

    @property
    def _count(self) -> int:
        """How many clusters there are."""
        return 1 + max(self._clusters.values(), default=0)

    @property
    def _annotations(self) -> Sequence[dict[str, Any]]:
        return self.truth.coco["annotations"] if self.truth else ()

    @cached_property
    def _at(self) -> Array | None:
        """Corners of the truth's boxes at mid-exposure; None: they stay."""
        if self.truth is None or self.move_boxes is None or not self._annotations:
            return None
        return self.move_boxes(self.truth.corners, self.truth.sizes, self.truth.labels)

    @cached_property
    def _moved(self) -> Array | None:
        return None if self._at is None else xywh(self._at)

    @cached_property
    def _swept(self) -> Array | None:
        """All that the boxes cover in the course of the exposure, as sides; None where that is no more."""
        if self.truth is None or self.sweep_boxes is None or not self._annotations:
            return None
        truth = self.truth
        at_middle = truth.corners if self._moved is None else xyxy(self._moved)
        swept = self.sweep_boxes(truth.corners, truth.sizes, truth.labels)
        swept = swept_within(swept, at_middle, np.where(np.isnan(truth.sizes), np.inf, truth.sizes))
        return None if np.array_equal(swept, at_middle) else xywh(swept)


def moved(truth: Truth, move_boxes: MoveBoxes | None) -> Sequence[dict[str, Any]]:
    """COCO's annotations with their boxes moved; areas, by which COCO sorts targets by size, stay."""
    annotations: Sequence[dict[str, Any]] = truth.coco["annotations"]
    if move_boxes is None or not annotations:
        return annotations
    return _with(annotations, move_boxes(truth.corners, truth.sizes, truth.labels))


def _sizes(truth: Truth) -> NDArray[np.float64]:
    """Width and height of each annotation's picture, (N, 2); NaN where it is not known."""
    unknown = (np.nan, np.nan)
    return np.array(
        [truth.sizes_px.get(each["image_id"], unknown) for each in truth.coco["annotations"]], float
    )


def _with(annotations: Sequence[dict[str, Any]], boxes_xyxy: NDArray[np.float64]) -> Sequence[dict[str, Any]]:
    """The annotations with these boxes instead of their own."""
    sides = xywh(boxes_xyxy).tolist()
    return [{**each, "bbox": box} for each, box in zip(annotations, sides, strict=True)]


def coco_results(
    detections: Detections, image_id: int, category_of: Mapping[int, int]
) -> Iterator[dict[str, Any]]:
    """Detections as COCO's results have them, those of classes that have a category."""
    rows = zip(
        xywh(detections.boxes_xyxy).tolist(),
        detections.scores.tolist(),
        detections.class_ids.tolist(),
        strict=True,
    )
    for box, score, class_id in rows:
        category = category_of.get(class_id)
        if category is not None:
            yield {"image_id": image_id, "category_id": category, "bbox": box, "score": score}
