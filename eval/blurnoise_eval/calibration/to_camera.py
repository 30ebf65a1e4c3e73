"""Cameras of measured figures, and of what a DNG file's tags describe: every figure with its source.

What frames and tags cannot show is a preset's. Of DNG files nothing is decoded but tags, in any of their directories.
The black level of a pixel is BlackLevel of its place in the pattern plus BlackLevelDeltaH of its column plus
BlackLevelDeltaV of its row; here it is their mean. NoiseProfile states the variance S x + O of a value x in [0, 1]
between black and white level. With K in DN/e- and W = white - black, a mean of n electrons is x = K n/W and its
shot noise K^2 n/W^2 = (K/W) x: so K = S W, and the noise in the dark is sqrt(O)/S electrons, rounding included.
Source: DNG specification 1.7.1, tags 50714 to 50717, 50829, 51041.
"""

from __future__ import annotations

import math
import re
from collections import ChainMap
from pathlib import Path
from typing import Any

import numpy as np

from blurnoise._core.checks import one_of
from blurnoise.camera import PRESETS, Camera
from blurnoise.camera.camera_files import KEYS
from blurnoise.camera.gain import MeasuredGain
from blurnoise.metrics.values import Estimate
from blurnoise_eval.calibration.fit import Measurement
from blurnoise_eval.calibration.frames import refuse
from blurnoise_eval.calibration.headers import Tags, directories, linearized, numbers
from blurnoise_eval.cameras import find
from blurnoise_eval.system.files import check_regular

NOISE_PROFILE, BLACK_LEVEL, WHITE_LEVEL, MODEL = 51041, 50714, 50717, 50708
_BLACK_DELTAS = {50715: "BlackLevelDeltaH", 50716: "BlackLevelDeltaV"}
_WIDTH, _HEIGHT, _BITS, _PHOTOMETRIC, _ACTIVE_AREA = 256, 257, 258, 262, 50829
_F_NUMBER, _ISO = 33437, 34855
_RAW = (32803, 34892)  # colour filter array, linear raw
_COUNTED = "counted from "
_GREEN = 1  # of NoiseProfile's planes, in the order red, green, blue
Known = dict[str, tuple[Any, str]]
"""Values and their sources, by the camera's field."""


def camera_of(
    found: Measurement, name: str, *, base: str = "imx250", temperature_c: float | None = None
) -> Camera:
    """The camera that was measured. temperature_c: of the sensor meanwhile, for the dark current; ``base``: the
    preset for the rest (lens, pixel pitch, quantum efficiency without photons).

    Raises ``ValueError`` for an unknown preset, and where a figure is outside what a camera can have.
    """
    estimates, full_scale = found.estimates, 2**found.bit_depth - 1
    bits = "assumed: the fewest of 8, 10, 12, 14, 16 bits that hold the frames' numbers"
    if found.bits_given:
        bits = "stated with the frames"
    elif found.clip_dn == full_scale:
        bits = f"measured: frames clip at {full_scale} DN"
    known: Known = {"bit_depth": (found.bit_depth, bits)}
    for name_px, side in zip(("width_px", "height_px"), found.size_px, strict=True):
        known[name_px] = (side, "measured: size of the frames")
    for figure, estimate in estimates.items():
        source = f"measured: photon transfer of {found.frames}, 95 % {'-'.join(ends(estimate))}"
        if figure == "full_well_e" and (found.clip_dn or 0) >= full_scale:
            source += "; the converter clips there, the full well may be larger"
        source += "; 0 is within" if estimate.low <= 0 == estimate.value else ""
        doubted = [doubt.text for doubt in found.doubts if figure in doubt.figures]
        known[figure] = (estimate.value, "; doubtful: ".join([source, *doubted]))
    known.pop("linearity_error", None)
    if found.bend:
        factors = [f"{point.value:.3g} ({'-'.join(ends(point))})" for point in found.bend.factors[1:]]
        text = f"measured: variance over the line's, 95 %, {', '.join(factors)}; K is of the straight part"
        points = zip(found.bend.shares, found.bend.factors, strict=True)
        known["photon_transfer"] = (tuple((share, point.value) for share, point in points), text)
    preset = PRESETS[one_of("base", base, sorted(PRESETS))]
    known |= _gains(found, preset)
    if found.cfa and set(found.cfa) == set(preset.sensor.cfa):
        doubted = [doubt.text for doubt in found.doubts if "cfa" in doubt.figures]
        known["cfa"] = (found.cfa, "; doubtful: ".join(["stated with the frames", *doubted]))
    if "quantum_efficiency" in known and preset.sensor.cfa not in ("none", "mono"):
        of_green = f"{known['quantum_efficiency'][0]:.3g} in the frames' light and the green pixels"
        source = f"assumed, as of the preset {base}: measured was {of_green}, not of each colour"
        known["quantum_efficiency"] = (preset.sensor.quantum_efficiency, source)
    if "full_well_e" not in known:
        gain, black = (estimates[each].value for each in ("system_gain_dn_per_e", "black_level_dn"))
        limit = "assumed: the limit of the converter, as no frame clips"
        known["full_well_e"] = ((full_scale - black) / gain, limit)
    if "dark_current_e_s" not in estimates:
        part = "assumed: not measurable with one dark exposure; part of the black level"
        known["dark_current_e_s"] = (0.0, part)
    elif temperature_c is not None:
        known["dark_reference_c"] = (temperature_c, "stated with the frames")
    return on_base(name, known, base)


