"""Which detection answers for which target, average precision as COCO has it, and curves."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from blurnoise_eval.detectors.records import Detections
from blurnoise_eval.scoring import matching
from blurnoise_eval.scoring.boxes import iou, xywh
from blurnoise_eval.scoring.matching import Targets, matched, target_confidences
from coco_oracle import hits
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

BOX = (10.0, 20.0, 30.0, 60.0)  # 20 x 40 px


def detections(*rows: tuple[tuple[float, float, float, float], float, int]) -> Detections:
    boxes, scores, class_ids = zip(*rows, strict=True) if rows else ((), (), ())
    return Detections(np.array(boxes), np.array(scores), np.array(class_ids))


def confidence(found: Detections, class_id: int) -> float:
    return float(target_confidences(found, [BOX], [class_id])[0])


def annotations(boxes_xyxy: Any) -> list[dict[str, Any]]:
    return [{"category_id": 7, "bbox": box, "area": box[2] * box[3]} for box in xywh(boxes_xyxy).tolist()]


@pytest.mark.parametrize(
    ("other", "expected"),
    [
        (BOX, 1.0),
        ((10, 20, 30, 40), 0.5),  # its upper half
        ((20, 20, 40, 60), 1 / 3),  # half a width aside: 400 of 1200 px^2
        ((20, 40, 40, 80), 200 / 1400),  # a quarter shared
        ((30, 20, 50, 60), 0.0),  # edge to edge
        ((0, 0, 5, 5), 0.0),
        ((15, 30, 15, 30), 0.0),  # without area
    ],
)
def test_iou_by_hand(other: tuple[float, ...], expected: float) -> None:
    assert iou([other], [BOX])[0, 0] == pytest.approx(expected, abs=1e-6)
    assert iou([BOX], [other])[0, 0] == pytest.approx(expected, abs=1e-6)


edges = st.tuples(*[st.integers(0, 50)] * 4).map(
    lambda e: (min(e[0], e[2]), min(e[1], e[3]), max(e[0], e[2]), max(e[1], e[3]))
)


@given(edges, edges, st.integers(-1000, 1000))
def test_iou_lies_in_0_to_1_and_ignores_the_origin(
    a: tuple[int, ...], b: tuple[int, ...], shift: int
) -> None:
    found = float(iou([a], [b])[0, 0])
    assert 0 <= found <= 1
    moved = float(iou(np.array([a]) + shift, np.array([b]) + shift)[0, 0])
    assert moved == pytest.approx(found, abs=1e-6)


def test_highest_score_of_the_right_class_and_place() -> None:
    found = detections(
        (BOX, 0.4, 1),
        ((11, 21, 31, 61), 0.7, 1),
        (BOX, 0.9, 0),  # another class
        ((40, 20, 60, 60), 0.95, 1),  # another place
    )
    assert confidence(found, 1) == pytest.approx(0.7)
    assert confidence(found, 2) == 0.0
    assert confidence(detections(), 1) == 0.0


def test_half_an_overlap_is_enough_and_less_is_not() -> None:
    assert confidence(detections(((10, 20, 30, 40), 0.8, 0)), 0) == pytest.approx(0.8)
    assert confidence(detections(((10, 20, 30, 39.9), 0.8, 0)), 0) == 0.0


def matches(found: Detections, targets_xyxy: Any) -> list[bool]:
    """Of the detections of class 0, in one picture."""
    own = found.boxes_xyxy[found.class_ids == 0]
    targets = Targets.of([annotations(targets_xyxy)])
    keys, target_keys = np.zeros(len(own), int), np.zeros(len(targets.picture), int)
    taken, beside = matched(keys, xywh(own), target_keys, targets, targets.crowd[None], np.array([0.5]))
    assert not beside.any()
    every: list[bool] = taken[0, 0].tolist()
    return every


def test_a_target_takes_one_detection_and_a_detection_the_target_it_fits_best() -> None:
    beside = (10.0, 25.0, 30.0, 65.0)  # overlaps BOX by 7/9
    found = detections((BOX, 0.9, 0), (BOX, 0.8, 0), (beside, 0.7, 0), (BOX, 0.95, 1), (beside, 0.6, 0))
    for targets, expected in (
        ([BOX], [True, False, False, False]),
        ([BOX, beside], [True, True, False, False]),
        (np.zeros((0, 4)), [False] * 4),
    ):
        assert matches(found, targets) == hits(found, targets, 0).tolist() == expected
    assert matches(detections(), [BOX]) == []


@pytest.mark.parametrize("seed", range(3))
def test_matches_are_those_of_a_search_box_by_box(seed: int) -> None:
    """With targets that overlap each other, so that detections have a choice."""
    rng = np.random.default_rng(seed)
    for _ in range(20):
        targets = _near(rng, 5) * [0.4, 0.4, 1, 1]
        targets[:, 2:] = np.maximum(targets[:, 2:], targets[:, :2] + 10)
        boxes = (targets + rng.normal(0, 6, (6, 1, 4))).reshape(-1, 4)
        boxes[:, 2:] = np.maximum(boxes[:, 2:], boxes[:, :2] + 1)
        found = Detections(boxes, np.linspace(0.9, 0.1, len(boxes)), np.zeros(len(boxes), int))
        assert matches(found, targets) == hits(found, targets, 0).tolist()


def test_targets_are_held_against_any_number_of_boxes(monkeypatch: pytest.MonkeyPatch) -> None:
    """In pieces of a few boxes as all at once: the highest score of the class from an IoU of 0.5 on."""
    rng = np.random.default_rng(2)
    targets = _near(rng, 3)
    boxes = np.concatenate([targets + rng.normal(0, 6, (40, 1, 1)) for _ in range(2)]).reshape(-1, 4)
    found = Detections(boxes, rng.uniform(0, 1, len(boxes)), rng.integers(0, 2, len(boxes)))
    ids = [0, 1, 1]
    right = (iou(found.boxes_xyxy, targets) >= 0.5) & (found.class_ids[:, None] == ids)
    expected = np.where(right, found.scores[:, None], 0).max(axis=0)
    assert expected.min() > 0
    for pairs in (1, 7, 1 << 14):
        monkeypatch.setattr(matching, "_PAIRS", pairs)
        np.testing.assert_array_equal(target_confidences(found, targets.tolist(), ids), expected)


def _near(rng: np.random.Generator, count: int) -> NDArray[np.float64]:
    corners = rng.uniform(0, 100, (count, 2))
    return np.concatenate([corners, corners + rng.uniform(30, 50, (count, 2))], axis=1)
