"""Label files of a whole set: COCO's instances, BDD100K's and Scalabel's frames, PP-OCR's texts.

They come from anywhere and are read strictly: what is wrong is one line that names file, place and value.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Annotated, Any, TypeVar

import numpy as np
from annotated_types import Ge, Gt, Len, Lt
from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Strict, ValidationError

from blurnoise._core.checks import Characters, shown
from blurnoise._core.files import LARGEST_TEXT_BYTES, json_of, read_bytes, text_of
from blurnoise_eval.datasets.folder import Listed, from_files
from blurnoise_eval.datasets.images import sizes_px
from blurnoise_eval.datasets.records import PictureSet, Target, size_group
from blurnoise_eval.datasets.segmentation import LARGEST_PX
from blurnoise_eval.system.files import inside
from blurnoise_eval.system.urls import Location, local_file, location

T = TypeVar("T")
Form = TypeVar("Form", bound=BaseModel)
TEXT = "text"
LARGEST_SET_BYTES = 2 << 30
"""Of a file with the labels of a whole set: COCO's of 118 000 pictures has 448 MB, BDD100K's of 70 000 1.3 GB."""
_LARGEST_ID = 2**63  # COCO's tools hold ids in 64 bits
_READ = ("id", "image_id", "category_id", "bbox")  # of an annotation; the rest stays with the target
_UNREADABLE = ("###", "*")  # PP-OCR's marks of text that nobody could read
_HEIGHTS_PX = (("< 16", 16), ("16-32", 32), ("32-64", 64), ("> 64", math.inf))

Number = Annotated[float, Strict()]
"""A number, which may be NaN or infinite."""
Whole = Annotated[
    int,
    BeforeValidator(lambda value: int(value) if type(value) is float and value.is_integer() else value),
    Strict(),
    Gt(-_LARGEST_ID),
    Lt(_LARGEST_ID),
]
"""A whole number of at most 64 bits; 7.0 is one."""
FileName = Annotated[Characters, AfterValidator(inside)]
"""A name in the pictures' folder."""


@contextmanager
def faults_of(name: str, file: Location) -> Iterator[None]:
    """Turn errors inside into one ``ValueError`` that begins with "name = file"."""
    try:
        yield
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or " ".join(str(error).split())
        other = getattr(error, "filename", None) or str(file)
        named = "" if str(other) == str(file) else f"{other}: "
        raise ValueError(f"{name} = {str(file)!r}: {named}{why}") from None


def read_text(file: Location, largest: int = LARGEST_TEXT_BYTES) -> str:
    """The file as UTF-8, with or without a byte-order mark; line ends are ``\\n``. Raises ``OSError``, and
    ``ValueError``, also above ``largest`` bytes."""
    return text_of(read_bytes(local_file(file), largest))


def as_json(content: str, what: str) -> Any:
    """``content`` as JSON. Raises ``ValueError`` that it is not ``what``."""
    try:
        return json_of(content)
    except ValueError as error:
        raise ValueError(f"is not {what}: {error}") from None


def checked(form: type[Form], value: object, name: str = "") -> Form:
    """``value`` in that form. Raises ``ValueError`` of one line: ``name``, the place in it, and what stands there."""
    try:
        return form.model_validate(value)
    except ValidationError as error:
        fault = error.errors(include_url=False)[0]
    place, must = list(fault["loc"]), re.sub(r"^\w+ should", "must", fault["msg"])
    must = must.partition(" or instance")[0].replace(" after validation", "")
    if fault["type"] == "missing":
        must = f"has no {place.pop()!r}"
    for part in place:
        name += f"[{part}]" if isinstance(part, int) else f": {part}"
    found = f" = {shown(fault['input'])}" if must.startswith("must") else ""
    raise ValueError(f"{name}{found}: {must.removeprefix('Value error, ')}".lstrip(" :="))


def each(entries: object, name: str, form: type[Form]) -> Iterator[Form]:
    """Every object of a list in that form. Raises as :func:`checked` does."""
    if not isinstance(entries, list):
        raise ValueError(f"{name} = {shown(entries)}: must be a list")
    for place, entry in enumerate(entries):
        yield checked(form, entry, f"{name}[{place}]")


def each_line(content: str, read: Callable[[str], T]) -> Iterator[T]:
    """Apply ``read`` to every line that is not blank. A ``ValueError`` gets the number of the line."""
    for place, line in enumerate(content.split("\n"), start=1):
        if line.strip():
            try:
                found = read(line)
            except ValueError as error:
                raise ValueError(f"line {place}: {error}") from None
            yield found


