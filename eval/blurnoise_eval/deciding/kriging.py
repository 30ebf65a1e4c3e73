"""Kriging: a surface through scattered nodes of the plane, with what it does not know between them.

Domain: places (u, w) of :mod:`blurnoise_eval.answers.plane`, in stops; values in any unit, sigma in the same.
Universal kriging (Cressie, Statistics for Spatial Data, 1993, 3.4) on a constant and a :class:`Trend`, with a Matern
5/2 covariance, one length per axis, and a nugget. The trend is a logistic curve of signal to noise, motion and
saturation, as high as the highest score seen: it guides a surface between few nodes and need not be right.
Lengths and nugget are the most probable ones: restricted likelihood, lengths log-normal about ``USUAL_LENGTH``.
A prediction is a weighted sum of the nodes' values. The weights of a fitted surface depend on places alone, so
every picture's own surface has those of the mean's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from blurnoise.optics.camera import Camera
from blurnoise.optics.radiometry import electrons_per_lux_s
from blurnoise_eval.deciding.lines import spread

USUAL_LENGTH = 3.3  # stops
_LENGTH_SPREAD = 0.6  # of its natural logarithm
_USUAL_SCALE, _SCALE_WEIGHT = 0.05, 2.0  # deviation about the trend, as if so many values had shown it
_LEAST = np.log([0.3, 0.3, 1e-6])  # lengths along u and w, nugget
_MOST = np.log([12.0, 12.0, 0.05])
_GRID = (5, 5, 4)  # of their logarithms, from end to end
_HALVINGS = 4  # of the grid's step, about the best so far
_MOST_FITTED = 120  # nodes that they are chosen by
_FLAT = 0.02  # share of its top below which the range of a trend counts as none
_CONTRAST, _GREY = 0.62, 0.3  # of a target, and its mean reflectance
_MOTION_PX, _MOST_MOTION = 16.0, 8.0
_PENALTY = 0.002 * np.array([0.1, 1, 1, 1, 1, 1, 1])  # on squares of the coefficients: a cliff may be steep
_STEPS = 40  # of Newton's method, at most
_MOST_LOGIT = 30.0
Array = NDArray[np.float64]


class Trend(NamedTuple):
    """Figures of a camera: electrons per lux s of a white pixel, the noise in the dark, e-, and the light at which
    white saturates, lux s."""

    electrons_per_lux_s: float = 7000.0
    noise_e: float = 2.5
    full_lux_s: float = 1.5

    @classmethod
    def of(cls, camera: Camera) -> Trend:
        """That of a camera at its base gain."""
        per_lux_s = electrons_per_lux_s(camera)
        noise_e = math.sqrt(camera.dark_variance_dn2()) / camera.system_gain_dn_per_e
        return cls(per_lux_s, noise_e, camera.saturation_e / per_lux_s)

    def features(self, places: Array) -> Array:
        """(N, 7): 1, s, s^2, L, L^2, log (1 + L^2), o; s: signal to noise, L: motion, o: beyond saturation."""
        light = 2.0 ** places[:, 0]
        electrons = self.electrons_per_lux_s * light
        signal = np.log2(_CONTRAST * electrons / np.sqrt(_GREY * electrons + self.noise_e**2)) / 4
        motion = np.minimum(2.0 ** places[:, 1] / _MOTION_PX, _MOST_MOTION)
        over = np.log2(1 + (light / self.full_lux_s) ** 2) / 4
        blur = np.log2(1 + 4.0 ** places[:, 1]) / 4
        return np.stack([np.ones(len(places)), signal, signal**2, motion, motion**2, blur, over], axis=1)

    def fitted(self, places: Array, values: Array) -> Fitted:
        """The trend of values (N,), not below 0, at places (N, 2)."""
        top = max(float(values.max(initial=0.0)), 1e-9) * 1.02
        shares = np.clip(values / top, 0.0, 1.0)
        return Fitted(self, top, fractional_logistic(self.features(places), shares, _PENALTY))


USUAL = Trend()
"""Of a machine-vision camera at f/1.4: where the camera is not known."""


class Fitted(NamedTuple):
    """A trend with its coefficients (7,); top: the highest it can be."""

    trend: Trend
    top: float
    coefficients: Array

    def __call__(self, places: Array) -> Array:
        """Its values at places (N, 2), (N,)."""
        return self.top * logistic(self.trend.features(places) @ self.coefficients)


def logistic(logits: Array) -> Array:
    """1 / (1 + exp(-x))."""
    return np.asarray(1 / (1 + np.exp(-np.clip(logits, -_MOST_LOGIT, _MOST_LOGIT))))


def fractional_logistic(features: Array, shares: Array, penalty: Array) -> Array:
    """Coefficients (K,) of a logistic regression of shares (N,) on features (N, K), by Newton's method.

    penalty: (K,) on half the squares of the coefficients.
    """

    def loss(at: Array) -> float:
        logits = features @ at
        return float((np.logaddexp(0, logits) - shares * logits).sum() + penalty @ at**2 / 2)

    found = np.zeros(features.shape[1])
    here = loss(found)
    for _ in range(_STEPS):
        rate = logistic(features @ found)
        slope = features.T @ (rate - shares) + penalty * found
        bend = (features * (rate * (1 - rate))[:, None]).T @ features + np.diag(penalty)
        step = np.linalg.solve(bend, slope)
        while np.abs(step).max() > 1e-6 and loss(found - step) > here:
            step = step / 2
        found = found - step
        here = loss(found)
        if np.abs(step).max() <= 1e-6:
            break
    return np.asarray(found)


@dataclass(frozen=True, eq=False)
class Kriging:
    """A fitted surface through N nodes at places (N, 2).

    lengths: of the covariance along u and w. nugget: variance of a node's own departure, in ``scale`` squared.
    trend: None: a constant. scale: standard deviation about the trend.
    """

    places: Array
    lengths: tuple[float, float]
    nugget: float
    trend: Fitted | None
    scale: float = 1.0

    @classmethod
    def fit(cls, places: ArrayLike, values: ArrayLike, mean: Trend | None = USUAL) -> Kriging:
        """Through values (N,), finite, at places (N, 2), all different. mean: None: a constant."""
        at, known = np.asarray(places, float), np.asarray(values, float)
        trend = None if mean is None else mean.fitted(at, known)
        if trend is not None and np.ptp(trend(at)) <= _FLAT * trend.top:
            trend = None
        some = np.sort(spread(at, _MOST_FITTED)) if len(at) > _MOST_FITTED else np.arange(len(at))
        length_u, length_w, nugget = np.exp(_most_probable(at[some], known[some], _basis(trend, at[some])))
        surface = cls(at, (float(length_u), float(length_w)), float(nugget), trend)
        basis = _basis(trend, at)
        rest = known - basis @ (surface._spread_of_basis @ (surface._of_basis.T @ known))
        variance = _variance(rest @ surface._inverse @ rest, len(known) - basis.shape[1])
        return replace(surface, scale=float(np.sqrt(variance)))

    def through(self, places: Array) -> Kriging:
        """The same surface, known at other places (M, 2) instead."""
        return replace(self, places=places)

    def weights(self, places: Array) -> Array:
        """Of the nodes' values in the surface at places (M, 2): (M, N), each row's sum 1."""
        between, beyond = self._toward(places)
        return np.asarray(between @ self._inverse + beyond @ self._spread_of_basis @ self._of_basis.T)

    def sigma(self, places: Array) -> Array:
        """Standard deviation (M,) of the prediction of a value at places (M, 2), its own departure included."""
        between, beyond = self._toward(places)
        known = ((between @ self._inverse) * between).sum(axis=1)
        unsure = ((beyond @ self._spread_of_basis) * beyond).sum(axis=1)
        return np.asarray(self.scale * np.sqrt(np.maximum(1.0 - known + unsure, 0.0) + self.nugget))

    def covariance(self, places: Array) -> Array:
        """Covariance (M, M) of the surface itself at places (M, 2), without their own departures."""
        between, beyond = self._toward(places)
        known = between @ self._inverse @ between.T
        unsure = beyond @ self._spread_of_basis @ beyond.T
        return np.asarray(self.scale**2 * (correlation(places, places, self.lengths) - known + unsure))

    def _toward(self, places: Array) -> tuple[Array, Array]:
        """Correlation of places (M, 2) with the nodes, and the residual of their trend basis."""
        between = correlation(places, self.places, self.lengths)
        return between, _basis(self.trend, places) - between @ self._of_basis

    @cached_property
    def _inverse(self) -> Array:
        own = correlation(self.places, self.places, self.lengths) + self.nugget * np.eye(len(self.places))
        return np.asarray(np.linalg.inv(own), np.float64)

    @cached_property
    def _of_basis(self) -> Array:
        return np.asarray(self._inverse @ _basis(self.trend, self.places))

    @cached_property
    def _spread_of_basis(self) -> Array:
        return np.asarray(np.linalg.pinv(_basis(self.trend, self.places).T @ self._of_basis, hermitian=True))


def correlation(places: Array, others: Array, lengths: tuple[float, float]) -> Array:
    """Matern 5/2 between places (M, 2) and others (N, 2), (M, N)."""
    return _matern(np.sqrt((((places[:, None] - others[None]) / lengths) ** 2).sum(axis=-1)))


def _matern(distance: Array) -> Array:
    far = np.sqrt(5.0) * distance
    return np.asarray((1 + far + far**2 / 3) * np.exp(-far))


def _basis(trend: Fitted | None, places: Array) -> Array:
    one = np.ones(len(places))
    return one[:, None] if trend is None else np.stack([one, trend(places) / trend.top], axis=1)


def _variance(square: Array, degrees: int) -> Array:
    """Of the departures from the trend, from their weighted square and a usual one."""
    return (square + _SCALE_WEIGHT * _USUAL_SCALE**2) / (max(degrees, 0) + _SCALE_WEIGHT)


def _most_probable(places: Array, values: Array, basis: Array) -> Array:
    """Logarithms of lengths and nugget, (3,): the best of a grid, then of ever finer ones about it."""
    step = (_MOST - _LEAST) / (np.array(_GRID) - 1)
    along = (np.linspace(*ends) for ends in zip(_LEAST, _MOST, _GRID, strict=True))
    tried = np.array(list(product(*along)))
    around = np.array(list(product((-1, 0, 1), repeat=3)))
    best = tried[np.argmin(_improbability(places, values, basis, tried))]
    for _ in range(_HALVINGS):
        step = step / 2
        tried = np.clip(best + around * step, _LEAST, _MOST)
        best = tried[np.argmin(_improbability(places, values, basis, tried))]
    return np.asarray(best)


def _improbability(places: Array, values: Array, basis: Array, tried: Array) -> Array:
    """Minus twice the logarithm of the restricted likelihood times the prior, of each (3,) of T tried, (T,)."""
    apart = (places[:, None] - places[None]) ** 2
    lengths, nuggets = np.exp(tried[:, :2]), np.exp(tried[:, 2])
    matrices = _matern(np.sqrt((apart / lengths[:, None, None] ** 2).sum(axis=-1)))
    matrices += nuggets[:, None, None] * np.eye(len(places))
    beside = np.concatenate([basis, values[:, None]], axis=1)
    inner = np.swapaxes(beside[None], 1, 2) @ np.linalg.solve(matrices, beside[None])
    of_basis, mixed, square = inner[:, :-1, :-1], inner[:, :-1, -1:], inner[:, -1, -1]
    square = square - (np.swapaxes(mixed, 1, 2) @ np.linalg.solve(of_basis, mixed))[:, 0, 0]
    degrees = len(values) - basis.shape[1]
    misfit = (max(degrees, 0) + _SCALE_WEIGHT) * np.log(_variance(np.maximum(square, 0.0), degrees))
    volume = np.linalg.slogdet(matrices)[1] + np.linalg.slogdet(of_basis)[1]
    unusual = (((tried[:, :2] - np.log(USUAL_LENGTH)) / _LENGTH_SPREAD) ** 2).sum(axis=1)
    return np.asarray(misfit + volume + unusual)
