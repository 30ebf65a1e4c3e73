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

from blurnoise_eval.detectors.records import Detections
from blurnoise_eval.scoring.estimates import Array, Estimate, left_out, mean
from blurnoise_eval.scoring.matching import (
    FOUND_SCORE,
    MATCH_IOU,
    MoveBoxes,
    hits,
    share_inside,
    swept_within,
)
from blurnoise_eval.scoring.precision import AREAS_PX2, SIZES, Answered, Precision, precision

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
    None for a reader. found: (picture name, repeat, detections). move_boxes: to where the truth's boxes stand
    here; None: they stay. sweep_boxes: to what these cover in the course of the exposure; None: no more than that.
    cluster_of: the number of a picture's cluster; without, each is its own.
    """

    sums: Mapping[str, tuple[Array, Array]]
    truth: Truth | None = None
    found: Sequence[tuple[str, int, Detections]] = ()
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
        every = found.precision.mean(axis=2)
        averages = {"ap": every[:, 0], "ap50": found.precision[:, 0, 0], "ap75": found.precision[:, 0, 5]}
        averages |= {f"ap_{size}": every[:, place] for place, size in enumerate(SIZES[1:], start=1)}
        averages["ar100"] = found.recall.mean(axis=1)
        return {name: left_out(values) for name, values in averages.items()}

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
        seen = {} if self.truth is None else {self.truth.image_ids[name] for name, _, _ in self.found}
        own = [
            target for number in seen for target in self._targets.get(number, ()) if not target.get("iscrowd")
        ]
        areas = np.array([target["area"] for target in own], float)
        return {
            size: int(((low <= areas) & (areas <= high)).sum())
            for size, (low, high) in zip(SIZES, AREAS_PX2.tolist(), strict=True)
        }

    @cached_property
    def _at_middle(self) -> Precision:
        return self._precision(self._targets)

    @cached_property
    def swept_ap50(self) -> Estimate:
        """COCO's AP50 with the boxes that the motion sweeps; where these are the boxes at mid-exposure, that."""
        swept = self._swept_annotations
        if swept is None:
            return self.coco["ap50"]
        return left_out(self._precision(_by_picture(swept)).precision[:, 0, 0])

    @cached_property
    def alarms(self) -> Alarms | None:
        """Detections that count as alarms; None without a truth to hold them against."""
        return self.alarms_from(FOUND_SCORE)

    def alarms_from(self, least: float) -> Alarms | None:
        """Those of at least this confidence."""
        if self.truth is None:
            return None
        scores, right, cluster = [np.zeros(0)], [np.zeros(0, bool)], [np.zeros(0, np.int64)]
        pictures = np.zeros(self._count)
        for name, _, each in self.found:
            pictures[self._clusters[name]] += 1
            targets = self._targets.get(self.truth.image_ids[name], ())
            certain = each[each.scores >= least].leading
            for class_id in np.unique(certain.class_ids):
                category = self.truth.category_of.get(int(class_id))
                if category is None:
                    continue
                of_class = certain[certain.class_ids == class_id]
                own = [target for target in targets if target["category_id"] == category]
                sides = [_corners(target) for target in own if not target.get("iscrowd")]
                hit = hits(of_class, sides, int(class_id))
                crowd = [_corners(target) for target in own if target.get("iscrowd")]
                judged = hit | ~(share_inside(of_class.boxes_xyxy, crowd) >= MATCH_IOU)
                scores.append(of_class.scores[judged].astype(float))
                right.append(hit[judged])
                cluster.append(np.full(np.count_nonzero(judged), self._clusters[name]))
        return Alarms(np.concatenate(scores), np.concatenate(right), np.concatenate(cluster), pictures)

    def _precision(self, targets: Mapping[int, Sequence[Mapping[str, Any]]]) -> Precision:
        """Of what was found, with these annotations, by picture, as the truth."""
        truth = self.truth or Truth({}, {}, {})
        numbers = truth.image_ids
        in_order = sorted(
            self.found, key=lambda entry: (entry[1], numbers[entry[0]])
        )  # of equal scores: COCO's
        answered = [
            Answered(self._clusters[name], each, targets.get(numbers[name], ())) for name, _, each in in_order
        ]
        return precision(answered, truth.category_of, self._count)

    @cached_property
    def _clusters(self) -> Mapping[str, int]:
        if self.cluster_of is not None:
            return self.cluster_of
        return {name: place for place, name in enumerate(dict.fromkeys(name for name, _, _ in self.found))}

    @property
    def _count(self) -> int:
        """How many clusters there are."""
        return 1 + max(self._clusters.values(), default=0)

    @cached_property
    def _targets(self) -> dict[int, list[Mapping[str, Any]]]:
        """The truth's annotations by picture."""
        return _by_picture(self._annotations)

    @cached_property
    def _annotations(self) -> Sequence[dict[str, Any]]:
        return moved(self.truth, self.move_boxes) if self.truth else ()

    @cached_property
    def _swept_annotations(self) -> Sequence[dict[str, Any]] | None:
        """Those with all that the boxes cover in the course of the exposure; None where that is no more."""
        if self.truth is None or self.sweep_boxes is None or not self._annotations:
            return None
        at_middle, sizes = _boxes(self._annotations), _sizes(self.truth)
        swept = self.sweep_boxes(_boxes(self.truth.coco["annotations"]), sizes, self.truth.labels)
        swept = swept_within(swept, at_middle, np.where(np.isnan(sizes), np.inf, sizes))
        return None if np.array_equal(swept, at_middle) else _with(self._annotations, swept)


