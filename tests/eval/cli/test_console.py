"""What a sweep prints first: plain, nothing cut at any width, the same facts as the page."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from blurnoise_eval.cli.console import MOST_ROWS, print_assumed, print_models, print_opening
from blurnoise_eval.detectors.contract import preset
from made_runs import made_run
from rich.cells import cell_len

Output = pytest.CaptureFixture[str]
WIDE = {
    "groups": {f"objects of a rather long name, number {i} (32-96 px)": 0.95 - i / 20 for i in range(9)},
    "lights_lux": (0.5, 5.0, 50.0, 5000.0),
    "speeds": (0.0, 300.0, 1000.0, 3000.0),
    "models": ("a_model_of_one_very_long_name_v2_int8", "b", "c"),
}


def _printed(capsys: Output, folder: Path, **shape: Any) -> list[str]:
    print_opening(made_run(folder, n_examples=0, **shape))
    return capsys.readouterr().out.splitlines()


@pytest.mark.parametrize(
    "shape",
    [{}, {"interval": False}, {"kind": "reader"}, {"groups": {}}, WIDE, WIDE | {"f_numbers": (1.4, 2.8)}],
    ids=["one model", "few pictures", "reader", "no targets", "three models", "a further axis"],
)
def test_the_first_screen_fits_and_has_no_colour(
    tmp_path: Path, capsys: Output, monkeypatch: pytest.MonkeyPatch, shape: dict[str, Any]
) -> None:
    data = made_run(tmp_path, n_examples=0, **shape)
    for wide in (40, 60, 80, 100, 160):
        monkeypatch.setenv("COLUMNS", str(wide))
        print_opening(data)
        lines = capsys.readouterr().out.splitlines()
        assert lines
        assert max(map(cell_len, lines)) <= wide
        assert not any("\x1b" in line or "…" in line for line in lines)
        assert wide < 80 or len(lines) <= 20 + 4 * MOST_ROWS


def test_the_four_questions_stand_before_the_rows(tmp_path: Path, capsys: Output) -> None:
    lines = _printed(capsys, tmp_path)
    starts = ("Use 4 ms", "Which exposure?", "Which gain?", "How fast?", "How sure?", "stop sign 100 px, 24")
    places = [next(i for i, line in enumerate(lines) if line.startswith(start)) for start in starts]
    assert places == sorted(places)
    row = next(line for line in lines if line.startswith("  200 lux"))
    assert row.split() == ["200", "lux", ">=", "600", "px/s", "4", "ms", "6", "dB", "0.88", "(0.82-0.92)"]
    assert lines[-1] == "In answers.csv: every target, light and speed by itself."


def test_rows_that_are_left_out_are_counted(tmp_path: Path, capsys: Output) -> None:
    lines = _printed(capsys, tmp_path, **WIDE)
    shown = [
        line for line in lines if line.startswith("  ") and line[2:].lstrip()[:1].isdigit() and "lux" in line
    ]
    last = " ".join(lines[-2:])
    assert "more rows, and every target, light and speed by itself." in last
    assert 0 < len([line for line in shown if " dB " in line]) <= MOST_ROWS


@pytest.mark.parametrize("wide", [40, 80, 160, None])
@pytest.mark.parametrize("longest", [5, 17, 18, 60])
def test_numbers_of_models_are_whole_at_any_width(
    tmp_path: Path, capsys: Output, monkeypatch: pytest.MonkeyPatch, wide: int | None, longest: int
) -> None:
    if wide:
        monkeypatch.setenv("COLUMNS", str(wide))
    models = "標識_" + "m" * (longest - 5), "b", "c"
    print_models(made_run(tmp_path, n_examples=0, models=models).models)
    printed = capsys.readouterr().out
    assert wide is None or max(map(cell_len, printed.splitlines())) <= wide
    assert "…" not in printed
    for number in ("0.800", "0.780", "0.760", "0.740", "0.720", "30.0 (36.0)", "22.0 (28.0)"):
        assert number in printed
    assert "threads: 1" in " ".join(printed.split())


def test_what_a_contract_assumes_is_one_line(capsys: Output) -> None:
    stated = preset("yolox")
    print_assumed(stated, Path("folder/model.onnx"))
    assert capsys.readouterr().err == ""
    guessed = stated.sources | {"colour": "assumed (usual)", "value_range": "assumed (usual)"}
    print_assumed(replace(stated, sources=guessed), Path("folder/model.onnx"))
    assert capsys.readouterr().err == "model.onnx: assumed colour, value range; see blurnoise inspect\n"
