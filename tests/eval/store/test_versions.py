"""Runs of earlier versions are read: files that these versions have made, a picture and a few conditions each.

tests/data/runs/version-N is what ``blurnoise sweep --limit 1 --exposure-ms 5,60 --lux 50 --dx 0,300 --seed 3`` wrote
at the last commit whose tables were of version N, without its examples and the paths of the machine.
"""

from __future__ import annotations

import shutil
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest
from blurnoise_eval.evaluation import Evaluation
from blurnoise_eval.store import schema
from blurnoise_eval.store.exports import write_exports
from blurnoise_eval.store.store import Store, StoreError
from blurnoise_eval.system.files import RUN_FILE

RUNS = Path(__file__).parents[2] / "data" / "runs"


def made_by(version: int, folder: Path) -> Path:
    shutil.copytree(RUNS / f"version-{version}", folder)
    return folder


@pytest.mark.parametrize("read_only", [False, True])
@pytest.mark.parametrize("version", [3, 7, 9])
def test_run_of_an_earlier_version_is_read(
    version: int, read_only: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every row and number, and what it did not measure as nothing; a file that cannot be written stays as it is."""
    run = made_by(version, tmp_path / "run")
    with closing(sqlite3.connect(run / RUN_FILE)) as old:
        (held,) = old.execute("PRAGMA user_version").fetchone()
        told = old.execute("SELECT cell_id, target_confidence FROM cells ORDER BY cell_id").fetchall()
        boxes = old.execute("SELECT COUNT(*), SUM(x0), SUM(confidence) FROM targets").fetchone()
    assert held == version
    before = (run / RUN_FILE).read_bytes()
    if read_only:
        monkeypatch.setattr("blurnoise_eval.store.store._writable", lambda path: False)
    with Store(run) as store:
        cells = list(store.cells())
        assert sorted((cell["cell_id"], cell["target_confidence"]) for cell in cells) == told
        targets = list(store.targets())
        assert len(targets) == boxes[0]
        assert sum(row["x0"] for row in targets) == pytest.approx(boxes[1])
        assert {cell["moves"] for cell in cells} == {0.0, None}
        assert {cell["applied_exposure_s"] == cell["exposure_s"] for cell in cells} == {True}
        write_exports(store, tmp_path)
    found = Evaluation(run, output=tmp_path / "page")
    assert len(found.answers) > 0
    assert found.models[0]["p"] is not None
    assert ((run / RUN_FILE).read_bytes() == before) == read_only
    with Store(run) as again:
        assert list(again.cells()) == cells


def test_run_of_a_later_version_is_refused(tmp_path: Path) -> None:
    """It has a column that is not known here; one that lacks a column gets it."""
    with Store(tmp_path, create=True):
        pass
    with closing(sqlite3.connect(tmp_path / RUN_FILE)) as database:
        database.execute("ALTER TABLE cells ADD COLUMN phase_rad REAL")
        database.execute("PRAGMA user_version = 999")
    with pytest.raises(StoreError, match="later version of blurnoise, which reads it"):
        Store(tmp_path)


def test_a_new_column_is_a_new_version(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A run made before an axis was added is read with NULL in its place, and of that version then."""
    with Store(tmp_path, create=True) as store:
        before = store.columns("cells")
    more = schema.TABLES.replace("seed INTEGER", "phase_rad REAL, seed INTEGER")
    monkeypatch.setattr(schema, "TABLES", more)
    monkeypatch.setattr(schema, "VERSION", schema.VERSION + 1)
    with Store(tmp_path) as store:
        assert set(store.columns("cells")) == {*before, "phase_rad"}
    with closing(sqlite3.connect(tmp_path / RUN_FILE)) as database:
        assert database.execute("PRAGMA user_version").fetchone() == (schema.VERSION,)
