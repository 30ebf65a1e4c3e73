"""The command, from a small sweep to its files, and what it refuses."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest
from blurnoise_eval.program.optimise import Stages
from commands import main

pytestmark = pytest.mark.slow
GRID = ["--exposure-ms", "0.5,4,32", "--lux", "2,40", "--dx", "0,800", "--limit", "1"]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("sweep") / "run"
    assert main(["sweep", "-o", str(folder), *GRID]) == 0
    return folder


def test_a_program_from_a_sweep(run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    capsys.readouterr()
    assert main(["program", str(run), "-o", str(tmp_path / "out"), "--speeds", "0:0.7,800:0.3"]) == 0
    told = capsys.readouterr().out.splitlines()
    assert told[0].startswith("From 2 to 40 lux this program reaches mean confidence 0.")
    assert max(map(len, told[:-1])) <= 80
    written = {path.name for path in (tmp_path / "out").iterdir()}
    assert written == {"program.csv", "program.json", "program.png", "libcamera.json"}
    with (tmp_path / "out" / "program.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 10  # half stops, or a little less, from 2 to 40 lux
    assert all(0.0005 * 0.8 <= float(row["exposure_s"]) <= 1 / 30 for row in rows)
    mode = json.loads((tmp_path / "out" / "libcamera.json").read_text())["rpi.agc"]["exposure_modes"][
        "custom"
    ]
    assert mode["shutter"][0] == 20
    Stages(tuple(time / 1e6 for time in mode["shutter"]), tuple(mode["gain"]))


def test_the_best_fixed_time_is_what_the_report_recommends(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with (run / "recommendations.csv").open(newline="") as file:
        (whole,) = [row for row in csv.DictReader(file) if row["scope"] == "all"]
    capsys.readouterr()
    assert main(["program", str(run), "-o", str(tmp_path)]) == 0
    found = json.loads((tmp_path / "program.json").read_text())
    assert found["best_fixed_s"] == float(whole["exposure_s"])


@pytest.mark.parametrize(
    ("options", "named"),
    [
        (
            ["--anti-flicker", "50", "--fps", "125"],
            "whole periods of 50 Hz mains, exposures from 20 us on: leave no exposure at any light",
        ),
        (["--lux", "2:100000000"], "the run covers light x exposure"),
        (["--model", "other"], "model = 'other': must be one of stop_sign"),
        (["--targets", "cat"], "targets = 'cat'"),
        (["--speeds", "0:0.5,800:0.2,800.0:0.3"], "must have each entry once"),
        (["--least-exposure-us", "0"], "least_exposure_s = 0"),
    ],
)
def test_what_it_refuses(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], named: str
) -> None:
    capsys.readouterr()
    assert main(["program", str(run), "-o", str(tmp_path / "out"), *options]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert named in error
    assert not (tmp_path / "out").exists()


def test_a_fixed_gain_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    grid = ["--exposure-ms", "4", "--lux", "40", "--dx", "0", "--limit", "1", "--gain", "6"]
    assert main(["sweep", "-o", str(tmp_path / "run"), *grid]) == 0
    assert main(["program", str(tmp_path / "run"), "-o", str(tmp_path / "out")]) == 2
    assert "gain 6 dB; a program needs a run with --gain auto" in capsys.readouterr().err
