"""Rows that each see a path in their own window, which along rows and down them hardly goes at once.

Along rows by their own transfer functions, across them by Lanczos's taps, integrated over the window: exact, but for
what a path does along both at once in a window, which has to be little (:attr:`.Displacement.way`).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from blurnoise._core.borders import Border
from blurnoise._core.threads import plain
from blurnoise.blur import fourier, rows
from blurnoise.blur.displacement import Displacement, Floats

_STILL_PX = 1e-3  # motion across that is not worth its transform
_LEAST_SAMPLES = 16  # of a row's exposure, however little moves
_SAMPLES_PER_PX, _LONGEST_PX = 4, 4096.0  # of the way up and down; beyond that they thin out
_PHASES = 256  # places within a pixel at which taps are computed, linear between them: to 1e-5
_ROOM_PX = 32  # of a row's band-limited ends


def exposed(light: Tensor, moves: Displacement, border: Border) -> Tensor:
    """Pictures (B, C, H, W) of which each row is its window's mean; differentiable in the light."""
    time, knots = moves.track
    across, down = np.abs(knots).max(1)
    if down > _STILL_PX:
        light = rows.mixed(light, *_integrated_taps(time, knots[1], moves.readout.windows_s), border)
    return _rows_blurred(light, time, knots[0], moves, border) if across > _STILL_PX else light


def _integrated_taps(
    time: Floats, y_px: Floats, windows_s: tuple[Floats, Floats]
) -> tuple[NDArray[np.int64], Floats]:
    """Where each row's taps begin, from itself, and their means over the row's window of a path y_px (K,)."""
    starts, stops = windows_s
    gone = np.concatenate(
        [[0.0], np.cumsum(np.abs(np.diff(y_px)))]
    )  # there and back: a vibration goes further
    longest = float((np.interp(stops, time, gone) - np.interp(starts, time, gone)).max())
    count = max(_LEAST_SAMPLES, math.ceil(_SAMPLES_PER_PX * min(longest, _LONGEST_PX)))
    at = starts[:, None] + (stops - starts)[:, None] * (np.arange(count) + 0.5) / count
    seen = -np.interp(at, time, y_px)  # what was at row i + seen is at row i
    low = np.floor(seen.min(1)).astype(np.int64)
    height, span = len(starts), int((np.floor(seen.max(1)) - low).max()) + 2
    fine = (seen - low[:, None]) * _PHASES
    place = fine.astype(np.int64)
    part = (fine - place).ravel()
    place = (place + span * _PHASES * np.arange(height)[:, None]).ravel()
    spent = np.bincount(place, 1 - part, height * span * _PHASES)
    spent += np.bincount(place + 1, part, height * span * _PHASES)
    taps = rows.lanczos(np.arange(_PHASES)[:, None] / _PHASES - np.arange(1 - rows.LOBES, rows.LOBES + 1))
    taps /= taps.sum(1, keepdims=True) * count
    spread = spent.reshape(height, span, _PHASES) @ taps
    weights = np.zeros((height, span + 2 * rows.LOBES - 1))
    for tap in range(2 * rows.LOBES):
        weights[:, tap : tap + span] += spread[..., tap]
    return low + 1 - rows.LOBES, weights


def _rows_blurred(light: Tensor, time: Floats, x_px: Floats, moves: Displacement, border: Border) -> Tensor:
    """Rows times the transfer functions of their own windows of a path x_px (K,), exact."""
    reach = math.ceil(float(np.abs(x_px).max()))
    side = fourier.fast_length(2 * reach + _ROOM_PX + 32)
    margin = side // 2
    length = fourier.fast_length(light.shape[-1] + 2 * margin)
    _, f = fourier.frequencies((1, side))

    def motion(fx: Floats, fy: Floats) -> NDArray[np.complex128]:
        return row_responses(fx, time, x_px, moves.readout.windows_s)[:, None]

    spread = np.fft.irfft(fourier.joined(motion, f, np.zeros(1), (1, side))[:, 0], n=side)
    kernels = np.zeros((len(spread), length))
    kernels[:, (np.arange(side) + side // 2) % side - side // 2] = spread
    factors: NDArray[Any] = np.fft.rfft(kernels)
    if not plain(light):
        return rows.times(light, torch.from_numpy(factors).to(light.device), margin, length, border)
    packed = rows.packed_factors(factors, length, light.detach().numpy().dtype)
    return rows.times_packed(light, packed, margin, border)


def row_responses(
    f: Floats, time: Floats, x_px: Floats, windows_s: tuple[Floats, Floats]
) -> NDArray[np.complex128]:
    """(H, n): at frequencies f (n,), cycles/px, of the path x_px (K,) seen in each row's window; exact.

    The integral of exp(-2 pi i f x) up to any time, by segments, at a window's end less that at its start.
    """
    starts, stops = windows_s
    if not (stops > starts).any():
        return np.asarray(np.exp(-2j * np.pi * np.outer(np.interp(starts, time, x_px), f)))

    def segment(first: Floats, last: Floats, spent: Floats) -> NDArray[np.complex128]:
        wave = np.exp(-1j * np.pi * np.outer(first + last, f))
        return np.asarray(wave * np.sinc(np.outer(last - first, f)) * spent[:, None])

    whole = np.cumsum(segment(x_px[:-1], x_px[1:], np.diff(time)), axis=0)
    whole = np.concatenate([np.zeros((1, len(f))), whole])

    def until(at: Floats) -> NDArray[np.complex128]:
        knot = np.clip(np.searchsorted(time, at, side="right") - 1, 0, len(time) - 2)
        return np.asarray(whole[knot] + segment(x_px[knot], np.interp(at, time, x_px), at - time[knot]))

    lasting = np.maximum(stops - starts, 1e-300)
    return (until(stops) - until(starts)) / lasting[:, None]
