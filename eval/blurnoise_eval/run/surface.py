"""Surfaces of a score over the plane: its value between scattered nodes, cluster by cluster, and how uncertain it is.

Domain: places (u, w) of :mod:`blurnoise_eval.answers.plane`, in stops; values in any unit, sigma in the same. Nodes
may be those of a search or of a full grid.

Universal kriging (Cressie, Statistics for Spatial Data, 1993, 3.4) on a constant and a :class:`Trend`, with a Matern
5/2 covariance, one length per axis, and a nugget. The trend is a logistic curve of signal to noise, motion and
saturation, as high as the highest score measured: it guides a surface between few nodes and need not be right.
Places may have further coordinates, for what tells experiments at one place of the plane apart; they share a length.
Lengths and nugget are the most probable ones: restricted likelihood, lengths log-normal about ``USUAL_LENGTH``.
A prediction is a weighted sum of the nodes' values. The weights of a fitted surface depend on places alone, so
every cluster's surface has those of the mean's.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from blurnoise.camera import Camera
from blurnoise.camera.radiometry import electrons_per_lux_s
from blurnoise.camera.spectra import Curve
from blurnoise.picture import fusion
from blurnoise_eval.answers.table import ScoreTable
from blurnoise_eval.run.search_space import STEP, SearchSpace, exposures_on, spread

CAUTION = 1.5
"""Inflation of the kriging sigma, calibrated on searches that were replayed on dense sweeps."""
PER_STOP = 12  # predicted exposures on a line
USUAL_LENGTH = 3.3  # stops
_LENGTH_SPREAD = 0.6  # of its natural logarithm
_USUAL_SCALE, _SCALE_WEIGHT = 0.05, 2.0  # deviation about the trend, as if so many values had shown it
_LENGTHS, _NUGGETS = np.log((0.3, 12.0)), np.log((1e-6, 0.05))  # least and most
_STEPS = 4, 3  # of the grid of their logarithms, from end to end
_HALVINGS = 4  # of the grid's step, about the best so far
_MOST_FITTED = 120  # nodes that they are chosen by
_FLAT = 0.02  # share of its top below which the range of a trend counts as none
_CONTRAST, _GREY = 0.62, 0.3  # of a target, and its mean reflectance
_MOTION_PX, _MOST_MOTION = 16.0, 8.0
_PENALTY = 0.002 * np.array([0.1, 1, 1, 1, 1, 1, 1])  # on squares of the coefficients: a cliff may be steep
_MOST_LOGIT = 30.0
_HAIR = 1e-6  # stops by which the hull of nodes is widened, so that one of a single line has an area
Array = NDArray[np.float64]


class Trend(NamedTuple):
    """Figures of a camera: electrons per lux s of a white pixel, the noise in the dark, e-, and the light at which
    white saturates, lux s.

    >>> Trend().features(np.array([[0.0, -1.0]])).shape
    (1, 7)
    """

    electrons_per_lux_s: float = 7000.0
    noise_e: float = 2.5
    full_lux_s: float = 1.5

    @classmethod
    def of(cls, camera: Camera, illuminant: str | Curve = "D55") -> Trend:
        """That of a camera at its base gain."""
        per_lux_s = electrons_per_lux_s(camera, illuminant)
        noise_e = math.sqrt(camera.sensor.dark_variance_dn2()) / camera.sensor.system_gain_dn_per_e
        return cls(per_lux_s, noise_e, fusion.saturations_e(camera)[-1] / per_lux_s)

    def features(self, places: Array) -> Array:
        """(N, 7): 1, s, s^2, L, L^2, log (1 + L^2), o; s: signal to noise, L: motion, o: beyond saturation."""
        light = 2.0 ** places[:, 0]
        electrons = self.electrons_per_lux_s * light
        signal = np.log2(_CONTRAST * electrons / np.sqrt(_GREY * electrons + self.noise_e**2)) / 4
        motion = np.minimum(2.0 ** places[:, 1] / _MOTION_PX, _MOST_MOTION)
        over = np.log2(1 + (light / self.full_lux_s) ** 2) / 4
        blur = np.log2(1 + 4.0 ** places[:, 1]) / 4
        return np.stack([np.ones(len(places)), signal, signal**2, motion, motion**2, blur, over], axis=1)


USUAL = Trend()
"""Of a machine-vision camera at f/1.4: where the camera is not known."""


def logistic(logits: Array) -> Array:
    """1 / (1 + exp(-x)).

    >>> logistic(np.array([-1000.0, 0.0])).round(6).tolist()
    [0.0, 0.5]
    """
    return np.asarray(1 / (1 + np.exp(-np.clip(logits, -_MOST_LOGIT, _MOST_LOGIT))))


def fractional_logistic(features: Array, shares: Array, penalty: Array) -> Array:
    """Coefficients (K,) of a logistic regression of shares (N,) on features (N, K).

    penalty: (K,) on half the squares of the coefficients.

    >>> features = np.array([[1.0, -1.0], [1.0, 1.0]])
    >>> at = fractional_logistic(features, np.array([0.25, 0.75]), np.full(2, 1e-9))
    >>> logistic(features @ at).round(3).tolist()
    [0.25, 0.75]
    """
    from scipy.optimize import minimize  # takes 0.2 s

    def loss(at: Array) -> tuple[float, Array]:
        logits = features @ at
        value = (np.logaddexp(0, logits) - shares * logits).sum() + penalty @ at**2 / 2
        return value, features.T @ (logistic(logits) - shares) + penalty * at

    start = np.zeros(features.shape[1])
    return np.asarray(minimize(loss, start, jac=True, method="BFGS", options={"gtol": 1e-9}).x)


@dataclass(frozen=True, eq=False)
class Kriging:
    """A fitted surface through values (N,) at places (N, 2), or (N, D) with further coordinates.

    lengths: of the covariance along u and w, (2,), and one along what comes beside them, (3,). nugget: variance of a
    node's own departure, in ``scale`` squared.
    coefficients: of the trend's features; None: a constant in place of the trend.
    """

    places: Array
    values: Array
    lengths: Array
    nugget: float
    trend: Trend = USUAL
    coefficients: Array | None = None

    @classmethod
    def fit(cls, places: ArrayLike, values: ArrayLike, trend: Trend | None = USUAL) -> Kriging:
        """Through values (N,), finite, at places (N, 2) or (N, D), all different. trend: None: a constant."""
        at, known = np.asarray(places, float), np.asarray(values, float)
        guide = trend or USUAL
        coefficients = None if trend is None else _trend_of(at, known, trend)
        # Each try inverts a matrix of the nodes: time by the cube of their number.
        some = np.sort(spread(at, _MOST_FITTED)) if len(at) > _MOST_FITTED else np.arange(len(at))

        def improbability(logarithms: Array) -> float:
            *lengths, nugget = np.exp(logarithms)
            tried = cls(at[some], known[some], np.array(lengths), nugget, guide, coefficients)
            return tried._improbability

        n_lengths = min(at.shape[1], 3)
        least, most = np.array([_LENGTHS] * n_lengths + [_NUGGETS]).T
        steps = [_STEPS[0]] * n_lengths + [_STEPS[1]]
        step = (most - least) / steps
        # A grid and halvings of its step: the likelihood may have several maxima, and a descent ends in one.
        corners: Iterable[tuple[int, ...]] = product(*(range(1 + count) for count in steps))
        best = min((least + step * each for each in corners), key=improbability)
        for _ in range(_HALVINGS):
            step = step / 2
            around = (best + step * each for each in product((-1, 0, 1), repeat=len(step)))
            best = min((np.clip(each, least, most) for each in around), key=improbability)
        *lengths, nugget = np.exp(best).tolist()
        return cls(at, known, np.array(lengths), nugget, guide, coefficients)

    def weights(self, places: Array) -> Array:
        """Of the nodes' values in the surface at places (M, 2): (M, N), each row's sum 1."""
        return np.asarray((self._toward(places) @ self._inverse)[:, : len(self.places)])

    def mean(self, places: Array) -> Array:
        """The surface at places (M, 2), (M,)."""
        return np.asarray(self.weights(places) @ self.values)

    def sigma(self, places: Array) -> Array:
        """Standard deviation (M,) of the prediction of a value at places (M, 2), its own departure included."""
        toward = self._toward(places)
        known = ((toward @ self._inverse) * toward).sum(axis=1)
        return np.asarray(self.scale * np.sqrt(np.maximum(1.0 - known, 0.0) + self.nugget))

    def covariance(self, places: Array) -> Array:
        """Covariance (M, M) of the surface itself at places (M, 2), without their own departures."""
        toward = self._toward(places)
        known = toward @ self._inverse @ toward.T
        # Without the nugget: it is a node's own departure, not an error of the surface.
        return np.asarray(self.scale**2 * (correlation(places, places, self.lengths) - known))

    def basis(self, places: Array) -> Array:
        """A constant and the trend, as a share of its top, at places (M, 2): (M, K)."""
        one = np.ones((len(places), 1))
        if self.coefficients is None:
            return one
        return np.hstack([one, logistic(self.trend.features(places) @ self.coefficients)[:, None]])

    @cached_property
    def scale(self) -> float:
        """Standard deviation of the values about the trend."""
        return math.sqrt(self._variance)

    def _toward(self, places: Array) -> Array:
        """Right-hand sides of the kriging system for places (M, 2): (M, N + K)."""
        return np.hstack([correlation(places, self.places, self.lengths), self.basis(places)])

    @cached_property
    def _system(self) -> Array:
        """The nodes' correlation, bordered by the basis: (N + K, N + K)."""
        basis = self.basis(self.places)
        own = correlation(self.places, self.places, self.lengths) + self.nugget * np.eye(len(basis))
        return np.block([[own, basis], [basis.T, np.zeros((basis.shape[1],) * 2)]])

    @cached_property
    def _inverse(self) -> Array:
        return np.asarray(np.linalg.inv(self._system))

    @property
    def _degrees(self) -> float:
        return max(2 * len(self.places) - len(self._system), 0) + _SCALE_WEIGHT

    @property
    def _variance(self) -> float:
        """Of the departures from the trend, from their weighted square and a usual one."""
        known = np.pad(self.values, (0, len(self._system) - len(self.values)))
        square = max(float(known @ np.linalg.solve(self._system, known)), 0.0)
        return (square + _SCALE_WEIGHT * _USUAL_SCALE**2) / self._degrees

    @property
    def _improbability(self) -> float:
        """Minus twice the logarithm of the restricted likelihood times the lengths' prior."""
        volume = np.linalg.slogdet(self._system)[1]  # of the correlation and of the basis in it
        unusual = (((np.log(self.lengths) - np.log(USUAL_LENGTH)) / _LENGTH_SPREAD) ** 2).sum()
        return float(self._degrees * math.log(self._variance) + volume + unusual)


