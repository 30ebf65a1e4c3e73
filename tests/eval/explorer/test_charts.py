"""Boxes and the curve: what they show, and that names from files are only ever text."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from types import SimpleNamespace
from typing import Any

import numpy as np
from blurnoise_eval.detectors.records import Detections
from blurnoise_eval.explorer import charts
from blurnoise_eval.explorer.rendered import Point
from blurnoise_eval.scoring.on_picture import ModelOutput

HOSTILE = "</text><script>alert(1)</script>"


def row(x: float, confidence: float) -> dict[str, object]:
    place = {"x0": x, "y0": 20.0, "x1": x + 30, "y1": 50.0, "width_px": 30.0, "height_px": 30.0}
    return {**place, "confidence": confidence}


def drawn(classes: tuple[str, ...], *targets: dict[str, object]) -> ET.Element:
    places = np.array([[0, 0, 9, 9], [60, 20, 90, 50]], np.float32)
    detections = Detections(places, np.array([0.9, 0.8], np.float32), np.array([0, 0]))
    found: Any = SimpleNamespace(classes=classes, frame=SimpleNamespace(image=np.zeros((80, 120, 3))))
    return ET.fromstring(charts.boxes(found, ModelOutput(detections, targets, 1.0, None, 0)))


def test_boxes_are_found_missed_or_others() -> None:
    tree = drawn(("sign",), row(10, 0.7), row(60, 0.2))
    assert tree.get("viewBox") == "0 0 120 80"  # whatever lies below
    assert [each.get("class") for each in tree] == ["other", "found", "missed"]
    assert [each.findtext("text") for each in tree] == ["sign 0.90", "0.70", "0.20"]


def test_names_are_text() -> None:
    assert drawn((HOSTILE,))[0].findtext("text") == f"{HOSTILE[:24]} 0.90"


def test_the_curve_has_a_point_for_each_exposure_that_was_tried() -> None:
    curve = [Point(exposure_ms, mean) for exposure_ms, mean in ((1.0, 0.2), (4.0, 0.8), (16.0, 0.9))]
    (mean,) = charts.confidences(curve, 20.0, 0.5)["series"]
    assert mean["data"] == [[1.0, 0.2], [4.0, 0.8], [16.0, 0.9]]
    ((low, high),) = mean["markArea"]["data"]
    assert abs(low["xAxis"] - 2.0) < 1e-9
    assert high["xAxis"] == 16.0
