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
_TABLE, _SEEN = types.uint8[::1], types.uint8[:, ::1]
_NO_ROW, _NO_TABLE, _NOT_SEEN = np.empty(0, np.float32), np.empty(0, np.uint8), np.empty((0, 1), np.uint8)


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
    at_once = table is not None and table.dtype == np.uint8 and all(each.interleaved for each in exposures)
    with borrowed([planes.light.shape], np.uint16) as (codes,):
        for white_e, dark_e, out, interleaved in exposures:
            scaled = dark_e > 0.0 or white_e <= FAINT_E or shifted
            unit_e = 1.0 if scaled else white_e
            root_e = math.sqrt(unit_e)
            figures = (
                *(most, white_e if scaled else 1.0, dark_e if scaled else 0.0, unit_e),
                math.inf if noisy else min(well_e, BEYOND_DN / gain_dn) / unit_e,
                *((read_noise_e**2 / unit_e, -2 / 36 / unit_e, 1 / 6 / root_e) if noisy else (1.0, 0.0, 0.0)),
                *(gain_dn * unit_e, gain_dn * root_e if noisy else 0.0, camera.black_level_dn),
                *(stages.nearly_full_e(camera) / unit_e, well_e, read_noise_e, gain_dn),
            )
            seen, tones = (out[of], table) if at_once else (_NOT_SEEN, _NO_TABLE)
            for colour, (fields, own) in enumerate(zip(by_colour, codes, strict=True)):
                _codes_of_row(*fields, own, seen, colour, tones, *flags, *figures)
            if not at_once:
                write(codes, camera.full_scale_dn, table, out[of] if interleaved else out[:, of], interleaved)


@intrinsic  # type: ignore[untyped-decorator]
def _fma(typing: Any, a: Any, b: Any, c: Any) -> Any:
    """A b + c, rounded once."""
    return _REAL(a, b, c), lambda context, builder, signature, values: builder.fma(*values)


@numba.njit(inline="always")  # type: ignore[untyped-decorator]
def _mean(value: Any, most: float, white_e: float, dark_e: float, most_mean: float) -> Any:
    value = value if value > _ZERO else _ZERO
    value = (value if value < most else most) * white_e + dark_e
    return value if value < most_mean else most_mean


@numba.njit(  # type: ignore[untyped-decorator]
    types.void(*[_ROW] * 5, _CODES, _SEEN, types.int64, _TABLE, *[_FLAG] * 4, *[_REAL] * 15),
    nogil=True,
    cache=True,
    error_model="numpy",
)
def _codes_of_row(
    light: Any, normal: Any, read: Any, gain: Any, offset_e: Any,
    codes: Any, seen: Any, colour: int, table: Any,
    noisy: bool, well_clips: bool, gained: bool, shifted: bool,
    most: float, white_e: float, dark_e: float, unit_e: float, most_mean: float,
    read_variance: float, of_skew: float, of_bend: float,
    of_mean: float, of_noise: float, black_dn: float,
    nearly_full: float, well_e: float, read_noise_e: float, gain_dn: float,
) -> None:  # fmt: skip
    """Codes of 16 bits (n,) of one colour; or, where there is a table, what it has for them, in seen (n, C).

    Flags tell what counts: noisy: normal; well_clips: read; gained: gain; shifted: offset_e. What does not is 0, or a
    factor 1, which rounds nothing: a loop without branches takes less time.
    """
    count = len(light)
    none, one = np.zeros(_AT_ONCE, np.float32), np.ones(_AT_ONCE, np.float32)
    for first in range(0, count, _AT_ONCE):
        last = min(first + _AT_ONCE, count)
        n = last - first
        lit, out = light[first:last], codes[first:last]
        factor = gain[first:last] if gained else one[:n]
        drawn = normal[first:last] if noisy else none[:n]
        shown = offset_e[first:last] if shifted else none[:n]
        nearly = False
        for i in range(n):
            mean, z = _mean(lit[i] * factor[i], most, white_e, dark_e, most_mean), drawn[i]
            nearly |= mean >= nearly_full
            variance = mean + read_variance
            skew = mean / variance
            spread = np.sqrt(_fma(of_skew * skew, skew, variance))
            noise = _fma(of_bend * skew, z * z - _ONE, spread * z)
            value = _fma(mean + shown[i], of_mean, _fma(noise, of_noise, black_dn))
            value = value if value > _ZERO else _ZERO
            value = value if value < _MOST_CODE else _MOST_CODE
            out[i] = np.uint16(np.int32(value + _WHOLE - _WHOLE))
        if well_clips and nearly:
            own = read[first:last]
            for i in range(n):
                mean = _mean(lit[i] * factor[i], most, white_e, dark_e, most_mean)
                if mean >= nearly_full:
                    z, mean_e = drawn[i], mean * unit_e
                    variance = mean_e + _LEAST_VARIANCE
                    skew = mean_e / variance / _SIX
                    spread = variance - _TWO * skew * skew
                    spread = spread if spread > _LEAST_VARIANCE else _LEAST_VARIANCE
                    charge = mean_e - skew + (np.sqrt(spread) + skew * z) * z
                    charge = charge if charge > _ZERO else _ZERO
                    charge = charge if charge < well_e else well_e
                    charge += read_noise_e * own[i]
                    charge += shown[i]
                    value = charge * gain_dn + black_dn
                    value = value if value > _ZERO else _ZERO
                    value = value if value < _MOST_CODE else _MOST_CODE
                    out[i] = np.uint16(np.int32(value + _WHOLE - _WHOLE))
        if len(table):
            pixels = seen[first:last]
            for i in range(n):
                pixels[i, colour] = table[out[i]]