def moved(truth: Truth, move_boxes: MoveBoxes | None) -> Sequence[dict[str, Any]]:
    """COCO's annotations with their boxes moved; areas, by which COCO sorts targets by size, stay."""
    annotations: Sequence[dict[str, Any]] = truth.coco["annotations"]
    if move_boxes is None or not annotations:
        return annotations
    return _with(annotations, move_boxes(_boxes(annotations), _sizes(truth), truth.labels))


def _sizes(truth: Truth) -> NDArray[np.float64]:
    """Width and height of each annotation's picture, (N, 2); NaN where it is not known."""
    unknown = (np.nan, np.nan)
    return np.array(
        [truth.sizes_px.get(each["image_id"], unknown) for each in truth.coco["annotations"]], float
    )


def _by_picture(annotations: Sequence[Mapping[str, Any]]) -> dict[int, list[Mapping[str, Any]]]:
    found: dict[int, list[Mapping[str, Any]]] = {}
    for annotation in annotations:
        found.setdefault(annotation["image_id"], []).append(annotation)
    return found


def _boxes(annotations: Sequence[Mapping[str, Any]]) -> NDArray[np.float64]:
    """Corners (N, 4) of COCO's boxes."""
    sides = np.array([each["bbox"] for each in annotations], float)
    return np.concatenate([sides[:, :2], sides[:, :2] + sides[:, 2:]], axis=1)


def _with(annotations: Sequence[dict[str, Any]], boxes_xyxy: NDArray[np.float64]) -> Sequence[dict[str, Any]]:
    """The annotations with these boxes instead of their own."""
    sides = np.concatenate([boxes_xyxy[:, :2], boxes_xyxy[:, 2:] - boxes_xyxy[:, :2]], axis=1)
    return [{**each, "bbox": box} for each, box in zip(annotations, sides.tolist(), strict=True)]


def _corners(annotation: Mapping[str, Any]) -> list[float]:
    x, y, width, height = annotation["bbox"]
    return [x, y, x + width, y + height]


def coco_results(
    detections: Detections, image_id: int, category_of: Mapping[int, int]
) -> Iterator[dict[str, Any]]:
    """Detections as COCO's results have them, those of classes that have a category."""
    sides = detections.boxes_xyxy.astype(float)
    sides[:, 2:] -= sides[:, :2]
    rows = zip(sides.tolist(), detections.scores.tolist(), detections.class_ids.tolist(), strict=True)
    for box, score, class_id in rows:
        category = category_of.get(class_id)
        if category is not None:
            yield {"image_id": image_id, "category_id": category, "bbox": box, "score": score}
