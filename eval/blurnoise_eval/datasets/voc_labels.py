"""Pascal VOC's annotations: an XML file for each picture.

LabelImg, CVAT, Roboflow, FiftyOne and others write them. The VOC challenge counts pixels from 1 and includes the last
one, so its box begins at xmin - 1; LabelImg, CVAT and FiftyOne write corners as they are. A file does not say which.
"""

from __future__ import annotations

import posixpath
from collections import defaultdict
from collections.abc import Sequence
from pathlib import PurePosixPath
from xml.etree.ElementTree import Element

from pydantic import BaseModel

from blurnoise._core.fields import Characters
from blurnoise_eval.datasets.folder import Listed, is_litter
from blurnoise_eval.datasets.images import SUFFIXES
from blurnoise_eval.datasets.label_reading import Flag, checked, faults_of, read_text, xml_of
from blurnoise_eval.datasets.records import DOUBTFUL_LABELS, PictureSet, Target
from blurnoise_eval.datasets.selection import Selection
from blurnoise_eval.system.files import check_regular
from blurnoise_eval.system.urls import Location, for_each, listing, local_file

_FROM_ONE = (
    "The VOC",
    "PASCAL VOC",
    "roboflow.ai",
)  # databases whose files count from 1; the last is supervision's
_PICTURES = ("JPEGImages", "images", "data")  # folders beside Annotations


class _VocBox(BaseModel):
    xmin: float
    ymin: float
    xmax: float
    ymax: float


class _VocObject(BaseModel):
    name: Characters
    bndbox: _VocBox | None = None
    difficult: Flag = False


class _VocSize(BaseModel):
    width: float = 0
    height: float = 0


class _VocFile(BaseModel):
    filename: str = ""
    database: str = ""
    size: _VocSize = _VocSize()
    objects: list[_VocObject]

    @property
    def size_px(self) -> tuple[float, float] | None:
        """Of the picture."""
        return (self.size.width, self.size.height) if self.size.width and self.size.height else None


def voc(
    path: str | Location,
    *,
    images: str | Location | None = None,
    labels: Sequence[str] = (),
    keep_empty: bool = False,
) -> PictureSet:
    """The pictures of XML files in Pascal VOC's format; difficult objects are crowds, neither missed nor wrong.

    path: a folder, with its XML files in it and below, or one file. Its picture has the name of the XML file, or the
    one that stands in it, beside it or in JPEGImages, images or data beside Annotations; images: the pictures' folder
    in place of these. Boxes are corners in px; files of the VOC challenge count from 1. labels, ``keep_empty``,
    notes, sizes and errors as of :func:`blurnoise_eval.datasets.coco`; categories are numbered in alphabetical order.

    >>> from pathlib import Path
    >>> from blurnoise_eval import datasets
    >>> box = "<xmin>10</xmin><ymin>20</ymin><xmax>40</xmax><ymax>60</ymax>"
    >>> xml = f"<annotation><object><name>car</name><bndbox>{box}</bndbox></object></annotation>"
    >>> _ = Path("a.xml").write_text(xml)
    >>> datasets.voc("a.xml").pictures[0].targets[0].box_xyxy
    (10.0, 20.0, 40.0, 60.0)
    """
    selection = Selection("voc", path, images, labels, keep_empty)
    with faults_of("labels", selection.file):
        whole = selection.file.is_dir()
        root = selection.file if whole else selection.file.parent
        files_below = listing(root)
        xmls = [name for name in sorted(files_below) if name.lower().endswith(".xml")]
        labels_only = [name for name in xmls if not is_litter(name)]
        files = labels_only if whole else [selection.file.name]
        if not files:
            raise ValueError("contains no XML files")
        selection.folder = selection.folder if images else root
        read = for_each({name: root / name for name in files}, _annotation)
        if lost := [name for name in files if name not in read]:
            raise ValueError(f"{lost[0]}: No such file")
        pictures = _Pictures(list(listing(selection.folder)) if images else list(files_below))
        picture_of = {name: pictures.of(name, read[name].filename) for name in files}
        selection.look_at([picture_of[name] for name in files if read[name].size_px is None])
        entries = []
        from_one: list[bool] = []
        difficult = 0
        for name in files:
            annotation = read[name]
            size_px = annotation.size_px
            one = annotation.database.startswith(_FROM_ONE)  # its boxes begin a pixel further left and up
            targets: list[Target] = []
            for entry in annotation.objects:
                if (box := entry.bndbox) is None:
                    selection.leave_out("without bndbox", entry.name)
                    continue
                corners = (box.xmin - one, box.ymin - one, box.xmax, box.ymax)
                from_one += [min(box.xmin, box.ymin) >= 1] * (not one)
                difficult += entry.difficult
                targets += selection.target(
                    entry.name,
                    corners,
                    size_px,
                    picture=picture_of[name],
                    crowd=entry.difficult,
                    annotation={"difficult": int(entry.difficult)},
                )
            entries.append(Listed(picture_of[name], tuple(targets), size_px=size_px))
        pictures.note(selection, len(files))
        litter = len(xmls) - len(labels_only) if whole else 0
        selection.note("files of macOS (._NAME), which are no labels, left out", litter)
        selection.note("difficult objects, which are neither missed nor wrong", difficult)
        selection.notes += _counted_from(list(read.values()), from_one)
        return selection.picture_set(entries)


