"""Frames of a folder: which one is dark or flat, how long it was exposed, and the numbers it holds.

``frames.csv`` in the folder lists them (columns file, kind, exposure_s, and photons_per_px where the light is known);
without it the files' names do: ``dark_10ms_0.png``, ``flat_2.5ms_1.tif``, ``flat_500us_a.npy``, ``dark_1s.dng``.

Files: PNG, TIFF and PGM of one channel, NPY, headerless little-endian 16-bit planes (.raw, .bin) of a stated size,
and whatever LibRaw reads (DNG and cameras' raw files) where the package rawpy is installed.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, NoReturn

import numpy as np
from annotated_types import Interval
from numpy.typing import NDArray

from blurnoise._core.checks import check_fields, known, shown, within
from blurnoise._core.files import read_text
from blurnoise_eval.datasets import decode
from blurnoise_eval.system.files import check_regular, inside

Kind = Literal["dark", "flat"]
Plane = NDArray[np.uint8] | NDArray[np.uint16]
"""Digital numbers of a frame as the converter gave them, (H, W)."""
LIST = "frames.csv"
SMALLEST_PX = 32
_COLUMNS, _OPTIONAL = ("file", "kind", "exposure_s"), ("photons_per_px",)
_NAME = re.compile(r"(dark|flat)_(\d+(?:\.\d+)?)(ns|us|ms|s)(?:_[^.]*)?\.\w+", re.IGNORECASE)
_UNITS = {"ns": 1e-9, "us": 1e-6, "ms": 1e-3, "s": 1.0}
_PATTERN = "dark_10ms_0.png, flat_10ms_1.png"
_BARE = (".raw", ".bin")
_PICTURES = (".png", ".tif", ".tiff", ".pgm")
_LOSSY = {b"\xff\xd8\xff": "JPEG", b"RIFF": "WebP", b"\x00\x00\x00\x0cJXL": "JPEG XL"}
_LOSSY_SUFFIXES = (".jpg", ".jpeg", ".webp", ".heic", ".heif", ".avif", ".jxl")


@dataclass(frozen=True)
class Frame:
    """A file and how it was taken. photons_per_px: mean, during the exposure; None where unknown."""

    path: Path
    kind: Kind
    exposure_s: Annotated[float, within("exposure_s")]
    photons_per_px: Annotated[float, Interval(ge=0.0, le=1e12)] | None = None

    def __post_init__(self) -> None:
        check_fields(self)


class Folder:
    """Dark and flat levels of a folder: the frames of one exposure and light, by rising exposure.

    All frames must have one size and depth. size_px: (width, height), known once a frame was read.
    """

    def __init__(self, folder: Path, raw_size_px: tuple[int, int] | None = None) -> None:
        levels: dict[tuple[float, ...], list[Frame]] = {}
        for frame in frames_of(folder):
            light = -1.0 if frame.photons_per_px is None else frame.photons_per_px
            levels.setdefault((frame.exposure_s, light, frame.kind == "flat"), []).append(frame)
        ordered = [levels[key] for key in sorted(levels)]
        self.dark = [frames for frames in ordered if frames[0].kind == "dark"]
        self.flat = [frames for frames in ordered if frames[0].kind == "flat"]
        self.size_px = (0, 0)
        self._raw_size_px, self._bits = raw_size_px, 0

    def planes(self, frames: Sequence[Frame]) -> Iterator[Plane]:
        """The frames' numbers, one after the other. Raises ``ValueError`` for another size or depth."""
        for frame in frames:
            plane = read_plane(frame.path, self._raw_size_px)
            (height, width), bits = plane.shape, 8 * plane.itemsize
            if not self._bits:
                self.size_px, self._bits = (width, height), bits
            if self.size_px != (width, height):
                before = "{} x {}".format(*self.size_px)
                raise ValueError(
                    f"{frame.path}: mixed sizes, {width} x {height} px; the frames before it: {before}"
                )
            if self._bits != bits:
                raise ValueError(
                    f"{frame.path}: mixed depths, {bits} bits; the frames before it: {self._bits}"
                )
            yield plane

    def mean(self, frames: Sequence[Frame]) -> NDArray[np.float64]:
        """The mean (H, W) of these frames."""
        total = np.zeros(())
        for plane in self.planes(frames):
            total = total + plane
        return total / len(frames)


