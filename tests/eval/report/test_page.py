"""The page answers the question, survives odd runs and lets no name into it as markup."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from blurnoise_eval.grid.axes import EXPOSURE
from blurnoise_eval.report import interactive, page, tables, words
from blurnoise_eval.report.page import write_report
from blurnoise_eval.report.run import RunData
from made_runs import EXPOSURES_S, made_run
from read_pages import Page, records

TWO = ("yolox-nano", "fastestdet")


@pytest.fixture(scope="module")
def reported(tmp_path_factory: pytest.TempPathFactory) -> tuple[RunData, Path]:
    folder = tmp_path_factory.mktemp("run")
    data = made_run(folder)
    return data, write_report(data, folder)


@pytest.fixture
def page_only(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave the figures undrawn, for tests of the page's words."""
    monkeypatch.setattr(page, "FIGURES", {})


def test_writes_the_page_and_five_real_pictures(reported: tuple[RunData, Path]) -> None:
    _, page = reported
    assert page.name == "report.html"
    assert page.stat().st_size < 3e6
    names = {"confidence_exposure.png", "confidence_blur.png", "confidence_speed.png", "examples.png"}
    names |= {"gain_snr_brightness.png"}
    assert {path.name for path in (page.parent / "figures").iterdir()} == names
    for name in names:
        image = cv2.imread(str(page.parent / "figures" / name))
        assert min(image.shape[:2]) > 300
        coloured = np.ptp(image.astype(int), axis=2) > 40
        assert coloured.mean() > 0.005  # text alone is grey


def test_the_answer_comes_first_and_is_complete(reported: tuple[RunData, Path]) -> None:
    data, page = reported
    text = Page(page).text
    order = ["Best single exposure: 16 ms", "any speed", "?: cannot tell", "Limits:", "Surer:"]
    order += ["Scores", "Curves", "Heat map: exposure × blur", "How it was measured"]
    assert [text.index(part) for part in order] == sorted(text.index(part) for part in order)
    for answer in data.answers:
        if answer["recommended_s"] is not None:
            assert words.window_text(answer) in text
            recommended = EXPOSURE.text(answer["recommended_s"])
            assert f"{recommended} → {words.confidence_text(answer)}" in text
        else:
            assert words.best_text(answer) in text
    assert "stop sign 30 px: 0.50 on the untouched pictures, below the threshold 0.6" in text


@pytest.mark.usefixtures("page_only")
def test_two_models_are_compared_in_words_table_and_chart(tmp_path: Path) -> None:
    data = made_run(tmp_path, {"sign": 0.95, "small sign": 0.7}, models=TWO, n_examples=1)
    parsed = Page(page := write_report(data, tmp_path))
    works = {name: sum(bool(a["windows_s"]) for a in data.answers if a["model"] == name) for name in TWO}
    assert works["yolox-nano"] > works["fastestdet"] > 0
    assert "Best is yolox-nano: mPC 0.780 (mean AP);" in parsed.text
    for name in TWO:
        assert f"{name}: some exposure works in {works[name]} of 8" in parsed.text
    # Slower and better against faster and worse: both stand on the front.
    charts = re.findall(r'png;base64,[^"]+" alt="([A-Za-z ]+) against latency', page.read_text("utf-8"))
    assert charts == ["AUC over exposure", "AUC over blur", "rPC"]


