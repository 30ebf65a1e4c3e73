"""Simulated detectors: what many samples of pictures would have shown, so that intervals can be held to the truth.

Domain: exposures in s, confidences in [0, 1]. A population has two detectors, which see the same pictures. Arrays
are (pictures, targets, samples, exposures), NaN where a picture has fewer targets.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from blurnoise_eval.scoring.precision import RECALLS
from numpy.typing import NDArray

Array = NDArray[np.float64]
EXPOSURES_S = (1e-3, 2e-3, 5e-3, 10e-3, 15e-3, 20e-3, 30e-3, 45e-3, 60e-3, 90e-3)
PICTURE_EFFECT = 0.25
"""Standard deviation over pictures of each edge's exposure, decades."""
NOISE_FIELDS = 3
RANKED_S = 30e-3
LISTED = 0.05
_FALSE = 0.5  # false detections per target
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


@dataclass(frozen=True)
class Ranking:
    """What average precision at an IoU of 0.5 needs of P pictures, so that they can be weighted over and over.

    The T detections that answer for a target, highest score first. targets: (P,) per picture; right, wrong:
    (P, T) how many right and wrong detections of a picture stand in the ranking down to each of the T.
    """

    targets: Array
    right: Array
    wrong: Array

    @classmethod
    def ranked(cls, whose: NDArray[np.int64], right: NDArray[np.bool_], targets: Array) -> Ranking:
        """Of detections with the highest score first: each one's picture and whether it is right; targets (P,)."""
        places = np.flatnonzero(right)
        one_per_hit = np.zeros((len(targets), len(places)))
        one_per_hit[whose[places], np.arange(len(places))] = 1
        between = np.zeros_like(one_per_hit)
        before = np.searchsorted(places, np.flatnonzero(~right))  # the next hit below each wrong detection
        counted = before < len(places)  # those below the last hit change nothing
        np.add.at(between, (whose[~right][counted], before[counted]), 1)
        return cls(targets, one_per_hit.cumsum(axis=1), between.cumsum(axis=1))

    def ap50(self, weights: Array) -> Array:
        """Average precision at an IoU of 0.5 with picture p counted ``weights[..., p]`` times, (...).

        Equals COCO's for weights of 1, and for whole weights that of a set that repeats its pictures. NaN
        where no picture with a weight has a target.
        """
        right, every = weights @ self.right, weights @ self.targets
        shown = right + weights @ self.wrong
        precision = np.divide(right, shown, out=np.zeros_like(right), where=shown > 0)
        precision = np.maximum.accumulate(precision[..., ::-1], axis=-1)[..., ::-1]
        with np.errstate(invalid="ignore", divide="ignore"):
            recall = right / every[..., None]
        reached = np.searchsorted(RECALLS, recall, side="right")
        steps = np.diff(reached, axis=-1, prepend=0)
        return np.where(every > 0, (precision * steps).sum(axis=-1) / len(RECALLS), np.nan)


def ranked(confidence: Array, generator: np.random.Generator, *, as_one: bool = False) -> Ranking:
    """One sample's detections at ``RANKED_S``, confidences (pictures, targets, exposures), ranked for AP50.

    Targets below ``LISTED`` are not detected; false detections come at random, for some pictures more than for
    others. as_one: all pictures as one, for a population.
    """
    scores = confidence[..., EXPOSURES_S.index(RANKED_S)]
    targets = np.isfinite(scores).sum(axis=1)
    picture, place = np.nonzero(scores > LISTED)
    false = generator.poisson(_FALSE * targets * generator.gamma(2, 0.5, size=len(targets)))
    every = np.concatenate([scores[picture, place], generator.beta(1, 4, size=false.sum())])
    right = np.arange(len(every)) < len(picture)
    whose = np.concatenate([picture, np.repeat(np.arange(len(targets)), false)])
    if as_one:
        whose, targets = np.zeros_like(whose), targets.sum(keepdims=True)
    order = np.argsort(-every, kind="stable")
    return Ranking.ranked(whose[order], right[order], targets.astype(float))
