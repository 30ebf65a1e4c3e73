"""Which detection answers for which target, where the exposure has moved it."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from blurnoise_eval.datasets import Picture, Target
from blurnoise_eval.detectors.ocr import Reading
from blurnoise_eval.detectors.records import Detections
from blurnoise_eval.scoring import matching
from blurnoise_eval.scoring.boxes import iou, xywh
from blurnoise_eval.scoring.matching import Targets, matched, target_confidences
from blurnoise_eval.scoring.on_picture import ModelOnPicture
from coco_oracle import hits
from signs_in_memory import BOX as SIGN
from signs_in_memory import sign

BOX = (10.0, 20.0, 30.0, 60.0)  # 20 x 40 px


def detections(*rows):
    boxes, scores, class_ids = zip(*rows, strict=True) if rows else ((), (), ())
    return Detections(np.array(boxes), np.array(scores), np.array(class_ids))


def confidence(found, class_id):
    return float(target_confidences(found, [BOX], [class_id])[0])


def test_half_an_overlap_is_enough_and_less_is_not():
    assert confidence(detections(((10, 20, 30, 40), 0.8, 0)), 0) == pytest.approx(0.8)
    assert confidence(detections(((10, 20, 30, 39.9), 0.8, 0)), 0) == 0.0


def matches(found, targets_xyxy):
    """Of the detections of class 0, in one picture."""
    own = found.boxes_xyxy[found.class_ids == 0]
    sides = xywh(targets_xyxy).tolist()
    targets = Targets.of([[{"category_id": 7, "bbox": box, "area": box[2] * box[3]} for box in sides]])
    keys, target_keys = np.zeros(len(own), int), np.zeros(len(targets.picture), int)
    taken, beside = matched(keys, xywh(own), target_keys, targets, targets.crowd[None], np.array([0.5]))
    assert not beside.any()
    every: list[bool] = taken[0, 0].tolist()
    return every


@pytest.mark.parametrize("seed", range(3))
def test_matches_are_those_of_a_search_box_by_box(seed):
    """With targets that overlap each other, so that detections have a choice."""
    rng = np.random.default_rng(seed)
    for _ in range(20):
        targets = _near(rng, 5) * [0.4, 0.4, 1, 1]
        targets[:, 2:] = np.maximum(targets[:, 2:], targets[:, :2] + 10)
        boxes = (targets + rng.normal(0, 6, (6, 1, 4))).reshape(-1, 4)
        boxes[:, 2:] = np.maximum(boxes[:, 2:], boxes[:, :2] + 1)
        found = Detections(boxes, np.linspace(0.9, 0.1, len(boxes)), np.zeros(len(boxes), int))
        assert matches(found, targets) == hits(found, targets, 0).tolist()


def test_targets_are_held_against_any_number_of_boxes(monkeypatch):
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


def _near(rng, count):
    corners = rng.uniform(0, 100, (count, 2))
    return np.concatenate([corners, corners + rng.uniform(30, 50, (count, 2))], axis=1)


SHIFT_PX = 15
MOVED = (SIGN[0] + SHIFT_PX, SIGN[1], SIGN[2] + SHIFT_PX, SIGN[3])


def to_the_right(boxes, sizes_px, labels):
    assert boxes.shape == (1, 4)
    assert len(labels) == 1
    assert sizes_px.shape == (1, 2)
    return boxes + np.array([SHIFT_PX, 0, SHIFT_PX, 0])


@pytest.mark.parametrize("labelled", [True, False], ids=["labelled", "found when clean"])
def test_a_detector_is_held_against_moved_targets(detector, labelled):
    targets = (Target("stop sign", "signs", SIGN),) if labelled else None
    seen = ModelOnPicture(detector, Picture("p", targets, sign, "p"), sign())
    (clean,), (missed,) = seen.clean.targets, seen.evaluate(sign(right_px=SHIFT_PX)).targets
    (found,) = seen.evaluate(sign(right_px=SHIFT_PX), to_the_right).targets
    assert clean.confidence > 0.8
    assert missed.confidence < 0.3
    assert found.confidence == pytest.approx(clean.confidence, abs=0.1)
    assert missed.box_xyxy == clean.box_xyxy
    assert found.box_xyxy == pytest.approx(
        [edge + d for edge, d in zip(clean.box_xyxy, (15, 0, 15, 0), strict=True)]
    )
    assert found.width_px == pytest.approx(clean.width_px)
    (again,) = seen.evaluate(
        sign(right_px=SHIFT_PX)
    ).targets  # where targets stand is kept for one motion, not for all
    assert again == replace(missed, confidence=again.confidence)
    swept = seen.evaluate(sign(), None, to_the_right).targets[0]
    assert (swept.box_xyxy, swept.confidence) == (clean.box_xyxy, clean.confidence)
    assert swept.confidence_swept < 0.3


class Asked:
    """A reader that notes where it is asked to read."""

    name, sha256, non_finite_values_here, contract, path = "reader", "0" * 64, 0, None, Path("reader.onnx")

    def __init__(self):
        self.boxes: list[Any] = []

    def read(self, image, boxes_xyxy):
        self.boxes.append([tuple(box) for box in boxes_xyxy])
        return [Reading("STOP", 0.9) for _ in boxes_xyxy]


def test_a_reader_reads_where_the_targets_stand():
    reader = Asked()
    seen = ModelOnPicture(
        reader, Picture("p", (Target("text", "texts", SIGN, text="STOP"),), sign, "p"), sign()
    )
    (row,) = seen.evaluate(sign(right_px=SHIFT_PX), to_the_right).targets
    assert reader.boxes == [[SIGN], [MOVED]]
    assert (row.box_xyxy, row.confidence) == (MOVED, 0.9)
