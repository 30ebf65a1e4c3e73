"""Row gain: noise of whole rows that grows with the signal, and over how many rows it is correlated.

The spectrum over the rows of a level of signal S is a + S^2 g^2 P(k): a of pixels and of rows in the dark, P the mean
periodogram of an autoregression of first order of variance 1. Length and g maximise Whittle's likelihood.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from blurnoise.metrics.values import Estimate
from blurnoise_eval.calibration.frames import Floats
from blurnoise_eval.calibration.uncertain import Uncertain

_SURE = 4.0  # standard deviations, as the length is chosen among several
_SEEN = 0.1  # of the variance of the brightest row means: less changes nothing
_ROUNDS = 6


@dataclass(frozen=True)
class RowSpectrum:
    """Spectrum (K,) over the rows of a level, DN^2, without frequency 0, of ``freedom`` frames less one.

    signal_dn: mean signal. floor_dn2: of white noise.
    """

    power: Floats
    freedom: int
    signal_dn: float
    floor_dn2: float


def spectrum_of(rows: Floats, dark_dn: float, floor_dn2: float) -> RowSpectrum:
    """The spectrum of row means (N, H) of a level, its frames scaled to one light. floor_dn2: of white noise.

    >>> rows = 100 + np.random.default_rng(0).normal(0.0, 2.0, (64, 256))
    >>> round(float(spectrum_of(rows, 10.0, 4.0).power.mean()), 1)
    4.0
    """
    light = rows.mean(1, keepdims=True) - dark_dn
    scaled = (rows - dark_dn) * (light.mean() / light)
    rest = scaled - scaled.mean(0)
    power = (np.abs(np.fft.rfft(rest, axis=1)) ** 2).sum(0) / rows.shape[1] / (len(rows) - 1)
    return RowSpectrum(power[1:], len(rows) - 1, float(light.mean()), floor_dn2)


def row_gain(levels: Sequence[RowSpectrum]) -> tuple[Uncertain, Estimate]:
    """Variance of the row gain, relative to the squared signal, and its length in rows; 0 where there is none.

    Levels scatter more than chance lets them, as lamps do: the error is that of leaving out one level at a time, and
    the interval of the length is as much wider.

    >>> draw = np.random.default_rng(1)
    >>> flat = [
    ...     spectrum_of(signal * (1 + 0.01 * draw.standard_normal((2, 400))), 0.0, 0.0) for signal in (50, 100, 200)
    ... ]
    >>> square, rows = row_gain(flat)
    >>> 0.009 < square.value ** 0.5 < 0.011, rows.value
    (True, 0.0)
    """
    count = 2 * len(levels[0].power)
    lengths = [0.0, *np.geomspace(1.0, count, 1 + 2 * int(math.log2(count)))]
    found = [_fitted(levels, periodogram(rows, count)) for rows in lengths]
    likelihoods = np.array([likelihood for likelihood, *_ in found])
    best = int(np.argmax(likelihoods))
    _, square, error, information = found[best]
    rows = float(lengths[best])
    brightest = max(levels, key=lambda level: level.signal_dn)
    added = square * brightest.signal_dn**2 * float(periodogram(rows, count).mean())
    if square < _SURE * error or added < _SEEN * brightest.floor_dn2:
        return Uncertain(0.0, error), Estimate(0.0, 0.0, 0.0)
    within = chi2.ppf(0.95, 1) / 2 * max(1.0, error * error * information)
    likely = np.flatnonzero(likelihoods > likelihoods[best] - within)
    low, high = lengths[max(0, likely[0] - 1)], lengths[min(len(lengths) - 1, likely[-1] + 1)]
    return Uncertain(square, error), Estimate(rows, float(low), float(high))


def periodogram(rows: float, count: int) -> Floats:
    """Mean periodogram of ``count`` rows with the correlation length ``rows``, at the frequencies of a spectrum.

    >>> periodogram(0.0, 8).tolist()  # white
    [1.0, 1.0, 1.0, 1.0]
    """
    apart = np.arange(count)
    law = np.exp(-apart / rows) if rows else (apart == 0).astype(float)
    law *= (1 - apart / count) * np.where(apart, 2.0, 1.0)
    return np.maximum(np.fft.rfft(law).real[1:], 1e-12)


def _fitted(levels: Sequence[RowSpectrum], shape: Floats) -> tuple[float, float, float, float]:
    """Log likelihood, variance, its standard deviation by leaving out one level at a time, and its information."""
    square = 0.0
    for _ in range(_ROUNDS):
        sums = np.array([_scored(level, shape, square) for level in levels])
        square = max(0.0, float(sums[:, 0].sum() / sums[:, 1].sum()))
    likelihood = 0.0
    for level in levels:
        expected = level.floor_dn2 + level.signal_dn**2 * square * shape
        likelihood -= level.freedom * float((np.log(expected) + level.power / expected).sum())
    without = (sums[:, 0].sum() - sums[:, 0]) / np.maximum(sums[:, 1].sum() - sums[:, 1], 1e-300)
    count = len(levels)
    error = math.sqrt((count - 1) / count * float(((without - without.mean()) ** 2).sum()))
    return likelihood, square, error, float(sums[:, 1].sum())


def _scored(level: RowSpectrum, shape: Floats, square: float) -> tuple[float, float]:
    """Numerator and denominator of the weighted estimate of the variance from one level."""
    slope = level.signal_dn**2 * shape
    expected = np.maximum(level.floor_dn2 + square * slope, 1e-12)
    weight = level.freedom * slope / expected**2
    return float((weight * (level.power - level.floor_dn2)).sum()), float((weight * slope).sum())
