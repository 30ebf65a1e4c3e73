"""The frames of a folder, and how each was taken.

``frames.csv`` lists them (its columns are the fields of ``FrameFile``), or the descriptor of the data sets of EMVA
1288 and the package emva1288 (a .txt file). Otherwise the kind comes from the names of files and folders, then from
headers, and the exposure from headers, then from names: ``dark_10ms_0.png``, ``flat/2ms_1.tif``, ``IMG_1.dng``. Notes
name the files where both differ, or where a name has several readings.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from annotated_types import Interval
from pydantic import BaseModel, ValidationError

from blurnoise._core.fields import within
from blurnoise._core.files import read_text
from blurnoise_eval.calibration.formats import FORMATS, RawLayout, format_of, naming, read_plane
from blurnoise_eval.calibration.headers import FrameHeader, refuse
from blurnoise_eval.calibration.names import NamedExposure, exposure_of, fitting_reading, kind_of
from blurnoise_eval.system.files import inside

Kind = Literal["dark", "flat"]
BayerPattern = Literal["none", "RGGB", "GRBG", "GBRG", "BGGR", "RCCB", "RCCC"]
_LIST = "frames.csv"
_DECIMAL_COMMA = re.compile(r"-?\d+,\d+(?:e-?\d+)?", re.IGNORECASE)
_PARTS = ("ms", 1e-3), ("us", 1e-6)  # units of some headers, in place of seconds
_CLIPPED = 0.01  # share of the pixels with the largest number
_DESCRIPTOR = re.compile(r"^n\s+\d+\s+\d+\s+\d+\s*$", re.MULTILINE)


class FrameFile(BaseModel, frozen=True, extra="forbid", allow_inf_nan=False):
    """A frame in a file and how it was taken; each field is a column of frames.csv.

    photons_per_px, illuminance_lux, wavelength_nm: of the light of flat frames; photons are the mean during the
    exposure. gain_db: of the camera; temperature_c: of its sensor. page: in a file with several frames, from 0.
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
    def level_name(self) -> str:
        """The name of the level in messages, and for ``--leave-out``."""
        light = (
            (self.photons_per_px, "photons/px"),
            (self.illuminance_lux, "lx"),
            (self.wavelength_nm, "nm"),
            (self.gain_db or None, "dB"),
        )
        parts = [f"{value:g} {unit}" for value, unit in light if value is not None]
        return ", ".join([f"{self.kind} {self.exposure_s * 1e3:g} ms", *parts])

    @property
    def level(self) -> tuple[float, ...]:
        """What the frames of a level have in common, in the order of levels."""
        lit = self.kind == "flat"
        light = (self.photons_per_px, self.illuminance_lux, self.wavelength_nm)
        known = (-1.0 if value is None or not lit else value for value in light)
        return (self.gain_db, self.exposure_s, *known, lit)


class Listing(NamedTuple):
    """The frames of a folder in the order taken. bit_depth: by the list; black_dn: by the headers."""

    frames: Sequence[FrameFile]
    notes: Sequence[str]
    bit_depth: int | None = None
    black_dn: float | None = None

    @property
    def left_out(self) -> list[str]:
        """Notes on files that were left out."""
        return [note for note in self.notes if note.startswith("left out")]


def list_frames(folder: Path, layout: RawLayout | None = None) -> Listing:
    """List the frames of ``folder``. layout: of files without a header.

    Raises ``ValueError`` for a folder without frames and for a list that cannot be read.
    """
    refuse(not folder.is_dir(), f"folder = {str(folder)!r}: must be a folder of dark and flat frames")
    descriptors = [path for path in sorted(folder.glob("*.txt")) if _DESCRIPTOR.search(read_text(path))]
    refuse(len(descriptors) > 1, f"{folder}: {len(descriptors)} descriptors of EMVA 1288; must be one")
    if (folder / _LIST).is_file():
        listing = _from_list(folder / _LIST, layout)
    elif descriptors:
        listing = _from_descriptor(descriptors[0])
    else:
        listing = _from_names(folder, layout)
    must = f"must contain {_LIST}, a descriptor of EMVA 1288, files with names such as flat_10ms_1.png, or raw files"
    refuse(not listing.frames, f"{folder}: no frames; {'; '.join([must, *listing.left_out])}")
    return listing