def _trend_of(places: Array, values: Array, trend: Trend) -> Array | None:
    """Coefficients (7,) of the trend of values (N,), not below 0, at places (N, 2); None where it is flat."""
    # A little above the highest value, where a logistic curve is reached only in the infinite.
    top = max(float(values.max(initial=0.0)), 1e-9) * 1.02
    features = trend.features(places)
    found = fractional_logistic(features, np.clip(values / top, 0.0, 1.0), _PENALTY)
    return None if np.ptp(logistic(features @ found)) <= _FLAT else found


def correlation(places: Array, others: Array, lengths: ArrayLike) -> Array:
    """Matern 5/2 between places (M, D) and others (N, D), (M, N); the last length is that of all further coordinates.

    >>> near, far = np.array([[0.0, 0.0]]), np.array([[0.0, 0.0], [3.0, 0.0]])
    >>> correlation(near, far, (3.0, 3.0)).round(2).tolist()  # 1, and at one length
    [[1.0, 0.52]]
    """
    given, n = np.asarray(lengths), places.shape[1]
    each = given[np.minimum(np.arange(n), len(given) - 1)]
    one, other = places / each, others / each
    # Twice differentiable, unlike an exponential: scores change smoothly with light and motion.
    far = np.sqrt(5.0 * sum(np.subtract.outer(one[:, k], other[:, k]) ** 2 for k in range(n)))
    return np.asarray((1 + far + far**2 / 3) * np.exp(-far))