def _gains(found: Measurement, preset: Camera) -> Known:
    """What was measured at gains, or that nothing was."""
    lowest = f"; {_COUNTED}{found.lowest_db:g} dB, the lowest measured" if found.lowest_db else ""
    if not found.gains:
        law = f"assumed: from the preset {preset.name}, as the frames have one gain{lowest}"
        return {"read_noise_post_share": (preset.sensor.read_noise_post_share, law)}
    rows = [
        MeasuredGain(gain_db, **{name: estimate.value for name, estimate in figures.items()})
        for gain_db, figures in found.gains.items()
    ]
    intervals = [
        f"{gain_db:g} dB: " + ", ".join(f"{name} {'-'.join(ends(each))}" for name, each in figures.items())
        for gain_db, figures in found.gains.items()
    ]
    known: Known = {
        "gains": (tuple(rows), f"measured: photon transfer at each, 95 % at {'; '.join(intervals)}{lowest}"),
        "read_noise_post_share": (0.0, "not used: read noise was measured at gains"),
        "conversion_gains": ((), "not used: read noise was measured at gains"),
    }
    for limit in ("analogue_gain_max_db", "gain_max_db"):
        if preset.figure(limit) < max(found.gains):
            known[limit] = (max(found.gains), "measured: the highest gain of the frames")
    return known


def lowest_gain_db(camera: Camera) -> float:
    """The gain of the frames at which the camera's 0 dB was measured, by its sources; 0 where these name none."""
    found = re.search(rf"{_COUNTED}(\S+) dB", " ".join(map(str, camera.sources.values())))
    return float(found[1]) if found else 0.0


def on_base(name: str, known: Known, base: str) -> Camera:
    """The camera of ``known`` values and sources; the rest from ``base``: a preset's is called assumed.

    Raises ``ValueError`` for a name that is neither.
    """
    if not Path(base).is_file():
        one_of("base", base, sorted(PRESETS))
    camera = find(base)
    names = [key for key in KEYS if key not in ("name", "sources")]
    sources = dict.fromkeys(names, f"assumed, as of the preset {base}") if base in PRESETS else camera.sources
    return changed(camera.with_figures(name=name, sources=sources), known)


def changed(camera: Camera, known: Known) -> Camera:
    """The camera with other figures and their sources."""
    sources = {**camera.sources, **{name: source for name, (_, source) in known.items()}}
    figures = {name: value for name, (value, _) in known.items()}
    figures |= figures.pop("lens", {})  # of the lens over the field, as in camera files
    return camera.with_figures(**figures, sources=sources)


def ends(estimate: Estimate) -> tuple[str, str]:
    """Both ends of an interval in digits that tell them apart."""
    size, width = max(abs(estimate.low), abs(estimate.high)), estimate.high - estimate.low
    digits = 3 if width <= 0 else max(3, math.ceil(math.log10(size / width)) + 2)
    return f"{estimate.low:.{digits}g}", f"{estimate.high:.{digits}g}"


