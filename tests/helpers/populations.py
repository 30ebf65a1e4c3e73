"""Simulated detectors: what many samples of pictures would have shown, so that intervals can be held to the truth.

Domain: exposures in s, confidences in [0, 1]. A population has two detectors, which see the same pictures. Arrays
are (pictures, targets, samples, exposures), NaN where a picture has fewer targets.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
EXPOSURES_S = (1e-3, 2e-3, 5e-3, 10e-3, 15e-3, 20e-3, 30e-3, 45e-3, 60e-3, 90e-3)
PICTURE_EFFECT = 0.25
"""Standard deviation over pictures of each edge's exposure, decades."""
NOISE_FIELDS = 3
_WIDTH = 0.12  # of an edge, decades of exposure per unit of logit
_DARK_S, _BRIGHT_S = 3e-3, 40e-3
_LATER = 0.06  # decades: the second detector's dark edge
_OWN = 0.1  # decades: what of a picture's effect is one detector's only
_SHARED = (PICTURE_EFFECT**2 - _OWN**2) ** 0.5


class Seen(NamedTuple):
    """What both detectors say of the targets: confidences (pictures, targets, samples, exposures)."""

    first: Array
    second: Array


@dataclass(frozen=True)
class Population:
    """Pictures that can be drawn without end. threshold: the confidence that is enough."""

    name: str
    threshold: float
    draw: Callable[[np.random.Generator, int, int], Seen]


def one_sign(generator: np.random.Generator, pictures: int, samples: int) -> Seen:
    """One target per picture in ``NOISE_FIELDS`` noise fields: logistic edges, each moved by the picture."""
    shared = _SHARED * generator.normal(size=(2, pictures, 1, samples, 1))

    def detector(later: float) -> Array:
        dark, bright = shared + _OWN * generator.normal(size=shared.shape)
        noise = 0.5 * generator.normal(size=(pictures, NOISE_FIELDS, samples, len(EXPOSURES_S)))
        return np.asarray(0.97 * _window(dark + later, bright, noise))

    return Seen(detector(0.0), detector(_LATER))


def small_targets(generator: np.random.Generator, pictures: int, samples: int) -> Seen:
    """Many small targets per picture, 1 to 60, 8 on average: most confidences near 0, a few high.

    Crowded pictures have the lower ones.
    """
    count = np.minimum(1 + generator.geometric(1 / 8, size=(pictures, 1, samples, 1)) - 1, 60)
    most = int(count.max())
    there = np.arange(most)[:, None, None] < count
    ease = 0.8 * generator.normal(size=count.shape) - 0.4 * np.log(count / 8)
    target = 1.5 * generator.normal(size=(pictures, most, samples, 1))
    shared = _SHARED * generator.normal(size=(2, *count.shape))

    def detector(later: float) -> Array:
        dark, bright = shared + _OWN * generator.normal(size=shared.shape)
        noise = 0.3 * generator.normal(size=(pictures, most, samples, 1))
        known = 1 / (1 + np.exp(3.0 - ease - target - noise))
        return np.asarray(np.where(there, known * _window(dark + later, bright, 0.0), np.nan))

    return Seen(detector(0.0), detector(_LATER))


def _window(dark: Array, bright: Array, noise: Array | float) -> Array:
    """Two logistic edges over the logarithm of the exposure, moved by decades, noise on the logits."""
    at = np.log10(EXPOSURES_S)
    rise = (at - np.log10(_DARK_S) - dark) / _WIDTH + noise
    fall = (np.log10(_BRIGHT_S) + bright - at) / _WIDTH + noise
    return np.asarray(1 / (1 + np.exp(-rise)) / (1 + np.exp(-fall)))


POPULATIONS = (Population("one sign", 0.6, one_sign), Population("small targets", 0.05, small_targets))


def mean_over(x: Sequence[float], y: Array) -> Array:
    """Area under y (..., N), straight between its points, over x (N,) increasing, divided by the range of x."""
    return np.asarray(np.trapezoid(y, x, axis=-1) / (x[-1] - x[0]))
