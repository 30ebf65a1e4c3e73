"""Headers: keywords of FITS files, tags of TIFF and DNG files, and what they say of how a frame was taken.

FITS standard 4.0, sections 3 and 4; XBAYROFF, YBAYROFF and ROWORDER as Siril and ASTAP read them: the letters of
BAYERPAT begin at the picture's top left, moved by the offsets, and a file that is BOTTOM-UP begins with the last row.
"""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Mapping
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
_KIND_KEYS = ("IMAGETYP", "FRAMETYP", "OBSTYPE", "FRAME")  # INDI's is the last, beside IMAGETYP
_AVERAGES = ("NCOMBINE", "STACKCNT", "SNAPSHOT")  # of IRAF, Siril, MaxIm DL: frames in this one
_MILLI = re.compile(r"\b(ms|msecs?|milliseconds?)\b|\b([uµμ]s|usecs?|microseconds?)\b", re.IGNORECASE)
_BAYER = ("RGGB", "GRBG", "GBRG", "BGGR")


def refuse(applies: object, text: str) -> None:
    """Raise ``ValueError`` of this text where it applies."""
    if applies:
        raise ValueError(text)


def fits_header(path: Path) -> tuple[dict[str, Any], int]:
    """Keywords of the primary header, and where the array begins. Exposures are in seconds, by their comment."""
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
    """Of a header. Raises ``ValueError`` for what is no number."""
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
    held = path.stat().st_size
    refuse(held < needed, f"has {held} bytes; must have {needed} according to its header")
    values: NDArray[Any] = np.memmap(path, kind, "r", start, tuple(axes))
    return values.reshape(-1, *axes[-2:]), header


def fits_taken(path: Path) -> dict[str, Any]:
    """What the header says of the frame, as ``Format.taken``."""
    values, header = fits(path)
    number(header, "GAIN", 0.0)
    names = {
        "exposure_s": ("EXPTIME", "EXPOSURE"), "gain_setting": ("GAIN",), "temperature_c": ("CCD-TEMP", "TEMPERAT"),
    }  # fmt: skip
    found = {field: header[key] for field, keys in names.items() for key in keys[::-1] if key in header}
    notes = []
    both = [header[key] for key in names["exposure_s"] if isinstance(header.get(key), float)]
    if len(both) == 2 and not math.isclose(*both, rel_tol=0.01):
        notes.append("EXPTIME = {:g} but EXPOSURE = {:g}; EXPTIME is used".format(*both))
    words = [str(header[key]) for key in _KIND_KEYS if str(header.get(key, "")).strip()]
    if words and (len(words) > 1 or "FRAME" not in header or any(kind_of(words[0]))):  # else of coordinates
        found["words"] = next((text for text in words if any(kind_of(text))), words[0])
    averaged = [key for key in _AVERAGES if isinstance(count := header.get(key), float) and count > 1]
    averaged += ["CALSTAT"] if header.get("CALSTAT") else []
    if averaged:
        found["processed"] = f"{averaged[0]} = {header[averaged[0]]}"
    stated = str(header.get("BAYERPAT") or header.get("COLORTYP") or "").upper()
    if stated in _BAYER:
        found["cfa"] = _letters(stated, header, values.shape[1])
        if found["cfa"] != stated:
            by = ", ".join(
                key for key in ("XBAYROFF", "YBAYROFF", "BAYOFFX", "BAYOFFY", "ROWORDER") if key in header
            )
            notes.append(f"{stated} in the header is {found['cfa']} from the file's first row on, by {by}")
    elif stated and "BAYERPAT" in header:
        notes.append(f"BAYERPAT = {stated!r} is not used; set --cfa")
    return {**found, "notes": notes}


def _letters(pattern: str, header: Mapping[str, Any], height: int) -> str:
    """The mosaic from the file's first pixel on."""
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
    """All directories of a TIFF file: the chain, those below them, and EXIF's."""
    found: list[Tags] = []
    with path.open("rb") as file, warnings.catch_warnings():
        warnings.simplefilter("error")  # of entries that are cut short
        head = file.read(8)
        refuse(head[:4] not in (b"II*\0", b"MM\0*"), "is not a DNG file; it does not begin like a TIFF file")
        places = [int.from_bytes(head[4:8], "little" if head[:2] == b"II" else "big")]
        for place in places:  # which grows
            directory = ImageFileDirectory_v2(head)
            try:
                file.seek(place)
                directory.load(file)
                found.append(dict(directory))
            except Exception as error:  # Pillow raises all sorts
                raise ValueError(f"is not a valid DNG file: {error}") from None
            below = [*numbers(directory, SUB_DIRECTORIES), *numbers(directory, EXIF), directory.next]
            places += [int(each) for each in below if each and each not in places]
    refuse(not any(found), "is not a DNG file; it has no tags")
    return found


def numbers(tags: Tags, tag: int, default: Any = ()) -> list[float]:
    """A tag's numbers, one or many, NaN for fractions over 0; those of ``default`` without it."""
    value = tags.get(tag, default)
    return [float(each) for each in (value if isinstance(value, (tuple, list)) else (value,))]


def linearized(tags: Tags) -> str:
    """How a raw picture's numbers were stretched by a LinearizationTable, "" where they were not."""
    table = numbers(tags, LINEARIZATION)
    if not table:
        return ""
    return f"a LinearizationTable spreads {len(table)} stored numbers to {max(table):g}"
