"""Locations: what a URL means and what is shown of it; listings, versions and copies of what is there."""

import os
from typing import Any

import pytest
from blurnoise_eval.system.files import RUN_FILE, write_whole, writing
from blurnoise_eval.system.urls import (
    explained,
    listing,
    local_file,
    location,
    version,
    versions,
    without_secrets,
)
from blurnoise_eval.system.working_folder import check_outputs, output_folder, written_run

from blurnoise._core.manifest import MANIFEST

pytest.importorskip("upath")
URL = "memory://bucket/set"


@pytest.fixture
def bucket(tmp_path, monkeypatch):
    """Three objects, of this process."""
    monkeypatch.setenv("BLURNOISE_CACHE", str(tmp_path / "cache"))
    found = location(URL)
    for name in ("a.bin", "sub/größe b.bin", "sub/none"):
        (found / name).write_bytes(b"" if "none" in name else name.encode())
    yield found
    found.fs.store.clear()


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("s3://bucket/a/b.png", "s3://bucket/a/b.png"),
        ("s3://bucket/a/../b", "s3://bucket/b"),
        ("s3://bucket/with space/größe", "s3://bucket/with space/größe"),
        ("hf://datasets/user/set@main/a", "hf://datasets/user/set@main/a"),
    ],
)
def test_urls(text, shown):
    assert str(location(text)) == shown


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "must be the name of a file or folder"),
        ("ftp://host/a", "must begin with s3://, gs://, hf:// or file:///"),
        *((url, "must be a path in a bucket") for url in ("s3://", "s3:///a", "s3://../a", "s3://b/../a")),
        ("s3://bucket/a?versionId=secret", "must not contain a user, password or query"),
        ("s3://key:secret@bucket/a?token=secret", "must not contain a user, password or query"),
    ],
)
def test_urls_that_cannot_be_meant(text, told):
    with pytest.raises(ValueError, match=told) as error:
        location(text)
    assert "secret" not in str(error.value)
    assert "\n" not in str(error.value)


def test_secrets_are_not_shown():
    command = "sweep --images s3://k:secret@b/a?token=secret -o 'https://b/c?x=secret' --lux 1,2"
    assert without_secrets(command) == "sweep --images s3://b/a -o 'https://b/c' --lux 1,2"


def test_a_listing_is_that_of_a_folder(bucket, tmp_path):
    """Names that lead elsewhere are left out, links to folders stay shut, broken links are no files."""
    for name in ("a.bin", "sub/größe b.bin", "sub/none"):
        (tmp_path / "set" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "set" / name).write_bytes((bucket / name).read_bytes())
    (tmp_path / "set/shut").symlink_to(tmp_path)
    (tmp_path / "set/broken").symlink_to(tmp_path / "nothing")
    os.mkfifo(tmp_path / "set/pipe")
    for path in ("../x", "./y", "/z"):
        bucket.fs.store[f"{bucket.path}/{path}"] = bucket.fs.store[f"{bucket.path}/a.bin"]
    for folder in (bucket, tmp_path / "set"):
        found = listing(folder)
        assert set(found) == {"a.bin", "sub/größe b.bin", "sub/none"}
        assert found["sub/none"] == version(folder / "sub" / "none")
        assert versions(folder, ["a.bin", "missing"]) == {"a.bin": found["a.bin"]}
    many = {f"{number}.bin": b"x" for number in range(201)}
    bucket.fs.pipe({f"{bucket.path}/many/{name}": data for name, data in many.items()})
    assert set(versions(bucket / "many", [*many, "missing"])) == set(many)
    assert versions(location("memory://other/none"), list(many)) == {}


def test_a_copy_is_of_one_version(bucket, tmp_path):
    known = version(bucket / "a.bin")
    copy = local_file(bucket / "a.bin", known=known)
    assert (copy.name, copy.read_bytes()) == ("a.bin", b"a.bin")
    (bucket / "a.bin").write_bytes(b"other")
    assert local_file(bucket / "a.bin", known=known) == copy, "as it was"
    assert local_file(bucket / "a.bin").read_bytes() == b"other"
    with pytest.raises(OSError, match="has changed while it was read") as error:
        local_file(bucket / "sub" / "none", known=known)
    assert error.value.filename == f"{URL}/sub/none"
    assert sorted(path.name for path in (tmp_path / "cache").rglob("*.bin")) == ["a.bin", "a.bin"]
    assert local_file(tmp_path) == tmp_path


