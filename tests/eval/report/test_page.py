"""The page answers the question, survives odd runs and lets no name into it as markup."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from blurnoise_eval.report import charts, figures, tables, words
from blurnoise_eval.report.page import write_report
from blurnoise_eval.report.run import RunData
from made_runs import EXPOSURES_S, made_run
from read_pages import Page

TWO = ("yolox-nano", "fastestdet")


@pytest.fixture(scope="module")
def reported(tmp_path_factory: pytest.TempPathFactory) -> tuple[RunData, Path]:
    folder = tmp_path_factory.mktemp("run")
    data = made_run(folder)
    return data, write_report(data, folder)


@pytest.fixture
def page_only(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave the figures undrawn, for tests of the page's words."""
    monkeypatch.setattr(figures, "figures_of", lambda *_: {})


def test_writes_the_page_and_real_pictures(reported: tuple[RunData, Path]) -> None:
    _, page = reported
    assert page.name == "report.html"
    assert page.stat().st_size < 3e6
    names = {f"confidence_{view}.png" for view in ("exposure", "blur", "speed", "illuminance_lux")}
    assert {path.name for path in (page.parent / "figures").iterdir()} == names
    assert {view["file"] for view in Page(page).numbers["views"]} == names
    for name in names:
        image = cv2.imread(str(page.parent / "figures" / name))
        assert min(image.shape[:2]) > 300
        coloured = np.ptp(image.astype(int), axis=2) > 40
        assert coloured.mean() > 0.005  # text alone is grey


def test_the_answer_comes_first_and_is_complete(reported: tuple[RunData, Path]) -> None:
    data, page = reported
    text = Page(page).text
    order = ["Best single exposure: 16 ms", "any speed", "?: cannot tell", "Limits:", "Surer:"]
    order += ["Curves", "Heat map: ", "Scores", "How it was measured"]
    assert [text.index(part) for part in order] == sorted(text.index(part) for part in order)
    for answer in data.answers:
        assert all(line in text for line in words.answer_lines(answer))


@pytest.mark.usefixtures("page_only")
def test_two_models_are_compared_in_words_and_table(tmp_path: Path) -> None:
    data = made_run(tmp_path, {"sign": 0.95, "small sign": 0.7}, models=TWO, n_examples=1)
    parsed = Page(write_report(data, tmp_path))
    works = {name: sum(bool(a["windows_s"]) for a in data.answers if a["model"] == name) for name in TWO}
    assert works["yolox-nano"] > works["fastestdet"] > 0
    assert "Best is yolox-nano: mPC 0.780 (mean AP);" in parsed.text
    for name in TWO:
        assert f"{name}: some exposure works in {works[name]} of 8" in parsed.text


@pytest.mark.usefixtures("page_only")
def test_readers_are_judged_by_what_they_read(tmp_path: Path) -> None:
    data = made_run(tmp_path, kind="reader")
    wrong = data.examples[0]["targets"][0] | {"text": "STOO", "confidence": 0.0}
    data.examples[0]["targets"] = [wrong]
    parsed = Page(write_report(data, tmp_path))
    assert "exact matches on the original pictures" in parsed.text
    assert "Character error rate" in parsed.text
    assert "AP50" not in parsed.text
    assert "read “STOO”, wrong" in parsed.text
    assert "read “STOP”, confidence" in parsed.text
    assert [measure["name"] for measure in parsed.numbers["measures"]][1:4] == [
        "Confidence, right or wrong (all targets)",
        "Exact match (all targets)",
        "Character error rate (all targets)",
    ]


@pytest.mark.usefixtures("page_only")
def test_warnings_assumptions_and_circumstances_are_on_the_page(reported: tuple[RunData, Path]) -> None:
    data, page = reported
    skipped = [{"image": f"broken {i}.jpg", "reason": "not a picture"} for i in range(50)]
    text = Page(write_report(replace(data, skipped=skipped), page.parent / "again")).text
    for expected in (
        "two pictures are smaller than the sensor",
        "Skipped broken 0.jpg: not a picture",
        "42 more skipped pictures",
        "yolox-nano: assumed colour order",
        "colour_order BGR assumed (usual for YOLOX)",
        "blurnoise sweep model.onnx",
        "AR0237",
        "https://example.org/sheet.pdf",
        "8 cores",
        "onnxruntime",
    ):
        assert expected in text
    assert "broken 49.jpg" not in text
    assert "This run needs attention" not in text


