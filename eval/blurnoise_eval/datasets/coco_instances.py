"""Instances files of COCO."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from typing import Annotated, Any, TypeVar

from pydantic import AfterValidator, BaseModel, model_validator

from blurnoise._core.checks import Characters
from blurnoise_eval.datasets.folder import from_files
from blurnoise_eval.datasets.images import MAX_MEGAPIXELS
from blurnoise_eval.datasets.labels import (
    LARGEST_ID,
    FileName,
    Number,
    Selection,
    Size,
    Whole,
    each,
    faults_of,
    of_length,
    read_json,
)
from blurnoise_eval.datasets.records import PictureSet, Target
from blurnoise_eval.system.urls import Location

_KIND = "a COCO instances file"
_READ = ("id", "image_id", "category_id", "bbox")  # the rest stays with the target
_PARTS = {"images", "categories", "annotations"}


def _area(px2: float) -> float:
    if not 0 <= px2 < math.inf:
        raise ValueError("must be finite and >= 0, px^2")
    return px2


class _Category(BaseModel):
    id: Whole
    name: Characters


class _Image(BaseModel):
    id: Whole
    file_name: FileName
    size: Size | None = None

    @model_validator(mode="before")
    @classmethod
    def _both_sides_or_none(cls, entry: Any) -> Any:
        known = isinstance(entry, dict) and entry.get("width") and entry.get("height")
        return {**entry, "size": entry if known else None} if isinstance(entry, dict) else entry


class _Annotation(BaseModel):
    image_id: Whole
    category_id: Whole
    bbox: Annotated[list[Number], of_length(4, 4, "must be [x, y, width, height], px")]
    area: Annotated[Number, AfterValidator(_area)] | None = None


Entry = TypeVar("Entry", _Category, _Image)


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
        categories = _by_id(each(document["categories"], "categories", _Category), "categories")
        labels_by_id = {category_id: category.name for category_id, category in categories.items()}
        listed = _by_id(each(document["images"], "images", _Image), "images")
        targets = _targets(document["annotations"], labels_by_id, listed, selection)
        taken = (
            (image.file_name, tuple(targets[image_id]), image_id, image.size.px if image.size else None)
            for image_id, image in listed.items()
            if selection.takes(targets[image_id])
        )
        pictures = from_files(images or file.parent, taken, max_megapixels)
        selection.check(labels_by_id.values(), pictures)
    ids = {label: category_id for category_id, label in labels_by_id.items()}
    return PictureSet("coco", str(file), pictures, ids, selection.notes(), selection.chosen)


def _by_id(entries: Iterable[Entry], name: str) -> dict[int, Entry]:
    found: dict[int, Entry] = {}
    for entry in entries:
        if entry.id in found:
            raise ValueError(f"{name}: id {entry.id} twice")
        found[entry.id] = entry
    return found


def _targets(
    entries: Any, labels: Mapping[int, str], listed: Mapping[int, _Image], selection: Selection
) -> defaultdict[int, list[Target]]:
    """The boxes that count, by the picture's id. An annotation's id that COCO's tools could not use is forgotten."""
    targets: defaultdict[int, list[Target]] = defaultdict(list)
    used: set[int] = set()
    for place, entry in enumerate(each(entries, "annotations", _Annotation)):
        if entry.category_id not in labels:
            raise ValueError(
                f"annotations[{place}]: category_id = {entry.category_id}: not among the categories"
            )
        if entry.image_id not in listed:
            selection.leave_out("of pictures that are not listed")
            continue
        annotation = {key: value for key, value in entries[place].items() if key not in _READ}
        own = entries[place].get("id")
        usable = type(own) is int and 0 < own < LARGEST_ID  # pycocotools takes 0 for "not found"
        repeated = usable and own in used
        if usable and not repeated:
            annotation["id"] = own
            used.add(own)
        x, y, width, height = entry.bbox
        size = listed[entry.image_id].size
        found = selection.target(
            labels[entry.category_id],
            (x, y, x + width, y + height),
            size.px if size else None,
            area_px2=entry.area,
            crowd=bool(entries[place].get("iscrowd")),
            annotation=annotation,
        )
        if found and repeated:
            selection.count("with the id of another (its own is a new one)")
        targets[entry.image_id] += found
    return targets
