"""Formats of frame files: the digital numbers of their planes, and their headers.

PNG, TIFF (each page is a frame) and PGM with one channel; NPY, (H, W) or (N, H, W); FITS, the primary array with two
or three axes; files without a header (.raw, .bin), in a ``RawLayout``; DNG and raw files of cameras, if the package
rawpy (LibRaw) is installed. A new format is an entry of ``FORMATS``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from blurnoise._core.checks import integer, one_of
from blurnoise_eval.calibration.headers import (
    FrameHeader,
    directories,
    fits,
    fits_frame,
    linearized,
    number,
    refuse,
)
from blurnoise_eval.datasets import decode
from blurnoise_eval.system.files import check_regular

Plane = NDArray[np.uint8] | NDArray[np.uint16]
"""Digital numbers of a frame, (H, W)."""
SMALLEST_PX = 32
RAW_SUFFIXES = (".dng", ".cr2", ".cr3", ".nef", ".arw", ".raf", ".rw2", ".orf", ".pef", ".srw")
_JPEG = b"\xff\xd8\xff"


class _Packing(NamedTuple):
    """A group of ``pixels`` with ``bits`` each in ``octets`` bytes. mipi: high bytes first, then all low bits."""

    bits: int
    pixels: int
    octets: int
    mipi: bool = False

    def row_bytes(self, width: int) -> int:
        """Bytes of ``width`` pixels; groups of MIPI are always complete."""
        return math.ceil(width / self.pixels) * self.octets if self.mipi else math.ceil(width * self.bits / 8)


PACKINGS = {
    "u8": _Packing(8, 1, 1), "u16": _Packing(16, 1, 2),
    "mipi10": _Packing(10, 4, 5, mipi=True), "mipi12": _Packing(12, 2, 3, mipi=True),
    "mono10p": _Packing(10, 4, 5), "mono12p": _Packing(12, 2, 3),
}  # fmt: skip
"""By name: little-endian 8 and 16 bits, RAW10 and RAW12 of MIPI CSI-2, Mono10p and Mono12p of GenICam (PFNC)."""


@dataclass(frozen=True)
class RawLayout:
    """Packing and size of frames without a header. stride: bytes from one row to the next."""

    packing: str
    width: int
    height: int
    stride: int

    @classmethod
    def parse(cls, text: str) -> RawLayout:
        """Read ``PACKING,WIDTHxHEIGHT`` or ``PACKING,WIDTHxHEIGHT,STRIDE``. Raises ``ValueError``.

        >>> RawLayout.parse("mipi10,4056x3040").stride
        5070
        """
        try:
            name, size, *stride = text.lower().split(",")
            width, height = (int(side) for side in size.split("x"))
            (row,) = [int(part) for part in stride] or [0]
        except ValueError:
            must = (
                "must be PACKING,WIDTHxHEIGHT or PACKING,WIDTHxHEIGHT,STRIDE, such as mipi10,4056x3040,5072"
            )
            raise ValueError(f"raw_layout = {text!r}: {must}") from None
        packing = PACKINGS[one_of("raw_layout", name, PACKINGS)]
        for side, pixels in (("width", width), ("height", height)):
            integer(f"raw_layout, {side}", pixels, 1, 100_000)
        least = packing.row_bytes(width)
        refuse(
            0 < row < least,
            f"raw_layout, stride = {row}: must be {least} or more, the bytes of {width} pixels",
        )
        return cls(name, width, height, row or least)

    @property
    def frame_bytes(self) -> int:
        """Bytes of a frame."""
        return self.stride * self.height

    def unpack(self, octets: NDArray[np.uint8]) -> NDArray[np.uint16]:
        """The digital numbers (H, W) of the bytes of a frame.

        >>> RawLayout.parse("mipi12,2x1").unpack(np.array([0x12, 0x34, 0x65], np.uint8)).tolist()
        [[293, 838]]
        """
        packing = PACKINGS[self.packing]
        bits, pixels, group, mipi = packing
        rows = octets.reshape(self.height, self.stride)[:, : packing.row_bytes(self.width)]
        groups = np.pad(rows, ((0, 0), (0, -rows.shape[1] % group))).reshape(self.height, -1, group)
        if mipi:
            low = bits - 8
            last = groups[..., pixels:] >> low * np.arange(pixels, dtype=np.uint8) & (1 << low) - 1
            numbers = groups[..., :pixels].astype(np.uint16) << low | last
        else:
            word = (groups.astype(np.int64) << 8 * np.arange(group)).sum(-1, keepdims=True)
            numbers = (word >> bits * np.arange(pixels) & (1 << bits) - 1).astype(np.uint16)
        return np.asarray(numbers.reshape(self.height, -1)[:, : self.width], np.uint16)


class Format(NamedTuple):
    """Functions that read a format: the digital numbers (H, W) of a page, the number of pages, and the header."""

    read: Callable[[Path, RawLayout | None, int], NDArray[Any]]
    pages: Callable[[Path, RawLayout | None], int] = lambda *_: 1
    header: Callable[[Path], FrameHeader] = lambda _: FrameHeader()


def format_of(path: Path) -> Format:
    """The format by the suffix; LibRaw for all others."""
    return FORMATS.get(path.suffix.lower(), _LIBRAW)


def read_plane(path: Path, layout: RawLayout | None = None, page: int = 0) -> Plane:
    """Read the digital numbers of one page of a file. layout: of files without a header.

    Raises ``ValueError`` for a lossy format, more than one channel, numbers that are no integers of 16 bits, and
    files that cannot be read; ``OSError`` if the file is missing.
    """
    with naming(path):
        with path.open("rb") as file:
            lossy = "is a JPEG file, whose compression changes the noise; must be PNG, TIFF, NPY, FITS or raw"
            refuse(file.read(3) == _JPEG, lossy)
        plane = format_of(path).read(path, layout, page)
        colours = f"shape = {plane.shape}: must be one channel of raw numbers, not colours"
        refuse(plane.ndim != 2, colours)
        size = "{1} x {0}".format(*plane.shape)
        refuse(
            min(plane.shape) < SMALLEST_PX,
            f"size = {size} px: must be at least {SMALLEST_PX} x {SMALLEST_PX}",
        )
    return plane if plane.dtype == np.uint8 else plane.astype(np.uint16)


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Name the file in errors. Raises ``ValueError`` and ``OSError`` if it is no regular file."""
    check_regular(path)
    try:
        yield
    except ValueError as error:
        raise ValueError(f"{path}: {str(error).removeprefix(f'{path}: ')}") from None


