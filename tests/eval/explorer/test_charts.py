"""Boxes and charts: what they show, and that names from files are only ever text."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np
from blurnoise_eval.detectors.records import Detections
from blurnoise_eval.explorer import charts
from blurnoise_eval.explorer.charts import boxes
from blurnoise_eval.explorer.rendered import Point
from blurnoise_eval.explorer.state import control
from blurnoise_eval.scoring.on_picture import ModelOutput

from blurnoise import Camera

IMX250 = Camera.preset("imx250")
HOSTILE = "</text><script>alert(1)</script>"


def row(x: float, confidence: float, text: str | None = None) -> dict[str, object]:
    place = {"x0": x, "y0": 20.0, "x1": x + 30, "y1": 50.0, "width_px": 30.0, "height_px": 30.0}
    return {**place, "confidence": confidence, "text": text}


def found(*targets: dict[str, object]) -> ModelOutput:
    places = np.array([[0, 0, 9, 9], [60, 20, 90, 50]], np.float32)
    detections = Detections(places, np.array([0.9, 0.8], np.float32), np.array([0, 0]))
    return ModelOutput(detections, targets, 1.0, None, 0)


def test_boxes_are_found_missed_or_others() -> None:
    svg = boxes(found(row(10, 0.7), row(60, 0.2)), (80, 120), 0.6, ["sign"])
    tree = ET.fromstring(svg)
    assert tree.get("viewBox") == "0 0 120 80"  # whatever lies below
    assert [each.get("class") for each in tree] == ["other", "found", "missed"]
    assert [each.findtext("text") for each in tree] == ["sign 0.90", "0.70", "0.20"]
    assert boxes(None, (80, 120), 0.6) == ""


def test_names_are_text() -> None:
    svg = boxes(found(row(10, 0.7, HOSTILE)), (80, 120), 0.6, [HOSTILE])
    assert "<script" not in svg
    ET.fromstring(svg)


def test_a_chart_of_scores_has_a_point_for_each_value_that_was_tried() -> None:
    along = control("exposure_s", IMX250)
    curve = [Point(value, (0.9, 0.3 * place)) for place, value in enumerate(along.places(4))]
    (mean,) = charts.scores(curve, along, 20.0, 0.6, (1.0, 50.0))["series"]
    assert mean["data"] == [[point.value, point.mean] for point in curve]
    assert mean["markArea"]["data"] == [[{"xAxis": 1.0}, {"xAxis": 50.0}]]
    assert [next(iter(line)) for line in mean["markLine"]["data"]] == ["yAxis", "xAxis"]
    assert len(charts.scores([], along, float("nan"), 0.6, None)["series"][0]["markLine"]["data"]) == 1
