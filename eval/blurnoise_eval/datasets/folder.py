"""Pictures in a folder, on this machine or by URL."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

from blurnoise_eval.datasets.images import SUFFIXES, read_picture
from blurnoise_eval.datasets.records import Image, Picture, PictureSet, Target, UnreadablePicture
from blurnoise_eval.system.files import RUN_FILE, RUN_PICTURES
from blurnoise_eval.system.urls import Location, listing, location, versions

MAX_MEGAPIXELS = 100.0
"""Of a picture: a sweep takes some 100 bytes a pixel."""


class Listed(NamedTuple):
    """A picture's name in its folder, targets, id (None: its place, from 1 on), and the size (width, height) that its
    labels are for."""

    name: str
    targets: tuple[Target, ...] | None = None
    image_id: int | None = None
    size_px: tuple[float, float] | None = None


def image_folder(folder: str | Location) -> PictureSet:
    """The pictures in ``folder`` and below, by name. The targets are the detections in the original pictures.

    Raises ``ValueError`` when the folder is missing, cannot be read or holds no picture.
    """
    place = location(folder)
    found = pictures_below(place)
    return PictureSet("folder", str(place), from_files(place, [*map(Listed, found)], found))


def pictures_below(folder: Location) -> dict[str, str]:
    """Versions of the pictures in ``folder`` and below by their names, sorted, as sub/picture.png.

    Links to folders stay shut. What a sweep has written is left out: the folders of runs below, and of a run in
    ``folder`` itself its own examples and figures. Raises ``ValueError`` as :func:`image_folder`.
    """
    if isinstance(folder, Path) and not folder.is_dir():
        raise ValueError(f"images = {str(folder)!r}: must be a folder")
    try:
        found = listing(folder)
    except OSError as error:
        raise ValueError(f"images = {str(error.filename or folder)!r}: {error.strerror}") from None
    runs = [name.removesuffix(RUN_FILE) for name in found if f"/{name}".endswith(f"/{RUN_FILE}")]
    own = [f"{pictures}/" for pictures in RUN_PICTURES] if "" in runs else []
    left_out = (*own, *filter(None, runs))
    names = [name for name in sorted(found) if name.lower().endswith(SUFFIXES)]
    taken = {name: found[name] for name in names if not name.startswith(left_out)}
    if not taken:
        raise ValueError(f"images = {str(folder)!r}: contains no pictures ({' '.join(SUFFIXES)})")
    return taken


def from_files(
    folder: Location, entries: Sequence[Listed], known: Mapping[str, str] | None = None
) -> tuple[Picture, ...]:
    """The pictures of these names in the folder; they need not be there before they are loaded.

    known: their versions, where these have been looked up. One of another size than its labels are for, turned as
    EXIF says, or of more than ``MAX_MEGAPIXELS``, is an :class:`UnreadablePicture` then. Raises ``OSError`` where
    the folder is a URL that nothing can be read from.
    """
    found = versions(folder, [entry.name for entry in entries]) if known is None else known
    pictures = []
    for place, (name, targets, image_id, size_px) in enumerate(entries, start=1):
        printed = name.encode("utf-8", "backslashreplace").decode()  # tables hold no bytes that are not UTF-8
        version = found.get(name)
        load = partial(_load, folder, name, size_px, version)
        identity = f"{printed} {version or 'missing'}"
        pictures.append(Picture(printed, targets, load, identity, place if image_id is None else image_id))
    return tuple(pictures)


def _load(folder: Location, name: str, size_px: tuple[float, float] | None, known: str | None) -> Image:
    path = folder / name  # joined only now: a hundred thousand paths take 50 MB
    picture = read_picture(path, MAX_MEGAPIXELS, known)
    height, width = picture.shape[:2]
    if size_px and size_px != (width, height):
        wanted = f"{size_px[0]:g} x {size_px[1]:g}"
        raise UnreadablePicture(
            f"{path}: {width} x {height} px in its EXIF orientation, but its labels are for {wanted}"
        )
    return picture
