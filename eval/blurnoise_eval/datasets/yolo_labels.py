"""YOLO's text labels: a data.yaml or a folder, and for each picture a text file with a line per object."""

from __future__ import annotations

import math
import os
import posixpath
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated

import numpy as np
from annotated_types import Ge, MinLen
from pydantic import BaseModel, BeforeValidator, ConfigDict, Strict

from blurnoise._core.checks import Characters, shown
from blurnoise._core.files import yaml_of
from blurnoise_eval.datasets.folder import Listed, pictures_below
from blurnoise_eval.datasets.images import sizes_px
from blurnoise_eval.datasets.label_files import (
    LARGEST_SET_BYTES,
    Selection,
    checked,
    each_line,
    faults_of,
    read_text,
)
from blurnoise_eval.datasets.records import PictureSet, Target
from blurnoise_eval.system.files import check_regular, inside
from blurnoise_eval.system.urls import Location, explained, for_each, local_file

_SPLITS = ("val", "train")  # what is taken where nobody chooses
_FARTHEST = 2.0  # sides of the picture; a number beyond was not meant as a share of them

Object = tuple[str, tuple[float, float, float, float]]
"""A class, and a box as shares (x0, y0, x1, y1) of the picture's sides."""


def _by_number(names: object) -> object:
    names = dict(enumerate(names)) if isinstance(names, list) else names
    if not isinstance(names, dict):
        return names
    return {number: str(name) if type(name) is int else name for number, name in names.items()}


class _DataYaml(BaseModel):
    """The classes and folder of a data set; each split, in ``model_extra``, names folders or lists of pictures."""

    model_config = ConfigDict(extra="allow")
    names: Annotated[
        dict[Annotated[int, Strict(), Ge(0)], Annotated[Characters, Strict()]],
        BeforeValidator(_by_number),
        MinLen(1),
    ]
    path: str = ""


def yolo(
    path: str | Location,
    *,
    images: str | Location | None = None,
    labels: Sequence[str] = (),
    split: str | None = None,
    keep_empty: bool = False,
) -> PictureSet:
    """The pictures of a YOLO data set as Ultralytics lays it out; polygons count as the boxes around them.

    path: a data.yaml (its ``split``, by default val, else train), or a folder with a data.yaml or classes.txt,
    and with images/ or pictures. images: the pictures' folder in place of these. The objects of images/a.jpg
    are in labels/a.txt, else in a.txt beside it; a picture without such a file has none. labels,
    ``keep_empty``, notes and errors as of :func:`blurnoise_eval.datasets.coco`; an error in a
    line names it. Source: https://docs.ultralytics.com/datasets/detect.
    """
    selection = Selection("yolo", path, images, labels, keep_empty)
    with faults_of("labels", selection.file):
        root, described = _described(selection.file)
        sources = [selection.folder] if images else _sources(root, described, split)
        selection.folder, names = _pictures(sources)
        parents = {name: (selection.folder / name).parent for name in names}
        folders = {parent: _label_folder(parent) for parent in {*parents.values()}}
        files = {name: folders[parent] / f"{Path(name).stem}.txt" for name, parent in parents.items()}
        objects = for_each(files, partial(_objects, classes=described.names))
        if not objects:
            raise ValueError(
                f"none of the {len(names)} pictures in {str(selection.folder)!r} has a label file"
            )
        sizes = sizes_px(selection.folder, [name for name in names if objects.get(name)])
        entries = []
        for name in names:
            targets: list[Target] = []
            for label, box in objects.get(name, ()) if name in sizes else ():
                corners = np.multiply(box, sizes[name] * 2)
                targets += selection.target(label, tuple(corners.tolist()), sizes[name])
            entries.append(Listed(name, tuple(targets)))
        categories = {name: class_id + 1 for class_id, name in described.names.items()}
        unlabelled = len(names) - len(objects)
        note = f"pictures without a label file, used as pictures without objects: {unlabelled}"
        return selection.picture_set(entries, categories, [note] if unlabelled else [])


