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
Places = NDArray[np.int64]


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

    @property
    def annotations(self) -> Sequence[Mapping[str, Any]]:
        """COCO's."""
        found: Sequence[Mapping[str, Any]] = self.coco["annotations"]
        return found

    @cached_property
    def places(self) -> Mapping[int, int]:
        """A place for the id of each picture."""
        annotated = (each["image_id"] for each in self.annotations)
        numbers = dict.fromkeys([*self.image_ids.values(), *annotated])
        return {number: place for place, number in enumerate(numbers)}

    @cached_property
    def in_places(self) -> Places:
        """The annotations picture by picture, in the order of :attr:`places`."""
        places = np.array([self.places[each["image_id"]] for each in self.annotations], np.int64)
        return np.argsort(places, kind="stable")

    @cached_property
    def targets(self) -> Targets:
        """The annotations in the order of :attr:`in_places`."""
        pictures: list[list[Mapping[str, Any]]] = [[] for _ in self.places]
        for each in self.annotations:
            pictures[self.places[each["image_id"]]].append(each)
        return Targets.of(pictures)

    @cached_property
    def corners(self) -> Array:
        """(N, 4) of the annotations' boxes."""
        return xyxy([each["bbox"] for each in self.annotations])

    @cached_property
    def sizes(self) -> Array:
        """Width and height of each annotation's picture, (N, 2); NaN where it is not known."""
        unknown = (np.nan, np.nan)
        return np.array([self.sizes_px.get(each["image_id"], unknown) for each in self.annotations], float)

    def moved(self, move_boxes: MoveBoxes) -> Array:
        """The corners elsewhere, (N, 4)."""
        names = {category["id"]: category["name"] for category in self.coco["categories"]}
        labels = [names[each["category_id"]] for each in self.annotations]
        return move_boxes(self.corners, self.sizes, labels)


