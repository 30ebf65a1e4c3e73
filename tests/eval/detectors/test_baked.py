"""Limits baked into a graph, found in its answers: scores and number, known by construction."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from blurnoise_eval.detectors.baked import baked, baked_text
from blurnoise_eval.detectors.contract import Contract
from blurnoise_eval.detectors.detector import Detector
from constant_graphs import answering_graph
from numpy.typing import NDArray

SIZE_PX = (64, 96)
BOXES = np.array([[0, 0, 20, 10], [10, 0, 30, 10], [10, 0, 30, 10], [50, 30, 90, 60], [0, 0, 0, 0]], float)
SCORES = np.array([0.9, 0.5, 0.8, 0.3, 0.0])  # of a white picture; the last row is padding


def end_to_end(path: Path, nms_iou: float | None = None) -> Detector:
    """[1, 5, 6]: scores grow with the picture's mean."""
    base, gain = np.zeros((1, 5, 6)), np.zeros((1, 5, 6))
    base[0, :, :4], gain[0, :, 4] = BOXES, SCORES
    answering_graph(path, {"output0": (base, gain)}, [1, 3, *SIZE_PX])
    return Detector(path, contract=Contract("yolov10", ("a", "b"), resize="stretch", nms_iou=nms_iou))


def grey(value: int) -> NDArray[np.uint8]:
    return np.full((*SIZE_PX, 3), value, np.uint8)


def test_limits_are_those_of_the_answers(tmp_path: Path) -> None:
    found = baked(end_to_end(tmp_path / "m.onnx"), [grey(255), grey(153)])
    assert found is not None
    assert (found["pictures"], found["most_boxes"]) == (2, 4)
    assert found["lowest_score"] == pytest.approx(0.6 * 0.3, rel=1e-4)
    assert "in 2 pictures no score below 0.18, at most 4 boxes" in baked_text(found)


def test_what_drops_nothing_itself_has_none_and_nothing_found_says_so(tmp_path: Path) -> None:
    assert baked(end_to_end(tmp_path / "m.onnx", nms_iou=0.6), [grey(255)]) is None
    nothing = baked(end_to_end(tmp_path / "m.onnx"), [grey(0)])
    assert nothing == {"pictures": 1, "lowest_score": None, "most_boxes": 0}
    assert baked_text(nothing) == "no answers in 1 pictures"
