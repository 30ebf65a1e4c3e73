"""Cameras from the tags of DNG files: gain, noise and levels, each with its source.

Only tags are read, of any directory. The black level of a pixel is BlackLevel of its site in the pattern plus
BlackLevelDeltaH of its column plus BlackLevelDeltaV of its row; here it is their mean. NoiseProfile gives the
variance S x + O of a value x in [0, 1] between black and white level. With K in DN/e- and W = white - black, a mean
of n electrons is x = K n/W and its shot noise K^2 n/W^2 = (K/W) x: so K = S W, and the noise in the dark is sqrt(O)/S
electrons, rounding included: to counts, or to the numbers that a LinearizationTable has at black. Source: DNG
specification 1.7.1, tags 50712, 50714 to 50717, 50829, 51041.
"""

from __future__ import annotations

import math
from collections import ChainMap
from pathlib import Path

import numpy as np

from blurnoise.camera import Camera
from blurnoise_eval.calibration.headers import (
    LINEARIZATION,
    Tags,
    directories,
    linearized,
    numbers,
    refuse,
)
from blurnoise_eval.calibration.to_camera import Known, on_base
from blurnoise_eval.system.files import check_regular

NOISE_PROFILE, BLACK_LEVEL, WHITE_LEVEL, MODEL = 51041, 50714, 50717, 50708
_BLACK_DELTAS = {50715: "BlackLevelDeltaH", 50716: "BlackLevelDeltaV"}
_WIDTH, _HEIGHT, _BITS, _PHOTOMETRIC, _ACTIVE_AREA = 256, 257, 258, 262, 50829
_F_NUMBER, _ISO = 33437, 34855
_RAW = (32803, 34892)  # photometric interpretations: colour filter array, linear raw
_GREEN = 1  # index in the planes of NoiseProfile: red, green, blue


def camera_of_dng(path: Path, *, base: str = "imx250") -> Camera:
    """The camera of a DNG file at its ISO; the other figures are those of ``base``.

    Raises ``ValueError`` for other files, and for tags that are missing or impossible; ``OSError`` as reading does.
    """
    check_regular(path)
    try:
        every = directories(path)
        raw = next((tags for tags in every if tags.get(_PHOTOMETRIC) in _RAW), every[0])
        # tags of the raw picture take precedence over those of its preview
        tags = ChainMap(dict(raw), *map(dict, every))
        at = f" at ISO {numbers(tags, _ISO)[0]:g}" if _ISO in tags else ""
        known = _levels(raw, tags, f"of {path.name}{at}")
        whole = (0, 0, *numbers(raw, _HEIGHT), *numbers(raw, _WIDTH))
        area = numbers(raw, _ACTIVE_AREA, whole)
        if len(area) == 4:
            tag = "ActiveArea" if _ACTIVE_AREA in raw else "size"
            source = f"stated: {tag} of the raw picture of {path.name}"
            known["width_px"] = (int(area[3] - area[1]), source)
            known["height_px"] = (int(area[2] - area[0]), source)
        if numbers(tags, _F_NUMBER, 0)[0] > 0:
            known["f_number"] = (numbers(tags, _F_NUMBER)[0], f"stated: FNumber of {path.name}")
        return on_base(str(tags.get(MODEL) or path.stem).strip("\0 ") + at, known, base)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{path}: {error}") from None


def _levels(raw: Tags, tags: Tags, of: str) -> Known:
    """Gain, noise and levels. of: the file and its ISO, in words."""
    profile = numbers(tags, NOISE_PROFILE)
    refuse(not profile, "has no NoiseProfile (tag 51041); use frames: blurnoise cameras fit FOLDER")
    pairs = len(profile) % 2 == 0 and np.isfinite(profile).all() and min(profile[::2]) > 0
    refuse(not pairs, f"NoiseProfile = {profile}: must be pairs of S > 0 and O")
    planes = np.reshape(profile, (-1, 2)).tolist()
    used = min(_GREEN, len(planes) - 1)
    scale, offset = planes[used]
    bits = int(max(numbers(raw, _BITS, 16)))
    white = min(numbers(raw, WHITE_LEVEL, 2**bits - 1))
    deltas = [name for tag, name in _BLACK_DELTAS.items() if tag in raw]
    blacks = [np.mean(numbers(raw, tag, 0)) for tag in (BLACK_LEVEL, *_BLACK_DELTAS)]
    black, tags_of_black = float(np.sum(blacks)), " + ".join(["BlackLevel", *deltas])
    sound, levels = 0 <= black < white <= 65535, f"{tags_of_black} = {black:g}, WhiteLevel = {white:g}"
    refuse(not sound, f"{levels}: must be 0 <= black < white <= 65535")
    span, gain = white - black, scale * (white - black)
    step = _step_at(black, raw)
    read_e = math.sqrt(max(0.0, offset - step**2 / 12 / span**2)) / scale
    profiled = f"from NoiseProfile {of}" + (f", its plane {used + 1} of {len(planes)}" if used else "")
    depth = f"derived: the fewest bits that hold WhiteLevel {white:g}"
    depth = depth if WHITE_LEVEL in raw else "stated: BitsPerSample"
    level = (
        f"stated: mean of {tags_of_black}"
        if BLACK_LEVEL in raw or deltas
        else "assumed: no BlackLevel, so 0,"
    )
    rounding = f"the rounding of {step:g}²/12 DN²" if step > 1 else "the rounding of 1/12 DN²"
    rounding += f"; {linearized(raw)}, by {step:g} near black" if linearized(raw) else ""
    return {
        "system_gain_dn_per_e": (gain, f"derived: S (white - black) {profiled}"),
        "read_noise_e": (read_e, f"derived: sqrt(O)/S {profiled}, less {rounding}"),
        "full_well_e": (span / gain, f"derived: (white - black) / K, {of}; the full well may be larger"),
        "black_level_dn": (black, f"{level} {of}"),
        "bit_depth": (max(1, math.ceil(math.log2(white + 1))), f"{depth} {of}"),
    }


def _step_at(black: float, raw: Tags) -> float:
    """Distance of the numbers that a LinearizationTable has around the black level; 1 without a table."""
    table = np.unique(numbers(raw, LINEARIZATION))
    if len(table) < 2:
        return 1.0
    above = np.clip(np.searchsorted(table, black), 1, len(table) - 1)
    return float(table[above] - table[above - 1])
