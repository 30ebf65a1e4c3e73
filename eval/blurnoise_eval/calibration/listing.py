"""Which frames a folder holds and how each was taken.

``frames.csv`` lists them (its columns are the fields of ``Frame``), or the descriptor of EMVA 1288's data sets and of
the package emva1288 (a .txt file). Without either, names of files and folders say what is dark and what is flat,
names or headers how long the exposure was: ``dark_10ms_0.png``, ``flat/2ms_1.tif``, ``flat_5us.npy``, ``IMG_1.dng``.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

from annotated_types import Interval
from pydantic import BaseModel, ValidationError

from blurnoise._core.checks import within
from blurnoise._core.files import read_text
from blurnoise_eval.calibration.formats import FORMATS, RawLayout, format_of, naming, refuse
from blurnoise_eval.system.files import inside

Kind = Literal["dark", "flat"]
BayerPattern = Literal["none", "RGGB", "GRBG", "GBRG", "BGGR", "RCCB", "RCCC"]
_LIST = "frames.csv"
_KIND = re.compile(r"(?<![a-z])(dark|bias|flat)s?(?![a-z])", re.IGNORECASE)
_EXPOSURE = re.compile(r"(?<![a-z\d.])(\d+(?:\.\d+)?)(ns|us|ms|s)(?![a-z\d])", re.IGNORECASE)
_UNITS = {"ns": 1e-9, "us": 1e-6, "ms": 1e-3, "s": 1.0}
_DESCRIPTOR = re.compile(r"^n\s+\d+\s+\d+\s+\d+\s*$", re.MULTILINE)


class Frame(BaseModel, frozen=True, extra="forbid", allow_inf_nan=False):
    """A frame of a file and how it was taken; each field is a column of frames.csv.

    photons_per_px, illuminance_lux, wavelength_nm: of the light of flat frames; photons are the mean during the
    exposure. gain_db: of the camera; temperature_c: of its sensor. page: of a file that holds several frames, from 0.
    """

    file: Path
    kind: Kind
    exposure_s: Annotated[float, within("exposure_s")]
    photons_per_px: Annotated[float, Interval(ge=0.0, le=1e12)] | None = None
    gain_db: Annotated[float, within("gain_db")] = 0.0
    illuminance_lux: Annotated[float, within("illuminance_lux")] | None = None
    wavelength_nm: Annotated[float, Interval(ge=100.0, le=20_000.0)] | None = None
    temperature_c: Annotated[float, within("temperature_c")] | None = None
    cfa: BayerPattern | None = None
    page: Annotated[int, Interval(ge=0)] = 0

    @property
    def level(self) -> tuple[float, ...]:
        """What frames of one level have in common, in the order of levels."""
        lit = self.kind == "flat"
        light = (self.photons_per_px, self.illuminance_lux, self.wavelength_nm)
        return (
            self.gain_db,
            self.exposure_s,
            *(-1.0 if each is None or not lit else each for each in light),
            lit,
        )


class Listing(NamedTuple):
    """The frames of a folder in the order taken. bit_depth: as the list states it."""

    frames: Sequence[Frame]
    notes: Sequence[str]
    bit_depth: int | None = None


class _Headers:
    """Headers of files, and the ISO numbers and gain settings in them, which only compare the gains."""

    def __init__(self) -> None:
        self._isos: dict[Path, float] = {}
        self._settings: dict[Path, float] = {}

    def read(self, path: Path, given: dict[str, Any]) -> dict[str, Any]:
        """Fields of the file's frames; given: those known without its header, which count more."""
        refuse(not path.is_file(), f"file {path.name!r}: must be a file in {path.parent}")
        with naming(path):
            taken = format_of(path).taken(path)
        for name, values in (("iso", self._isos), ("gain_setting", self._settings)):
            value = taken.pop(name, None)
            if value is not None and "gain_db" not in given:
                values[path] = value
        return {"file": path, **taken, **given}

    def apply(self, frames: Sequence[Frame], notes: Sequence[str] = ()) -> Listing:
        """The frames with their gains. Raises ``ValueError`` for settings whose gains are unknown."""
        different = sorted({*self._settings.values()})
        numbers = ", ".join(f"{setting:g}" for setting in different)
        unit = "their unit depends on the manufacturer; add the column gain_db to frames.csv"
        refuse(len(different) > 1, f"GAIN in the headers = {numbers}: {unit}")
        if not self._isos:
            return Listing(frames, notes)
        base = min(self._isos.values())
        gains = {path: round(20 * math.log10(iso / base), 3) for path, iso in self._isos.items()}
        with_gain = [
            each.model_copy(update={"gain_db": gains.get(each.file, each.gain_db)}) for each in frames
        ]
        return Listing(with_gain, [*notes, f"ISO {base:g}, the lowest, is used as 0 dB of gain"])


def _frame(fields: dict[str, Any]) -> Frame:
    """Raises ``ValueError`` that names the field and its value."""
    try:
        return Frame.model_validate(fields)
    except ValidationError as error:
        fault = error.errors(include_url=False)[0]
        got = "" if fault["type"] == "missing" else f" = {fault['input']!r}"
        columns = ", ".join(Frame.model_fields)
        unknown = f"; columns: {columns}" if fault["type"] == "extra_forbidden" else ""
        must = fault["msg"].replace("Input should", "must")
        raise ValueError(f"{fault['loc'][0]}{got}: {must}{unknown}") from None


def _pages(fields: dict[str, Any], layout: RawLayout | None) -> Iterator[Frame]:
    """The frames of a file."""
    first = _frame(fields)
    with naming(first.file):
        count = 1 if "page" in fields else format_of(first.file).pages(first.file, layout)
    for page in range(count):
        yield first.model_copy(update={"page": first.page + page})


