"""The cache of a machine: its limit, what it holds, and what it does without room."""

from __future__ import annotations

import multiprocessing
import os
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

import pytest
from blurnoise_eval.system import node_cache
from blurnoise_eval.system.node_cache import NodeCache


def bytes_in(folder: Path) -> int:
    return sum(file.stat().st_size for file in folder.rglob("*") if file.is_file())


def no_fetch() -> bytes:
    raise AssertionError("asked for again")


def test_what_is_kept_is_not_fetched_again(tmp_path: Path) -> None:
    cache = NodeCache(tmp_path, 1000)
    assert cache.read("a", lambda: b"data") == b"data"
    assert cache.read("a", no_fetch) == b"data"
    assert NodeCache(tmp_path, 1000).read("a", no_fetch) == b"data"


def test_a_copy_cut_short_is_fetched_again(tmp_path: Path) -> None:
    cache = NodeCache(tmp_path, 1000)
    cache.read("a", lambda: b"da", 2)
    assert cache.read("a", lambda: b"data", 4) == b"data"


def test_used_longest_ago_goes_first(tmp_path: Path) -> None:
    cache = NodeCache(tmp_path, 1000)
    for age, key in enumerate(("used", "old", "new")):
        cache.read(key, lambda: b"x" * 300)
        for file in (tmp_path / "objects").iterdir():
            os.utime(file, (file.stat().st_mtime - 100 * (3 - age),) * 2)
    cache.read("used", no_fetch)
    cache.read("more", lambda: b"y" * 300)  # 1200 bytes: down to 900
    for key in ("used", "new", "more"):
        cache.read(key, no_fetch)
    assert cache.read("old", lambda: b"again") == b"again"


def test_stays_below_its_limit(tmp_path: Path) -> None:
    cache = NodeCache(tmp_path, 10_000)
    for index in range(200):
        cache.read(str(index), partial(bytes, 777))
        assert bytes_in(tmp_path) <= 10_000 * 1.02 + 777
    assert bytes_in(tmp_path) > 7_000


def test_what_is_larger_is_handed_on(tmp_path: Path) -> None:
    assert NodeCache(tmp_path, 100).read("a", partial(bytes, 101)) == bytes(101)
    assert not bytes_in(tmp_path)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_that_cannot_be_written(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    cache = NodeCache(tmp_path / "cache", 100)
    assert cache.read("a", lambda: b"data") == b"data"
    with pytest.raises(OSError, match="cache cannot be written"):
        cache.folder("a", lambda folder: None)


def test_a_file_where_the_folder_should_be(tmp_path: Path) -> None:
    (tmp_path / "cache").touch()
    cache = NodeCache(tmp_path / "cache", 100)
    assert cache.read("a", lambda: b"data") == b"data"
    with pytest.raises(OSError, match="cache cannot be written"):
        cache.folder("a", lambda folder: None)


def test_a_folder_in_use_stays(tmp_path: Path) -> None:
    def fill(folder: Path) -> None:
        (folder / "m.onnx").write_bytes(bytes(900))

    held = NodeCache(tmp_path, 1000).folder("held", fill)
    with multiprocessing.get_context("spawn").Pool(1) as another:
        another.apply(_fill_up, (tmp_path,))
    assert (held / "m.onnx").stat().st_size == 900


def _fill_up(folder: Path) -> None:
    cache = NodeCache(folder, 1000)
    for index in range(5):
        cache.read(str(index), partial(bytes, 300))


def test_a_folder_that_nobody_uses_goes(tmp_path: Path) -> None:
    with multiprocessing.get_context("spawn").Pool(1) as another:
        left = another.apply(_leave, (tmp_path,))
    assert (left / "m.onnx").is_file()
    os.utime(left, (1, 1))
    _fill_up(tmp_path)
    assert not left.exists()


def _leave(folder: Path) -> Path:
    return NodeCache(folder, 1000).folder(
        "left", lambda made: (made / "m.onnx").write_bytes(bytes(900)) and None
    )


def test_a_folder_appears_whole(tmp_path: Path) -> None:
    cache = NodeCache(tmp_path, 1000)

    def fail(folder: Path) -> None:
        (folder / "a").touch()
        raise OSError("cut off")

    with pytest.raises(OSError, match="cut off"):
        cache.folder("a", fail)
    assert not list((tmp_path / "objects").iterdir())


def test_an_object_alone_and_in_a_folder(tmp_path: Path) -> None:
    cache = NodeCache(tmp_path, 1000)
    assert cache.read("a", lambda: b"data") == b"data"
    assert cache.folder("a", lambda folder: None).is_dir()
    assert cache.read("a", no_fetch) == b"data"


def test_many_at_once(tmp_path: Path) -> None:
    """Threads over two caches of one folder, far too small for all: every answer is right."""
    caches = [NodeCache(tmp_path, 5_000) for _ in range(2)]

    def read(index: int) -> bool:
        key = index % 37
        return caches[index % 2].read(str(key), lambda: bytes([key]) * 500) == bytes([key]) * 500

    with ThreadPoolExecutor(8) as pool:
        assert all(pool.map(read, range(2000)))
    assert bytes_in(tmp_path) <= 5_000 * 1.04 + 8 * 500


@pytest.mark.parametrize("limit", ["0", "-1", "nan", "much"])
def test_limits(limit: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(node_cache.LIMIT_GB, limit)
    with pytest.raises(ValueError, match=f"cache-gb = {limit!r}: must be a number > 0"):
        node_cache.node_cache()


def test_what_another_process_is_still_filling_stays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """However long it has stood still, or clocks say it has."""
    monkeypatch.setattr(node_cache, "_ABANDONED_S", -1.0)
    one, other = NodeCache(tmp_path, 1000), NodeCache(tmp_path, 1000)

    def fill(folder: Path) -> None:
        (folder / "first").write_bytes(b"1")
        other.read("object", lambda: b"makes room")
        (folder / "second").write_bytes(b"2")

    assert {file.name for file in one.folder("model", fill).iterdir()} == {"first", "second"}
    (tmp_path / "objects" / ".left").mkdir()
    NodeCache(tmp_path, 1000).read("another", lambda: b"makes room")
    assert not (tmp_path / "objects" / ".left").exists()
