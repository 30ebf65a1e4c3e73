"""The command: every subcommand once, lists, JSON, and one line with exit code 2 for whatever is wrong."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
import pytest
from blurnoise_eval.cli.chart import CHARTS
from blurnoise_eval.datasets import write_picture
from blurnoise_eval.grid.values import numbers
from blurnoise_eval.report import page
from blurnoise_eval.store.store import Store
from blurnoise_eval.sweep import run as sweep
from blurnoise_models import matched_filter
from commands import Output, main, pixels, told

from blurnoise import charts
from blurnoise.optics.colour import srgb_from_linear

MOTION = "motion --speed-kmh 1 --distance-m 1 --target-width-m 1 --exposure-ms 1 --width-px 9 --hfov-deg 9"
LFS_POINTER = "version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12345\n"
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


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("5", [5]),
        ("1,5,10", [1, 5, 10]),
        ("-2.5,1e3", [-2.5, 1000]),
        ("1:10:3", [1, 4, 7, 10]),
        ("1:9:3", [1, 4, 7]),
        ("0:1:0.1", [0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0]),
        ("10:0:-5", [10, 5, 0]),
        ("-500:500:500", [-500, 0, 500]),
        ("3:3:1", [3]),
        ("1:1000", [1, 3, 10, 30, 100, 300, 1000]),
        ("2:250", [2, 3, 10, 30, 100, 250]),
        ("0:1000", [0, 10, 30, 100, 300, 1000]),
        ("0.5:5", [0.5, 1, 3, 5]),
    ],
)
def test_lists(text: str, expected: list[float]) -> None:
    assert numbers(text) == pytest.approx(expected)


@pytest.mark.parametrize(
    "text",
    ["", "a", "1,", ",", "2:1", "-1:2", "3:3", "1:inf", "1:2:0", "1:2:-1", "5:5.5:-1",
     "2:1:1", "1:2:3:4", "0:1:1e-9", "0:inf:1", "nan:1:1"],
)  # fmt: skip
def test_bad_lists(text: str) -> None:
    with pytest.raises(ValueError, match="start:stop:step"):
        numbers(text)


@pytest.mark.slow
def test_a_sweep_of_photographs_says_what_light_means(tmp_path: Path, model: Path, pictures: Path) -> None:
    command = ["sweep", *sweep_of(model, pictures), "-o"]
    assert main([*command, str(tmp_path / "plain")]) == 0
    assert "brightness is taken for reflectance" in (tmp_path / "plain/report.html").read_text()
    assert main(["report", str(tmp_path / "plain")]) == 0
    assert "brightness is taken for reflectance" in (tmp_path / "plain/report.html").read_text()
    assert main([*command, str(tmp_path / "anchored"), "--grey-anchor", "mean"]) == 0
    assert "18 % reflectance is the mean of each picture" in (tmp_path / "anchored/report.html").read_text()


def test_motion_meets_table_2(capsys: Output) -> None:
    """Lin et al. 2024, Table 2: a truck of 4.9 m at 50 m and 100 km/h, 15 ms."""
    table = ("--speed-kmh", 100, "--distance-m", 50, "--target-width-m", 4.9, "--exposure-ms", 15)
    camera = ("--width-px", 4096, "--hfov-deg", 99.32)
    facts = told(capsys, "motion", *table, *camera)
    assert facts["blur_px"] == pytest.approx(19.67512, abs=1e-4)
    assert facts["velocity_px_s"] == pytest.approx(facts["blur_px"] / 0.015)
    assert facts["lens"] == "f-theta"
    assert told(capsys, "motion", *table, *camera, "--lens", "rectilinear")["blur_px"] < facts["blur_px"]
    assert main(["motion", *map(str, (*table, *camera))]) == 0
    assert "19.6751" in capsys.readouterr().out


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


@pytest.mark.slow
def test_sweep_of_pictures_without_any_target(tmp_path: Path, capsys: Output, model: Path) -> None:
    (tmp_path / "grey").mkdir()
    write_picture(tmp_path / "grey" / "flat.png", np.full((64, 64, 3), 118, np.uint8))
    command = ("sweep", "--model", model, "--images", tmp_path / "grey", *FEW, "-o", tmp_path / "run")
    summary = told(capsys, *command)
    assert (summary["cells"], summary["answers"]) == (5, [])
    assert len(pd.read_csv(tmp_path / "run" / "targets.csv")) == 0


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


@pytest.fixture
def bad(tmp_path: Path) -> Path:
    """A folder of things that are not what their names say."""
    folder = tmp_path / "bad"
    folder.mkdir()
    (folder / "text.onnx").write_text("this is no model\n")
    (folder / "pointer.onnx").write_text(LFS_POINTER)
    (folder / "empty.onnx").write_bytes(b"")
    (folder / "empty.png").write_bytes(b"")
    (folder / "file").write_text("x")
    (folder / "no_pictures").mkdir()
    (folder / "instances.json").write_text("{ no json")
    write_picture(folder / "good.png", pixels((8, 9)))
    return folder


@pytest.mark.parametrize(
    ("command", "named"),
    [
        ("simulate missing.png -o out.png", "missing.png: No such file"),
        ("simulate empty.png -o out.png", "0 bytes"),
        ("simulate file -o out.png", "file: not an 8- or 16-bit picture"),
        ("simulate no_pictures -o out.png", "directory"),
        ("simulate good.png -o out.png --exposure-ms -1", "--exposure-ms = "),
        ("simulate good.png -o out.png --exposure-ms nan", "--exposure-ms = "),
        ("simulate good.png -o out.png --lux -1", "--lux = "),
        ("simulate good.png -o out.png --dx inf", "--dx = "),
        ("simulate good.png -o out.png --temperature-c nan", "--temperature-c = "),
        ("simulate good.png -o out.png --camera pinhole", "pinhole"),
        ("simulate good.png -o out.png --f-number 0", "--f-number = "),
        ("simulate good.png -o out.png --seed -1", "-1"),
        ("simulate good.png -o out.txt", "suffix"),
        ("simulate good.png -o out", "suffix"),
        ("simulate good.png -o out.jpg --bit-depth native", "16 bits"),
        ("simulate good.png -o file/out.png", "file/out.png"),
        ("simulate good.png -o nowhere/out.png", "nowhere/out.png"),
        ("inspect missing.onnx", "missing.onnx: no such file"),
        ("inspect text.onnx", "text file"),
        ("inspect pointer.onnx", "git lfs pull"),
        ("inspect empty.onnx", "empty"),
        ("inspect no_pictures", "directory"),
        ("sweep --model missing.onnx -o run", "no such file"),
        ("sweep --model text.onnx -o run", "text file"),
        ("sweep --model pointer.onnx -o run", "git lfs pull"),
        ("sweep --contract yolov9 -o run", "yolov9"),
        ("sweep --images no_pictures -o run", "holds no picture"),
        ("sweep --images missing -o run", "no such folder"),
        ("sweep --coco missing.json -o run", "No such file"),
        ("sweep --coco instances.json -o run", "not a COCO instances file"),
        ("sweep --target person -o run", "--labels"),
        ("sweep --camera pinhole -o run", "presets are"),
        ("sweep --exposure-ms 0 -o run", "--exposure-ms = "),
        ("sweep --exposure-ms nan -o run", "--exposure-ms = "),
        ("sweep --exposure-ms 5,-5 -o run", "--exposure-ms = "),
        ("sweep --lux nan -o run", "--lux = "),
        ("sweep --dx inf -o run", "--dx = "),
        ("sweep --repeats 0 -o run", "repeats"),
        ("sweep --limit 0 -o run", "limit"),
        ("sweep --threads 0 -o run", "threads"),
        ("sweep --threshold 1.5 -o run", "threshold"),
        ("sweep --threshold nan -o run", "threshold"),
        ("sweep --temperature-c nan -o run", "--temperature-c = "),
        ("sweep --seed -1 -o run", "seed"),
        ("bench blur --threads 0 -o run", "threads"),
        ("bench blur --quick -o file", "file"),
        ("bench blur --quick -o file/below", "file/below"),
        ("sweep -o file", "Not a directory"),
        ("sweep -o file/below", "Not a directory"),
        ("report nowhere", "blurnoise sweep"),
        ("report file", "blurnoise sweep"),
        ("{motion} --speed-kmh -1", "--speed-kmh = -1"),
        ("{motion} --distance-m 0", "--distance-m = "),
        ("{motion} --exposure-ms nan", "--exposure-ms = "),
        ("chart stop-sign -o out.png --size -3", "size"),
        ("chart stop-sign -o out.png --size nan", "size"),
        ("chart flat-patch -o out.png --width 0", "--width = "),
        ("chart slanted-edge -o out.png --angle nan", "angle"),
        ("chart siemens-star -o file/out.png", "file/out.png"),
    ],
)  # fmt: skip
def test_bad_input_is_one_line_and_leaves_nothing(
    bad: Path, capsys: Output, monkeypatch: pytest.MonkeyPatch, command: str, named: str
) -> None:
    monkeypatch.chdir(bad)
    before = sorted(bad.rglob("*"))
    refused(capsys, named, *command.format(motion=MOTION).split())
    assert sorted(bad.rglob("*")) == before


def test_run_in_use_and_damaged_run(tmp_path: Path, capsys: Output) -> None:
    with Store(tmp_path / "run", create=True):
        refused(capsys, "another process", "report", tmp_path / "run")
    refused(capsys, "no sweep has begun", "report", tmp_path / "run")
    (tmp_path / "run" / "results.sqlite").write_text("no database " * 100)
    refused(capsys, "damaged", "report", tmp_path / "run")
