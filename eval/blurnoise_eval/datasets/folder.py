"""Pictures in a folder, on this machine or by URL."""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import replace
from functools import partial
from pathlib import Path

from blurnoise_eval.datasets.images import MAX_MEGAPIXELS, SUFFIXES, read_picture
from blurnoise_eval.datasets.records import Image, Picture, PictureSet, Target, UnreadablePicture
from blurnoise_eval.system.files import RUN_FILE, RUN_PICTURES
from blurnoise_eval.system.storage import Location, Url, listing, stamps

MOST_TARGETS = 20_000
"""Of a picture, as many as the largest sets of crowds have: each is a row in every cell."""


def image_folder(folder: Location, *, max_megapixels: float = MAX_MEGAPIXELS) -> PictureSet:
    """Every picture in ``folder`` and below, by name; no boxes, so the clean picture's detections count.

    max_megapixels: larger pictures cannot be loaded, whose memory would be wanted by the others.
    Raises ``ValueError`` when the folder is missing, cannot be read or holds no picture.
    """
    found = _listed(folder) if isinstance(folder, Url) else None
    names = picture_names(folder) if found is None else sorted(found)
    load = partial(from_file, max_megapixels=max_megapixels)
    pictures = tuple(
        load(folder, name, None, number, stamp=found[name] if found else None)
        for number, name in enumerate(names, start=1)
    )
    return PictureSet("folder", str(folder), pictures)


def picture_names(folder: Location) -> list[str]:
    """Names of the pictures in ``folder`` and below, sorted, as sub/picture.png; links to folders stay shut.

    What a sweep has written is left out: the folders of runs below, and of a run in ``folder`` itself its own
    examples and figures.
    Raises ``ValueError`` as :func:`image_folder`.
    """
    if isinstance(folder, Url):
        return sorted(_listed(folder))
    folder = Path(str(folder))
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


def _listed(folder: Url) -> dict[str, str]:
    """Stamps of the pictures by their names, as :func:`picture_names` finds them, by one listing."""
    try:
        found = listing(folder)
    except OSError as error:
        raise ValueError(f"images = {str(folder)!r}: {error.strerror}") from None
    runs = {name.removesuffix(RUN_FILE) for name in found if f"/{name}".endswith(f"/{RUN_FILE}")}
    left_out = tuple(
        run or f"{pictures}/" for run in runs for pictures in (RUN_PICTURES if not run else ("",))
    )
    taken = {
        name: stamp
        for name, stamp in found.items()
        if name.lower().endswith(SUFFIXES) and not name.startswith(left_out)
    }
    if not taken:
        raise ValueError(f"images = {str(folder)!r}: holds no picture ({' '.join(SUFFIXES)})")
    return taken


Entry = tuple[str, tuple[Target, ...] | None, int, tuple[float, float] | None]


def from_files(folder: Location, entries: Iterable[Entry], max_megapixels: float) -> tuple[Picture, ...]:
    """The pictures of several (name, targets, id, size), as :func:`from_file` makes each.

    Raises ``OSError`` where the folder is a URL that nothing can be read from.
    """
    load = partial(from_file, folder, max_megapixels=max_megapixels)
    if not isinstance(folder, Url):
        return tuple(load(*entry) for entry in entries)
    entries = list(entries)
    found = stamps(folder, [name for name, *_ in entries])
    return tuple(load(*entry, stamp=found.get(entry[0])) for entry in entries)


def from_file(
    folder: Location,
    name: str,
    targets: tuple[Target, ...] | None,
    image_id: int,
    size_px: tuple[float, float] | None = None,
    *,
    max_megapixels: float = MAX_MEGAPIXELS,
    stamp: str | None = None,
) -> Picture:
    """The picture of that name in the folder; it need not be there before it is loaded.

    size_px: (width, height) that its labels are for, where they say it. One of another size, turned as EXIF
    says, or of more than ``max_megapixels``, is an :class:`UnreadablePicture` then. Raises ``ValueError`` for more
    than ``MOST_TARGETS`` targets. stamp: of an object in a folder that is a URL; None where it is missing.
    """
    if targets and len(targets) > MOST_TARGETS:
        raise ValueError(f"picture {name!r}: {len(targets)} boxes; must be at most {MOST_TARGETS}")
    printed = name.encode("utf-8", "backslashreplace").decode()  # tables hold no bytes that are not UTF-8
    return Picture(
        printed,
        targets,
        partial(_load, folder, name, size_px, max_megapixels, stamp),
        f"{printed} {_stamp(folder, name) if isinstance(folder, Path) else stamp or 'missing'}",
        image_id,
    )


def _stamp(folder: Path, name: str) -> str:
    """Changes whenever the file does, and sometimes without; nothing is read for it."""
    try:
        found = (folder / name).stat()
    except OSError:
        return "missing"
    return f"{found.st_size} {found.st_mtime_ns} {found.st_ctime_ns} {found.st_ino}"


def _load(
    folder: Location, name: str, size_px: tuple[float, float] | None, max_megapixels: float, stamp: str | None
) -> Image:
    path = folder / name  # joined only now: a hundred thousand paths take 50 MB
    if isinstance(path, Url):
        path = replace(path, stamp=stamp)
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
