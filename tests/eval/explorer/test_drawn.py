"""Drawings: what they show, and that names from files are only ever text."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pytest
from blurnoise_eval.detectors.records import Detections
from blurnoise_eval.explorer import drawn, words
from blurnoise_eval.explorer.controls import control
from blurnoise_eval.explorer.judging import Standard, Stop
from blurnoise_eval.explorer.runs import HeatMap
from blurnoise_eval.grid.axes import axis
from blurnoise_eval.scoring.criterion import Criterion
from blurnoise_eval.scoring.on_picture import Sight

from blurnoise import Camera, plan

IMX250 = Camera.preset("imx250")
HOSTILE = "</text><script>alert(1)</script>"


def row(x: float, confidence: float, text: str | None = None) -> dict[str, object]:
    place = {"x0": x, "y0": 20.0, "x1": x + 30, "y1": 50.0, "width_px": 30.0, "height_px": 30.0}
    return {**place, "confidence": confidence, "text": text}


def found(*targets: dict[str, object]) -> Sight:
    places = np.array([[0, 0, 9, 9], [60, 20, 90, 50]], np.float32)
    detections = Detections(places, np.array([0.9, 0.8], np.float32), np.array([0, 0]))
    return Sight(detections, targets, 1.0, None, 0)


def test_boxes_are_found_missed_or_others() -> None:
    svg = drawn.boxes(found(row(10, 0.7), row(60, 0.2)), (80, 120), 0.6, ["sign"])
    tree = ET.fromstring(svg)
    assert [each.get("class") for each in tree] == ["other", "found", "missed"]
    assert [each.findtext("text") for each in tree] == ["sign 0.90", "0.70", "0.20"]
    assert drawn.boxes(None, (80, 120), 0.6) == ""


def test_names_are_text() -> None:
    svg = drawn.boxes(found(row(10, 0.7, HOSTILE)), (80, 120), 0.6, [HOSTILE])
    assert "<script" not in svg
    ET.fromstring(svg)


def test_a_strip_has_a_dot_for_each_value_that_was_had() -> None:
    along = control("exposure_s", IMX250)
    curve = [Stop(value, (0.9, 0.3)) for value in along.stops(4)] + [Stop(900.0)]
    tree = ET.fromstring(drawn.strip(curve, along, 20.0, 0.6, (1.0, 50.0)))
    dots = [each for each in tree if each.tag == "circle"]
    assert [each.get("class") for each in dots] == ["dot"] * 4
    assert len([each for each in tree if each.get("class") == "target"]) == 2
    lines = {each.get("class"): each for each in tree if each.tag == "line"}
    xs = [float(str(each.get("cx"))) for each in dots]
    assert xs[0] < float(str(lines["here"].get("x1"))) < xs[-1]
    ticks = [each.text for each in tree if each.tag == "text"]
    assert [each for each in ticks if each in ("0.1", "1", "10", "100")] == ["1", "0.1", "1", "10", "100"]
    ET.fromstring(drawn.strip([], along, math.inf, 0.6, None))


@pytest.mark.parametrize(
    ("held", "told"),
    [
        ((0.9, 0.9, 0.9), "the mean is 0.60 or more anywhere along the strip; most, 0.90 at 1.64 ms."),
        (
            (0.1, 0.9, 0.1),
            "the mean is 0.60 or more from about 0.15 to 17 ms, not here; most, 0.90 at 1.64 ms.",
        ),
        ((0.9, 0.8, 0.1), "the mean is 0.60 or more up to about 9.9 ms, not here; most, 0.90 at 0.003 ms."),
        (
            (0.1, 0.2, 0.1),
            "None of the 3 values of exposure tried brings the mean to 0.60; most is 0.20 at 1.64 ms.",
        ),
    ],
)
def test_the_sentence_of_a_strip(held: tuple[float, ...], told: str) -> None:
    along = control("exposure_s", IMX250)
    curve = [Stop(value, (each,)) for value, each in zip(along.stops(3), held, strict=True)]
    standard = Standard(Criterion(0.6, kept=False), frozenset(), 1.0)
    assert words.window(curve, along, 20.0, standard).removeprefix("Exposure: ") == told


def test_a_heat_map_has_a_button_for_each_cell_that_was_computed() -> None:
    light = replace(axis("illuminance_lux"), title="<i>light</i>")
    found = HeatMap(axis("exposure_s"), light, (0.01, math.inf), (1.0,), ((0.25, None),), ())
    tree = ET.fromstring(drawn.heat_map(found, "0,0"))
    (button,) = tree.iter("button")
    assert (button.text, button.get("data-place"), button.get("aria-pressed")) == ("0.25", "0,0", "true")
    assert tree.findtext("caption") == "down: <i>light</i>, lux; across: Exposure, ms"
    assert [each.text for each in tree.iter("th")] == ["10", "automatic exposure", "1"]


def test_a_histogram_and_a_plan_are_well_formed() -> None:
    shares = np.full((3, 64), 1 / 64)
    assert "lit" in drawn.histogram(shares, (0.0, 0.2))
    assert "lit" not in drawn.histogram(shares, (0.0, 0.0))
    ET.fromstring(f"<div>{drawn.histogram(shares, (0.0, 0.2))}</div>")
    needs = plan(IMX250, exposure_s=0.01, illuminance_lux=100.0)
    tree = ET.fromstring(f"<div>{drawn.plan_table(needs)}</div>")
    assert [each.text for each in tree.iter("th")][3:] == [each.name for each in needs.stages]
