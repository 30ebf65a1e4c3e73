"""Files appear whole or not at all, whoever writes them."""

import os
import re
from pathlib import Path

import blurnoise_eval
import blurnoise_models
import pytest
from blurnoise_eval.system.files import write_whole, written_whole

import blurnoise
from blurnoise._core.manifest import MANIFEST

SOURCES = {
    f"{package.__name__}/{path.relative_to(folder)}": path
    for package in (blurnoise, blurnoise_eval, blurnoise_models)
    for folder in (Path(package.__path__[0]),)
    for path in folder.rglob("*.py")
}
WRITER = "blurnoise/_core/writing.py"
IN_PLACE = re.compile(
    r"""write_text\(|write_bytes\(|imwrite\(|\.tofile\(|json\.dump\(|np\.save\((?!content|data)|\.partial["'`]"""
    r"""|open\([^)]*["'][wax]"""
)
FIGURE_BY_NAME = re.compile(r"savefig\((?!.*format=)")  # into a buffer, the format has to be said


def there(folder):
    return {entry.name: entry.read_bytes() for entry in folder.iterdir() if entry.name != MANIFEST}


def test_what_fails_half_way_leaves_the_file_of_before(tmp_path):
    path = tmp_path / "table.csv"
    write_whole(path, b"before")

    def lines():
        yield b"half"
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_whole(path, lines())
    assert there(tmp_path) == {"table.csv": b"before"}
    write_whole(path, [b"af", b"ter"])
    assert there(tmp_path) == {"table.csv": b"after"}


def test_a_folder_is_on_disk_before_it_takes_its_name(tmp_path, monkeypatch):
    synced: list[str] = []
    honest = os.fsync

    def fsync(handle):
        synced.append(Path(f"/proc/self/fd/{handle}").readlink().name)
        honest(handle)

    monkeypatch.setattr(os, "fsync", fsync)
    with written_whole(tmp_path / "table") as unfinished:
        (unfinished / "below").mkdir(parents=True)
        (unfinished / "below" / "part").write_text("first")
        synced.clear()
    assert {"part", "below", unfinished.name} == set(synced[:-1])
    assert synced[-1] == tmp_path.name
    with pytest.raises(OSError, match="table'"), written_whole(tmp_path / "table") as unfinished:
        unfinished.mkdir()
    assert [file.name for file in tmp_path.iterdir()] == ["table"]
    assert (tmp_path / "table" / "below" / "part").read_text() == "first"


def test_nothing_writes_files_in_place():
    """Examples of docstrings apart, which make the files that they read."""
    in_place = [
        f"{name}: {line}"
        for name, source in SOURCES.items()
        for line in source.read_text(encoding="utf-8").splitlines()
        if name != WRITER and not line.lstrip().startswith((">>>", "..."))
        if IN_PLACE.search(line) or FIGURE_BY_NAME.search(line)
    ]
    assert not in_place


# --- what is said of this machine ---
