"""Scores of pictures' detections against pycocotools, with clusters left out, and by hand."""

from typing import Any

import numpy as np
import pytest
from blurnoise_eval.detectors.records import Answers, Detections
from blurnoise_eval.scoring import scores
from blurnoise_eval.scoring.evaluated import Alarms, Evaluated, Truth, coco_results
from blurnoise_eval.scoring.matching import Targets
from blurnoise_eval.scoring.precision import precision
from blurnoise_eval.scoring.uncertainty import interval_of, left_out
from coco_oracle import stats_of_cocos_tools

COCO_SCORES = {"ap": 0, "ap50": 1, "ap75": 2, "ap_small": 3, "ap_medium": 4, "ap_large": 5, "ar100": 8}
"""Names, and their places in COCO's summary."""
CATEGORIES = [{"id": 13, "name": "stop sign"}, {"id": 2, "name": "bicycle"}, {"id": 90, "name": "unseen"}]
CATEGORY_OF = {0: 13, 4: 2, 5: 90}  # class 7 of the model is nothing that the data set labels
Found = dict[str, Detections]


def crowded(seed, pictures=10):
    """Targets that overlap each other, of all sizes, some crowds, whose areas are not the boxes'; several tries at
    each, tied scores, clutter."""
    rng = np.random.default_rng(seed)
    annotations: list[dict[str, Any]] = []
    found = {}
    for image_id in range(100, 100 + pictures):
        boxes, classes = [], []
        for _ in range(rng.integers(0, 9)):
            x, y = rng.uniform(0, 60, 2)
            width, height = np.exp(rng.uniform(np.log(10), np.log(200), 2))
            class_id = int(rng.choice([0, 4]))
            own = {"image_id": image_id, "category_id": CATEGORY_OF[class_id], "bbox": [x, y, width, height]}
            own |= {"area": width * height * rng.uniform(0.4, 1), "iscrowd": int(rng.uniform() < 0.15)}
            annotations.append(own | {"id": len(annotations) + 7})
            for spread in (0.02, 0.05, 0.15):
                boxes.append(np.array([x, y, x + width, y + height]) + rng.normal(0, spread * width, 4))
                classes.append(class_id)
        for _ in range(rng.integers(0, 30)):
            corner = rng.uniform(0, 200, 2)
            boxes.append(np.concatenate([corner, corner + rng.uniform(2, 150, 2)]))
            classes.append(int(rng.choice([0, 4, 5, 7])))
        corners = np.array(boxes).reshape(-1, 4)
        corners[:, 2:] = np.maximum(corners[:, 2:], corners[:, :2] + 1)
        certain = rng.uniform(0.01, 1, len(corners)).round(2)
        found[f"{image_id}.jpg"] = Detections(corners, certain, np.array(classes, int))
    names = {name: int(name[:3]) for name in found}
    return Truth({"annotations": annotations, "categories": CATEGORIES}, names, CATEGORY_OF), found


def by_pycocotools(truth, found):
    ids = [truth.image_ids[name] for name in found]
    kept = [each for each in truth.coco["annotations"] if each["image_id"] in ids]
    document = {"images": [{"id": each} for each in ids], "annotations": kept, "categories": CATEGORIES}
    rows = [
        row for name, each in found.items() for row in coco_results(each, truth.image_ids[name], CATEGORY_OF)
    ]
    stats = stats_of_cocos_tools(document, rows)
    return {name: float(stats[place]) for name, place in COCO_SCORES.items()}


def scored(truth, found, move_boxes=None):
    """The scores of detections alone."""
    judged = Evaluated({}, truth, Answers.of([(name, 0, each) for name, each in found.items()]), move_boxes)
    own = ("false_positives_per_image", "calibration_error", *COCO_SCORES)
    return {each.name: each.estimate(judged).value for each in scores.of_conditions() if each.name in own}


