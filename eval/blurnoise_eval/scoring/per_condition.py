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
from blurnoise_eval.scoring.matching import FOUND_SCORE, MATCH_IOU, MOST_DETECTIONS, hits, share_inside
from blurnoise_eval.store.store import Store, unpack

CONDITIONS = ("clean", "exposure_s", "illuminance_lux", "velocity_x_px_s", "velocity_y_px_s")
COCO_SCORES = {"ap": 0, "ap50": 1, "ap75": 2, "ap_small": 3, "ap_medium": 4, "ap_large": 5, "ar100": 8}
COLUMNS = (
    "model", *CONDITIONS, "blur_px", "n_images", "n_targets", "errors", "target_confidence", "detection_rate",
    "confidence_when_found", *COCO_SCORES, "false_positives_per_image", "calibration_error",
    "read_confidence", "exact_match", "character_error_rate",
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
) -> Iterator[dict[str, Any]]:
    """One row (``COLUMNS``) per model and condition, the untouched pictures first.

    truth_of: a model's truth, None for a reader. Pictures that could not be read do not count; those on
    which the model failed count as answered by nothing.
    """
    for model in models:
        truth = truth_of(model)
        judge = Judge(truth) if truth is not None else None
        for row in list(store.rows(_MEANS, model, model)):
            found = dict.fromkeys(COLUMNS) | row
            if judge is not None:
                where = " AND ".join(f"{name} IS ?" for name in CONDITIONS)
                query = f"SELECT image, repeat, detections FROM cells WHERE model = ? AND {where}"
                cells = store.rows(query, model, *(row[name] for name in CONDITIONS))
                found |= judge([(c["image"], c["repeat"], unpack(c["detections"])) for c in cells])
            progress(1)
            yield found


_SHARED = ", ".join(CONDITIONS)
_SAME = " AND ".join(
    f"told.{name} IS seen.{name}" for name in CONDITIONS
)  # IS: untouched pictures have NULLs
_MEANS = f"""
SELECT seen.*, n_targets, target_confidence, detection_rate, confidence_when_found, read_confidence,
  exact_match, character_error_rate
FROM (
  SELECT model, {_SHARED}, blur_px, COUNT(*) AS n_images, COUNT(error) AS errors
  FROM cells WHERE model = ? GROUP BY {_SHARED}) AS seen
LEFT JOIN (
  SELECT {_SHARED}, COUNT(*) AS n_targets, AVG(confidence) AS target_confidence,
    AVG(confidence >= {FOUND_SCORE}) AS detection_rate,
    AVG(CASE WHEN confidence >= {FOUND_SCORE} THEN confidence END) AS confidence_when_found,
    AVG(read_confidence) AS read_confidence, AVG(text = truth) AS exact_match,
    AVG(character_error_rate) AS character_error_rate
  FROM targets WHERE model = ? GROUP BY {_SHARED}) AS told ON {_SAME}
ORDER BY clean DESC, illuminance_lux, exposure_s, velocity_x_px_s, velocity_y_px_s
"""


class Judge:
    """Compares detections with one truth. Call it with (picture name, repeat, detections) of one condition."""

    def __init__(self, truth: Truth) -> None:
        self._truth = truth
        self._boxes: dict[tuple[int, int], list[list[float]]] = {}
        self._crowds: dict[tuple[int, int], list[list[float]]] = {}
        for each in truth.coco["annotations"]:
            x, y, width, height = each["bbox"]
            kind = self._crowds if each.get("iscrowd") else self._boxes
            key = each["image_id"], each["category_id"]
            kind.setdefault(key, []).append([x, y, x + width, y + height])

    def __call__(self, found: Sequence[tuple[str, int, Detections]]) -> dict[str, float | None]:
        """COCO's averages, false positives per picture and the calibration error; None where undefined."""
        known = [(self._truth.image_ids[name], repeat, each) for name, repeat, each in found]
        return {**self._coco_scores(known), **self._alarms(known)}

    def _coco_scores(self, found: Sequence[tuple[int, int, Detections]]) -> dict[str, float | None]:
        from faster_coco_eval import COCO, COCOeval_faster  # takes 0.2 s

        repeats = {repeat for _, repeat, _ in found}
        numbered = [(image_id + repeat * _REPEAT, each) for image_id, repeat, each in found]
        annotations = [
            {**each, "id": place, "image_id": each["image_id"] + repeat * _REPEAT}
            for place, (repeat, each) in enumerate(
                ((repeat, each) for repeat in sorted(repeats) for each in self._truth.coco["annotations"]), 1
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

    def _alarms(self, found: Sequence[tuple[int, int, Detections]]) -> dict[str, float | None]:
        scores: list[float] = []
        right: list[bool] = []
        for image_id, _, each in found:
            certain = each[each.scores >= FOUND_SCORE]
            for class_id in np.unique(certain.class_ids):
                category = self._truth.category_of.get(int(class_id))
                if category is None:
                    continue
                of_class = certain[certain.class_ids == class_id]
                hit = hits(of_class, self._boxes.get((image_id, category), []), int(class_id))
                crowds = self._crowds.get((image_id, category), [])
                judged = hit | ~(share_inside(of_class.boxes_xyxy, crowds) >= MATCH_IOU)
                scores += of_class.scores[judged].tolist()
                right += hit[judged].tolist()
        wrong = len(right) - sum(right)
        return {
            "false_positives_per_image": wrong / len(found) if found else None,
            "calibration_error": calibration_error(scores, right),
        }


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
