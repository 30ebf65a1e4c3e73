"""TIFF files of unsigned integers, as TIFF 6.0 defines their pixels; BigTIFF too, in both orders of bytes.

OpenCV decodes the pixels. Of more than 8 bits it (5.0) ignores PhotometricInterpretation and PlanarConfiguration, and
fills 10, 12 and 14 bits up with zeros; this is corrected here. What neither it nor Pillow reads is an error.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from io import BytesIO
from typing import Any, NamedTuple

import cv2
import numpy as np
import PIL.Image
import PIL.ImageOps
from numpy.typing import NDArray

SUFFIXES = (".tif", ".tiff")
_WIDTH, _LENGTH, _BITS, _COMPRESSION, _PHOTOMETRIC = 256, 257, 258, 259, 262
_OFFSETS, _SAMPLES, _COUNTS, _PLANAR = 273, 277, 279, 284
_TILE_OFFSETS, _TILE_COUNTS, _EXTRA, _FORMAT, _SUBFILE = 324, 325, 338, 339, 254
_OF_A_PLANE = (
    _WIDTH,
    _LENGTH,
    _COMPRESSION,
    266,
    274,
    278,
    317,
    322,
    323,
)  # what each plane keeps of the page's tags
_SIZES = {1: (1, "B"), 3: (2, "H"), 4: (4, "I"), 16: (8, "Q")}
"""Types of numbers: bytes and code. Of the rest no tag is needed here."""
_MOST_VALUES = 1 << 22
_WHITE_IS_ZERO, _BLACK_IS_ZERO, _RGB = 0, 1, 2
_INTERPRETATIONS = {
    _WHITE_IS_ZERO: "white is zero", _BLACK_IS_ZERO: "black is zero", _RGB: "RGB", 3: "palette",
    4: "transparency mask", 5: "CMYK", 6: "YCbCr", 8: "CIELab", 9: "ICCLab", 10: "ITULab",
    32803: "a raw mosaic of colour filters", 32844: "LogL", 32845: "LogLuv", 34892: "linear raw light",
}  # fmt: skip
_ASSOCIATED = 1  # of ExtraSamples: colours are multiplied by the transparency
_READ_8, _READ_16 = (0, 1, 2, 3, 5, 6, 8), (_WHITE_IS_ZERO, _BLACK_IS_ZERO, _RGB)
_FORMATS = {2: "signed integers", 3: "floats", 5: "complex integers", 6: "complex floats"}


class Page(NamedTuple):
    """The tags of the first page as numbers, the file's order of bytes ("<" or ">"), and whether further pages
    follow that are no smaller copies."""

    tags: Mapping[int, tuple[int, ...]]
    order: str
    more: bool

    def one(self, tag: int, default: int = 0) -> int:
        """The first number of a tag."""
        return (self.tags.get(tag) or (default,))[0]

    @property
    def size_px(self) -> tuple[int, int]:
        """(width, height), as stored."""
        return self.one(_WIDTH), self.one(_LENGTH)

    @property
    def bits(self) -> int:
        """Of a value, the most of any channel."""
        return max(self.tags.get(_BITS) or (1,))

    @property
    def floats(self) -> bool:
        """Whether values are floats: linear light."""
        return self.one(_FORMAT, 1) == 3


def first_page(data: bytes) -> Page | None:
    """The first page of a TIFF; None for a file of another format. Raises ``ValueError`` for a broken directory."""
    order = {b"II": "<", b"MM": ">"}.get(data[:2])
    if order is None or len(data) < 8:
        return None
    version = struct.unpack_from(f"{order}H", data, 2)[0]
    if version not in (42, 43):
        return None
    try:
        begin = (
            struct.unpack_from(f"{order}Q", data, 8)
            if version == 43
            else struct.unpack_from(f"{order}I", data, 4)
        )
        tags, following = _directory(data, order, begin[0], big=version == 43)
        more = (
            bool(following)
            and not _directory(data, order, following, big=version == 43)[0].get(_SUBFILE, (0,))[0] & 1
        )
    except struct.error:
        raise ValueError("has a directory of tags that is cut off") from None
    return Page(tags, order, more)


def _directory(data: bytes, order: str, begin: int, *, big: bool) -> tuple[dict[int, tuple[int, ...]], int]:
    """Tags with whole numbers, and where the next directory is; 0: nowhere."""
    count_code, entry_code, inline, step = ("Q", "HHQ", 8, 20) if big else ("H", "HHI", 4, 12)
    count = struct.unpack_from(order + count_code, data, begin)[0]
    at = begin + struct.calcsize(order + count_code)
    if count > len(data) // step:
        raise struct.error
    tags = {}
    for entry in range(at, at + count * step, step):
        tag, kind, number = struct.unpack_from(order + entry_code, data, entry)
        if kind not in _SIZES or number > _MOST_VALUES:
            continue
        size, code = _SIZES[kind]
        values = entry + step - inline
        if size * number > inline:
            values = struct.unpack_from(order + ("Q" if big else "I"), data, values)[0]
        tags[tag] = struct.unpack_from(f"{order}{number}{code}", data, values)
    return tags, struct.unpack_from(order + ("Q" if big else "I"), data, at + count * step)[0]


def decode(data: bytes, page: Page) -> NDArray[Any]:
    """The first page's pixels as OpenCV orders them, (H, W) or (H, W, 3) BGR, without transparency. Raises
    ``ValueError`` that says why they cannot be read."""
    bits, meaning = page.bits, page.one(_PHOTOMETRIC, _BLACK_IS_ZERO)
    samples, kind = page.one(_SAMPLES, 1), page.one(_FORMAT, 1)
    name = _INTERPRETATIONS.get(meaning, f"PhotometricInterpretation {meaning}")
    if page.one(_SUBFILE) & 1:
        raise ValueError("begins with a smaller copy of a picture, as raw files do")
    if meaning not in (_READ_16 if bits > 8 else _READ_8) or (kind == 3 and meaning == _WHITE_IS_ZERO):
        raise ValueError(f"holds {name} with {bits} bits, which is not read; convert it to RGB")
    if samples > 4:
        raise ValueError(f"has {samples} channels; must have 1 to 4")
    if bits > 8 and samples > 1 and page.one(_PLANAR, 1) == 2:
        planes = [_decoded(_plane(data, page, number)) for number in range(3 if meaning == _RGB else 1)]
        pixels = None if any(plane is None for plane in planes) else np.dstack(planes[::-1])  # type: ignore[arg-type]
        pixels = pixels[..., 0] if pixels is not None and pixels.shape[2] == 1 else pixels
    else:
        pixels = _decoded(data)
        pixels = _by_pillow(data) if pixels is None and bits <= 8 else pixels
    if pixels is None:
        values = f"{bits}-bit {_FORMATS.get(kind, 'integers')}, compression {page.one(_COMPRESSION, 1)}"
        advice = "32-bit floats, grey or RGB without alpha" if kind == 3 else "an 8- or 16-bit PNG"
        raise ValueError(f"holds {name}, {values}, which OpenCV cannot decode; save it as {advice}")
    if pixels.dtype == np.uint16 and kind == 1:
        if 8 < bits < 16:  # OpenCV fills with zeros below
            pixels = np.round((pixels >> (16 - bits)) * (65535 / (2**bits - 1))).astype(np.uint16)
        if meaning == _WHITE_IS_ZERO:
            pixels = 65535 - pixels
        four = _decoded(data, cv2.IMREAD_UNCHANGED) if page.one(_EXTRA) == _ASSOCIATED else None
        if four is not None and four.shape[2:] == (4,):
            share = np.maximum(four[..., 3:], 1) / 65535
            pixels = np.round(np.minimum(four[..., :3] / share, 65535)).astype(np.uint16)
    elif kind in _FORMATS and pixels.dtype.kind != "f":
        raise ValueError(
            f"holds {_FORMATS[kind]}; must hold unsigned ones of 8 or 16 bits, or floats in one plane"
        )
    return pixels


def _decoded(data: bytes, how: int = cv2.IMREAD_ANYCOLOR | cv2.IMREAD_ANYDEPTH) -> NDArray[Any] | None:
    try:
        return cv2.imdecode(np.frombuffer(data, np.uint8), how)
    except cv2.error:
        return None


def _by_pillow(data: bytes) -> NDArray[np.uint8] | None:
    """Of 8 bits and less: further compressions, 2 and 4 bits, and tiles of odd sizes."""
    try:
        with PIL.Image.open(BytesIO(data)) as opened:
            grey = opened.mode in ("1", "L", "LA")
            turned = PIL.ImageOps.exif_transpose(opened).convert("L" if grey else "RGB")
    except Exception:  # Pillow raises all sorts
        return None
    return np.asarray(turned) if grey else np.asarray(turned)[..., ::-1]


def _plane(data: bytes, page: Page, number: int) -> bytes:
    """A plane as a grey picture: the same bytes with a directory of its own at their end."""
    samples = page.one(_SAMPLES, 1)
    tags = {tag: page.tags[tag] for tag in _OF_A_PLANE if tag in page.tags}
    tags |= {
        _BITS: (page.bits,),
        _PHOTOMETRIC: (_BLACK_IS_ZERO,),
        _SAMPLES: (1,),
        _PLANAR: (1,),
        _FORMAT: (1,),
    }
    for tag in (_OFFSETS, _COUNTS, _TILE_OFFSETS, _TILE_COUNTS):
        if offsets := page.tags.get(tag):
            tags[tag] = offsets[number * len(offsets) // samples : (number + 1) * len(offsets) // samples]
    begin = len(data) + len(data) % 2
    beyond = begin + 2 + 12 * len(tags) + 4
    entries, values = b"", b""
    for tag, numbers in sorted(tags.items()):
        packed = struct.pack(f"{page.order}{len(numbers)}I", *numbers)
        inline = packed if len(numbers) == 1 else struct.pack(f"{page.order}I", beyond + len(values))
        values += packed if len(numbers) > 1 else b""
        entries += struct.pack(f"{page.order}HHI", tag, 4, len(numbers)) + inline
    head = data[:2] + struct.pack(f"{page.order}HI", 42, begin)
    directory = struct.pack(f"{page.order}H", len(tags)) + entries + bytes(4)
    return head + data[8:].ljust(begin - 8, b"\0") + directory + values
