"""Rounding of normal noise to whole digital numbers: mean and variance, below the law of 1/12 DN^2.

That law holds from about 0.7 DN of noise on. Below it the variance depends on where between two numbers the mean
lies: at 0.25 DN rounding adds anything from -0.017 to 0.188 DN^2. Pixels whose means differ (DSNU) average over it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

Floats = NDArray[np.float64]
PLAIN_DN2 = 0.7**2
"""Variance before rounding from which on it adds 1/12: the first term left out is 2e^(-2 pi^2 0.49), 0.01 %."""
TWO_NUMBERS_DN = 0.2
"""Noise before rounding below which dark pixels hold two numbers at most (a third is 5 deviations away half of the
time): their shares tell the noise's ratio to black level, DSNU and dark current, but none of the four."""
_LEAST_DN2 = 1e-8
_WIDEST_DN = 4.0  # of a spread; beyond it all phases are equally frequent anyway
_NODES = np.linspace(-4, 4, 161)
_WEIGHTS = np.exp(-_NODES * _NODES / 2) / np.exp(-_NODES * _NODES / 2).sum()
_REACH = np.arange(-6.0, 7.0)


class Rounded(NamedTuple):
    """mean_dn, variance_dn2: (N,), averages over the pixels. pixel_dn: (N, nodes), the mean number by pixel."""

    mean_dn: Floats
    variance_dn2: Floats
    pixel_dn: Floats


def rounded(mean_dn: Floats, variance_dn2: Floats, spread_dn: float) -> Rounded:
    """What rounding makes of normal noise; pixels' means are normal, too, about ``mean_dn`` by ``spread_dn``."""
    places = mean_dn[:, None] + min(spread_dn, _WIDEST_DN) * _NODES
    sigma = np.sqrt(np.clip(variance_dn2, _LEAST_DN2, PLAIN_DN2))[:, None, None]
    numbers = np.round(places)[..., None] + _REACH
    share = ndtr((numbers + 0.5 - places[..., None]) / sigma) - ndtr(
        (numbers - 0.5 - places[..., None]) / sigma
    )
    off = numbers - places[..., None]
    shift = (share * off).sum(-1)
    variance = (share * off * off).sum(-1) - shift**2
    low = variance_dn2 < PLAIN_DN2
    mean = np.where(low, mean_dn + shift @ _WEIGHTS, mean_dn)
    told = np.where(low, variance @ _WEIGHTS, variance_dn2 + 1 / 12)
    return Rounded(mean, told, np.where(low[:, None], places + shift, places))


def spatial_variance(pixel_dn: Floats) -> float:
    """Variance over pixels of the mean over rows of ``pixel_dn`` (N, nodes)."""
    mean = pixel_dn.mean(0)
    return float(((mean - mean @ _WEIGHTS) ** 2) @ _WEIGHTS)
