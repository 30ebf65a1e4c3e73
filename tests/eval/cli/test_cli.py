"""A sweep at the command line: what it leaves, that it goes on, and one line for whatever stops it."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import matched_filter
import pandas as pd
import pytest
from blurnoise_eval.report import page
from blurnoise_eval.store.store import Store
from blurnoise_eval.sweep import run as sweep
from commands import Output, main
from signs_in_memory import BOX, sign


@pytest.fixture(scope="module")
def words(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
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
def run(tmp_path_factory: pytest.TempPathFactory, words: list[str]) -> Path:
    """A finished sweep."""
    folder = tmp_path_factory.mktemp("runs") / "run"
    assert main([*words, "-o", folder]) == 0
    return folder


def test_sweep_leaves_a_folder_that_answers(run: Path) -> None:
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


def test_same_sweep_again_computes_nothing(
    run: Path, words: list[str], capsys: Output, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(page, "write_report", lambda data, folder, progress: folder)
    assert main([*words, "-o", run, "--json"]) == 0
    out, err = capsys.readouterr()
    summary = json.loads(out)
    assert (summary["computed"], summary["resumed"], summary["cells"]) == (0, 10, 10)
    assert "b.png" in err


def test_interrupt_is_told(
    tmp_path: Path, capsys: Output, words: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(sweep, "run", interrupted)
    assert main([*words, "-o", tmp_path / "run"]) == 130
    err = capsys.readouterr().err
    assert (len(err.strip().splitlines()), "kept" in err) == (1, True)


def test_run_in_use_and_damaged_run(tmp_path: Path, capsys: Output) -> None:
    def complaint() -> str:
        assert main(["report", tmp_path / "run"]) == 2
        out, err = capsys.readouterr()
        assert (out, err.count("\n")) == ("", 1)
        return err

    with Store(tmp_path / "run", create=True):
        assert "another process" in complaint()
    assert "no sweep has begun" in complaint()
    (tmp_path / "run" / "results.sqlite").write_text("no database " * 100)
    assert "damaged" in complaint()
