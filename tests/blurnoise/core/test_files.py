"""Files that never end are refused at once, whatever they are read as."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest
from blurnoise_eval.grid.trajectory_spec import TrajectorySpec

from blurnoise._core import files
from blurnoise._core.files import read_document, read_samples


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="has no pipes")
@pytest.mark.parametrize(
    "read",
    [
        read_document,
        lambda path: read_samples(path, 1, "wavelength"),
        lambda path: TrajectorySpec.parse(str(path)),
    ],
)
def test_pipes_and_devices_are_refused(tmp_path: Path, read: Callable[[Path], object]) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", Path("/dev/zero")):
        with pytest.raises(OSError, match="device or pipe"):
            read(path)


def test_a_table_is_of_limited_size(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(files.read_bytes, "__defaults__", (20,))
    path = tmp_path / "a.csv"
    path.write_bytes(b"\xef\xbb\xbf1,2\r\n3,4\r5,6\n")
    assert read_samples(path, 1, "wavelength") == ((1, 3, 5), (2, 4, 6))
    path.write_bytes(b"1,2\n" * 6)
    with pytest.raises(ValueError, match=r"a\.csv: larger than 20 bytes"):
        read_samples(path, 1, "wavelength")


def test_other_bytes_are_no_text(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_bytes(b"1,2\n\xff")
    with pytest.raises(ValueError, match=r"a\.csv: not UTF-8 text \(byte 4\)"):
        TrajectorySpec.parse(str(tmp_path / "a.csv"))