def frames_of(folder: Path) -> list[Frame]:
    """The frames of ``folder``, by its list or their names.

    Raises ``ValueError`` for a folder without frames and for a list that cannot be read.
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


def _named(folder: Path) -> list[Frame]:
    found = []
    for path in sorted(folder.iterdir()):
        if match := _NAME.fullmatch(path.name):
            kind, number, unit = match.groups()
            exposure_s = float(number) * _UNITS[unit.lower()]
            found.append(Frame(path, "dark" if kind.lower() == "dark" else "flat", exposure_s))
    return found


def _listed(path: Path) -> list[Frame]:
    try:
        rows = csv.DictReader(read_text(path).splitlines(), skipinitialspace=True)
        rows.fieldnames = [name.strip() for name in rows.fieldnames or ()]
        if missing := [name for name in _COLUMNS if name not in rows.fieldnames]:
            raise ValueError(f"has no column {missing[0]}; must have {', '.join(_COLUMNS)}")
        for name in rows.fieldnames:
            known("column", name, (*_COLUMNS, *_OPTIONAL))
        found = []
        for row in rows:
            try:
                found.append(_of_row(path.parent, row))
            except (TypeError, ValueError) as error:
                raise ValueError(f"line {rows.line_num}: {error}") from None
    except (ValueError, csv.Error) as error:
        raise ValueError(f"{path}: {error}") from None
    return found


def _of_row(folder: Path, row: dict[str, str | None]) -> Frame:
    texts = {name: (value or "").strip() for name, value in row.items() if isinstance(name, str)}
    if not texts["file"]:
        raise ValueError("file: must not be empty")
    kind: Any = texts["kind"]
    photons = _number("photons_per_px", texts) if texts.get("photons_per_px") and kind == "flat" else None
    return Frame(folder / inside(texts["file"]), kind, _number("exposure_s", texts), photons)


def _number(name: str, texts: dict[str, str]) -> float:
    try:
        return float(texts[name])
    except ValueError:
        raise ValueError(f"{name} = {shown(texts[name])}: must be a number") from None


def read_plane(path: Path, raw_size_px: tuple[int, int] | None = None) -> Plane:
    """The numbers of one file. raw_size_px: (width, height) of files without a header.

    Raises ``ValueError`` for a lossy format, more than one channel, numbers that are not whole or do not fit into
    16 bits, and files that cannot be read; ``OSError`` where the file is missing.
    """
    check_regular(path)
    with path.open("rb") as file:
        head = file.read(12)
    suffix = path.suffix.lower()
    lossy = next((name for magic, name in _LOSSY.items() if head.startswith(magic)), None)
    if lossy or suffix in _LOSSY_SUFFIXES:
        name = lossy or suffix[1:].upper()
        _refuse(path, f"{name} is a lossy format, which alters the noise; must be PNG, TIFF, NPY or raw")
    if suffix in _BARE:
        plane = _bare(path, raw_size_px)
    elif suffix == ".npy":
        plane = _array(path)
    else:
        plane = decode(path) if suffix in _PICTURES else _raw(path)
    if plane.ndim != 2:
        _refuse(path, f"shape {plane.shape}: must be one plane, (H, W), as the sensor gives it, not colours")
    if min(plane.shape) < SMALLEST_PX:
        height, width = plane.shape
        _refuse(path, f"{width} x {height} px: must be at least {SMALLEST_PX} x {SMALLEST_PX}")
    kept: Plane = plane.astype(np.uint8) if plane.dtype == np.uint8 else plane.astype(np.uint16)
    return kept


def _array(path: Path) -> NDArray[Any]:
    try:
        plane: NDArray[Any] = np.load(path, allow_pickle=False)
    except (ValueError, EOFError) as error:
        _refuse(path, f"is no NPY file: {error}")
    if plane.dtype.kind not in "uif" or not plane.size:
        _refuse(path, f"dtype {plane.dtype}: must be numbers")
    if not np.isfinite(plane).all() or (plane != np.round(plane)).any():
        _refuse(path, "must hold whole numbers, as the converter gives them, not averages")
    if plane.min() < 0 or plane.max() > 65535:
        _refuse(path, f"holds {plane.min():g} to {plane.max():g}: must be within 0 and 65535")
    return plane


def _bare(path: Path, size_px: tuple[int, int] | None) -> NDArray[Any]:
    if size_px is None:
        _refuse(path, "a file without a header: state its size with --raw-size WxH")
    width, height = size_px
    if path.stat().st_size != 2 * width * height:
        _refuse(path, f"{path.stat().st_size} bytes: must be 2 x {width} x {height}, 16 bits a pixel")
    return np.fromfile(path, "<u2").reshape(height, width)


def _raw(path: Path) -> NDArray[Any]:
    try:
        import rawpy
    except ImportError:
        _refuse(path, "needs the package rawpy: pip install 'blurnoise[raw]'")
    try:
        with rawpy.imread(str(path)) as raw:
            return np.array(raw.raw_image_visible, np.uint16)
    except rawpy.LibRawError as error:
        said = error.args[0].decode() if error.args and isinstance(error.args[0], bytes) else str(error)
        _refuse(path, f"is no picture that OpenCV or LibRaw reads ({said})")


def _refuse(path: Path, why: str) -> NoReturn:
    raise ValueError(f"{path}: {why}") from None