class Alarms(NamedTuple):
    """Of N detections: scores, whether each is right, its cluster; pictures: their number per cluster, (n,)."""

    scores: Array
    right: NDArray[np.bool_]
    cluster: Places
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

    sums: of its targets' and readings' columns: sums over clusters, and their counts, both (n,). truth: None for a
    reader. found: (picture name, repeat, detections), or all as arrays. move_boxes: to where the truth's boxes are
    here; None: they stay. sweep_boxes: to all that these cover during the exposure; None: no more than that.
    cluster_of: the number of a picture's cluster; without, each is its own.
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
        found = self._at_middle
        if found is None:
            return dict.fromkeys(COCO_SCORES, Estimate(None))
        averages = {"ap": (0, slice(None)), "ap50": (0, slice(1)), "ap75": (0, slice(5, 6))}
        averages |= {f"ap_{size}": (place, slice(None)) for place, size in enumerate(SIZES) if place}
        both = found.precision, found.cautious
        return {
            name: left_out(*(each[:, area, ious].mean(axis=1) for each in both))
            for name, (area, ious) in averages.items()
        } | {"ar100": left_out(found.recall.mean(axis=1))}

    def precision_by_size(self, score: str) -> dict[str, Estimate]:
        """ "ap" or "ap50" of the targets of each of ``SIZES``."""
        found = self._at_middle
        if found is None:
            return dict.fromkeys(SIZES, Estimate(None))
        values = found.precision[:, :, 0] if score == "ap50" else found.precision.mean(axis=2)
        return {size: left_out(of) for size, of in zip(SIZES, values.T, strict=True)}

    @property
    def targets_by_size(self) -> dict[str, int]:
        """How many targets of each of ``SIZES`` the pictures have, each once; crowds are none."""
        own = self._own_targets(np.unique(self._places), None)
        areas = own.area_px2[~own.crowd, None]
        counts = ((AREAS_PX2[:, 0] <= areas) & (areas <= AREAS_PX2[:, 1])).sum(axis=0)
        return dict(zip(SIZES, counts.tolist(), strict=True))

    @cached_property
    def _at_middle(self) -> Precision | None:
        """None without targets."""
        return None if self._truth is _NO_TRUTH else self._precision(self._moved)

    @cached_property
    def swept_ap50(self) -> Estimate:
        """COCO's AP50 with the boxes that the motion sweeps; where these are the boxes at mid-exposure, that."""
        swept = self._swept
        if swept is None:
            return self.coco["ap50"]
        found = self._precision(swept, ap50_only=True)
        return left_out(found.precision[:, 0, 0], found.cautious[:, 0, 0])

    @cached_property
    def alarms(self) -> Alarms:
        """Detections that count as alarms; none, in no picture, without a truth to hold them against."""
        return self.alarms_from(FOUND_SCORE)

    def alarms_from(self, least: float) -> Alarms:
        """Those of at least this confidence."""
        if self.truth is None:
            return Alarms(np.zeros(0), np.zeros(0, bool), np.zeros(0, np.int64), np.zeros(1))
        answers, cluster = self._answers, self._cluster_of_picture
        certain = np.flatnonzero((answers.scores >= least) & answers.leads)
        known = np.full(max(self.truth.category_of, default=0) + 2, -1)  # the last: none
        targets = self._own_targets(self._places, self._moved)
        places = {category: place for place, category in enumerate(targets.categories)}
        for number, name in self.truth.category_of.items():
            known[number] = places.setdefault(name, len(places))
        category = known[np.minimum(answers.class_ids[certain], len(known) - 1)]
        certain, category = certain[category >= 0], category[category >= 0]
        picture = answers.picture[certain]
        taken, beside = matched(
            picture * len(places) + category,
            xywh(answers.boxes_xyxy[certain]),
            targets.picture * len(places) + targets.category,
            targets,
            targets.crowd[None],
            np.array([MATCH_IOU]),
        )
        judged = ~beside[0, 0]  # in a crowd they are neither right nor wrong
        return Alarms(
            answers.scores[certain][judged].astype(float),
            taken[0, 0][judged],
            cluster[picture][judged],
            np.bincount(cluster, minlength=self._count).astype(float),
        )

    def confidence_at(self, rate: float) -> float:
        """The confidence above which the pictures have at most ``rate`` false alarms each; 0 where all have no more.

        Crowds give no alarms. A detector that drops its weaker answers itself may stay below the rate.
        """
        alarms = self.alarms_from(0.0)
        wrong = np.sort(alarms.scores[~alarms.right])[::-1]
        allowed = int(np.floor(rate * alarms.pictures.sum() + 1e-9))
        return float(wrong[allowed]) if len(wrong) > allowed else 0.0

    def _precision(self, boxes_xywh: Array | None, *, ap50_only: bool = False) -> Precision:
        """Of what was found, with the annotations there as the truth."""
        numbers = np.array([self._truth.image_ids[name] for name in self._answers.names])
        order = np.lexsort((numbers, np.array(self._answers.repeats)))  # of equal scores: COCO's
        return precision(
            self._answers.in_order(order),
            self._cluster_of_picture[order],
            self._own_targets(self._places[order], boxes_xywh),
            self._truth.category_of,
            self._count,
            ap50_only=ap50_only,
        )

    @property
    def _truth(self) -> Truth:
        """The truth where it has targets, else one without."""
        return self.truth if self.truth is not None and self.truth.annotations else _NO_TRUTH

    @cached_property
    def _answers(self) -> Answers:
        return self.found if isinstance(self.found, Answers) else Answers.of(self.found)

    @cached_property
    def _cluster_of_picture(self) -> Places:
        return np.array([self._clusters[name] for name in self._answers.names], np.int64)

    @cached_property
    def _places(self) -> Places:
        """The place of each picture in the truth."""
        truth = self.truth
        names = () if truth is None else self._answers.names
        return np.array([truth.places[truth.image_ids[name]] for name in names if truth], np.int64)

    def _own_targets(self, places: Places, boxes_xywh: Array | None) -> Targets:
        """The truth's targets in pictures at these places; boxes: (N, 4) of all annotations, None: their own."""
        truth = self.truth or _NO_TRUTH
        every = truth.targets
        if boxes_xywh is not None:
            every = every._replace(boxes_xywh=boxes_xywh[truth.in_places])
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

    @cached_property
    def _moved(self) -> Array | None:
        """Sides of the truth's boxes at mid-exposure; None: they stay."""
        if self._truth is _NO_TRUTH or self.move_boxes is None:
            return None
        return xywh(self._truth.moved(self.move_boxes))

    @cached_property
    def _swept(self) -> Array | None:
        """All that the boxes cover during the exposure, as sides; None where that is no more."""
        truth = self._truth
        if truth is _NO_TRUTH or self.sweep_boxes is None:
            return None
        at_middle = truth.corners if self._moved is None else xyxy(self._moved)
        sizes = np.where(np.isnan(truth.sizes), np.inf, truth.sizes)
        swept = swept_within(truth.moved(self.sweep_boxes), at_middle, sizes)
        return None if np.array_equal(swept, at_middle) else xywh(swept)


_NO_TRUTH = Truth({"annotations": []}, {}, {})


def moved(truth: Truth, move_boxes: MoveBoxes | None) -> Sequence[Mapping[str, Any]]:
    """COCO's annotations with their boxes moved; areas, by which COCO sorts targets by size, stay."""
    if move_boxes is None or not truth.annotations:
        return truth.annotations
    boxes = xywh(truth.moved(move_boxes)).tolist()
    return [{**each, "bbox": box} for each, box in zip(truth.annotations, boxes, strict=True)]


def coco_results(
    detections: Detections, image_id: int, category_of: Mapping[int, int]
) -> Iterator[dict[str, Any]]:
    """Detections as COCO's results have them, those of classes that have a category."""
    columns = xywh(detections.boxes_xyxy), detections.scores, detections.class_ids
    for box, score, class_id in zip(*(each.tolist() for each in columns), strict=True):
        if (category := category_of.get(class_id)) is not None:
            yield {"image_id": image_id, "category_id": category, "bbox": box, "score": score}
