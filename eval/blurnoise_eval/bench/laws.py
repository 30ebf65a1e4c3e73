"""The exact law of a pixel's digital number, from its formula alone, and how far a sampler is from it.

Nothing of the simulator is used here. Units: electrons (e-) and digital numbers (DN). A law is the probability
of every digital number from 0 to full scale.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Law = NDArray[np.float64]
_REACH = 9.0  # standard deviations of the read noise: beyond lies less than 1e-18
_erfc = np.vectorize(math.erfc, otypes=[float])
_log_factorial = np.vectorize(lambda count: math.lgamma(count + 1), otypes=[float])


@dataclass(frozen=True)
class Converter:
    """Electrons to digital numbers: normal read noise (e- rms, > 0), gain, black level, rounding, limits."""

    read_noise_e: float
    gain_dn_per_e: float = 1.0
    black_dn: float = 32.0
    full_scale_dn: int = 65535


def exact(mean_e: float, converter: Converter) -> Law:
    """Poisson counts of this mean (> 0), read out: P(DN) = sum over n of Poisson(n; mean) P(DN | n)."""
    spread = 12 * math.sqrt(mean_e) + 40
    counts = np.arange(max(0, math.floor(mean_e - spread)), math.ceil(mean_e + spread) + 1)
    chances = np.exp(counts * math.log(mean_e) - mean_e - _log_factorial(counts))
    return read_out(counts, chances, converter)


def read_out(counts: NDArray[np.int64], chances: Law, converter: Converter) -> Law:
    """Law of the digital number of ``counts`` electrons that come with these ``chances``."""
    counts, chances = counts[chances > 0], chances[chances > 0]
    centre = converter.gain_dn_per_e * counts + converter.black_dn
    sigma = converter.gain_dn_per_e * converter.read_noise_e
    reach = math.ceil(_REACH * sigma) + 1
    codes = np.round(centre).astype(int)[:, None] + np.arange(-reach, reach + 1)
    edges = np.concatenate([codes - 0.5, codes[:, -1:] + 0.5], axis=1)
    below = 0.5 * _erfc((centre[:, None] - edges) / (sigma * math.sqrt(2)))
    law = np.zeros(converter.full_scale_dn + 1)
    np.add.at(law, codes.clip(0, converter.full_scale_dn), chances[:, None] * np.diff(below, axis=1))
    return law


def of_values(dn: NDArray[np.floating], full_scale_dn: int) -> Law:
    """Relative frequencies of integral digital numbers within the converter's limits."""
    return np.bincount(dn.astype(np.int64).ravel(), minlength=full_scale_dn + 1) / dn.size


def distance(one: Law, other: Law) -> float:
    """Total variation distance, 0 to 1: the largest difference in the probability of any event."""
    return float(0.5 * np.abs(one - other).sum())


def floor(law: Law, samples: int) -> float:
    """Mean distance between ``law`` and the frequencies of ``samples`` exact samples of it.

    Half the sum of E|X/n - p| over its binomial cells, in de Moivre's closed form
    2 k C(n, k) p^k (1 - p)^(n - k + 1) / n with k = floor(np) + 1.
    """
    p = law[(law > 0) & (law < 1)]
    k = np.floor(samples * p) + 1
    ways = _log_factorial(samples) - _log_factorial(k) - _log_factorial(samples - k)
    terms = np.exp(ways + np.log(k) + k * np.log(p) + (samples - k + 1) * np.log1p(-p))
    return float(terms.sum() / samples)


def spread(samples: int) -> float:
    """Upper bound of the standard deviation of an estimated distance: a sample moves it by 1/n at most."""
    return 0.5 / math.sqrt(samples)
