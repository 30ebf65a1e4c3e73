"""BDD100K's detection labels, and Scalabel's, whose format they are in."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

from blurnoise._core.checks import shown
from blurnoise_eval.datasets.fields import each, faults_of, number, read_json, text
from blurnoise_eval.datasets.folder import from_files
from blurnoise_eval.datasets.images import MAX_MEGAPIXELS
from blurnoise_eval.datasets.records import PictureSet, Target
from blurnoise_eval.datasets.selection import Selection
from blurnoise_eval.system.files import inside
from blurnoise_eval.system.storage import Location

_CORNERS = ("x1", "y1", "x2", "y2")


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
        document = read_json(file, "BDD100K's labels")
        frames = document.get("frames") if isinstance(document, dict) else document
        known: set[str] = set()
        read = partial(_frame, known=known, selection=selection)
        listed = [frame for frame in each(frames, "frames", read) if selection.takes(frame[1])]
        taken = (
            (name, tuple(found), place, size_px)
            for place, (name, found, size_px) in enumerate(listed, start=1)
        )
        pictures = from_files(images or file.parent, taken, max_megapixels)
        selection.check(known, pictures)
    categories = {label: place for place, label in enumerate(sorted(known), start=1)}
    return PictureSet("bdd", str(file), pictures, categories, selection.notes(), selection.chosen)


def _frame(
    frame: dict[str, Any], *, known: set[str], selection: Selection
) -> tuple[str, list[Target], tuple[float, float] | None]:
    """Its picture's name, targets and size, if stated; ``known`` gathers the categories that have boxes."""
    name = inside(text(frame, "name"))
    labels = each(frame.get("labels") or [], "labels", partial(_label, known=known, selection=selection))
    size = frame.get("size")
    if size is not None and not isinstance(size, dict):
        raise ValueError(f"size = {shown(size)}: must be an object")
    size_px = (number(size, "width"), number(size, "height")) if size else None
    return name, [target for found in labels for target in found], size_px


def _label(label: dict[str, Any], *, known: set[str], selection: Selection) -> list[Target]:
    corners = label.get("box2d")
    if corners is None:  # a lane, a drivable area
        return []
    if not isinstance(corners, dict):
        raise ValueError(f"box2d = {shown(corners)}: must be an object")
    x0, y0, x1, y1 = (number(corners, key) for key in _CORNERS)
    category = text(label, "category")
    known.add(category)
    annotation = {key: value for key, value in label.items() if key not in ("id", "category", "box2d")}
    attributes = label.get("attributes")
    crowd = isinstance(attributes, dict) and bool(attributes.get("crowd"))
    return selection.target(category, (x0, y0, x1, y1), crowd=crowd, annotation=annotation)
