"""Runs whose documents are cut, empty or of other software: an error of one line, whoever reads them."""

from __future__ import annotations

import json
import shutil
import sqlite3
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest
from blurnoise_eval import datasets
from blurnoise_eval.evaluation import evaluate
from blurnoise_eval.grid.conditions import SweepPlan
from blurnoise_eval.system.files import RUN_FILE
from commands import main

PLAN = SweepPlan({"exposure_s": (0.005,), "illuminance_lux": (50.0,), "velocity_x_px_s": (0.0,)})


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    every = datasets.rendered_signs()
    run = tmp_path_factory.mktemp("whole") / "run"
    evaluate(pictures=replace(every, pictures=every.pictures[:1]), plan=PLAN, output=run, threads=1)
    return run


def write(run: Path, key: str, value: object) -> None:
    with closing(sqlite3.connect(run / RUN_FILE)) as db, db:
        db.execute("UPDATE about SET value = ? WHERE key = ?", (json.dumps(value), key))


@pytest.mark.parametrize("command", ["report", "merge", "explore", "maps", "program"])
@pytest.mark.parametrize("value", [{}, [], None, {"version": 9}, "run"])
def test_another_manifest_is_a_line(
    whole: Path, command: str, value: object, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = shutil.copytree(whole, tmp_path / "run")
    write(run, "manifest", value)
    output = tmp_path / ("new.png" if command == "explore" else "new")
    assert main([command, str(run), *(() if command == "report" else ("-o", str(output)))]) == 2
    said = capsys.readouterr().err.splitlines()
    assert len([line for line in said if line.startswith("blurnoise: error: run = ")]) == 1
    assert not output.exists()