def camera_of_dng(path: Path, *, base: str = "imx250") -> Camera:
    """The camera that a DNG file describes at its ISO; the rest as the preset ``base`` has it.

    Raises ``ValueError`` for no DNG, and for tags that are missing or make no camera; ``OSError`` as reading does.
    """
    check_regular(path)
    try:
        every = directories(path)
        raw = next((each for each in every if each.get(_PHOTOMETRIC) in _RAW), every[0])
        # a tag of the raw picture before that of its preview
        tags = ChainMap(dict(raw), *(dict(each) for each in every))
        at = f" at ISO {numbers(tags, _ISO)[0]:g}" if _ISO in tags else ""
        known = _levels(raw, tags, f"of {path.name}{at}")
        whole = (0, 0, *numbers(raw, _HEIGHT), *numbers(raw, _WIDTH))
        area = numbers(raw, _ACTIVE_AREA, whole)
        if len(area) == 4:
            of_raw = (
                f"stated: {'ActiveArea' if _ACTIVE_AREA in raw else 'size'} of the raw picture of {path.name}"
            )
            known["width_px"], known["height_px"] = (
                (int(area[end + 2] - area[end]), of_raw) for end in (1, 0)
            )
        if numbers(tags, _F_NUMBER, 0)[0] > 0:
            known["f_number"] = (numbers(tags, _F_NUMBER)[0], f"stated: FNumber of {path.name}")
        return on_base(str(tags.get(MODEL) or path.stem).strip("\0 ") + at, known, base)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{path}: {error}") from None


def _levels(raw: Tags, tags: Tags, of: str) -> Known:
    """Gain, noise and levels, with their sources."""
    profile = numbers(tags, NOISE_PROFILE)
    refuse(not profile, "has no NoiseProfile (tag 51041); use frames: blurnoise cameras fit FOLDER")
    pairs = len(profile) % 2 == 0 and np.isfinite(profile).all() and min(profile[::2]) > 0
    refuse(not pairs, f"NoiseProfile = {profile}: must be pairs of S > 0 and O")
    planes = np.reshape(profile, (-1, 2)).tolist()
    used = min(_GREEN, len(planes) - 1)
    scale, offset = planes[used]
    bits = int(max(numbers(raw, _BITS, 16)))
    white = min(numbers(raw, WHITE_LEVEL, 2**bits - 1))
    deltas = [name for tag, name in _BLACK_DELTAS.items() if tag in raw]  # of each column, and of each row
    blacks = [np.mean(numbers(raw, tag, 0)) for tag in (BLACK_LEVEL, *_BLACK_DELTAS)]
    black, stated = float(np.sum(blacks)), " + ".join(["BlackLevel", *deltas])
    sound, levels = 0 <= black < white <= 65535, f"{stated} = {black:g}, WhiteLevel = {white:g}"
    refuse(not sound, f"{levels}: must be 0 <= black < white <= 65535")
    span, gain = white - black, scale * (white - black)
    read_e = math.sqrt(max(0.0, offset - 1 / 12 / span**2)) / scale
    profiled = f"from NoiseProfile {of}" + (f", its plane {used + 1} of {len(planes)}" if used else "")
    depth = f"derived: the fewest bits that hold WhiteLevel {white:g}"
    depth = depth if WHITE_LEVEL in raw else "stated: BitsPerSample"
    level = f"stated: mean of {stated}" if BLACK_LEVEL in raw or deltas else "assumed: no BlackLevel, so 0,"
    profiled += f"; {linearized(raw)}, counted here" if linearized(raw) else ""
    return {
        "system_gain_dn_per_e": (gain, f"derived: S (white - black) {profiled}"),
        "read_noise_e": (read_e, f"derived: sqrt(O)/S {profiled}, less the rounding of 1/12 DN²"),
        "full_well_e": (span / gain, f"derived: (white - black) / K, {of}; the full well may be larger"),
        "black_level_dn": (black, f"{level} {of}"),
        "bit_depth": (max(1, math.ceil(math.log2(white + 1))), f"{depth} {of}"),
    }
