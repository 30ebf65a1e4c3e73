"""The page answers the question, survives odd runs and lets no name into it as markup."""

import math
import re
from dataclasses import replace

import cv2
import numpy as np
import pytest
from blurnoise_eval.report import figures, words
from blurnoise_eval.report.page import write_report
from blurnoise_eval.store.rows import SkippedRow
from made_runs import made_run
from read_pages import Page


@pytest.fixture(scope="module")
def reported(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    data = made_run(folder)
    return data, write_report(data, folder)


@pytest.fixture
def page_only(monkeypatch):
    """Leave the figures undrawn, for tests of the page's words."""
    monkeypatch.setattr(figures, "figures_of", lambda *_: {})


def test_commands_to_copy_name_the_run(tmp_path, page_only):
    data = made_run(tmp_path, n_examples=0)
    automatic = [
        replace(row, conditions=row.conditions.but(gain_db=math.inf)) for row in data.recommendations
    ]
    page = write_report(replace(data, recommendations=automatic), tmp_path, run="my runs/first")
    assert "'blurnoise program 'my runs/first' -o program'" in Page(page).text


def test_writes_the_page_and_real_pictures(reported):
    _, page = reported
    assert page.name == "report.html"
    assert page.stat().st_size < 3e6
    names = {f"confidence_{view}.png" for view in ("exposure", "blur", "speed", "illuminance_lux")}
    assert {path.name for path in (page.parent / "figures").glob("*.*g")} == names
    assert {view["file"] for view in Page(page).numbers["views"]} == names
    for name in names:
        image = cv2.imread(str(page.parent / "figures" / name))
        assert min(image.shape[:2]) > 300
        coloured = np.ptp(image.astype(int), axis=2) > 40
        assert coloured.mean() > 0.005  # text alone is grey


def test_the_answer_comes_first_and_is_complete(reported):
    data, page = reported
    text = Page(page).text
    order = [
        "Set the exposure by the light",
        "any speed",
        "?: cannot tell",
        "What limits it:",
        "What to do next:",
    ]
    order += ["Curves", "Heat map: ", "Scores", "How it was measured"]
    assert [text.index(part) for part in order] == sorted(text.index(part) for part in order)
    for answer in data.answers:
        assert all(line in text for line in words.answer_lines(answer))


@pytest.mark.usefixtures("page_only")
def test_circumstances_and_what_is_doubtful_are_on_the_page(tmp_path):
    data = made_run(tmp_path, groups={"sign": 0.9}, n_examples=0)
    data.manifest["models"][0] |= {"non_finite_values": 17, "suspicions": ["colours seem swapped"]}
    errors = [{"model": "yolox-nano", "error": f"failed in way {i}", "cells": 30 - i} for i in range(20)]
    skipped = [SkippedRow(f"broken {i}.jpg", "not a picture") for i in range(50)]
    changed = replace(data, skipped=skipped, manifest=data.manifest | {"errors": errors})
    text = Page(write_report(changed, tmp_path)).text
    told = [
        "two pictures are smaller than the sensor",
        "Skipped broken 0.jpg: not a picture",
        "42 more skipped pictures",
    ]
    told += [
        "yolox-nano: assumed colour order",
        "colour_order BGR assumed (usual for YOLOX)",
        "blurnoise sweep model.onnx",
    ]
    told += ["AR0237", "https://example.org/sheet.pdf", "8 cores", "onnxruntime", "12 further kinds of error"]
    told += ["yolox-nano: 17 output values were NaN or infinite.", "yolox-nano: colours seem swapped"]
    told += ["yolox-nano: 30 cells failed: failed in way 0"]
    assert [each for each in told if each not in text] == []
    assert "broken 49.jpg" not in text


def test_curves_carry_every_measured_point(reported):
    """Series by measure, model and group; their rows by the place of their condition on the axes."""
    data, page = reported
    numbers = Page(page).numbers
    of_targets = [each for each in numbers["series"] if each[0] == 0]
    assert [each[:4] for each in of_targets] == [[0, 0, 0, 0.95], [0, 0, 1, 0.5]]
    assert sum(len(each[4]) for each in of_targets) == sum(len(a.exposures_s) for a in data.answers) == 32
    place, *values, n = of_targets[0][4][7]
    answer = data.answers[1]
    exposure, velocity, light = numbers["conditions"][place]
    assert n == 12
    assert [numbers["axes"][k]["x"][at] for k, at in enumerate((exposure, velocity, light))] == [64, 600, 10]
    expected = [answer.confidence[3], answer.low[3], answer.high[3]]
    assert values == pytest.approx(expected, abs=6e-5)  # four decimals
    names = [measure["name"] for measure in numbers["measures"]]
    clean, rows = next(each[3:] for each in numbers["series"] if each[0] == names.index("AP50 (all targets)"))
    assert clean == pytest.approx(data.scores[0].scores["ap50"].value, abs=6e-5)
    row = next(
        row
        for row in data.scores
        if row.conditions["exposure_s"] == 0.016 and row.conditions["velocity_x_px_s"] == 600
    )
    place, *values, n = rows[6]
    assert (numbers["conditions"][place], n) == ([2, 1, 0], 3)
    assert values == [pytest.approx(row.scores["ap50"].value, abs=6e-5), None, None]


def test_the_library_is_inlined_once_and_nothing_is_fetched(reported):
    _, page = reported
    parsed = Page(page)
    assert sum(len(script) > 1e6 for script in parsed.scripts) == 1
    assert parsed.tags.count("img") == 2
    assert {"link", "iframe", "object"}.isdisjoint(parsed.tags)
    near = re.compile(r"([a-z]+\.(csv|json)|figures/[a-z_]+\.png|examples/example%20\d\.png)$")
    assert all(
        address.startswith("data:image/jpeg;base64,") or near.match(address) for address in parsed.addresses
    )
    without_plotly = page.read_text().replace(max(parsed.scripts, key=len), "")
    assert not re.search(r"url\(|@import|//cdn|fetch\(|XMLHttpRequest", without_plotly)
    assert "default-src 'none'" in without_plotly
    assert "showSendToCloud: false" in without_plotly  # plotly offers to upload charts unless told not to


HOSTILE = ["<script>alert(1)</script>", "</script><img src=x onerror=alert(2)>", '"><b onmouseover=a()>']
HOSTILE += ["$\\frac{$", "a\udcffb"]


@pytest.mark.slow
def test_hostile_names_stay_text(tmp_path, reported):
    evil = HOSTILE[0] + HOSTILE[1]
    groups = dict.fromkeys(HOSTILE, 0.9)
    data = made_run(tmp_path, groups, lights_lux=(50.0,), models=(evil, *HOSTILE[2:]), n_examples=1)
    examples = [
        replace(
            example,
            cell=replace(example.cell, image=evil, error=evil),
            targets=tuple(replace(each, label=evil, text=evil) for each in example.targets),
            detections=tuple(each._replace(label=evil) for each in example.detections),
        )
        for example in data.examples
    ]
    for model in data.manifest["models"]:
        model |= {"contract": {evil: [evil], "sources": {evil: evil}}, "suspicions": [evil], "file": evil}
    manifest = data.manifest | {"title": evil, "command": evil, "camera": {"name": evil, evil: evil}}
    manifest |= {"errors": [{"model": evil, "error": evil, "cells": 3}], "warnings": [evil]}
    manifest |= {"versions": {evil: evil}, "hardware": {evil: evil}}
    skipped = [SkippedRow(evil, evil)]
    parsed = Page(
        write_report(replace(data, manifest=manifest, skipped=skipped, examples=examples), tmp_path)
    )
    assert (tmp_path / "figures" / "confidence_blur.png").stat().st_size > 10_000
    assert parsed.tags.count("script") == Page(reported[1]).tags.count("script") == 3
    assert parsed.tags.count("img") == len(data.examples) == 4
    assert all("alert(" not in script for script in parsed.scripts)
    assert "<script>alert(1)</script>" in parsed.text
