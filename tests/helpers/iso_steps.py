"""The slanted-edge steps of ISO 12233 in NumPy, one region at a time, as P. Burns's sfrmat5 takes them.

Domain: one linear region (H, W) float64, its edge near vertical and bright on the right. Errors included: the first
difference and its half-corrected response, the mean over bins of 1/4 px, a window on the line spread.
"""

import numpy as np
from numpy.polynomial import Polynomial

_FINER = 4
_ORDER = 5
_MOST_CORRECTION = 10.0


def iso_steps(region):
    """Frequencies, cycles/px along the edge's normal, and the response there, 1 at 0."""
    height, width = region.shape
    slope = np.empty_like(region)
    slope[:, 1:] = np.diff(region, axis=1) / 2
    slope[:, 0] = slope[:, 1]
    rows = np.arange(height)
    line = Polynomial.fit(rows, _centroids(slope, np.full(height, (width - 1) / 2)), _ORDER)
    line = Polynomial.fit(rows, _centroids(slope, line(rows)), _ORDER)
    tilt = float(Polynomial.fit(rows, line(rows), 1).convert().coef[-1])
    phases = np.floor(height * abs(tilt))
    used = round(phases / abs(tilt)) if phases else height

    spread = _binned(region[:used], line(rows[:used]) - line(0), middle=round(_FINER * (used - 1) * tilt / 2))
    bins = len(spread)
    derivative = np.zeros(bins)
    derivative[1:-1] = (spread[2:] - spread[:-2]) / 2
    derivative[0], derivative[-1] = derivative[1], derivative[-2]
    shift = bins // 2 - int(np.argmax(derivative))
    centred = np.zeros(bins)
    centred[max(shift, 0) : bins + min(shift, 0)] = derivative[max(-shift, 0) : bins - max(shift, 0)]
    modulus = np.abs(np.fft.rfft(centred * _bell(bins, np.full(1, bins // 2), 0.0)[0]))
    index = np.arange(1, len(modulus))
    angle = np.pi * (index + 1) / (len(modulus) + 1)
    with np.errstate(divide="ignore"):
        modulus[1:] *= np.minimum(np.abs(angle / np.sin(angle)), _MOST_CORRECTION)
    frequencies = np.arange(len(modulus)) * _FINER / bins * np.sqrt(1 + tilt**2)
    return frequencies, modulus / modulus[0]


def mtf50(frequencies, response):
    """First frequency at which the response is 1/2, straight between its points; NaN where it never is."""
    below = np.flatnonzero(response < 0.5)
    if not len(below):
        return float("nan")
    k = below[0]
    share = (response[k - 1] - 0.5) / (response[k - 1] - response[k])
    return float(frequencies[k - 1] + share * (frequencies[k] - frequencies[k - 1]))


def _bell(count, middle, pedestal=0.05):
    """Raised cosines, (len(middle), count), each falling to its lowest at the farther end; on a pedestal where the
    edge is looked for."""
    half = np.maximum(middle, count - 1 - middle)[:, None]
    bell = 0.5 + 0.5 * np.cos(np.pi * (np.arange(count) - middle[:, None]) / half)
    return (1 - pedestal) * bell + pedestal


def _centroids(slope, middle):
    windowed = slope * _bell(slope.shape[1], middle)
    return windowed @ np.arange(slope.shape[1]) / windowed.sum(1) - 0.5


def _binned(region, moved, middle):
    """Means over bins of 1/4 px of the distance from the edge, an empty bin's as that of its neighbours."""
    bins = _FINER * region.shape[1]
    index = np.ceil(_FINER * (np.arange(region.shape[1]) - moved[:, None])).astype(int) + middle
    kept = (index >= 0) & (index < bins)
    count = np.bincount(index[kept], minlength=bins)
    total = np.bincount(index[kept], weights=region[kept], minlength=bins)
    means = total / np.maximum(count, 1)
    empty = np.flatnonzero(count == 0)
    last = len(means) - 1
    means[empty] = (means[np.maximum(empty - 1, 0)] + means[np.minimum(empty + 1, last)]) / 2
    return means
