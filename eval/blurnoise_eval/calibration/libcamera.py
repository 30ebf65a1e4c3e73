"""Cameras from tuning files of libcamera for Raspberry Pi, with values measured by its tool (utils/raspberrypi/ctt).

``rpi.noise``: noise over the root of the mean, 16-bit DN; its square is K. ``rpi.lux``: mean of the picture of a
chart, balanced to green, with the black level, at a given light, time and gain. ``rpi.ccm``, ``rpi.awb``: by colour
temperature, colour matrices, and red and blue over green of grey. ``rpi.alsc``: a 16 x 12 table of gains that correct
the shading of the lens. ``rpi.contrast``: the tone curve.

``rpi.sdn`` (libcamera 26bfadc6, sdn.cpp, noise.cpp, pisp.cpp): ``deviation`` times the noise of ``rpi.noise``, which
grows by the root of the gain, is what its filter takes for noise; ``strength`` is the filtered share of the result,
the rest is what "leaks". The filter's kernel is not published. ``rpi.sharpen``: threshold, strength and limit are
factors of figures in the driver or the hardware, which have no unit. ``rpi.contrast`` stretches the histogram of the
whole picture, so that it is no local tone curve. ``rpi.agc`` sets exposures, not pictures.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch

from blurnoise._core.files import read_document
from blurnoise.camera import Camera, colour
from blurnoise.camera.colour import FilterCurves
from blurnoise.camera.isp import NoiseReduction
from blurnoise.camera.lens import RelativeIllumination
from blurnoise.camera.radiometry import filter_electrons
from blurnoise.picture import steps
from blurnoise_eval.calibration.frames import Floats
from blurnoise_eval.calibration.headers import refuse
from blurnoise_eval.calibration.light import scaled, tied
from blurnoise_eval.calibration.to_camera import Known, changed, on_base

KELVIN = 5000.0
_LIT_BY = f"planck:{KELVIN:g}"
_CHART = 0.22  # 24 patches of mean 0.27 in the black frame of a ColorChecker, which covers a fifth
_HEIGHTS = tuple(np.linspace(0, 1, 9).tolist())  # of the field, for the relative illumination
_TABLE = (12, 16)
_DEVIATION, _STRENGTH = 3.2, 0.75  # of rpi.sdn where a file has none
_STEP_DB = 6.0  # of the table of noise reduction; a line between two rows is 1.5 % off the root
_YCBCR = ((0.299, 0.587, 0.114), (0.5, -0.4187, -0.0813), (-0.1687, -0.3313, 0.5))  # of JPEG: Y', Cr, Cb
Algorithms = Mapping[str, Any]


def camera_of_libcamera(path: Path, *, base: str, bit_depth: int | None = None) -> Camera:
    """The camera of a tuning file at gain 1 and about 5000 K; the other figures are those of ``base``.

    bit_depth: of the converter, which is not in the file; None: that of ``base``. Raises ``ValueError`` for other
    files, ``OSError`` as reading does.
    """
    try:
        refuse(path.suffix.lower() != ".json", "must be a tuning file of libcamera, MODULE.json")
        document = read_document(path)
        listed: Any = document.get("algorithms") if isinstance(document, Mapping) else None
        refuse(
            not isinstance(listed, list),
            "must be a tuning file of libcamera for Raspberry Pi, with 'algorithms'",
        )
        algorithms = {
            name: of for entry in listed if isinstance(entry, Mapping) for name, of in entry.items()
        }
        bits: Known = {} if bit_depth is None else {"bit_depth": (bit_depth, "from --bit-depth")}
        camera = on_base(path.stem, bits, base)
        camera = changed(camera, _levels(algorithms, camera, path.name))
        camera = changed(camera, _colours(algorithms, camera, path.name))
        camera = changed(camera, _enhancement(algorithms, camera, path.name))
        return changed(camera, _light(algorithms, camera, path.name))
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        text = f"has no {error}" if isinstance(error, KeyError) else str(error)
        raise ValueError(f"{path}: {text}") from None


def _levels(of: Algorithms, camera: Camera, file: str) -> Known:
    """Gain, noise and levels."""
    per_dn = 2.0 ** (16 - camera.sensor.bit_depth)
    slope, constant = (float(of["rpi.noise"][f"reference_{name}"]) for name in ("slope", "constant"))
    refuse(not slope > 0, f"rpi.noise: reference_slope = {slope:g}: must be > 0")
    black = float(of["rpi.black_level"]["black_level"]) / per_dn
    gain = slope**2 / per_dn
    known: Known = {
        "system_gain_dn_per_e": (
            gain,
            f"derived: rpi.noise of {file}, slope squared; measured on patches, fixed pattern included",
        ),
        "black_level_dn": (black, f"derived: rpi.black_level of {file}"),
        "full_well_e": (
            (camera.sensor.full_scale_dn - black) / gain,
            "derived: (full scale - black) / K; the full well may be larger",
        ),
    }
    if constant > 0:
        known["read_noise_e"] = (constant / slope**2, f"derived: rpi.noise of {file}, reference_constant")
    if curve := of.get("rpi.contrast", {}).get("gamma_curve"):
        points = np.reshape(curve, (-1, 2)) / 65535
        text = f"derived: rpi.contrast of {file}, gamma_curve, without its adaptive part"
        known["tone"] = (tuple(map(tuple, points.tolist())), text)
    return known


def _colours(of: Algorithms, camera: Camera, file: str) -> Known:
    """Colour matrix, and filters scaled to the red and blue of grey; nothing without a Bayer pattern."""
    curves = camera.sensor.quantum_efficiency
    if not isinstance(curves, FilterCurves) or not {"R", "G", "B"} <= {*camera.sensor.cfa}:
        return {}
    near = min(of["rpi.ccm"]["ccms"], key=lambda entry: abs(entry["ct"] - KELVIN))
    rows = np.reshape(near["ccm"], (3, 3))
    matrix = tuple(map(tuple, (rows / rows.sum(1, keepdims=True)).tolist()))
    kelvin, *shares = np.reshape(of["rpi.awb"]["ct_curve"], (-1, 3)).T
    electrons = filter_electrons(camera, _LIT_BY)
    for letter, name, share in zip("RB", ("red", "blue"), shares, strict=True):
        wanted = float(np.interp(KELVIN, kelvin, share))
        curves = scaled(curves, wanted * electrons["G"] / electrons[letter], name)
    balanced = f"red and blue scaled to rpi.awb of {file}, ct_curve at {KELVIN:g} K"
    return {
        "ccm": (matrix, f"derived: rpi.ccm of {file} of {near['ct']:g} K, the nearest to {KELVIN:g} K"),
        "quantum_efficiency": (curves, f"{camera.sources['quantum_efficiency']}; {balanced}"),
    }


def _enhancement(of: Algorithms, camera: Camera, file: str) -> Known:
    """Noise reduction by gain; of sharpening and local tone what the file has, which is not converted."""
    known: Known = {}
    if "rpi.sharpen" in of:
        figures = ", ".join(f"{name} {value}" for name, value in of["rpi.sharpen"].items()) or "defaults"
        text = f"not read: rpi.sharpen of {file} ({figures}) is in units of its hardware"
        known["sharpening"] = ((), text)
    if of.get("rpi.contrast", {}).get("ce_enable", 1):
        text = (
            f"none: rpi.contrast of {file} stretches the histogram of whole pictures, which is not simulated"
        )
        known["local_tone"] = (None, text)
    if "rpi.sdn" not in of:
        return known
    deviation, strength = (
        float(of["rpi.sdn"].get(*each)) for each in (("deviation", _DEVIATION), ("strength", _STRENGTH))
    )
    luma_dn, chroma_dn = (deviation * noise_dn for noise_dn in _noise_dn(of, camera))
    rows = []
    for gain_db in np.arange(0.0, camera.sensor.gain_max_db + _STEP_DB, _STEP_DB):
        more = 10 ** (gain_db / 40)
        luma, chroma = (round(min(255.0, sigma_dn * more), 2) for sigma_dn in (luma_dn, chroma_dn))
        rows.append(NoiseReduction(float(gain_db), luma, chroma, strength))
    text = (
        f"derived: rpi.sdn of {file}, {deviation:g} times rpi.noise, on grey behind white balance, matrix and tone "
        "curve, mean over its numbers, times the root of the gain; assumed: a bilateral filter, as libcamera's "
        "is not published"
    )
    return known | {"noise_reduction": (tuple(rows), text)}


def _noise_dn(of: Algorithms, camera: Camera) -> tuple[float, float]:
    """Noise of luma and of chroma in the developed picture of grey at gain 1, DN of 8 bits, without demosaicing."""
    most = 65535.0 - float(of["rpi.black_level"]["black_level"])
    slope, constant = (float(of["rpi.noise"][f"reference_{name}"]) for name in ("slope", "constant"))
    edges = torch.linspace(0.0, 1.0, 1025, dtype=torch.float64) ** 2  # fine where curves are steep
    step = np.diff(colour.toned(edges, camera.isp.tone).numpy())
    light = (edges[1:] + edges[:-1]).numpy() / 2
    each = 255 * step / np.diff(edges.numpy()) * (constant + slope * np.sqrt(light * most)) / most
    mean_dn = float(np.average(each, weights=step))
    if not {*"RGB"} <= {*camera.sensor.cfa}:
        return mean_dn, mean_dn
    # A filter of gain g is at 1 / g of green's level, with the root of its noise, and is amplified by g.
    gains = dict(zip(camera.sensor.cfa, steps.site_gains(camera, _LIT_BY), strict=True))
    roots = np.sqrt([gains[letter] for letter in "RGB"])
    luma, *chroma = np.linalg.norm(np.array(_YCBCR) @ colour.normalised(camera.isp.ccm) * roots, axis=1)
    return mean_dn * float(luma), mean_dn * float(np.sqrt(np.mean(np.square(chroma))))


def _light(of: Algorithms, camera: Camera, file: str) -> Known:
    """Relative illumination of the lens, and electrons per lux second."""
    known: Known = {}
    if table := of.get("rpi.alsc", {}).get("luminance_lut"):
        curve, off = _radial(1 / np.reshape(table, _TABLE), camera)
        text = f"derived: rpi.alsc of {file}, luminance_lut, by distance from the centre; {off:.1%} RMS beside that"
        known["lens"] = ({"relative_illumination": curve}, text)
    lit, camera = of["rpi.lux"], changed(camera, known)
    lux_s, gain = lit["reference_lux"] * lit["reference_shutter_speed"] / 1e6, float(lit["reference_gain"])
    per_dn = 2.0 ** (16 - camera.sensor.bit_depth) * camera.sensor.system_gain_dn_per_e * gain
    mean_e = (lit["reference_Y"] - of["rpi.black_level"]["black_level"]) / per_dn
    source = (
        f"derived: rpi.lux of {file}, a ColorChecker with mean reflectance {_CHART:g} (assumed, to within a third; "
        "the file does not contain it)"
    )
    return known | tied(camera, mean_e / (lux_s * _CHART), source, _LIT_BY)


def _radial(light: Floats, camera: Camera) -> tuple[RelativeIllumination, float]:
    """Relative illumination by distance from the centre, and the RMS residual, relative to the maximum."""
    y, x = (np.arange(side) + 0.5 - side / 2 for side in light.shape)
    across, down = x / len(x) * camera.sensor.width_px, y / len(y) * camera.sensor.height_px
    heights = np.hypot(down[:, None], across) / camera.field.corner_px
    near = np.maximum(0, 1 - np.abs(heights[..., None] - _HEIGHTS) * (len(_HEIGHTS) - 1)).reshape(
        -1, len(_HEIGHTS)
    )
    values, *_ = np.linalg.lstsq(near, light.ravel())
    off = float((near @ values - light.ravel()).std() / values.max())
    shares = np.minimum(1.0, values / values.max())
    return RelativeIllumination(_HEIGHTS, tuple(np.round(shares, 4).tolist())), off
