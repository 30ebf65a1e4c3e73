"""The rerun of the paper as a command: exit codes, and what stands where."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest
from blurnoise_eval.paper import items
from commands import Output, main


def verdicts(folder: Path, *names: str, code: int = 0) -> set[str]:
    only = [word for name in names for word in ("--only", name)]
    assert main(["paper", "-o", str(folder / "out"), "--quick", *only]) == code
    with (folder / "out" / "paper.csv").open(newline="") as file:
        return {row["verdict"] for row in csv.DictReader(file)}


def test_items_that_agree(tmp_path: Path, capsys: Output) -> None:
    assert verdicts(tmp_path, "table-2", "quanta") == {"agrees"}
    shown = capsys.readouterr().out
    assert "10 of 10 statements of the paper agree." in shown
    assert "paper.html" in shown


def test_what_differs_is_exit_code_1(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(items, "QUANTA", 5000.0)
    assert verdicts(tmp_path, "quanta", code=1) == {"differs"}


def test_without_rapidocr_text_is_not_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("blurnoise_eval.detectors.ocr.rapidocr_models", lambda: None)
    assert verdicts(tmp_path, "ocr", "quanta") == {"agrees", "not run"}


@pytest.mark.parametrize("wrong", [["--only", "sharpness"], ["--threads", "0"]])
def test_bad_input_writes_nothing(tmp_path: Path, wrong: list[str]) -> None:
    assert main(["paper", "-o", str(tmp_path / "out"), *wrong]) == 2
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("names", "found"),
    [
        (("mtf50", "mtf50-dx", "patch-snr", "edge-snr", "clipping", "sic", "neq"), {"agrees"}),
        (("detection", "maps"), {"agrees", "not judged"}),
        (("ocr-dx",), {"agrees", "not judged"}),
    ],
)
def test_the_paper_agrees(tmp_path: Path, names: tuple[str, ...], found: set[str]) -> None:
    if "ocr-dx" in names:
        pytest.importorskip("rapidocr")
    assert verdicts(tmp_path, *names) == found
