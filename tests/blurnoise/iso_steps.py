"""The slanted-edge steps of ISO 12233 for one region, in NumPy, row by row: to compare with and to race against."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def bell(count: int, middle: float) -> Array:
    half = max(middle, count - 1 - middle)
    return 0.95 * (0.5 + 0.5 * np.cos(np.pi * (np.arange(count) - middle) / half)) + 0.05


def centroid(row: Array) -> float:
    return float((np.arange(len(row)) * row).sum() / row.sum()) - 0.5


def iso_steps(region: Array, *, order: int = 5) -> tuple[Array, Array]:
    """Frequencies, cycles/px, and response of an edge, near vertical and bright on the right, in ``region``."""
    height, width = region.shape
    across = np.empty_like(region)
    across[:, 1:] = (region[:, 1:] - region[:, :-1]) / 2
    across[:, 0] = across[:, 1]
    rows = np.arange(height)
    window = bell(width, (width - 1) / 2)
    places = np.array([centroid(row * window) for row in across])
    fit = np.polynomial.Polynomial.fit(rows, places, order)
    places = np.array([centroid(row * bell(width, fit(y))) for y, row in enumerate(across)])
    fit = np.polynomial.Polynomial.fit(rows, places, order)
    tilt = float(np.polynomial.Polynomial.fit(rows, fit(rows), 1).convert().coef[1])
    phases = np.floor(height * abs(tilt))
    used = round(phases / abs(tilt)) if phases else height

    bins = 4 * width
    middle = round(4 * (used - 1) * tilt / 2)
    total, count = np.zeros(bins), np.zeros(bins)
    for y in range(used):
        index = np.ceil(4 * (np.arange(width) - (fit(y) - fit(0)))).astype(int) + middle
        kept = (index >= 0) & (index < bins)
        total[index[kept]] += region[y, kept]
        count[index[kept]] += 1
    spread = total / np.maximum(count, 1e-9)
    means = spread.copy()
    for k in np.flatnonzero(count == 0):
        spread[k] = (means[max(k - 1, 0)] + means[min(k + 1, bins - 1)]) / 2

    line = np.zeros(bins)
    line[1:-1] = (spread[2:] - spread[:-2]) / 2
    line[0], line[-1] = line[1], line[-2]
    shift = bins // 2 - int(np.argmax(line))
    moved = np.zeros(bins)
    moved[max(shift, 0) : bins + min(shift, 0)] = line[max(-shift, 0) : bins - max(shift, 0)]
    modulus = np.abs(np.fft.rfft(moved * bell(bins, bins // 2)))
    index = np.arange(1, len(modulus))
    correction = np.ones(len(modulus))
    angle = np.pi * (index + 1) / (len(modulus) + 1)
    with np.errstate(divide="ignore"):
        correction[1:] = np.minimum(np.abs(angle / np.sin(angle)), 10)
    frequency = np.arange(len(modulus)) * 4 / bins * np.sqrt(1 + tilt**2)
    return frequency, modulus / modulus[0] * correction