@pytest.mark.usefixtures("page_only")
def test_what_makes_a_model_doubtful_raises_an_alarm(tmp_path: Path) -> None:
    data = made_run(tmp_path, groups={"sign": 0.9}, models=TWO, n_examples=0)
    data.manifest["models"][0] |= {"non_finite_values": 17, "suspicions": ["colours seem swapped"]}
    data.manifest["errors"] = [
        {"model": TWO[0], "error": f"failed in way {i}", "cells": 30 - i} for i in range(20)
    ]
    text = Page(write_report(data, tmp_path)).text
    assert "yolox-nano: 17 output values were NaN or infinite." in text
    assert "yolox-nano: colours seem swapped" in text
    assert "yolox-nano: 30 cells failed: failed in way 0" in text
    assert "12 further kinds of error" in text


def test_curves_carry_every_measured_point(reported: tuple[RunData, Path]) -> None:
    """Series by measure, model and group; their rows by the place of their condition on the axes."""
    data, page = reported
    numbers = Page(page).numbers
    of_targets = [each for each in numbers["series"] if each[0] == 0]
    assert [each[:4] for each in of_targets] == [[0, 0, 0, 0.95], [0, 0, 1, 0.5]]
    assert sum(len(each[4]) for each in of_targets) == sum(len(a["exposures_s"]) for a in data.answers) == 32
    place, *values, n = of_targets[0][4][7]
    answer = data.answers[1]
    exposure, velocity, light = numbers["conditions"][place]
    assert n == 12
    assert [numbers["axes"][k]["x"][at] for k, at in enumerate((exposure, velocity, light))] == [64, 600, 10]
    expected = [answer["confidence"][3], answer["low"][3], answer["high"][3]]
    assert values == pytest.approx(expected, abs=6e-5)  # four decimals
    names = [measure["name"] for measure in numbers["measures"]]
    clean, rows = next(each[3:] for each in numbers["series"] if each[0] == names.index("AP50 (all targets)"))
    assert clean == pytest.approx(data.scores[0]["ap50"], abs=6e-5)
    row = next(row for row in data.scores if row["exposure_s"] == 0.016 and row["velocity_x_px_s"] == 600)
    place, *values, n = rows[6]
    assert (numbers["conditions"][place], n) == ([2, 1, 0], 3)
    assert values == [pytest.approx(row["ap50"], abs=6e-5), None, None]


def test_the_library_is_inlined_once_and_nothing_is_fetched(reported: tuple[RunData, Path]) -> None:
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


HOSTILE = [
    "<script>alert(1)</script>",
    "</script><img src=x onerror=alert(2)>",
    '"><b onmouseover=a()>',
    "$\\frac{$",
    "a\udcffb",
]


@pytest.mark.slow
def test_hostile_names_stay_text(tmp_path: Path, reported: tuple[RunData, Path]) -> None:
    evil = HOSTILE[0] + HOSTILE[1]
    groups = dict.fromkeys(HOSTILE, 0.9)
    data = made_run(tmp_path, groups, lights_lux=(50.0,), models=(evil, *HOSTILE[2:]), n_examples=1)
    for example in data.examples:
        example["image"] = example["error"] = evil
        for box in [*example["targets"], *example["detections"]]:
            box["label"] = box["text"] = evil
    for model in data.manifest["models"]:
        model |= {"contract": {evil: [evil], "sources": {evil: evil}}, "suspicions": [evil], "file": evil}
    manifest = data.manifest | {
        "title": evil,
        "command": evil,
        "camera": {"name": evil, evil: evil},
        "errors": [{"model": evil, "error": evil, "cells": 3}],
        "warnings": [evil],
        "versions": {evil: evil},
        "hardware": {evil: evil},
    }
    skipped = [{"image": evil, "reason": evil}]
    parsed = Page(write_report(replace(data, manifest=manifest, skipped=skipped), tmp_path))
    assert (tmp_path / "figures" / "confidence_blur.png").stat().st_size > 10_000
    assert parsed.tags.count("script") == Page(reported[1]).tags.count("script") == 3
    assert parsed.tags.count("img") == len(data.examples) == 4
    assert all("alert(" not in script for script in parsed.scripts)
    assert "<script>alert(1)</script>" in parsed.text


