"""COCO's instances: pictures, categories and boxes in one JSON file."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from typing import Annotated, Any

from annotated_types import Ge, Len, Lt
from pydantic import BaseModel

from blurnoise._core.fields import Characters
from blurnoise_eval.datasets.folder import Listed
from blurnoise_eval.datasets.label_doubts import shared_names
from blurnoise_eval.datasets.label_reading import (
    LARGEST_ID,
    LARGEST_SET_BYTES,
    Flag,
    Number,
    Sized,
    Whole,
    as_json,
    checked,
    each,
    faults_of,
    read_text,
)
from blurnoise_eval.datasets.records import PictureSet, Target
from blurnoise_eval.datasets.selection import Selection
from blurnoise_eval.system.urls import Location

_READ = ("id", "image_id", "category_id", "bbox")  # of an annotation; the rest stays with the target


class _CocoCategory(BaseModel):
    id: Whole
    name: Characters


class _CocoImage(Sized):
    id: Whole
    file_name: Characters


class _Coco(BaseModel):
    images: list[_CocoImage]
    categories: list[_CocoCategory]
    annotations: list[Any]  # checked one by one: of the largest sets they fill the memory


class _CocoAnnotation(BaseModel):
    image_id: Whole
    category_id: Whole
    bbox: Annotated[list[Number], Len(4, 4)]  # x, y, width, height, px
    area: Annotated[Number, Ge(0), Lt(math.inf)] | None = None
    iscrowd: Flag = False
    ignore: Flag = False


def coco(
    file: str | Location,
    *,
    images: str | Location | None = None,
    labels: Sequence[str] = (),
    keep_empty: bool = False,
) -> PictureSet:
    """The pictures of a COCO instances file, with its boxes as targets; crowds are marked as such.

    images: folder of the pictures, by default that of the file. labels: category names to keep; pictures without any
    of them are left out, unless ``keep_empty`` is true: then all detections in them are false positives. Boxes
    without area, not finite or outside their picture are left out, with a note. Two annotations with the same id are
    two targets, with a note, as are boxes that occur twice, and what is marked with "ignore": COCO's tools count all
    of these. Boxes refer to the upright picture, after its EXIF orientation. A picture whose size
    differs from the file, or that has more than 100 megapixels, cannot be loaded. Raises ``ValueError`` that names
    the file if it is not a COCO file, or if a file name leaves the folder.

    >>> import json
    >>> from pathlib import Path
    >>> from blurnoise_eval import datasets
    >>> box = {"id": 1, "image_id": 7, "category_id": 3, "bbox": [10, 20, 30, 40]}
    >>> image = {"id": 7, "file_name": "a.jpg", "width": 640, "height": 480}
    >>> labels = {"images": [image], "categories": [{"id": 3, "name": "car"}], "annotations": [box]}
    >>> _ = Path("instances.json").write_text(json.dumps(labels))
    >>> datasets.coco("instances.json").pictures[0].targets[0].box_xyxy
    (10.0, 20.0, 40.0, 60.0)
    """
    selection = Selection("coco", file, images, labels, keep_empty, "x, y, width, height")
    with faults_of("labels", selection.file):
        text = read_text(selection.file, LARGEST_SET_BYTES)
        document = checked(_Coco, as_json(text, "a COCO instances file"))
        for name, ids in (("images", document.images), ("categories", document.categories)):
            for number, count in Counter(entry.id for entry in ids).items():
                if count > 1:
                    raise ValueError(f"{name}: id = {number} occurs twice; ids must be unique")
        names = {category.id: category.name for category in document.categories}
        sized = all(image.size_px for image in document.images)
        file_names = selection.names([image.file_name for image in document.images], sized=sized)
        listed = {
            image.id: (file_name, image.size_px, list[Target]())
            for file_name, image in zip(file_names, document.images, strict=True)
        }
        used: set[int] = set()
        repeated = ignored = 0
        for index, entry in enumerate(each(document.annotations, "annotations", _CocoAnnotation)):
            if entry.category_id not in names:
                span = f"{min(names)} to {max(names)}" if names else "none"
                known = f"category_id = {entry.category_id}: must be the id of a category ({span})"
                raise ValueError(f"annotations[{index}]: {known}")
            # pycocotools ignores them, too.
            if entry.image_id not in listed:
                selection.leave_out("of pictures that are not in images")
                continue
            written = document.annotations[index]
            annotation = {key: value for key, value in written.items() if key not in _READ}
            number = written.get("id")
            if type(number) is int and 0 < number < LARGEST_ID:  # for COCO's tools 0 is none
                if number in used:
                    repeated += 1
                else:
                    annotation["id"] = number
                    used.add(number)
            if "iscrowd" in annotation:
                annotation["iscrowd"] = int(entry.iscrowd)
            ignored += entry.ignore
            x, y, width, height = entry.bbox
            file_name, size_px, targets = listed[entry.image_id]
            targets += selection.target(
                names[entry.category_id],
                (x, y, x + width, y + height),
                size_px,
                picture=file_name,
                area_px2=entry.area,
                crowd=entry.iscrowd,
                annotation=annotation,
            )
        entries = [
            Listed(file_name, tuple(targets), number, size_px)
            for number, (file_name, size_px, targets) in listed.items()
        ]
        selection.note("annotations whose id occurs before, each used as a target of its own", repeated)
        selection.note('annotations with "ignore", used as any other, as COCO\'s tools do', ignored)
        selection.notes += shared_names(names.values())
        return selection.picture_set(entries, {name: number for number, name in names.items()})
