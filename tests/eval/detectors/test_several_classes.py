"""Several classes of one box: in what is counted, as each family's evaluator does, and in a target's confidence."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from blurnoise_eval.datasets import Picture, Target
from blurnoise_eval.detectors.contract import Contract
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.detectors.formats import FAMILIES
from blurnoise_eval.detectors.formats.boxes import Candidates, best_class, suppress
from blurnoise_eval.scoring.on_picture import View
from constant_graphs import constant_graph
from numpy.typing import NDArray

SIZE_PX, NAMES = (64, 96), ("lorry", "car", "bus")
CELLS = 8 * 12 + 4 * 6 + 2 * 3
HEADS = ("yolofastestv2", "anchors")


def constant_detector(path: Path, family: str, answer: NDArray[np.float32]) -> Detector:
    """A graph that answers the same to every picture."""
    constant_graph(path, [answer[None]], SIZE_PX)
    return Detector(path, contract=Contract(family, NAMES, resize="stretch", nms_iou=0.5))


def boxes_with_scores(
    family: str, boxes_cxcywh: NDArray[np.float64], scores: NDArray[np.float64]
) -> NDArray[np.float32]:
    """An answer in the family's layout that holds these boxes (N, 4), px, with class scores (N, 3)."""
    rows = np.zeros((3 * CELLS if family == "yolov5" else CELLS, 8), np.float32)
    rows[:, 4] = 1 if family == "yolov6" else 0
    count = len(scores)
    rows[:count, :4], rows[:count, 4], rows[:count, 5:] = boxes_cxcywh, 1, scores
    if family == "yolox":  # the first cells are those of stride 8, row by row
        column_row = np.stack([np.arange(count) % 12, np.arange(count) // 12], axis=1)
        rows[:count, :2] = boxes_cxcywh[:, :2] / 8 - column_row
        rows[:count, 2:4] = np.log(boxes_cxcywh[:, 2:] / 8)
    return np.delete(rows, 4, axis=1).T.copy() if family == "yolov8" else rows


TWO = np.array([[0.6, 0.5, 0.0005]])
"""A lorry that is nearly as much a car."""
PLACE = np.array([[50.0, 30.0, 20.0, 10.0]])


@pytest.mark.parametrize(
    ("family", "several"), [("yolov8", True), ("yolov5", True), ("yolov6", True), ("yolox", False)]
)
def test_boxes_count_with_as_many_classes_as_the_family_s_evaluator_counts(
    family: str, several: bool, tmp_path: Path
) -> None:
    detector = constant_detector(tmp_path / "m.onnx", family, boxes_with_scores(family, PLACE, TWO))
    found = detector.detect(np.zeros((*SIZE_PX, 3), np.uint8))
    assert found.class_ids.tolist() == ([0, 1] if several else [0])
    np.testing.assert_allclose(found.scores, [0.6, 0.5][: len(found)], rtol=1e-6)
    np.testing.assert_allclose(found.boxes_xyxy, [[40, 25, 60, 35]] * len(found), rtol=1e-5)
    assert found.leading.class_ids.tolist() == [0]


@pytest.mark.parametrize("family", ["yolov8", "yolox", "yolov5"])
@pytest.mark.parametrize("leading", [0.4999, 0.5001, 0.9])
def test_a_target_s_confidence_is_its_own_class_s_whichever_leads(
    family: str, leading: float, tmp_path: Path
) -> None:
    """No jump where the lorry's score passes the car's, which is 0.5 throughout."""
    scores = np.array([[leading, 0.5, 0.0005]])
    detector = constant_detector(tmp_path / "m.onnx", family, boxes_with_scores(family, PLACE, scores))
    image = np.zeros((*SIZE_PX, 3), np.uint8)
    picture = Picture("p", (Target("car", "cars", (40.0, 25.0, 60.0, 35.0)),), lambda: image, "p")
    sight = View(detector, picture, image).clean
    assert sight.targets[0]["confidence"] == pytest.approx(0.5, rel=1e-5)


def evaluated(
    boxes: NDArray[np.float64], scores: NDArray[np.float64], iou: float, most: int
) -> set[tuple[int, int]]:
    """Boxes and classes that a plain evaluator with several classes a box keeps: one by one, the best first."""
    pairs = [(scores[b, c], b, c) for b in range(len(boxes)) for c in range(3) if scores[b, c] >= 0.001]
    kept: list[tuple[int, int]] = []
    for _, b, c in sorted(pairs, key=lambda pair: -pair[0]):
        if len(kept) < most and all(c != d or overlap(boxes[b], boxes[a]) <= iou for a, d in kept):
            kept.append((b, c))
    return set(kept)


def overlap(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    (ax, ay, aw, ah), (bx, by, bw, bh) = a, b
    width = min(ax + aw / 2, bx + bw / 2) - max(ax - aw / 2, bx - bw / 2)
    height = min(ay + ah / 2, by + bh / 2) - max(ay - ah / 2, by - bh / 2)
    shared = max(width, 0) * max(height, 0)
    return float(shared / (aw * ah + bw * bh - shared))


@pytest.mark.parametrize("most", [7, 40, 300])
@pytest.mark.parametrize("family", ["yolov8", "yolov5"])
def test_what_is_kept_is_what_a_plain_evaluator_keeps(family: str, most: int, tmp_path: Path) -> None:
    rng = np.random.default_rng(most)
    boxes = np.concatenate([rng.uniform((20, 20), (76, 44), (60, 2)), rng.uniform(8, 24, (60, 2))], axis=1)
    boxes = np.round(boxes, 3)
    scores = rng.uniform(0, 1, (60, 3)).astype(np.float32) ** 6  # a third below the threshold
    detector = constant_detector(tmp_path / "m.onnx", family, boxes_with_scores(family, boxes, scores))
    found = detector.detect(np.zeros((*SIZE_PX, 3), np.uint8), max_detections=most)
    expected = evaluated(boxes, scores, 0.5, most)
    assert len(found) == len(expected)
    assert sorted(found.scores.tolist()) == pytest.approx(sorted(float(scores[pair]) for pair in expected))
    leading = {(b, c) for b, c in expected if c == scores[b].argmax()}
    assert sorted(found.leading.scores.tolist()) == pytest.approx(
        sorted(float(scores[pair]) for pair in leading)
    )


def test_every_family_says_what_its_evaluator_counts() -> None:
    several = {family.name for family in FAMILIES.values() if family.several_classes}
    assert several == {"yolov5", "yolov6", "yolov8", "nanodet", "nanodetplus", "rfdetr", *HEADS}


def test_what_is_left_out_below_a_score_changes_nothing_above_it() -> None:
    """300 boxes about 12 places, 5 classes: doubles are there to suppress, with equal scores among them."""
    rng = np.random.default_rng(3)
    corners = rng.uniform(0, 90, (12, 2))[rng.integers(0, 12, 300)] + rng.normal(0, 4, (300, 2))
    boxes = np.concatenate([corners, corners + rng.uniform(20, 40, (300, 2))], axis=1).astype(np.float32)
    each = (rng.uniform(0, 1, (300, 5)).round(2) ** 2).astype(np.float32)
    candidates = Candidates(boxes, *best_class(each), each)
    asked, above = np.array([1, 4]), np.array([0.3, 0.0], np.float32)
    every = suppress(candidates.with_classes(0.01, asked), 0.5, 200, per_class=100)
    some = suppress(candidates.with_classes(0.01, asked, above), 0.5, 200, per_class=100)
    higher = every[every.scores > np.where(every.class_ids == 1, above[0], above[1])]
    assert 20 < len(some) == len(higher) < len(every)
    assert (some.class_ids == 1).any()
    np.testing.assert_array_equal(some.boxes_xyxy, higher.boxes_xyxy)
    np.testing.assert_array_equal(some.scores, higher.scores)
    np.testing.assert_array_equal(some.class_ids, higher.class_ids)
