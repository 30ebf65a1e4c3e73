"""The command: every subcommand once, lists, JSON, and one line with exit code 2 for whatever is wrong."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import matched_filter
import numpy as np
import pandas as pd
import pytest
from blurnoise_eval.cli.chart import CHARTS
from blurnoise_eval.datasets import write_picture
from blurnoise_eval.report import page
from blurnoise_eval.store.store import Store
from blurnoise_eval.sweep import run as sweep
from commands import Output, main, told

from blurnoise import charts
from blurnoise.optics.colour import srgb_from_linear

FEW = ("--exposure-ms", "2,10", "--lux", "50", "--dx", "0,400", "--no-refine", "--threads", "1")


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("model") / "small.onnx"
    return matched_filter.build(path, sizes_px=(24, 16, 10), input_px=64)


@pytest.fixture(scope="module")
def pictures(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two signs of 24 px, a picture of 0 bytes between them, and boxes for all three."""
    folder = tmp_path_factory.mktemp("pictures")
    linear = charts.stop_sign(24, height_px=64, width_px=64)
    sign = srgb_from_linear(linear)[0].mul(255).round().byte().permute(1, 2, 0).numpy()
    for name in ("a.png", "c.png"):
        write_picture(folder / name, sign)
    (folder / "b.png").write_bytes(b"")
    x0, y0, x1, y1 = charts.stop_sign_box(24, height_px=64, width_px=64)
    names = ("a.png", "b.png", "c.png")
    data = {
        "images": [{"id": index, "file_name": name} for index, name in enumerate(names)],
        "categories": [{"id": 4, "name": "stop sign"}, {"id": 5, "name": "person"}],
        "annotations": [
            {"image_id": index, "category_id": 4, "bbox": [x0, y0, x1 - x0, y1 - y0]} for index in range(3)
        ],
    }
    (folder / "instances.json").write_text(json.dumps(data))
    return folder


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory, model: Path, pictures: Path) -> Path:
    """A finished sweep."""
    folder = tmp_path_factory.mktemp("runs") / "run"
    assert main(["sweep", *sweep_of(model, pictures), "-o", str(folder)]) == 0
    return folder


def sweep_of(model: Path, pictures: Path) -> list[str]:
    return ["--model", str(model), "--coco", str(pictures / "instances.json"), "--camera", "imx250", *FEW]


@pytest.mark.parametrize("kind", CHARTS)
def test_chart(tmp_path: Path, kind: str) -> None:
    size = ["--width", "71", "--height", "52", "--size", "40"]
    shallow, deep = tmp_path / "8.png", tmp_path / "16.png"
    assert main(["chart", kind, "-o", str(shallow), *size]) == 0
    assert main(["chart", kind, "-o", str(deep), *size, "--bit-depth", "16"]) == 0
    eight, sixteen = (cv2.imread(str(path), cv2.IMREAD_UNCHANGED) for path in (shallow, deep))
    assert eight.shape[:2] == sixteen.shape[:2] == (52, 71)
    assert (eight.dtype, sixteen.dtype) == (np.uint8, np.uint16)
    np.testing.assert_allclose(sixteen / 257, eight, atol=0.51)
    assert (eight.std() > 0) == (kind != "flat-patch")
    turned = tmp_path / "turned.png"
    assert main(["chart", kind, "-o", str(turned), *size, "--angle", "33"]) == 0
    assert np.array_equal(cv2.imread(str(turned), cv2.IMREAD_UNCHANGED), eight) == (kind == "flat-patch")


def test_sweep_leaves_a_folder_that_answers(run: Path, capsys: Output) -> None:
    for name in (
        "report.html",
        "results.csv",
        "targets.csv",
        "summary.json",
        "results.sqlite",
    ):
        assert (run / name).stat().st_size > 0, name
    assert len(list((run / "figures").glob("*.png"))) >= 2
    cells = pd.read_csv(run / "results.csv")
    assert len(cells) == 2 * (1 + 4)  # two good pictures, each clean and under four conditions
    assert sorted(cells["image"].unique()) == ["a.png", "c.png"]
    summary = json.loads((run / "summary.json").read_text())
    assert [entry["image"] for entry in summary["skipped"]] == ["b.png"]
    assert "0 bytes" in summary["skipped"][0]["reason"]
    assert {(a["illuminance_lux"], a["velocity_x_px_s"]) for a in summary["answers"]} == {(50, 0), (50, 400)}
    assert all(answer["recommended_s"] in (0.002, 0.01) for answer in summary["answers"])
    assert "b.png" in (run / "report.html").read_text()


def test_same_sweep_again_computes_nothing(
    run: Path, model: Path, pictures: Path, capsys: Output, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(page, "write_report", lambda data, folder, progress: folder)
    assert main(["sweep", *sweep_of(model, pictures), "-o", str(run), "--json"]) == 0
    out, err = capsys.readouterr()
    summary = json.loads(out)
    assert (summary["computed"], summary["resumed"], summary["cells"]) == (0, 10, 10)
    assert "b.png" in err
    assert main(["sweep", *sweep_of(model, pictures), "-o", str(run)]) == 0
    assert "1 picture skipped" in capsys.readouterr().out


@pytest.mark.slow
def test_report_at_another_threshold(run: Path, capsys: Output) -> None:
    (run / "report.html").unlink()
    summary = told(capsys, "report", run, "--threshold", 1)
    assert summary["threshold"] == 1
    assert all(answer["recommended_s"] is None for answer in summary["answers"])
    assert "no" in (run / "report.html").read_text().lower()


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        (("--exposure-ms", "2,11"), "plan"),
        (("--camera", "imx249"), "camera"),
        (("--limit", "1"), "pictures"),
        (("--seed", "7"), "plan"),
        (("--target", "stop sign"), "targets"),
    ],
)
def test_folder_of_another_run_is_refused(
    run: Path, model: Path, pictures: Path, capsys: Output, changes: tuple[str, str], named: str
) -> None:
    before = {path: path.stat().st_mtime_ns for path in run.rglob("*") if path.suffix != ".sqlite"}
    refused(capsys, named, "sweep", *sweep_of(model, pictures), *changes, "-o", run)
    assert {path: path.stat().st_mtime_ns for path in before} == before


def test_interrupt_is_told(
    tmp_path: Path, capsys: Output, model: Path, pictures: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(sweep, "run", interrupted)
    assert main(["sweep", *sweep_of(model, pictures), "-o", str(tmp_path / "run")]) == 130
    err = capsys.readouterr().err
    assert len(err.strip().splitlines()) == 1
    assert "kept" in err


def refused(capsys: Output, named: str, *arguments: object) -> None:
    """Exit code 2, nothing on stdout, one line on stderr that names what is wrong."""
    capsys.readouterr()
    assert main(list(map(str, arguments))) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("blurnoise: error: ")
    assert len(err.splitlines()) == 1, err
    assert named in err, err


def test_run_in_use_and_damaged_run(tmp_path: Path, capsys: Output) -> None:
    with Store(tmp_path / "run", create=True):
        refused(capsys, "another process", "report", tmp_path / "run")
    refused(capsys, "no sweep has begun", "report", tmp_path / "run")
    (tmp_path / "run" / "results.sqlite").write_text("no database " * 100)
    refused(capsys, "damaged", "report", tmp_path / "run")
