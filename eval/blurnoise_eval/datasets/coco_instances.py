"""Instances files of COCO."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple, TypeVar

from blurnoise._core.checks import shown
from blurnoise_eval.datasets.fields import (
    LARGEST_ID,
    as_number,
    each,
    faults_of,
    number,
    read_json,
    text,
    whole,
)
from blurnoise_eval.datasets.folder import from_files
from blurnoise_eval.datasets.images import MAX_MEGAPIXELS
from blurnoise_eval.datasets.records import PictureSet, Target
from blurnoise_eval.datasets.selection import Selection
from blurnoise_eval.system.files import inside
from blurnoise_eval.system.storage import Location

_KIND = "a COCO instances file"
_READ = ("id", "image_id", "category_id", "bbox")  # the rest stays with the target
_PARTS = {"images", "categories", "annotations"}
T = TypeVar("T")


class _Image(NamedTuple):
    name: str
    size_px: tuple[float, float] | None  # (width, height) where the file says it


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
        document = read_json(file, _KIND)
        if not isinstance(document, dict) or not document.keys() >= _PARTS:
            raise ValueError(f"not {_KIND}: must be an object with {', '.join(sorted(_PARTS))}")
        categories = _by_id(each(document["categories"], "categories", _category), "categories")
        listed = _by_id(each(document["images"], "images", _image), "images")
        targets: defaultdict[int, list[Target]] = defaultdict(list)
        read = partial(_annotation, categories=categories, listed=listed, selection=selection, used=set())
        for image_id, found in each(document["annotations"], "annotations", read):
            targets[image_id] += found
        taken = (
            (image.name, tuple(targets[image_id]), image_id, image.size_px)
            for image_id, image in listed.items()
            if selection.takes(targets[image_id])
        )
        pictures = from_files(images or file.parent, taken, max_megapixels)
        selection.check(categories.values(), pictures)
    ids = {label: category_id for category_id, label in categories.items()}
    return PictureSet("coco", str(file), pictures, ids, selection.notes(), selection.chosen)


def _by_id(entries: Iterable[tuple[int, T]], name: str) -> dict[int, T]:
    found: dict[int, T] = {}
    for entry_id, entry in entries:
        if entry_id in found:
            raise ValueError(f"{name}: id {entry_id} twice")
        found[entry_id] = entry
    return found


def _category(entry: dict[str, Any]) -> tuple[int, str]:
    return whole(entry, "id"), text(entry, "name")


def _image(entry: dict[str, Any]) -> tuple[int, _Image]:
    known = entry.get("width") and entry.get("height")
    size_px = (number(entry, "width"), number(entry, "height")) if known else None
    return whole(entry, "id"), _Image(inside(text(entry, "file_name")), size_px)


def _annotation(
    entry: dict[str, Any],
    *,
    categories: Mapping[int, str],
    listed: Mapping[int, _Image],
    selection: Selection,
    used: set[int],
) -> tuple[int, list[Target]]:
    """The picture's id and the box as a target, or none where it does not count.

    used: the annotations' ids so far; one that COCO's tools could not use is forgotten.
    """
    image_id, category_id = whole(entry, "image_id"), whole(entry, "category_id")
    if category_id not in categories:
        raise ValueError(f"category_id = {category_id}: not among the categories")
    bbox = entry["bbox"]
    if not isinstance(bbox, list) or len(bbox) != 4:
        raise ValueError(f"bbox = {shown(bbox)}: must be [x, y, width, height], px")
    x, y, width, height = (as_number(value, "bbox") for value in bbox)
    area = None if entry.get("area") is None else number(entry, "area")
    if area is not None and not 0 <= area < math.inf:
        raise ValueError(f"area = {area}: must be finite and >= 0, px^2")
    if image_id not in listed:
        return image_id, selection.leave_out("of pictures that are not listed")
    annotation = {key: value for key, value in entry.items() if key not in _READ}
    own: Any = entry.get("id")
    usable = type(own) is int and 0 < own < LARGEST_ID  # pycocotools takes 0 for "not found"
    repeated = usable and own in used
    if usable and not repeated:
        annotation["id"] = own
        used.add(own)
    found = selection.target(
        categories[category_id],
        (x, y, x + width, y + height),
        listed[image_id].size_px,
        area_px2=area,
        crowd=bool(entry.get("iscrowd")),
        annotation=annotation,
    )
    if found and repeated:
        selection.count("with the id of another (its own is a new one)")
    return image_id, found