def _counted_from(read: Sequence[_VocFile], from_one: Sequence[bool]) -> list[str]:
    """What was assumed of the first pixel, and a doubt where boxes touch 1 and none 0."""
    challenge = sum(entry.database.startswith(_FROM_ONE) for entry in read)
    notes = [f"files of the VOC challenge, whose pixels count from 1: {challenge}"] if challenge else []
    touching = sum(
        1.0 in (entry.bndbox.xmin, entry.bndbox.ymin)
        for file in read
        if not file.database.startswith(_FROM_ONE)
        for entry in file.objects
        if entry.bndbox
    )
    if touching and all(from_one):
        notes.append(
            f"{DOUBTFUL_LABELS}{touching} of {len(from_one)} boxes begin at 1 px and none at 0: do pixels count from "
            "1, as in the VOC challenge? They are read as counted from 0, which may be 1 px off"
        )
    return notes


def _annotation(file: Location) -> _VocFile:
    check_regular(local_file(file))
    with faults_of("label file", file):
        root = xml_of(read_text(file))
        if root.tag == "annotations":
            raise ValueError(
                "is CVAT's own XML, which is not read; export the task as COCO 1.0 or PASCAL VOC 1.1"
            )
        if root.tag != "annotation":
            raise ValueError(
                f"begins with <{root.tag[:40]}>; must begin with <annotation>, as Pascal VOC does"
            )
        objects = [
            {**_texts(entry), "bndbox": None if (box := entry.find("bndbox")) is None else _texts(box)}
            for entry in root.iterfind("object")
        ]
        fields = {
            "filename": root.findtext("filename") or "", "database": root.findtext("source/database") or "",
            "size": _texts(root.find("size")), "objects": objects,
        }  # fmt: skip
        return checked(_VocFile, fields)


def _texts(parent: Element | None) -> dict[str, str]:
    """Texts of the children that have one."""
    texts = {child.tag: (child.text or "").strip() for child in parent} if parent is not None else {}
    return {name: text for name, text in texts.items() if text}


class _Pictures:
    """The pictures below a folder, by which each XML file finds its own."""

    def __init__(self, names: Sequence[str]) -> None:
        self._names = {name for name in names if name.lower().endswith(SUFFIXES) and not is_litter(name)}
        self._used: set[str] = set()
        self._other = 0
        self._by_stem, self._by_name = defaultdict[str, list[str]](list), defaultdict[str, list[str]](list)
        for name in sorted(self._names):
            self._by_stem[_stem(name)].append(name)
            self._by_name[PurePosixPath(name).name].append(name)

    def of(self, xml: str, filename: str) -> str:
        """The picture with the XML file's name, else the one that stands in it; near it, or the only one below."""
        stated_name = posixpath.basename(filename.replace("\\", "/"))
        same_stem = self._nearest(self._by_stem[_stem(xml)], xml)
        named = (
            self._nearest(self._by_name[stated_name] or self._by_stem[_stem(stated_name)], xml)
            if stated_name
            else None
        )
        self._other += bool(same_stem and stated_name and PurePosixPath(same_stem).name != stated_name)
        picture = (
            same_stem or named or posixpath.join(posixpath.dirname(xml), stated_name or f"{_stem(xml)}.jpg")
        )
        self._used.add(picture)
        return picture

    def _nearest(self, among: Sequence[str], xml: str) -> str | None:
        folder = posixpath.dirname(xml)
        parts = folder.split("/") if folder else []
        near = [folder]
        if "Annotations" in parts:
            at = len(parts) - 1 - parts[::-1].index("Annotations")
            near += ["/".join((*parts[:at], name, *parts[at + 1 :])) for name in _PICTURES]
        nearest = [name for name in among if posixpath.dirname(name) in near] or list(among)
        return nearest[0] if len(nearest) == 1 else None

    def note(self, selection: Selection, n_files: int) -> None:
        """Note pictures whose XML names another one, and pictures without XML in a folder of some with it."""
        folders = {posixpath.dirname(name) for name in self._used}
        without = sum(posixpath.dirname(name) in folders for name in self._names - self._used)
        text = "XML files that name another picture than the one with their own name, which is used"
        selection.note(text, self._other)
        selection.note("pictures without an XML file, left out", without if n_files > 1 else 0)


def _stem(name: str) -> str:
    return PurePosixPath(name).stem
