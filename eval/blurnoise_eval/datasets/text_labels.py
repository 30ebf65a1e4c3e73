"""PP-OCR's lists of pictures and their texts."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import Annotated, Any

import numpy as np
from annotated_types import Len
from pydantic import BaseModel

from blurnoise._core.checks import shown
from blurnoise._core.fields import Characters
from blurnoise_eval.datasets.folder import Listed
from blurnoise_eval.datasets.images import sizes_px
from blurnoise_eval.datasets.label_reading import (
    LARGEST_SET_BYTES,
    Number,
    as_json,
    each,
    each_line,
    faults_of,
    read_text,
)
from blurnoise_eval.datasets.records import PictureSet, Target
from blurnoise_eval.datasets.selection import Selection
from blurnoise_eval.system.urls import Location

TEXT = "text"
_UNREADABLE = ("###", "*")  # PP-OCR's marks of text that nobody could read
_PLACES = re.compile(r"\t\s*\[\s*\{|\A(?:[^\t\n]*\t\s*\[\s*\]\s*(?:\n|\Z))+\Z")
"""JSON somewhere, or pictures without texts only; a text of a whole picture may be \"[]\"."""
_HEIGHTS_PX = (("< 16", 16), ("16-32", 32), ("32-64", 64), ("> 64", math.inf))


class _Text(BaseModel):
    transcription: Characters
    points: Annotated[list[Annotated[list[Number], Len(2, 2)]], Len(2)]  # corners [x, y], px


def texts(file: str | Location, *, images: str | Location | None = None) -> PictureSet:
    """The pictures of a PP-OCR label file, with their texts as targets; unreadable ones are marked as crowds.

    The file has a line per picture: its name, a tab, and either its text, when the whole picture is the box,
    or, for all pictures, JSON: ``[{"transcription": "STOP", "points": [[x, y], ...]}]``, px. Source: PaddleOCR,
    "text recognition" and "text detection" data sets. images: the pictures' folder, by default the file's own.
    Raises ``ValueError`` that names the file and the line.

    >>> from pathlib import Path
    >>> from blurnoise_eval import datasets
    >>> words = '[{"transcription": "STOP", "points": [[10, 20], [40, 20], [40, 60], [10, 60]]}]'
    >>> _ = Path("labels.txt").write_text("a.jpg\\t" + words)
    >>> datasets.texts("labels.txt").pictures[0].targets[0].text
    'STOP'
    """
    selection = Selection("text", file, images)
    with faults_of("labels", selection.file):
        content = read_text(selection.file, LARGEST_SET_BYTES)
        with_places = bool(_PLACES.search(content))

        def read(line: str) -> tuple[str, str, list[tuple[_Text, dict[str, Any]]]]:
            name, tab, rest = line.partition("\t")
            if not tab:
                raise ValueError(f"{shown(line)}: must be the name of a picture, a tab, and its text")
            return name, rest, _texts(rest) if with_places else []

        rows = list(each_line(content, read))
        names = selection.names([name for name, _, _ in rows], sized=not with_places)
        # Without places a picture is its text's box, for which its size has to be known.
        sizes = {} if with_places else sizes_px(selection.folder, names)
        entries = []
        for name, (_, rest, texts_of_line) in zip(names, rows, strict=True):
            targets = _targets(name, texts_of_line, selection)
            if name in sizes:
                width, height = sizes[name]
                box = (0.0, 0.0, float(width), float(height))
                targets = [Target(TEXT, _height_group(height), box, text=rest)]
            entries.append(Listed(name, tuple(targets)))
        return selection.picture_set(entries, {TEXT: 1})


def _texts(written: str) -> list[tuple[_Text, dict[str, Any]]]:
    """Each checked, and as it is written."""
    entries = as_json(written, "a list of texts and points")
    return list(zip(each(entries, "texts", _Text), entries, strict=True))


def _targets(
    picture: str, entries: Sequence[tuple[_Text, dict[str, Any]]], selection: Selection
) -> list[Target]:
    """The upright boxes around the points."""
    targets: list[Target] = []
    for entry, written in entries:
        corners = np.array(entry.points)
        (x0, y0), (x1, y1) = corners.min(axis=0).tolist(), corners.max(axis=0).tolist()
        targets += selection.target(
            TEXT,
            (x0, y0, x1, y1),
            picture=picture,
            group=_height_group(y1 - y0),
            crowd=entry.transcription in _UNREADABLE,
            text=entry.transcription,
            annotation={key: value for key, value in written.items() if key != "transcription"},
        )
    return targets


def _height_group(height_px: float) -> str:
    """The group of a text, by the height of its box."""
    return next(f"text, height {span} px" for span, below_px in _HEIGHTS_PX if height_px < below_px)