class Predicted:
    """The surfaces of the clusters of a plane, as :meth:`ScoreTable.on_plane` has it, through its nodes.

    A cluster that was not measured at a node has the mean there. trend: what the surface is guided by. places: other
    ones (N, 2) of the nodes than those of the plane.
    """

    def __init__(self, plane: ScoreTable, trend: Trend | None = USUAL, places: Array | None = None) -> None:
        measured = plane.take(plane.measured)
        self.clusters, self.most = plane.clusters, plane.most
        self.places = measured.places if places is None else places[plane.measured]
        self._mean, self._trend = measured.mean, trend
        known, counts = measured.counts > 0, measured.counts
        self._rates = np.where(known, measured.sums / np.where(known, counts, 1.0), self._mean)
        self._counts = counts.sum(axis=1) / np.maximum(known.sum(axis=1), 1)

    @cached_property
    def surface(self) -> Kriging:
        """The mean's."""
        return Kriging.fit(self.places, self._mean, self._trend)

    def on(self, places: ArrayLike) -> tuple[Array, Array]:
        """Sums and counts (C, M) predicted at places (M, 2). Beside a cliff a surface swings beyond its nodes, where
        nothing was measured: all clusters are moved alike there, to a mean between 0 and the greatest observed."""
        at = np.asarray(places, float).reshape(-1, 2)
        rates = self._rates @ self.surface.weights(at).T
        mean = self._counts @ rates / self._counts.sum()
        rates += mean.clip(0.0, self._mean.max()) - mean
        counts = np.repeat(self._counts[:, None], len(at), axis=1)
        return rates * counts, counts

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


