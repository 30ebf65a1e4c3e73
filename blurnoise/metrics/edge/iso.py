"""The slanted-edge steps of ISO 12233 as sfrmat5 takes them, to compare with what that and its kin report.

Source: ISO 12233:2023, annex D; P. D. Burns, sfrmat5 (2023), whose quirks are kept: bins are filled by ceil(), and
the correction of the derivative, capped at 10, counts frequencies from 1. The transform is padded, which gives
values between its frequencies and changes none at them.

Domain: regions (B, H, W) float64, linear, the edge near vertical and bright on the right.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from blurnoise.metrics.edge.place import cosine, slope, smooth
from blurnoise.metrics.edge.response import Response

BINS_PER_PX = 4
LINE_ORDER = 5
PADDING = 8
LARGEST_CORRECTION = 10.0


def iso_response(values: Tensor, noise: Tensor, weights: Tensor | None) -> Response:
    """Response of edges (B, H, W) as the standard has it, and of resamples by ``weights`` (n, H).

    noise: variance of the pixels, (B,). Frequencies end near 1 cycle/px. A bin's mean has the noise over its pixels;
    the difference of two bins, 2/4 px apart, passes sin^2 of it.
    """
    total, count, position = _binned(values)
    bins, pixels = BINS_PER_PX * values.shape[2], count.sum(1)
    index = torch.arange(bins * PADDING // BINS_PER_PX + 1, dtype=torch.float64) / PADDING
    angle = math.pi * (index + 1) / (bins // 2 + 2)
    correction = (angle / torch.sin(angle)).abs().clamp_max(LARGEST_CORRECTION)
    correction = torch.where(index == 0, 1.0, correction)

    def power(line: Tensor) -> Tensor:
        modulus: Tensor = torch.fft.rfft(line, bins * PADDING).abs()[..., : len(index)]
        return (modulus / modulus[..., :1] * correction) ** 2

    line = _line_spread(total.sum(1), pixels)
    window = _window(torch.arange(bins), torch.tensor([bins // 2])) ** 2
    held = (window / pixels.clamp_min(1)).sum(-1) * noise / line.sum(-1) ** 2
    passed = held[:, None] * (torch.sin(2 * math.pi * index / bins) * correction) ** 2
    resampled = None if weights is None else power(_line_spread(weights @ total, weights @ count))
    return Response(BINS_PER_PX / (bins * PADDING) / cosine(position), power(line), passed, resampled)


def _binned(values: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Sums and numbers of the pixels in bins of 1/4 px along the row, rows apart, (B, H, N), and the line, (B, H).

    The edge is found row by row. Whole phases only: as many rows as take the edge over whole pixels.
    """
    _, height, width = values.shape
    column, row = torch.arange(width, dtype=torch.float64), torch.arange(height)
    across = torch.diff(values, dim=2, prepend=2 * values[:, :, :1] - values[:, :, 1:2]) / 2
    position = torch.tensor([(width - 1) / 2], dtype=torch.float64)
    for _ in range(2):
        position = smooth(_centroid(across * _window(column, position)), order=LINE_ORDER)
    tilt = slope(position)
    rise = tilt.abs().clamp_min(1e-9)
    rows = torch.where(rise * height >= 1, torch.round(torch.floor(height * rise) / rise), height)
    middle = torch.round(BINS_PER_PX * (rows - 1) * tilt / 2)
    away = position - position[:, :1]
    index = torch.ceil(BINS_PER_PX * (column - away[:, :, None])) + middle[:, None, None]
    bins = BINS_PER_PX * width
    used = ((index >= 0) & (index < bins) & (row < rows[:, None])[:, :, None]).to(torch.float64)
    index = index.long().clamp_(0, bins - 1)
    empty = values.new_zeros(*values.shape[:2], bins)
    total, count = (empty.scatter_add(2, index, each) for each in (values * used, used))
    return total, count, position


def _line_spread(total: Tensor, count: Tensor) -> Tensor:
    """Central difference of the bins' means (..., N), its maximum moved to the middle, under the window.

    An empty bin takes the mean of its neighbours.
    """
    mean = total / count.clamp_min(1e-9)
    left = torch.cat([mean[..., :1], mean[..., :-1]], -1)
    right = torch.cat([mean[..., 1:], mean[..., -1:]], -1)
    spread = torch.where(count > 0, mean, (left + right) / 2)
    line = torch.zeros_like(spread)
    line[..., 1:-1] = (spread[..., 2:] - spread[..., :-2]) / 2
    line[..., 0], line[..., -1] = line[..., 1], line[..., -2]
    bins = line.shape[-1]
    place = torch.arange(bins)
    source = place + line.argmax(-1, keepdim=True) - bins // 2
    moved = line.gather(-1, source.clamp(0, bins - 1)) * ((source >= 0) & (source < bins))
    return moved * _window(place, torch.tensor([bins // 2]))


def _window(place: Tensor, middle: Tensor) -> Tensor:
    """0.95 of a cosine bell about ``middle`` (...) that ends at the farther end of ``place``, plus 0.05."""
    half = torch.maximum(middle, float(place[-1]) - middle)[..., None]
    return 0.525 + 0.475 * torch.cos(math.pi * (place - middle[..., None]) / half)


def _centroid(across: Tensor) -> Tensor:
    """Centre of mass of each row, px, half a pixel back, for a difference lies between two pixels."""
    place = torch.arange(across.shape[2], dtype=torch.float64)
    mass = across.sum(2)
    mass = torch.where(mass.abs() > 1e-12, mass, torch.inf)
    return (across @ place) / mass - 0.5
