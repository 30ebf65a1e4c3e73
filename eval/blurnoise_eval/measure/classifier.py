"""Classifier of patches: how well it separates real from simulated frames, as AUC (0.5 not at all, 1 perfectly).

Domain: frames (N, H, W) of several levels, DN. The classifier is trained on one half of the picture and every other
frame, and tested on the other half of both; the AUC is the mean over all such splits. The AUC of real frames against
real ones is the lowest that a simulation can reach.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import rankdata

from blurnoise.metrics.values import Estimate

Floats = NDArray[np.float64]
PATCH_PX = 64
FEWEST_PATCHES = 16  # of a frame
RESAMPLES = 200
_COARSE_PX = 8
_RIDGE = 1e-6  # of the features' covariance, whose diagonal is about 1


@dataclass(frozen=True)
class Patches:
    """Statistics (n, 7) of patches, and the level, frame, position and half of the picture (0 or 1) of each."""

    features: Floats
    level: NDArray[np.int64]
    frame: NDArray[np.int64]
    position: NDArray[np.int64]
    half: NDArray[np.int64]

    @classmethod
    def of(cls, levels: Sequence[Floats]) -> Patches:
        """The patches of the frames of each level."""
        rows = []
        for number, frames in enumerate(levels):
            down, across = (side // PATCH_PX for side in frames.shape[1:])
            cut = frames[:, : down * PATCH_PX, : across * PATCH_PX]
            split = cut.reshape(-1, down, PATCH_PX, across, PATCH_PX).swapaxes(2, 3)
            frame, y, x = np.indices((len(frames), down, across)).reshape(3, -1)
            position, half = y * across + x, (2 * x >= across).astype(int)
            about = np.stack([np.full_like(frame, number), frame, position, half], 1)
            rows.append(np.hstack([statistics(split.reshape(-1, PATCH_PX, PATCH_PX)), about]))
        table = np.concatenate(rows)
        return cls(table[:, :-4], *table[:, -4:].T.astype(int))

    def where(self, mask: NDArray[np.bool_]) -> Patches:
        """The patches of a mask."""
        return Patches(*(values[mask] for values in vars(self).values()))


def statistics(patches: Floats) -> Floats:
    """Statistics (n, 7) of patches (n, H, W): log variance, variance of row, column and coarse means over that of
    white noise, correlations of neighbours along x and y, and kurtosis.

    >>> white = np.random.default_rng(0).normal(0.0, 2.0, (1, 64, 64))
    >>> statistics(white)[0, [0, 5]].round(1).tolist()  # ln 4, and a kurtosis of 3
    [1.4, 2.9]
    """
    # each site of a mosaic has its own mean
    sites = [patches[:, y::2, x::2].mean((1, 2)) for y in (0, 1) for x in (0, 1)]
    values = patches.copy()
    for number, mean in enumerate(sites):
        values[:, number // 2 :: 2, number % 2 :: 2] -= mean[:, None, None]
    squares = values * values
    variance = np.maximum(squares.mean((1, 2)), 1e-12)
    side = values.shape[1]
    cells = side // _COARSE_PX
    coarse = values.reshape(-1, cells, _COARSE_PX, cells, _COARSE_PX).mean((2, 4))
    columns = (
        np.log(variance),
        np.log(1e-6 + values.mean(2).var(1) * side / variance),
        np.log(1e-6 + values.mean(1).var(1) * side / variance),
        (values[:, :, 1:] * values[:, :, :-1]).mean((1, 2)) / variance,
        (values[:, 1:] * values[:, :-1]).mean((1, 2)) / variance,
        (squares * squares).mean((1, 2)) / variance**2,
        np.log(1e-6 + coarse.var((1, 2)) * _COARSE_PX**2 / variance),
    )
    return np.stack(columns, 1)


def separation(real: Sequence[Floats], simulated: Sequence[Floats], seed: int = 0) -> Estimate:
    """AUC of the classifier for real against simulated frames of levels; NaN where the frames are too small.

    >>> drawn = np.random.default_rng(0)
    >>> quiet, noisy = (drawn.normal(0.0, sigma, (2, 256, 256)) for sigma in (1.0, 2.0))
    >>> separation([quiet], [noisy]).value > 0.99
    True
    """
    if min(real[0].shape[1:]) < PATCH_PX:
        return Estimate(math.nan)
    patches = Patches.of([*real, *simulated])
    patches.level[:] %= len(real)
    is_real = np.repeat([True, False], len(patches.level) // 2)
    return _score(patches, is_real, patches.frame % 2, seed)


def separation_of_halves(real: Sequence[Floats], seed: int = 0) -> Estimate:
    """AUC of the classifier for the first against the second half of the real frames of each level."""
    if min(real[0].shape[1:]) < PATCH_PX:
        return Estimate(math.nan)
    patches = Patches.of(real)
    count = np.array([len(frames) for frames in real])[patches.level]
    first = patches.frame < count // 2
    within = np.where(first, patches.frame, patches.frame - count // 2) % 2
    used = patches.frame < count // 2 * 2  # both halves have the same number of frames
    return _score(patches.where(used), first[used], within[used], seed)


def _score(patches: Patches, label: NDArray[np.bool_], parity: NDArray[np.int64], seed: int) -> Estimate:
    """Mean AUC over the splits; its interval comes from resampling the positions of the patches."""
    if len(np.unique(patches.position)) < FEWEST_PATCHES or len(np.unique(label)) < 2:
        return Estimate(math.nan)
    features = patches.features.copy()
    for level in np.unique(patches.level):
        of_level = patches.level == level
        spread = features[of_level].std(0)
        # Levels differ in noise by far more than real and simulated frames do: each has its own scale.
        features[of_level] -= features[of_level].mean(0)
        features[of_level] /= np.where(spread > 0, spread, 1.0)
    folds = []
    single = len(np.unique(parity)) < 2  # one frame of each kind: split by position only
    for half in (0, 1):
        for odd in (0,) if single else (0, 1):
            # Tested elsewhere in the picture and on other frames: else the fixed pattern would give the answer.
            trained = (patches.half == half) & (single | (parity == odd))
            tested = (patches.half != half) & (single | (parity != odd))
            folds.append((features[tested] @ _direction(features[trained], label[trained]), tested))
    random = np.random.default_rng(seed)
    count = int(patches.position.max()) + 1
    resampled = []
    for draw in range(RESAMPLES + 1):
        # By position: patches of one place in several frames share its fixed pattern, and are not independent.
        drawn = (
            np.bincount(random.integers(count, size=count), minlength=count) if draw else np.ones(count, int)
        )
        weight = drawn[patches.position]
        resampled.append(np.mean([_auc(score, label[of], weight[of]) for score, of in folds]))
    low, high = np.quantile(resampled[1:], (0.025, 0.975))
    return Estimate(float(resampled[0]), float(low), float(high))


def _direction(features: Floats, label: NDArray[np.bool_]) -> Floats:
    """Direction of Fisher's linear discriminant, towards the labelled patches."""
    groups = features[label], features[~label]
    within = sum(np.cov(group.T) for group in groups) / 2 + _RIDGE * np.eye(features.shape[1])
    return np.asarray(np.linalg.solve(within, groups[0].mean(0) - groups[1].mean(0)))


def _auc(score: Floats, label: NDArray[np.bool_], weight: NDArray[np.int64]) -> float:
    """Probability that a labelled patch scores higher than another one; weight: how often a patch counts."""
    score, label = np.repeat(score, weight), np.repeat(label, weight)
    ones = int(label.sum())
    others = len(label) - ones
    if not ones or not others:
        return 0.5
    return float((rankdata(score)[label].sum() - ones * (ones + 1) / 2) / (ones * others))