class _Headers:
    """Headers of the files, and notes on them. ISO numbers and gain settings only compare the gains of the files."""

    def __init__(self) -> None:
        self._headers: dict[Path, FrameHeader] = {}
        self._notes: dict[str, list[str]] = {}

    def note(self, text: str, path: Path) -> None:
        """Note an assumption about a file; files with the same note are counted."""
        self._notes.setdefault(text, []).append(path.name)

    def read(self, path: Path, known: Mapping[str, Any]) -> FrameHeader:
        """Read a header. known: fields of the frame from elsewhere, which take precedence."""
        refuse(not path.is_file(), f"file {path.name!r}: must be a file in {path.parent}")
        with naming(path):
            header = format_of(path).header(path)
        if "gain_db" not in known:
            self._headers[path] = header
        for text in header.notes:
            self.note(text, path)
        if isinstance(header.exposure_s, float) and header.exposure_s and "exposure_s" in known:
            with suppress(ValueError):
                if not math.isclose(header.exposure_s, float(known["exposure_s"]), rel_tol=0.01):
                    text = f"{known['exposure_s']} s in {_LIST} but {header.exposure_s:g} s in the header"
                    self.note(f"{text}; that of {_LIST} is used", path)
        return header

    def listing(self, frames: Sequence[FrameFile]) -> Listing:
        """The frames with their gains. Raises ``ValueError`` for gain settings whose unit is unknown."""
        headers = self._headers.items()
        settings = sorted({header.gain_setting for _, header in headers if header.gain_setting is not None})
        numbers = ", ".join(f"{setting:g}" for setting in settings)
        unit = "their unit depends on the manufacturer; add the column gain_db to frames.csv"
        refuse(len(settings) > 1, f"GAIN in the headers = {numbers}: {unit}")
        notes = [f"{text} ({len(names)} files, such as {names[0]})" for text, names in self._notes.items()]
        blacks_dn = {header.black_dn for _, header in headers} - {None}
        black_dn = blacks_dn.pop() if len(blacks_dn) == 1 else None
        isos = {path: header.iso for path, header in headers if header.iso is not None}
        if isos:
            lowest = min(isos.values())
            gains = {path: round(20 * math.log10(iso / lowest), 3) for path, iso in isos.items()}
            frames = [x.model_copy(update={"gain_db": gains.get(x.file, x.gain_db)}) for x in frames]
            notes.append(f"ISO {lowest:g}, the lowest, is used as 0 dB of gain")
        return Listing(frames, notes, black_dn=black_dn)


def _frame(fields: Mapping[str, Any]) -> FrameFile:
    """Raises ``ValueError`` that names the field and its value."""
    try:
        return FrameFile.model_validate(fields)
    except ValidationError as error:
        fault = error.errors(include_url=False)[0]
        got = "" if fault["type"] == "missing" else f" = {fault['input']!r}"
        columns = ", ".join(FrameFile.model_fields)
        unknown = f"; columns: {columns}" if fault["type"] == "extra_forbidden" else ""
        must = fault["msg"].replace("Input should", "must")
        raise ValueError(f"{fault['loc'][0]}{got}: {must}{unknown}") from None


def _pages(fields: Mapping[str, Any], layout: RawLayout | None) -> Iterator[FrameFile]:
    """The frames of a file."""
    first = _frame(fields)
    with naming(first.file):
        count = 1 if "page" in fields else format_of(first.file).pages(first.file, layout)
    for page in range(count):
        yield first.model_copy(update={"page": first.page + page})


# --- frames.csv ---


def _from_list(source: Path, layout: RawLayout | None) -> Listing:
    frames: list[FrameFile] = []
    headers = _Headers()
    lines: dict[tuple[Path, int], int] = {}
    with naming(source):
        rows = table_reader(source)
        try:
            names = _columns(next(rows, []))
            for cells in rows:
                for frame in _row(source.parent, headers, names, with_points(cells, rows), layout):
                    page = frame.file, frame.page
                    again = (
                        f"file {frame.file.name!r}, page {frame.page}: is already in line {lines.get(page)}"
                    )
                    refuse(page in lines, again)
                    lines[page] = rows.line_num
                    frames.append(frame)
        except (ValueError, csv.Error) as error:
            raise ValueError(f"line {rows.line_num}: {error}") from None
        refuse(not frames, "no frames; must have a line for each file")
        return headers.listing(frames)


