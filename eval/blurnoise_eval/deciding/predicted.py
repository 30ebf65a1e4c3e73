"""Predicted sums of clusters anywhere in the plane, from what was observed at scattered nodes.

Domain: places (u, w) of :mod:`blurnoise_eval.deciding.nodes`. Values are sums by counts: a mean's counts are numbers
of targets, a kept share's what the same model reaches in the untouched pictures. Nodes may be those of a search or of
a full grid.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from blurnoise_eval.answers.plane import same_places
from blurnoise_eval.deciding.kriging import Kriging
from blurnoise_eval.deciding.nodes import STEP
from blurnoise_eval.deciding.trend import USUAL, Trend

Array = NDArray[np.float64]


class At(NamedTuple):
    """What is predicted of C clusters at M places: sums and counts (C, M)."""

    sums: Array
    counts: Array


class Predicted:
    """The surfaces of C clusters through N nodes.

    places: (N, 2). sums, counts: (C, N); where a cluster was not observed both are 0, or NaN. Nodes at one place
    count as one. trend: what the surface is guided by. most: the greatest value there can be. Raises ``ValueError``
    for shapes that do not fit, and where nothing was observed.
    """

    def __init__(
        self,
        places: ArrayLike,
        clusters: Sequence[str],
        sums: ArrayLike,
        counts: ArrayLike,
        trend: Trend | None = USUAL,
        most: float = 1.0,
    ) -> None:
        at = np.asarray(places, float).reshape(-1, 2)
        total, count = np.nan_to_num(np.asarray(sums, float)), np.nan_to_num(np.asarray(counts, float))
        if not total.shape == count.shape == (len(clusters), len(at)):
            raise ValueError(
                f"sums, counts: {total.shape} and {count.shape}; must be ({len(clusters)}, {len(at)}), "
                "clusters by places"
            )
        if not (count > 0).any():
            raise ValueError("counts: all are 0; must be above 0 somewhere")
        self.clusters = tuple(clusters)
        different, which = same_places(at)
        own = np.eye(len(different))[which]
        total, count = total @ own, count @ own
        seen = (count > 0).any(axis=0)
        self.places, self._sums, self._counts = different[seen], total[:, seen], count[:, seen]
        self._trend = trend
        self.most = most

    @cached_property
    def surface(self) -> Kriging:
        """The mean's."""
        return Kriging.fit(self.places, self._mean, self._trend)

    @property
    def _mean(self) -> Array:
        """Of all clusters at the nodes, (N,)."""
        return np.asarray(self._sums.sum(axis=0) / self._counts.sum(axis=0))

    def on(self, places: ArrayLike) -> At:
        """What is predicted at places (M, 2). Beside a cliff a surface swings beyond its nodes, where no model was
        seen: all clusters are moved alike there, to a mean between 0 and the greatest observed."""
        at = np.asarray(places, float).reshape(-1, 2)
        sums, counts = np.zeros((2, len(self.clusters), len(at)))
        known = self._counts > 0
        for pattern in np.unique(known, axis=0):
            if not pattern.any():
                continue
            alike = (known == pattern).all(axis=1)
            surface = self.surface if pattern.all() else self.surface.through(self.places[pattern])
            weights = surface.weights(at)
            of_each = self._counts[alike][:, pattern]
            counts[alike] = of_each.mean(axis=1, keepdims=True)
            sums[alike] = (self._sums[alike][:, pattern] / of_each) @ weights.T * counts[alike]
        mean = sums.sum(axis=0) / counts.sum(axis=0)
        sums += counts * (mean.clip(0.0, self._mean.max()) - mean)
        return At(sums, counts)

    def inside(self, places: ArrayLike) -> NDArray[np.bool_]:
        """Which of the places (M, 2) lie among the nodes, within half a step of their hull."""
        at = np.asarray(places, float).reshape(-1, 2)
        corners = _hull(self.places)
        if len(corners) == 1:
            return np.asarray((np.abs(at - corners[0]) <= STEP / 2).all(axis=1))
        sides = np.roll(corners, -1, axis=0) - corners
        outward = np.stack([sides[:, 1], -sides[:, 0]], axis=1) / np.hypot(*sides.T)[:, None]
        beyond = ((at[:, None] - corners[None]) * outward[None]).sum(axis=-1).max(axis=1)
        within = (at >= self.places.min(axis=0) - STEP / 2) & (at <= self.places.max(axis=0) + STEP / 2)
        return np.asarray((beyond <= STEP / 2) & within.all(axis=1))


def _hull(places: Array) -> Array:
    """Corners of the convex hull, anticlockwise, (K, 2): Andrew's chain. Of places on one line its two ends."""
    ordered = np.unique(places, axis=0)
    if len(ordered) < 2:
        return ordered

    def chain(points: Array) -> list[Array]:
        kept: list[Array] = []
        for point in points:
            while len(kept) > 1 and _turn(kept[-2], kept[-1], point) <= 1e-12:
                kept.pop()
            kept.append(point)
        return kept[:-1]

    return np.array([*chain(ordered), *chain(ordered[::-1])])


def _turn(a: Array, b: Array, c: Array) -> float:
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))
