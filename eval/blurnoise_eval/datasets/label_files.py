"""Readers of label files of a whole set: COCO's instances, BDD100K's and Scalabel's frames, PP-OCR's texts."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Sequence
from typing import Annotated, Any, TypeVar

import numpy as np
from annotated_types import Ge, Len, Lt
from pydantic import BaseModel, ConfigDict

from blurnoise._core.checks import Characters, shown
from blurnoise_eval.datasets.folder import Entry
from blurnoise_eval.datasets.images import MAX_MEGAPIXELS, size_px
from blurnoise_eval.datasets.labels import (
    LARGEST_ID,
    LARGEST_SET_BYTES,
    FileName,
    Number,
    Selection,
    Sized,
    Whole,
    as_json,
    checked,
    each,
    each_line,
    faults_of,
    read_text,
)
from blurnoise_eval.datasets.records import PictureSet, Target, UnreadablePicture
from blurnoise_eval.system.files import inside
from blurnoise_eval.system.urls import Location, fetch_ahead, versions

TEXT = "text"
_READ = ("id", "image_id", "category_id", "bbox")  # the rest stays with the target
_UNREADABLE = ("###", "*")  # PP-OCR's marks of text that nobody could read
_HEIGHTS_PX = (("< 16", 16), ("16-32", 32), ("32-64", 64), ("> 64", math.inf))


class _Category(BaseModel):
    id: Whole
    name: Characters


class _Image(Sized):
    id: Whole
    file_name: FileName


class _Coco(BaseModel):
    images: list[_Image]
    categories: list[_Category]
    annotations: list[Any]  # checked one by one: of the largest sets they fill the memory


class _Annotation(BaseModel):
    image_id: Whole
    category_id: Whole
    bbox: Annotated[tuple[Number, Number, Number, Number], "must be [x, y, width, height], px"]
    area: Annotated[Number, Ge(0), Lt(math.inf)] | None = None


_WithId = TypeVar("_WithId", _Category, _Image)


def coco(
    file: Location,
    *,
    images: Location | None = None,
    labels: Sequence[str] = (),
    keep_empty: bool = False,
    max_megapixels: float = MAX_MEGAPIXELS,
) -> PictureSet:
    """The pictures of a COCO instances file, with its boxes as targets; crowds are marked as such.

    images: their folder, by default the file's own. labels: category names to keep; pictures without any of
    them are left out, unless ``keep_empty``: what is found there is wrong. Boxes without area, not finite or
    outside their picture are left out and noted. Boxes are those of the upright picture, as EXIF turns it: one
    of another size than the file says cannot be loaded, nor can one of more than ``max_megapixels``. Raises
    ``ValueError`` that names the file for anything that is not COCO, and for a file name that leaves the folder.
    """
    selection = Selection(labels, keep_empty)
    with faults_of("coco", file):
        document = checked(_Coco, as_json(read_text(file, LARGEST_SET_BYTES), "a COCO instances file"))
        categories = _by_id(document.categories, "categories")
        listed = _by_id(document.images, "images")
        targets: defaultdict[int, list[Target]] = defaultdict(list)
        used: set[int] = set()
        for place, entry in enumerate(each(document.annotations, "annotations", _Annotation)):
            if entry.category_id not in categories:
                known = f"category_id = {entry.category_id}: not among the categories"
                raise ValueError(f"annotations[{place}]: {known}")
            if entry.image_id not in listed:
                selection.leave_out("of pictures that are not listed")
                continue
            stated = document.annotations[place]
            annotation = {key: value for key, value in stated.items() if key not in _READ}
            own = stated.get("id")
            if type(own) is int and 0 < own < LARGEST_ID and own not in used:  # for COCO's tools 0 is none
                annotation["id"] = own
                used.add(own)
            x, y, width, height = entry.bbox
            targets[entry.image_id] += selection.target(
                categories[entry.category_id].name,
                (x, y, x + width, y + height),
                listed[entry.image_id].size_px,
                area_px2=entry.area,
                crowd=bool(annotation.get("iscrowd")),
                annotation=annotation,
            )
        ids = {category.name: category_id for category_id, category in categories.items()}
        entries = ((each.file_name, tuple(targets[n]), n, each.size_px) for n, each in listed.items())
        return selection.picture_set("coco", file, entries, ids, images, max_megapixels)


def _by_id(entries: Iterable[_WithId], name: str) -> dict[int, _WithId]:
    found: dict[int, _WithId] = {}
    for entry in entries:
        if entry.id in found:
            raise ValueError(f"{name}: id {entry.id} twice")
        found[entry.id] = entry
    return found


class _Corners(BaseModel):
    x1: Number
    y1: Number
    x2: Number
    y2: Number


class _Label(BaseModel):
    """What else it says, ``model_extra``, stays with the target. A lane or a drivable area has no box."""

    model_config = ConfigDict(extra="allow")
    id: Any = None
    box2d: _Corners | None = None
    category: Characters | None = None


class _Frame(BaseModel):
    name: FileName
    labels: list[_Label] | None = None
    size: Sized | None = None


def bdd(
    file: Location,
    *,
    images: Location | None = None,
    labels: Sequence[str] = (),
    keep_empty: bool = False,
    max_megapixels: float = MAX_MEGAPIXELS,
) -> PictureSet:
    """The pictures of a BDD100K detection file, with their box2d as targets; labels without one do not count.

    The file is a list of frames, or an object with ``frames``: https://doc.bdd100k.com/format.html. images,
    labels, ``keep_empty``, ``max_megapixels``, notes, sizes (a frame's ``size``, where it has one) and errors as
    of :func:`blurnoise_eval.datasets.coco`; categories keep their names ("traffic sign", "bike") and are numbered
    in alphabetical order.
    """
    selection = Selection(labels, keep_empty)
    with faults_of("bdd", file):
        document = as_json(read_text(file, LARGEST_SET_BYTES), "BDD100K's labels")
        frames = document.get("frames") if isinstance(document, dict) else document
        known: set[str] = set()
        entries: list[Entry] = []
        for frame in each(frames, "frames", _Frame):
            targets: list[Target] = []
            for label in frame.labels or ():
                if (box := label.box2d) and label.category:
                    known.add(label.category)
                    beside = label.model_extra or {}
                    attributes = beside.get("attributes")
                    crowd = isinstance(attributes, dict) and bool(attributes.get("crowd"))
                    corners = (box.x1, box.y1, box.x2, box.y2)
                    targets += selection.target(label.category, corners, crowd=crowd, annotation=beside)
            entries.append((frame.name, tuple(targets), None, frame.size.size_px if frame.size else None))
        categories = {label: place for place, label in enumerate(sorted(known), start=1)}
        return selection.picture_set("bdd", file, entries, categories, images, max_megapixels)


class _Text(BaseModel):
    transcription: Characters
    points: Annotated[list[tuple[Number, Number]], Len(2), "must be corners [[x, y], ...], px"]


def texts(
    file: Location, *, images: Location | None = None, max_megapixels: float = MAX_MEGAPIXELS
) -> PictureSet:
    """The pictures of a PP-OCR label file, with their texts as targets; unreadable ones are marked as crowds.

    The file has a line per picture: its name, a tab, and either its text, when the whole picture is the box,
    or, for all pictures, JSON: ``[{"transcription": "STOP", "points": [[x, y], ...]}]``, px. Source: PaddleOCR,
    "text recognition" and "text detection" data sets. images: the pictures' folder, by default the file's own;
    one of more than ``max_megapixels`` cannot be loaded. Raises ``ValueError`` that names the file and the line.
    """
    folder = images or file.parent
    selection = Selection((), keep_empty=True)
    with faults_of("text", file):
        content = read_text(file, LARGEST_SET_BYTES)
        with_places, known = "\t[{" in content, dict[str, str]()
        if not with_places:
            names = [line.partition("\t")[0] for line in content.split("\n") if line.strip()]
            known = versions(folder, names)
            fetch_ahead(folder, known)

        def read(line: str) -> tuple[str, list[Target]]:
            name, tab, rest = line.partition("\t")
            if not tab:
                raise ValueError(f"{shown(line)}: must be a picture's name, a tab and its text")
            name = inside(name)
            if with_places:
                return name, _places(rest, selection)
            return name, _whole(rest, folder / name, known.get(name))

        entries = ((name, tuple(found), None, None) for name, found in each_line(content, read))
        return selection.picture_set("text", file, entries, {TEXT: 1}, images, max_megapixels)


def _whole(written: str, picture: Location, known: str | None) -> list[Target]:
    """The whole picture as the text's place; nothing where it cannot be read, which loading it says."""
    try:
        width, height = size_px(picture, known)
    except UnreadablePicture:
        return []
    return [Target(TEXT, _height_group(height), (0.0, 0.0, float(width), float(height)), text=written)]


def _places(written: str, selection: Selection) -> list[Target]:
    """The upright boxes around the points."""
    entries, targets = as_json(written, "a list of texts and points"), list[Target]()
    for place, entry in enumerate(each(entries, "texts", _Text)):
        corners = np.array(entry.points)
        (x0, y0), (x1, y1) = corners.min(axis=0).tolist(), corners.max(axis=0).tolist()
        targets += selection.target(
            TEXT,
            (x0, y0, x1, y1),
            group=_height_group(y1 - y0),
            crowd=entry.transcription in _UNREADABLE,
            text=entry.transcription,
            annotation={key: value for key, value in entries[place].items() if key != "transcription"},
        )
    return targets


def _height_group(height_px: float) -> str:
    """The text's curve, by the height of its box."""
    return next(f"text, height {span} px" for span, below_px in _HEIGHTS_PX if height_px < below_px)
