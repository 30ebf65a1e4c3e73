"""Pictures in a folder, on this machine or by URL."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path, PurePosixPath
from typing import NamedTuple

import numpy as np

from blurnoise_eval.datasets import netpbm, tiff
from blurnoise_eval.datasets.images import OF_LIGHT, SUFFIXES, decode, depth_and_pages, read_picture
from blurnoise_eval.datasets.records import Image, Picture, PictureSet, Target, UnreadablePicture
from blurnoise_eval.system.files import RUN_FILE, RUN_PICTURES, note_inputs
from blurnoise_eval.system.urls import Location, listing, location, versions

MAX_MEGAPIXELS = 100.0
"""Of a picture: a sweep takes some 100 bytes a pixel."""


_LOOKED_AT = 8
_SIXTEEN_BITS = (".png", *netpbm.SUFFIXES, *tiff.SUFFIXES)
_FEWER_BITS = 14  # of 16, with which a picture reaches a quarter of full scale at most


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

    >>> import numpy as np
    >>> from blurnoise_eval import datasets
    >>> datasets.write_picture("grey.png", np.full((60, 80, 3), 128, np.uint8))
    >>> [picture.name for picture in datasets.image_folder(".")]
    ['grey.png']
    """
    root = location(folder)
    pictures_in_folder, notes = pictures_below(root)
    pictures = from_files(root, [*map(Listed, pictures_in_folder)], pictures_in_folder)
    notes += picture_doubts(root, [*pictures_in_folder])
    return PictureSet("folder", str(root), pictures, notes=tuple(notes), folder=root)


def pictures_below(folder: Location) -> tuple[dict[str, str], list[str]]:
    """Versions of the pictures in ``folder`` and below by their names, sorted, as sub/picture.png; and notes.

    Links to folders stay shut. What a sweep has written is left out: the folders of runs below, and of a run in
    ``folder`` itself its own examples and figures. What macOS puts into archives is left out with a note. Raises
    ``ValueError`` as :func:`image_folder`.
    """
    if isinstance(folder, Path) and not folder.is_dir():
        raise ValueError(f"images = {str(folder)!r}: must be a folder")
    try:
        files = listing(folder)
    except OSError as error:
        raise ValueError(f"images = {str(error.filename or folder)!r}: {error.strerror}") from None
    runs = [name.removesuffix(RUN_FILE) for name in files if f"/{name}".endswith(f"/{RUN_FILE}")]
    own_pictures = [f"{pictures}/" for pictures in RUN_PICTURES] if "" in runs else []
    left_out = (*own_pictures, *filter(None, runs))
    names = [
        name for name in sorted(files) if name.lower().endswith(SUFFIXES) and not name.startswith(left_out)
    ]
    chosen = {name: files[name] for name in names if not is_litter(name)}
    if not chosen:
        raise ValueError(f"images = {str(folder)!r}: contains no pictures ({' '.join(SUFFIXES)})")
    litter = len(names) - len(chosen)
    return chosen, [f"files of macOS (._NAME), which are no pictures, left out: {litter}"] if litter else []


def is_litter(name: str) -> bool:
    """Whether macOS has put the file beside another, into an archive or onto a foreign disk."""
    return PurePosixPath(name).name.startswith("._") or "__MACOSX/" in name


def picture_doubts(folder: Location, names: Sequence[str]) -> list[str]:
    """What is assumed of up to ``_LOOKED_AT`` of the pictures: that floats are linear light. Signs that they mean
    other values than are read: 16 bits that use fewer, and TIFFs with more pages."""
    able = [name for name in names if name.lower().endswith(_SIXTEEN_BITS)]
    indices = np.unique(np.linspace(0, len(able) - 1, min(_LOOKED_AT, len(able))).round().astype(int))
    most, pages, doubts = 0, list[str](), list[str]()
    lights = [name for name in names if name.lower().endswith(OF_LIGHT)]
    for name in (able[index] for index in indices):
        with suppress(UnreadablePicture):
            header = depth_and_pages(folder / name)
            pages += [name] * header.more_pages
            lights += [name] * header.light
            if header.bits == 16 and not header.light:
                most = max(most, int(decode(folder / name, MAX_MEGAPIXELS).max()))
    if 0 < most < 2**_FEWER_BITS:
        doubts.append(
            f"doubtful values: the brightest of all is {most} of 65535 in the pictures of 16 bits: "
            f"{max(8, most.bit_length())} bits? They are read as {most / 65535:.1%} of white at most"
        )
    if lights:
        doubts.append(
            f"{lights[0]} holds floats: linear light, of which 1 is white and more is brighter than white"
        )
    if pages:
        doubts.append(f"doubtful pictures: {pages[0]} has more than one page; only the first is read")
    return doubts


def from_files(
    folder: Location, entries: Sequence[Listed], known: Mapping[str, str] | None = None
) -> tuple[Picture, ...]:
    """The pictures of these names in the folder; they need not be there before they are loaded.

    known: their versions, where these have been looked up. One of another size than its labels are for, turned as
    EXIF says, or of more than ``MAX_MEGAPIXELS``, is an :class:`UnreadablePicture` then. Raises ``OSError`` where
    the folder is a URL that nothing can be read from.
    """
    if isinstance(folder, Path):
        note_inputs(folder / entry.name for entry in entries)
    known_versions = versions(folder, [entry.name for entry in entries]) if known is None else known
    pictures = []
    for number, (name, targets, image_id, size_px) in enumerate(entries, start=1):
        printed = name.encode("utf-8", "backslashreplace").decode()  # tables hold no bytes that are not UTF-8
        version = known_versions.get(name)
        load = partial(_load, folder, name, size_px, version)
        identity = f"{printed} {version or 'missing'}"
        pictures.append(Picture(printed, targets, load, identity, number if image_id is None else image_id))
    return tuple(pictures)


def _cause(labels_px: tuple[float, float], picture_px: tuple[int, int]) -> str:
    """What may have made the sizes differ."""
    if labels_px == picture_px[::-1]:
        return " (turned: labels of the picture as it is stored?)"
    scale = picture_px[0] / labels_px[0]
    return (
        f" (scaled by {scale:.3g}?)" if abs(picture_px[1] - scale * labels_px[1]) <= max(1.0, scale) else ""
    )


def _load(folder: Location, name: str, size_px: tuple[float, float] | None, known: str | None) -> Image:
    path = folder / name  # joined only now: a hundred thousand paths take 50 MB
    picture = read_picture(path, MAX_MEGAPIXELS, known)
    height, width = picture.shape[:2]
    if size_px and size_px != (width, height):
        wanted = f"{size_px[0]:g} x {size_px[1]:g}"
        raise UnreadablePicture(
            f"{path}: {width} x {height} px in its EXIF orientation, but its labels are for {wanted}"
            f"{_cause(size_px, (width, height))}"
        )
    return picture
