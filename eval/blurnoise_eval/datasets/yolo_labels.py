"""YOLO's text labels: a data.yaml or a folder, and for each picture a text file with a line per object."""

from __future__ import annotations

import math
import os
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated

import numpy as np
from annotated_types import Ge, MinLen
from pydantic import BaseModel, BeforeValidator, ConfigDict, Strict

from blurnoise._core.checks import Characters, shown
from blurnoise._core.files import yaml_of
from blurnoise_eval.datasets.folder import pictures_below
from blurnoise_eval.datasets.images import MAX_MEGAPIXELS, size_px
from blurnoise_eval.datasets.labels import (
    LARGEST_SET_BYTES,
    Selection,
    checked,
    each_line,
    faults_of,
    read_text,
)
from blurnoise_eval.datasets.records import PictureSet, Target, UnreadablePicture
from blurnoise_eval.system.files import inside
from blurnoise_eval.system.urls import Location, explained, fetch_ahead, location, versions

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
        "must be names, as a list or by their numbers",
    ]
    path: str | None = None


def yolo(
    path: Location,
    *,
    images: Location | None = None,
    labels: Sequence[str] = (),
    split: str | None = None,
    keep_empty: bool = False,
    max_megapixels: float = MAX_MEGAPIXELS,
) -> PictureSet:
    """The pictures of a YOLO data set as Ultralytics lays it out; polygons count as the boxes around them.

    path: a data.yaml (its ``split``, by default val, else train), or a folder with a data.yaml or classes.txt,
    and with images/ or pictures. images: the pictures' folder in place of these. The objects of images/a.jpg
    are in labels/a.txt, else in a.txt beside it; a picture without such a file has none. labels,
    ``keep_empty``, ``max_megapixels``, notes and errors as of :func:`blurnoise_eval.datasets.coco`; an error in a
    line names it. Source: https://docs.ultralytics.com/datasets/detect.
    """
    selection = Selection(labels, keep_empty)
    with faults_of("yolo", path):
        root, described = _described(path)
        folder, names = _pictures([images] if images else _sources(root, described, split))
        objects = _objects(folder, names, described.names)
        if not objects:
            raise ValueError(f"no label file for any of {len(names)} pictures in {str(folder)!r}")
        known = versions(folder, [name for name in names if objects.get(name)])
        fetch_ahead(folder, known)  # their sizes are wanted
        entries = (
            (name, _targets(folder / name, objects.get(name, ()), known.get(name), selection), None, None)
            for name in names
        )
        categories = {name: class_id + 1 for class_id, name in described.names.items()}
        notes = []
        if unlabelled := len(names) - len(objects):
            notes = [f"without a label file, and so without an object: {unlabelled} of the pictures"]
        return selection.picture_set("yolo", path, entries, categories, folder, max_megapixels, notes)


def _described(path: Location) -> tuple[Location, _DataYaml]:
    """The set's folder, and what its data.yaml or, without one, its classes.txt says."""
    if path.is_dir() and not (path / "data.yaml").is_file():
        for file in (path / "classes.txt", path / "labels" / "classes.txt"):
            if file.is_file():
                lines = read_text(file).split("\n")
                names = [line.strip() for line in lines if line.strip()]
                return path, checked(_DataYaml, {"names": names})
        raise ValueError("holds neither data.yaml nor classes.txt, which name the classes")
    file = path / "data.yaml" if path.is_dir() else path
    described = checked(_DataYaml, yaml_of(read_text(file)))
    if "kpt_shape" in (described.model_extra or {}):
        raise ValueError("describes poses (kpt_shape), whose lines would pass for polygons")
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
        raise ValueError(f"split {split!r} = {shown(found)}: must name folders or lists (.txt)")
    return [_existing(root, root / (described.path or ""), str(entry)) for entry in entries]


def _existing(root: Location, folder: Location, entry: str) -> Location:
    """The folder or list in the data set's folder; Roboflow's exports write '../' where they mean './'."""
    named = (folder / entry, folder / entry.removeprefix("../"))
    own = [found for place in named if (found := _below(root, place)) is not None]
    if not own:
        must = "name that of the pictures (--images)"
        raise ValueError(f"{str(named[0])!r} leaves the folder {str(root)!r}; {must}")
    for found in own:
        with explained(found):
            if found.exists():
                return found
    raise ValueError(f"{str(own[0])!r}: no such folder or list of pictures")


def _below(root: Location, place: Location) -> Location | None:
    """The place without detours; None outside of ``root``."""
    if not isinstance(place, Path):
        place = location(str(place))
        return place if place.parts[: len(root.parts)] == root.parts else None
    below = Path(os.path.relpath(str(place), str(root)))
    return None if below.parts[:1] == (os.pardir,) else root / below


def _pictures(sources: Iterable[Location]) -> tuple[Location, list[str]]:
    """The folder that holds all sources, and the names of their pictures in it."""
    listed = []
    for source in sources:
        if source.suffix == ".txt" and source.is_file():
            with faults_of("list", source):
                lines = each_line(read_text(source, LARGEST_SET_BYTES), lambda line: inside(line.strip()))
                listed.append((source.parent, list(lines)))
        else:
            listed.append((source, list(pictures_below(source))))
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


def _objects(folder: Location, names: Sequence[str], classes: Mapping[int, str]) -> dict[str, list[Object]]:
    """The objects of each picture that has a label file."""
    together = defaultdict[str, dict[str, str]](dict)
    for name in names:
        parent, _, own = name.rpartition("/")
        together[parent][name] = f"{Path(own).stem}.txt"
    found: dict[str, list[Object]] = {}
    for parent, files in together.items():
        labels = _label_folder(folder / parent)
        known = versions(labels, set(files.values()))
        fetch_ahead(labels, known)
        for name, file in files.items():
            if file in known:
                with faults_of("labels", labels / file):
                    lines = read_text(labels / file, known=known[file])
                    found[name] = list(each_line(lines, partial(_object, classes=classes)))
    return found


def _targets(
    picture: Location, objects: Sequence[Object], known: str | None, selection: Selection
) -> tuple[Target, ...]:
    """The picture's objects, in pixels; none of one that cannot be read, which loading it says."""
    if not objects:
        return ()
    try:
        width, height = size_px(picture, known)
    except UnreadablePicture:
        return ()
    sides = np.array([width, height, width, height])
    found = [selection.target(name, tuple((sides * box).tolist()), (width, height)) for name, box in objects]
    return tuple(target for each in found for target in each)


def _object(line: str, *, classes: Mapping[int, str]) -> Object:
    fields = line.split()
    try:
        class_id, *shares = (float(field) for field in fields)
    except ValueError:
        raise ValueError(f"{shown(line)}: must be numbers") from None
    if class_id not in classes:
        raise ValueError(f"class {fields[0]}: not among the {len(classes)} names")
    if any(_FARTHEST < abs(share) < math.inf for share in shares):
        raise ValueError(f"{shown(line)}: must be shares of the picture's sides, 0 to 1, no pixels")
    if len(shares) == 4:
        x, y, width, height = shares
        return classes[int(class_id)], (x - width / 2, y - height / 2, x + width / 2, y + height / 2)
    if len(shares) < 6 or len(shares) % 2:
        raise ValueError(f"{shown(line)}: must be 'class x y width height' or 'class x1 y1 x2 y2 x3 y3 ...'")
    xs, ys = np.array(shares[::2]), np.array(shares[1::2])
    return classes[int(class_id)], (xs.min(), ys.min(), xs.max(), ys.max())