@pytest.mark.parametrize("status", [401, 403, 404])
def test_what_a_storage_says_by_a_status(status):
    """As Google's and Hugging Face's clients say it."""
    error = RuntimeError("no")
    error.status = status  # type: ignore[attr-defined]
    kind, told = (FileNotFoundError, "no such object") if status == 404 else (PermissionError, "denied")
    with pytest.raises(kind, match=told), explained("gs://bucket/a"):
        raise error


# --- working folders: a run is fetched, worked on here and put back ---


fsspec = pytest.importorskip("fsspec")
pytest.importorskip("upath")
RUN_URL = "memory://bucket/run"
RUN: Any = location(RUN_URL)


@pytest.fixture(autouse=True)
def empty(tmp_path, monkeypatch):
    monkeypatch.setenv("BLURNOISE_CACHE", str(tmp_path / "cache"))
    fsspec.filesystem("memory").store.clear()
    yield
    fsspec.filesystem("memory").store.clear()


def there():
    return {name: (RUN / name).read_bytes() for name in listing(RUN)}


def work(folder, **files):
    for name, text in files.items():
        (folder / name.replace("_", ".")).write_text(text)


def test_what_was_written_is_there_at_the_end(tmp_path):
    with written_run(RUN) as folder:
        work(folder.path, results_sqlite="rows", report_html="page")
        (folder.path / "examples").mkdir()
        (folder.path / "examples/a.png").write_text("picture")
        (folder.path / f"{RUN_FILE}-wal").write_text("SQLite's own")
        assert folder.with_url(folder.path / "report.html") == f"{RUN_URL}/report.html"
    assert there() == {"examples/a.png": b"picture", "report.html": b"page", RUN_FILE: b"rows"}
    assert not list((tmp_path / "cache/runs").iterdir()), "nothing stays here"


def test_what_was_done_before_it_was_stopped_is_put():
    def interrupted():
        with written_run(RUN) as folder:
            work(folder.path, results_sqlite="some rows")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert there() == {RUN_FILE: b"some rows"}


def test_results_that_another_machine_has_put_meanwhile_stay(tmp_path):
    def overtaken():
        with written_run(RUN) as folder:
            work(folder.path, results_sqlite="rows of this one")
            (RUN / RUN_FILE).write_bytes(b"rows of another machine")

    with pytest.raises(ValueError, match=f"run = '{RUN_URL}': another process has written"):
        overtaken()
    assert there() == {RUN_FILE: b"rows of another machine"}
    (here,) = (tmp_path / "cache/runs").glob(f"*/{RUN_FILE}")
    assert here.read_text() == "rows of this one"


def test_what_cannot_be_put_stays_and_is_named(tmp_path, monkeypatch):
    def denied(*_):
        raise PermissionError

    monkeypatch.setattr(type(RUN.fs), "put", denied)
    with (
        pytest.raises(OSError, match=r"denied.*; files that were not uploaded are in") as told,
        written_run(RUN) as folder,
    ):
        work(folder.path, results_sqlite="rows")
    (here,) = (tmp_path / "cache/runs").glob(f"*/{RUN_FILE}")
    assert here.read_text() == "rows"
    assert str(here.parent) in str(told.value)


def test_what_is_not_blurnoises_stays_there():
    """As in a folder: what was put before is replaced, and nothing else."""

    def put(text, **further):
        with output_folder(RUN) as folder, writing(**further):
            write_whole(folder.path / "program.csv", text)

    for text in (b"one", b"two"):
        put(text)
        assert (RUN / "program.csv").read_bytes() == text
    (RUN / "program.csv").write_bytes(b"two, edited")
    with pytest.raises(FileExistsError, match="did not write, or that was changed since") as told:
        put(b"three")
    assert told.value.filename == f"{RUN_URL}/program.csv"
    with pytest.raises(FileExistsError, match="did not write"):
        check_outputs(RUN, "*.csv")
    assert there()["program.csv"] == b"two, edited"
    with writing(overwrite=True):
        put(b"three")
    put(b"four")
    (RUN / "report.html").write_bytes(b"mine")
    with pytest.raises(FileExistsError, match="did not write"), written_run(RUN):
        pytest.fail("it has begun")
    assert {name: held for name, held in there().items() if name != MANIFEST} == {
        "program.csv": b"four", "report.html": b"mine"
    }  # fmt: skip
