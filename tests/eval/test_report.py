"""The report answers the question, survives odd runs and lets no name into the page as markup."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from blurnoise_eval import figures, pictures, report
from blurnoise_eval.findings import best_common_exposure, window_text
from blurnoise_eval.report import RunData, write_report
from numpy.typing import NDArray

EXPOSURES_S = (0.001, 0.004, 0.016, 0.064)
THRESHOLD = 0.6


def _confidence(exposure_s: float, lux: float, speed: float, best: float) -> float:
    """A detector that needs light (exposure x lux) and dislikes blur (exposure x speed)."""
    light = 1 - math.exp(-exposure_s * lux / 0.25)
    return best * light * math.exp(-((exposure_s * speed / 14) ** 2))


def _windows(exposures_s: tuple[float, ...], curve: list[float]) -> list[list[float]]:
    """Runs of tested exposures at or above the threshold, their ends interpolated in log exposure."""
    log, found, start = np.log(exposures_s), [], None
    for i, value in enumerate(curve):
        if value >= THRESHOLD and start is None:
            start = exposures_s[i]
            if i:
                start = math.exp(np.interp(THRESHOLD, [curve[i - 1], value], log[i - 1 : i + 1]))
        if value < THRESHOLD and start is not None:
            found.append([start, math.exp(np.interp(THRESHOLD, [value, curve[i - 1]], [log[i], log[i - 1]]))])
            start = None
    return [*found, [start, exposures_s[-1]]] if start is not None else found


def synthetic_run(
    folder: Path,
    groups: dict[str, float] | None = None,
    exposures_s: tuple[float, ...] = EXPOSURES_S,
    lights_lux: tuple[float, ...] = (10.0, 200.0),
    speeds: tuple[float, ...] = (0.0, 600.0),
    interval: bool = True,
    n_examples: int = 2,
) -> RunData:
    """A run whose parts agree with each other; ``groups`` gives the best confidence of each target group."""
    groups = {"stop sign 100 px": 0.95, "stop sign 30 px": 0.5} if groups is None else groups
    cells, targets, answers, examples = [], [], [], []
    picture = {"image": "chart.png", "n_targets": len(groups), "error": None, "n_detections": 2, "seed": 1}
    clean = dict.fromkeys(
        ("exposure_s", "illuminance_lux", "velocity_x_px_s", "velocity_y_px_s", "blur_px", "simulate_ms")
    )
    conditions = [clean | {"clean": True}] + [
        {"clean": False, "exposure_s": t, "illuminance_lux": lux, "blur_px": t * v}
        | {"velocity_x_px_s": v, "velocity_y_px_s": 0.0, "simulate_ms": 7.0}
        for lux in lights_lux for v in speeds for t in exposures_s
    ]  # fmt: skip
    for index, at in enumerate(conditions):
        found = {
            group: best
            if at["clean"]
            else _confidence(at["exposure_s"], at["illuminance_lux"], at["velocity_x_px_s"], best)
            for group, best in groups.items()
        }
        mean = float(np.mean(list(found.values()))) if groups else None
        rate = None if mean is None else mean * 0.9
        cells.append(
            picture
            | at
            | {"cell_id": f"c{index}", "target_confidence": mean, "detection_rate": rate, "infer_ms": 20.0}
        )
        for group, confidence in found.items():
            row = {
                "cell_id": f"c{index}",
                "image": "chart.png",
                "target_id": group,
                "group": group,
                "label": "stop sign",
            }
            targets.append(row | at | {"width_px": 100.0, "height_px": 100.0, "confidence": confidence})
    for group, best in groups.items():
        for lux in lights_lux:
            for v in speeds:
                curve = [_confidence(t, lux, v, best) for t in exposures_s]
                windows = _windows(exposures_s, curve)
                top = int(np.argmax(curve))
                answers.append(
                    {"group": group, "illuminance_lux": lux, "velocity_x_px_s": v, "velocity_y_px_s": 0.0}
                    | {"n_targets": 12, "exposures_s": list(exposures_s), "confidence": curve}
                    | {"low": [max(0.0, c - 0.06) for c in curve] if interval else None}
                    | {"high": [min(1.0, c + 0.04) for c in curve] if interval else [None] * len(curve)}
                    | {
                        "windows_s": windows,
                        "open_low": curve[0] >= THRESHOLD,
                        "open_high": curve[-1] >= THRESHOLD,
                    }
                    | {"recommended_s": exposures_s[top] if windows else None}
                    | {"confidence_at_recommended": curve[top] if windows else None}
                )
    for index in range(n_examples):
        at = conditions[(index * 7) % len(conditions)]
        boxes = {group: [40 + 150 * k, 60, 140 + 150 * k, 160] for k, group in enumerate(list(groups)[:3])}
        scored = [
            {"box_xyxy": box, "label": "stop sign", "confidence": t["confidence"]}
            for group, box in boxes.items()
            for t in targets
            if t["group"] == group and t["cell_id"] == f"c{conditions.index(at)}"
        ]
        detections = [
            {"box_xyxy": t["box_xyxy"], "score": t["confidence"], "label": "stop sign"} for t in scored
        ]
        detections.append({"box_xyxy": [300, 200, 380, 290], "score": 0.41, "label": "kite"})
        path = folder / "pictures" / f"example {index}.png"
        path.parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(path), _picture(list(boxes.values()), at))
        examples.append(
            {"path": str(path), "image": "chart.png", "detections": detections, "targets": scored} | at
        )
    return RunData(_manifest(), cells, targets, [], answers, examples)


def _picture(boxes: list[list[float]], at: dict[str, Any]) -> NDArray[np.uint8]:
    image = np.full((320, 480, 3), 90, np.uint8)
    for x0, y0, x1, y1 in boxes:
        cv2.circle(image, ((x0 + x1) // 2, (y0 + y1) // 2), (x1 - x0) // 2, (40, 40, 200), -1)
    if not at["clean"]:
        image = cv2.blur(image, (max(1, round(at["blur_px"])), 1))
        electrons = at["exposure_s"] * at["illuminance_lux"] * 400
        image = image + np.random.default_rng(0).normal(0, 255 / math.sqrt(electrons + 4), image.shape)
    return np.clip(image, 0, 255).astype(np.uint8)


def _manifest() -> dict[str, Any]:
    contract = {"family": "YOLOX", "colour_order": "BGR", "classes": [f"class {i}" for i in range(80)]}
    sources = {"family": "output shapes", "colour_order": "assumed (usual for YOLOX)"}
    return {
        "title": "Exposure sweep",
        "command": "blurnoise sweep model.onnx --exposures 1ms 4ms",
        "model": {"name": "yolox-nano", "file": "yolox_nano.onnx", "sha256": "695e" * 16}
        | {"contract": contract | {"sources": sources}, "assumptions": ["resize: letterbox, pad 114"]},
        "camera": {
            "name": "AR0237",
            "read_noise_e": 2.5,
            "sources": {"read_noise_e": "https://example.org/sheet.pdf"},
        },
        "seed": 7,
        "versions": {"blurnoise": "0.1.0", "onnxruntime": "1.31"},
        "hardware": {"cpu": "8 cores"},
        "threads": 2,
        "threshold": THRESHOLD,
        "images": {"kind": "rendered targets", "count": 1},
        "wall_s": 12.3,
        "warnings": ["two pictures are smaller than the sensor"],
    }


class _Page(HTMLParser):
    """Visible text, tags and the addresses that a browser would fetch or follow."""

    def __init__(self, page: Path) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.addresses: list[str] = []
        self.scripts: list[str] = []
        self.words: list[str] = []
        self.feed(page.read_text(encoding="utf-8"))
        self.text = " ".join(" ".join(self.words).split())

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.addresses += [
            value or "" for name, value in attrs if name in ("src", "href", "srcset", "action")
        ]
        assert not any(name.startswith("on") for name, _ in attrs)

    def handle_data(self, data: str) -> None:
        inside = self.tags[-1] if self.tags else ""
        (self.scripts if inside == "script" else self.words).append(data)


@pytest.fixture(scope="module")
def reported(tmp_path_factory: pytest.TempPathFactory) -> tuple[RunData, Path]:
    folder = tmp_path_factory.mktemp("run")
    data = synthetic_run(folder)
    return data, write_report(data, folder)


@pytest.fixture
def page_only(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave the figures undrawn, for tests of the page's words."""
    monkeypatch.setattr(report, "FIGURES", {})


