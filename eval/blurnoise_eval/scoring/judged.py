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

from blurnoise_eval.detectors.records import Detections
from blurnoise_eval.scoring.matching import (
    FOUND_SCORE,
    MATCH_IOU,
    MOST_DETECTIONS,
    MoveBoxes,
    hits,
    share_inside,
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
    """

    means: Mapping[str, Any]
    truth: Truth | None = None
    found: Sequence[tuple[str, int, Detections]] = ()
    move_boxes: MoveBoxes | None = None

    @cached_property
    def coco(self) -> dict[str, float | None]:
        """COCO's averages by the names of ``COCO_SCORES``, None where undefined."""
        from faster_coco_eval import COCO, COCOeval_faster  # takes 0.2 s

        if self.truth is None:
            return dict.fromkeys(COCO_SCORES)
        repeats = {repeat for _, repeat, _ in self._known}
        numbered = [(image_id + repeat * _REPEAT, each) for image_id, repeat, each in self._known]
        annotations = [
            {**each, "id": place, "image_id": each["image_id"] + repeat * _REPEAT}
            for place, (repeat, each) in enumerate(
                ((repeat, each) for repeat in sorted(repeats) for each in self._annotations), 1
            )
        ]
        if not annotations:
            return dict.fromkeys(COCO_SCORES)
        truth = {  # of pictures that are not listed, annotations do not count
            "images": [{"id": number} for number in sorted({number for number, _ in numbered})],
            "annotations": annotations,
            "categories": self.truth.coco["categories"],
        }
        coco = COCO(truth)
        categories = self.truth.category_of
        answers = [row for number, each in numbered for row in coco_results(each, number, categories)]
        judge = COCOeval_faster(coco, coco.loadRes(answers), "bbox", print_function=lambda *_: None)
        judge.params.maxDets = [1, 10, MOST_DETECTIONS]
        judge.run()
        scores = {name: float(judge.stats[place]) for name, place in COCO_SCORES.items()}
        return {name: score if score >= 0 else None for name, score in scores.items()}  # -1: no such target

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

    @cached_property
    def _known(self) -> list[tuple[int, int, Detections]]:
        numbers = self.truth.image_ids if self.truth else {}
        return [(numbers[name], repeat, each) for name, repeat, each in self.found]

    @cached_property
    def _annotations(self) -> Sequence[Mapping[str, Any]]:
        return moved(self.truth, self.move_boxes) if self.truth else ()


def moved(truth: Truth, move_boxes: MoveBoxes | None) -> Sequence[dict[str, Any]]:
    """COCO's annotations with their boxes moved; areas, by which COCO sorts targets by size, stay."""
    annotations: Sequence[dict[str, Any]] = truth.coco["annotations"]
    if move_boxes is None or not annotations:
        return annotations
    sizes = [truth.sizes_px.get(each["image_id"], (np.nan, np.nan)) for each in annotations]
    sides = np.array([each["bbox"] for each in annotations], float)
    boxes = move_boxes(
        np.concatenate([sides[:, :2], sides[:, :2] + sides[:, 2:]], axis=1), np.array(sizes, float)
    )
    own = np.concatenate([boxes[:, :2], boxes[:, 2:] - boxes[:, :2]], axis=1)
    return [{**each, "bbox": box} for each, box in zip(annotations, own.tolist(), strict=True)]


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
