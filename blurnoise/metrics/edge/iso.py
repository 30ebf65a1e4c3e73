"""The slanted-edge steps of ISO 12233 as sfrmat5 takes them, for comparison with what that and its kin report.

Source: ISO 12233:2023, annex D; P. D. Burns, sfrmat5 (2023), whose quirks are kept: bins are filled by ceil(), and
the correction of the derivative, capped at 10, counts frequencies from 1. The transform is padded, which gives
values between its frequencies and changes none at them.

Domain: regions (B, H, W) float64, linear, the edge near vertical and bright on the right.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from blurnoise.metrics.edge.geometry import slope, smooth
from blurnoise.metrics.edge.response import Response

BINS_PER_PX = 4
LINE_ORDER = 5
_PADDING = 8
_LARGEST_CORRECTION = 10.0


def iso_response(values: Tensor, noise: Tensor, weights: Tensor | None = None) -> Response:
    """Response of edges (B, H, W) as the standard has it, and of resamples by ``weights`` (n, H).

    noise: variance of the pixels, (B,). Frequencies end near 1 cycle/px.
    """
    total, count, cosine = _binned(values)
    pixels = count.sum(1)
    line = _line_spread(total.sum(1), pixels)
    spacing = BINS_PER_PX / (line.shape[-1] * _PADDING) / cosine
    resampled = None
    if weights is not None:
        resampled = _response(_line_spread(weights @ total, weights @ count)) ** 2
    return Response(spacing, _response(line) ** 2, _noise_power(line, pixels, noise), resampled)


def _binned(values: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Sums and numbers of the pixels in bins of 1/4 px along the row, rows apart, (B, H, N), and the cosine, (B,).

    The edge is found row by row. Whole phases only: as many rows as take the edge over whole pixels.
    """
    _, height, width = values.shape
    column, row = torch.arange(width, dtype=torch.float64), torch.arange(height)
    across = torch.diff(values, dim=2, prepend=2 * values[:, :, :1] - values[:, :, 1:2]) / 2
    window = _window(column, torch.full((1,), (width - 1) / 2, dtype=torch.float64))
    position = smooth(_centroid(across * window), order=LINE_ORDER)
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
    return total, count, 1 / torch.sqrt(1 + tilt**2)


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
    return moved * _window(place, torch.full((1,), bins // 2))


def _response(line: Tensor) -> Tensor:
    """Modulus of the transform of ``line`` (..., N) over its value at 0, corrected for the derivative, (..., F)."""
    bins = line.shape[-1]
    modulus = torch.fft.rfft(line, bins * _PADDING).abs()[..., : bins * _PADDING // BINS_PER_PX + 1]
    corrected: Tensor = modulus / modulus[..., :1] * _correction(bins)
    return corrected


def _noise_power(line: Tensor, count: Tensor, noise: Tensor) -> Tensor:
    """Power that pixel noise of variance ``noise`` (B,) adds to the response, (B, F).

    A bin's mean has the noise over its pixels; the difference of two bins, 2/4 px apart, passes sin^2 of it.
    """
    bins = line.shape[-1]
    window = _window(torch.arange(bins), torch.full((1,), bins // 2)) ** 2
    held = (window / count.clamp_min(1)).sum(-1) * noise / line.sum(-1) ** 2
    f = torch.arange(bins * _PADDING // BINS_PER_PX + 1, dtype=torch.float64) / (bins * _PADDING)
    return held[:, None] * (torch.sin(2 * math.pi * f) * _correction(bins)) ** 2


def _correction(bins: int) -> Tensor:
    index = torch.arange(bins * _PADDING // BINS_PER_PX + 1, dtype=torch.float64) / _PADDING
    angle = math.pi * (index + 1) / (bins // 2 + 2)
    corrected = (angle / torch.sin(angle)).abs().clamp_max(_LARGEST_CORRECTION)
    return torch.where(index == 0, 1.0, corrected)


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
