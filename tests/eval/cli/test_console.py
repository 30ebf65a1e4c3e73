"""What a sweep prints first: plain, nothing cut at any width, the same facts as the page."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from blurnoise_eval.cli.console import print_opening
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
    [
        {},
        {"interval": False},
        {"kind": "reader"},
        {"groups": {}},
        WIDE,
        WIDE | {"groups": {"sign": 0.9}, "f_numbers": (1.4, 2.8)},
    ],
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
        assert wide < 80 or len(lines) <= (20 if data.manifest["models"][1:] == [] else 40)


def test_the_answer_of_one_model_fits_a_screen(tmp_path: Path, capsys: Output) -> None:
    """20 lines, so that 24 hold the command and the last line, too; whole where nothing is a terminal."""
    lines = _printed(capsys, tmp_path)
    assert lines[0].startswith("Best single exposure: 16 ms.")
    assert len(lines) <= 20
    (bright,) = (line for line in lines if line.startswith("  200 lux"))
    assert bright.split()[:6] == ["200", "lux", "4", "ms", "0.69", "sure"]
    assert lines[-2].startswith("Limits: ")
    assert lines[-1].startswith("Surer: ")


def test_two_models_on_the_usual_grid_leave_room_for_the_command_and_the_last_lines(
    tmp_path: Path, capsys: Output
) -> None:
    """Only the first model's sentence names what is averaged over; the legend is a line."""
    grid = {"lights_lux": (1.0, 30.0, 1000.0, 20_000.0), "speeds": (0.0, 300.0, 1000.0)}
    lines = _printed(capsys, tmp_path, models=("yolox_nano", "fastestdet_upstream"), **grid)
    assert len(lines) <= 20
    assert " ".join(lines).count(" on average over ") == 1
    assert sum("cannot tell" in line for line in lines) == 1
    (legend,) = (line for line in lines if line.startswith("  sure: "))
    assert legend.endswith("cannot tell")


def test_cells_that_are_left_out_are_counted(tmp_path: Path, capsys: Output) -> None:
    lines = _printed(capsys, tmp_path, **WIDE)
    assert "4 more cells: recommendations.csv" in " ".join(" ".join(lines).split())
    assert sum(" lux " in line and line.startswith("  ") for line in lines) == 4


def test_speeds_that_do_not_fit_are_left_out_of_the_table(
    tmp_path: Path, capsys: Output, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each row stays one line."""
    monkeypatch.setenv("COLUMNS", "80")
    shape: dict[str, Any] = {"lights_lux": (0.5, 20000.0), "speeds": (0.0, 300.0, 1000.0)}
    exposures = (0.0000312, 0.000125, 0.0005)
    lines = _printed(capsys, tmp_path, groups={"sign": 0.95}, exposures_s=exposures, **shape)
    (bright,) = (line for line in lines if line.startswith("  20000 lux"))
    assert bright.count("ms") == 3
    (heads,) = (line for line in lines if "any speed" in line)
    assert "300 px/s" not in heads
