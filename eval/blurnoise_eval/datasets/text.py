"""Text labels as PP-OCR has them: a text per picture, or several texts with their places in it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import partial
from typing import Annotated

import numpy as np
from pydantic import BaseModel

from blurnoise._core.checks import Characters, shown
from blurnoise_eval.datasets.folder import from_files
from blurnoise_eval.datasets.images import MAX_MEGAPIXELS, size_px
from blurnoise_eval.datasets.labels import (
    LARGEST_SET_BYTES,
    Number,
    Selection,
    as_json,
    each,
    each_line,
    faults_of,
    of_length,
    read_text,
)
from blurnoise_eval.datasets.records import PictureSet, Target, UnreadablePicture
from blurnoise_eval.system.files import inside
from blurnoise_eval.system.urls import Location, fetch_ahead, versions

LABEL = "text"
_UNREADABLE = ("###", "*")  # PP-OCR's marks of text that nobody could read
_HEIGHTS_PX = (16, 32, 64)
_Corner = Annotated[list[Number], of_length(2, 2, "must be [x, y], px")]


class _Text(BaseModel):
    transcription: Characters
    points: Annotated[list[_Corner], of_length(2, math.inf, "must be corners [[x, y], ...], px")]


def texts(
    file: Location, *, images: Location | None = None, max_megapixels: float = MAX_MEGAPIXELS
) -> PictureSet:
    """The pictures of a PP-OCR label file, with their texts as targets; unreadable ones are marked as crowds.

    The file has a line per picture: its name, a tab, and either its text, when the whole picture is the box,
    or, for all pictures, JSON: ``[{"transcription": "STOP", "points": [[x, y], ...]}]``, px. Source: PaddleOCR,
    "text recognition" and "text detection" data sets. images: the pictures' folder, by default the file's own;
    one of more than ``max_megapixels`` cannot be loaded. Raises ``ValueError`` that names the file and the line.
    """
    folder = images or file.parent
    selection = Selection((), keep_empty=True)
    with faults_of("text", file):
        content = read_text(file, LARGEST_SET_BYTES)
        targets: Callable[[str, str], list[Target]]
        if "\t[{" in content:
            targets = partial(_places, selection=selection)
        else:
            known = versions(
                folder, [line.partition("\t")[0] for line in content.split("\n") if line.strip()]
            )
            fetch_ahead(folder, known)
            targets = partial(_whole, folder=folder, known=known)
        lines = list(each_line(content, partial(_line, targets=targets)))
        selection.check((), lines)
        taken = ((name, tuple(found), place, None) for place, (name, found) in enumerate(lines, start=1))
        pictures = from_files(folder, taken, max_megapixels)
    return PictureSet("text", str(file), pictures, {LABEL: 1}, selection.notes())


def _line(line: str, *, targets: Callable[[str, str], list[Target]]) -> tuple[str, list[Target]]:
    name, tab, rest = line.partition("\t")
    if not tab:
        raise ValueError(f"{shown(line)}: must be a picture's name, a tab and its text")
    name = inside(name)
    return name, targets(name, rest)


def _whole(name: str, written: str, *, folder: Location, known: Mapping[str, str]) -> list[Target]:
    """The whole picture as the text's place; nothing where it cannot be read, which is told on loading."""
    try:
        width, height = size_px(folder / name, known.get(name))
    except UnreadablePicture:
        return []
    return [Target(LABEL, _height_group(height), (0.0, 0.0, float(width), float(height)), text=written)]


def _places(_name: str, written: str, *, selection: Selection) -> list[Target]:
    """The upright boxes around the points."""
    entries, targets = as_json(written, "a list of texts and points"), []
    for place, entry in enumerate(each(entries, "texts", _Text)):
        corners = np.array(entry.points)
        (x0, y0), (x1, y1) = corners.min(axis=0).tolist(), corners.max(axis=0).tolist()
        targets += selection.target(
            LABEL,
            (x0, y0, x1, y1),
            group=_height_group(y1 - y0),
            crowd=entry.transcription in _UNREADABLE,
            text=entry.transcription,
            annotation={key: value for key, value in entries[place].items() if key != "transcription"},
        )
    return targets


def _height_group(height_px: float) -> str:
    """The text's curve, by the height of its box."""
    below = next((edge for edge in _HEIGHTS_PX if height_px < edge), None)
    if below is None:
        return f"text, height > {_HEIGHTS_PX[-1]} px"
    above = below // 2
    return f"text, height < {below} px" if below == _HEIGHTS_PX[0] else f"text, height {above}-{below} px"
