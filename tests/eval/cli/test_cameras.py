"""Cameras at the command: the table, a file's way through it, and what is wrong with one."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from blurnoise_eval.datasets import write_picture
from commands import main, told

from blurnoise.optics.camera import PRESETS, Camera

Output = pytest.CaptureFixture[str]


def refused(capsys: Output, named: str, *arguments: object) -> None:
    assert main(list(map(str, arguments))) == 2
    out, err = capsys.readouterr()
    assert (out, len(err.splitlines())) == ("", 1)
    assert named in err


def test_list_has_a_line_for_each_preset(capsys: Output) -> None:
    assert main(["cameras"]) == 0
    out = capsys.readouterr().out
    assert "…" not in out
    assert max(map(len, out.splitlines())) <= 80
    rows = {
        line.split()[0]: line.split()[1:] for line in out.splitlines() if line and line.split()[0] in PRESETS
    }
    assert list(rows) == list(PRESETS)
    assert rows["imx250"] == [
        "3.45", "10715", "2.45", "0.3816", "12", "2464x2056", "10715", "40.3", "70.7",
    ]  # fmt: skip
    assert rows["lin2024"][6] == "696"


def test_one_camera_shows_every_figure_and_source(capsys: Output, tmp_path: Path) -> None:
    assert main(["cameras", "imx250"]) == 0
    out = capsys.readouterr().out
    words = " ".join(out.split())
    for name in PRESETS["imx250"].to_dict():
        assert name in words or name == "sources"
    for text in ("0.6 at 525 nm", "quoted: manual", "chosen: the full well is full scale", "10715"):
        assert text in words
    many = {"wavelengths_nm": list(range(400, 701)), "values": [0.5] * 301}
    path = tmp_path / "own.json"
    path.write_text(json.dumps({"base": "imx250", "quantum_efficiency": many}))
    assert main(["cameras", str(path)]) == 0
    words = " ".join(capsys.readouterr().out.split())
    assert "301 samples" in words
    assert "from own.json" in words


def test_saved_edited_and_used(tmp_path: Path, capsys: Output) -> None:
    """The way of one's own camera: saved, edited, simulated with; its lens and noise are in the picture."""
    path = tmp_path / "mine.yaml"
    assert main(["cameras", "imx250", "--save", str(path)]) == 0
    assert str(path) in capsys.readouterr().out
    assert Camera.load(path) == PRESETS["imx250"]
    path.write_text(path.read_text().replace("f_number: 1.4", "f_number: 2.8"))
    write_picture(tmp_path / "scene.png", np.full((8, 9), 200, np.uint8))
    command = ("simulate", tmp_path / "scene.png", "-o", tmp_path / "out.png")
    mine = told(capsys, *command, "--camera", path)
    preset = told(capsys, *command, "--camera", "imx250")
    assert preset["white_electrons"] == pytest.approx(4 * mine["white_electrons"])
    back = told(capsys, *command, "--camera", path, "--f-number", 1.4)
    assert back["white_electrons"] == pytest.approx(preset["white_electrons"])


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (("pinhole",), "camera = 'pinhole': neither a preset nor a file; presets are ar0132at"),
        (("nowhere.yaml",), "neither a preset nor a file"),
        (("bad.yaml",), "bad.yaml: field 'read_noise' is unknown; did you mean 'read_noise_e'"),
        (("imx250", "--save", "mine.txt"), "suffix of mine.txt"),
        (("imx250", "--save", "nowhere/mine.yaml"), "nowhere/mine.yaml"),
        (("--save", "mine.yaml"), "needs a camera"),
    ],
)
def test_bad_input_is_one_line_and_leaves_nothing(
    tmp_path: Path, capsys: Output, monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...], named: str
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bad.yaml").write_text("base: imx250\nread_noise: 3\n")
    refused(capsys, named, "cameras", *arguments)
    assert [path.name for path in tmp_path.iterdir()] == ["bad.yaml"]
    if len(arguments) == 1:
        refused(capsys, named, "sweep", "--camera", *arguments, "-o", "run")
