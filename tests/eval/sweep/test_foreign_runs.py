"""Runs of somebody else: files that they name outside their own folder are refused; devices and pipes stay shut."""

from __future__ import annotations

import json
import os
import shutil
import sqlite3
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from blurnoise_eval import datasets
from blurnoise_eval.evaluation import evaluate
from blurnoise_eval.grid.conditions import SweepPlan
from blurnoise_eval.sweep.coco_export import INSTANCES
from blurnoise_eval.system.files import RUN_FILE
from commands import main

PLAN = SweepPlan({"exposure_s": (0.005,), "illuminance_lux": (50.0,), "velocity_x_px_s": (0.0,)})


@pytest.fixture(scope="module")
def sent(tmp_path_factory: pytest.TempPathFactory) -> Path:
    every = datasets.rendered_signs()
    run = tmp_path_factory.mktemp("sent") / "run"
    evaluate(pictures=replace(every, pictures=every.pictures[:1]), plan=PLAN, output=run, threads=1)
    return run


def commands(run: Path, output: Path) -> list[list[str]]:
    return [["merge", str(run), "-o", str(output)], ["report", str(run)]]


def name_example(run: Path, name: str) -> None:
    with closing(sqlite3.connect(run / RUN_FILE)) as db, db:
        assert db.execute("UPDATE cells SET example = ? WHERE example IS NOT NULL", (name,)).rowcount


@pytest.mark.parametrize("name", ["../secrets/new", "/dev/zero", "examples/link.png", "examples/../../x.png"])
@pytest.mark.parametrize("command", [0, 1])
def test_examples_outside_are_refused(
    sent: Path, tmp_path: Path, name: str, command: int, capsys: pytest.CaptureFixture[str]
) -> None:
    run = shutil.copytree(sent, tmp_path / "run")
    (tmp_path / "secrets").mkdir()
    (tmp_path / "secrets" / "key").write_text("mine")
    (run / "examples" / "link.png").symlink_to(tmp_path / "secrets" / "key")
    name_example(run, name)
    assert main(commands(run, tmp_path / "merged")[command]) == 2
    assert "leaves the folder" in capsys.readouterr().err
    assert [file.name for file in (tmp_path / "secrets").iterdir()] == ["key"]
    assert not (tmp_path / "merged").exists()


@pytest.mark.parametrize("what", ["examples/pipe.png", str(INSTANCES)])
@pytest.mark.parametrize("command", [0, 1])
def test_pipes_are_not_read(sent: Path, tmp_path: Path, what: str, command: int) -> None:
    run = shutil.copytree(sent, tmp_path / "run")
    (run / what).unlink(missing_ok=True)
    os.mkfifo(run / what)
    if what != str(INSTANCES):
        name_example(run, what)
    assert main(commands(run, tmp_path / "merged")[command]) == (2 if what == str(INSTANCES) else 0)


@pytest.mark.parametrize(
    ("name", "command"),
    [("figures", "report"), ("coco", "report --coco"), ("coco", "report"), (RUN_FILE, "report")],
)
def test_links_are_not_followed(
    sent: Path, tmp_path: Path, name: str, command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    run = shutil.copytree(sent, tmp_path / "run")
    (run / "figures").mkdir()
    (run / name).replace(tmp_path / name)
    (run / name).symlink_to(tmp_path / name)
    before = {file: file.stat().st_mtime_ns for file in tmp_path.glob(f"{name}/**/*")}
    assert main([*command.split(), str(run)]) == 2
    assert "leaves the folder" in capsys.readouterr().err
    assert {file: file.stat().st_mtime_ns for file in tmp_path.glob(f"{name}/**/*")} == before


def test_a_model_of_any_name_has_its_detections_within(sent: Path, tmp_path: Path) -> None:
    run = shutil.copytree(sent, tmp_path / "run")
    with closing(sqlite3.connect(run / RUN_FILE)) as db, db:
        (text,) = db.execute("SELECT value FROM about WHERE key = 'manifest'").fetchone()
        manifest: dict[str, Any] = json.loads(text)
        manifest["models"][0]["name"] = "../../away"
        db.execute("UPDATE about SET value = ? WHERE key = 'manifest'", (json.dumps(manifest),))
    assert main(["report", "--coco", str(run)]) == 2
    assert not list(tmp_path.glob("**/away"))


ROWS = {
    "cells.detections: must have 24": "UPDATE cells SET detections = X'616263'",
    "cells.detections: is missing": "UPDATE cells SET detections = NULL",
    "cells.detections: holds text": "UPDATE cells SET detections = 'hello'",
    "cells.detections: class": "UPDATE cells SET detections = X'" + "00" * 20 + "FFFFFF7F'",
    "cells.detections: boxes": "UPDATE cells SET detections = X'" + "FF" * 20 + "00000000'",
    "cells.exposure_s: holds text": "UPDATE cells SET exposure_s = 'x'",
    "cells.example: holds blob": "UPDATE cells SET example = X'FF'",
    "cells.image: holds blob": "UPDATE cells SET image = X'FF'",
    "cells.model: 'other'": "UPDATE cells SET model = 'other'",
    "targets.model: 'other'": "UPDATE targets SET model = 'other'",
    "targets.confidence: holds blob": "UPDATE targets SET confidence = X'FF'",
    "targets.confidence: is missing": "UPDATE targets SET confidence = NULL",
    "targets.cell_id: ": "DELETE FROM cells",
    "software.versions: value": "UPDATE software SET versions = '[1]'",
    "software.versions: Expecting": "UPDATE software SET versions = '{'",
    "asked: value": "INSERT INTO about VALUES ('asked', '{\"a\": 1}')",
    "manifest: is nested too deeply": f"UPDATE about SET value = '{'[' * 100_000}' WHERE key = 'manifest'",
    "manifest: models.0": "UPDATE about SET value = json_set(value, '$.models[0].contract.classes', json('[{}]'))"
    " WHERE key = 'manifest'",
    "identity: plan": "UPDATE about SET value = json_set(value, '$.plan.grid', json('"
    + json.dumps({name: [*range(300)] for name in ("exposure_s", "illuminance_lux", "velocity_x_px_s")})
    + "')) WHERE key = 'identity'",
    "cells: is a view": "ALTER TABLE cells RENAME TO held; CREATE VIEW cells AS WITH RECURSIVE endless(n) AS"
    " (SELECT 1 UNION ALL SELECT n + 1 FROM endless) SELECT held.* FROM held, endless",
    "seldom: is a trigger": "CREATE TRIGGER seldom AFTER INSERT ON about BEGIN DELETE FROM cells; END",
}


@pytest.mark.parametrize("told", ROWS)
def test_rows_that_no_sweep_writes_are_a_line(
    sent: Path, tmp_path: Path, told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    run = shutil.copytree(sent, tmp_path / "run")
    with closing(sqlite3.connect(run / RUN_FILE)) as db, db:
        db.executescript(ROWS[told])
    assert main(["report", str(run)]) == 2
    (line,) = [each for each in capsys.readouterr().err.splitlines() if "error" in each]
    assert line.startswith(f"blurnoise: error: run = {str(run)!r}: {RUN_FILE} is damaged")
    assert f"({told}" in line
