"""A sweep at the command line: what it leaves, that it goes on, and one line for whatever stops it."""

import json
import math
from dataclasses import replace
from pathlib import Path

import cv2
import matched_filter
import pandas as pd
import pytest
from blurnoise_eval.cli.console import print_opening
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.report import page
from blurnoise_eval.store.store import Store
from commands import main
from made_runs import made_run
from rich.cells import cell_len
from signs_in_memory import BOX, sign


@pytest.fixture(scope="module")
def words(tmp_path_factory):
    """A sweep of two signs, a picture of 0 bytes between them, and boxes for all three."""
    folder = tmp_path_factory.mktemp("pictures")
    model = matched_filter.build(folder / "small.onnx", sizes_px=(24, 16, 10), input_px=64)
    names = ("a.png", "b.png", "c.png")
    for name in names:
        cv2.imwrite(str(folder / name), sign())
    (folder / "b.png").write_bytes(b"")
    bbox = [BOX[0], BOX[1], BOX[2] - BOX[0], BOX[3] - BOX[1]]
    data = {
        "images": [{"id": index, "file_name": name} for index, name in enumerate(names)],
        "categories": [{"id": 4, "name": "stop sign"}, {"id": 5, "name": "person"}],
        "annotations": [{"image_id": index, "category_id": 4, "bbox": bbox} for index in range(3)],
    }
    (folder / "instances.json").write_text(json.dumps(data))
    few = "--exposure-ms 2,10 --lux 50 --dx 0,400 --no-refine --threads 1 --camera imx250"
    return ["sweep", "--model", str(model), "--coco", str(folder / "instances.json"), *few.split()]


@pytest.fixture(scope="module")
def run(tmp_path_factory, words):
    """A finished sweep."""
    folder = tmp_path_factory.mktemp("runs") / "run"
    assert main([*words, "-o", folder]) == 0
    return folder


def test_sweep_leaves_a_folder_that_answers(run):
    for name in ("report.html", "results.csv", "targets.csv", "summary.json", "results.sqlite"):
        assert (run / name).stat().st_size > 0, name
    assert len(list((run / "figures").glob("*.png"))) >= 2
    cells = pd.read_csv(run / "results.csv")
    assert len(cells) == 2 * (1 + 4)  # two good pictures, each clean and under four conditions
    assert sorted(cells["image"].unique()) == ["a.png", "c.png"]
    summary = json.loads((run / "summary.json").read_text())
    ((image, reason),) = [(entry["image"], entry["reason"]) for entry in summary["skipped"]]
    assert (image, "0 bytes" in reason) == ("b.png", True)
    assert {(a["illuminance_lux"], a["velocity_x_px_s"]) for a in summary["answers"]} == {(50, 0), (50, 400)}
    assert all(answer["recommended_s"] in (0.002, 0.01) for answer in summary["answers"])
    assert "b.png" in (run / "report.html").read_text()


def test_same_sweep_again_computes_nothing(run, words, capsys, monkeypatch):
    monkeypatch.setattr(page, "write_report", lambda data, folder, progress, run: folder)
    assert main([*words, "-o", run, "--json"]) == 0
    out, err = capsys.readouterr()
    summary = json.loads(out)
    assert (summary["computed"], summary["resumed"], summary["cells"]) == (0, 10, 10)
    assert "b.png" in err


@pytest.mark.parametrize(
    ("where", "kept"),
    [("run.evaluation.begun_or_gone", ""), ("run.computing._check_hope", "; finished work is kept")],
)
def test_an_interrupt_says_what_is_kept(tmp_path, capsys, words, monkeypatch, where, kept):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(f"blurnoise_eval.{where}", interrupted)
    assert main([*words, "-o", tmp_path / "run"]) == 130
    assert capsys.readouterr().err == f"blurnoise: interrupted{kept}\n"


def test_run_in_use_and_damaged_run(tmp_path, capsys):
    def complaint():
        assert main(["report", tmp_path / "run"]) == 2
        out, err = capsys.readouterr()
        assert (out, err.count("\n")) == ("", 1)
        return err

    with Store(tmp_path / "run", create=True):
        assert "another process" in complaint()
    assert "contains no sweep" in complaint()
    (tmp_path / "run" / "results.sqlite").write_text("no database " * 100)
    assert "damaged" in complaint()


