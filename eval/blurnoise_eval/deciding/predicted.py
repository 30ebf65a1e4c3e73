"""Scores predicted anywhere in the plane, cluster by cluster, from what was observed at scattered nodes.

Domain: places (u, w) of :mod:`blurnoise_eval.answers.plane`. Values are sums by counts, as a
:class:`~blurnoise_eval.answers.table.ScoreTable` has them. Nodes may be those of a search or of a full grid.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from blurnoise_eval.answers.table import ScoreTable
from blurnoise_eval.deciding.kriging import USUAL, Kriging, Trend
from blurnoise_eval.deciding.lines import STEP, exposures_on
from blurnoise_eval.deciding.question import Question

CAUTION = 1.5
"""Inflation of the kriging sigma, calibrated by ``python -m blurnoise_eval.bench decide``."""
PER_STOP = 12
"""Predicted exposures on a line."""
_HAIR = 1e-6  # stops by which the hull of nodes is widened, so that one of a single line has an area
Array = NDArray[np.float64]


class At(NamedTuple):
    """The prediction of C clusters at M places: sums and counts (C, M)."""

    sums: Array
    counts: Array


class Predicted:
    """The surfaces of the clusters of a plane, as :meth:`ScoreTable.on_plane` has it, through its nodes.

    trend: what the surface is guided by.
    """

    def __init__(self, seen: ScoreTable, trend: Trend | None = USUAL) -> None:
        known = seen.measured
        self.clusters, self.most, self._trend = seen.clusters, seen.most, trend
        self.places, self._sums, self._counts = seen.places[known], seen.sums[:, known], seen.counts[:, known]
        self._mean = seen.mean[known]

    @cached_property
    def surface(self) -> Kriging:
        """The mean's."""
        return Kriging.fit(self.places, self._mean, self._trend)

    def on(self, places: ArrayLike) -> At:
        """The prediction at places (M, 2). Beside a cliff a surface swings beyond its nodes, where no model was
        seen: all clusters are moved alike there, to a mean between 0 and the greatest observed."""
        at = np.asarray(places, float).reshape(-1, 2)
        sums, counts = np.zeros((2, len(self.clusters), len(at)))
        known = self._counts > 0
        for pattern in np.unique(known[known.any(axis=1)], axis=0):
            alike = (known == pattern).all(axis=1)
            surface = self.surface if pattern.all() else self.surface.through(self.places[pattern])
            of_each = self._counts[alike][:, pattern]
            counts[alike] = of_each.mean(axis=1, keepdims=True)
            rates = self._sums[alike][:, pattern] / of_each
            sums[alike] = rates @ surface.weights(at).T * counts[alike]
        mean = sums.sum(axis=0) / counts.sum(axis=0)
        sums += counts * (mean.clip(0.0, self._mean.max()) - mean)
        return At(sums, counts)

    @cached_property
    def _sides(self) -> Array:
        """Outward normals of the nodes' hull and its distance from 0, (K, 3)."""
        from scipy.spatial import ConvexHull  # takes 0.2 s

        corners = _HAIR * np.array([(-1, -1), (-1, 1), (1, -1), (1, 1)])
        return np.asarray(ConvexHull((self.places[:, None] + corners).reshape(-1, 2)).equations)

    def inside(self, places: ArrayLike) -> NDArray[np.bool_]:
        """Which of the places (M, 2) lie among the nodes, within half a step of their hull."""
        at = np.asarray(places, float).reshape(-1, 2)
        beyond = (at @ self._sides[:, :2].T + self._sides[:, 2]).max(axis=1)
        reach = STEP / 2 + _HAIR
        within = (at >= self.places.min(axis=0) - reach) & (at <= self.places.max(axis=0) + reach)
        return np.asarray((beyond <= reach) & within.all(axis=1))


def predicted_table(seen: ScoreTable, question: Question, trend: Trend) -> ScoreTable:
    """Of one plane the table of all lines of the question, ``PER_STOP`` exposures to a stop; without conditions where
    the model knows too little. The covariance of the prediction is that of the surface, ``CAUTION`` times as wide."""
    if seen.knows_too_little:
        return seen.take([])
    exposures = exposures_on(question.exposures_s, PER_STOP)
    lines = sorted(question.lines, key=lambda line: (line.illuminance_lux, line.velocity_px_s))
    count = len(lines) * len(exposures)
    conditions = {name: np.full(count, values[0]) for name, values in seen.conditions.items()}
    conditions["exposure_s"] = np.tile(exposures, len(lines))
    for name in lines[0].axes:
        conditions[name] = np.repeat([line.axes[name] for line in lines], len(exposures))
    places = np.concatenate([line.places(exposures) for line in lines])
    plane = Predicted(seen, trend)
    at = plane.on(places)
    return replace(
        seen,
        conditions=conditions,
        sums=at.sums,
        counts=at.counts,
        saturated=_by_light(seen, seen.saturated, places),
        brightness=_by_light(seen, seen.brightness, places),
        prediction_cov=lambda those: CAUTION**2 * plane.surface.covariance(places[those]),
    )


def _by_light(seen: ScoreTable, values: Array, places: Array) -> Array:
    """At places (M, 2), between the nodes' values (N,), which depend on the light and hardly on motion."""
    known = np.isfinite(values)
    if not known.any():
        return np.full(len(places), np.nan)
    lights, which = np.unique(seen.places[known, 0], return_inverse=True)
    return np.asarray(np.interp(places[:, 0], lights, np.bincount(which, values[known]) / np.bincount(which)))
