"""Frames of a folder: which one is dark or flat, how long it was exposed, and the statistics of each level.

``frames.csv`` in the folder lists them (the columns are the fields of ``Frame``); without it the files' names do:
``dark_10ms_0.png``, ``flat_2.5ms_1.tif``, ``flat_500us_a.npy``, ``dark_1s.dng``.

Files: PNG, TIFF and PGM of one channel, NPY, headerless little-endian 16-bit planes (.raw, .bin) of a given size,
and whatever LibRaw reads (DNG and cameras' raw files) where the package rawpy is installed. A further format is an
entry of ``READERS``.
"""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from copy import copy
from itertools import groupby
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from annotated_types import Interval
from numpy.typing import NDArray
from pydantic import BaseModel, ValidationError

from blurnoise._core.checks import within
from blurnoise._core.files import read_text
from blurnoise_eval.datasets import decode
from blurnoise_eval.system.files import check_regular, inside

Floats = NDArray[np.float64]
Kind = Literal["dark", "flat"]
Plane = NDArray[np.uint8] | NDArray[np.uint16]
"""Digital numbers of a frame as the converter gave them, (H, W)."""
Size = tuple[int, int]
SMALLEST_PX = 32
FEWEST_FLAT = 3
_LIST = "frames.csv"
_NAME = re.compile(r"(dark|flat)_(\d+(?:\.\d+)?)(ns|us|ms|s)(?:_[^.]*)?\.\w+", re.IGNORECASE)
_UNITS = {"ns": 1e-9, "us": 1e-6, "ms": 1e-3, "s": 1.0}
_JPEG = b"\xff\xd8\xff"


class Frame(BaseModel, frozen=True, extra="forbid"):
    """A frame of a file and how it was taken; each field is a column of frames.csv.

    photons_per_px, illuminance_lux, wavelength_nm: of the light of flat frames; photons are the mean during the
    exposure. gain_db: of the camera; temperature_c: of its sensor.
    """

    file: Path
    kind: Kind
    exposure_s: Annotated[float, within("exposure_s")]
    photons_per_px: Annotated[float, Interval(ge=0.0, le=1e12)] | None = None
    gain_db: Annotated[float, Interval(ge=-60.0, le=120.0)] = 0.0
    illuminance_lux: Annotated[float, Interval(ge=0.0, le=1e7)] | None = None
    wavelength_nm: Annotated[float, Interval(ge=100.0, le=20_000.0)] | None = None
    temperature_c: Annotated[float, Interval(ge=-273.15, le=200.0)] | None = None

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


class Folder:
    """Dark and flat levels of a folder: the frames of one gain, exposure and light, by rising gain and exposure.

    Raises ``ValueError`` unless there are dark levels and three flat ones, of two frames each, and for frames of
    several sizes or depths. step_dn: of which all numbers are multiples, 16 for 12 bits at the top of 16; the planes
    are counted in it. size_px: (width, height).
    """

    def __init__(self, folder: Path, raw_size_px: Size | None = None) -> None:
        self._raw_size_px = raw_size_px
        ordered = sorted(frames_of(folder), key=lambda frame: frame.level)
        levels = [list(frames) for _, frames in groupby(ordered, lambda frame: frame.level)]
        self.dark = [frames for frames in levels if frames[0].kind == "dark"]
        self.flat = [frames for frames in levels if frames[0].kind == "flat"]
        refuse(not self.dark, "frames: no dark ones; must be two or more, with the lens covered")
        few = f"frames: {len(self.flat)} flat exposures; must be 3, better 8 or more"
        refuse(len(self.flat) < FEWEST_FLAT, few)
        none = f"frames: dark levels and {FEWEST_FLAT} flat ones must be of one gain_db; they are of none"
        refuse(not self.gains_db, none)
        for frame, *others in levels:
            refuse(not others, f"{frame.file}: alone; must be two of each level, to tell noise from pattern")
        before = ""
        held = np.zeros(1 << 16, bool)
        for frame in ordered:
            plane = read_plane(frame.file, raw_size_px)
            held[plane] = True
            height, width = plane.shape
            here = f"{width} x {height} px, {8 * plane.itemsize} bits"
            before = before or here
            mixed = f"{frame.file}: mixed frames, this is {here}; those before it {before}"
            refuse(here != before, mixed)
        self.size_px, self.step_dn = (width, height), max(1, int(np.gcd.reduce(np.flatnonzero(held))))

    @property
    def gains_db(self) -> list[float]:
        """Gains with dark levels and ``FEWEST_FLAT`` flat ones, rising."""
        flat = Counter(frames[0].gain_db for frames in self.flat)
        dark = {frames[0].gain_db for frames in self.dark}
        return sorted(gain for gain, count in flat.items() if gain in dark and count >= FEWEST_FLAT)

    def at_gain(self, gain_db: float) -> Folder:
        """The levels of one gain."""
        one = copy(self)
        one.dark, one.flat = (
            [frames for frames in levels if frames[0].gain_db == gain_db] for levels in (self.dark, self.flat)
        )
        return one

    def planes(self, frames: Sequence[Frame]) -> Iterator[Plane]:
        """The frames' numbers in steps of the converter, one after the other."""
        for frame in frames:
            yield read_plane(frame.file, self._raw_size_px) // self.step_dn