class Selection:
    """The part of a labelled set that is used: boxes of these ``labels`` (all, if empty), and pictures with them.

    images: folder of the pictures, by default that of the file. keep_empty: also use pictures without any of the
    labels; all detections in them are false positives.
    """

    def __init__(
        self,
        kind: str,
        file: str | Location,
        images: str | Location | None = None,
        labels: Sequence[str] = (),
        keep_empty: bool = True,
    ) -> None:
        self.kind, self.file = kind, location(file)
        self.folder = location(images) if images else self.file.parent
        self._labels, self._keep_empty = tuple(labels), keep_empty
        self._left_out: Counter[str] = Counter()

    def target(
        self,
        label: str,
        box_xyxy: tuple[float, float, float, float],
        size_px: tuple[float, float] | None = None,
        *,
        group: str | None = None,
        **beside: Any,
    ) -> list[Target]:
        """The box as a target, or nothing. size_px: (width, height) of the picture, where that is known.

        group: by default its size class. ``beside``: the target's other fields. Boxes partly outside the
        picture stay as they are.
        """
        if self._labels and label not in self._labels:
            return []
        x0, y0, x1, y1 = box_xyxy
        width, height = x1 - x0, y1 - y0
        if not all(abs(each) <= LARGEST_PX for each in (x0, y0, width, height)):
            return self.leave_out("with coordinates that are not finite or beyond 1e6 px")
        if width <= 0 or height <= 0:
            return self.leave_out("without area")
        if size_px and (x1 <= 0 or y1 <= 0 or x0 >= size_px[0] or y0 >= size_px[1]):
            return self.leave_out("outside the picture")
        group = group or size_group(width, height, label if self._labels else "objects")
        return [Target(label, group, box_xyxy, **beside)]

    def leave_out(self, why: str) -> list[Target]:
        """Count a box that is left out. Returns no target."""
        self._left_out[why] += 1
        return []

    def picture_set(
        self, entries: Iterable[Listed], categories: Mapping[str, int], notes: Sequence[str] = ()
    ) -> PictureSet:
        """The pictures that are used; a picture with crowds only is not.

        Raises ``ValueError`` for a label that is not a category, or if no picture is left.
        """
        every = self._keep_empty or not self._labels
        taken = [entry for entry in entries if every or not all(each.crowd for each in entry.targets or ())]
        if unknown := [label for label in self._labels if label not in categories]:
            raise ValueError(f"target = {unknown}: must be among the categories {sorted(categories)}")
        if not taken:
            raise ValueError(f"contains no pictures{f' with {list(self._labels)}' if self._labels else ''}")
        pictures = from_files(self.folder, taken)
        empty = ["pictures without targets"] * (self._keep_empty and bool(self._labels))
        chosen = ", ".join([*sorted(self._labels), *empty])
        counted = (f"{n} {'box' if n == 1 else 'boxes'} {why} left out" for why, n in self._left_out.items())
        about = (*counted, *notes), chosen, str(self.folder)
        return PictureSet(self.kind, str(self.file), pictures, categories, *about)


class _Sized(BaseModel):
    """Size of a picture, px, where both sides are known."""

    width: Number | None = None
    height: Number | None = None

    @property
    def size_px(self) -> tuple[float, float] | None:
        """Width and height; None where one is missing or 0."""
        return (self.width, self.height) if self.width and self.height else None


class _Category(BaseModel):
    id: Whole
    name: Characters


class _Image(_Sized):
    id: Whole
    file_name: FileName


class _Coco(BaseModel):
    images: list[_Image]
    categories: list[_Category]
    annotations: list[Any]  # checked one by one: of the largest sets they fill the memory


