"""Files appear whole or not at all, whoever writes them."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import blurnoise_eval
import pytest
from blurnoise_eval.system import files
from blurnoise_eval.system.files import write_whole

SOURCES = Path(blurnoise_eval.__file__).parent
IN_PLACE = re.compile(
    r"""write_text\(|write_bytes\(|imwrite\(|\.tofile\(|json\.dump\(|open\([^)]*["'][wax]"""
)
FIGURE_BY_NAME = re.compile(r"savefig\((?!.*format=)")  # into a buffer, the format has to be said


def test_what_fails_half_way_leaves_the_file_of_before(tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    write_whole(path, b"before")

    def lines() -> Iterator[bytes]:
        yield b"half"
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_whole(path, lines())
    assert {entry.name: entry.read_bytes() for entry in tmp_path.iterdir()} == {"table.csv": b"before"}
    write_whole(path, [b"af", b"ter"])
    assert {entry.name: entry.read_bytes() for entry in tmp_path.iterdir()} == {"table.csv": b"after"}


@pytest.mark.parametrize("name", ["no folder/a.csv", "n" * 250 + ".csv", "folder"])
def test_errors_name_the_file_that_was_asked_for(tmp_path: Path, name: str) -> None:
    (tmp_path / "folder").mkdir()
    path = tmp_path / name
    with pytest.raises(OSError, match=re.escape(f"'{path}'")) as failed:
        write_whole(path, b"data")
    assert failed.value.strerror
    assert [entry.name for entry in tmp_path.iterdir()] == ["folder"]


@pytest.mark.parametrize(
    "source", sorted(SOURCES.rglob("*.py")), ids=lambda path: str(path.relative_to(SOURCES))
)
def test_nothing_writes_files_in_place(source: Path) -> None:
    found = [
        line
        for line in source.read_text(encoding="utf-8").splitlines()
        if IN_PLACE.search(line) or FIGURE_BY_NAME.search(line)
    ]
    own = ['with unfinished.open("wb") as file:'] if source == Path(files.__file__) else []
    assert [line.strip() for line in found] == own