def _described(path: Location) -> tuple[Location, _DataYaml]:
    """The folder of the data set, and its data.yaml or, if there is none, its classes.txt."""
    if path.is_dir() and not (path / "data.yaml").is_file():
        for file in (path / "classes.txt", path / "labels" / "classes.txt"):
            if file.is_file():
                return path, checked(_DataYaml, {"names": list(each_line(read_text(file), str.strip))})
        raise ValueError("must contain data.yaml or classes.txt, with the names of the classes")
    file = path / "data.yaml" if path.is_dir() else path
    described = checked(_DataYaml, yaml_of(read_text(file)))
    if "kpt_shape" in (described.model_extra or {}):
        raise ValueError("contains poses (kpt_shape); must contain boxes or polygons")
    return file.parent, described


def _sources(root: Location, described: _DataYaml, split: str | None) -> list[Location]:
    """Folders of pictures, and lists of them (.txt)."""
    stated = described.model_extra or {}
    split = split or next((key for key in _SPLITS if stated.get(key)), None)
    if split is None:
        return [root / "images" if (root / "images").is_dir() else root]
    found = stated.get(split)
    entries = found if isinstance(found, list) else [found]
    if not entries or not all(isinstance(entry, str) for entry in entries):
        raise ValueError(f"split {split!r} = {shown(found)}: must be folders or lists of pictures (.txt)")
    return [_existing(root, described.path, str(entry)) for entry in entries]


def _existing(root: Location, folder: str, entry: str) -> Location:
    """The folder or list in the data set's folder; Roboflow's exports write '../' where they mean './'."""
    fault = f"{entry!r} leaves the folder {str(root)!r}; set images to the folder of the pictures"
    for name in (entry, entry.removeprefix("../")):
        below = os.path.relpath(posixpath.join(str(root), folder, name), str(root))
        if below.partition("/")[0] != "..":
            place: Location = root if below == "." else root / below
            with explained(place):
                if place.exists():
                    return place
            fault = f"{str(place)!r}: no such folder or list of pictures"
    raise ValueError(fault)


def _pictures(sources: Iterable[Location]) -> tuple[Location, list[str]]:
    """The folder that holds all sources, and the names of their pictures in it."""
    listed = []
    for source in sources:
        if source.suffix == ".txt" and source.is_file():
            with faults_of("list", source):
                lines = each_line(read_text(source, LARGEST_SET_BYTES), lambda line: inside(line.strip()))
                listed.append((source.parent, list(lines)))
        else:
            listed.append((source, list(pictures_below(source)[0])))
    folder = listed[0][0]
    while any(source.parts[: len(folder.parts)] != folder.parts for source, _ in listed):
        folder = folder.parent
    below = len(folder.parts)
    names = ["/".join((*source.parts[below:], name)) for source, each_name in listed for name in each_name]
    return folder, names


def _label_folder(folder: Location) -> Location:
    """Where the labels of a folder of pictures are: its labels/ for the last images/, else the folder."""
    for above in (folder, *folder.parents):
        if above.name == "images":
            beside: Location = above.parent.joinpath("labels", *folder.parts[len(above.parts) :])
            return beside if beside.is_dir() else folder
    return folder


def _objects(file: Location, classes: Mapping[int, str]) -> list[Object]:
    check_regular(local_file(file))  # a missing file is no error
    with faults_of("label file", file):
        return list(each_line(read_text(file), partial(_object, classes=classes)))


def _object(line: str, *, classes: Mapping[int, str]) -> Object:
    fields = line.split()
    try:
        class_id, *shares = (float(field) for field in fields)
    except ValueError:
        raise ValueError(f"{shown(line)}: must be numbers") from None
    if class_id not in classes:
        raise ValueError(f"class = {fields[0]}: must be one of the {len(classes)} classes")
    if any(_FARTHEST < abs(share) < math.inf for share in shares):
        raise ValueError(f"{shown(line)}: must be fractions of the picture's size, 0 to 1, not pixels")
    if len(shares) == 4:
        x, y, width, height = shares
        return classes[int(class_id)], (x - width / 2, y - height / 2, x + width / 2, y + height / 2)
    if len(shares) < 6 or len(shares) % 2:
        raise ValueError(f"{shown(line)}: must be 'class x y width height' or 'class x1 y1 x2 y2 x3 y3 ...'")
    xs, ys = np.array(shares[::2]), np.array(shares[1::2])
    return classes[int(class_id)], (xs.min(), ys.min(), xs.max(), ys.max())
