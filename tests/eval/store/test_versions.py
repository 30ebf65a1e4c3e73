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
from blurnoise_eval.store.exports import write_exports
from blurnoise_eval.store.schema import READ_BY, UPGRADES, VERSION
from blurnoise_eval.store.store import Store, StoreError
from blurnoise_eval.sweep.evaluation import Evaluation
from blurnoise_eval.system.files import RUN_FILE

RUNS = Path(__file__).parents[2] / "data" / "runs"


def made_by(version: int, folder: Path) -> Path:
    shutil.copytree(RUNS / f"version-{version}", folder)
    return folder


def test_every_version_since_the_first_has_its_way() -> None:
    assert sorted([*READ_BY, *UPGRADES, VERSION]) == [0, *range(2, VERSION + 1)]


@pytest.mark.parametrize("read_only", [False, True])
@pytest.mark.parametrize("version", UPGRADES)
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


def test_run_too_old_names_who_reads_it(tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    shutil.copy(RUNS / "version-2" / RUN_FILE, tmp_path / "run")
    with pytest.raises(StoreError, match=r"version 2.*commit c423369 reads it"):
        Store(tmp_path / "run")


def test_run_of_a_later_version_is_refused(tmp_path: Path) -> None:
    with Store(tmp_path, create=True):
        pass
    with closing(sqlite3.connect(tmp_path / RUN_FILE)) as database:
        database.execute("PRAGMA user_version = 999")
    with pytest.raises(StoreError, match=rf"another version.*999.*reads versions 3 to {VERSION}"):
        Store(tmp_path)
