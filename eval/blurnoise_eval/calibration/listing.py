"""Which frames a folder holds and how each was taken.

``frames.csv`` lists them (its columns are the fields of ``Frame``), or the descriptor of EMVA 1288's data sets and of
the package emva1288 (a .txt file). Without either, names of files and folders say what is dark and what is flat, then
headers; headers how long the exposure was, then names: ``dark_10ms_0.png``, ``flat/2ms_1.tif``, ``IMG_1.dng``. Where
the two differ, and where a name can be read in several ways, the listing's notes say so.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from annotated_types import Interval
from pydantic import BaseModel, ValidationError

from blurnoise._core.checks import within
from blurnoise._core.files import read_text
from blurnoise_eval.calibration.formats import FORMATS, RawLayout, format_of, naming, read_plane, refuse
from blurnoise_eval.calibration.names import WAYS, Exposure, exposure_of, kind_of, way_of
from blurnoise_eval.system.files import inside

Kind = Literal["dark", "flat"]
BayerPattern = Literal["none", "RGGB", "GRBG", "GBRG", "BGGR", "RCCB", "RCCC"]
_LIST = "frames.csv"
_DECIMAL_COMMA = re.compile(r"-?\d+,\d+(?:e-?\d+)?", re.IGNORECASE)
_PARTS = ("ms", 1e-3), ("us", 1e-6)  # that headers may be in, though seconds are their unit
_CLIPPED = 0.01  # of the pixels at the greatest number
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
    """The frames of a folder in the order taken. bit_depth: as the list states it; black_dn: as headers do."""

    frames: Sequence[Frame]
    notes: Sequence[str]
    bit_depth: int | None = None
    black_dn: float | None = None

    @property
    def left_out(self) -> list[str]:
        """Notes on files that were left out."""
        return [note for note in self.notes if note.startswith("left out")]


class _Headers:
    """Headers of files, the ISO numbers and gain settings in them, which only compare the gains, and notes.

    noted: files by what was assumed of them or why they were left out.
    """

    def __init__(self) -> None:
        self._isos: dict[Path, float] = {}
        self._settings: dict[Path, float] = {}
        self._blacks_dn: dict[Path, float] = {}
        self.noted: dict[str, list[str]] = {}

    def note(self, text: str, path: Path) -> None:
        """What was assumed of a file."""
        self.noted.setdefault(text, []).append(path.name)

    def read(self, path: Path, given: Mapping[str, Any]) -> dict[str, Any]:
        """Fields of the file's frames, and its ``words`` and ``processed``; given: those known without its header,
        which count more."""
        refuse(not path.is_file(), f"file {path.name!r}: must be a file in {path.parent}")
        with naming(path):
            taken = format_of(path).taken(path)
        for name, values in (
            ("iso", self._isos), ("gain_setting", self._settings), ("black_dn", self._blacks_dn),
        ):  # fmt: skip
            value = taken.pop(name, None)
            if value is not None and "gain_db" not in given:
                values[path] = value
        for text in taken.pop("notes", ()):
            self.note(text, path)
        stated = taken.get("exposure_s")
        if isinstance(stated, float) and stated and "exposure_s" in given:
            with suppress(ValueError):
                if not math.isclose(stated, float(given["exposure_s"]), rel_tol=0.01):
                    text = f"{given['exposure_s']} s in {_LIST} but {stated:g} s in the header"
                    self.note(f"{text}; that of {_LIST} is used", path)
        return {"file": path, **taken, **given}

    def apply(self, frames: Sequence[Frame], notes: Sequence[str] = ()) -> Listing:
        """The frames with their gains. Raises ``ValueError`` for settings whose gains are unknown."""
        different = sorted({*self._settings.values()})
        numbers = ", ".join(f"{setting:g}" for setting in different)
        unit = "their unit depends on the manufacturer; add the column gain_db to frames.csv"
        refuse(len(different) > 1, f"GAIN in the headers = {numbers}: {unit}")
        notes = [
            *notes,
            *(f"{text} ({len(names)} files, such as {names[0]})" for text, names in self.noted.items()),
        ]
        blacks_dn = {*self._blacks_dn.values()}
        black_dn = blacks_dn.pop() if len(blacks_dn) == 1 else None
        if not self._isos:
            return Listing(frames, notes, black_dn=black_dn)
        base = min(self._isos.values())
        gains = {path: round(20 * math.log10(iso / base), 3) for path, iso in self._isos.items()}
        with_gain = [
            each.model_copy(update={"gain_db": gains.get(each.file, each.gain_db)}) for each in frames
        ]
        return Listing(
            with_gain, [*notes, f"ISO {base:g}, the lowest, is used as 0 dB of gain"], black_dn=black_dn
        )


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
    refuse(not found.frames, f"{folder}: no frames; {'; '.join([must, *found.left_out])}")
    return found


def _listed(source: Path, layout: RawLayout | None) -> Listing:
    """Of frames.csv."""
    frames: list[Frame] = []
    headers = _Headers()
    lines: dict[tuple[Path, int], int] = {}
    with naming(source):
        rows = reader_of(source)
        try:
            names = _columns(next(rows, []))
            for cells in rows:
                for frame in _row(source.parent, headers, names, with_points(cells, rows), layout):
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


def reader_of(source: Path) -> Any:
    """The ``csv.reader`` of a table: separated by commas, or by semicolons or tabs as its first line is."""
    lines = read_text(source).splitlines()
    if lines and lines[0].lower().startswith("sep="):  # for Excel
        return csv.reader(lines[1:], delimiter=lines[0][4:5] or ",", skipinitialspace=True)
    head = lines[0] if lines else ""
    separator = next((each for each in ";\t" if "," not in head and each in head), ",")
    return csv.reader(lines, delimiter=separator, skipinitialspace=True)


def with_points(cells: Sequence[str], reader: Any) -> list[str]:
    """Cells of a line, with a point for the decimal comma that numbers have between semicolons or tabs."""
    commas = reader.dialect.delimiter != ","
    return [
        cell.replace(",", ".") if commas and _DECIMAL_COMMA.fullmatch(cell.strip()) else cell.strip()
        for cell in cells
    ]


def _columns(header: Sequence[str]) -> list[str]:
    """Names of the columns, in small letters."""
    names = [name.strip().lower() for name in header]
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
    given: dict[str, Any] = {name: cell for name, cell in zip(names, cells, strict=False) if cell}
    if "file" in given:
        path = folder / inside(given.pop("file"))
        fields = headers.read(path, given)
        words, processed = fields.pop("words", ""), fields.pop("processed", "")
        averaged = kind_of(words).averaged or processed
        refuse(
            averaged, f"{path.name}: {processed or words!r}: must be a raw frame, not an average or processed"
        )
        if "kind" not in given and kind_of(words).kind in ("dark", "flat"):
            fields["kind"] = kind_of(words).kind
        yield from _pages(fields, layout)
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
    headers = _Headers()
    found: list[tuple[dict[str, Any], Exposure | None]] = []
    below = [path for each in folder.iterdir() if each.is_dir() for path in each.iterdir()]
    for path in sorted([*folder.iterdir(), *below]):
        above = path.parent.name if path.parent != folder else ""
        names = [kind_of(path.stem), kind_of(above)]
        exposure = exposure_of(path.stem) or exposure_of(above)
        named = any(each.kind for each in names) and exposure
        if not path.is_file() or (path.suffix.lower() not in FORMATS and not named):
            continue
        fields = headers.read(path, {})
        words, processed = fields.pop("words", ""), fields.pop("processed", "")
        stated = kind_of(words)
        signs = [*(names[::-1] if names[1].of_flats else names), stated]
        kind = next((each.kind for each in signs if each.kind in ("dark", "flat")), "")
        if not kind and (words or any(each.kind for each in names)):
            kind = "light"
        elif not kind and "exposure_s" in fields:
            kind = "flat"
        if kind and (processed or any(each.averaged for each in signs)):
            why = f" ({processed})" if processed else ""
            headers.note(f"left out: averages or processed frames{why}; single raw frames are needed", path)
        elif kind == "light":
            called = f" ({words})" if words else ""
            headers.note(
                f"left out: light frames{called}, which are not of an even light; else name them flat", path
            )
        elif kind and not exposure and "exposure_s" not in fields:
            headers.note("left out: no exposure in name or header", path)
        elif kind:
            if stated.kind not in ("", kind):
                headers.note(f"{kind} by name but {words!r} by header; the name is used", path)
            found.append((_timed({**fields, "kind": kind}, exposure, headers), exposure))
    _settle(found, headers, layout)
    return headers.apply([frame for fields, _ in found for frame in _pages(fields, layout)])


def _timed(fields: dict[str, Any], exposure: Exposure | None, headers: _Headers) -> dict[str, Any]:
    """The fields with the header's exposure, or the name's where that is clear."""
    if fields.get("exposure_s"):
        stated = _frame(fields).exposure_s
        by_name = exposure.readings[0] if exposure and exposure.clear else 0.0
        unit = next((unit for unit, of_s in _PARTS if math.isclose(by_name, stated * of_s, rel_tol=0.02)), "")
        if unit:
            headers.note(
                f"exposures in headers are in {unit}, by the names; the names are used", fields["file"]
            )
            fields["exposure_s"] = by_name
        elif exposure and not exposure.agrees(stated):
            text = f"{exposure.readings[0]:g} s by name but {stated:g} s by header; the header's is used"
            headers.note(text, fields["file"])
    elif exposure and exposure.clear:
        fields["exposure_s"] = exposure.readings[0]
    return fields


def _settle(
    found: Sequence[tuple[dict[str, Any], Exposure | None]], headers: _Headers, layout: RawLayout | None
) -> None:
    """Read exposures in names that can be read in several ways in the one with which the light grows with them."""
    unclear = [(fields, exposure) for fields, exposure in found if exposure and "exposure_s" not in fields]
    if not unclear:
        return
    dark = [read_plane(fields["file"], layout).mean() for fields, _ in found if fields["kind"] == "dark"][:2]
    signals = [
        _signal(fields["file"], layout) - min(dark, default=0.0) if fields["kind"] == "flat" else math.nan
        for fields, _ in unclear
    ]
    way = way_of([exposure for _, exposure in unclear], signals)
    first, shown = unclear[0][0]["file"], sorted({*unclear[0][1].readings})
    may = " or ".join(f"{each:g} s" for each in shown)
    fits = f"exposures in names such as {first.name} can be {may}, and the flat frames' light fits none"
    if way is None:
        raise ValueError(f"{fits}; list them in {_LIST}")
    for fields, exposure in unclear:
        fields["exposure_s"] = exposure.readings[WAYS.index(way)]
    headers.note(f"exposures in names: {first.name} is read as {unclear[0][0]['exposure_s']:g} s", first)


def _signal(file: Path, layout: RawLayout | None) -> float:
    """Mean of a file's first frame, NaN where it clips."""
    plane = read_plane(file, layout)
    return math.nan if np.mean(plane == plane.max()) > _CLIPPED else float(plane.mean())