@pytest.mark.usefixtures("page_only")
def test_readers_are_judged_by_what_they_read(tmp_path: Path) -> None:
    data = made_run(tmp_path, kind="reader")
    wrong = data.examples[0]["targets"][0] | {"text": "STOO", "confidence": 0.0}
    data.examples[0]["targets"] = [wrong]
    parsed = Page(write_report(data, tmp_path))
    assert "exact matches on the untouched pictures" in parsed.text
    assert "Character error rate" in parsed.text
    assert "AP50" not in parsed.text
    assert "read “STOO”, wrong" in parsed.text
    assert "read “STOP”, confidence" in parsed.text
    assert [measure["name"] for measure in parsed.numbers["measures"]] == [
        "Confidence, right or wrong",
        "Exact match",
        "Character error rate",
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
        "yolox-nano: assumed colour order colour_order = BGR; assumed (usual for YOLOX)",
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
    zero = [row | ({"highest_confidence": 0.0} if row["model"] == TWO[1] else {}) for row in data.groups]
    data.manifest["models"][0] |= {"non_finite_values": 17, "suspicions": ["colours seem swapped"]}
    data.manifest["errors"] = [
        {"model": TWO[0], "error": f"failed in way {i}", "cells": 30 - i} for i in range(20)
    ]
    text = Page(write_report(replace(data, groups=zero), tmp_path)).text
    assert (
        "fastestdet: every target in every condition, the untouched pictures included, has confidence 0."
        in text
    )
    assert "yolox-nano: every target" not in text
    assert "yolox-nano: 17 output values were NaN or infinite." in text
    assert "yolox-nano: colours seem swapped" in text
    assert "yolox-nano: 30 cells failed: failed in way 0" in text
    assert "12 further kinds of error" in text


def test_curves_carry_every_measured_point(reported: tuple[RunData, Path]) -> None:
    data, page = reported
    numbers = Page(page).numbers
    assert len(numbers["points"]) == sum(len(answer["exposures_s"]) for answer in data.answers) == 32
    point, answer = numbers["points"][7], data.answers[1]
    exposure, velocity, light = point["at"]
    assert (point["model"], point["group"], point["n"]) == (0, 0, 12)
    assert numbers["axes"][2]["values"][light] == 10.0
    assert numbers["speeds_px_s"][velocity] == 600.0
    assert numbers["exposures_ms"][exposure] == pytest.approx(64)
    expected = (answer["confidence"][3], answer["low"][3], answer["high"][3])
    assert (point["y"], point["low"], point["high"]) == pytest.approx(expected, abs=6e-5)  # four decimals
    assert numbers["clean_confidence"] == [[0.95, 0.5]]
    names = [measure["name"] for measure in numbers["measures"]]
    assert numbers["clean"][0][names.index("AP")] == pytest.approx(data.scores[0]["ap"], abs=6e-5)
    row = next(row for row in data.scores if row["exposure_s"] == 0.016 and row["velocity_x_px_s"] == 600)
    place = names.index("AP50")
    found = numbers["scores"][6]
    assert (found["model"], found["at"], found["n"]) == (0, [2, 1, 0], 3)
    assert found["y"][place] == pytest.approx(row["ap50"], abs=6e-5)


@pytest.mark.usefixtures("page_only")
def test_failure_points_are_tabled_and_marked(tmp_path: Path) -> None:
    data = made_run(tmp_path, n_examples=0)
    marked = Page(write_report(data, tmp_path)).numbers["failures"]
    assert len(marked) == len(data.endurances) == 16
    within = [c for c in data.endurances if c["fails_at"] not in (None, 0.0)]
    assert [f["x"] for f in marked if f["x"] is not None] == pytest.approx(
        [c["fails_at"] for c in within], abs=6e-5
    )
    curve = data.endurances[0] | {"x": [0.0, 24.0], "auc": 0.71, "auc_low": 0.65, "auc_high": 0.8}
    curve |= {"non_monotonic": True}
    cases = {
        ("12.1 px", "95 %: 9.8 to 14 px"): (12.1, 9.8, 14.0),
        ("12.1 px", "95 %: from 9.8 px"): (12.1, 9.8, None),
        ("12.1 px", "AUC 0.71 (0.65–0.80)"): (12.1, None, None),
        ("beyond 24 px", "95 %: from 18 px"): (None, 18.0, None),
        ("below throughout", "AUC 0.71 (0.65–0.80)"): (0.0, 0.0, 0.0),
    }
    for (text, note), (at, low, high) in cases.items():
        one = [curve | {"fails_at": at, "fails_low": low, "fails_high": high}]
        table = tables.failures(replace(data, endurances=one), ["stop sign 100 px"])[0]
        cell = table["rows"][0][1][0]
        assert (*cell[:2], cell[-1]) == (text, note, "non-monotonic")
        assert table["rows"][1][1][0] is None


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
    assert (tmp_path / "figures" / "latency_robustness.png").stat().st_size > 10_000
    assert parsed.tags.count("script") == Page(reported[1]).tags.count("script") == 3
    assert parsed.tags.count("img") - 3 == len(data.examples) == 4  # three charts of latency
    assert all("alert(" not in script for script in parsed.scripts)
    assert "<script>alert(1)</script>" in parsed.text


@pytest.mark.usefixtures("page_only")
def test_many_groups_are_capped_and_said_so(tmp_path: Path) -> None:
    groups = {f"class {i}": 0.9 for i in range(60)}
    data = made_run(tmp_path, groups, exposures_s=EXPOSURES_S[:2], speeds=(0.0,), n_examples=0)
    biggest = [a | {"n_targets": 99} if a["group"] == "class 41" else a for a in data.answers]
    text = Page(write_report(replace(data, answers=biggest), tmp_path)).text
    assert "12 of 60 target groups are shown" in text
    assert "class 41 n = 99" in text
    assert "class 30 n =" not in text


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
    assert parsed.tags.count("img") == 39 + 3  # all of them, and the charts of latency


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
        assert "at 5 ms (the only exposure tested)" in text or "no exposure works" in text
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
    groups = sorted({answer["group"] for answer in data.answers})
    numbers = interactive.numbers(data, groups)
    names = [score.name for score in interactive.choices(data)]
    place = names.index("ap50")
    for row in records(numbers["scores"]):
        value, low, high = (row[name][place] for name in ("y", "y_low", "y_high"))
        assert (low, high) == pytest.approx((value - 0.25, value + 0.25), abs=2e-4)
        assert row["y_low"][names.index("detection_rate")] is None
    cells = next(row["cells"] for row in tables.model_rows(data) if row["name"] == "P")
    assert cells[0]["text"] == "0.500 (0.250–0.750)"
    assert "(" not in (cells[1]["text"] or "")


@pytest.mark.usefixtures("page_only")
def test_the_first_figure_marks_the_exposure_to_use_and_its_window(tmp_path: Path) -> None:
    """Its abscissa is logarithmic: 4 ms lie a third of the way from 1 to 64 ms."""
    data = made_run(tmp_path, {"sign": 0.95}, lights_lux=(200.0, 2000.0), n_examples=0)
    text = write_report(data, tmp_path).read_text(encoding="utf-8")
    dots = [float(x) for x in re.findall(r'<circle class="dot c0" cx="([\d.]+)"', text)]
    assert dots[1] - dots[0] == pytest.approx((dots[3] - dots[0]) / 3, abs=0.2)
    (chosen,) = re.findall(r'<line class="chosen" x1="([\d.]+)"', text)
    assert float(chosen) == pytest.approx(dots[1], abs=0.1)
    (start, width) = map(
        float, *re.findall(r'<rect class="window" x="([\d.]+)" y="\d+" width="([\d.]+)"', text)
    )
    assert start <= dots[0] < dots[2] < start + width < dots[3]
    assert text.count("<polyline") == 2  # a line per speed
    assert "Shaded: its window" in text


@pytest.mark.usefixtures("page_only")
def test_without_several_exposures_there_is_no_first_figure(tmp_path: Path) -> None:
    data = made_run(tmp_path, {"sign": 0.95}, exposures_s=(0.004,), n_examples=0)
    assert 'class="kept"' not in write_report(data, tmp_path).read_text(encoding="utf-8")


@pytest.mark.usefixtures("page_only")
def test_examples_say_whether_a_target_was_missed(tmp_path: Path) -> None:
    data = made_run(tmp_path, {"sign": 0.95}, n_examples=5)
    text = write_report(data, tmp_path).read_text(encoding="utf-8")
    found = re.findall(r'data-outcome="(\w+)"', text)
    least = data.found_from
    missed = [any(target["confidence"] < least for target in each["targets"]) for each in data.examples]
    assert found == ["missed" if each else "found" for each in missed]
    assert len(set(found)) == 2
