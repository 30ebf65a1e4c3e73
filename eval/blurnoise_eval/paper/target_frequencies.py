"""Spatial frequencies that a target holds, from the edges along a line through it.

Domain: digital numbers with the black level removed, px.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from blurnoise._core import checks
from blurnoise.metrics import values


@dataclass(frozen=True)
class TargetFrequencies:
    """Frequencies between neighbouring edges of a target, cycles/px.

    frequency: (K,), rising. standard_error: (K,), from the pixels' noise alone, to first order.
    low, high: the least and the greatest of them, NaN for none. profile: (N,), the line. rises_px, falls_px:
    (R,), (F,): places of the edges on it, px from the first pixel's centre.
    too_few_edges: no two edges of one direction, so no frequency. not_finite: NaN or Inf on the line.
    """

    frequency: Tensor
    standard_error: Tensor
    low: float
    high: float
    profile: Tensor
    rises_px: Tensor
    falls_px: Tensor
    too_few_edges: bool
    not_finite: bool


def target_frequencies(
    image: Tensor, *, across: str = "x", threshold: float = 0.2, noise_std: float = 0.0
) -> TargetFrequencies:
    """Frequency content of the target in the middle of ``image`` (H, W) or (C, H, W), channels averaged.

    The profile is the centre row (``across`` "x") or column ("y"), the mean of two where their number is even.
    Its central difference has a peak at every edge, upwards where the picture gets brighter, downwards where it
    gets darker; from a peak to the next one of its direction lasts a cycle, and its inverse is a frequency
    (Lin et al. 2024, Sensors 24(16) 5135, 4.2.1). Peaks are placed by the parabola through three differences.

    threshold: least peak as a share of the largest. noise_std: the pixels' noise, DN, on this line (for the mean
    of n independent rows or channels 1/sqrt(n) of a pixel's); peaks below five times what it does to a difference,
    noise_std / sqrt(2), are none. The profile looks at what lies on one line: other lines have other edges, and
    edges closer than three pixels merge. Raises ``TypeError`` or ``ValueError`` naming the argument.
    """
    checks.one_of("across", across, ("x", "y"))
    checks.in_range("threshold", threshold, 0.0, 1.0, above=True)
    noise = checks.in_range("noise_std", noise_std, 0.0)
    picture = values.real("image", image, dims=2).detach()
    if picture.ndim > 3:
        raise ValueError(f"image: must be (H, W) or (C, H, W), got {tuple(picture.shape)}")
    plane = picture if picture.ndim == 2 else picture.mean(0)
    lines = plane if across == "x" else plane.T
    if lines.shape[1] < 5:
        raise ValueError(f"image: must be 5 px or more along {across}, got {lines.shape[1]}")
    height = len(lines)
    profile = lines[(height - 1) // 2 : height // 2 + 1].mean(0)
    finite = bool(torch.isfinite(profile).all())
    slope = (profile[2:] - profile[:-2]) / 2 if finite else torch.zeros_like(profile[2:])
    rounding = float(profile.abs().max()) * 1e-12 if finite else 0.0
    least = max(threshold * float(slope.abs().max()), 5 * noise / math.sqrt(2), rounding)

    edges, frequencies, errors = [], [], []
    for direction in (slope, -slope):
        place, error = _peaks(direction, least, noise)
        distance = place.diff()
        edges.append(place)
        frequencies.append(1 / distance)
        errors.append(torch.hypot(error[1:], error[:-1]) / distance**2)
    frequency, order = torch.cat(frequencies).sort()
    none = len(frequency) == 0
    return TargetFrequencies(
        frequency=frequency,
        standard_error=torch.cat(errors)[order],
        low=math.nan if none else float(frequency[0]),
        high=math.nan if none else float(frequency[-1]),
        profile=profile,
        rises_px=edges[0],
        falls_px=edges[1],
        too_few_edges=none,
        not_finite=not finite,
    )


def _peaks(slope: Tensor, least: float, noise: float) -> tuple[Tensor, Tensor]:
    """Places (K,) of the maxima of ``slope`` above ``least``, px on the profile, and their standard errors.

    Equal neighbours are one maximum in their middle; the parabola's vertex lies (right - left) / (2 bend) off it.
    In terms of the profile p, right - left is (p[i+2] - 2 p[i] + p[i-2]) / 2, of variance 1.5 noise², and bend
    p[i+1] - p[i-1] - (p[i+2] - p[i-2]) / 2, of variance 2.5 noise²; they do not covary.
    """
    height, length = torch.unique_consecutive(slope, return_counts=True)
    middle = length.cumsum(0) - (length - 1) / 2  # slope 0 belongs to the profile's sample 1
    left, top, right = height[:-2], height[1:-1], height[2:]
    peak = (top > left) & (top > right) & (top > least)
    bend = (2 * top - left - right)[peak]
    offset = (right - left)[peak] / (2 * bend)
    return middle[1:-1][peak] + offset, noise / bend * (1.5 / 4 + 2.5 * offset**2).sqrt()
