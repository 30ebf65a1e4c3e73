"""A model's answers under one condition, compared with the truth: all that a score is made of.

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
from blurnoise_eval.scoring.matching import FOUND_SCORE, MATCH_IOU, Targets, matched
from blurnoise_eval.scoring.precision import AREAS_PX2, SIZES, Precision, precision
from blurnoise_eval.scoring.uncertainty import Array, ClusterEstimate, left_out, mean

_IOU_50 = slice(1)
_BINS = 10  # of confidence, for the calibration error
Places = NDArray[np.int64]


@dataclass(frozen=True)
class Truth:
    """What is in the pictures, as a COCO data set, and what a model calls it.

    coco: annotations and categories as COCO's instances file has them. image_ids: by picture name.
    category_of: a category's id by the model's number for it; other classes do not count. sizes_px: width and
    height by image id.

    >>> coco = {"annotations": [{"image_id": 7, "category_id": 1, "bbox": [0, 0, 10, 10], "area": 100.0}]}
    >>> truth = Truth({**coco, "categories": [{"id": 1, "name": "sign"}]}, {"a.png": 7}, {0: 1})
    >>> truth.moved(None).tolist()
    [[0.0, 0.0, 10.0, 10.0]]
    """

    coco: Mapping[str, Any]
    image_ids: Mapping[str, int]
    category_of: Mapping[int, int]
    sizes_px: Mapping[int, tuple[int, int]] = field(default_factory=dict)

    @cached_property
    def places(self) -> Mapping[int, int]:
        """A place for the id of each picture."""
        annotated = (each["image_id"] for each in self.coco["annotations"])
        numbers = dict.fromkeys([*self.image_ids.values(), *annotated])
        return {number: place for place, number in enumerate(numbers)}

    @cached_property
    def annotations(self) -> Sequence[Mapping[str, Any]]:
        """COCO's, picture by picture in the order of :attr:`places`."""
        return sorted(self.coco["annotations"], key=lambda each: self.places[each["image_id"]])

    @cached_property
    def targets(self) -> Targets:
        """The annotations."""
        pictures: list[list[Mapping[str, Any]]] = [[] for _ in self.places]
        for each in self.annotations:
            pictures[self.places[each["image_id"]]].append(each)
        return Targets.of(pictures)

    @cached_property
    def sizes(self) -> Array:
        """Width and height of each annotation's picture, (N, 2); NaN where it is not known."""
        unknown = (np.nan, np.nan)
        return np.array([self.sizes_px.get(each["image_id"], unknown) for each in self.annotations], float)

    def moved(self, move_boxes: MoveBoxes | None) -> Array:
        """The annotations' corners elsewhere, (N, 4)."""
        corners = xyxy(self.targets.boxes_xywh)
        if move_boxes is None or not len(corners):
            return corners
        names = {category["id"]: category["name"] for category in self.coco["categories"]}
        return move_boxes(corners, self.sizes, [names[each["category_id"]] for each in self.annotations])


NO_TRUTH, NO_ANSWERS = Truth({"annotations": (), "categories": ()}, {}, {}), Answers.of(())


