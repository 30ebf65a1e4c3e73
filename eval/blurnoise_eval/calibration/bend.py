"""The bend of photon transfer: the variance of photo noise leaves the line, as it does before a well fills.

Points (signal_share, variance_factor) are the camera's ``photon_transfer``: mean signal above black as a share of the
signal at which frames clip, and variance relative to the line. The first has the factor 1 and ends the straight part.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import f as fisher

from blurnoise.metrics.values import Estimate
from blurnoise_eval.calibration.frames import FEWEST_FLAT, Floats
from blurnoise_eval.calibration.levels import Level, columns
from blurnoise_eval.calibration.transfer import Transfer
from blurnoise_eval.calibration.uncertain import Uncertain, Z

_CHANCE = 1e-3  # probability of a bend by chance
_LEAST = 0.02  # smallest relative change of the variance that counts
_SCATTER = 0.005  # relative scatter of the variances beyond chance, of lamps and real sensors
_MOST_POINTS = 3  # beyond the straight part


@dataclass(frozen=True)
class Bend:
    """shares, factors: of the points; shares are relative to the signal top_dn.

    straight_dn: mean of the last level on the line.

    >>> factors = Estimate(1.0, 1.0, 1.0), Estimate(0.5, 0.4, 0.6)
    >>> before_full = Bend((0.7, 1.0), factors, top_dn=4000.0, straight_dn=2800.0)
    >>> before_full.factors[-1].value  # at the end half of the variance is left
    0.5
    """

    shares: tuple[float, ...]
    factors: tuple[Estimate, ...]
    top_dn: float
    straight_dn: float


class _Gains:
    """Variance over signal of levels by rising mean, which is K on the straight part."""

    def __init__(self, flat: Sequence[Level], fit: Transfer, top_dn: float) -> None:
        mean, variance, error = columns(flat, "mean_dn", "variance_dn2", "variance_error_dn2")
        order = np.argsort(mean)
        # K is variance over signal: read noise and rounding are taken off, and black level, too.
        signal = mean[order] - fit.dark.offset
        self.mean_dn, self.shares = mean[order], signal / top_dn
        self.gain = (variance[order] - fit.read_dn2 - 1 / 12) / signal
        noise = np.hypot(error[order], fit.error(0, 1)) / signal
        self.error = np.hypot(noise, _SCATTER * self.gain)

    def fit(self, design: Floats) -> tuple[float, Floats, Floats]:
        """Chi-square, values and covariance of a fit with the columns of ``design`` (N, k)."""
        scaled, gain = design / self.error[:, None], self.gain / self.error
        covariance = np.linalg.inv(scaled.T @ scaled).astype(np.float64)
        values = covariance @ (scaled.T @ gain)
        return float(((scaled @ values - gain) ** 2).sum()), values, covariance

    def bent(self, straight: int, beyond: int) -> tuple[Floats, Floats]:
        """Shares of points, and the design of straight lines between them, constant before the first.

        straight: number of levels before the first point; beyond: number of points after it.
        """
        nodes = np.linspace(self.shares[straight - 1], self.shares[-1], beyond + 1)
        return nodes, np.stack([np.interp(self.shares, nodes, unit) for unit in np.eye(len(nodes))], 1)


def bend_of(flat: Sequence[Level], fit: Transfer, top_dn: float, *, tone: bool) -> Bend | None:
    """The bend that explains the variances of ``flat``, levels that do not clip, significantly better than a line.

    top_dn: signal at which frames clip. tone: a power of the signal explains them, too, and the bend must be better.
    None if there is no bend.
    """
    gains = _Gains(flat, fit, top_dn)
    count = len(flat)
    plain = [gains.fit(np.ones((count, 1)))[0]]
    if tone:
        plain.append(gains.fit(np.stack([np.ones(count), np.log(gains.shares)], 1))[0])
    tried = []
    for straight in range(FEWEST_FLAT, count):
        for beyond in range(1, 1 + min(_MOST_POINTS, count - straight)):
            freedom = count - beyond - 2  # K, the share of the first point, and the value of each other one
            if freedom > 0:
                left = gains.fit(gains.bent(straight, beyond)[1])[0]
                # F test: what the further points explain, over what is left; never over less than chance leaves.
                gained = (min(plain) - left) / (beyond + 1) / max(1.0, left / freedom)
                tried.append((float(fisher.sf(gained, beyond + 1, freedom)), straight, beyond))
    chance, straight, beyond = min(tried, default=(1.0, 0, 0))
    if chance > _CHANCE:
        return None
    nodes, design = gains.bent(straight, beyond)
    chi_square, values, covariance = gains.fit(design)
    # Where points scatter more than their errors say, the errors are too small.
    widened = max(1.0, chi_square / (count - len(nodes)))
    factors = values[1:] / values[0]
    along = np.hstack([-factors[:, None], np.eye(beyond)]) / values[0]
    errors = np.sqrt(widened * np.diag(along @ covariance @ along.T))
    away = np.abs(factors - 1)
    if not (away > np.maximum(_LEAST, Z * errors)).any():
        return None
    pairs = zip(factors.tolist(), errors.tolist(), strict=True)
    points = [Estimate(1.0, 1.0, 1.0), *(Uncertain(*pair).interval(0.0) for pair in pairs)]
    return Bend(tuple(nodes.tolist()), tuple(points), top_dn, float(gains.mean_dn[straight - 1]))
