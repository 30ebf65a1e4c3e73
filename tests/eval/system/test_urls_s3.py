"""Objects of a real S3 server, over a wire that is slow, cut, busy or closed."""

import pytest
from blurnoise_eval.system.urls import local_file, location, version, versions
from s3_servers import BUCKET, at, s3_server, wire_to

pytestmark = pytest.mark.slow  # the server takes seconds to import
A = f"s3://{BUCKET}/a.bin"
CONTENT = b"a.bin" * 1000


@pytest.fixture(scope="module")
def held():
    """To a server with an empty bucket."""
    with pytest.MonkeyPatch.context() as patch, s3_server() as server, wire_to(server) as (address, wire):
        at(address, patch.setenv)
        location(A).fs.mkdir(BUCKET)
        yield wire


@pytest.fixture
def wire(held, tmp_path, monkeypatch):
    """Of a bucket with three objects, through an empty cache."""
    monkeypatch.setenv("BLURNOISE_CACHE", str(tmp_path / "cache"))
    held.mend()
    for name in ("a.bin", "sub/b.bin", "no bytes.bin"):
        (location(f"s3://{BUCKET}") / name).write_bytes(b"" if "no" in name else name.encode() * 1000)
    yield held
    held.mend()


def read(url, known=None):
    return local_file(location(url), known=known).read_bytes()


def test_reads_once(wire):
    """A version is fetched once and then stays; another version is another object."""
    known = version(location(A))
    wire.requests.clear()
    assert read(A, known) == read(A, known) == CONTENT
    assert len(wire.requests) == 2  # its bytes, and whether it has changed meanwhile
    location(A).write_bytes(b"new")
    assert read(A) == b"new"
    assert read(A, known) == CONTENT, "as it was"


@pytest.mark.parametrize(("fault", "times"), [("cuts", 3), ("refusals", 2)])
def test_a_fault_that_passes_is_not_seen(fault, times, wire):
    known = version(location(A))
    setattr(wire, fault, times)
    assert read(A, known) == CONTENT
    assert getattr(wire, fault) == 0


def test_a_connection_that_is_always_cut(wire, tmp_path):
    known, wire.cuts, wire.cut_at = version(location(A)), 99, 100
    with pytest.raises(OSError, match="failed") as told:
        read(A, known)
    assert told.value.filename == A
    assert not [file for file in (tmp_path / "cache").rglob("*") if file.is_file()], "nothing of it is kept"


def test_denied(wire):
    """At once, and named; a folder that must not be listed is asked for its objects one by one."""
    wire.requests.clear()
    wire.refusals, wire.status = 99, "403 Forbidden"
    with pytest.raises(PermissionError, match="denied") as told:
        read(A)
    assert told.value.filename == A
    assert len(wire.requests) == 1
    with pytest.raises(PermissionError, match="denied"):
        versions(location(f"s3://{BUCKET}"), ["a.bin", "sub/b.bin"])
    wire.named = "list-type"
    names = ["a.bin", "sub/b.bin", *map(str, range(200))]
    assert list(versions(location(f"s3://{BUCKET}"), names)) == ["a.bin", "sub/b.bin"]


def test_missing(wire):
    for url in (f"s3://{BUCKET}/none", "s3://no-such-bucket/a"):
        with pytest.raises(FileNotFoundError, match="no such object") as told:
            read(url)
        assert told.value.filename == url
