"""Scores of a condition against pycocotools, and against values worked out by hand."""

from __future__ import annotations

from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from blurnoise_eval.answers import criterion
from blurnoise_eval.answers.per_condition import PICTURES, Scored, conditions_of, numbered, scored
from blurnoise_eval.detectors.records import Answers, Detections
from blurnoise_eval.scoring import scores as table
from blurnoise_eval.scoring import uncertainty
from blurnoise_eval.scoring.boxes import MoveBoxes
from blurnoise_eval.scoring.evaluated import Alarms, Evaluated, Truth, coco_results
from blurnoise_eval.store import queries
from blurnoise_eval.store.schema import CONDITIONS
from blurnoise_eval.store.store import CellResult, Store
from pycocotools.coco import COCO
from pycocotools.cocoeval import COCOeval

COCO_SCORES = {"ap": 0, "ap50": 1, "ap75": 2, "ap_small": 3, "ap_medium": 4, "ap_large": 5, "ar100": 8}
"""Names, and their places in COCO's summary."""
CATEGORIES = [{"id": 13, "name": "stop sign"}, {"id": 2, "name": "bicycle"}, {"id": 90, "name": "unseen"}]
CATEGORY_OF = {0: 13, 4: 2, 5: 90}  # class 7 of the model is nothing that the data set labels


class Judge:
    """The scores of detections alone."""

    def __init__(self, truth: Truth) -> None:
        self.truth = truth

    def __call__(
        self, found: list[tuple[str, int, Detections]], move_boxes: MoveBoxes | None = None
    ) -> dict[str, float | None]:
        judged = Evaluated({}, self.truth, Answers.of(found), move_boxes)
        own = ("false_positives_per_image", "calibration_error", *COCO_SCORES)
        return {
            score.name: score.estimate(judged).value for score in table.of_conditions() if score.name in own
        }


def score_rows(
    store: Store, truth: Truth | None, cluster: str | None = None, moves: Any = lambda row: (None, None)
) -> list[Scored]:
    """The scores of model m."""
    clusters = numbered(queries.pictures_seen(store), cluster)
    return list(scored(store, conditions_of(store, ["m"], clusters), lambda _: truth, moves, clusters))


def street(seed: int, pictures: int = 12) -> tuple[Truth, dict[str, Detections]]:
    """Targets of all sizes, some crowds, areas that are not the boxes'; two tries at each, and clutter."""
    rng = np.random.default_rng(seed)
    annotations: list[dict[str, Any]] = []
    found = {}
    for image_id in range(100, 100 + pictures):
        boxes, classes = [], []
        for _ in range(rng.integers(0, 6)):
            x, y, width, height = rng.uniform(0, 300, 4) * [1, 1, rng.uniform(0.05, 1), rng.uniform(0.05, 1)]
            class_id = int(rng.choice([0, 4]))
            annotations.append(
                {"id": len(annotations) + 7, "image_id": image_id, "category_id": CATEGORY_OF[class_id]}
                | {"bbox": [x, y, width, height], "area": width * height * rng.uniform(0.4, 1)}
                | {"iscrowd": int(rng.uniform() < 0.15)}
            )
            for spread in (0.03, 0.15):
                boxes.append(np.array([x, y, x + width, y + height]) + rng.normal(0, spread * width, 4))
                classes.append(class_id)
        for _ in range(rng.integers(0, 40)):
            corner = rng.uniform(0, 300, 2)
            boxes.append(np.concatenate([corner, corner + rng.uniform(2, 150, 2)]))
            classes.append(int(rng.choice([0, 4, 5, 7])))
        corners = np.array(boxes).reshape(-1, 4)
        corners[:, 2:] = np.maximum(corners[:, 2:], corners[:, :2] + 1)
        found[f"{image_id}.jpg"] = Detections(corners, rng.uniform(0.01, 1, len(corners)), np.array(classes))
    names = {f"{image_id}.jpg": image_id for image_id in range(100, 100 + pictures)}
    return Truth({"annotations": annotations, "categories": CATEGORIES}, names, CATEGORY_OF), found


def by_pycocotools(truth: Truth, found: dict[str, Detections]) -> dict[str, float]:
    coco = COCO()
    images = [{"id": image_id} for image_id in truth.image_ids.values()]
    coco.dataset = {"images": images, **truth.coco}
    with redirect_stdout(StringIO()):
        coco.createIndex()
        rows = [
            row
            for name, each in found.items()
            for row in coco_results(each, truth.image_ids[name], truth.category_of)
        ]
        judge = COCOeval(coco, coco.loadRes(rows), "bbox")
        judge.evaluate()
        judge.accumulate()
        judge.summarize()
    return {name: float(judge.stats[place]) for name, place in COCO_SCORES.items()}