def table_reader(source: Path) -> Any:
    """The ``csv.reader`` of a table, separated by commas, semicolons or tabs as its first line shows."""
    lines = read_text(source).splitlines()
    if lines and lines[0].lower().startswith("sep="):  # written by Excel
        return csv.reader(lines[1:], delimiter=lines[0][4:5] or ",", skipinitialspace=True)
    head = lines[0] if lines else ""
    separator = next((mark for mark in ";\t" if "," not in head and mark in head), ",")
    return csv.reader(lines, delimiter=separator, skipinitialspace=True)


def with_points(cells: Sequence[str], reader: Any) -> list[str]:
    """Cells of a line; between semicolons or tabs, a decimal comma becomes a point."""
    commas = reader.dialect.delimiter != ","
    return [
        cell.replace(",", ".") if commas and _DECIMAL_COMMA.fullmatch(cell.strip()) else cell.strip()
        for cell in cells
    ]


def _columns(head: Sequence[str]) -> list[str]:
    """Names of the columns in lower case."""
    names = [name.strip().lower() for name in head]
    repeated = [name for name in names if name and names.count(name) > 1]
    refuse(repeated, f"column {', '.join(repeated[:1])!r}: must occur once")
    return names


def _row(
    folder: Path, headers: _Headers, names: Sequence[str], cells: Sequence[str], layout: RawLayout | None
) -> Iterator[FrameFile]:
    """The frames of a line of frames.csv."""
    most = f"must be at most {len(names)}, the number of columns"
    refuse(len(cells) > len(names), f"{len(cells)} values; {most}")
    known: dict[str, Any] = {name: cell for name, cell in zip(names, cells, strict=False) if cell}
    if "file" in known:
        path = folder / inside(known.pop("file"))
        header = headers.read(path, known)
        kind = kind_of(header.words)
        raw = f"{path.name}: {header.processed or header.words!r}: must be a raw frame, not an average or processed"
        refuse(kind.averaged or header.processed, raw)
        fields = {"file": path, **header.fields(), **known}
        if "kind" not in known and kind.kind in ("dark", "flat"):
            fields["kind"] = kind.kind
        yield from _pages(fields, layout)
    elif known:
        _frame(known)  # which names what is missing


# --- descriptors of EMVA 1288 ---


def _from_descriptor(source: Path) -> Listing:
    """n BITS WIDTH HEIGHT; b EXPOSURE_NS PHOTONS or d EXPOSURE_NS; i PICTURE."""
    frames: list[FrameFile] = []
    fields: dict[str, Any] = {}
    bits = 0
    for number, line in enumerate(read_text(source).splitlines(), 1):
        letter, *words = line.replace(",", ".").split() or ["#"]
        try:
            if letter == "n":
                bits = int(words[0])
            elif letter in ("b", "d"):
                fields = {"kind": "flat" if letter == "b" else "dark", "exposure_s": float(words[0]) / 1e9}
                if letter == "b":
                    fields["photons_per_px"] = float(words[1])
            elif letter == "i":
                name = line.strip()[1:].strip().replace("\\", "/")
                frames.append(_frame({"file": source.parent / inside(name), **fields}))
        except (IndexError, ValueError) as error:
            text = str(error) if isinstance(error, ValueError) else "must be b EXPOSURE_NS PHOTONS"
            raise ValueError(f"{source}: line {number}: {text}") from None
    present = [frame for frame in frames if frame.file.is_file()]
    missing = len(frames) - len(present)
    notes = [f"{source.name} lists {len(frames)} pictures; {missing} of them are missing and left out"]
    return Listing(present, notes if missing else [], bits or None)


# --- names and headers ---


@dataclass
class _NamedFile:
    """A file that is a frame by its name or header; exposure: by its name."""

    fields: dict[str, Any]
    exposure: NamedExposure | None


def _from_names(folder: Path, layout: RawLayout | None) -> Listing:
    """Files without dark or flat in name, folder or header are flat frames if the header has an exposure."""
    headers = _Headers()
    below = [path for part in folder.iterdir() if part.is_dir() for path in part.iterdir()]
    every = [_named_file(path, folder, headers) for path in sorted([*folder.iterdir(), *below])]
    files = [file for file in every if file]
    _choose_readings(files, headers, layout)
    return headers.listing([frame for file in files for frame in _pages(file.fields, layout)])


