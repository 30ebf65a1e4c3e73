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
from blurnoise_eval.scoring.matching import (
    FOUND_SCORE,
    MATCH_IOU,
    MOST_DETECTIONS,
    MoveBoxes,
    hits,
    share_inside,
    swept_within,
)

COCO_SCORES = {"ap": 0, "ap50": 1, "ap75": 2, "ap_small": 3, "ap_medium": 4, "ap_large": 5, "ar100": 8}
_BINS = 10  # of confidence, for the calibration error
_REPEAT = 1 << 40  # picture p in repeat r has the number p + r times this


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


class Alarms(NamedTuple):
    """Scores of detections, whether each is right, and the number of pictures."""

    scores: tuple[float, ...]
    right: tuple[bool, ...]
    pictures: int

    @property
    def false_per_image(self) -> float | None:
        """Wrong ones per picture; None without pictures."""
        return (len(self.right) - sum(self.right)) / self.pictures if self.pictures else None


@dataclass(frozen=True)
class Judged:
    """A model's answers under one condition.

    means: of its targets and readings, by column, None where there is none of them. truth: None for a reader.
    found: (picture name, repeat, detections). move_boxes: to where the truth's boxes stand here; None: they stay.
    sweep_boxes: to what these cover in the course of the exposure; None: no more than that.
    """

    means: Mapping[str, Any]
    truth: Truth | None = None
    found: Sequence[tuple[str, int, Detections]] = ()
    move_boxes: MoveBoxes | None = None
    sweep_boxes: MoveBoxes | None = None

    @cached_property
    def coco(self) -> dict[str, float | None]:
        """COCO's averages by the names of ``COCO_SCORES``, None where undefined."""
        if not self._annotations:
            return dict.fromkeys(COCO_SCORES)
        judge = self._judge(self._annotations)
        judge.params.maxDets = [1, 10, MOST_DETECTIONS]
        judge.run()
        scores = {name: float(judge.stats[place]) for name, place in COCO_SCORES.items()}
        return {name: score if score >= 0 else None for name, score in scores.items()}  # -1: no such target

    @cached_property
    def swept_ap50(self) -> float | None:
        """COCO's AP50 with the boxes that the motion sweeps; where these are the boxes at mid-exposure, that."""
        swept = self._swept_annotations
        if swept is None:
            return self.coco["ap50"]
        judge = self._judge(swept)
        judge.params.iouThrs = np.array([MATCH_IOU])
        judge.params.areaRng, judge.params.areaRngLbl = judge.params.areaRng[:1], judge.params.areaRngLbl[:1]
        judge.params.maxDets = [MOST_DETECTIONS]
        judge.evaluate()
        judge.accumulate()
        precision = judge.eval["precision"]
        return float(precision[precision > -1].mean()) if (precision > -1).any() else None

    @cached_property
    def alarms(self) -> Alarms | None:
        """Detections that count as alarms; None without a truth to hold them against."""
        if self.truth is None:
            return None
        targets: dict[tuple[int, int], list[list[float]]] = {}
        crowds: dict[tuple[int, int], list[list[float]]] = {}
        for annotation in self._annotations:
            x, y, width, height = annotation["bbox"]
            kind = crowds if annotation.get("iscrowd") else targets
            key = annotation["image_id"], annotation["category_id"]
            kind.setdefault(key, []).append([x, y, x + width, y + height])
        scores: list[float] = []
        right: list[bool] = []
        for image_id, _, each in self._known:
            certain = each[each.scores >= FOUND_SCORE]
            for class_id in np.unique(certain.class_ids):
                category = self.truth.category_of.get(int(class_id))
                if category is None:
                    continue
                of_class = certain[certain.class_ids == class_id]
                hit = hits(of_class, targets.get((image_id, category), []), int(class_id))
                crowd = crowds.get((image_id, category), [])
                judged = hit | ~(share_inside(of_class.boxes_xyxy, crowd) >= MATCH_IOU)
                scores += of_class.scores[judged].tolist()
                right += hit[judged].tolist()
        return Alarms(tuple(scores), tuple(right), len(self._known))

    def _judge(self, annotations: Sequence[Mapping[str, Any]]) -> Any:
        """COCO's evaluation of what was found, with these boxes as the truth."""
        from faster_coco_eval import COCOeval_faster  # takes 0.2 s

        return COCOeval_faster(self._coco(annotations), self._answers, "bbox", print_function=lambda *_: None)

    def _coco(self, annotations: Sequence[Mapping[str, Any]]) -> Any:
        """The annotations as a COCO data set, with those of every repeat as pictures of their own."""
        from faster_coco_eval import COCO

        repeats = sorted({repeat for _, repeat, _ in self._known})
        every = [(repeat, each) for repeat in repeats for each in annotations]
        truth = {  # of pictures that are not listed, annotations do not count
            "images": [{"id": number} for number in sorted({_number(*which) for *which, _ in self._known})],
            "annotations": [
                {**each, "id": place, "image_id": _number(each["image_id"], repeat)}
                for place, (repeat, each) in enumerate(every, 1)
            ],
            "categories": self.truth.coco["categories"] if self.truth else [],
        }
        return COCO(truth)

    @cached_property
    def _answers(self) -> Any:
        """What was found, as COCO holds results."""
        categories = self.truth.category_of if self.truth else {}
        return self._coco(self._annotations).loadRes(
            [
                row
                for image_id, repeat, each in self._known
                for row in coco_results(_counted(each), _number(image_id, repeat), categories)
            ]
        )

    @cached_property
    def _known(self) -> list[tuple[int, int, Detections]]:
        numbers = self.truth.image_ids if self.truth else {}
        return [(numbers[name], repeat, each) for name, repeat, each in self.found]

    @cached_property
    def _annotations(self) -> Sequence[dict[str, Any]]:
        """COCO's annotations with their boxes moved; areas, by which COCO sorts targets by size, stay."""
        if self.truth is None or not self.truth.coco["annotations"]:
            return ()
        annotations: Sequence[dict[str, Any]] = self.truth.coco["annotations"]
        return (
            annotations
            if self.move_boxes is None
            else _with(annotations, self.move_boxes(_boxes(annotations)))
        )

    @cached_property
    def _swept_annotations(self) -> Sequence[dict[str, Any]] | None:
        """Those with all that the boxes cover in the course of the exposure; None where that is no more."""
        if self.truth is None or self.sweep_boxes is None or not self._annotations:
            return None
        moved = _boxes(self._annotations)
        sizes = [self.truth.sizes_px.get(each["image_id"], (np.inf, np.inf)) for each in self._annotations]
        swept = swept_within(self.sweep_boxes(_boxes(self.truth.coco["annotations"])), moved, sizes)
        return None if np.array_equal(swept, moved) else _with(self._annotations, swept)


