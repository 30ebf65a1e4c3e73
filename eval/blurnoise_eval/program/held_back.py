"""How wrong a surface over light and exposure is where nothing was measured, by scores that are held back from it.

Domain: places (log2 of lux s, log2 of the motion in px) at one speed, as :func:`.by_speed.places_at` has them; scores
in the criterion's unit. Every other exposure of each light, then every other light, is held back and predicted from
what stays, with a surface that is fitted to this alone. Held back, a score is twice as far from its neighbours as a
place between tested conditions is, so the errors are rather too large than too small.

The error goes with the spread of the scores that it is predicted from: a wide plateau has small errors beside a cliff
with large ones. A run's errors, as shares of these spreads, are taken at their 95 % quantile. It is the rank of
Vovk, Gammerman and Shafer, *Algorithmic Learning in a Random World* (2005): of n errors the one that the next of
their kind exceeds with a probability of at most 5 %.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from blurnoise_eval.run.surface import Kriging

UNKNOWN = 1.0
"""The error as a share of the spread where nothing can be held back: scores there may be any of those around."""
_COVERED, _SIGMAS = 0.95, 1.96  # of a normal distribution
_LEAST_KEPT = 4  # nodes of a surface: two coefficients and two of their departures
_DIGITS = 9  # of a light in lux
_EQUAL = 1e-9  # spread below which scores are alike, and none of them tells how errors go with it
Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


def can_be_held_back(kinds: Mapping[float, object]) -> list[float]:
    """The lights that can be held back: those between two of their own kind. kinds: by light, from dark to bright.

    >>> can_be_held_back({1.0: "lamp", 10.0: "lamp", 100.0: "lamp", 20000.0: "sun"})
    [10.0]
    """
    lights = [*kinds]
    neighbours = zip(lights, lights[1:], lights[2:], strict=False)
    return [light for dark, light, bright in neighbours if kinds[dark] == kinds[light] == kinds[bright]]


def spread_around(surface: Kriging, places: ArrayLike, mean: ArrayLike) -> Array:
    """RMS distance (M,) of the nodes' scores from those predicted at places (M, 2), by the nodes' weights there."""
    weights = np.abs(surface.weights(np.asarray(places, float)))
    squares = (surface.values - np.asarray(mean, float)[:, None]) ** 2
    return np.asarray(np.sqrt((weights * squares).sum(axis=1) / weights.sum(axis=1)))


def share_of_spread(lit: Iterable[tuple[Kriging, Array]], lights: Sequence[float]) -> float:
    """The standard deviation of an error as a share of the spread around it, of what is held back of surfaces.

    lit: each surface with the lights (N,) of its nodes. lights: those that can be held back. Both in lux. ``UNKNOWN``
    where nothing can be held back: fewer than three exposures of each light, and none of these lights.
    """
    shares = np.sort(np.concatenate([np.empty(0), *(each for of in lit for each in _shares(*of, lights))]))
    if not len(shares):
        return UNKNOWN
    rank = min(math.ceil(_COVERED * (len(shares) + 1)), len(shares))
    return float(shares[rank - 1]) / _SIGMAS


def _shares(surface: Kriging, lux: Array, lights: Sequence[float]) -> Iterator[Array]:
    """Absolute errors of what is held back, as shares of the spreads around them, one array for each time."""
    for held in _folds(surface.places, lux, lights):
        places, scores = surface.places[~held], surface.values[~held]
        if not held.any() or len(places) < _LEAST_KEPT:
            continue
        # Fitted anew, trend and lengths: a surface that has seen a score knows it too well.
        known = Kriging.fit(places, scores, surface.trend if surface.coefficients is not None else None)
        predicted = known.mean(surface.places[held]).clip(0.0, scores.max())
        spread = spread_around(known, surface.places[held], predicted)
        error = np.abs(predicted - surface.values[held])
        yield error[spread > _EQUAL] / spread[spread > _EQUAL]


def _folds(places: Array, lux: Array, lights: Sequence[float]) -> Iterator[Flags]:
    """Which nodes (N,) are held back together: every other exposure of each light but its first and last, then every
    other light of those that can be."""
    of_light = np.unique(lux.round(_DIGITS), return_inverse=True)[1].ravel()
    number, inner = np.zeros(len(places), np.int64), np.zeros(len(places), bool)
    for light in range(int(of_light.max()) + 1):
        own = np.flatnonzero(of_light == light)
        number[own[np.argsort(places[own, 1])]] = np.arange(len(own))
        inner[own] = (number[own] > 0) & (number[own] < len(own) - 1)
    for odd in (0, 1):
        yield inner & (number % 2 == odd)
    can_be = np.isclose(lux[:, None], lights, rtol=1e-6).any(axis=1)
    for odd in (0, 1):
        yield can_be & (of_light % 2 == odd)
