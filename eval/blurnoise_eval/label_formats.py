"""Formats of labels: how each is recognised, opened and described, and what to export from tools that write others.

A format is an entry of ``LABEL_FORMATS``, in the order in which they are tried; nothing else lists them. Its reader
is imported when a file is opened: help texts need the table.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import PurePosixPath
from typing import Any

from blurnoise_eval.system.urls import Location, local_file

_FIRST_NAMES = 100  # in a folder, of which folders are looked into
_HEAD = 4096  # bytes of a file from which its format is recognised


@dataclass(frozen=True)
class Labels:
    """What labels are recognised by: suffix in lower case, first characters, a folder's names to a depth of two."""

    suffix: str
    head: str = ""
    names: tuple[str, ...] = ()


@dataclass(frozen=True)
class LabelFormat:
    """A format. name: the kind of its sets. help: what to pass, in the help of ``--labels``.

    recognises: whether labels are of it. open: a ``PictureSet`` from the labels, ``images`` and, unless it is of
    texts, ``labels``, the classes to use. suffixes: of its files. texts: for text recognisers; others are for
    detectors. instead: of a format that is known but not read, what to do.
    """

    name: str
    help: str
    recognises: Callable[[Labels], bool]
    open: Callable[..., Any]
    suffixes: tuple[str, ...] = ()
    texts: bool = False
    instead: str = ""


def _opener(name: str) -> Callable[..., Any]:
    """A function of ``datasets``, which is imported when it is called."""

    def open_labels(place: Location, **options: Any) -> Any:
        return getattr(import_module("blurnoise_eval.datasets"), name)(place, **options)

    return open_labels


_PICTURES = (".bmp", ".jpeg", ".jpg", ".png", ".tif", ".tiff", ".webp")


def _is_yolo(labels: Labels) -> bool:
    """A folder, unless it holds XML; its file; or a list of pictures without texts."""
    if labels.suffix == ".txt":
        lines = [
            line.strip().lower() for line in labels.head.split("\n")[:-1] or [labels.head] if line.strip()
        ]
        return "\t" not in labels.head and bool(lines) and all(line.endswith(_PICTURES) for line in lines)
    return labels.suffix in (".yaml", ".yml", ".data", ".names", ".labels") or bool(labels.names)


def _is_voc(labels: Labels) -> bool:
    """XML, or a folder with XML files and without the names of YOLO's classes."""
    xml = any(name.lower().endswith((".xml", "annotations")) for name in labels.names)
    yolo = {"data.yaml", "obj.data", "obj.names", "classes.txt"}.isdisjoint(labels.names)
    return labels.suffix == ".xml" or labels.head.startswith(("<annotation", "<?xml")) or (xml and yolo)


def _is_known_folder(labels: Labels) -> bool:
    """Whether a folder holds what YOLO's or VOC's do."""
    return any(
        name.lower().endswith((".xml", ".yaml", ".yml", ".data", ".names", ".labels", ".txt"))
        for name in labels.names
    )


def _is_bdd(labels: Labels) -> bool:
    frames = labels.head.startswith("{") and '"frames"' in labels.head and '"images"' not in labels.head
    return labels.head.startswith("[") or frames


def _not_read(name: str, sign: str, instead: str) -> LabelFormat:
    """A format that is known by its beginning, a regular expression, but not read."""
    begins = re.compile(sign, re.DOTALL)

    def recognises(labels: Labels) -> bool:
        return labels.suffix not in (".yaml", ".yml") and bool(labels.head and begins.match(labels.head))

    def refuse(place: Location, **options: Any) -> Any:
        raise ValueError(f"labels = {str(place)!r}: is {name}, which is not read; {instead}")

    return LabelFormat(name, "", recognises, refuse, instead=instead)


