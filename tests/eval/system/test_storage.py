"""Locations: what a URL means, what is shown of it, and that it behaves as a path does."""

from __future__ import annotations

import pickle
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

import pytest
from blurnoise_eval.system import storage, transport
from blurnoise_eval.system.storage import Url, location
from blurnoise_eval.system.transport import without_secrets


@pytest.mark.parametrize("text", ["a/b", "/a", "s3:/a", "~/a", "C:/a"])
def test_paths_stay_paths(text: str) -> None:
    assert location(text) == Path(text)
    assert location(Path(text)) == Path(text)


def test_files_by_url_are_paths(tmp_path: Path) -> None:
    strange = tmp_path / "with space %20 größe"
    assert location(strange.as_uri()) == strange
    assert location(f"file://localhost{tmp_path}") == tmp_path
    with pytest.raises(ValueError, match="must be of this machine"):
        location("file://server/a")


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("s3://bucket/a/b.png", "s3://bucket/a/b.png"),
        ("S3://bucket/a/", "s3://bucket/a"),
        ("gcs://bucket//a/./b", "gs://bucket/a/b"),
        ("s3://bucket/a/../b", "s3://bucket/b"),
        ("s3://bucket/with space/größe", "s3://bucket/with space/größe"),
        ("hf://datasets/user/set@main/a", "hf://datasets/user/set@main/a"),
        ("s3://bucket/a?versionId=123", "s3://bucket/a"),
    ],
)
def test_urls(text: str, shown: str) -> None:
    assert str(location(text)) == shown


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "must name a file or folder"),
        ("ftp://host/a", "must begin with s3://, gs://, hf:// or file://"),
        ("s3://", "must name a bucket"),
        ("s3:///a", "must name a bucket"),
        ("s3://../a", "must name a bucket"),
        ("s3://bucket/../a", "leaves the bucket"),
        ("s3://key:secret@bucket/a?token=secret", "must hold no user or password"),
        ("https://user:secret@host/a?token=secret", "must begin with"),
    ],
)
def test_urls_that_cannot_be_meant(text: str, told: str) -> None:
    with pytest.raises(ValueError, match=told) as error:
        location(text)
    assert "secret" not in str(error.value)
    assert "\n" not in str(error.value)


def test_secrets_are_not_shown() -> None:
    command = "sweep --images s3://k:secret@b/a?token=secret -o 'https://b/c?x=secret' --lux 1,2"
    assert without_secrets(command) == "sweep --images s3://b/a -o 'https://b/c' --lux 1,2"
    version = location("s3://bucket/a?versionId=secret")
    assert "secret" not in f"{version} {version!r} {version.parent} {version / 'b'}"


@pytest.mark.parametrize(
    "path", ["bucket/a.b/c.png", "bucket/a", "bucket/.hidden", "bucket/a.tar.gz", "bucket/a."]
)
def test_parts_are_those_of_a_path(path: str) -> None:
    url, expected = Url("s3", path), PurePosixPath(path)
    for part in ("name", "stem", "suffix", "parts"):
        assert getattr(url, part) == getattr(expected, part), part
    assert str(url.parent) == f"s3://{expected.parent}"
    assert str(url / "x/y") == f"s3://{expected / 'x/y'}"


def test_travels_with_its_version() -> None:
    version = Url("s3", "bucket/a", stamp="3 abc")
    arrived = pickle.loads(pickle.dumps(version))
    assert (arrived, arrived.stamp) == (version, "3 abc")


def test_a_package_that_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(transport, "SCHEMES", (("s3", "s3", "no_such_package"),))
    transport.system_of.cache_clear()
    with pytest.raises(OSError, match=r"needs no_such_package: pip install 'blurnoise\[s3\]'"):
        location("s3://bucket/a").read_bytes()


def test_a_listing_leaves_out_names_that_lead_elsewhere(monkeypatch: pytest.MonkeyPatch) -> None:
    names = ["b/a.png", "b/../x.png", "b/./y.png", "b//z.png", "b/folder/", "b/c/d.png"]

    class System:
        def _strip_protocol(self, address: str) -> str:
            return address.partition("://")[2]

        def find(self, address: str, detail: bool) -> dict[str, dict[str, object]]:
            return {name: {"type": "file", "size": 1, "ETag": '"e"'} for name in names}

    monkeypatch.setattr(storage, "system_of", lambda scheme: System())
    assert storage.listing(location("s3://b")) == {"a.png": "1 e", "c/d.png": "1 e"}


def test_an_answer_that_is_lost_does_not_make_ours_theirs(monkeypatch: pytest.MonkeyPatch) -> None:
    """The request is repeated, and finds what it has made itself; what another has made stays another's."""
    system = pytest.importorskip("fsspec").filesystem("memory")
    monkeypatch.setattr(transport, "WAITS_S", (0.0, 0.0))
    monkeypatch.setattr(transport, "system_of", lambda scheme: Deaf())
    monkeypatch.setattr(storage, "system_of", lambda scheme: Deaf())
    asked = []

    class Deaf:
        async_impl = False

        def __getattr__(self, name: str) -> Any:
            return getattr(system, name)

        def pipe_file(self, path: str, data: bytes, mode: str) -> None:
            asked.append(data)
            system.pipe_file(path, data, mode=mode)
            raise TimeoutError

    lock = location("memory://bucket/lost answer")
    assert lock.put_new(b"mine")
    assert not lock.put_new(b"theirs")
    assert asked == [b"mine", b"mine", b"theirs"]
    assert lock.read_fresh() == b"mine"
    system.rm_file("/bucket/lost answer")


@dataclass
class Clock:
    """In place of the module ``time``."""

    now_s: float = 0.0

    def monotonic(self) -> float:
        return self.now_s

    def sleep(self, seconds: float) -> None:
        self.now_s += seconds


def test_storage_that_does_not_answer_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two tries of 30 s, then one for each object, until it has answered."""
    clock = Clock()
    monkeypatch.setattr(transport, "time", clock)

    def stalled() -> None:
        clock.now_s += 30
        raise TimeoutError

    for name, took_s in (("a", 60.5), ("b", 30), ("c", 30)):
        began_s = clock.now_s
        with pytest.raises(TimeoutError, match="no answer within 30 s") as caught:
            transport.tried(f"s3://stalled/{name}.png", stalled)
        assert (caught.value.filename, clock.now_s - began_s) == (f"s3://stalled/{name}.png", took_s)
    assert transport.tried("s3://stalled/d.png", lambda: 5) == 5
    began_s = clock.now_s
    with pytest.raises(TimeoutError):
        transport.tried("s3://stalled/e.png", stalled)
    assert clock.now_s - began_s == 60.5


def test_what_is_cut_off_after_a_minute_is_read_again(monkeypatch: pytest.MonkeyPatch) -> None:
    clock, cuts = Clock(), iter([EOFError(), EOFError()])
    monkeypatch.setattr(transport, "time", clock)

    def large() -> int:
        clock.now_s += 300
        for cut in cuts:
            raise cut
        return 5

    assert transport.tried("s3://large/model.onnx", large) == 5
