"""Working folders: a run at a URL is fetched, worked on here and put back when the work ends or stops."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from blurnoise_eval.system.files import RUN_FILE
from blurnoise_eval.system.urls import listing, location
from blurnoise_eval.system.working_folder import output_folder, read_run, written_run

fsspec = pytest.importorskip("fsspec")
pytest.importorskip("upath")
URL = "memory://bucket/run"
RUN: Any = location(URL)


@pytest.fixture(autouse=True)
def empty(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setenv("BLURNOISE_CACHE", str(tmp_path / "cache"))
    fsspec.filesystem("memory").store.clear()
    yield
    fsspec.filesystem("memory").store.clear()


def there() -> dict[str, bytes]:
    return {name: (RUN / name).read_bytes() for name in listing(RUN)}


def work(folder: Path, **files: str) -> None:
    for name, text in files.items():
        (folder / name.replace("_", ".")).write_text(text)


def test_what_was_written_is_there_at_the_end(tmp_path: Path) -> None:
    with written_run(RUN) as folder:
        work(folder.path, results_sqlite="rows", report_html="page")
        (folder.path / "examples").mkdir()
        (folder.path / "examples/a.png").write_text("picture")
        (folder.path / f"{RUN_FILE}-wal").write_text("SQLite's own")
        assert folder.told(folder.path / "report.html") == f"{URL}/report.html"
    assert there() == {"examples/a.png": b"picture", "report.html": b"page", RUN_FILE: b"rows"}
    assert not list((tmp_path / "cache/runs").iterdir()), "nothing stays here"


def test_another_machine_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with written_run(RUN) as folder:
        work(folder.path, results_sqlite="rows", summary_json="{}")
    monkeypatch.setenv("BLURNOISE_CACHE", str(tmp_path / "another"))
    with written_run(RUN) as folder:
        assert (folder.path / RUN_FILE).read_text() == "rows"
        assert not (folder.path / "summary.json").exists(), "is made anew"
        work(folder.path, results_sqlite="rows and more")
    assert there() == {RUN_FILE: b"rows and more", "summary.json": b"{}"}


def test_what_was_done_before_it_was_stopped_is_put() -> None:
    def interrupted() -> None:
        with written_run(RUN) as folder:
            work(folder.path, results_sqlite="some rows")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert there() == {RUN_FILE: b"some rows"}


def test_results_that_another_machine_has_put_meanwhile_stay(tmp_path: Path) -> None:
    def overtaken() -> None:
        with written_run(RUN) as folder:
            work(folder.path, results_sqlite="rows of this one")
            (RUN / RUN_FILE).write_bytes(b"rows of another machine")

    with pytest.raises(ValueError, match=f"run = '{URL}': another process has put"):
        overtaken()
    assert there() == {RUN_FILE: b"rows of another machine"}
    (here,) = (tmp_path / "cache/runs").glob(f"*/{RUN_FILE}")
    assert here.read_text() == "rows of this one"


def test_what_cannot_be_put_stays_and_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def denied(*_: object) -> None:
        raise PermissionError

    monkeypatch.setattr(type(RUN.fs), "put", denied)
    with (
        pytest.raises(OSError, match=r"denied.*; what was not put is in") as told,
        written_run(RUN) as folder,
    ):
        work(folder.path, results_sqlite="rows")
    (here,) = (tmp_path / "cache/runs").glob(f"*/{RUN_FILE}")
    assert here.read_text() == "rows"
    assert str(here.parent) in str(told.value)


def test_reading_leaves_the_results_as_they_are(tmp_path: Path) -> None:
    (RUN / RUN_FILE).write_bytes(b"rows")
    with read_run(RUN) as folder:
        work(folder.path, results_sqlite="touched", report_html="page")
    assert there() == {RUN_FILE: b"rows", "report.html": b"page"}
    with output_folder(RUN / "coco") as folder:
        work(folder.path, a_json="{}")
    assert there()["coco/a.json"] == b"{}"
    assert not list((tmp_path / "cache/runs").iterdir())
