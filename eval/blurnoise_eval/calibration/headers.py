"""Headers: keywords of FITS files, tags of TIFF and DNG files, and how the frame was taken.

FITS standard 4.0, sections 3 and 4; XBAYROFF, YBAYROFF and ROWORDER as Siril and ASTAP read them: the letters of
BAYERPAT begin at the top left of the picture, moved by the offsets; a BOTTOM-UP file begins with the last row.
"""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL.TiffImagePlugin import ImageFileDirectory_v2

from blurnoise_eval.calibration.names import kind_of

Tags = Mapping[int, Any]
SUB_DIRECTORIES, EXIF, LINEARIZATION = 330, 34665, 50712
_BLOCK, _CARD = 2880, 80
_NUMBERS = {8: "u1", 16: ">i2", 32: ">i4", -32: ">f4", -64: ">f8"}
_KIND_KEYS = ("IMAGETYP", "FRAMETYP", "OBSTYPE", "FRAME")  # the last is that of INDI, in addition to IMAGETYP
_AVERAGES = ("NCOMBINE", "STACKCNT", "SNAPSHOT")  # of IRAF, Siril, MaxIm DL: frames in this one
_MILLI = re.compile(r"\b(ms|msecs?|milliseconds?)\b|\b([uµμ]s|usecs?|microseconds?)\b", re.IGNORECASE)
_BAYER = ("RGGB", "GRBG", "GBRG", "BGGR")


def refuse(applies: object, text: str) -> None:
    """Raise ``ValueError`` with this text if it applies."""
    if applies:
        raise ValueError(text)


@dataclass
class FrameHeader:
    """How a frame was taken, by the header of its file; None where it has no value.

    words: the kind in the words of the header. processed: the keyword that shows that this is no raw frame.
    """

    exposure_s: float | str | None = None
    temperature_c: float | str | None = None
    cfa: str | None = None
    iso: float | None = None
    gain_setting: float | None = None
    black_dn: float | None = None
    words: str = ""
    processed: str = ""
    notes: list[str] = field(default_factory=list)

    def fields(self) -> dict[str, Any]:
        """The fields of ``FrameFile`` that the header has."""
        values = {name: getattr(self, name) for name in ("exposure_s", "temperature_c", "cfa")}
        return {name: value for name, value in values.items() if value is not None}


def fits_header(path: Path) -> tuple[dict[str, Any], int]:
    """Keywords of the primary header, and the offset of the array. Exposures in seconds, by their comment."""
    header: dict[str, Any] = {}
    with path.open("rb") as file:
        while len(block := file.read(_BLOCK).decode("ascii", "replace")) == _BLOCK:
            for start in range(0, _BLOCK, _CARD):
                card = block[start : start + _CARD]
                name, value = card[:8].strip(), card[10:].strip()
                if name == "END":
                    return header, file.tell()
                if value.startswith("'"):
                    header[name] = value[1:].split("'")[0].strip()
                elif card[8:10] == "= ":
                    text, _, comment = value.partition("/")
                    header[name] = _value(text.strip())
                    unit = _MILLI.search(comment) if name in ("EXPTIME", "EXPOSURE") else None
                    if unit and isinstance(header[name], float):
                        header[name] *= 1e-3 if unit[1] else 1e-6
            refuse("SIMPLE" not in header, "is not a FITS file; it does not begin with SIMPLE")
    raise ValueError("is not a FITS file; its header has no END")


def _value(text: str) -> float | str:
    try:
        return float(text.replace("D", "E").replace(",", "."))
    except ValueError:
        return text


def number(header: Mapping[str, Any], key: str, default: float) -> float:
    """A number of a header. Raises ``ValueError`` for other values."""
    value = header.get(key, default)
    refuse(
        not (isinstance(value, float | int) and math.isfinite(value)), f"{key} = {value!r}: must be a number"
    )
    return float(value)


_MOST_AXES = 999  # of the FITS standard, section 4.4.1.1


def fits(path: Path) -> tuple[NDArray[Any], dict[str, Any]]:
    """The primary array (N, H, W) as it is stored, and the header."""
    header, start = fits_header(path)
    count = min(int(number(header, "NAXIS", 0)), _MOST_AXES)
    axes = [int(number(header, f"NAXIS{axis}", 0)) for axis in range(count, 0, -1)]
    two = len(axes) in (2, 3) and min(axes) > 0
    refuse(
        not two,
        f"axes = {axes}: must be 2 or 3 in the primary array (compressed extensions and tables are not supported)",
    )
    bits = int(number(header, "BITPIX", 0))
    kind = _NUMBERS.get(bits, "")
    refuse(not kind, f"BITPIX = {bits}: must be one of {', '.join(map(str, _NUMBERS))}")
    needed = start + np.dtype(kind).itemsize * math.prod(axes)
    size = path.stat().st_size
    refuse(size < needed, f"has {size} bytes; must have {needed} according to its header")
    values: NDArray[Any] = np.memmap(path, kind, "r", start, tuple(axes))
    return values.reshape(-1, *axes[-2:]), header