def _picture(path: Path, _: RawLayout | None, page: int) -> NDArray[Any]:
    if page == 0:
        return decode(path)
    read, planes = cv2.imreadmulti(str(path), start=page, count=1, flags=cv2.IMREAD_UNCHANGED)
    refuse(not read, f"page {page + 1} cannot be read")
    return np.asarray(planes[0])


def _tiff_pages(path: Path, _: RawLayout | None) -> int:
    """Number of directories in the chain (TIFF 6.0, BigTIFF); OpenCV only counts those before the first fault."""
    with path.open("rb") as file:
        head = file.read(16)
        order: Literal["little", "big"] = "little" if head[:2] == b"II" else "big"
        big = int.from_bytes(head[2:4], order) == 43
        count_bytes, entry, link = (8, 20, 8) if big else (2, 12, 4)
        offset = int.from_bytes(head[link : 2 * link], order)
        pages: list[int] = []
        while offset and offset not in pages:
            file.seek(offset)
            entries = int.from_bytes(file.read(count_bytes), order)
            file.seek(offset + count_bytes + entry * entries)
            following = file.read(link)
            refuse(len(following) < link, f"is incomplete; page {len(pages) + 1} cannot be read")
            pages.append(offset)
            offset = int.from_bytes(following, order)
    return max(1, len(pages))


