"""Frames of a folder: which one is dark or flat, how long it was exposed, and the numbers it holds.

``frames.csv`` in the folder lists them (columns file, kind, exposure_s, and photons_per_px where the light is known);
without it the files' names do: ``dark_10ms_0.png``, ``flat_2.5ms_1.tif``, ``flat_500us_a.npy``, ``dark_1s.dng``.

Files: PNG, TIFF and PGM of one channel, NPY, headerless little-endian 16-bit planes (.raw, .bin) of a given size,
and whatever LibRaw reads (DNG and cameras' raw files) where the package rawpy is installed. A further format is an
entry of ``READERS``, a further way to list frames one of ``LISTS``.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from itertools import groupby
from pathlib import Path
from typing import Annotated, Any, Literal

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
Size = tuple[int, int]
SMALLEST_PX = 32
FEWEST_FLAT = 3
_NAME = re.compile(r"(dark|flat)_(\d+(?:\.\d+)?)(ns|us|ms|s)(?:_[^.]*)?\.\w+", re.IGNORECASE)
_UNITS = {"ns": 1e-9, "us": 1e-6, "ms": 1e-3, "s": 1.0}
_LOSSY = {b"\xff\xd8\xff": "JPEG", b"RIFF": "WebP", b"\x00\x00\x00\x0cJXL": "JPEG XL"}
_LOSSY_SUFFIXES = (".jpg", ".jpeg", ".webp", ".heic", ".heif", ".avif", ".jxl")


@dataclass(frozen=True)
class Frame:
    """A file and how it was taken; a column of frames.csv for each further field.

    photons_per_px: of flat frames, mean during the exposure; None where unknown.
    """

    path: Path
    kind: Kind
    exposure_s: Annotated[float, within("exposure_s")]
    photons_per_px: Annotated[float, Interval(ge=0.0, le=1e12)] | None = None

    def __post_init__(self) -> None:
        check_fields(self)

    @property
    def level(self) -> tuple[float, float, bool]:
        """What frames of one level have in common, in the order of levels."""
        light = -1.0 if self.photons_per_px is None else self.photons_per_px
        return self.exposure_s, light, self.kind == "flat"


_COLUMNS = ("file", "kind", "exposure_s")
_OPTIONAL = tuple(each.name for each in fields(Frame) if each.default is None)


class Folder:
    """Dark and flat levels of a folder: the frames of one exposure and light, by rising exposure.

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
        if not self.dark:
            raise ValueError("frames: no dark ones; must be two or more, with the lens covered")
        if (flat := len(self.flat)) < FEWEST_FLAT:
            raise ValueError(
                f"frames: flat ones of {flat} exposure{'s' * (flat != 1)}; must be of {FEWEST_FLAT} or more, better "
                "eight"
            )
        for path in [frames[0].path for frames in [*self.dark, *self.flat] if len(frames) < 2]:
            raise ValueError(
                f"{path}: alone; must be two frames of each level or more, to tell noise from pattern"
            )
        self.size_px, self.step_dn = self._surveyed()

    def _surveyed(self) -> tuple[Size, int]:
        """Size and step of all frames."""
        before: dict[str, str] = {}
        held = np.zeros(1 << 16, bool)
        for frame in [frame for frames in [*self.dark, *self.flat] for frame in frames]:
            plane = read_plane(frame.path, self._raw_size_px)
            held[plane] = True
            size, bits = "{1} x {0} px".format(*plane.shape), f"{8 * plane.itemsize} bits"
            for what, taken in (("sizes", size), ("depths", bits)):
                if before.setdefault(what, taken) != taken:
                    raise ValueError(
                        f"{frame.path}: mixed {what}, {taken}; the frames before it: {before[what]}"
                    )
        return (plane.shape[1], plane.shape[0]), max(1, int(np.gcd.reduce(np.flatnonzero(held))))

    def planes(self, frames: Sequence[Frame]) -> Iterator[Plane]:
        """The frames' numbers in steps of the converter, one after the other."""
        for frame in frames:
            yield read_plane(frame.path, self._raw_size_px) // self.step_dn

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
    listed = next((folder / name for name in LISTS if (folder / name).is_file()), None)
    try:
        found = _named(folder) if listed is None else LISTS[listed.name](listed)
    except (ValueError, csv.Error) as error:
        raise ValueError(f"{listed or folder}: {error}") from None
    if not found:
        raise ValueError(
            f"{folder}: no frames: must hold {' or '.join(LISTS)}, or files named like dark_10ms_0.png, "
            "flat_10ms_1.png"
        )
    for frame in found:
        if not frame.path.is_file():
            raise ValueError(f"{listed}: file {shown(str(frame.path.name))}: must be a file in {folder}")
    return found