@pytest.mark.parametrize("seed", [0, 1, 2, 4])
def test_scores_are_those_of_pycocotools(seed: int) -> None:
    truth, found = street(seed)
    scores = Judge(truth)([(name, 0, each) for name, each in found.items()])
    expected = by_pycocotools(truth, found)
    assert {name: scores[name] for name in COCO_SCORES} == pytest.approx(expected, abs=1e-9)
    assert 0 < expected["ap"] < expected["ap50"] < 1
    assert len(set(expected.values())) == len(expected)


def test_pictures_that_were_not_run_do_not_count() -> None:
    truth, found = street(6)
    some = dict(list(found.items())[:5])
    kept = {truth.image_ids[name] for name in some}
    fewer = Truth(
        {**truth.coco, "annotations": [a for a in truth.coco["annotations"] if a["image_id"] in kept]},
        {name: truth.image_ids[name] for name in some},
        CATEGORY_OF,
    )
    scores = Judge(truth)([(name, 0, each) for name, each in some.items()])
    assert {n: scores[n] for n in COCO_SCORES} == pytest.approx(by_pycocotools(fewer, some), abs=1e-9)


def test_what_no_target_of_a_size_can_tell_is_none() -> None:
    large = {"id": 1, "image_id": 1, "category_id": 13, "bbox": [0, 0, 200, 200], "area": 4e4, "iscrowd": 0}
    truth = Truth({"annotations": [large], "categories": CATEGORIES}, {"p": 1, "q": 2}, CATEGORY_OF)
    right = Detections(np.array([[0, 0, 200, 200]]), np.array([0.9]), np.array([0]))
    scores = Judge(truth)([("p", 0, right)])
    assert (scores["ap"], scores["ap_large"], scores["ap_small"]) == (
        pytest.approx(1),
        pytest.approx(1),
        None,
    )
    empty = Judge(truth)([("q", 0, right)])  # a picture without targets: nothing to find, one false alarm
    assert (empty["ap"], empty["false_positives_per_image"]) == (None, 1)


