"""Whether the pictures decide for an exposure, whatever the model scores with it.

The decision needs fewer pictures than the level: what makes a picture hard makes it so at every exposure, and cancels
in the differences between exposures, which are paired by cluster of pictures.

Domain: exposures in s; gains in the criterion's unit: a score, or the share of it that is kept. S rivals, n clusters.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.scoring import uncertainty

Array = NDArray[np.float64]
SETTLED = 0.03
"""An exposure is settled where every other one loses, or gains at most this. Chosen: half of the 0.06 by which the
level of a good exposure is known from 20 pictures."""
_MOST_PICTURES = 9999
_ONE_SIDED = 2 * uncertainty.CONFIDENCE - 1  # of a two-sided interval whose upper end holds with 95 %
_NORMAL = 1.645  # standard errors above the mean that hold 95 % of a normal distribution, one-sided


class Rivals(NamedTuple):
    """The other exposures that may be used, and what they gain over the chosen one.

    exposures_s: (S,). gain: (S,) their mean less that of the chosen one. influence: (n, S) of clusters on the gain.
    sigma: (S,) its standard error beside that, of predictions. effective: how many clusters of one size there are.
    untested_gain: what one more exposure may gain that was not tested, by a search; None where all were.
    """

    exposures_s: Array
    gain: Array
    influence: Array
    sigma: Array
    effective: float
    untested_gain: float | None = None


class AsGood(NamedTuple):
    """The tested exposures, s, about the chosen one that score at most ``SETTLED`` less, without a worse one between.

    from_open, to_open: whether the next shorter, the next longer one of the grid was not tested, or there is none.
    """

    from_s: float
    to_s: float
    from_open: bool
    to_open: bool


class Settled(NamedTuple):
    """Whether an exposure is settled.

    sure: None where it is not known: from fewer than ``FEWEST`` clusters, or without a rival. rival_s: the rival that
    may gain most, and gain_95 what that is, at 95 %; below 0 where every rival surely loses. pictures: where the
    exposure is not settled, how many pictures settle half of such cases; None above 9999. untested_gain: what an
    exposure may gain that was not tested, by a search; None where all were.
    """

    sure: bool | None = None
    rival_s: float | None = None
    gain_95: float | None = None
    pictures: int | None = None
    untested_gain: float | None = None


def settled(rivals: Rivals) -> Settled:
    """Whether every rival loses, or gains at most ``SETTLED``: whether the upper bounds of all gains are below that.

    Each bound is Student's, one-sided at 95 %. They need not hold together: the claim is wrong only if the truly best
    rival passes its own test, which happens in at most 5 % (an intersection-union test, Berger, Technometrics 24
    (1982) 295). With the quantile of the largest of S Student's t a third fewer exposures are settled by 20
    photographs, and no fewer claims are wrong.

    >>> away = np.array([[0.1], [-0.1]] * 10)  # of 20 pictures half gain 0.1 more, half 0.1 less
    >>> worse = Rivals(np.array([0.002]), np.array([-0.05]), away, np.zeros(1), effective=20.0)
    >>> settled(worse).sure
    True
    >>> alike = settled(worse._replace(gain=np.zeros(1)))
    >>> alike.sure, round(alike.gain_95, 3), alike.pictures  # one may be better than the other by more than 0.03
    (False, 0.04, 35)
    """
    untested = rivals.untested_gain
    # A search bounds what it has not tested, in these pictures; without a bound only a tested rival tells.
    bounded = untested is not None and untested <= SETTLED
    if rivals.effective < uncertainty.FEWEST:
        return Settled()
    if not len(rivals.gain):
        return Settled(sure=bounded or None, untested_gain=untested)
    high = uncertainty.of_difference(rivals.gain, rivals.influence, _ONE_SIDED).high
    # What clusters differ by and what a prediction misses are independent: their squares add.
    most = rivals.gain + np.hypot(high - rivals.gain, _NORMAL * rivals.sigma)
    if not np.isfinite(most).any():
        return Settled()
    place = int(np.nanargmax(most))
    at, gain_95 = float(rivals.exposures_s[place]), float(most[place])
    if gain_95 > SETTLED:
        return Settled(False, at, gain_95, _pictures(rivals, most), untested)
    return Settled(bounded or untested is None or None, at, gain_95, None, untested)


def _pictures(rivals: Rivals, most: Array) -> int | None:
    """How many pictures bring the bounds down to ``SETTLED``, if the gains stay as they are: half-widths shrink with
    the root of their number."""
    spare = SETTLED - rivals.gain
    if (spare <= 0).any():
        return None
    n = int(np.isfinite(rivals.influence).any(axis=1).sum())
    needed = n * float(np.nanmax((most - rivals.gain) / spare)) ** 2
    return None if needed > _MOST_PICTURES else max(math.ceil(needed), n + 1)


def alike(exposures_s: Array, values: Array, of_grid: NDArray[np.bool_], chosen: int) -> AsGood:
    """Of exposures (E,). values: (E,), NaN where not tested, 0 where they saturate too much. of_grid: (E,).

    >>> at, every = np.array([0.001, 0.002, 0.004, 0.008]), np.ones(4, bool)
    >>> alike(at, np.array([0.5, 0.9, 0.88, np.nan]), every, 1)
    AsGood(from_s=0.002, to_s=0.004, from_open=False, to_open=True)
    """
    tested, place = np.isfinite(values), np.arange(len(values))
    worse = values < values[chosen] - SETTLED
    below = int(place[worse & (place < chosen)].max(initial=-1))
    above = int(place[worse & (place > chosen)].min(initial=len(values)))
    alike_ones = [n for n in range(below + 1, above) if tested[n]]
    first, last = alike_ones[0], alike_ones[-1]
    unknown = of_grid & ~tested
    return AsGood(
        float(exposures_s[first]),
        float(exposures_s[last]),
        from_open=below < 0 or bool(unknown[below:first].any()),
        to_open=above == len(values) or bool(unknown[last:above].any()),
    )