@pytest.mark.parametrize("seed", range(4))
def test_scores_are_those_of_pycocotools(seed):
    """Of all pictures, of some, and with each of five clusters of two pictures left out."""
    truth, found = crowded(seed)
    expected = by_pycocotools(truth, found)
    whole = scored(truth, found)
    assert {name: whole[name] for name in COCO_SCORES} == pytest.approx(expected, abs=1e-9)
    assert 0 < expected["ap"] < expected["ap50"] < 1
    some = dict(list(found.items())[:5])
    fewer = scored(truth, some)
    known = {name: value for name, value in by_pycocotools(truth, some).items() if value >= 0}
    assert {name: fewer[name] for name in known} == pytest.approx(known, abs=1e-9)
    answers = Answers.of([(name, 0, each) for name, each in found.items()])
    pictures = [
        [a for a in truth.coco["annotations"] if a["image_id"] == n] for n in truth.image_ids.values()
    ]
    of = precision(answers, np.arange(10) // 2, Targets.of(pictures), CATEGORY_OF, 5)
    for row in range(1, 6):
        rest = {name: each for place, (name, each) in enumerate(found.items()) if place // 2 != row - 1}
        every = of.precision[row].mean(axis=1)
        got = dict(zip(COCO_SCORES, (every[0], *of.precision[row, 0, [0, 5]], *every[1:4]), strict=False))
        got["ar100"] = of.recall[row].mean()
        assert {n: -1 if np.isnan(v) else v for n, v in got.items()} == pytest.approx(
            by_pycocotools(truth, rest)
        )
    assert len({round(float(value), 9) for value in of.precision[:, 0, 0]}) > 3  # clusters do matter


NOTHING = Detections(np.zeros((0, 4)), np.zeros(0), np.zeros(0, int))


def test_what_no_target_of_a_size_can_tell_is_none():
    large = {"id": 1, "image_id": 1, "category_id": 13, "bbox": [0, 0, 200, 200], "area": 4e4, "iscrowd": 0}
    truth = Truth({"annotations": [large], "categories": CATEGORIES}, {"p": 1, "q": 2}, CATEGORY_OF)
    right = Detections(np.array([[0, 0, 200, 200]]), np.array([0.9]), np.array([0]))
    found = scored(truth, {"p": right})
    assert [found[name] for name in ("ap", "ap_large", "ap_small")] == [
        pytest.approx(1),
        pytest.approx(1),
        None,
    ]
    empty = scored(truth, {"q": right})  # a picture without targets: nothing to find, one false alarm
    assert (empty["ap"], empty["false_positives_per_image"]) == (None, 1)
    missed = scored(truth, {"p": NOTHING})
    assert (missed["ap"], missed["ar100"], missed["ap_small"]) == (0, 0, None)


def test_false_positives_and_calibration_by_hand():
    """Per picture, from a score of 0.25 on, of labelled classes, outside crowds, each target found once."""
    shared = {"image_id": 1, "category_id": 13}
    annotations = [
        {**shared, "id": 1, "bbox": [10, 10, 20, 20], "area": 400, "iscrowd": 0},
        {**shared, "id": 2, "bbox": [100, 100, 80, 80], "area": 6400, "iscrowd": 1},
    ]
    truth = Truth({"annotations": annotations, "categories": CATEGORIES}, {"p": 1, "q": 2}, CATEGORY_OF)
    rows = [
        ([10, 10, 30, 30], 0.95, 0, "right"),
        ([11, 10, 31, 30], 0.85, 0, "the same target again: wrong"),
        ([110, 110, 130, 130], 0.75, 0, "in the crowd: neither"),
        ([170, 110, 200, 130], 0.65, 0, "a third of it in the crowd: wrong"),
        ([10, 10, 30, 30], 0.55, 4, "the class of another category: wrong"),
        ([10, 10, 30, 30], 0.55, 7, "a class without category: not judged"),
        ([200, 10, 230, 30], 0.24, 0, "nobody acts upon it"),
    ]
    boxes, certain, classes, _ = zip(*rows, strict=True)
    got = scored(
        truth, {"p": Detections(np.array(boxes), np.array(certain), np.array(classes)), "q": NOTHING}
    )
    assert got["false_positives_per_image"] == pytest.approx(3 / 2)
    gaps = abs(0.95 - 1) + 0.85 + 0.65 + 0.55  # one detection to a bin
    assert got["calibration_error"] == pytest.approx(gaps / 4, abs=1e-6)


@pytest.mark.parametrize(
    ("rate", "expected"), [(0.1, 0.7), (0.49, 0.7), (0.5, 0.4), (1.0, 0.03), (1.5, 0.0), (100.0, 0.0)]
)
def test_confidence_at_a_rate_of_false_alarms(rate, expected):
    """Two pictures, false alarms of 0.7, 0.4 and 0.03."""
    certain, right = np.array([0.9, 0.7, 0.5, 0.4, 0.03]), np.array([True, False, True, False, False])
    found = Alarms(certain, right, np.arange(5) % 2, np.ones(2))
    assert found.confidence_at(rate) == pytest.approx(expected)
    assert (~found.right & (found.scores > found.confidence_at(rate))).sum() / 2 <= rate


def test_truth_stands_where_the_conditions_move_it():
    """All is 40 px further right, targets and crowds alike: scores as before, and none where it is not told."""
    truth, found = crowded(7)
    before, by = scored(truth, found), np.array([40.0, 0.0, 40.0, 0.0])
    shifted = {
        n: Detections(d.boxes_xyxy + by.astype(np.float32), d.scores, d.class_ids) for n, d in found.items()
    }
    assert scored(truth, shifted, lambda boxes, sizes, labels: boxes + by) == pytest.approx(before, abs=1e-6)
    assert (scored(truth, shifted)["ap50"] or 0) < 0.5 * (before["ap50"] or 0)
    assert scored(truth, found) == before  # nothing stays moved


def test_cautious_mean_leans_to_categories_of_many_targets():
    """The first has three targets after a false detection: 1/2, 2/3, 3/4, interpolated .75; the other has one, found:
    1. COCO .875, by targets .8125, the cautious half as far below."""
    boxes = np.array([[100.0 * n, 0, 100.0 * n + 50, 50] for n in range(5)])
    classes = np.array([0, 0, 0, 0, 1])
    targets = [
        {"category_id": int(classes[n]), "bbox": [100.0 * n, 0, 50, 50], "area": 2500.0} for n in (1, 2, 3, 4)
    ]
    answers = Answers.of([("p", 0, Detections(boxes, [0.9, 0.8, 0.7, 0.6, 0.5], classes))])
    found = precision(answers, np.zeros(1, int), Targets.of([targets]), {0: 0, 1: 1}, 1)
    assert found.precision[0, 0, 0] == pytest.approx((0.75 + 1) / 2)
    assert found.cautious[0, 0, 0] == pytest.approx(0.8125 - 0.5 * 0.0625)


def some(rng, pictures, clusters, categories=20):
    """Targets of categories of which most are rare, found at chance, and false detections of the same categories."""
    frequency = 1 / np.arange(1, categories + 1)
    answers, every = [], []
    for place in range(pictures):
        own = rng.choice(categories, 1 + rng.poisson(3), p=frequency / frequency.sum())
        false = rng.choice(categories, rng.poisson(5), p=frequency / frequency.sum())
        right = rng.uniform(size=len(own)) < 0.6
        left = 40.0 * np.arange(len(own) + len(false))
        top = np.where(np.arange(len(left)) < len(own), 0.0, 500.0)
        boxes = np.stack([left, top, left + 30, top + 30], axis=1)
        seen = np.concatenate([right, np.ones(len(false), bool)])
        certain = np.concatenate([rng.beta(3, 2, len(own)), rng.beta(2, 3, len(false))])
        answers.append(
            (str(place), 0, Detections(boxes[seen], certain[seen], np.concatenate([own, false])[seen]))
        )
        every.append(
            [{"category_id": int(c), "bbox": [40.0 * n, 0, 30, 30], "area": 900.0} for n, c in enumerate(own)]
        )
    ids = {number: number for number in range(categories)}
    return precision(Answers.of(answers), np.arange(pictures) % clusters, Targets.of(every), ids, clusters)


@pytest.mark.slow
@pytest.mark.parametrize("pictures", [12, 20, 35])
def test_intervals_of_ap_hold_though_it_is_biased(pictures):
    """20 categories, most of them rare: COCO's AP50 of few pictures lies above that of 1500, and its own interval
    misses that; with the cautious end it holds in 93 % at least, less three standard errors of 150 samples (2 %)."""
    rng = np.random.default_rng(pictures)
    truth = some(rng, 1500, 1).precision[0, 0, 0]
    held, values = np.zeros(2), []
    for _ in range(150):
        found = some(rng, pictures, pictures)
        whole, cautious = found.precision[:, 0, 0], found.cautious[:, 0, 0]
        values.append(whole[0])
        for place, estimate in enumerate((left_out(whole), left_out(whole, cautious))):
            low, high = interval_of(estimate, 1.0)
            assert low <= whole[0] <= high
            held[place] += low <= truth <= high
    assert np.mean(values) > truth + 0.02
    assert held[1] / 150 > 0.93 - 0.06
    assert held[1] > held[0]