def _number(image_id: int, repeat: int) -> int:
    return image_id + repeat * _REPEAT


def _boxes(annotations: Sequence[Mapping[str, Any]]) -> NDArray[np.float64]:
    """Corners (N, 4) of COCO's boxes."""
    sides = np.array([each["bbox"] for each in annotations], float)
    return np.concatenate([sides[:, :2], sides[:, :2] + sides[:, 2:]], axis=1)


def _with(annotations: Sequence[dict[str, Any]], boxes_xyxy: NDArray[np.float64]) -> Sequence[dict[str, Any]]:
    """The annotations with these boxes instead of their own."""
    sides = np.concatenate([boxes_xyxy[:, :2], boxes_xyxy[:, 2:] - boxes_xyxy[:, :2]], axis=1)
    return [{**each, "bbox": box} for each, box in zip(annotations, sides.tolist(), strict=True)]


def calibration_error(scores: Sequence[float], right: Sequence[bool]) -> float | None:
    """Expected calibration error: |mean score - share of right ones|, over ten bins, weighted by number.

    Of detections, hence without the misses (Küppers et al. 2020, confidence alone). None without any.
    """
    if not len(scores):
        return None
    values, hit = np.asarray(scores, float), np.asarray(right, float)
    bins = np.minimum((values * _BINS).astype(int), _BINS - 1)
    gaps = np.bincount(bins, values - hit, _BINS)  # n_b · (mean score - precision)
    return float(np.abs(gaps).sum() / len(values))


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


def _counted(detections: Detections) -> Detections:
    """The first ``MOST_DETECTIONS`` of each class, highest score first: COCO looks at no others."""
    if len(detections) <= MOST_DETECTIONS:
        return detections
    kept = np.zeros(len(detections), bool)
    for class_id in np.unique(detections.class_ids):
        kept[np.flatnonzero(detections.class_ids == class_id)[:MOST_DETECTIONS]] = True
    return detections[kept]