def fits_frame(path: Path) -> FrameHeader:
    """How the frame of a FITS file was taken."""
    values, keywords = fits(path)
    number(keywords, "GAIN", 0.0)  # refuses other values
    header = FrameHeader(
        exposure_s=keywords.get("EXPTIME", keywords.get("EXPOSURE")),
        temperature_c=keywords.get("CCD-TEMP", keywords.get("TEMPERAT")),
        gain_setting=keywords.get("GAIN"),
    )
    both = [keywords[key] for key in ("EXPTIME", "EXPOSURE") if isinstance(keywords.get(key), float)]
    if len(both) == 2 and not math.isclose(*both, rel_tol=0.01):
        header.notes.append("EXPTIME = {:g} but EXPOSURE = {:g}; EXPTIME is used".format(*both))
    words = [str(keywords[key]) for key in _KIND_KEYS if str(keywords.get(key, "")).strip()]
    # FRAME alone may be the frame of celestial coordinates
    if words and (len(words) > 1 or "FRAME" not in keywords or any(kind_of(words[0]))):
        header.words = next((text for text in words if any(kind_of(text))), words[0])
    averages = [key for key in _AVERAGES if isinstance(count := keywords.get(key), float) and count > 1]
    averages += ["CALSTAT"] if keywords.get("CALSTAT") else []
    if averages:
        header.processed = f"{averages[0]} = {keywords[averages[0]]}"
    pattern = str(keywords.get("BAYERPAT") or keywords.get("COLORTYP") or "").upper()
    if pattern in _BAYER:
        header.cfa = _letters(pattern, keywords, values.shape[1])
        if header.cfa != pattern:
            moved_by = ("XBAYROFF", "YBAYROFF", "BAYOFFX", "BAYOFFY", "ROWORDER")
            by = ", ".join(key for key in moved_by if key in keywords)
            header.notes.append(
                f"{pattern} in the header is {header.cfa} from the file's first row on, by {by}"
            )
    elif pattern and "BAYERPAT" in keywords:
        header.notes.append(f"BAYERPAT = {pattern!r} is not used; set --cfa")
    return header


def _letters(pattern: str, header: Mapping[str, Any], height: int) -> str:
    """The mosaic, beginning with the first pixel of the file."""
    across, down = (
        round(number(header, key, number(header, other, 0)))
        for key, other in (("XBAYROFF", "BAYOFFX"), ("YBAYROFF", "BAYOFFY"))
    )
    if str(header.get("ROWORDER", "")).upper().startswith("BOTTOM"):
        down += height - 1
    rows = [pattern[:2], pattern[2:]]
    turned = rows[::-1] if down % 2 else rows
    return "".join(row[::-1] if across % 2 else row for row in turned)


def directories(path: Path) -> list[Tags]:
    """All directories of a TIFF file: the chain, the directories below, and EXIF."""
    every: list[Tags] = []
    with path.open("rb") as file, warnings.catch_warnings():
        warnings.simplefilter("error")  # Pillow warns of incomplete entries
        head = file.read(8)
        refuse(head[:4] not in (b"II*\0", b"MM\0*"), "is not a DNG file; it does not begin like a TIFF file")
        offsets = [int.from_bytes(head[4:8], "little" if head[:2] == b"II" else "big")]
        for offset in offsets:  # which grows
            directory = ImageFileDirectory_v2(head)
            try:
                file.seek(offset)
                directory.load(file)
                every.append(dict(directory))
            except Exception as error:  # Pillow raises all sorts
                raise ValueError(f"is not a valid DNG file: {error}") from None
            below = [*numbers(directory, SUB_DIRECTORIES), *numbers(directory, EXIF), directory.next]
            offsets += [int(value) for value in below if value and value not in offsets]
    refuse(not any(every), "is not a DNG file; it has no tags")
    return every


def numbers(tags: Tags, tag: int, default: Any = ()) -> list[float]:
    """The numbers of a tag, or ``default``; a list also of one number; NaN for a fraction over 0.

    >>> numbers({256: 640, 258: (12, 12)}, 256), numbers({}, 258, 16)
    ([640.0], [16.0])
    """
    value = tags.get(tag, default)
    return [float(part) for part in (value if isinstance(value, (tuple, list)) else (value,))]


def linearized(tags: Tags) -> str:
    """How a LinearizationTable stretches the numbers of a raw picture, "" without one."""
    table = numbers(tags, LINEARIZATION)
    if not table:
        return ""
    return f"a LinearizationTable spreads {len(table)} stored numbers to {max(table):g}"
