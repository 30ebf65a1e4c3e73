"""Average precision with clusters left out, against COCO's own of the other pictures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pytest
from blurnoise_eval.detectors.records import Answers, Detections
from blurnoise_eval.scoring.evaluated import coco_results
from blurnoise_eval.scoring.matching import Targets
from blurnoise_eval.scoring.precision import Precision
from blurnoise_eval.scoring.precision import precision as pooled
from blurnoise_eval.scoring.uncertainty import interval_of, left_out
from faster_coco_eval import COCO, COCOeval_faster

COCO_SCORES = {"ap": 0, "ap50": 1, "ap75": 2, "ap_small": 3, "ap_medium": 4, "ap_large": 5, "ar100": 8}
"""Names, and their places in COCO's summary."""
CATEGORY_OF = {0: 13, 4: 2, 5: 90}


class Answered(NamedTuple):
    """One picture as it was answered."""

    cluster: int
    detections: Detections
    targets: Sequence[Mapping[str, Any]]


def precision(pictures: Sequence[Answered], category_of: Mapping[int, int], clusters: int) -> Precision:
    return pooled(
        Answers.of([(str(place), 0, each.detections) for place, each in enumerate(pictures)]),
        np.array([each.cluster for each in pictures], np.int64),
        Targets.of([each.targets for each in pictures]),
        category_of,
        clusters,
    )


