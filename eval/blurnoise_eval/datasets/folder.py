"""Pictures in a folder."""

from __future__ import annotations

import os
from functools import partial
from pathlib import Path

from blurnoise_eval.datasets.images import SUFFIXES, read_picture
from blurnoise_eval.datasets.records import Image, Picture, PictureSet, Target
from blurnoise_eval.system.files import RUN_FILE, RUN_PICTURES


def image_folder(folder: Path) -> PictureSet:
    """Every picture in ``folder`` and below, by name; no boxes, so the clean picture's detections count.

    Raises ``ValueError`` when the folder is missing, cannot be read or holds no picture.
    """
    names = picture_names(folder)
    pictures = (from_file(folder, name, None, number) for number, name in enumerate(names, start=1))
    return PictureSet("folder", str(folder), tuple(pictures))


def picture_names(folder: Path) -> list[str]:
    """Names of the pictures in ``folder`` and below, sorted, as sub/picture.png; links to folders stay shut.

    What a sweep has written is left out: the folders of runs below, and of a run in ``folder`` itself its own
    examples and figures.
    Raises ``ValueError`` as :func:`image_folder`.
    """
    if not folder.is_dir():
        raise ValueError(f"images = {str(folder)!r}: no such folder")
    names, unread = [], [""]
    while unread:
        below = unread.pop()
        is_run = (folder / below / RUN_FILE).is_file()
        if is_run and below:
            continue
        try:
            with os.scandir(folder / below) as entries:
                for entry in entries:
                    if entry.is_dir(follow_symlinks=False):
                        if is_run and entry.name in RUN_PICTURES:
                            continue
                        unread.append(f"{below}{entry.name}/")
                    elif entry.name.lower().endswith(SUFFIXES) and _is_file(entry):
                        names.append(below + entry.name)
        except OSError as error:
            raise ValueError(f"images = {str(folder / below)!r}: {error.strerror}") from None
    if not names:
        raise ValueError(f"images = {str(folder)!r}: holds no picture ({' '.join(SUFFIXES)})")
    return sorted(names)


def from_file(folder: Path, name: str, targets: tuple[Target, ...] | None, image_id: int) -> Picture:
    """The picture of that name in the folder; it need not be there before it is loaded."""
    printed = name.encode("utf-8", "backslashreplace").decode()  # tables hold no bytes that are not UTF-8
    try:
        size: int | None = (folder / name).stat().st_size
    except OSError:
        size = None
    return Picture(printed, targets, partial(_load, folder, name), f"{printed} {size} bytes", image_id)


def _load(folder: Path, name: str) -> Image:
    return read_picture(folder / name)  # joined only now: a hundred thousand paths take 50 MB


def _is_file(entry: os.DirEntry[str]) -> bool:
    """Whether it is a file or leads to one; a link that leads nowhere, or to itself, is none."""
    return entry.is_file(follow_symlinks=False) or Path(entry).is_file()
