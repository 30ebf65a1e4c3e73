"""The bend of photon transfer: the variance of photo noise leaves the line, as it does before a well fills.

Points (signal_share, variance_factor) are the camera's ``photon_transfer``: mean signal above black as a share of the
signal at which frames clip, and variance relative to the line. Where at least the lower half is straight, K is fitted
to that part alone, and the first point, with the factor 1, ends it. Otherwise K remains that of the levels up to 70 %
of saturation, as in EMVA 1288, and points begin at the dimmest level.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2
from scipy.stats import f as fisher

from blurnoise.metrics.values import Estimate
from blurnoise_eval.calibration.frames import Floats
from blurnoise_eval.calibration.levels import Level, columns
from blurnoise_eval.calibration.rounding import SHEPPARD_DN2, rounded
from blurnoise_eval.calibration.transfer import Transfer
from blurnoise_eval.calibration.uncertain import Uncertain, Z

_CHANCE = 1e-3  # probability of a bend by chance
_LEAST = 0.02  # smallest relative change of the variance that counts
_SCATTER = 0.005  # relative scatter of the variances beyond chance, of lamps and real sensors
_FEWEST = 4  # levels
_STRAIGHT = 0.5  # least share of a straight part
_MOST_POINTS = 7  # beyond the first one
_DIMMEST = 0.02  # share of the signal below which the variance is mostly that in the dark


@dataclass(frozen=True)
class Bend:
    """shares, factors: of the points; shares are relative to the signal top_dn.

    straight_dn: mean of the last level on the line, None if no part is straight.

    >>> factors = Estimate(1.0, 1.0, 1.0), Estimate(0.5, 0.4, 0.6)
    >>> before_full = Bend((0.7, 1.0), factors, top_dn=4000.0, straight_dn=2800.0)
    >>> before_full.factors[-1].value  # at the end half of the variance is left
    0.5
    """

    shares: tuple[float, ...]
    factors: tuple[Estimate, ...]
    top_dn: float
    straight_dn: float | None


class _Gains:
    """Variance over signal of levels by rising mean, which is K on the straight part."""

    def __init__(self, flat: Sequence[Level], fit: Transfer, top_dn: float) -> None:
        mean, variance, error = columns(flat, "mean_dn", "variance_dn2", "variance_error_dn2")
        signal_dn = mean - fit.dark.offset
        used = (signal_dn > _DIMMEST * top_dn) & (variance - 1 / 12 > SHEPPARD_DN2)
        order = np.flatnonzero(used)[np.argsort(mean[used])]
        # K is variance over signal: read noise and rounding are taken off, and black level, too.
        signal = signal_dn[order]
        self.mean_dn, self.shares = mean[order], signal / top_dn
        before = np.maximum(fit.at(mean[order]) - 1 / 12, 0.0)
        added = rounded(mean[order], before, math.sqrt(fit.spread_dn2))[1] - before
        self.gain = (variance[order] - fit.read_dn2 - added) / signal
        noise = np.hypot(error[order], fit.error(0, 1)) / signal
        self.error = np.hypot(noise, _SCATTER * self.gain)

    def fit(self, design: Floats) -> tuple[float, Floats, Floats]:
        """Chi-square, values and covariance of a fit with the columns of ``design`` (N, k)."""
        scaled, gain = design / self.error[:, None], self.gain / self.error
        covariance = np.asarray(np.linalg.pinv(scaled.T @ scaled), np.float64)
        values = covariance @ (scaled.T @ gain)
        return float(((scaled @ values - gain) ** 2).sum()), values, covariance

    def is_straight(self, count: int) -> bool:
        """Whether the first ``count`` levels have one K within their errors."""
        gain, error = self.gain[:count], self.error[:count]
        mean = np.average(gain, weights=1 / error**2)
        return bool(chi2.sf((((gain - mean) / error) ** 2).sum(), count - 1) > _CHANCE)

    def bent(self, straight: int, beyond: int) -> tuple[Floats, Floats]:
        """Shares of points, and the design of straight lines between them, constant before the first.

        straight: number of levels up to the first point; beyond: number of points after it, at levels: the last one,
        and those with which the fit improves most, one after the other.
        """
        chosen = [straight - 1, len(self.shares) - 1]
        while len(chosen) <= beyond:
            others = [index for index in range(straight, len(self.shares) - 1) if index not in chosen]
            tried = [sorted([*chosen, index]) for index in others]
            chosen = min(tried, key=lambda points: self.fit(self._lines(points))[0])
        return self.shares[chosen], self._lines(chosen)

    def _lines(self, points: Sequence[int]) -> Floats:
        nodes = self.shares[list(points)]
        return np.stack([np.interp(self.shares, nodes, unit) for unit in np.eye(len(nodes))], 1)


def bend_of(flat: Sequence[Level], fit: Transfer, top_dn: float, *, tone: bool) -> Bend | None:
    """The bend that explains the variances of ``flat``, levels that do not clip, significantly better than a line.

    top_dn: signal at which frames clip. tone: a power of the signal explains them, too, and the bend must be better.
    None if there is no bend.
    """
    gains = _Gains(flat, fit, top_dn)
    count = len(gains.shares)
    if count < _FEWEST:
        return None
    plain = [gains.fit(np.ones((count, 1)))[0]]
    if tone:
        plain.append(gains.fit(np.stack([np.ones(count), np.log(gains.shares)], 1))[0])
    tried: list[tuple[bool, float, int, int]] = []
    for straight in (1, *np.flatnonzero(gains.shares >= _STRAIGHT)[:-1] + 1):
        if straight > 1 and not gains.is_straight(straight):
            break
        for beyond in range(1, min(_MOST_POINTS, count - int(straight)) + 1):
            freedom = (
                count - beyond - (2 if straight > 1 else 1)
            )  # values of points, and the share of the first
            if freedom > 0:
                left = gains.fit(gains.bent(straight, beyond)[1])[0]
                # F test: what the further points explain, over what is left; never over less than chance leaves.
                gained = (min(plain) - left) / (count - 1 - freedom) / max(1.0, left / freedom)
                chance = float(fisher.logsf(gained, count - 1 - freedom, freedom))
                # a straight part that explains all levels comes first
                whole = straight > 1 and bool(chi2.sf(left, freedom) > _CHANCE)
                if chance < math.log(_CHANCE):
                    tried.append((not whole, chance, int(straight), beyond))
    if not tried:
        return None
    _, _, straight, beyond = min(tried)
    nodes, design = gains.bent(straight, beyond)
    chi_square, values, covariance = gains.fit(design)
    # Where points scatter more than their errors say, the errors are too small.
    widened = max(1.0, chi_square / max(1, count - len(nodes)))
    if straight > 1:
        factors = values / values[0]
        along = np.eye(len(nodes)) / values[0]
        along[:, 0] -= factors / values[0]
    else:
        factors, along = values / fit.gain, np.eye(len(nodes)) / fit.gain
    errors = np.sqrt(widened * np.maximum(0.0, np.diag(along @ covariance @ along.T)))
    away = np.abs(factors - 1)
    if not (away > np.maximum(_LEAST, Z * errors)).any():
        return None
    pairs = zip(factors.tolist(), errors.tolist(), strict=True)
    straight_dn = float(gains.mean_dn[straight - 1]) if straight > 1 else None
    points = tuple(Uncertain(*pair).interval(0.0) for pair in pairs)
    return Bend(tuple(nodes.tolist()), points, top_dn, straight_dn)
