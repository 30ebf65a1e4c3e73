"""YOLO's text labels: a data.yaml, obj.data or a folder, and for each picture a text file with a line per object."""

from __future__ import annotations

import math
import os
import posixpath
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path, PurePosixPath
from typing import Annotated, NamedTuple

import numpy as np
from annotated_types import Ge, MinLen
from numpy.typing import NDArray
from pydantic import BaseModel, BeforeValidator, ConfigDict, Strict

from blurnoise._core.checks import shown
from blurnoise._core.fields import Characters
from blurnoise._core.files import yaml_of
from blurnoise_eval.datasets.folder import Listed, is_litter, pictures_below
from blurnoise_eval.datasets.images import sizes_px
from blurnoise_eval.datasets.label_doubts import shared_names
from blurnoise_eval.datasets.label_reading import (
    LARGEST_SET_BYTES,
    checked,
    each_line,
    faults_of,
    read_text,
)
from blurnoise_eval.datasets.places import Places, ends
from blurnoise_eval.datasets.records import DOUBTFUL_LABELS, PictureSet, Target
from blurnoise_eval.datasets.selection import Selection
from blurnoise_eval.system.files import check_regular
from blurnoise_eval.system.urls import Location, explained, for_each, listing, local_file

_SPLITS = ("val", "valid", "train")  # what is taken where nobody chooses
_YAMLS = ("data.yaml", "dataset.yaml", "data.yml", "dataset.yml")
_NAMES = ("classes.txt", "labels/classes.txt", "obj.names", "_darknet.labels", "train/_darknet.labels")
_FEWEST_ROWS = 3  # all of which begin like boxes by no chance
_ROUNDING = 0.01  # of shares
_FARTHEST = 2.0  # sides of the picture; a number beyond was not meant as a share of them

Object = tuple[str, tuple[float, float, float, float]]
"""A class, and a box as shares (x0, y0, x1, y1) of the picture's sides."""


class _LabelFile(NamedTuple):
    """Of a label file, without ``repeated`` rows, which occur before."""

    objects: list[Object]
    repeated: int
    rows: list[NDArray[np.float64]]


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

    path: a data.yaml (its ``split``, by default val, else train), Darknet's obj.data, a list of pictures (.txt) near
    the names of the classes, or a folder with one of these, or with classes.txt, and with images/ or pictures.
    images: the pictures' folder in place of these. The objects of images/a.jpg are in labels/a.txt, else in a.txt
    beside it, else in the only a.txt of the data set; a picture without such a file has none. A row that occurs
    before is left out with a note, as Ultralytics does. labels, ``keep_empty``, notes and errors as of
    :func:`blurnoise_eval.datasets.coco`; an error in a line names it. Source:
    https://docs.ultralytics.com/datasets/detect.

    >>> from pathlib import Path
    >>> import numpy as np
    >>> from blurnoise_eval import datasets
    >>> for folder in ("signs/images", "signs/labels"):
    ...     Path(folder).mkdir(parents=True)
    >>> datasets.write_picture("signs/images/a.png", np.zeros((100, 200, 3), np.uint8))
    >>> _ = Path("signs/labels/a.txt").write_text("0 0.5 0.5 0.1 0.2")
    >>> _ = Path("signs/data.yaml").write_text("names: [stop sign]")
    >>> target = datasets.yolo("signs").pictures[0].targets[0]
    >>> target.label, [round(edge) for edge in target.box_xyxy]
    ('stop sign', [90, 40, 110, 60])
    """
    selection = Selection("yolo", path, images, labels, keep_empty, "centre x, y, width, height")
    with faults_of("labels", selection.file):
        root, described = _described(selection.file)
        sources = [selection.folder] if images else _sources(root, described, split, selection)
        selection.folder, names = _pictures(sources, selection)
        read = partial(_objects, classes=described.names)
        objects = for_each(_beside(selection.folder, names), read)
        objects = objects or for_each(_by_stem(root, names) if images else {}, read)
        if not objects:
            raise ValueError(
                f"none of the {len(names)} pictures in {str(selection.folder)!r} has a label file"
            )
        sizes = sizes_px(
            selection.folder, [name for name in names if name in objects and objects[name].objects]
        )
        entries = []
        for name in names:
            targets: list[Target] = []
            for label, box in objects[name].objects if name in sizes else ():
                corners = np.multiply(box, sizes[name] * 2)
                targets += selection.target(label, tuple(corners.tolist()), sizes[name])
            entries.append(Listed(name, tuple(targets)))
        categories = {name: class_id + 1 for class_id, name in described.names.items()}
        rows = [row for of_picture in objects.values() for row in of_picture.rows]
        repeated, unlabelled = sum(file.repeated for file in objects.values()), len(names) - len(objects)
        selection.note("rows that occur before in their file, left out as Ultralytics does", repeated)
        selection.note("pictures without a label file, used as pictures without objects", unlabelled)
        selection.notes += shared_names(described.names.values())
        if doubt := _box_doubt(rows):
            selection.notes.append(f"{DOUBTFUL_LABELS}{doubt}")
        return selection.picture_set(entries, categories, unlabelled)


def _described(path: Location) -> tuple[Location, _DataYaml]:
    """The folder of the data set, and its classes and splits."""
    if path.is_dir():
        files = [path / name for name in (*_YAMLS, "obj.data", *_NAMES) if (path / name).is_file()]
        if not files:
            raise ValueError("must contain data.yaml, obj.data or classes.txt, with the names of the classes")
        path, root = files[0], path
    else:
        root = path.parent
    if path.suffix.lower() == ".data":
        return root, _darknet(root, path)
    if path.name in {PurePosixPath(name).name for name in _NAMES}:
        return root, _named(path)
    if path.suffix.lower() == ".txt":
        known = [root / name for name in (*_YAMLS, *_NAMES) if (root / name).is_file()]
        if not known:
            raise ValueError("is a list of pictures; data.yaml, obj.names or classes.txt must be beside it")
        return root, _DataYaml.model_validate({"names": _described(known[0])[1].names, "val": path.name})
    described = checked(_DataYaml, yaml_of(read_text(path)))
    if "kpt_shape" in (described.model_extra or {}):
        raise ValueError("contains poses (kpt_shape); must contain boxes or polygons")
    return root, described


def _named(file: Location) -> _DataYaml:
    names = [line.strip() for line in read_text(file).rstrip().split("\n")]
    if "" in names:  # left out, it would shift the classes after it
        raise ValueError(f"{file.name}, line {names.index('') + 1}: is empty; each line must name a class")
    return checked(_DataYaml, {"names": names})


def _darknet(root: Location, file: Location) -> _DataYaml:
    """Darknet's obj.data: NAME = VALUE, with the lists of pictures and the file with the names of the classes."""
    lines = (line.partition("=") for line in read_text(file).split("\n"))
    entries = {name.strip(): value.strip() for name, sign, value in lines if sign}
    if "names" not in entries:
        raise ValueError("has no 'names = obj.names'")
    names = _named(_existing(root, "", entries["names"])[0]).names
    lists = {key: value for key, value in entries.items() if value.endswith(".txt")}
    return _DataYaml.model_validate({"names": names, **lists})