def _array(path: Path) -> NDArray[Any]:
    try:
        values: NDArray[Any] = np.load(path, mmap_mode="r", allow_pickle=False)
    except Exception as error:  # NumPy evaluates the header as Python, which raises many types
        raise ValueError(f"is not an NPY file: {' '.join(str(error).split())[:200]}") from None
    refuse(not isinstance(values, np.ndarray), "is not an NPY file: it is an archive of arrays (NPZ)")
    refuse(values.ndim not in (2, 3), f"shape = {values.shape}: must be (H, W), or (N, H, W) for N frames")
    refuse(not values.size, f"shape = {values.shape}: must not be empty")
    return values if values.ndim == 3 else values[None]


def _whole(plane: NDArray[Any]) -> NDArray[Any]:
    number = plane.dtype.kind in "uif"
    whole = number and ((plane >= 0) & (plane <= 65535) & (plane == np.round(plane))).all()
    refuse(not whole, "must contain integers from 0 to 65535, not averages")
    return plane


def _bytes(path: Path, layout: RawLayout | None) -> NDArray[np.uint8]:
    if layout is None:
        names = ", ".join(PACKINGS)
        raise ValueError(f"has no header; set --raw-layout PACKING,WIDTHxHEIGHT (packing: {names})")
    size, of_frame = path.stat().st_size, layout.frame_bytes
    rows = f"{layout.height} rows of {layout.stride} bytes"
    refuse(
        not size or size % of_frame, f"has {size} bytes; must have {of_frame}, {rows}, or a multiple of it"
    )
    return np.memmap(path, np.uint8, "r").reshape(-1, of_frame)


def _headerless(path: Path, layout: RawLayout | None, page: int) -> NDArray[Any]:
    octets = _bytes(path, layout)[page]
    return layout.unpack(octets) if layout else octets


def _fits_plane(path: Path, _: RawLayout | None, page: int) -> NDArray[Any]:
    values, header = fits(path)
    scale, zero = number(header, "BSCALE", 1.0), number(header, "BZERO", 0.0)
    return _whole(scale * values[page].astype(np.float64) + zero)


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    try:
        import rawpy
    except ImportError:
        raise ValueError("needs the package rawpy: pip install 'blurnoise[raw]'") from None
    try:
        with rawpy.imread(str(path)) as raw:
            yield raw
    except rawpy.LibRawError as error:
        raise ValueError(f"must be a picture that OpenCV or LibRaw can read ({error})") from None


def _raw(path: Path, *_: object) -> NDArray[Any]:
    with _opened(path) as raw:
        return np.array(raw.raw_image_visible, np.uint16)


def _raw_header(path: Path) -> FrameHeader:
    header = FrameHeader()
    with _opened(path) as raw:
        if raw.other.iso_speed > 0:
            header.iso = raw.other.iso_speed
        if any(blacks := raw.black_level_per_channel):
            header.black_dn = float(np.mean(blacks))
        if raw.other.shutter_speed > 0:
            header.exposure_s = float(f"{raw.other.shutter_speed:.6g}")
        if raw.raw_pattern is not None and raw.raw_pattern.shape == (2, 2):
            header.cfa = "".join(
                chr(raw.color_desc[colour]) for colour in raw.raw_colors_visible[:2, :2].ravel()
            )
    if path.suffix.lower() == ".dng":
        with suppress(ValueError):  # Pillow cannot read all files that LibRaw can
            if stretched := "; ".join(filter(None, map(linearized, directories(path)))):
                header.notes.append(f"{stretched}: noise near black is of those steps")
    return header


_LIBRAW = Format(_raw, header=_raw_header)
FORMATS: Mapping[str, Format] = {
    **dict.fromkeys((".png", ".pgm"), Format(_picture)),
    **dict.fromkeys((".tif", ".tiff"), Format(_picture, _tiff_pages)),
    **dict.fromkeys((".raw", ".bin"), Format(_headerless, lambda path, layout: len(_bytes(path, layout)))),
    **dict.fromkeys((".fit", ".fits", ".fts"), Format(_fits_plane, lambda path, _: len(fits(path)[0]), fits_frame)),
    ".npy": Format(lambda path, _, page: _whole(_array(path)[page]), lambda path, _: len(_array(path))),
    **dict.fromkeys(RAW_SUFFIXES, _LIBRAW),
}  # fmt: skip
"""Formats by suffix."""
