"""Files of a run and of figures: written completely or not at all, and none outside the folder of the run."""

from __future__ import annotations

import errno
import io
import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any

from blurnoise._core.files import check_regular
from blurnoise._core.writing import (
    check_replaceable,
    check_writable,
    check_writable_folder,
    note_inputs,
    remove,
    write_whole,
    writing,
    written_whole,
)
from blurnoise_eval.system.tables import csv_lines

__all__ = [
    "check_regular", "check_replaceable", "check_writable", "check_writable_folder",
    "note_inputs", "remove", "write_whole", "writing", "written_whole",
]  # fmt: skip

RUN_FILE = "results.sqlite"
"""The file that makes a folder a run's."""
LARGEST_EXAMPLE_BYTES = 300_000_000
"""Of a picture in a run's folder."""
RUN_PICTURES = ("examples", "figures")
"""Folders of a run that hold pictures."""
RUN_FILES = (
    "recommendations.csv", "answers.csv", "models.csv", "scores.csv", "curves.csv", "results.csv", "targets.csv",
    "conditions.json", "summary.json", "report.html", "failures.html", "coco/instances.json",
    "figures/confidence_*.png", "figures/score_moves.png",
)  # fmt: skip
"""The other files of a sweep and its report."""


def write_records(
    name: str, records: Sequence[Mapping[str, Any]], document: Mapping[str, Any], folder: Path
) -> None:
    """Write ``name``.csv with a row per record, and ``name``.json. Raises ``OSError``.

    >>> import tempfile
    >>> folder = Path(tempfile.mkdtemp())
    >>> write_records("answers", [{"model": "a", "auc": 0.5}], {"models": ["a"]}, folder)
    >>> (folder / "answers.csv").read_text()
    'model,auc\\na,0.5\\n'
    """
    write_whole(folder / f"{name}.csv", (line.encode() for line in csv_lines([*records[0]], records)))
    write_whole(folder / f"{name}.json", json.dumps(document, indent=1, allow_nan=False).encode())


def check_outputs(folder: Path, *names: str) -> None:
    """Check before any computation that these files in a folder may be written.

    names: patterns of :meth:`Path.glob`; folders end with a slash. Raises ``OSError`` for a file that must not be
    replaced, and for a pipe, which may have no reader; ``ValueError`` for a link out of the folder, which may come
    from anyone.

    >>> import tempfile
    >>> check_outputs(Path(tempfile.mkdtemp()), "report.html", "figures/")  # raises where one must not be written
    """
    check_writable_folder(folder)
    for below in sorted({name.rpartition("/")[0] for name in names} - {""}):
        if path_within(folder, below).exists():
            check_writable_folder(folder / below)
    for name in (each for each in names if not each.endswith("/")):
        for path in sorted({*folder.glob(name), *(each for each in [folder / name] if each.is_symlink())}):
            target = check_replaceable(path)
            path_within(folder, path.relative_to(folder))
            if target is None:
                raise OSError(errno.EINVAL, "is a device or a pipe; must be a file", str(path))


def write_figure(path: Path, figure: Any, *, dpi: int) -> None:
    """Write a figure of matplotlib in the format of the suffix, as :func:`write_whole` does."""
    picture = io.BytesIO()
    figure.savefig(picture, format=path.suffix[1:].lower(), dpi=dpi)
    write_whole(path, picture.getvalue())


def inside(name: str) -> str:
    """The normal form of a file's name, such as sub/picture.png.

    Raises ``ValueError`` for a name that leaves its folder on any system: by '..', as an absolute path, with a drive
    letter or a backslash.

    >>> inside("a/./b/../c.png")
    'a/c.png'
    """
    windows, path = PureWindowsPath(name), os.path.normpath(PurePosixPath(name))
    leaves = path in (".", "..") or path.startswith(("/", "../"))
    if leaves or windows.drive or windows.root or "\\" in name or "\0" in name:
        must = "must stay in it, such as sub/picture.png (no root, drive or backslash)"
        raise ValueError(f"file name {name[:200]!r} leaves the folder; {must}")
    return path


def path_within(folder: Path, name: str | Path) -> Path:
    """The path in ``folder`` of a name from a run, which may come from anyone. It need not exist.

    Raises ``ValueError`` for a name that leaves the folder, as :func:`inside` does, also through a symbolic link.

    >>> path_within(Path("run"), "figures/../report.html").as_posix()
    'run/report.html'
    """
    path = folder / inside(str(name))
    if not path.resolve().is_relative_to(folder.resolve()):
        raise ValueError(f"file name {str(name)[:200]!r} leaves the folder {str(folder)!r} through a link")
    return path
