"""Objects of a real S3 server, over a wire that is slow, cut, busy or closed."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from blurnoise_eval.system import storage, transport
from blurnoise_eval.system.storage import location
from s3_servers import BUCKET, Wire, at, s3_server, wire_to

pytestmark = pytest.mark.slow  # the server takes seconds to import


@pytest.fixture(scope="module")
def held() -> Iterator[Wire]:
    """To an empty server; waits are short."""
    with pytest.MonkeyPatch.context() as patch, s3_server() as server, wire_to(server) as (address, wire):
        at(address, patch.setenv)
        transport.system_of.cache_clear()
        transport.system_of("s3").mkdir(BUCKET)
        patch.setattr(transport, "WAITS_S", (0.01, 0.01, 0.01, 0.01))
        transport.system_of.cache_clear()
        yield wire
    transport.system_of.cache_clear()


@pytest.fixture
def wire(held: Wire, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Wire]:
    """Of a bucket with three objects, through an empty cache."""
    monkeypatch.setenv("BLURNOISE_CACHE", str(tmp_path / "cache"))
    system = transport.system_of("s3")
    for name in ("a.bin", "sub/b.bin", "no bytes.bin"):
        system.pipe_file(f"{BUCKET}/{name}", b"" if "no" in name else name.encode() * 1000)
    held.mend()
    yield held
    held.mend()


A = f"s3://{BUCKET}/a.bin"


def test_reads_once(wire: Wire) -> None:
    """A version is fetched by one request and then stays; another version is another object."""
    version = location(A).stamped()
    wire.requests.clear()
    assert version.read_bytes() == version.read_bytes() == b"a.bin" * 1000
    assert len(wire.requests) == 1
    transport.system_of("s3").pipe_file(f"{BUCKET}/a.bin", b"new")
    assert location(A).read_bytes() == b"new"
    assert version.read_bytes() == b"a.bin" * 1000  # as it was


def test_listing_of_a_folder(wire: Wire) -> None:
    found = storage.listing(location(f"s3://{BUCKET}"))
    assert list(found) == ["a.bin", "no bytes.bin", "sub/b.bin"]
    assert list(storage.listing(location(f"s3://{BUCKET}/sub/"))) == ["b.bin"]
    assert storage.stamps(location(f"s3://{BUCKET}"), ["a.bin", "c.bin"]) == {"a.bin": found["a.bin"]}


def test_a_listing_of_several_pages(wire: Wire) -> None:
    """S3 lists a thousand at a time."""
    names = [f"{number:04d}.bin" for number in range(1003)]
    folder = location(f"s3://{BUCKET}/many")
    objects = {f"{BUCKET}/many/{name}": b"x" for name in names}
    transport.system_of("s3").pipe(
        objects, batch_size=4
    )  # hundreds at once have a busy machine's server give up
    assert list(storage.listing(folder)) == names
    assert len(storage.stamps(folder, names)) == 1003


def test_kinds(wire: Wire) -> None:
    bucket = location(f"s3://{BUCKET}")
    assert (bucket / "sub").is_dir()
    assert (bucket / "a.bin").is_file()
    assert not (bucket / "c.bin").exists()
    assert (bucket / "no bytes.bin").read_bytes() == b""


@pytest.mark.parametrize("name", ["with space.bin", "größe-日本.bin", "a+b&c=d#e%20.bin", "what?.bin"])
def test_any_name(name: str, wire: Wire) -> None:
    url = location(f"s3://{BUCKET}/names") / name
    url.put(name.encode())
    assert url.read_bytes() == name.encode()
    assert name in storage.listing(location(f"s3://{BUCKET}/names"))
    url.unlink()
    assert not url.exists()
    url.unlink()


def test_new_objects_are_made_once(wire: Wire) -> None:
    lock = location(f"s3://{BUCKET}/lock")
    assert lock.put_new(b"mine")
    assert not lock.put_new(b"theirs")
    assert lock.read_bytes() == b"mine"
    lock.unlink()


@pytest.mark.parametrize("fault", ["cuts", "refusals"])
def test_a_fault_that_passes_is_not_seen(fault: str, wire: Wire) -> None:
    version = location(A).stamped()
    setattr(wire, fault, 3)
    assert version.read_bytes() == b"a.bin" * 1000
    assert len(wire.requests) == 5


@pytest.mark.parametrize("cut_at", [100, 2000], ids=["before the object", "within it"])
def test_a_connection_that_is_always_cut(cut_at: int, wire: Wire, tmp_path: Path) -> None:
    version, wire.cuts, wire.cut_at = location(A).stamped(), 99, cut_at
    with pytest.raises(OSError, match="cut off") as told:
        version.read_bytes()
    assert told.value.filename == A
    assert cut_at == 100 or len(wire.requests) == 1 + 5
    assert not list((tmp_path / "cache").rglob("*.*")), "nothing of it is kept"


def test_a_server_that_does_not_answer(wire: Wire, monkeypatch: pytest.MonkeyPatch) -> None:
    version, wire.delay_s = location(A).stamped(), 20.0
    monkeypatch.setattr(transport, "WAITS_S", (0.01,))
    monkeypatch.setattr(transport, "READ_S", 1)
    transport.system_of.cache_clear()
    try:
        with pytest.raises(TimeoutError, match="no answer within 1 s"):
            version.read_bytes()
    finally:
        transport.system_of.cache_clear()


def test_a_slow_server_is_waited_for(wire: Wire) -> None:
    wire.delay_s = 0.5
    assert location(A).read_bytes() == b"a.bin" * 1000


def test_denied(wire: Wire) -> None:
    """At once, and named."""
    wire.refusals, wire.status = 99, "403 Forbidden"
    with pytest.raises(PermissionError, match="denied") as told:
        location(A).read_bytes()
    assert told.value.filename == A
    assert len(wire.requests) == 1
    with pytest.raises(PermissionError, match="denied"):
        storage.stamps(location(f"s3://{BUCKET}"), ["a.bin", "sub/b.bin"])


def test_a_folder_that_must_not_be_listed(wire: Wire, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its objects are asked for one by one."""
    monkeypatch.setattr(storage, "_FEW", 1)
    wire.named, wire.refusals, wire.status = "list-type", 99, "403 Forbidden"
    found = storage.stamps(location(f"s3://{BUCKET}"), ["a.bin", "sub/b.bin"])
    assert list(found) == ["a.bin", "sub/b.bin"]