def test_writes_the_page_and_four_real_pictures(reported: tuple[RunData, Path]) -> None:
    _, page = reported
    assert page.name == "report.html"
    assert page.stat().st_size < 6e6
    names = {"confidence_exposure.png", "confidence_blur.png", "confidence_speed.png", "examples.png"}
    assert {path.name for path in (page.parent / "figures").iterdir()} == names
    for name in names:
        image = cv2.imread(str(page.parent / "figures" / name))
        assert min(image.shape[:2]) > 300
        coloured = np.ptp(image.astype(int), axis=2) > 40
        assert coloured.mean() > 0.005  # text alone is grey


def test_the_answer_comes_first_and_is_complete(reported: tuple[RunData, Path]) -> None:
    data, page = reported
    text = _Page(page).text
    assert text.index("An exposure that keeps") < text.index("Curves") < text.index("How it was measured")
    assert text.count("no exposure works") == sum(not answer["windows_s"] for answer in data.answers) > 0
    for answer in data.answers:
        assert window_text(answer) in text
        if answer["recommended_s"] is not None:
            recommended = pictures.exposure_text(answer["recommended_s"])
            assert f"{recommended} → {answer['confidence_at_recommended']:.2f}" in text
    assert "stop sign 30 px: the detector gives 0.50 on the untouched pictures" in text