def _named_file(path: Path, folder: Path, headers: _Headers) -> _NamedFile | None:
    """A file by name and header, or None with a note if it is no single raw frame of a kind and exposure."""
    above = path.parent.name if path.parent != folder else ""
    names = [kind_of(path.stem), kind_of(above)]
    exposure = exposure_of(path.stem) or exposure_of(above)
    named = any(name.kind for name in names) and exposure
    if not path.is_file() or (path.suffix.lower() not in FORMATS and not named):
        return None
    header = headers.read(path, {})
    by_header = kind_of(header.words)
    # a folder of dark flats says more than the word flat in the name of a file
    signs = [*(names[::-1] if names[1].of_flats else names), by_header]
    kind = next((sign.kind for sign in signs if sign.kind in ("dark", "flat")), "")
    if not kind and (header.words or any(name.kind for name in names)):
        kind = "light"
    elif not kind and header.exposure_s is not None:
        kind = "flat"
    if kind and (header.processed or any(sign.averaged for sign in signs)):
        why = f" ({header.processed})" if header.processed else ""
        headers.note(f"left out: averages or processed frames{why}; single raw frames are needed", path)
    elif kind == "light":
        words = f" ({header.words})" if header.words else ""
        even = "which are not of an even light; else name them flat"
        headers.note(f"left out: light frames{words}, {even}", path)
    elif kind and not exposure and header.exposure_s is None:
        headers.note("left out: no exposure in name or header", path)
    elif kind:
        if by_header.kind not in ("", kind):
            headers.note(f"{kind} by name but {header.words!r} by header; the name is used", path)
        fields = {"file": path, "kind": kind, **header.fields()}
        return _NamedFile(_with_exposure(fields, exposure, headers), exposure)
    return None


def _with_exposure(
    fields: dict[str, Any], exposure: NamedExposure | None, headers: _Headers
) -> dict[str, Any]:
    """The fields with the exposure of the header, or that of the name if it has one reading."""
    if fields.get("exposure_s"):
        by_header = _frame(fields).exposure_s
        by_name = exposure.readings[0] if exposure and exposure.clear else 0.0
        units = (unit for unit, of_s in _PARTS if math.isclose(by_name, by_header * of_s, rel_tol=0.02))
        if unit := next(units, ""):
            text = f"exposures in headers are in {unit}, by the names; the names are used"
            headers.note(text, fields["file"])
            fields["exposure_s"] = by_name
        elif exposure and not exposure.agrees(by_header):
            text = f"{exposure.readings[0]:g} s by name but {by_header:g} s by header; the header's is used"
            headers.note(text, fields["file"])
    elif exposure and exposure.clear:
        fields["exposure_s"] = exposure.readings[0]
    return fields


def _choose_readings(files: Sequence[_NamedFile], headers: _Headers, layout: RawLayout | None) -> None:
    """For names with several readings, choose the reading with which light and exposure are proportional."""
    unclear = [
        (file.fields, file.exposure) for file in files if file.exposure and "exposure_s" not in file.fields
    ]
    if not unclear:
        return
    dark = [file.fields["file"] for file in files if file.fields["kind"] == "dark"][:2]
    black_dn = min((read_plane(file, layout).mean() for file in dark), default=0.0)
    signals = [
        _signal(fields["file"], layout) - black_dn if fields["kind"] == "flat" else math.nan
        for fields, _ in unclear
    ]
    reading = fitting_reading([exposure for _, exposure in unclear], signals)
    first, times = unclear[0][0]["file"], sorted({*unclear[0][1].readings})
    if reading is None:
        may = " or ".join(f"{time:g} s" for time in times)
        fits = f"exposures in names such as {first.name} can be {may}, and the flat frames' light fits none"
        raise ValueError(f"{fits}; list them in {_LIST}")
    for fields, exposure in unclear:
        fields["exposure_s"] = exposure.readings[reading]
    headers.note(f"exposures in names: {first.name} is read as {unclear[0][0]['exposure_s']:g} s", first)


def _signal(file: Path, layout: RawLayout | None) -> float:
    """Mean of the first frame of a file, NaN if it clips."""
    plane = read_plane(file, layout)
    return math.nan if np.mean(plane == plane.max()) > _CLIPPED else float(plane.mean())
