"""Scalabel's frames, which BDD100K's labels are: pictures of videos or single ones, with box2d."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field

from blurnoise._core.fields import Characters
from blurnoise_eval.datasets.folder import Listed
from blurnoise_eval.datasets.label_reading import (
    LARGEST_SET_BYTES,
    Flag,
    Number,
    Sized,
    as_json,
    checked,
    each,
    faults_of,
    read_text,
)
from blurnoise_eval.datasets.records import PictureSet, Target
from blurnoise_eval.datasets.selection import Selection
from blurnoise_eval.system.urls import Location, versions

_FIRST = 20  # frames by which is seen where the pictures are


class _Corners(BaseModel):
    x1: Number
    y1: Number
    x2: Number
    y2: Number


class _BddLabel(BaseModel):
    """Other fields, ``model_extra``, stay with the target. A lane or a drivable area has no box."""

    model_config = ConfigDict(extra="allow")
    id: Any = None
    box2d: _Corners | None = None
    category: Characters | None = None


class _BddFrame(BaseModel):
    name: Characters
    video: Annotated[Characters | None, Field(alias="videoName")] = None
    labels: list[_BddLabel] | None = None
    size: Sized | None = None


class _Marks(BaseModel):
    """Attributes of a label that make it a crowd, as for Scalabel's own conversion to COCO."""

    crowd: Flag = False
    ignored: Flag = False


class _Config(BaseModel):
    image_size: Annotated[Sized | None, Field(alias="imageSize")] = None


def bdd(
    file: str | Location,
    *,
    images: str | Location | None = None,
    labels: Sequence[str] = (),
    keep_empty: bool = False,
) -> PictureSet:
    """The pictures of a BDD100K detection file, with their box2d as targets; labels without one do not count.

    The file is a list of frames, or an object with ``frames``: https://doc.bdd100k.com/format.html. A frame of a
    video is videoName/name, or name, where its pictures are there. images, labels, ``keep_empty``, notes, sizes (a
    frame's ``size``, or the ``imageSize`` of the set) and errors as of :func:`blurnoise_eval.datasets.coco`;
    categories keep their names ("traffic sign", "bike") and are numbered in alphabetical order.

    >>> import json
    >>> from pathlib import Path
    >>> from blurnoise_eval import datasets
    >>> label = {"category": "traffic sign", "box2d": {"x1": 10, "y1": 20, "x2": 40, "y2": 60}}
    >>> _ = Path("bdd.json").write_text(json.dumps([{"name": "a.jpg", "labels": [label]}]))
    >>> datasets.bdd("bdd.json").categories
    {'traffic sign': 1}
    """
    selection = Selection("bdd", file, images, labels, keep_empty)
    with faults_of("labels", selection.file):
        document = as_json(read_text(selection.file, LARGEST_SET_BYTES), "a BDD100K label file")
        frames = document.get("frames") if isinstance(document, dict) else document
        config = document.get("config") if isinstance(document, dict) else None
        common = checked(_Config, config, "config").image_size if isinstance(config, dict) else None
        checked_frames = list(each(frames, "frames", _BddFrame))
        sized = bool(checked_frames) and all(frame.size or common for frame in checked_frames)
        names = selection.names(_names(checked_frames, selection), sized=sized)
        entries: list[Listed] = []
        for index, (name, frame) in enumerate(zip(names, checked_frames, strict=True)):
            targets: list[Target] = []
            size = frame.size or common
            for label in frame.labels or ():
                if (box := label.box2d) and label.category:
                    others = label.model_extra or {}
                    attributes = others.get("attributes")
                    marks = _Marks()
                    if isinstance(attributes, dict):
                        marks = checked(_Marks, attributes, f"frames[{index}]: attributes")
                    corners = (box.x1, box.y1, box.x2, box.y2)
                    crowd = marks.crowd or marks.ignored
                    targets += selection.target(
                        label.category, corners, picture=name, crowd=crowd, annotation=others
                    )
            entries.append(Listed(name, tuple(targets), size_px=size.size_px if size else None))
        return selection.picture_set(entries)


def _names(frames: Sequence[_BddFrame], selection: Selection) -> list[str]:
    """The frames' names in the folder of their video, unless the pictures of all videos are in one folder."""
    flat = [frame.name for frame in frames]
    in_videos = [
        frame.name
        if frame.video is None or frame.name.startswith(f"{frame.video}/")
        else f"{frame.video}/{frame.name}"
        for frame in frames
    ]
    if in_videos != flat and not versions(selection.folder, _inside(in_videos)):
        return flat if versions(selection.folder, _inside(flat)) else in_videos
    return in_videos


def _inside(names: Sequence[str]) -> list[str]:
    return [name for name in names[:_FIRST] if ".." not in name and not name.startswith("/")]