def test_false_positives_by_hand() -> None:
    """Per picture, from a score of 0.25 on, of labelled classes, outside crowds, each target found once."""
    box, crowd = [10, 10, 20, 20], [100, 100, 80, 80]
    annotations = [
        {"id": 1, "image_id": 1, "category_id": 13, "bbox": box, "area": 400, "iscrowd": 0},
        {"id": 2, "image_id": 1, "category_id": 13, "bbox": crowd, "area": 6400, "iscrowd": 1},
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
    boxes, scores, classes, _ = zip(*rows, strict=True)
    found = Detections(np.array(boxes), np.array(scores), np.array(classes))
    nothing = found[np.zeros(len(found), bool)]
    got = Judge(truth)([("p", 0, found), ("q", 0, nothing)])
    assert got["false_positives_per_image"] == pytest.approx(3 / 2)
    gaps = abs(0.95 - 1) + 0.85 + 0.65 + 0.55  # one detection to a bin
    assert got["calibration_error"] == pytest.approx(gaps / 4, abs=1e-6)


def test_truth_stands_where_the_conditions_move_it() -> None:
    """All is 40 px further right, targets and crowds alike: scores as before, and none where it is not told."""
    truth, found = street(7)
    shifted = {
        n: Detections(d.boxes_xyxy + np.array([40, 0, 40, 0]), d.scores, d.class_ids)
        for n, d in found.items()
    }
    judge = Judge(truth)
    before = judge([(name, 0, each) for name, each in found.items()])
    moved = [(name, 0, each) for name, each in shifted.items()]
    after = judge(moved, lambda boxes, sizes, labels: boxes + np.array([40.0, 0.0, 40.0, 0.0]))
    assert after == pytest.approx(before, abs=1e-6)
    assert judge(moved)["ap50"] < 0.5 * before["ap50"]
    assert judge([(name, 0, each) for name, each in found.items()]) == before  # nothing stays moved


def calibration_error(scores: list[float], right: list[bool]) -> float | None:
    """Of one picture's detections."""
    alarms = Alarms(
        np.array(scores, float), np.array(right, bool), np.zeros(len(scores), np.int64), np.ones(1)
    )
    return alarms.calibration_error.value


def test_calibration_error_by_hand() -> None:
    assert calibration_error([], []) is None
    assert calibration_error([0.75] * 4, [True, True, True, False]) == pytest.approx(0)
    assert calibration_error([0.75] * 4 + [0.35] * 4, [True] * 8) == pytest.approx((0.25 + 0.65) / 2)
    # Within a bin, too sure and too unsure make up for each other; 1.0 belongs to the last.
    assert calibration_error([0.91, 1.0], [True, False]) == pytest.approx((1.91 - 1) / 2)


def test_rows_of_a_run(tmp_path: Path) -> None:
    truth = Truth(
        {
            "annotations": [
                {"id": 1, "image_id": 1, "category_id": 13, "bbox": [0, 0, 9, 9], "area": 81, "iscrowd": 0}
            ],
            "categories": CATEGORIES,
        },
        {"p": 1, "q": 2},
        CATEGORY_OF,
    )
    right = Detections(np.array([[0, 0, 9, 9]]), np.array([0.8]), np.array([0]))
    nothing = right[np.zeros(1, bool)]
    at = {"exposure_s": 0.01, "illuminance_lux": 5.0, "velocity_x_px_s": 1.0, "velocity_y_px_s": 0.0}

    def cell(
        image: str, found: Detections, confidence: float | None, error: str | None = None, **where: Any
    ) -> CellResult:
        clean = where or dict.fromkeys(at)
        shared = {"model": "m", "camera": "c", "image": image, "repeat": 0, "clean": not where, **clean}
        shared |= {"cell_id": f"{image} {where}", "blur_px": 0.01 if where else None}
        row = {**shared, "target_id": 0, "group": "g", "label": "stop sign", "confidence": confidence}
        rows = () if confidence is None else (row,)
        return CellResult({**shared, "n_targets": len(rows), "error": error}, rows, found)

    with Store(tmp_path, create=True) as store:
        store.add([cell("p", right, 0.8), cell("q", nothing, None)])
        store.add([cell("p", nothing, None, "it threw", **at), cell("q", right, None, **at)])
        clean, exposed = (each.row for each in score_rows(store, truth))
        moved: list[Any] = []

        def moves(row: Any) -> tuple[None, None]:
            moved.append(dict(row))
            return None, None

        moving = score_rows(store, truth, moves=moves)
        assert [each.row for each in moving] == [clean, exposed]
        assert [row["exposure_s"] for row in moved] == [0.01]  # original pictures do not move
    shared = ("model", *CONDITIONS, "blur_px", "n_images", "n_targets", "errors", *PICTURES)
    columns = [f"{score.name}{end}" for score in table.of_conditions() for end in ("", "_low", "_high")]
    assert tuple(clean) == tuple(exposed) == (*shared, *columns)
    assert all(clean[name] is None for name in columns if name.endswith(("_low", "_high")))  # of two pictures
    assert (clean["clean"], clean["n_images"], clean["n_targets"], clean["errors"]) == (True, 2, 1, 0)
    assert (clean["ap"], clean["target_confidence"], clean["detection_rate"]) == pytest.approx((1, 0.8, 1))
    assert clean["false_positives_per_image"] == 0
    assert clean["exact_match"] is None
    assert {name: exposed[name] for name in at} == at
    assert (exposed["ap"], exposed["errors"], exposed["false_positives_per_image"]) == (0, 1, 0.5)
    assert exposed["target_confidence"] is None
    assert moving[0].performance.value == pytest.approx(1)


def test_scores_have_intervals_over_clusters(tmp_path: Path) -> None:
    """Ten pictures in two repeats: intervals are those of the means and of COCO's averages with each left out."""
    truth, found = street(9, 10)
    at = {"exposure_s": 0.01, "illuminance_lux": 5.0, "velocity_x_px_s": 1.0, "velocity_y_px_s": 0.0}
    rng = np.random.default_rng(3)
    confidence = {name: rng.uniform(size=rng.integers(1, 5)).round(3) for name in found}
    cells = []
    for repeat in range(2):
        for name, detections in found.items():
            shared = {"cell_id": f"{name}{repeat}", "model": "m", "image": name, "repeat": repeat}
            shared |= {"clean": False, **at}
            rows = tuple(
                {**shared, "target_id": place, "group": "g", "confidence": float(value)}
                for place, value in enumerate(confidence[name])
            )
            cells.append(CellResult(shared, rows, detections))
    with Store(tmp_path, create=True) as store:
        store.add(cells)
        ((row, whole, *_),) = score_rows(store, truth)
        ((few, *_),) = score_rows(store, truth, cluster=r"(\d)\.jpg$")
        ((one, *_),) = score_rows(store, truth, cluster="jpg")
    sums, counts = [np.array([f(confidence[name]) for name in sorted(found)]) for f in (np.sum, len)]
    expected = uncertainty.of_level(sums.sum() / counts.sum(), uncertainty.influence(sums, counts))
    np.testing.assert_allclose((row["target_confidence_low"], row["target_confidence_high"]), expected)
    judge = Judge(truth)
    once = [(name, 0, each) for name, each in sorted(found.items())]
    ap = judge([*once, *once])["ap"]
    without = [judge([each for each in once if each[0] != name])["ap"] for name in sorted(found)]
    assert whole.value == row["ap"] == pytest.approx(ap, abs=1e-6)
    np.testing.assert_allclose(whole.influence, uncertainty.left_out([ap, *without]).influence, atol=1e-4)
    assert 0 <= row["ap_low"] < row["ap"] < row["ap_high"] <= 1
    for name in ("detection_rate", "false_positives_per_image", "ar100"):
        assert row[f"{name}_low"] < row[name] < row[f"{name}_high"], name
    assert row["exact_match_low"] is row["calibration_error_low"] is None
    assert few["ap_low"] == row["ap_low"]  # the pattern tells every picture apart
    assert one["ap"] == row["ap"]
    assert one["ap_low"] is None  # one cluster


def test_rows_of_a_reader(tmp_path: Path) -> None:
    at = {"exposure_s": 0.01, "illuminance_lux": 5.0, "velocity_x_px_s": 1.0, "velocity_y_px_s": 0.0}
    shared = {"cell_id": "x", "model": "m", "image": "p", "repeat": 0, "clean": False, **at}
    read = [("STOP", 0.9, 0.0), ("STOO", 0.8, 0.25), ("", 0.0, 1.0), ("STOP", 0.5, 0.0), ("STP", 0.8, 0.25)]
    rows = tuple(
        {**shared, "target_id": place, "group": "g", "confidence": sure if text == "STOP" else 0.0}
        | {"truth": "STOP", "text": text, "read_confidence": sure, "character_error_rate": error}
        for place, (text, sure, error) in enumerate(read)
    )
    nothing = Detections(np.zeros((0, 4)), np.zeros(0), np.zeros(0))
    with Store(tmp_path, create=True) as store:
        store.add([CellResult(shared, rows, nothing)])
        ((row, exact, *_),) = score_rows(store, None)
    assert (row["exact_match"], row["read_confidence"]) == pytest.approx((0.4, 0.6))
    assert row["character_error_rate"] == pytest.approx(1.5 / 5)
    assert (row["target_confidence"], row["detection_rate"]) == pytest.approx((0.28, 0.4))
    assert row["ap"] is None
    assert exact.value == 0.4


def test_a_new_score_is_one_entry(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With its function it has columns and, with a name as a criterion, is what ``--score`` takes."""
    alarms = table.Score("alarms", "Alarms", table.DETECTOR, lambda judged: 7.0, "lower", "count")
    doubled = table.Score(
        "half",
        "Half",
        table.DETECTOR,
        of_targets=lambda rows: rows.confidence / 2,
        criterion=("half", "half"),
    )
    monkeypatch.setattr(table, "SCORES", (*table.SCORES, alarms, doubled))
    target = {"model": "m", "image": "p", "repeat": 0, "clean": True, "target_id": 0, "group": "g"}
    with Store(tmp_path, create=True) as store:
        cell = {"cell_id": "c", "model": "m", "image": "p", "repeat": 0, "clean": True, "n_targets": 1}
        rows = ({**target, "cell_id": "c", "label": "x", "confidence": 0.8},)
        store.add([CellResult(cell, rows, Detections(np.zeros((0, 4)), np.zeros(0), np.zeros(0)))])
        ((row, *_),) = score_rows(store, None)
    assert (row["alarms"], row["half"]) == (7.0, 0.4)
    assert "half" in criterion.names("detector")
    assert "alarms" not in criterion.names("detector")
    assert criterion.Criterion(0.9, kept=True, score="half").text == "keeps 0.9 of its half"
