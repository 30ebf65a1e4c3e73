"""What each model scores under each condition of a run: COCO's averages, false alarms, calibration, reading.

Domain: fractions in [0, 1]; boxes (left, top, right, bottom) px; conditions in s, lux and px/s. A detection
counts as an alarm, and in the calibration error, from ``FOUND_SCORE`` on.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

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
from blurnoise_eval.scoring.registry import SCORES
from blurnoise_eval.store import queries
from blurnoise_eval.store.schema import CONDITIONS
from blurnoise_eval.store.store import Store

COCO_SCORES = {"ap": 0, "ap50": 1, "ap75": 2, "ap_small": 3, "ap_medium": 4, "ap_large": 5, "ar100": 8}
COLUMNS = (
    "model", *CONDITIONS, "blur_px", "n_images", "n_targets", "errors", *(score.name for score in SCORES)
)  # fmt: skip
_BINS = 10  # of confidence, for the calibration error
_REPEAT = 1 << 40  # picture p in repeat r has the number p + r times this


@dataclass(frozen=True)
class Truth:
    """What is in the pictures, as a COCO data set, and what a model calls it.

    coco: annotations and categories as COCO's instances file has them. image_ids: by picture name.
    category_of: a category's id by the model's number for it; other classes are not judged.
    """

    coco: Mapping[str, Any]
    image_ids: Mapping[str, int]
    category_of: Mapping[int, int]


def score_rows(
    store: Store,
    models: Sequence[str],
    truth_of: Callable[[str], Truth | None],
    progress: Callable[[int], None] = lambda rows: None,
    *,
    moves: Callable[[Mapping[str, Any]], MoveBoxes | None] = lambda row: None,
) -> Iterator[dict[str, Any]]:
    """One row (``COLUMNS``) per model and condition, the untouched pictures first.

    truth_of: a model's truth, None for a reader. moves: where the conditions of a row have moved the truth's
    boxes. Pictures that could not be read do not count; those on which the model failed count as answered by
    nothing.
    """
    for model in models:
        truth = truth_of(model)
        judge = Judge(truth) if truth is not None else None
        for row in queries.condition_means(store, model, FOUND_SCORE):
            found = dict.fromkeys(COLUMNS) | row
            if judge is not None:
                cells = list(queries.detections_at(store, model, row))
                found |= judge(cells, None if row["clean"] else moves(row))
            progress(1)
            yield found


class Judge:
    """Compares detections with one truth. Call it with (picture name, repeat, detections) of one condition."""

    def __init__(self, truth: Truth) -> None:
        self._truth = truth

    def __call__(
        self, found: Sequence[tuple[str, int, Detections]], move_boxes: MoveBoxes | None = None
    ) -> dict[str, float | None]:
        """COCO's averages, false positives per picture and the calibration error; None where undefined.

        move_boxes: to where the truth's boxes stand in these pictures.
        """
        known = [(self._truth.image_ids[name], repeat, each) for name, repeat, each in found]
        annotations = _moved(self._truth.coco["annotations"], move_boxes)
        return {**self._coco_scores(known, annotations), **self._alarms(known, annotations)}

    def _coco_scores(
        self, found: Sequence[tuple[int, int, Detections]], stated: Sequence[Mapping[str, Any]]
    ) -> dict[str, float | None]:
        from faster_coco_eval import COCO, COCOeval_faster  # takes 0.2 s

        repeats = {repeat for _, repeat, _ in found}
        numbered = [(image_id + repeat * _REPEAT, each) for image_id, repeat, each in found]
        annotations = [
            {**each, "id": place, "image_id": each["image_id"] + repeat * _REPEAT}
            for place, (repeat, each) in enumerate(
                ((repeat, each) for repeat in sorted(repeats) for each in stated), 1
            )
        ]
        if not annotations:
            return dict.fromkeys(COCO_SCORES)
        truth = {  # of pictures that are not listed, annotations do not count
            "images": [{"id": number} for number in sorted({number for number, _ in numbered})],
            "annotations": annotations,
            "categories": self._truth.coco["categories"],
        }
        coco = COCO(truth)
        categories = self._truth.category_of
        answers = [row for number, each in numbered for row in coco_results(each, number, categories)]
        judge = COCOeval_faster(coco, coco.loadRes(answers), "bbox", print_function=lambda *_: None)
        judge.params.maxDets = [1, 10, MOST_DETECTIONS]
        judge.run()
        scores = {name: float(judge.stats[place]) for name, place in COCO_SCORES.items()}
        return {name: score if score >= 0 else None for name, score in scores.items()}  # -1: no such target

    def _alarms(
        self, found: Sequence[tuple[int, int, Detections]], stated: Sequence[Mapping[str, Any]]
    ) -> dict[str, float | None]:
        targets: dict[tuple[int, int], list[list[float]]] = {}
        crowds: dict[tuple[int, int], list[list[float]]] = {}
        for annotation in stated:
            x, y, width, height = annotation["bbox"]
            kind = crowds if annotation.get("iscrowd") else targets
            key = annotation["image_id"], annotation["category_id"]
            kind.setdefault(key, []).append([x, y, x + width, y + height])
        scores: list[float] = []
        right: list[bool] = []
        for image_id, _, each in found:
            certain = each[each.scores >= FOUND_SCORE]
            for class_id in np.unique(certain.class_ids):
                category = self._truth.category_of.get(int(class_id))
                if category is None:
                    continue
                of_class = certain[certain.class_ids == class_id]
                hit = hits(of_class, targets.get((image_id, category), []), int(class_id))
                crowd = crowds.get((image_id, category), [])
                judged = hit | ~(share_inside(of_class.boxes_xyxy, crowd) >= MATCH_IOU)
                scores += of_class.scores[judged].tolist()
                right += hit[judged].tolist()
        wrong = len(right) - sum(right)
        return {
            "false_positives_per_image": wrong / len(found) if found else None,
            "calibration_error": calibration_error(scores, right),
        }


def _moved(annotations: Sequence[dict[str, Any]], move_boxes: MoveBoxes | None) -> Sequence[dict[str, Any]]:
    """COCO's annotations with their boxes moved; areas, by which COCO sorts targets by size, stay."""
    if move_boxes is None or not annotations:
        return annotations
    sides = np.array([each["bbox"] for each in annotations], float)
    boxes = move_boxes(np.concatenate([sides[:, :2], sides[:, :2] + sides[:, 2:]], axis=1))
    moved = np.concatenate([boxes[:, :2], boxes[:, 2:] - boxes[:, :2]], axis=1)
    return [{**each, "bbox": box} for each, box in zip(annotations, moved.tolist(), strict=True)]


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


def performance(row: Mapping[str, Any]) -> float | None:
    """The one number of a score row that P, mPC and rPC are made of: AP, or for a reader exact matches."""
    value = row["exact_match"] if row["ap"] is None else row["ap"]
    return None if value is None or math.isnan(value) else float(value)
