"""DNG files: the camera that their tags describe. Nothing is decoded but tags, in any of the file's directories.

NoiseProfile states the variance S x + O of a value x in [0, 1] between black and white level. With K in DN/e- and
W = white - black, a mean of n electrons is x = K n/W and its shot noise K^2 n/W^2 = (K/W) x: so K = S W, and
the noise in the dark is sqrt(O)/S electrons, rounding included. Source: DNG specification 1.7.1, tag 51041.
"""

from __future__ import annotations

import math
import warnings
from collections import ChainMap
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from PIL.TiffImagePlugin import ImageFileDirectory_v2

from blurnoise.optics.camera import Camera
from blurnoise_eval.calibration.to_camera import Known, on_base
from blurnoise_eval.system.files import check_regular

NOISE_PROFILE, BLACK_LEVEL, WHITE_LEVEL, MODEL = 51041, 50714, 50717, 50708
_WIDTH, _HEIGHT, _BITS, _PHOTOMETRIC, _SUB, _EXIF, _F_NUMBER, _ISO = (
    256,
    257,
    258,
    262,
    330,
    34665,
    33437,
    34855,
)
_RAW = (32803, 34892)  # colour filter array, linear raw
_MOST_DIRECTORIES = 64
_GREEN = 1  # of NoiseProfile's planes, in the order red, green, blue
Tags = Mapping[int, Any]


def camera_of_dng(path: Path, *, base: str = "imx250") -> Camera:
    """The camera that a DNG file describes at its ISO; the rest as the preset ``base`` has it.

    Raises ``ValueError`` for no DNG, and for tags that are missing or make no camera; ``OSError`` as reading does.
    """
    check_regular(path)
    try:
        directories = _directories(path)
        raw = next((each for each in directories if each.get(_PHOTOMETRIC) in _RAW), directories[0])
        # a tag of the raw picture before that of its preview
        tags = ChainMap(dict(raw), *(dict(each) for each in directories))
        iso, f_number = (_numbers(tags, each, None)[0] for each in (_ISO, _F_NUMBER))
        at = "" if iso is None else f" at ISO {iso:g}"
        known = _levels(raw, tags, f"of {path.name}{at}")
        for name, tag in (("width_px", _WIDTH), ("height_px", _HEIGHT)):
            if tag in raw:
                known[name] = (int(raw[tag]), f"stated: size of the raw picture of {path.name}")
        if f_number is not None and f_number > 0:
            known["f_number"] = (f_number, f"stated: FNumber of {path.name}")
        return on_base(str(tags.get(MODEL) or path.stem).strip("\0 ") + at, known, base)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{path}: {error}") from None


def _levels(raw: Tags, tags: Tags, of: str) -> Known:
    """Gain, noise and levels, with their sources."""
    profile = _numbers(tags, NOISE_PROFILE, ())
    if not profile:
        raise ValueError("states no NoiseProfile (tag 51041); measure frames: blurnoise cameras fit FOLDER")
    if len(profile) % 2 or not np.isfinite(profile).all() or min(profile[::2]) <= 0:
        raise ValueError(f"NoiseProfile = {profile}: must be pairs of S > 0 and O")
    planes = len(profile) // 2
    used = min(_GREEN, planes - 1)
    scale, offset = profile[2 * used : 2 * used + 2]
    bits = int(max(_numbers(raw, _BITS, 16)))
    white = min(_numbers(raw, WHITE_LEVEL, 2**bits - 1))
    black = float(np.mean(_numbers(raw, BLACK_LEVEL, 0)))
    if not 0 <= black < white <= 65535:
        raise ValueError(
            f"BlackLevel = {black:g}, WhiteLevel = {white:g}: must be 0 <= black < white <= 65535"
        )
    span, gain = white - black, scale * (white - black)
    read_e = math.sqrt(max(0.0, offset - 1 / 12 / span**2)) / scale
    profiled = f"from NoiseProfile {of}" + ("" if planes == 1 else f", its plane {used + 1} of {planes}")
    whole = f"derived: the fewest bits that hold WhiteLevel {white:g}"
    depth = whole if WHITE_LEVEL in raw else "stated: BitsPerSample"
    level = "stated: BlackLevel" if BLACK_LEVEL in raw else "assumed: no BlackLevel, so 0,"
    return {
        "system_gain_dn_per_e": (gain, f"derived: S (white - black) {profiled}"),
        "read_noise_e": (read_e, f"derived: sqrt(O)/S {profiled}, less the rounding of 1/12 DN²"),
        "full_well_e": (span / gain, f"derived: white less black over K, {of}; the well may hold more"),
        "black_level_dn": (black, f"{level} {of}"),
        "bit_depth": (max(1, math.ceil(math.log2(white + 1))), f"{depth} {of}"),
    }


def _directories(path: Path) -> list[Tags]:
    """All directories of a TIFF file: the chain, those below them, and EXIF's."""
    found: list[Tags] = []
    with path.open("rb") as file, warnings.catch_warnings():
        warnings.simplefilter("error")  # of entries that are cut short
        head = file.read(8)
        if head[:4] not in (b"II*\0", b"MM\0*"):
            raise ValueError("is no DNG file: it does not begin as TIFF does")
        places = [int.from_bytes(head[4:8], "little" if head[:2] == b"II" else "big")]
        for place in places:  # which grows
            directory = ImageFileDirectory_v2(head)
            try:
                file.seek(place)
                directory.load(file)
                found.append(dict(directory))
            except Exception as error:  # Pillow raises all sorts
                raise ValueError(f"is no sound DNG file: {error}") from None
            below = [*_numbers(directory, _SUB, ()), *_numbers(directory, _EXIF, ()), directory.next]
            new = [int(each) for each in below if each and each not in places]
            places += new[: _MOST_DIRECTORIES - len(places)]
    if not any(found):
        raise ValueError("is no DNG file: it has no tags")
    return found


def _numbers(tags: Tags, tag: int, default: Any) -> list[Any]:
    """A tag's numbers, one or many, NaN for fractions over 0; those of ``default`` without it."""
    value = tags.get(tag, default)
    every = value if isinstance(value, (tuple, list)) else (value,)
    return [None if each is None else float(each) for each in every]