@pytest.mark.usefixtures("page_only")
def test_warnings_assumptions_and_circumstances_are_on_the_page(reported: tuple[RunData, Path]) -> None:
    data, page = reported
    failed = [data.cells[0] | {"error": "model returned NaN"}, *data.cells[1:]]
    skipped = [{"image": f"broken {i}.jpg", "reason": "not a picture"} for i in range(50)]
    text = _Page(write_report(replace(data, cells=failed, skipped=skipped), page.parent / "again")).text
    for expected in (
        "two pictures are smaller than the sensor",
        "resize: letterbox, pad 114",
        "1 of 17 cells failed: model returned NaN",
        "Skipped broken 0.jpg: not a picture",
        "42 more skipped pictures",
        "colour_order = BGR; assumed (usual for YOLOX)",
        "blurnoise sweep model.onnx",
        "AR0237",
        "https://example.org/sheet.pdf",
        "8 cores",
        "onnxruntime",
    ):
        assert expected in text
    assert "broken 49.jpg" not in text
    assert "has confidence 0" not in text


@pytest.mark.usefixtures("page_only")
def test_all_scores_zero_raises_an_alarm(tmp_path: Path) -> None:
    data = synthetic_run(tmp_path, groups={"sign": 0.0}, n_examples=0)
    text = _Page(write_report(data, tmp_path)).text
    assert "Every target in every condition, the untouched pictures included, has confidence 0." in text
    assert "No tested exposure reaches a mean confidence of 0.6" in text


def test_curves_carry_every_measured_point(reported: tuple[RunData, Path]) -> None:
    data, page = reported
    numbers = next(json.loads(text) for text in _Page(page).scripts if text.startswith("{"))
    assert len(numbers["points"]) == sum(len(answer["exposures_s"]) for answer in data.answers) == 32
    group, light, velocity, exposure, blur, confidence, low, high, n = numbers["points"][7]
    answer = data.answers[1]
    assert (group, numbers["lights_lux"][light], numbers["speeds_px_s"][velocity]) == (0, 10.0, 600.0)
    assert numbers["exposures_ms"][exposure] == pytest.approx(64)
    assert blur == pytest.approx(0.064 * 600)
    expected = (answer["confidence"][3], answer["low"][3], answer["high"][3])
    assert (confidence, low, high) == pytest.approx(expected, abs=6e-5)  # four decimals
    assert n == 12


def test_the_library_is_inlined_once_and_nothing_is_fetched(reported: tuple[RunData, Path]) -> None:
    _, page = reported
    parsed = _Page(page)
    assert sum(len(script) > 1e6 for script in parsed.scripts) == 1
    assert parsed.tags.count("img") == 2
    assert {"link", "iframe", "object"}.isdisjoint(parsed.tags)
    near = re.compile(r"(results\.(csv|json)|targets\.csv|figures/[a-z_]+\.png|pictures/example%20\d\.png)$")
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