def _sources(root: Location, described: _DataYaml, split: str | None, selection: Selection) -> list[Location]:
    """Folders of pictures, and lists of them (.txt)."""
    splits = described.model_extra or {}
    if split is None:
        split = next((key for key in _SPLITS if splits.get(key)), None) or next(
            (key for key, value in splits.items() if isinstance(value, str) and value.endswith(".txt")), None
        )
    if split is None:
        return [root / "images" if (root / "images").is_dir() else root]
    value = splits.get(split)
    entries = value if isinstance(value, list) else [value]
    if not entries or not all(isinstance(entry, str) for entry in entries):
        raise ValueError(f"split {split!r} = {shown(value)}: must be folders or lists of pictures (.txt)")
    resolved = [_existing(root, described.path, str(entry)) for entry in entries]
    selection.notes += [note for _, note in resolved if note]
    return [source for source, _ in resolved]


def _existing(root: Location, folder: str, entry: str) -> tuple[Location, str]:
    """The folder or list in the data set's folder, as it is named or by the end of its path, and a note in that case.

    Roboflow writes '../train/images' and, once downloaded, 'project/train/images', CVAT 'data/train.txt'.
    """
    entry = entry.replace("\\", "/")
    whole = posixpath.normpath(posixpath.join(str(root), folder, entry))
    below = os.path.relpath(whole, str(root))
    leaves = below.partition("/")[0] == ".."
    paths = ends(posixpath.normpath(posixpath.join(folder, entry)))
    for name in [below] * (not leaves) + paths:
        candidate: Location = root if name == "." else root / name
        with explained(candidate):
            if candidate.exists():
                return candidate, "" if name == below else f"{entry!r} is read as {name!r}"
    if leaves:
        raise ValueError(
            f"{entry!r} leaves the folder {str(root)!r}; set images to the folder of the pictures"
        )
    raise ValueError(f"{str(root / below)!r}: no such folder or list of pictures")


def _pictures(sources: Iterable[Location], selection: Selection) -> tuple[Location, list[str]]:
    """The folder that holds all sources, and the names of their pictures in it."""
    listed = []
    for source in sources:
        if source.suffix == ".txt" and source.is_file():
            with faults_of("list", source):
                names, notes = _of_a_list(read_text(source, LARGEST_SET_BYTES), source.parent)
        else:
            versions, notes = pictures_below(source)
            names = list(versions)
        listed.append((source.parent if source.suffix == ".txt" else source, names))
        selection.notes += notes
    folder = listed[0][0]
    while any(source.parts[: len(folder.parts)] != folder.parts for source, _ in listed):
        folder = folder.parent
    below = len(folder.parts)
    names = ["/".join((*source.parts[below:], name)) for source, of_source in listed for name in of_source]
    return folder, names