def crowded(seed: int, pictures: int = 10) -> list[Answered]:
    """Targets that overlap each other, of all sizes, some crowds; several tries at each, tied scores, clutter."""
    rng = np.random.default_rng(seed)
    answered = []
    for picture in range(pictures):
        targets: list[dict[str, Any]] = []
        boxes, classes = [], []
        for _ in range(rng.integers(0, 9)):
            x, y = rng.uniform(0, 60, 2)
            width, height = np.exp(rng.uniform(np.log(10), np.log(200), 2))
            class_id = int(rng.choice([0, 4]))
            targets.append(
                {"image_id": picture, "category_id": CATEGORY_OF[class_id], "bbox": [x, y, width, height]}
                | {"area": width * height * rng.uniform(0.4, 1), "iscrowd": int(rng.uniform() < 0.15)}
            )
            for spread in (0.02, 0.05, 0.15):
                boxes.append(np.array([x, y, x + width, y + height]) + rng.normal(0, spread * width, 4))
                classes.append(class_id)
        for _ in range(rng.integers(0, 30)):
            corner = rng.uniform(0, 200, 2)
            boxes.append(np.concatenate([corner, corner + rng.uniform(2, 150, 2)]))
            classes.append(int(rng.choice([0, 4, 5, 7])))
        corners = np.array(boxes).reshape(-1, 4)
        corners[:, 2:] = np.maximum(corners[:, 2:], corners[:, :2] + 1)
        scores = rng.uniform(0.01, 1, len(corners)).round(2)
        answered.append(Answered(picture // 2, Detections(corners, scores, np.array(classes, int)), targets))
    return answered


def by_coco(pictures: list[Answered]) -> dict[str, float]:
    annotations = [
        {**target, "id": number, "image_id": place}
        for number, (place, target) in enumerate(
            ((place, target) for place, each in enumerate(pictures) for target in each.targets), start=1
        )
    ]
    coco = COCO(
        {
            "images": [{"id": place} for place in range(len(pictures))],
            "annotations": annotations,
            "categories": [{"id": number} for number in CATEGORY_OF.values()],
        }
    )
    rows = [
        row
        for place, each in enumerate(pictures)
        for row in coco_results(each.detections, place, CATEGORY_OF)
    ]
    judge = COCOeval_faster(coco, coco.loadRes(rows), "bbox", print_function=lambda *_: None)
    judge.run()
    return {name: float(judge.stats[place]) for name, place in COCO_SCORES.items()}


@pytest.mark.parametrize("seed", range(4))
def test_every_cluster_left_out_is_cocos_of_the_others(seed: int) -> None:
    """Five clusters of two pictures: of all, and without each."""
    pictures = crowded(seed)
    found = precision(pictures, CATEGORY_OF, 5)
    for row in range(6):
        expected = by_coco([each for each in pictures if each.cluster != row - 1])
        every = found.precision[row].mean(axis=1)
        got = {"ap": every[0], "ap50": found.precision[row, 0, 0], "ap75": found.precision[row, 0, 5]}
        got |= {"ap_small": every[1], "ap_medium": every[2], "ap_large": every[3]}
        got["ar100"] = found.recall[row].mean()
        assert {name: -1 if np.isnan(value) else value for name, value in got.items()} == pytest.approx(
            expected, abs=1e-9
        )
    assert len({round(float(value), 9) for value in found.precision[:, 0, 0]}) > 3  # clusters do matter


def test_nothing_found_and_nothing_there() -> None:
    nothing = Detections(np.zeros((0, 4)), np.zeros(0), np.zeros(0, int))
    target = {"category_id": 13, "bbox": [0, 0, 200, 200], "area": 4e4}
    found = precision([Answered(0, nothing, [target]), Answered(1, nothing, [])], CATEGORY_OF, 2)
    assert found.precision[0, 0, 0] == found.recall[0, 0] == 0
    assert np.isnan(found.precision[0, 1]).all()  # no small target
    assert np.isnan(found.precision[1]).all()  # without the only one
    assert np.isnan(precision([], CATEGORY_OF, 1).precision).all()


def some(rng: np.random.Generator, pictures: int, categories: int = 20) -> list[Answered]:
    """Targets of categories of which most are rare, found at chance, and false detections of the same categories."""
    frequency = 1 / np.arange(1, categories + 1)
    found = []
    for place in range(pictures):
        own = rng.choice(categories, 1 + rng.poisson(3), p=frequency / frequency.sum())
        false = rng.choice(categories, rng.poisson(5), p=frequency / frequency.sum())
        right = rng.uniform(size=len(own)) < 0.6
        left = 40.0 * np.arange(len(own) + len(false))
        boxes = np.stack(
            [left, np.where(np.arange(len(left)) < len(own), 0, 500), left + 30, left * 0 + 30], axis=1
        )
        boxes[len(own) :, 3] = 530
        seen = np.concatenate([right, np.ones(len(false), bool)])
        scores = np.concatenate([rng.beta(3, 2, len(own)), rng.beta(2, 3, len(false))])
        classes = np.concatenate([own, false])
        detections = Detections(boxes[seen], scores[seen], classes[seen])
        targets = [
            {"category_id": int(each), "bbox": [40.0 * n, 0, 30, 30], "area": 900.0}
            for n, each in enumerate(own)
        ]
        found.append(Answered(place, detections, targets))
    return found


def test_cautious_mean_leans_to_categories_of_many_targets() -> None:
    """The first has three targets after a false detection: 1/2, 2/3, 3/4, interpolated .75; the other has one, found:
    1. COCO .875, by targets .8125, the cautious half as far below."""
    boxes = np.array([[100.0 * n, 0, 100.0 * n + 50, 50] for n in range(5)])
    classes = np.array([0, 0, 0, 0, 1])
    detections = Detections(boxes, [0.9, 0.8, 0.7, 0.6, 0.5], classes)
    targets = [
        {"category_id": int(classes[n]), "bbox": [100.0 * n, 0, 50, 50], "area": 2500.0} for n in (1, 2, 3, 4)
    ]
    found = precision([Answered(0, detections, targets)], {0: 0, 1: 1}, 1)
    assert found.precision[0, 0, 0] == pytest.approx((0.75 + 1) / 2)
    assert found.cautious[0, 0, 0] == pytest.approx(0.8125 - 0.5 * 0.0625)


@pytest.mark.slow
@pytest.mark.parametrize("pictures", [12, 20, 35])
def test_intervals_of_ap_hold_though_it_is_biased(pictures: int) -> None:
    """20 categories, most of them rare: COCO's AP50 of few pictures lies above that of 1500, and its own interval
    misses that; with the cautious end it holds in 93 % at least, less three standard errors of 150 samples (2 %)."""
    ids = {number: number for number in range(20)}
    rng = np.random.default_rng(pictures)
    truth = precision([each._replace(cluster=0) for each in some(rng, 1500)], ids, 1).precision[0, 0, 0]
    held = np.zeros(2)
    values = []
    for _ in range(150):
        found = precision(some(rng, pictures), ids, pictures)
        whole, cautious = found.precision[:, 0, 0], found.cautious[:, 0, 0]
        values.append(whole[0])
        for place, estimate in enumerate((left_out(whole), left_out(whole, cautious))):
            low, high = interval_of(estimate, 1.0)
            assert low is not None
            assert high is not None
            assert low <= whole[0] <= high
            held[place] += low <= truth <= high
    assert np.mean(values) > truth + 0.02
    assert held[1] / 150 > 0.93 - 0.06
    assert held[1] > held[0]