def predicted_table(plane: ScoreTable, space: SearchSpace, trend: Trend) -> ScoreTable:
    """Of one plane the table of all lines of the search, ``PER_STOP`` exposures to a stop; without conditions where
    the model knows too little. The covariance of the prediction is that of the surface, ``CAUTION`` times as wide."""
    if plane.reference_too_low:
        return plane.take([])
    exposures = exposures_on(space.exposures_s, PER_STOP)
    lines = sorted(space.lines, key=lambda line: (line.illuminance_lux, line.velocity_px_s))
    count = len(lines) * len(exposures)
    conditions = {name: np.full(count, values[0]) for name, values in plane.conditions.items()}
    conditions["exposure_s"] = np.tile(exposures, len(lines))
    for name in lines[0].axes:
        conditions[name] = np.repeat([line.axes[name] for line in lines], len(exposures))
    places = np.concatenate([line.places(exposures) for line in lines])
    predicted = Predicted(plane, trend)
    sums, counts = predicted.on(places)
    return replace(
        plane,
        conditions=conditions,
        sums=sums,
        counts=counts,
        saturated=_by_light(plane, plane.saturated, places),
        brightness=_by_light(plane, plane.brightness, places),
        prediction_cov=lambda those: CAUTION**2 * predicted.surface.covariance(places[those]),
        missed_pulses=None,
    )


def _by_light(plane: ScoreTable, values: Array, places: Array) -> Array:
    """At places (M, 2), between the nodes' values (N,), which depend on the light and hardly on motion."""
    known = np.isfinite(values)
    if not known.any():
        return np.full(len(places), np.nan)
    lights, which = np.unique(plane.places[known, 0], return_inverse=True)
    return np.asarray(np.interp(places[:, 0], lights, np.bincount(which, values[known]) / np.bincount(which)))
