"""Exposure of a photograph by its EXIF (JEITA CP-3451): time in s, ISO, f-number."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, NamedTuple

from PIL import Image

_EXIF, _TIME, _F_NUMBER, _ISO, _KIND = 0x8769, 33434, 33437, 34855, 34864
_LARGE_ISO = {1: 34865, 2: 34866, 3: 34867, 4: 34866, 5: 34865, 6: 34866, 7: 34866}
"""Tags of 32 bits with what the ISO is, by its kind; ISO itself has 16 and is 65535 where it is larger."""
_KINDS = {1: "SOS", 2: "REI", 3: "ISO speed", 4: "SOS, REI"}


class ExifExposure(NamedTuple):
    """Time in s, ISO and f-number, NaN where EXIF lacks one; kind: what the ISO is (SensitivityType), or ""."""

    exposure_s: float = math.nan
    iso: float = math.nan
    f_number: float = math.nan
    kind: str = ""


def exif_exposure(path: Path) -> ExifExposure:
    """Of a picture file. Raises ``OSError`` for a file that is no picture.

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     exif = Image.Exif()
    ...     exif.get_ifd(_EXIF).update({_TIME: 0.04, _ISO: 200})
    ...     Image.new("L", (8, 8)).save(f"{folder}/a.jpg", exif=exif)
    ...     exif_exposure(Path(folder, "a.jpg"))
    ExifExposure(exposure_s=0.04, iso=200.0, f_number=nan, kind='')
    """
    with Image.open(path) as picture:
        tags: Any = picture.getexif().get_ifd(_EXIF)
    time, iso, f_number = (_number(tags.get(tag)) for tag in (_TIME, _ISO, _F_NUMBER))
    if iso >= 65535:
        iso = _number(tags.get(_LARGE_ISO.get(tags.get(_KIND), 0)))
    return ExifExposure(time, iso, f_number, _KINDS.get(tags.get(_KIND), ""))


def _number(value: Any) -> float:
    """A tag that may be missing, a rational without denominator, or several numbers, of which the first counts."""
    first = value[0] if isinstance(value, tuple) and value else value
    try:
        return float(first) or math.nan
    except (TypeError, ValueError, ZeroDivisionError):
        return math.nan