_AS_COCO = "export it as COCO"
LABEL_FORMATS = (
    # First, because these look like formats that are read: CVAT's XML like VOC's, labelme's JSON like COCO's.
    _not_read("CVAT's own XML", r"(<\?xml[^>]*>\s*)?<annotations\b", f"{_AS_COCO} 1.0 or PASCAL VOC 1.1"),
    _not_read(
        "labelme's JSON",
        r'\{(?=.*"shapes"\s*:)(?=.*("imagePath"|"imageData"|"flags"))',
        "convert the folder to COCO",
    ),
    _not_read("VIA's JSON", r'\{.*("_via_settings"|"file_attributes"|"shape_attributes")', _AS_COCO),
    _not_read(
        "Label Studio's JSON",
        r'\[\s*\{(?=.*"data"\s*:)(?=.*"(annotations|completions|predictions)"\s*:)',
        _AS_COCO,
    ),
    _not_read("Supervisely's JSON", r'\{(?!.*"images"\s*:)(?=.*"size"\s*:).*"objects"\s*:', _AS_COCO),
    _not_read("CreateML's JSON", r'\[\s*\{(?=.*"image"\s*:)(?=.*"annotations"\s*:)', _AS_COCO),
    _not_read(
        "a list of a model's detections", r'\[\s*\{(?=.*"image_id"\s*:)(?=.*"score"\s*:)', "use the labels"
    ),
    _not_read(
        "a list of annotations without pictures", r'\[\s*\{.*"image_id"\s*:', "use the whole instances file"
    ),
    _not_read("a table (CSV)", r"[^\t\n{\[<]*,[^\t\n{\[<]*(?:,[^\t\n]*){2,}\n", "convert it to COCO"),
    LabelFormat("voc", "Pascal VOC folder or .xml", _is_voc, _opener("voc"), (".xml",)),
    LabelFormat(
        "yolo",
        "YOLO data.yaml, obj.data or folder",
        _is_yolo,
        _opener("yolo"),
        (".data", ".txt", ".yaml", ".yml"),
    ),
    LabelFormat("bdd", "BDD100K or Scalabel JSON", _is_bdd, _opener("bdd"), (".json",)),
    LabelFormat(
        "coco",
        "COCO instances",
        lambda labels: labels.suffix == ".json" or labels.head.startswith("{"),
        _opener("coco"),
        (".json",),
    ),
    LabelFormat("text", "PP-OCR text (.txt)", lambda labels: True, _opener("texts"), (".txt",), texts=True),
)
"""All formats, in the order in which they are tried; a new one precedes those that would recognise its files, too."""
_READ = [entry.help for entry in LABEL_FORMATS if not entry.instead]
HELP = f"labels: {', '.join(_READ[:-1])}, or {_READ[-1]}"


def labels_at(place: Location) -> Labels:
    """What labels are recognised by; nothing is read of what is missing."""
    try:
        if place.is_dir():
            names = sorted(each.name for each in place.iterdir())
            folders = [name for name in names[:_FIRST_NAMES] if (place / name).is_dir()]
            names += [f"{name}/{each.name}" for name in folders for each in (place / name).iterdir()]
            return Labels("", names=tuple(names) or (".",))
        with local_file(place).open("rb") as file:
            head = file.read(_HEAD).decode("utf-8-sig", "replace").lstrip().replace("\r\n", "\n")
    except OSError:
        head = ""
    return Labels(PurePosixPath(place.name).suffix.lower(), head)


def format_of(place: Location) -> LabelFormat:
    """The format of labels. Raises ``ValueError`` for those that are known but not read.

    >>> from pathlib import Path
    >>> _ = Path("instances.json").write_text('{"images": []}')
    >>> format_of(Path("instances.json")).name
    'coco'
    """
    labels = labels_at(place)
    if (jsons := [name for name in labels.names if name.endswith(".json")]) and not _is_known_folder(labels):
        format_of(place / jsons[0])
        raise ValueError(
            f"labels = {str(place)!r}: is a folder with JSON files; pass one, such as {jsons[0]}"
        )
    entry = next(entry for entry in LABEL_FORMATS if entry.recognises(labels))
    if entry.instead:
        entry.open(place)
    return entry


def is_label_file(place: Location) -> bool:
    """Whether a file has the suffix of labels.

    >>> from pathlib import Path
    >>> is_label_file(Path("instances.json")), is_label_file(Path("photo.jpg"))
    (True, False)
    """
    suffix = PurePosixPath(place.name).suffix.lower()
    return any(suffix in entry.suffixes for entry in LABEL_FORMATS)


def format_named(name: str) -> LabelFormat | None:
    """The format whose sets are of this kind."""
    return next((each for each in LABEL_FORMATS if each.name == name), None)