def refuse(applies: object, text: str) -> None:
    """Raise ``ValueError`` of this text where it applies."""
    if applies:
        raise ValueError(text)


def frames_of(folder: Path) -> list[Frame]:
    """The frames of ``folder``, by frames.csv or their names.

    Raises ``ValueError`` for a folder without frames and for a list that cannot be read.
    """
    refuse(not folder.is_dir(), f"folder = {str(folder)!r}: must be a folder of dark and flat frames")
    source = folder / _LIST if (folder / _LIST).is_file() else folder
    try:
        found = list(_named(folder) if source == folder else _listed(source))
    except (ValueError, csv.Error) as error:
        raise ValueError(f"{source}: {error}") from None
    refuse(not found, f"{folder}: no frames: must hold {_LIST}, or files named like flat_10ms_1.png")
    for frame in found:
        refuse(not frame.file.is_file(), f"{source}: file {frame.file.name!r}: must be a file in {folder}")
    return found


def _named(folder: Path) -> Iterator[Frame]:
    for path in sorted(folder.iterdir()):
        if match := _NAME.fullmatch(path.name):
            kind, number, unit = (group.lower() for group in match.groups())
            taken = {"file": path, "kind": kind, "exposure_s": float(number) * _UNITS[unit]}
            yield Frame.model_validate(taken)


def _listed(path: Path) -> Iterator[Frame]:
    rows = csv.DictReader(read_text(path).splitlines(), skipinitialspace=True)
    for row in rows:
        given: dict[str, Any] = {str(name).strip(): value.strip() for name, value in row.items() if value}
        try:
            if "file" in given:
                given["file"] = path.parent / inside(given["file"])
            yield Frame.model_validate(given)
        except ValueError as error:
            text = str(error)
            if isinstance(error, ValidationError):
                fault = error.errors(include_url=False)[0]
                got = "" if fault["type"] == "missing" else f" = {fault['input']!r}"
                text = f"{fault['loc'][0]}{got}: {fault['msg'].replace('Input should', 'must')}"
            raise ValueError(f"line {rows.line_num}: {text}") from None


def read_plane(path: Path, raw_size_px: Size | None = None) -> Plane:
    """The numbers of one file. raw_size_px: (width, height) of files without a header.

    Raises ``ValueError`` for a lossy format, more than one channel, numbers that are not whole or do not fit into
    16 bits, and files that cannot be read; ``OSError`` where the file is missing.
    """
    check_regular(path)
    try:
        with path.open("rb") as file:
            lossy = "JPEG is lossy, which alters noise; must be PNG, TIFF, NPY or raw"
            refuse(file.read(3) == _JPEG, lossy)
        plane = READERS.get(path.suffix.lower(), _raw)(path, raw_size_px)
        colours = f"shape {plane.shape}: must be one plane, as the sensor gives it, not colours"
        refuse(plane.ndim != 2, colours)
        size = "{1} x {0}".format(*plane.shape)
        refuse(min(plane.shape) < SMALLEST_PX, f"{size} px: must be at least {SMALLEST_PX} x {SMALLEST_PX}")
    except ValueError as error:
        raise ValueError(f"{path}: {str(error).removeprefix(f'{path}: ')}") from None
    return plane if plane.dtype == np.uint8 else plane.astype(np.uint16)


def _array(path: Path, _: Size | None) -> NDArray[Any]:
    try:
        plane: NDArray[Any] = np.load(path, allow_pickle=False)
    except (ValueError, EOFError) as error:
        raise ValueError(f"is no NPY file: {error}") from None
    number = plane.dtype.kind in "uif"
    whole = number and ((plane >= 0) & (plane <= 65535) & (plane == np.round(plane))).all()
    refuse(not whole, "must hold whole numbers from 0 to 65535, as the converter gives them, not averages")
    return plane


def _headerless(path: Path, size_px: Size | None) -> NDArray[Any]:
    if size_px is None:
        raise ValueError("a file without a header: state its size with --raw-size WxH")
    width, height = size_px
    held = path.stat().st_size
    refuse(held != 2 * width * height, f"{held} bytes: must be 2 x {width} x {height}, 16 bits a pixel")
    return np.fromfile(path, "<u2").reshape(height, width)


def _raw(path: Path, _: Size | None) -> NDArray[Any]:
    try:
        import rawpy
    except ImportError:
        raise ValueError("needs the package rawpy: pip install 'blurnoise[raw]'") from None
    try:
        with rawpy.imread(str(path)) as raw:
            return np.array(raw.raw_image_visible, np.uint16)
    except rawpy.LibRawError as error:
        raise ValueError(f"is no picture that OpenCV or LibRaw reads ({error})") from None


READERS: Mapping[str, Callable[[Path, Size | None], NDArray[Any]]] = {
    **dict.fromkeys((".png", ".tif", ".tiff", ".pgm"), lambda path, _: decode(path)),
    **dict.fromkeys((".raw", ".bin"), _headerless),
    ".npy": _array,
}
"""By suffix, readers of planes; what has no entry goes to LibRaw."""
