"""Flicker of a pulsed lamp in a video: how its brightness varies from frame to frame.

Domain: mean values of the lamp's region in consecutive frames, (..., N), black level removed; results have the
leading shape. They are of the numbers as they are: linear ones and coded ones differ. Names are those of IEEE Std
2020-2024, definitions those of an implementation that calls itself the reference (on GitHub,
CARpublic/P2020-flicker).
All raise ``TypeError`` or ``ValueError`` that names the argument.
"""

from __future__ import annotations

import math
from statistics import NormalDist

import torch
from torch import Tensor

from blurnoise._core.checks import limited
from blurnoise.metrics import values
from blurnoise.metrics.values import BatchEstimate

Z = NormalDist().inv_cdf(0.975)
FEWEST_FRAMES = 30
"""Frames below which a share is known to 18 % at best."""


def modulation_index(means: Tensor) -> BatchEstimate:
    """Flicker modulation index (FMI): (max - min)/(max + min) of the mean values (..., N). It has no interval.

    >>> modulation_index(torch.tensor([50.0, 100.0, 150.0])).value.item()
    0.5
    """
    means = _series(means)
    most, least = means.amax(-1), means.amin(-1)
    index = (most - least) / (most + least)
    missing = torch.full_like(index, math.nan)
    return BatchEstimate(index, missing, missing, _flags(means))


def detection_index(means: Tensor, *, off: float | Tensor, threshold: float = 0.1) -> BatchEstimate:
    """Flicker detection index (FDI): the share of frames in which the lamp is seen to be on.

    There, the mean exceeds ``off``, that of the region without the lamp, > 0, one number or (...), by more than
    ``threshold``, relative. The 95 % interval is Wilson's for independent frames.

    >>> detection_index(torch.tensor([10.0, 10.0, 90.0, 10.5]), off=10.0).value.item()
    0.25
    """
    means, threshold = _series(means), limited("threshold", threshold, "contrast")
    dark = values.beside("off", off, means[..., 0], low=0.0)
    if bool((dark == 0).any()):
        raise ValueError("off: must be > 0, as brightness is relative to it")
    return _share(means, means / dark[..., None] - 1 > threshold)


def mitigation_probability(means: Tensor, *, tolerance: float = 0.1) -> BatchEstimate:
    """Modulation mitigation probability (MMP): the share of frames within ``tolerance`` of the mean of all, relative.

    1: no flicker. The 95 % interval is Wilson's for independent frames.

    >>> mitigation_probability(torch.tensor([95.0, 100.0, 105.0, 60.0])).value.item()  # of a mean of 90
    0.25
    """
    means, tolerance = _series(means), limited("tolerance", tolerance, "contrast")
    middle = means.mean(-1, keepdim=True)
    return _share(means, (means - middle).abs() < tolerance * middle)


def _series(means: Tensor) -> Tensor:
    means = values.real("means", means, dims=1)
    if means.shape[-1] < 2:
        raise ValueError(f"means: must be of two frames or more, got shape {tuple(means.shape)}")
    return means


def _flags(means: Tensor) -> dict[str, Tensor]:
    finite = torch.isfinite(means).all(-1)
    return {"not_finite": ~finite, "too_few_frames": torch.full_like(finite, means.shape[-1] < FEWEST_FRAMES)}


def _share(means: Tensor, counted: Tensor) -> BatchEstimate:
    """The share of frames that count, NaN where a mean is not finite."""
    count, flags = means.shape[-1], _flags(means)
    share = torch.where(flags["not_finite"], math.nan, counted.double().mean(-1))
    centre = (share + Z**2 / (2 * count)) / (1 + Z**2 / count)
    margin = Z / (1 + Z**2 / count) * torch.sqrt(share * (1 - share) / count + (Z / (2 * count)) ** 2)
    return BatchEstimate(share, (centre - margin).clamp(min=0), (centre + margin).clamp(max=1), flags)