def test_hostile_names_stay_text(tmp_path: Path, reported: tuple[RunData, Path]) -> None:
    data = synthetic_run(tmp_path, groups=dict.fromkeys(HOSTILE, 0.9), lights_lux=(50.0,))
    evil = HOSTILE[0] + HOSTILE[1]
    for example in data.examples:
        example["image"] = evil
        for box in [*example["targets"], *example["detections"]]:
            box["label"] = evil
    model = data.manifest["model"] | {
        "name": evil,
        "contract": {evil: [evil], "sources": {evil: evil}},
        "assumptions": [evil],
    }
    manifest = data.manifest | {
        "title": evil,
        "command": evil,
        "model": model,
        "camera": {"name": evil, evil: evil},
    }
    manifest |= {"warnings": [evil], "versions": {evil: evil}, "hardware": {evil: evil}}
    skipped = [{"image": evil, "reason": evil}]
    cells = [data.cells[0] | {"error": evil}, *data.cells[1:]]
    parsed = _Page(write_report(replace(data, manifest=manifest, skipped=skipped, cells=cells), tmp_path))
    assert parsed.tags.count("script") == _Page(reported[1]).tags.count("script") == 3
    assert parsed.tags.count("img") == len(data.examples)
    assert all("alert(" not in script for script in parsed.scripts)
    assert "<script>alert(1)</script>" in parsed.text


@pytest.mark.usefixtures("page_only")
def test_many_groups_and_lights_are_capped_and_said_so(tmp_path: Path) -> None:
    groups = {f"class {i}": 0.9 for i in range(60)}
    lights = tuple(float(10 * 2**i) for i in range(7))
    data = synthetic_run(
        tmp_path, groups, exposures_s=EXPOSURES_S[:2], lights_lux=lights, speeds=(0.0,), n_examples=0
    )
    biggest = [a | {"n_targets": 99} if a["group"] == "class 41" else a for a in data.answers]
    data = replace(data, answers=biggest)
    parsed = _Page(write_report(data, tmp_path))
    assert "12 of 60 target groups are shown" in parsed.text
    assert "class 41 n = 99" in parsed.text
    assert "class 30" not in parsed.text
    figure = figures.confidence_exposure(data)
    assert len(figure.axes) == figures.MAX_PANELS
    assert "3 of 60 target groups shown" in figure.get_supxlabel()
    assert "4 of 7 light levels shown" in figure.get_supxlabel()


@pytest.mark.parametrize(
    "shape",
    [
        {"groups": {}},
        {"interval": False, "lights_lux": (200.0,)},
        {"exposures_s": (0.005,), "lights_lux": (200.0,)},
        {"exposures_s": (0.005,), "lights_lux": (50.0,), "speeds": (0.0,), "n_examples": 0},
    ],
    ids=["no targets", "no intervals", "one exposure", "one condition"],
)
def test_odd_runs_are_reported(tmp_path: Path, shape: dict[str, Any]) -> None:
    data = synthetic_run(tmp_path, **shape)
    text = _Page(write_report(data, tmp_path)).text
    if not data.answers:
        assert "The pictures hold no targets" in text
        assert "Curves" not in text
    elif len(data.answers[0]["exposures_s"]) == 1:
        assert "5 ms (the only exposure tested)" in text or "no exposure works" in text


@pytest.mark.usefixtures("page_only")
def test_a_missing_picture_is_said_and_does_not_stop_the_report(tmp_path: Path) -> None:
    data = synthetic_run(tmp_path)
    Path(data.examples[0]["path"]).unlink()
    Path(data.examples[1]["path"]).write_bytes(b"no picture")
    assert _Page(write_report(data, tmp_path)).text.count("picture file is missing") == 2


@pytest.mark.parametrize(
    ("windows_s", "open_low", "open_high", "expected"),
    [
        ([], False, False, "no exposure works"),
        ([[0.001, 0.022]], True, False, "≤ 1 ms (shortest tested) to 22 ms"),
        ([[0.00123, 0.064]], False, True, "1.23 ms to ≥ 64 ms (longest tested)"),
        ([[0.002, 0.003], [0.01, 0.012]], False, False, "2 ms to 3 ms, and 10 ms to 12 ms"),
        ([[0.004, 0.004]], False, False, "4 ms"),
    ],
)
def test_window_text(windows_s: list[list[float]], open_low: bool, open_high: bool, expected: str) -> None:
    answer = {
        "windows_s": windows_s,
        "open_low": open_low,
        "open_high": open_high,
        "exposures_s": EXPOSURES_S,
    }
    assert window_text(answer) == expected