def _of_a_list(content: str, folder: Location) -> tuple[list[str], list[str]]:
    """Names in the list's folder, by the ends of their paths where they are not there, as CVAT's data/obj_train_data;
    and notes. A fault names the line."""
    files, resolver = frozenset(listing(folder)), Places(folder)

    def name(line: str) -> str:
        path = line.strip().replace("\\", "/").removeprefix("./")
        matches = [] if path in files else [end for end in ends(path) if end in files]
        return (
            matches[0]
            if len(matches) == 1 and not path.startswith(("/", "../"))
            else resolver.name(line.strip())
        )

    return list(each_line(content, name)), resolver.notes


def _beside(folder: Location, names: Sequence[str]) -> dict[str, Location]:
    """Label files by picture, beside it or in labels/, as Ultralytics looks for them."""
    parents = {name: (folder / name).parent for name in names}
    folders = {parent: _label_folder(parent) for parent in {*parents.values()}}
    return {name: folders[parent] / f"{Path(name).stem}.txt" for name, parent in parents.items()}


def _by_stem(root: Location, names: Sequence[str]) -> dict[str, Location]:
    """The only label files of the pictures' names in the data set; the pictures are elsewhere."""
    by_stem = defaultdict[str, list[str]](list)
    for name in listing(root):
        if name.endswith(".txt") and not is_litter(name):
            by_stem[PurePosixPath(name).stem].append(name)
    stems = {name: by_stem[Path(name).stem] for name in names}
    return {name: root / files[0] for name, files in stems.items() if len(files) == 1}


def _label_folder(folder: Location) -> Location:
    """Where the labels of a folder of pictures are: its labels/ for the last images/, else the folder."""
    for above in (folder, *folder.parents):
        if above.name == "images":
            labels: Location = above.parent.joinpath("labels", *folder.parts[len(above.parts) :])
            return labels if labels.is_dir() else folder
    return folder


def _objects(file: Location, classes: Mapping[int, str]) -> _LabelFile:
    check_regular(local_file(file))  # a missing file is no error
    with faults_of("label file", file):
        rows = list(each_line(read_text(file), partial(_row, classes=classes)))
    unique: dict[bytes, NDArray[np.float64]] = {}
    for row in rows:
        unique.setdefault(row.astype(np.float32).tobytes(), row)  # as Ultralytics tells them apart
    return _LabelFile([_object(row, classes) for row in unique.values()], len(rows) - len(unique), rows)


def _row(line: str, *, classes: Mapping[int, str]) -> NDArray[np.float64]:
    """The class and the shares of a line."""
    fields = line.split()
    try:
        class_id, *shares = (float(field) for field in fields)
    except ValueError:
        raise ValueError(f"{shown(line)}: must be numbers") from None
    if class_id not in classes:
        ids = f"one of the {len(classes)} classes, {min(classes)} to {max(classes)}"
        raise ValueError(f"class = {fields[0]}: must be {ids}; the first is 0")
    if any(_FARTHEST < abs(share) < math.inf for share in shares):
        raise ValueError(f"{shown(line)}: must be fractions of the picture's size, 0 to 1, not pixels")
    if len(shares) != 4 and (len(shares) < 6 or len(shares) % 2):
        score = "; a sixth number is a score, so these may be detections" if len(shares) == 5 else ""
        raise ValueError(
            f"{shown(line)}: must be 'class x y width height' or 'class x1 y1 x2 y2 x3 y3 ...'{score}"
        )
    return np.array([class_id, *shares])


def _box_doubt(rows: Sequence[NDArray[np.float64]]) -> str:
    """That polygons may be boxes with more behind them, or "": the corners of polygons do not all fit as boxes, and
    their count varies."""
    lengths = {len(row) for row in rows}
    if len(rows) < _FEWEST_ROWS or len(lengths) > 1 or lengths <= {5, 9}:  # of boxes and of rotated ones
        return ""
    middle, half = np.array(rows)[:, 1:3], np.array(rows)[:, 3:5] / 2
    if not ((half > 0) & (middle - half > -_ROUNDING) & (middle + half < 1 + _ROUNDING)).all():
        return ""
    count = (lengths.pop() - 1) // 2
    many = f"all {len(rows)} rows are polygons of {count} corners, and each begins like a box"
    return f"{many}: poses, or tracks with scores? They are read as polygons"


def _object(row: NDArray[np.float64], classes: Mapping[int, str]) -> Object:
    label, shares = classes[int(row[0])], row[1:]
    if len(shares) == 4:
        x, y, width, height = shares.tolist()
        return label, (x - width / 2, y - height / 2, x + width / 2, y + height / 2)
    (x0, y0), (x1, y1) = (
        shares.reshape(-1, 2).min(axis=0).tolist(),
        shares.reshape(-1, 2).max(axis=0).tolist(),
    )
    return label, (x0, y0, x1, y1)
