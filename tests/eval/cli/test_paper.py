"""``blurnoise paper``: exit codes, and what stands where."""

from __future__ import annotations

import csv
from pathlib import Path

import commands
import pytest
from blurnoise_eval.paper import __main__ as paper
from blurnoise_eval.paper import formulas, table
from commands import main


def verdicts(folder: Path) -> list[str]:
    with (folder / "paper.csv").open(newline="") as file:
        return [row["verdict"] for row in csv.DictReader(file)]


def test_items_that_agree(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["paper", "-o", str(tmp_path / "out"), "--only", "table-2", "--only", "quanta"]) == 0
    assert verdicts(tmp_path / "out") == ["agrees"] * 10
    shown = capsys.readouterr().out
    assert "10 of 10 statements of the paper agree." in shown
    assert "paper.html" in shown
    told = commands.told(capsys, "paper", "-o", tmp_path, "--only", "quanta")
    assert told["rows"][0]["verdict"] == "agrees"


def test_what_differs_is_exit_code_1(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(formulas, "QUANTA", 5000.0)
    assert main(["paper", "-o", str(tmp_path), "--only", "quanta"]) == 1
    assert verdicts(tmp_path) == ["differs"]


def test_without_rapidocr_text_is_not_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("blurnoise_eval.detectors.ocr.packaged.rapidocr_models", lambda: None)
    assert main(["paper", "-o", str(tmp_path), "--only", "ocr", "--only", "quanta"]) == 0
    assert verdicts(tmp_path) == ["agrees", "not run"]
    assert "1 item was not run" in capsys.readouterr().out


@pytest.mark.parametrize("wrong", [["--only", "sharpness"], ["--seed", "-1"], ["--threads", "0"]])
def test_bad_input_writes_nothing(tmp_path: Path, wrong: list[str]) -> None:
    assert main(["paper", "-o", str(tmp_path / "out"), *wrong]) == 2
    assert not (tmp_path / "out").exists()


def test_help_names_every_item() -> None:
    assert ", ".join(item.name for item in table.ITEMS) == paper.ITEM_NAMES


@pytest.mark.slow
def test_charts_agree(tmp_path: Path) -> None:
    only = ("mtf50", "mtf50-dx", "patch-snr", "edge-snr", "clipping", "sic", "neq")
    arguments = [word for name in only for word in ("--only", name)]
    assert main(["paper", "-o", str(tmp_path), "--quick", *arguments]) == 0
    assert set(verdicts(tmp_path)) == {"agrees", "not judged"}


@pytest.mark.slow
def test_signs_agree(tmp_path: Path) -> None:
    assert main(["paper", "-o", str(tmp_path), "--quick", "--only", "detection", "--only", "maps"]) == 0
    assert set(verdicts(tmp_path)) == {"agrees", "not judged"}


@pytest.mark.slow
def test_text_over_speed_agrees(tmp_path: Path) -> None:
    pytest.importorskip("rapidocr")
    assert main(["paper", "-o", str(tmp_path), "--quick", "--only", "ocr-dx"]) == 0
    assert set(verdicts(tmp_path)) == {"agrees", "not judged"}
