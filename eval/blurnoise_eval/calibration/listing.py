"""Lists of frames: which file of a folder is dark or flat, and how long it was exposed.

``frames.csv`` in the folder says so (columns file, kind, exposure_s, and photons_per_px where the light is known);
without it the files' names do: ``dark_10ms_0.png``, ``flat_2.5ms_1.tif``, ``flat_500us_a.npy``, ``dark_1s.dng``.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from blurnoise._core.checks import in_range, known, limited, shown
from blurnoise._core.files import read_text
from blurnoise_eval.system.files import inside

Kind = Literal["dark", "flat"]
LIST = "frames.csv"
_COLUMNS, _OPTIONAL = ("file", "kind", "exposure_s"), ("photons_per_px",)
_NAME = re.compile(r"(dark|flat)_(\d+(?:\.\d+)?)(ns|us|ms|s)(?:_[^.]*)?\.\w+", re.IGNORECASE)
_UNITS = {"ns": 1e-9, "us": 1e-6, "ms": 1e-3, "s": 1.0}
_PATTERN = "dark_10ms_0.png, flat_10ms_1.png"


@dataclass(frozen=True)
class Frame:
    """A file and how it was taken. photons_per_px: mean, during the exposure; None where nobody knows."""

    path: Path
    kind: Kind
    exposure_s: float
    photons_per_px: float | None = None


def frames_of(folder: Path) -> list[Frame]:
    """The frames of ``folder``, as its list or their names say.

    Raises ``ValueError`` for a folder without frames and for a list that is none, ``OSError`` where a file that is
    listed is missing.
    """
    if not folder.is_dir():
        raise ValueError(f"folder = {str(folder)!r}: must be a folder of dark and flat frames")
    listed = folder / LIST
    found = _listed(listed) if listed.is_file() else _named(folder)
    if not found:
        raise ValueError(f"{folder}: no frames: must hold {LIST}, or files named like {_PATTERN}")
    for frame in found:
        if not frame.path.is_file():
            raise ValueError(f"{listed}: file {shown(str(frame.path.name))}: must be a file in {folder}")
    return found


def grouped(frames: Sequence[Frame]) -> dict[tuple[Kind, float, float | None], list[Frame]]:
    """The frames of each level, dark ones first, by exposure and light."""
    levels: dict[tuple[Kind, float, float | None], list[Frame]] = {}
    for frame in sorted(frames, key=lambda each: (each.kind, each.exposure_s, each.photons_per_px or 0.0)):
        levels.setdefault((frame.kind, frame.exposure_s, frame.photons_per_px), []).append(frame)
    return levels


def _named(folder: Path) -> list[Frame]:
    found = []
    for path in sorted(folder.iterdir()):
        if match := _NAME.fullmatch(path.name):
            kind, number, unit = match.groups()
            found.append(_frame(path, kind.lower(), float(number) * _UNITS[unit.lower()], None))
    return found


def _listed(path: Path) -> list[Frame]:
    text = read_text(path)
    try:
        with io.StringIO(text) as file:
            rows = csv.DictReader(file, skipinitialspace=True)
            columns = [name.strip() for name in rows.fieldnames or ()]
            rows.fieldnames = columns
            if missing := [name for name in _COLUMNS if name not in columns]:
                raise ValueError(f"has no column {missing[0]}; must have {', '.join(_COLUMNS)}")
            for name in columns:
                known("column", name, (*_COLUMNS, *_OPTIONAL))
            found = []
            for row in rows:
                try:
                    found.append(_of_row(path.parent, row))
                except (TypeError, ValueError) as error:
                    raise ValueError(f"line {rows.line_num}: {error}") from None
            return found
    except (ValueError, csv.Error) as error:
        raise ValueError(f"{path}: {error}") from None


def _of_row(folder: Path, row: dict[str, str | None]) -> Frame:
    texts = {name: (value or "").strip() for name, value in row.items() if isinstance(name, str)}
    if not texts["file"]:
        raise ValueError("file: must not be empty")
    photons = texts.get("photons_per_px", "")
    light = None if not photons else in_range("photons_per_px", _number("photons_per_px", photons), 0.0, 1e12)
    return _frame(
        folder / inside(texts["file"]), texts["kind"], _number("exposure_s", texts["exposure_s"]), light
    )


def _frame(path: Path, kind: str, exposure_s: float, photons_per_px: float | None) -> Frame:
    exposure_s = limited("exposure_s", exposure_s)
    if kind == "dark":
        return Frame(path, "dark", exposure_s)
    if kind == "flat":
        return Frame(path, "flat", exposure_s, photons_per_px)
    raise ValueError(f"kind = {shown(kind)}: must be dark or flat")


def _number(name: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise ValueError(f"{name} = {shown(text)}: must be a number") from None
