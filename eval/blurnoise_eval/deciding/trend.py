"""The trend of a score over the plane: how it rises with light and falls with motion, by a few closed forms.

Domain: places (u, w) of :mod:`blurnoise_eval.answers.plane`. A logistic curve of signal to noise, motion and
saturation, as high as the highest score seen. It guides a surface between few nodes and need not be right.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from blurnoise.optics.camera import Camera
from blurnoise.optics.radiometry import electrons_per_lux_s

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
