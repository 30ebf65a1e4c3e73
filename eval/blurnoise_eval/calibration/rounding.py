"""Rounding of the converter: mean and variance of normal noise after it, DN.

Rounding adds 1/12 DN^2 if the noise is about 0.7 DN or more. Below, the variance depends on where the mean lies
between two digital numbers: at 0.25 DN of noise, rounding adds -0.017 to 0.188 DN^2. Pixels whose means differ (DSNU)
average over this.
"""

from __future__ import annotations

import numpy as np
from scipy.special import ndtr

from blurnoise_eval.calibration.frames import Floats

PLAIN_DN2 = 0.7**2
"""Variance before rounding above which rounding adds 1/12: the next term is 2e^(-2 pi^2 0.49), 0.01 %."""
SHEPPARD_DN2 = 0.4**2
"""Variance before rounding above which rounding adds 1/12 within 7 % of the sum, wherever the mean lies."""
TWO_NUMBERS_DN = 0.2
"""Noise before rounding below which dark pixels have two numbers at most (a third is 5 deviations away half of the
time). Their shares give the ratio of the noise to black level, DSNU and dark current, but none of the four."""
_LEAST_DN2 = 1e-8
_WIDEST_DN = 4.0  # of a spread over pixels; beyond it all phases are equally frequent anyway
_NODES = np.linspace(-4, 4, 161)
_WEIGHTS = np.exp(-_NODES * _NODES / 2) / np.exp(-_NODES * _NODES / 2).sum()
_REACH = np.arange(-6.0, 7.0)


def rounded(mean_dn: Floats, variance_dn2: Floats, spread_dn: float) -> tuple[Floats, Floats, Floats]:
    """Moments of normal noise after rounding, for pixels whose means are normal about ``mean_dn`` (``spread_dn``).

    Returns mean and variance (N,), averaged over the pixels, and the mean of pixels at the nodes of the normal
    distribution (N, nodes).

    >>> float(rounded(np.array([7.0]), np.array([1.0]), 0.0)[1][0] - 1.0)  # the 1/12 of uniform rounding
    0.08333333333333326
    """
    means = mean_dn[:, None] + min(spread_dn, _WIDEST_DN) * _NODES
    sigma = np.sqrt(np.clip(variance_dn2, _LEAST_DN2, PLAIN_DN2))[:, None, None]
    off = np.round(means)[..., None] + _REACH - means[..., None]
    share = ndtr((off + 0.5) / sigma) - ndtr((off - 0.5) / sigma)
    shift = (share * off).sum(-1)
    variance = (share * off * off).sum(-1) - shift**2
    low = variance_dn2 < PLAIN_DN2
    mean = np.where(low, mean_dn + shift @ _WEIGHTS, mean_dn)
    after = np.where(low, variance @ _WEIGHTS, variance_dn2 + 1 / 12)
    return mean, after, np.where(low[:, None], means + shift, means)


def spatial_variance(pixel_dn: Floats) -> float:
    """Variance over pixels of the mean over levels of ``pixel_dn`` (N, nodes)."""
    mean = pixel_dn.mean(0)
    return float(((mean - mean @ _WEIGHTS) ** 2) @ _WEIGHTS)