@pytest.mark.parametrize("url", [f"s3://{BUCKET}/none", "s3://no-such-bucket/a"])
def test_missing(url: str, wire: Wire) -> None:
    with pytest.raises(FileNotFoundError, match="no such object") as told:
        location(url).read_bytes()
    assert told.value.filename == url


def test_changed_since_it_was_looked_up(wire: Wire) -> None:
    version = location(A).stamped()
    transport.system_of("s3").pipe_file(f"{BUCKET}/a.bin", b"other" * 1000)  # as many bytes
    with pytest.raises(OSError, match="has changed"):
        version.read_bytes()


def test_no_such_host(wire: Wire, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("AWS_ENDPOINT_URL", "http://127.0.0.1:9")
    transport.system_of.cache_clear()
    with pytest.raises(OSError, match="no such host, or it does not answer"):
        location(A).read_bytes()
    monkeypatch.undo()
    transport.system_of.cache_clear()


def test_a_file_with_its_company(wire: Wire) -> None:
    """What stands beside it, in one folder; what is missing is left out, and what leads elsewhere."""
    found = storage.local_file(f"s3://{BUCKET}/a.bin", ["sub/b.bin", "c.bin", "../x.bin"])
    assert sorted(file.name for file in found.parent.rglob("*.bin")) == ["a.bin", "b.bin"]
    assert found.read_bytes() == b"a.bin" * 1000
    assert found == storage.local_file(f"s3://{BUCKET}/a.bin", ["sub/b.bin"])
