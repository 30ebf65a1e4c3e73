"""Brute force: pictures as means of many sub-exposures, each displaced by whole and Lanczos-6 parts of a pixel."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Path = Callable[[Floats], tuple[Floats, Floats]]
"""Places (x, y), px, at times, s."""


def photograph(height, width, seed=5, channels=1):
    """Noise whose amplitude falls as 1/f through a lens of 0.7 px, within [0, 1]: (1, C, H, W).

    Detail that Lanczos-6 displaces wrongly, beyond 0.4 cycles/px, is 0.01 of it.
    """
    drawn = np.random.default_rng(seed).normal(size=(channels, height, width))
    f = np.hypot(np.fft.fftfreq(height)[:, None], np.fft.rfftfreq(width))
    f[0, 0] = 1.0
    lens = np.exp(-2 * (np.pi * 0.7 * f) ** 2)
    seen = np.fft.irfft2(np.fft.rfft2(drawn) * lens / f, s=(height, width))
    seen -= seen.min((1, 2), keepdims=True)
    return np.asarray(seen / seen.max((1, 2), keepdims=True))[None]


def _taps(length, shifts_px):
    """Weights (n, length) at whole distances, which wrap round, of displacements (n,)."""
    off = (np.arange(length) - shifts_px[:, None] + length / 2) % length - length / 2
    weights = np.where(np.abs(off) < 6, np.sinc(off) * np.sinc(off / 6), 0.0)
    return np.asarray(weights / weights.sum(1, keepdims=True))


def displaced(light, x_px, y_px):
    """Planes (..., H, W) that wrap round, displaced to the right and down."""
    down, across = (
        _taps(size, np.array([px]))[0][(np.arange(size)[:, None] - np.arange(size)) % size]
        for size, px in zip(light.shape[-2:], (y_px, x_px), strict=True)
    )
    return down @ light @ across.T


def rolled(light, path, starts_s, stops_s, moments=128):
    """Row i exposed from starts_s[i] to stops_s[i], every row by as many moments of its own."""
    out = np.empty_like(light)
    height, width = light.shape[-2:]
    for row, (start, stop) in enumerate(zip(starts_s, stops_s, strict=True)):
        x, y = path(start + (np.arange(moments) + 0.5) / moments * (stop - start))
        down = _taps(height, y)[:, (row - np.arange(height)) % height]
        seen = np.fft.rfft(down @ light) * np.fft.rfft(_taps(width, x))
        out[..., row, :] = np.fft.irfft(seen.mean(-2), n=width)
    return out


def rms_dn(first, second):
    """RMS difference in 8-bit numbers of linear light."""
    return float(255 * np.sqrt(((first - second) ** 2).mean()))
