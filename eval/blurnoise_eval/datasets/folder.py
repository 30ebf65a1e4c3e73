"""Pictures in a folder."""

from __future__ import annotations

import os
from functools import partial
from pathlib import Path

from blurnoise_eval.datasets.images import MAX_MEGAPIXELS, SUFFIXES, read_picture
from blurnoise_eval.datasets.records import Image, Picture, PictureSet, Target, UnreadablePicture
from blurnoise_eval.system.files import RUN_FILE, RUN_PICTURES

MOST_TARGETS = 20_000
"""Of a picture, as many as the largest sets of crowds have: each is a row in every cell."""


def image_folder(folder: Path, *, max_megapixels: float = MAX_MEGAPIXELS) -> PictureSet:
    """Every picture in ``folder`` and below, by name; no boxes, so the clean picture's detections count.

    max_megapixels: larger pictures cannot be loaded, whose memory would be wanted by the others.
    Raises ``ValueError`` when the folder is missing, cannot be read or holds no picture.
    """
    names = picture_names(folder)
    load = partial(from_file, max_megapixels=max_megapixels)
    pictures = tuple(load(folder, name, None, number) for number, name in enumerate(names, start=1))
    return PictureSet("folder", str(folder), pictures)


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


def from_file(
    folder: Path,
    name: str,
    targets: tuple[Target, ...] | None,
    image_id: int,
    size_px: tuple[float, float] | None = None,
    *,
    max_megapixels: float = MAX_MEGAPIXELS,
) -> Picture:
    """The picture of that name in the folder; it need not be there before it is loaded.

    size_px: (width, height) that its labels are for, where they say it. One of another size, turned as EXIF
    says, or of more than ``max_megapixels``, is an :class:`UnreadablePicture` then. Raises ``ValueError`` for more
    than ``MOST_TARGETS`` targets.
    """
    if targets and len(targets) > MOST_TARGETS:
        raise ValueError(f"picture {name!r}: {len(targets)} boxes; must be at most {MOST_TARGETS}")
    printed = name.encode("utf-8", "backslashreplace").decode()  # tables hold no bytes that are not UTF-8
    return Picture(
        printed,
        targets,
        partial(_load, folder, name, size_px, max_megapixels),
        f"{printed} {_stamp(folder / name)}",
        image_id,
    )


def _stamp(file: Path) -> str:
    """Changes whenever the file does, and sometimes without; nothing is read for it."""
    try:
        found = file.stat()
    except OSError:
        return "missing"
    return f"{found.st_size} {found.st_mtime_ns} {found.st_ctime_ns} {found.st_ino}"


def _load(folder: Path, name: str, size_px: tuple[float, float] | None, max_megapixels: float) -> Image:
    path = folder / name  # joined only now: a hundred thousand paths take 50 MB
    picture = read_picture(path, max_megapixels)
    height, width = picture.shape[:2]
    if height * width == 1:
        raise UnreadablePicture(f"{path}: a single pixel, in which nothing can be found")
    if size_px and size_px != (width, height):
        raise UnreadablePicture(
            f"{path}: {width} x {height} px as EXIF turns it, but its labels are for {size_px[0]:g} x {size_px[1]:g}"
        )
    return picture


def _is_file(entry: os.DirEntry[str]) -> bool:
    """Whether it is a file or leads to one; a link that leads nowhere, or to itself, is none."""
    return entry.is_file(follow_symlinks=False) or Path(entry).is_file()