class _Annotation(BaseModel):
    image_id: Whole
    category_id: Whole
    bbox: Annotated[list[Number], Len(4, 4)]  # x, y, width, height, px
    area: Annotated[Number, Ge(0), Lt(math.inf)] | None = None


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
    two targets, with a note. Boxes refer to the upright picture, after its EXIF orientation. A picture whose size
    differs from the file, or that has more than 100 megapixels, cannot be loaded. Raises ``ValueError`` that names
    the file if it is not a COCO file, or if a file name leaves the folder.
    """
    selection = Selection("coco", file, images, labels, keep_empty)
    with faults_of("labels", selection.file):
        text = read_text(selection.file, LARGEST_SET_BYTES)
        document = checked(_Coco, as_json(text, "a COCO instances file"))
        for name, ids in (("images", document.images), ("categories", document.categories)):
            for number, count in Counter(entry.id for entry in ids).items():
                if count > 1:
                    raise ValueError(f"{name}: id = {number} occurs twice; ids must be unique")
        names = {category.id: category.name for category in document.categories}
        listed = {image.id: (image, list[Target]()) for image in document.images}
        used: set[int] = set()
        repeated = 0
        for place, entry in enumerate(each(document.annotations, "annotations", _Annotation)):
            if entry.category_id not in names:
                known = f"category_id = {entry.category_id}: must be the id of a category"
                raise ValueError(f"annotations[{place}]: {known}")
            if entry.image_id not in listed:
                selection.leave_out("of pictures that are not in images")
                continue
            stated = document.annotations[place]
            annotation = {key: value for key, value in stated.items() if key not in _READ}
            own = stated.get("id")
            if type(own) is int and 0 < own < _LARGEST_ID:  # for COCO's tools 0 is none
                if own in used:
                    repeated += 1
                else:
                    annotation["id"] = own
                    used.add(own)
            x, y, width, height = entry.bbox
            image, targets = listed[entry.image_id]
            targets += selection.target(
                names[entry.category_id],
                (x, y, x + width, y + height),
                image.size_px,
                area_px2=entry.area,
                crowd=bool(annotation.get("iscrowd")),
                annotation=annotation,
            )
        entries = (
            Listed(image.file_name, tuple(targets), number, image.size_px)
            for number, (image, targets) in listed.items()
        )
        note = f"annotations whose id occurs before, each used as a target of its own: {repeated}"
        categories = {name: number for number, name in names.items()}
        return selection.picture_set(entries, categories, [note] if repeated else [])


class _Corners(BaseModel):
    x1: Number
    y1: Number
    x2: Number
    y2: Number


class _Label(BaseModel):
    """Other fields, ``model_extra``, stay with the target. A lane or a drivable area has no box."""

    model_config = ConfigDict(extra="allow")
    id: Any = None
    box2d: _Corners | None = None
    category: Characters | None = None


class _Frame(BaseModel):
    name: FileName
    labels: list[_Label] | None = None
    size: _Sized | None = None


def bdd(
    file: str | Location,
    *,
    images: str | Location | None = None,
    labels: Sequence[str] = (),
    keep_empty: bool = False,
) -> PictureSet:
    """The pictures of a BDD100K detection file, with their box2d as targets; labels without one do not count.

    The file is a list of frames, or an object with ``frames``: https://doc.bdd100k.com/format.html. images,
    labels, ``keep_empty``, notes, sizes (a frame's ``size``, where it has one) and errors as
    of :func:`blurnoise_eval.datasets.coco`; categories keep their names ("traffic sign", "bike") and are numbered
    in alphabetical order.
    """
    selection = Selection("bdd", file, images, labels, keep_empty)
    with faults_of("labels", selection.file):
        document = as_json(read_text(selection.file, LARGEST_SET_BYTES), "a BDD100K label file")
        frames = document.get("frames") if isinstance(document, dict) else document
        known: set[str] = set()
        entries: list[Listed] = []
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
            entries.append(
                Listed(frame.name, tuple(targets), size_px=frame.size.size_px if frame.size else None)
            )
        return selection.picture_set(entries, {label: n for n, label in enumerate(sorted(known), start=1)})


class _Text(BaseModel):
    transcription: Characters
    points: Annotated[list[Annotated[list[Number], Len(2, 2)]], Len(2)]  # corners [x, y], px


def texts(file: str | Location, *, images: str | Location | None = None) -> PictureSet:
    """The pictures of a PP-OCR label file, with their texts as targets; unreadable ones are marked as crowds.

    The file has a line per picture: its name, a tab, and either its text, when the whole picture is the box,
    or, for all pictures, JSON: ``[{"transcription": "STOP", "points": [[x, y], ...]}]``, px. Source: PaddleOCR,
    "text recognition" and "text detection" data sets. images: the pictures' folder, by default the file's own.
    Raises ``ValueError`` that names the file and the line.
    """
    selection = Selection("text", file, images)
    with faults_of("labels", selection.file):
        content = read_text(selection.file, LARGEST_SET_BYTES)
        with_places = "\t[{" in content

        def read(line: str) -> tuple[str, str, list[Target]]:
            name, tab, rest = line.partition("\t")
            if not tab:
                raise ValueError(f"{shown(line)}: must be the name of a picture, a tab, and its text")
            return inside(name), rest, _places(rest, selection) if with_places else []

        rows = list(each_line(content, read))
        sizes = {} if with_places else sizes_px(selection.folder, [name for name, _, _ in rows])
        entries = []
        for name, text, targets in rows:
            if name in sizes:
                width, height = sizes[name]
                targets = [
                    Target(TEXT, _height_group(height), (0.0, 0.0, float(width), float(height)), text=text)
                ]
            entries.append(Listed(name, tuple(targets)))
        return selection.picture_set(entries, {TEXT: 1})


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
    """The group of a text, by the height of its box."""
    return next(f"text, height {span} px" for span, below_px in _HEIGHTS_PX if height_px < below_px)
