"""BDD100K's detection labels, and Scalabel's, whose format they are in."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, ConfigDict, ValidatorFunctionWrapHandler, WrapValidator

from blurnoise._core.checks import Characters
from blurnoise_eval.datasets.folder import Entry, from_files
from blurnoise_eval.datasets.images import MAX_MEGAPIXELS
from blurnoise_eval.datasets.labels import FileName, Number, Selection, Size, each, faults_of, read_json
from blurnoise_eval.datasets.records import PictureSet, Target
from blurnoise_eval.system.urls import Location


class _Corners(BaseModel):
    x1: Number
    y1: Number
    x2: Number
    y2: Number


class _Label(BaseModel):
    """What else it says, ``model_extra``, stays with the target."""

    model_config = ConfigDict(extra="allow")
    id: Any = None
    box2d: _Corners
    category: Characters


def _boxed(label: Any, read: ValidatorFunctionWrapHandler) -> Any:
    """None for a lane or a drivable area."""
    return None if isinstance(label, dict) and label.get("box2d") is None else read(label)


class _Frame(BaseModel):
    name: FileName
    labels: Annotated[
        list[Annotated[_Label, WrapValidator(_boxed)]], BeforeValidator(lambda labels: labels or [])
    ] = []
    size: Annotated[Size | None, BeforeValidator(lambda size: None if size == {} else size)] = None


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
        taken: list[Entry] = []
        for frame in each(frames, "frames", _Frame):
            known.update(label.category for label in frame.labels if label)
            targets = _targets(frame, selection)
            if selection.takes(targets):
                size_px = frame.size.px if frame.size else None
                taken.append((frame.name, tuple(targets), len(taken) + 1, size_px))
        pictures = from_files(images or file.parent, taken, max_megapixels)
        selection.check(known, pictures)
    categories = {label: place for place, label in enumerate(sorted(known), start=1)}
    return PictureSet("bdd", str(file), pictures, categories, selection.notes(), selection.chosen)


def _targets(frame: _Frame, selection: Selection) -> list[Target]:
    targets = []
    for label in filter(None, frame.labels):
        corners, annotation = label.box2d, label.model_extra or {}
        attributes = annotation.get("attributes")
        targets += selection.target(
            label.category,
            (corners.x1, corners.y1, corners.x2, corners.y2),
            crowd=isinstance(attributes, dict) and bool(attributes.get("crowd")),
            annotation=annotation,
        )
    return targets