def _named(folder: Path) -> list[Frame]:
    found = []
    for path in sorted(folder.iterdir()):
        if match := _NAME.fullmatch(path.name):
            kind, number, unit = (group.lower() for group in match.groups())
            found.append(Frame(path, "dark" if kind == "dark" else "flat", float(number) * _UNITS[unit]))
    return found


def _listed(path: Path) -> list[Frame]:
    """Of frames.csv, a row per frame."""
    rows = csv.DictReader(read_text(path).splitlines(), skipinitialspace=True)
    rows.fieldnames = [name.strip() for name in rows.fieldnames or ()]
    if missing := [name for name in _COLUMNS if name not in rows.fieldnames]:
        raise ValueError(f"has no column {missing[0]}; must have {', '.join(_COLUMNS)}")
    for name in rows.fieldnames:
        known("column", name, (*_COLUMNS, *_OPTIONAL))
    found = []
    for row in rows:
        texts = {name: (value or "").strip() for name, value in row.items() if isinstance(name, str)}
        try:
            if not texts["file"]:
                raise ValueError("file: must not be empty")
            kind: Any = texts["kind"]
            given = ["exposure_s", *(name for name in _OPTIONAL if kind == "flat" and texts.get(name))]
            numbers = {name: _number(name, texts[name]) for name in given}
            found.append(Frame(path.parent / inside(texts["file"]), kind, **numbers))
        except (TypeError, ValueError) as error:
            raise ValueError(f"line {rows.line_num}: {error}") from None
    return found


def _number(name: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise ValueError(f"{name} = {shown(text)}: must be a number") from None


def read_plane(path: Path, raw_size_px: Size | None = None) -> Plane:
    """The numbers of one file. raw_size_px: (width, height) of files without a header.

    Raises ``ValueError`` for a lossy format, more than one channel, numbers that are not whole or do not fit into
    16 bits, and files that cannot be read; ``OSError`` where the file is missing.
    """
    check_regular(path)
    with path.open("rb") as file:
        head = file.read(12)
    suffix = path.suffix.lower()
    lossy = next((name for magic, name in _LOSSY.items() if head.startswith(magic)), None)
    try:
        if lossy or suffix in _LOSSY_SUFFIXES:
            name = lossy or suffix[1:].upper()
            raise ValueError(
                f"{name} is a lossy format, which alters the noise; must be PNG, TIFF, NPY or raw"
            )
        plane = decode(path) if suffix in _PICTURES else READERS.get(suffix, _raw)(path, raw_size_px)
        if plane.ndim != 2:
            raise ValueError(
                f"shape {plane.shape}: must be one plane, (H, W), as the sensor gives it, not colours"
            )
        if min(plane.shape) < SMALLEST_PX:
            size = "{1} x {0}".format(*plane.shape)
            raise ValueError(f"{size} px: must be at least {SMALLEST_PX} x {SMALLEST_PX}")
    except ValueError as error:
        told = str(error)
        raise ValueError(told if told.startswith(str(path)) else f"{path}: {told}") from None
    kept: Plane = plane.astype(np.uint8) if plane.dtype == np.uint8 else plane.astype(np.uint16)
    return kept


def _array(path: Path, _: Size | None) -> NDArray[Any]:
    try:
        plane: NDArray[Any] = np.load(path, allow_pickle=False)
    except (ValueError, EOFError) as error:
        raise ValueError(f"is no NPY file: {error}") from None
    if plane.dtype.kind not in "uif" or not plane.size:
        raise ValueError(f"dtype {plane.dtype}: must be numbers")
    if not np.isfinite(plane).all() or (plane != np.round(plane)).any():
        raise ValueError("must hold whole numbers, as the converter gives them, not averages")
    if plane.min() < 0 or plane.max() > 65535:
        raise ValueError(f"holds {plane.min():g} to {plane.max():g}: must be within 0 and 65535")
    return plane


def _bare(path: Path, size_px: Size | None) -> NDArray[Any]:
    if size_px is None:
        raise ValueError("a file without a header: state its size with --raw-size WxH")
    width, height = size_px
    if path.stat().st_size != 2 * width * height:
        raise ValueError(f"{path.stat().st_size} bytes: must be 2 x {width} x {height}, 16 bits a pixel")
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
        said = error.args[0].decode() if error.args and isinstance(error.args[0], bytes) else str(error)
        raise ValueError(f"is no picture that OpenCV or LibRaw reads ({said})") from None


LISTS: Mapping[str, Callable[[Path], list[Frame]]] = {"frames.csv": _listed}
"""By the name of a file that lists a folder's frames, its reader."""
READERS: Mapping[str, Callable[[Path, Size | None], NDArray[Any]]] = {
    ".npy": _array,
    ".raw": _bare,
    ".bin": _bare,
}
"""By suffix, readers of planes beside OpenCV's; what has no entry goes to LibRaw."""
_PICTURES = (".png", ".tif", ".tiff", ".pgm")