# --- what a sweep prints first ---


WIDE = {
    "groups": {f"objects of a rather long name, number {i} (32-96 px)": 0.95 - i / 20 for i in range(9)},
    "lights_lux": (0.5, 5.0, 50.0, 5000.0),
    "speeds": (0.0, 300.0, 1000.0, 3000.0),
    "models": ("a_model_of_one_very_long_name_v2_int8", "b", "c"),
}


@pytest.mark.parametrize(
    "shape",
    [{}, {"interval": False}, {"kind": "reader"}, {"groups": {}}, WIDE | {"speeds": (0.0, 3000.0)}],
    ids=["one model", "few pictures", "reader", "no targets", "three models"],
)
def test_the_first_screen_fits_and_has_no_colour(tmp_path, capsys, monkeypatch, shape):
    data = made_run(tmp_path, n_examples=0, **shape)
    for wide in (40, 60, 80, 100, 160):
        monkeypatch.setenv("COLUMNS", str(wide))
        print_opening(data, "run")
        lines = capsys.readouterr().out.splitlines()
        assert lines
        assert max(map(cell_len, lines)) <= wide
        assert not any("\x1b" in line or "…" in line for line in lines)
        assert wide < 80 or len(lines) <= (20 if data.manifest["models"][1:] == [] else 48)


def test_the_advice_names_the_run_itself(tmp_path, capsys):
    data = made_run(tmp_path, n_examples=0)
    automatic = [
        replace(row, conditions=row.conditions.but(gain_db=math.inf)) for row in data.recommendations
    ]
    print_opening(replace(data, recommendations=automatic), "runs/first")
    assert "'blurnoise program runs/first -o program'" in " ".join(capsys.readouterr().out.split())


# --- names that files bring are printed as they stand ---


FEW = "--exposure-ms 2,10 --lux 50 --dx 0 --threads 1 -o run"
NAMES = ("[/]", "sign [occluded]", r"$\frac{1}{", "止まれ", "red \x1b[31m", ":cat:")


@pytest.mark.slow
def test_a_sweep_tells_names_as_they_stand(tmp_path, capsys, monkeypatch):
    """A model and a target of each name, and a picture of 0 bytes whose name steers a terminal."""
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.chdir(tmp_path)
    cv2.imwrite("a.png", sign())
    Path("b\x1b[31m[b].png").write_bytes(b"")
    words = ["sweep", "--coco", "instances.json", *FEW.split()]
    data = {
        "images": [{"id": 0, "file_name": "a.png"}, {"id": 1, "file_name": "b\x1b[31m[b].png"}],
        "categories": [{"id": number, "name": name} for number, name in enumerate(NAMES)],
        "annotations": [
            {"image_id": image, "category_id": n, "bbox": [2, 2, 40, 40]}
            for image in (0, 1)
            for n in range(len(NAMES))
        ],
    }
    Path("instances.json").write_text(json.dumps(data))
    for number, name in enumerate(NAMES):
        model = matched_filter.build(Path(f"yolo[{number}].onnx"), sizes_px=(24, 16, 10), input_px=64)
        contract = {**Detector(model).contract.to_dict(), "classes": [name]}
        model.with_suffix(".contract.json").write_text(json.dumps(contract))
        words += ["--model", str(model), "--target", name]
    assert main(words) == 0
    told, warned = capsys.readouterr()
    assert all(f"yolo[{number}]" in told for number in range(len(NAMES)))
    assert "b?[31m[b].png" in told + warned or r"b\x1b[31m[b].png" in told + warned
    assert "\x1b" not in told + warned
    assert "Glyph" not in warned
    assert "Warning" not in warned


def test_an_error_is_one_plain_line(tmp_path, capsys):
    assert main(["measure", tmp_path / "a\x1b[31m\nblurnoise: all is well\u202e.png"]) == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1
    assert not {"\x1b", "\u202e"} & set(told)
    with pytest.raises(SystemExit):
        main(["sweep", "--lu\x1b[31m\nx"])
    told = capsys.readouterr().err
    assert (told.count("\n"), "\x1b" in told) == (1, False)
