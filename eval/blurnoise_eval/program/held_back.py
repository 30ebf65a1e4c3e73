"""How wrong a surface over light and exposure is where nothing was measured, by scores that are held back from it.

Domain: places (log2 of lux s, log2 of the motion in px) at one speed, as :func:`.by_speed.places_at` has them; scores
in the criterion's unit; gaps between lights and between exposures in stops. Every other exposure of each light, then
every other light, is held back and predicted from what stays, with a surface that is fitted to this alone.

A score that is held back d stops from its nearest neighbour shows errors in gaps of up to 2 d, in which no place is
farther from its own. On an even grid the gaps are half of that, so the errors are rather too large than too small.

The error goes with the spread of the scores that it is predicted from: a wide plateau has small errors beside a cliff
with large ones. A run's errors, as shares of these spreads, are taken at their 95 % quantile. It is the rank of
Vovk, Gammerman and Shafer, *Algorithmic Learning in a Random World* (2005): of n errors the one that the next of
their kind exceeds with a probability of at most 5 %, which 19 or more have.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from blurnoise_eval.run.surface import Kriging

UNKNOWN = 1.0
"""The error as a share of the spread where too few scores were held back: one may be any of those around."""
LEAST = 19
"""How many errors have a 95 % rank."""
_COVERED, _SIGMAS = 0.95, 1.96  # of a normal distribution
_EQUAL = 1e-9  # spread below which scores are alike, and none of them tells how errors go with it
_HAIR = 1e-6  # stops, in which logarithms are rounded
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


def gaps_around(nodes: Array, places: Array) -> tuple[Array, Array]:
    """Stops (M,) between the lights of nodes (N, 2) on both sides of places (M, 2); and between the exposures on both
    sides, at whichever of these lights they are farther apart. 0 at a node's own, and twice the way beyond the last.

    >>> nodes = np.array([[0.0, 1.0], [1.0, 2.0], [3.0, 4.0]])  # one light; exposures one and two stops apart
    >>> wide, long = gaps_around(nodes, np.array([[2.0, 3.0], [3.0, 5.0], [1.5, 2.0]]))
    >>> wide.tolist(), long.tolist()
    ([0.0, 2.0, 1.0], [2.0, 2.0, 0.0])
    """
    light, at = (each[:, 0] - each[:, 1] for each in (nodes, places))
    lights, of_light = np.unique(light.round(6), return_inverse=True)
    long = np.zeros(len(places))
    for each in range(len(lights)):
        beside = np.any([number == each for number in _beside(lights, at)], axis=0)
        long[beside] = np.maximum(long[beside], _gaps(nodes[of_light == each, 1], places[beside, 1]))
    return _gaps(lights, at), long


def _beside(rising: Array, at: Array) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The numbers (M,) of the nearest values below and above; both the same at a value and beyond the last."""
    below, above = np.searchsorted(rising, at + _HAIR) - 1, np.searchsorted(rising, at - _HAIR)
    return np.maximum(below, 0), np.minimum(above, len(rising) - 1)


def _gaps(known: Array, at: Array) -> Array:
    rising = np.sort(known)
    below, above = (rising[number] for number in _beside(rising, at))
    gaps = np.maximum(above - below, 2 * np.maximum(below - at, at - above))
    return np.where(gaps > 2 * _HAIR, gaps, 0.0)


class Errors(NamedTuple):
    """Errors (N,) as shares of the spreads around them, of scores so many stops (N,) from what stayed."""

    stops: Array
    shares: Array

    def number(self, gap: float) -> int:
        """How many show errors in a gap so wide, stops."""
        return int((2 * self.stops >= gap - _HAIR).sum())

    def share(self, gap: float) -> float:
        """The standard deviation of an error in a gap so wide, as a share of the spread around it."""
        shares = np.sort(self.shares[2 * self.stops >= gap - _HAIR])
        if len(shares) < LEAST:
            return UNKNOWN
        return float(shares[math.ceil(_COVERED * (len(shares) + 1)) - 1]) / _SIGMAS

    def shares_in(self, gaps: Array) -> Array:
        """Those in gaps (M,)."""
        different, which = np.unique(gaps, return_inverse=True)
        return np.array([self.share(gap) for gap in different.tolist()])[which]


class HeldBack(NamedTuple):
    """The errors of lights that were held back, and of exposures."""

    lights: Errors
    exposures: Errors

    def shares_at(self, places: Array, nodes: Array) -> Array:
        """The standard deviations (M,) of errors at places (M, 2), by the gaps between nodes (N, 2) that they lie in,
        as shares of the spreads around them."""
        wide, long = gaps_around(nodes, places)
        return np.maximum(np.where(wide, self.lights.shares_in(wide), 0.0), self.exposures.shares_in(long))


def hold_back(lit: Iterable[tuple[Kriging, Array]], lights: Sequence[float]) -> HeldBack:
    """The errors of what is held back.

    lit: each surface with the lights (N,) of its nodes. lights: those that can be held back. Both in lux.
    """
    found: tuple[list[Array], list[Array]] = ([np.empty((2, 0))], [np.empty((2, 0))])
    for surface, lux in lit:
        for axis, held in _folds(surface.places, lux, lights):
            found[axis].append(_errors(surface, held, axis))
    return HeldBack(*(Errors(*np.concatenate(each, axis=1)) for each in found))


def _errors(surface: Kriging, held: Flags, axis: int) -> Array:
    """Of what is held back, (2, N): stops to the nearest that stays, along light (0) or exposure (1), and absolute
    errors as shares of the spreads around."""
    places, scores = surface.places[~held], surface.values[~held]
    # Fitted anew, trend and lengths: a surface that has seen a score knows it too well.
    known = Kriging.fit(places, scores, surface.trend if surface.coefficients is not None else None)
    predicted = known.mean(surface.places[held]).clip(0.0, scores.max())
    spread = spread_around(known, surface.places[held], predicted)
    error = np.abs(predicted - surface.values[held])
    light = surface.places[:, 0] - surface.places[:, 1]
    apart = np.abs(np.subtract.outer(light[held], light[~held]))
    if axis:
        along = np.abs(np.subtract.outer(surface.places[held, 1], places[:, 1]))
        apart = np.where(apart < _HAIR, along, np.inf)
    tells = spread > _EQUAL
    return np.stack([apart.min(axis=1)[tells], error[tells] / spread[tells]])


def _folds(places: Array, lux: Array, lights: Sequence[float]) -> Iterator[tuple[int, Flags]]:
    """Which nodes (N,) are held back together, and whether by exposure (1): every other exposure of each light but
    its first and last, then every other light of those that can be."""
    of_light = np.unique((places[:, 0] - places[:, 1]).round(6), return_inverse=True)[1].ravel()
    number, inner = np.zeros(len(places), np.int64), np.zeros(len(places), bool)
    for light in range(int(of_light.max()) + 1):
        own = np.flatnonzero(of_light == light)
        number[own[np.argsort(places[own, 1])]] = np.arange(len(own))
        inner[own] = (number[own] > 0) & (number[own] < len(own) - 1)
    can_be = np.isclose(lux[:, None], lights, rtol=1e-6).any(axis=1)
    for axis, some, numbers in ((1, inner, number), (0, can_be, of_light)):
        for odd in (0, 1):
            if (held := some & (numbers % 2 == odd)).any():
                yield axis, held
