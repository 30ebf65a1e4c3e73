"""Working folders: a run at a URL is fetched, worked on here and put back; one machine at a time writes it."""

from __future__ import annotations

import json
import sqlite3
import time
from collections.abc import Iterator
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from blurnoise_eval.system import working_folder
from blurnoise_eval.system.files import RUN_FILE
from blurnoise_eval.system.storage import Url, listing, location
from blurnoise_eval.system.working_folder import output_folder, read_run, written_run

fsspec = pytest.importorskip("fsspec")
URL = "memory://bucket/run"


@pytest.fixture(autouse=True)
def empty(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setenv("BLURNOISE_CACHE", str(tmp_path / "cache"))
    fsspec.filesystem("memory").store.clear()
    yield
    fsspec.filesystem("memory").store.clear()


def run() -> Url:
    found: Url = location(URL)
    return found


def there() -> dict[str, bytes]:
    return {name: (run() / name).read_fresh() for name in listing(run())}


def work(folder: Path, **files: str) -> None:
    for name, text in files.items():
        (folder / name.replace("_", ".")).write_text(text)


def test_what_was_written_is_there_at_the_end(tmp_path: Path) -> None:
    with written_run(run()) as folder:
        work(folder.path, results_sqlite="rows", report_html="page")
        (folder.path / "examples").mkdir()
        (folder.path / "examples/a.png").write_text("picture")
        assert list(there()) == [working_folder.LOCK]
    assert there() == {"examples/a.png": b"picture", "report.html": b"page", RUN_FILE: b"rows"}
    assert not list((tmp_path / "cache/runs").glob("*/*")), "nothing stays here"


def test_another_machine_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with written_run(run()) as folder:
        work(folder.path, results_sqlite="rows", summary_json="{}")
    monkeypatch.setenv("BLURNOISE_CACHE", str(tmp_path / "another"))
    with written_run(run()) as folder:
        assert (folder.path / RUN_FILE).read_text() == "rows"
        assert not (folder.path / "summary.json").exists(), "is made anew"
        work(folder.path, results_sqlite="rows and more")
    assert there() == {RUN_FILE: b"rows and more", "summary.json": b"{}"}


def test_only_what_has_changed_is_put(monkeypatch: pytest.MonkeyPatch) -> None:
    with written_run(run()) as folder:
        work(folder.path, results_sqlite="rows")
        (folder.path / "examples").mkdir()
        (folder.path / "examples/a.png").write_text("picture")
    put = []
    monkeypatch.setattr(working_folder, "put_file", lambda file, url: put.append(url.name))
    with written_run(run()) as folder:
        work(folder.path, report_html="page", scores_csv="a")
    assert put == ["scores.csv", "report.html"]


def test_what_was_done_before_an_error_is_kept() -> None:
    def interrupted() -> None:
        with written_run(run()) as folder:
            work(folder.path, results_sqlite="some rows")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert there() == {RUN_FILE: b"some rows"}


def test_what_cannot_be_put_waits_here(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(file: Path, url: Url) -> None:
        raise PermissionError(13, "denied", str(url))

    with monkeypatch.context() as patch:
        patch.setattr(working_folder, "put_file", fail)
        with pytest.raises(PermissionError, match="denied"), written_run(run()) as folder:
            work(folder.path, results_sqlite="rows")
    with written_run(run()) as folder:
        assert (folder.path / RUN_FILE).read_text() == "rows"
    assert there() == {RUN_FILE: b"rows"}


def test_the_newer_results_are_gone_on_from(monkeypatch: pytest.MonkeyPatch) -> None:
    """Those here where nobody has put others since; those there where somebody has; none where they are gone."""

    def left_here(text: str) -> None:
        with monkeypatch.context() as patch:
            patch.setattr(working_folder, "put_file", _denied)
            with pytest.raises(PermissionError), written_run(run()) as folder:
                work(folder.path, results_sqlite=text)

    def gone_on_from() -> str:
        with written_run(run()) as folder:
            file = folder.path / RUN_FILE
            return file.read_text() if file.exists() else ""

    with written_run(run()) as folder:
        work(folder.path, results_sqlite="rows")
    left_here("rows and more")
    assert gone_on_from() == "rows and more"
    left_here("rows and more again")
    time.sleep(0.01)
    (run() / RUN_FILE).put(b"rows of another machine")
    assert gone_on_from() == "rows of another machine"
    left_here("rows")
    (run() / RUN_FILE).unlink()
    assert gone_on_from() == ""


def _denied(file: Path, url: Url) -> None:
    raise PermissionError(13, "denied", str(url))


def test_one_process_at_a_time() -> None:
    with (
        written_run(run()),
        pytest.raises(ValueError, match=f"run = '{URL}': another process is using it"),
        written_run(run()),
    ):
        pass


def test_one_machine_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(working_folder, "WATCHED_S", 0.1)
    lock = run() / working_folder.LOCK
    held = partial(dict, host="another", process=1)
    lock.put(json.dumps(held(time_s=time.time() - 200)).encode())
    with pytest.raises(ValueError, match="another is writing it, as of 200 s ago"), written_run(run()):
        pass
    assert lock.exists(), "theirs"
    lock.put(json.dumps(held(time_s=time.time() - 400)).encode())
    with written_run(run()):
        assert json.loads(lock.read_fresh())["host"] != "another"
    assert not lock.exists()


def elsewhere(monkeypatch: pytest.MonkeyPatch, name: str, tmp_path: Path) -> None:
    """Be another machine."""
    monkeypatch.setattr("socket.gethostname", lambda: name)
    monkeypatch.setenv("BLURNOISE_CACHE", str(tmp_path / name))


def test_who_stood_still_puts_nothing_over_another_and_leaves_its_lock(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(working_folder, "WATCHED_S", 0.1)
    monkeypatch.setattr(working_folder, "RESPECTED_S", 0.0)
    monkeypatch.setattr(working_folder, "RENEW_S", 3600.0)  # it stands still
    elsewhere(monkeypatch, "one", tmp_path)
    with written_run(run()) as folder:
        work(folder.path, results_sqlite="rows")
    lock = run() / working_folder.LOCK
    stood_still = ExitStack()
    folder = stood_still.enter_context(written_run(run()))
    (folder.path / RUN_FILE).write_text("rows of one")
    elsewhere(monkeypatch, "other", tmp_path)
    with written_run(run()) as other:
        (other.path / RUN_FILE).write_text("rows of other")
        elsewhere(monkeypatch, "one", tmp_path)
        with pytest.raises(ValueError, match="other has taken it over"):
            stood_still.close()
        assert json.loads(lock.read_fresh())["host"] == "other"
    assert there() == {RUN_FILE: b"rows of other"}


@pytest.mark.parametrize("off_s", [-3600.0, 3600.0])
def test_clocks_that_differ_take_no_lock_of_who_lives(
    off_s: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nor does one that was set back keep a lock of who is gone."""
    monkeypatch.setattr(working_folder, "WATCHED_S", 2.0)
    clock = time.time
    monkeypatch.setattr(working_folder, "RENEW_S", 0.05)
    elsewhere(monkeypatch, "one", tmp_path)
    with written_run(run()):
        elsewhere(monkeypatch, "other", tmp_path)
        monkeypatch.setattr("time.time", lambda: clock() + off_s)
        lock = run() / working_folder.LOCK
        lock.put(json.dumps({**json.loads(lock.read_fresh()), "time_s": clock()}).encode())
        with pytest.raises(ValueError, match="one is writing it"), written_run(run()):
            pass
    monkeypatch.setattr("time.time", clock)
    monkeypatch.setattr(working_folder, "WATCHED_S", 0.1)
    (run() / working_folder.LOCK).put(json.dumps({"host": "gone", "time_s": clock() + off_s}).encode())
    with written_run(run()):
        pass


def test_two_users_of_one_machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with written_run(run()):
        monkeypatch.setenv("BLURNOISE_CACHE", str(tmp_path / "another"))
        with pytest.raises(ValueError, match="is writing it"), written_run(run()):
            pass


@pytest.mark.parametrize("text", [b"", b"[]", b"{}", b'{"time_s": "x"}'])
def test_a_lock_that_says_nothing(text: bytes) -> None:
    (run() / working_folder.LOCK).put(text)
    with written_run(run()):
        pass


def test_the_lock_is_renewed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(working_folder, "RENEW_S", 0.01)
    with written_run(run()):
        before = json.loads((run() / working_folder.LOCK).read_fresh())["time_s"]
        deadline = time.monotonic() + 120
        while json.loads((run() / working_folder.LOCK).read_fresh())["time_s"] == before:
            assert time.monotonic() < deadline
            time.sleep(0.01)


def test_meanwhile_a_copy_is_put(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of SQLite's own, whole, after the pictures that its rows name."""
    monkeypatch.setattr(working_folder, "MIRROR_S", -1.0)
    done: list[int] = []
    with written_run(run()) as folder:
        database = sqlite3.connect(folder.path / RUN_FILE)
        database.executescript("PRAGMA journal_mode = WAL; CREATE TABLE t (a); INSERT INTO t VALUES (7)")

        def copy(file: Path) -> None:
            with sqlite3.connect(file) as other:
                database.backup(other)

        (folder.path / "a.png").write_text("picture")
        folder.minded(done.append, copy)(3)
        assert done == [3]
        assert set(there()) == {working_folder.LOCK, "a.png", RUN_FILE}
        assert rows(there()[RUN_FILE], folder.path.parent / "seen.sqlite") == [(7,)]
        assert not list(folder.path.glob(".*copy*"))
        database.close()


def rows(data: bytes, file: Path) -> list[Any]:
    file.write_bytes(data)
    return list(sqlite3.connect(file).execute("SELECT * FROM t"))


def test_a_copy_that_cannot_be_put_does_not_end_the_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(working_folder, "MIRROR_S", -1.0)
    with written_run(run()) as folder, monkeypatch.context() as patch:
        patch.setattr(working_folder, "put_file", _denied)
        with pytest.warns(UserWarning, match=r"memory://bucket/run: not up to date \(denied\)"):
            folder.minded(lambda done: None, lambda file: file.write_text("x") and None)(1)


def test_reading_leaves_the_results_as_they_are(tmp_path: Path) -> None:
    (run() / RUN_FILE).put(b"rows")
    with read_run(run()) as folder:
        work(folder.path, results_sqlite="touched", report_html="page")
        assert folder.told(folder.path / "report.html") == f"{URL}/report.html"
    assert there() == {RUN_FILE: b"rows", "report.html": b"page"}
    with output_folder(run() / "coco") as folder:
        work(folder.path, a_json="{}")
    assert there()["coco/a.json"] == b"{}"
    assert not list((tmp_path / "cache/runs").iterdir())


def test_errors_name_the_url(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=f"run = '{URL}': holds no rows"), read_run(run()) as folder:
        raise ValueError(f"run = {str(folder.path)!r}: holds no rows")


def test_folders_of_this_machine_are_themselves(tmp_path: Path) -> None:
    for opened in (written_run, read_run, output_folder):
        with opened(tmp_path / "run") as folder:
            assert folder.path == tmp_path / "run"
            assert folder.told(folder.path) == str(tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_urls_in_python_say_how() -> None:
    with pytest.raises(ValueError, match="open it with written_run") as told:
        working_folder.working_folder("s3://k:secret@bucket/run")
    assert "secret" not in str(told.value)