class Alarms(NamedTuple):
    """Of N detections: scores, whether each is right, its cluster; pictures: their number per cluster, (n,).

    >>> scores, right = np.array([0.9, 0.8, 0.3, 0.3]), np.array([True, False, True, False])
    >>> alarms = Alarms(scores, right, cluster=np.array([0, 0, 1, 1]), pictures=np.array([1.0, 1.0]))
    >>> alarms.false_per_image.value, alarms.confidence_at(0.5)
    (1.0, 0.3)
    """

    scores: Array
    right: NDArray[np.bool_]
    cluster: Places
    pictures: Array

    @property
    def false_per_image(self) -> ClusterEstimate:
        """Wrong ones per picture; undefined without pictures."""
        wrong = np.bincount(self.cluster[~self.right], minlength=len(self.pictures))
        return mean(wrong, self.pictures)

    @property
    def calibration_error(self) -> ClusterEstimate:
        """Expected calibration error: |mean score - share of right ones|, over ten bins, weighted by number.

        Of detections, hence without the misses (Küppers et al. 2020, confidence alone). Undefined without any. It is
        biased upwards, the more the better a model is calibrated, so no interval of ours would hold: it has none.
        """
        if not len(self.scores):
            return ClusterEstimate(None)
        # A score of 1 belongs to the last bin.
        place = np.minimum((self.scores * _BINS).astype(int), _BINS - 1)
        gaps = np.bincount(place, self.scores - self.right, _BINS)  # n_b · (mean score - precision)
        return ClusterEstimate(float(np.abs(gaps).sum() / len(self.scores)))

    def confidence_at(self, rate: float) -> float:
        """The confidence above which there are at most ``rate`` wrong ones per picture; 0 where all are no more.

        A detector that drops its weaker answers itself may stay below the rate.
        """
        wrong = np.sort(self.scores[~self.right])[::-1]
        # 0.29 times 100 pictures is 29, though floats make it 28.999999999999996.
        allowed = int(np.floor(rate * self.pictures.sum() + 1e-9))
        return float(wrong[allowed]) if len(wrong) > allowed else 0.0