def list_frames(folder: Path, layout: RawLayout | None = None) -> Listing:
    """The frames of ``folder``. layout: of files without a header.

    Raises ``ValueError`` for a folder without frames and for a list that cannot be read.
    """
    refuse(not folder.is_dir(), f"folder = {str(folder)!r}: must be a folder of dark and flat frames")
    descriptors = [path for path in sorted(folder.glob("*.txt")) if _DESCRIPTOR.search(read_text(path))]
    refuse(len(descriptors) > 1, f"{folder}: {len(descriptors)} descriptors of EMVA 1288; must be one")
    if (folder / _LIST).is_file():
        found = _listed(folder / _LIST, layout)
    elif descriptors:
        found = _described(descriptors[0])
    else:
        found = _named(folder, layout)
    must = f"must contain {_LIST}, a descriptor of EMVA 1288, files with names such as flat_10ms_1.png, or raw files"
    refuse(not found.frames, f"{folder}: no frames; {must}")
    return found


def _listed(source: Path, layout: RawLayout | None) -> Listing:
    """Of frames.csv."""
    frames: list[Frame] = []
    headers = _Headers()
    lines: dict[tuple[Path, int], int] = {}
    with naming(source):
        rows = csv.reader(read_text(source).splitlines(), skipinitialspace=True)
        try:
            names = _columns(next(rows, []))
            for cells in rows:
                for frame in _row(source.parent, headers, names, cells, layout):
                    page = frame.file, frame.page
                    twice = (
                        f"file {frame.file.name!r}, page {frame.page}: is already in line {lines.get(page)}"
                    )
                    refuse(page in lines, twice)
                    lines[page] = rows.line_num
                    frames.append(frame)
        except (ValueError, csv.Error) as error:
            raise ValueError(f"line {rows.line_num}: {error}") from None
        refuse(not frames, "no frames; must have a line for each file")
        return headers.apply(frames)


def _columns(header: Sequence[str]) -> list[str]:
    """Names of the columns, in small letters."""
    names = [name.strip().lower() for name in header]
    separated = "columns must be separated by commas, with a decimal point in numbers"
    refuse(len(names) == 1 and re.search(r"[;\t]", names[0]), f"{header[:1]}: {separated}")
    twice = [name for name in names if name and names.count(name) > 1]
    refuse(twice, f"column {', '.join(twice[:1])!r}: must occur once")
    return names


def _row(
    folder: Path, headers: _Headers, names: Sequence[str], cells: Sequence[str], layout: RawLayout | None
) -> Iterator[Frame]:
    """The frames of a line of frames.csv."""
    refuse(
        len(cells) > len(names), f"{len(cells)} values; must be at most {len(names)}, the number of columns"
    )
    given: dict[str, Any] = {
        name: cell.strip() for name, cell in zip(names, cells, strict=False) if cell.strip()
    }
    if "file" in given:
        yield from _pages(headers.read(folder / inside(given.pop("file")), given), layout)
    elif given:
        _frame(given)


def _described(source: Path) -> Listing:
    """Of a descriptor: n BITS WIDTH HEIGHT; b EXPOSURE_NS PHOTONS or d EXPOSURE_NS; i PICTURE."""
    frames: list[Frame] = []
    given: dict[str, Any] = {}
    bits = 0
    for number, line in enumerate(read_text(source).splitlines(), 1):
        letter, *words = line.replace(",", ".").split() or ["#"]
        try:
            if letter == "n":
                bits = int(words[0])
            elif letter in ("b", "d"):
                given = {"kind": "flat" if letter == "b" else "dark", "exposure_s": float(words[0]) / 1e9}
                if letter == "b":
                    given["photons_per_px"] = float(words[1])
            elif letter == "i":
                name = line.strip()[1:].strip().replace("\\", "/")
                path = source.parent / inside(name)
                frames.append(_frame({"file": path, **given}))
        except (IndexError, ValueError) as error:
            text = str(error) if isinstance(error, ValueError) else "must be b EXPOSURE_NS PHOTONS"
            raise ValueError(f"{source}: line {number}: {text}") from None
    here = [frame for frame in frames if frame.file.is_file()]
    absent = len(frames) - len(here)
    notes = [f"{source.name} lists {len(frames)} pictures; {absent} of them are missing and left out"]
    return Listing(here, notes if absent else [], bits or None)


def _named(folder: Path, layout: RawLayout | None) -> Listing:
    """Of files by the names of files and folders, and by their headers. What neither name calls dark or flat is a
    frame of light where its header states an exposure, or else no frame."""
    frames: list[Frame] = []
    unknown: list[str] = []
    headers = _Headers()
    below = [path for each in folder.iterdir() if each.is_dir() for path in each.iterdir()]
    for path in sorted([*folder.iterdir(), *below]):
        kind = _KIND.search(path.stem) or (_KIND.search(path.parent.name) if path.parent != folder else None)
        exposure = _EXPOSURE.search(path.stem)
        given: dict[str, Any] = {}
        if kind:
            given["kind"] = "flat" if kind[1].lower() == "flat" else "dark"
        if exposure:
            given["exposure_s"] = float(exposure[1]) * _UNITS[exposure[2].lower()]
        if not path.is_file() or (path.suffix.lower() not in FORMATS and len(given) < 2):
            continue
        fields = headers.read(path, given)
        if "exposure_s" not in fields:
            unknown += [path.name] if kind else []
        elif kind or len(fields) > 1 + len(given):
            frames += _pages({"kind": "flat", **fields}, layout)
    none = f"left out: {len(unknown)} files without an exposure in name or header, such as {''.join(unknown[:1])}"
    return headers.apply(frames, [none] if unknown else [])
