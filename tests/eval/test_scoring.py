"""Which detection answers for which target."""

from __future__ import annotations

import numpy as np
import pytest
from blurnoise_eval.records import Detections
from blurnoise_eval.scoring import iou, target_confidence
from hypothesis import given
from hypothesis import strategies as st

BOX = (10.0, 20.0, 30.0, 60.0)  # 20 x 40 px


def detections(*rows: tuple[tuple[float, float, float, float], float, int]) -> Detections:
    boxes, scores, class_ids = zip(*rows, strict=True) if rows else ((), (), ())
    return Detections(np.array(boxes), np.array(scores), np.array(class_ids))


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
    assert iou(np.array([other], np.float32), BOX)[0] == pytest.approx(expected, abs=1e-6)
    assert iou(np.array([BOX], np.float32), other)[0] == pytest.approx(expected, abs=1e-6)


def test_iou_of_two_empty_boxes_and_of_none() -> None:
    assert iou(np.array([[5, 5, 5, 5]], np.float32), (5, 5, 5, 5)).tolist() == [0.0]
    assert iou(np.zeros((0, 4), np.float32), BOX).shape == (0,)


edges = st.tuples(*[st.integers(0, 50)] * 4).map(
    lambda e: (min(e[0], e[2]), min(e[1], e[3]), max(e[0], e[2]), max(e[1], e[3]))
)


@given(edges, edges, st.integers(-1000, 1000))
def test_iou_lies_in_0_to_1_and_ignores_the_origin(
    a: tuple[int, ...], b: tuple[int, ...], shift: int
) -> None:
    found = float(iou(np.array([a], np.float32), b)[0])
    assert 0 <= found <= 1
    moved = float(iou(np.array([a], np.float32) + shift, [edge + shift for edge in b])[0])
    assert moved == pytest.approx(found, abs=1e-6)


def test_highest_score_of_the_right_class_and_place() -> None:
    found = detections(
        (BOX, 0.4, 1),
        ((11, 21, 31, 61), 0.7, 1),
        (BOX, 0.9, 0),  # another class
        ((40, 20, 60, 60), 0.95, 1),  # another place
    )
    assert target_confidence(found, BOX, 1) == pytest.approx(0.7)
    assert target_confidence(found, BOX, 2) == 0.0
    assert target_confidence(detections(), BOX, 1) == 0.0


def test_half_an_overlap_is_enough_and_less_is_not() -> None:
    assert target_confidence(detections(((10, 20, 30, 40), 0.8, 0)), BOX, 0) == pytest.approx(0.8)
    assert target_confidence(detections(((10, 20, 30, 39.9), 0.8, 0)), BOX, 0) == 0.0