@dataclass(frozen=True)
class Evaluated:
    """A model's answers under one condition.

    sums: of each score of single targets and readings its sums over clusters and their counts, both (n,). truth:
    ``NO_TRUTH`` for a reader. found: in every picture. move_boxes: to where the truth's boxes are here; None: they
    stay. sweep_boxes: to all that these cover during the exposure; None: no more than that. cluster_of: the number of
    a picture's cluster; without, each is its own.

    >>> recalls = {"detection_rate": (np.array([1.0, 2.0]), np.array([2.0, 2.0]))}  # sums, targets
    >>> Evaluated(recalls).mean("detection_rate").value
    0.75
    """

    sums: Mapping[str, tuple[Array, Array]]
    truth: Truth = NO_TRUTH
    found: Answers = NO_ANSWERS
    move_boxes: MoveBoxes | None = None
    sweep_boxes: MoveBoxes | None = None
    cluster_of: Mapping[str, int] | None = None

    def mean(self, score: str) -> ClusterEstimate:
        """Of targets or readings; undefined where there is none of them."""
        return mean(*self.sums[score]) if score in self.sums else ClusterEstimate(None)

    def average(self, size: str = "all", ious: slice = slice(None)) -> ClusterEstimate:
        """COCO's average precision of targets of a size; undefined without targets."""
        if self._at_middle is None:
            return ClusterEstimate(None)
        values, cautious = self._at_middle.precision, self._at_middle.cautious
        return left_out(*(each[:, SIZES.index(size), ious].mean(axis=1) for each in (values, cautious)))

    @property
    def recall(self) -> ClusterEstimate:
        """COCO's average recall with 100 detections a picture."""
        found = self._at_middle
        return ClusterEstimate(None) if found is None else left_out(found.recall.mean(axis=1))

    @property
    def swept_ap50(self) -> ClusterEstimate:
        """COCO's AP50 with the boxes that the motion sweeps; where these are the boxes at mid-exposure, that."""
        if self.sweep_boxes is None or self._at_middle is None:
            return self.average(ious=_IOU_50)
        at_middle, sizes = self.truth.moved(self.move_boxes), self.truth.sizes
        swept = swept_within(
            self.truth.moved(self.sweep_boxes), at_middle, np.where(np.isnan(sizes), np.inf, sizes)
        )
        if np.array_equal(swept, at_middle):
            return self.average(ious=_IOU_50)
        found = self._precision(swept, ap50_only=True)
        return left_out(found.precision[:, 0, 0], found.cautious[:, 0, 0])

    @property
    def targets_by_size(self) -> dict[str, int]:
        """How many targets of each of ``SIZES`` the pictures have, each once; crowds are none."""
        targets = self.truth.targets.of_pictures(np.unique(self._pictures[1]), len(self.truth.places))
        areas = targets.area_px2[~targets.crowd, None]
        counts = ((AREAS_PX2[:, 0] <= areas) & (areas <= AREAS_PX2[:, 1])).sum(axis=0)
        return dict(zip(SIZES, counts.tolist(), strict=True))

    @cached_property
    def alarms(self) -> Alarms:
        """Detections that count as alarms."""
        return self.alarms_from(FOUND_SCORE)

    def alarms_from(self, least: float) -> Alarms:
        """Those of at least this confidence; those in a crowd are neither right nor wrong."""
        answers, _, clusters, count = self._pictures
        targets = self._targets(self.truth.moved(self.move_boxes))
        category, categories = targets.category_of_class(self.truth.category_of, answers.class_ids)
        # One class of each box: whoever acts on an alarm sees the leading one only.
        certain = np.flatnonzero((answers.scores >= least) & answers.leads & (category >= 0))
        picture = answers.picture[certain]
        taken, beside = matched(
            picture * categories + category[certain],
            xywh(answers.boxes_xyxy[certain]),
            targets.picture * categories + targets.category,
            targets,
            targets.crowd[None],
            np.array([MATCH_IOU]),
        )
        # A detection in a crowd may be right or wrong: nobody labelled the single objects.
        counted = ~beside[0, 0]
        scores, cluster = answers.scores[certain][counted].astype(float), clusters[picture][counted]
        return Alarms(
            scores, taken[0, 0][counted], cluster, np.bincount(clusters, minlength=count).astype(float)
        )

    @cached_property
    def _at_middle(self) -> Precision | None:
        """With the boxes at mid-exposure; None without targets."""
        if not self.truth.annotations:
            return None
        return self._precision(self.truth.moved(self.move_boxes))

    def _precision(self, boxes_xyxy: Array, *, ap50_only: bool = False) -> Precision:
        answers, _, cluster, count = self._pictures
        targets, of = self._targets(boxes_xyxy), self.truth.category_of
        return precision(answers, cluster, targets, of, count, ap50_only=ap50_only)

    def _targets(self, boxes_xyxy: Array) -> Targets:
        """The truth's targets in the pictures, boxes: (N, 4) of all annotations."""
        moved = self.truth.targets._replace(boxes_xywh=xywh(boxes_xyxy))
        return moved.of_pictures(self._pictures[1], len(self.truth.places))

    @cached_property
    def _pictures(self) -> tuple[Answers, Places, Places, int]:
        """The answers in COCO's order of pictures, which ranks equal scores; of each picture its place in the truth
        and its cluster, and how many clusters there are."""
        of, places = self.truth.image_ids, self.truth.places
        order = np.lexsort(([of[name] for name in self.found.names], self.found.repeats))
        answers = self.found.in_order(order)
        numbers = [places[of[name]] for name in answers.names]
        clusters = self.cluster_of
        if clusters is None:
            clusters = {name: place for place, name in enumerate(dict.fromkeys(answers.names))}
        own = np.array([clusters[name] for name in answers.names], np.int64)
        return answers, np.array(numbers, np.int64), own, 1 + max(clusters.values(), default=0)


def coco_results(
    detections: Detections, image_id: int, category_of: Mapping[int, int]
) -> Iterator[dict[str, Any]]:
    """Detections as COCO's results have them, those of classes that have a category.

    >>> of_one = Detections(np.array([[10.0, 20.0, 30.0, 50.0]]), np.array([0.5]), np.array([0]))
    >>> next(coco_results(of_one, image_id=7, category_of={0: 1}))["bbox"]
    [10.0, 20.0, 20.0, 30.0]
    """
    columns = xywh(detections.boxes_xyxy), detections.scores, detections.class_ids
    for box, score, class_id in zip(*(each.tolist() for each in columns), strict=True):
        if (category := category_of.get(class_id)) is not None:
            yield {"image_id": image_id, "category_id": category, "bbox": box, "score": score}