@pytest.mark.usefixtures("page_only")
def test_many_groups_are_capped_and_said_so(tmp_path: Path) -> None:
    groups = {f"class {i}": 0.9 for i in range(60)}
    data = made_run(tmp_path, groups, exposures_s=EXPOSURES_S[:2], speeds=(0.0,), n_examples=0)
    biggest = [a | {"n_targets": 99} if a["group"] == "class 41" else a for a in data.answers]
    text = Page(write_report(replace(data, answers=biggest), tmp_path)).text
    assert "At most 12 groups and 24 settings are shown" in text
    assert "class 41: n = 99" in text
    assert "class 30: n =" not in text


@pytest.mark.usefixtures("page_only")
def test_a_wide_run_stays_a_light_page(tmp_path: Path) -> None:
    exposures = tuple(0.0005 * 1.5**i for i in range(12))
    speeds = tuple(100.0 * i for i in range(10))
    groups = {f"class {i}": 0.95 - 0.05 * i for i in range(9)}
    models = ("a", "b", "c")
    data = made_run(tmp_path, groups, exposures, (1.0, 10.0, 100.0), speeds, n_examples=13, models=models)
    assert len(data.scores) == 3 * (360 + 1)
    parsed = Page(page := write_report(data, tmp_path))
    assert page.stat().st_size < 3.6e6  # of which 0.7 are 360 conditions of 9 classes and 3 models
    assert parsed.tags.count("img") == 39


@pytest.mark.slow
@pytest.mark.parametrize(
    "shape",
    [
        {"groups": {}},
        {"groups": {}, "models": TWO},
        {"interval": False, "lights_lux": (200.0,)},
        {"exposures_s": (0.005,), "lights_lux": (200.0,)},
        {"exposures_s": (0.005,), "lights_lux": (50.0,), "speeds": (0.0,), "n_examples": 0},
    ],
    ids=["no targets", "no targets, two models", "no intervals", "one exposure", "one condition"],
)
def test_odd_runs_are_reported(tmp_path: Path, shape: dict[str, Any]) -> None:
    data = made_run(tmp_path, **shape)
    text = Page(write_report(data, tmp_path)).text
    if not data.answers:
        assert "the pictures hold no targets" in text
    elif len(data.answers[0]["exposures_s"]) == 1:
        assert "5 ms → " in text or "no exposure works" in text
        assert "5 ms: it reaches" in text


@pytest.mark.usefixtures("page_only")
def test_a_run_that_computed_nothing_has_a_page_without_plots(tmp_path: Path) -> None:
    data = made_run(tmp_path, groups={}, n_examples=0)
    page = write_report(replace(data, scores=[]), tmp_path)
    assert "Curves" not in Page(page).text
    assert page.stat().st_size < 1e5  # the library is left out


@pytest.mark.usefixtures("page_only")
def test_a_missing_picture_is_said_and_does_not_stop_the_report(tmp_path: Path) -> None:
    data = made_run(tmp_path)
    Path(data.examples[0]["path"]).unlink()
    Path(data.examples[1]["path"]).write_bytes(b"no picture")
    assert Page(write_report(data, tmp_path)).text.count("picture file is missing") == 2


def test_scores_bring_their_intervals(tmp_path: Path) -> None:
    """Low and high of each score stand behind the values; in the table of models in brackets."""
    data = made_run(tmp_path, models=TWO)
    for row in data.scores:
        row |= (
            {"ap50_low": row["ap50"] - 0.25, "ap50_high": row["ap50"] + 0.25}
            if row["ap50"] is not None
            else {}
        )
    data.models[0] |= {"p": 0.5, "p_low": 0.25, "p_high": 0.75}
    numbers = charts.numbers(data, [])
    place = 1 + [score.name for score in charts.choices(data)].index("ap50")
    rows = [row for measure, *_, rows in numbers["series"] for row in rows if measure == place]
    assert rows
    assert all((low, high) == pytest.approx((y - 0.25, y + 0.25), abs=2e-4) for _, y, low, high, _ in rows)
    cells = next(cells for name, _, cells in tables.model_rows(data) if name == "P")
    assert cells[0][1] == "0.500 (0.250–0.750)"
    assert "(" not in cells[1][1]
