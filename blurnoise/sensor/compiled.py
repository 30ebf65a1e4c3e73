"""A piece of exposures, light to digital numbers in one compiled pass: :mod:`blurnoise.sensor.piece` by Numba.

Domain: float32, the laws "none" and "merged". Convention: rounding is where ``piece`` does it, and products
and sums fused where PyTorch and OpenCV fuse them: the same bits, which :mod:`blurnoise.sensor.fused` makes sure of
before it comes here. Other threads run meanwhile. The first import compiles, for seconds; later ones need not.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numba
import numpy as np
from numba import types
from numba.extending import intrinsic

from blurnoise._core.scratch import borrowed
from blurnoise.camera import Camera
from blurnoise.sensor import stages
from blurnoise.sensor.piece import BEYOND_DN, FAINT_E, Light, Plane, Planes, most_light, write
from blurnoise.sensor.stage import Law

_ZERO, _ONE, _TWO, _SIX = np.float32(0.0), np.float32(1.0), np.float32(2.0), np.float32(6.0)
_MOST_CODE = np.float32(65_535.0)
_WHOLE = np.float32(1 << 23)  # a float32 that has lost its fraction: adding it rounds, halves to even
_LEAST_VARIANCE = np.float32(1e-6)
_AT_ONCE = 2048  # values that stay in the first cache from pass to pass
_ROW, _CODES, _REAL, _FLAG = types.float32[::1], types.uint16[::1], types.float32, types.boolean
_NO_ROW = np.empty(0, np.float32)


def expose_piece(
    planes: Planes,
    of: slice,
    exposures: Sequence[Light],
    camera: Camera,
    law: Law,
    table: Plane | None,
) -> None:
    """As :func:`blurnoise.sensor.piece.expose_piece`."""
    gain_dn, well_e, read_noise_e = camera.system_gain_dn_per_e, camera.well_limit_e, camera.read_noise_e
    rows = planes.light, planes.normal, planes.read, planes.gain, planes.offset_e
    by_colour = [
        [_NO_ROW if row is None else np.ascontiguousarray(row[colour]) for row in rows]
        for colour in range(len(planes.light))
    ]
    noisy, shifted = law == "merged", planes.offset_e is not None
    flags = noisy, noisy and planes.read is not None, planes.gain is not None, shifted
    most = most_light(exposures, gain_dn)
    with borrowed([planes.light.shape], np.uint16) as (codes,):
        for white_e, dark_e, out, interleaved in exposures:
            scaled = dark_e > 0.0 or white_e <= FAINT_E or shifted
            unit_e = 1.0 if scaled else white_e
            root_e = math.sqrt(unit_e)
            figures = (
                *(most, white_e, dark_e, unit_e, min(well_e, BEYOND_DN / gain_dn) / unit_e),
                *(read_noise_e**2 / unit_e, -2 / 36 / unit_e, 1 / 6 / root_e),
                *(gain_dn * unit_e, gain_dn * root_e if noisy else 0.0, camera.black_level_dn),
                *(stages.nearly_full_e(camera) / unit_e, well_e, read_noise_e, gain_dn),
            )
            for fields, own in zip(by_colour, codes, strict=True):
                _codes_of_row(*fields, own, *flags, scaled, *figures)
            write(codes, camera.full_scale_dn, table, out[of] if interleaved else out[:, of], interleaved)


@intrinsic  # type: ignore[untyped-decorator]
def _fma(typing: Any, a: Any, b: Any, c: Any) -> Any:
    """A b + c, rounded once."""
    return _REAL(a, b, c), lambda context, builder, signature, values: builder.fma(*values)


@numba.njit(  # type: ignore[untyped-decorator]
    types.void(*[_ROW] * 5, _CODES, *[_FLAG] * 5, *[_REAL] * 15), nogil=True, cache=True, error_model="numpy"
)
def _codes_of_row(
    light: Any, normal: Any, read: Any, gain: Any, offset_e: Any, codes: Any,
    noisy: bool, well_clips: bool, gained: bool, shifted: bool, scaled: bool,
    most: float, white_e: float, dark_e: float, unit_e: float, most_mean: float,
    read_variance: float, of_skew: float, of_bend: float,
    of_mean: float, of_noise: float, black_dn: float,
    nearly_full: float, well_e: float, read_noise_e: float, gain_dn: float,
) -> None:  # fmt: skip
    """Codes of 16 bits (n,) of one colour. Flags tell what counts: noisy: normal; well_clips: read; gained: gain;
    shifted: offset_e; scaled: white_e and dark_e, else what is in units of unit_e stays so."""
    count = len(light)
    electrons, noisy_e = np.empty(_AT_ONCE, np.float32), np.empty(_AT_ONCE, np.float32)
    for first in range(0, count, _AT_ONCE):
        last = min(first + _AT_ONCE, count)
        n = last - first
        mean, noise, out = electrons[:n], noisy_e[:n], codes[first:last]
        seen = light[first:last]
        if gained:
            factor = gain[first:last]
            for i in range(n):
                mean[i] = seen[i] * factor[i]
        else:
            for i in range(n):
                mean[i] = seen[i]
        for i in range(n):
            value = mean[i] if mean[i] > _ZERO else _ZERO
            mean[i] = value if value < most else most
        if scaled:
            for i in range(n):
                mean[i] = mean[i] * white_e + dark_e
        if noisy:
            drawn = normal[first:last]
            for i in range(n):
                z = drawn[i]
                variance = mean[i] + read_variance
                skew = mean[i] / variance
                spread = np.sqrt(_fma(of_skew * skew, skew, variance))
                noise[i] = _fma(of_bend * skew, z * z - _ONE, spread * z)
        else:
            for i in range(n):
                noise[i] = _ZERO
                mean[i] = mean[i] if mean[i] < most_mean else most_mean
        shown = noisy_e[:0]
        if shifted:
            shown = offset_e[first:last]
        for i in range(n):
            value = mean[i] + shown[i] if shifted else mean[i]
            value = _fma(value, of_mean, _fma(noise[i], of_noise, black_dn))
            value = value if value > _ZERO else _ZERO
            value = value if value < _MOST_CODE else _MOST_CODE
            out[i] = np.uint16(np.int32(value + _WHOLE - _WHOLE))
        if well_clips:
            drawn, own = normal[first:last], read[first:last]
            for i in range(n):
                if mean[i] >= nearly_full:
                    z, mean_e = drawn[i], mean[i] * unit_e
                    variance = mean_e + _LEAST_VARIANCE
                    skew = mean_e / variance / _SIX
                    spread = variance - _TWO * skew * skew
                    spread = spread if spread > _LEAST_VARIANCE else _LEAST_VARIANCE
                    charge = mean_e - skew + (np.sqrt(spread) + skew * z) * z
                    charge = charge if charge > _ZERO else _ZERO
                    charge = charge if charge < well_e else well_e
                    charge += read_noise_e * own[i]
                    if shifted:
                        charge += shown[i]
                    value = charge * gain_dn + black_dn
                    value = value if value > _ZERO else _ZERO
                    value = value if value < _MOST_CODE else _MOST_CODE
                    out[i] = np.uint16(np.int32(value + _WHOLE - _WHOLE))