def test_best_common_exposure_counts_answers_then_compares_means() -> None:
    curves = [[0.7, 0.9, 0.1], [0.7, 0.8, None], [0.1, 0.2, 0.9]]
    answers = [{"exposures_s": [0.001, 0.002, 0.003], "confidence": curve} for curve in curves]
    assert best_common_exposure(answers, 0.6) == (0.002, 2)
    assert best_common_exposure([], 0.6) is None


def _lines(figure: Any, panel: int) -> dict[str, tuple[list[float], list[float]]]:
    """Abscissae and ordinates of a panel's labelled lines."""
    lines = [line for line in figure.axes[panel].lines if not line.get_label().startswith("_")]
    return {line.get_label(): (list(line.get_xdata()), list(line.get_ydata())) for line in lines}


def test_figures_draw_the_measured_points_in_their_units(tmp_path: Path) -> None:
    data = synthetic_run(tmp_path, n_examples=0)
    answer = data.answers[3]  # 100 px sign, 200 lux, 600 px/s
    by_exposure = _lines(figures.confidence_exposure(data), 1)
    assert by_exposure["600 px/s"] == (pytest.approx([1, 4, 16, 64]), answer["confidence"])
    for figure, x in (
        (figures.confidence_blur(data), [0, 0.004 * 600]),
        (figures.confidence_speed(data), [0, 600]),
    ):
        lines = _lines(figure, 1)
        assert set(lines) == {"1 ms", "4 ms", "16 ms", "64 ms"}
        assert lines["4 ms"] == (
            pytest.approx(x),
            [data.answers[2]["confidence"][1], answer["confidence"][1]],
        )
    assert "only the speed changes" in figures.confidence_blur(data).get_supxlabel()


def test_points_of_one_speed_in_two_directions_are_not_joined(tmp_path: Path) -> None:
    data = synthetic_run(tmp_path, n_examples=0)
    turned = [
        a | {"velocity_x_px_s": 0.0, "velocity_y_px_s": a["velocity_x_px_s"]}
        for a in data.answers
        if a["velocity_x_px_s"]
    ]
    both = replace(data, answers=data.answers + turned)
    labelled = [line for line in figures.confidence_speed(both).axes[0].lines if "ms" in line.get_label()]
    assert {line.get_linestyle() for line in labelled} == {"None"}
    assert "(0, 600) px/s" in _lines(figures.confidence_exposure(both), 0)


def test_common_windows_are_the_intersection() -> None:
    assert figures.common_windows([[[1, 5], [8, 9]], [[2, 8.5]], [[0, 20]]]) == [(2, 5), (8, 8.5)]
    assert figures.common_windows([[[1, 2]], [[3, 4]]]) == []
    assert figures.common_windows([[[1, 2]], []]) == figures.common_windows([]) == []


def test_spread_keeps_both_ends() -> None:
    assert figures.spread(range(100), 4) == [0, 33, 66, 99]
    assert figures.spread("abc", 5) == ["a", "b", "c"]


def test_boxes_have_the_colour_of_their_outcome(tmp_path: Path) -> None:
    path = tmp_path / "grey.png"
    cv2.imwrite(str(path), np.full((100, 200, 3), 128, np.uint8))
    targets = [
        {"box_xyxy": [20, 40, 60, 80], "label": "a", "confidence": 0.61},
        {"box_xyxy": [120, 40, 160, 80], "label": "a", "confidence": 0.59},
    ]
    detections = [
        {"box_xyxy": [26, 44, 60, 80], "label": "a", "score": 0.61},  # the first target's own
        {"box_xyxy": [80, 40, 100, 80], "label": "b", "score": 0.29},  # too weak to be drawn
    ]
    example = {"path": str(path), "targets": targets, "detections": detections}
    picture = pictures.drawn_example(example, 400, THRESHOLD)
    assert picture is not None
    assert picture.shape == (200, 400, 3)
    left_edges = {x: {tuple(map(int, pixel)) for pixel in picture[90:150, x]} for x in (40, 52, 160, 240)}
    assert left_edges[40] == {pictures.FOUND_RGB}  # solid
    assert {pictures.MISSED_RGB, (128, 128, 128)} <= left_edges[240]  # dashed
    assert left_edges[52] == left_edges[160] == {(128, 128, 128)}
    stronger = example | {"detections": [detections[1] | {"score": 0.31}]}
    drawn = pictures.drawn_example(stronger, 400, THRESHOLD)
    assert drawn is not None
    assert np.abs(drawn[120, 160] - np.array(pictures.OTHER_RGB)).max() < 20  # antialiased
