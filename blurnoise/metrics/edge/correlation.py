"""Correlation of the noise beside an edge: its power at frequency 0, and the rows that a bootstrap keeps together.

Domain: what is left of the two sides without their planes, upright regions (B, H, W), lags in px.

Noise that a lens does not see has the same power at all frequencies. Interpolation, denoising, compression and
columns of their own amplifiers change that: with a Gaussian of 0.5, 0.8 and 1.5 px the power at 0 is 2.3, 8 and 28
variances, and intervals that draw row by row hold in 89, 77 and 64 % in place of 95 %.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

_ACROSS_PX, _ALONG_PX = 6, 24
_CERTAIN = 4.0
"""Standard errors of a correlation that is no accident: one in 3 000 edges with white noise at the lags looked at."""
_ALTERNATES = 5.0
"""The same of neighbours alone, by which they must alternate."""
_FADED = 1.5
"""Standard errors below which a correlation has ended."""
_LENGTHS_PER_BLOCK, _REACHES_PER_BLOCK = 4, 2
_FEWEST_BLOCKS = 7


@dataclass(frozen=True)
class Correlation:
    """power_at_0: NPS(0) over the variance, (B,), 1 where noise is white. block: rows that are drawn together, (B,).

    too_long: (B,) bool, there are fewer than seven such blocks. alternates: (B,) bool, neighbours certainly differ
    more than white noise does, as sharpening leaves them.
    """

    power_at_0: Tensor
    block: Tensor
    too_long: Tensor
    alternates: Tensor


def correlation_of(sides: Sequence[tuple[Tensor, Tensor]]) -> Correlation:
    """Of the noise in ``sides``, each what is left of it and where it is: (B, H, W), 0 outside, and (B, H, W)."""
    height = sides[0][0].shape[1]
    pixels = [there.sum((1, 2), keepdim=True).clamp_min(1) for _, there in sides]
    powers = [
        torch.linalg.vector_norm(off, dim=(1, 2), keepdim=True) / count.sqrt()
        for (off, _), count in zip(sides, pixels, strict=True)
    ]
    # Single precision is enough of sums that are told to some parts in a hundred.
    noise = [(off / power.clamp_min(1e-15)).float() for (off, _), power in zip(sides, powers, strict=True)]
    there = [where.float() for _, where in sides]
    along = _at_lags([each.mT for each in noise], [each.mT for each in there], min(_ALONG_PX, height // 3))
    across = _at_lags(noise, there, _ACROSS_PX)
    (length_x, _), (length_y, alive) = _length(*across), _length(*along)
    next_to = (across[0][:, 0] / across[1][:, 0] + along[0][:, 0] / along[1][:, 0]) / math.sqrt(2)
    wanted = torch.where(
        length_y > 1, (_LENGTHS_PER_BLOCK * length_y).maximum(_REACHES_PER_BLOCK * alive), 1.0
    )
    block = wanted.ceil().long()
    most = max(height // _FEWEST_BLOCKS, 1)
    return Correlation(length_x * length_y, block.clamp(1, most), wanted > most, next_to < -_ALTERNATES)


def _at_lags(noise: Sequence[Tensor], there: Sequence[Tensor], most: int) -> tuple[Tensor, Tensor]:
    """Correlation at lags 1 to ``most`` along the last axis and its error for white noise, (B, most) each."""
    products, pairs = (torch.stack([_products(each, most) for each in of]).sum(0) for of in (noise, there))
    pairs = pairs.round().clamp_min(1)
    return products / pairs, 1 / pairs.sqrt()


def _products(values: Tensor, most: int) -> Tensor:
    """Sum of the products of all values that lie 1 to ``most`` apart along the last axis, (B, most)."""
    long = 1 << (values.shape[2] + most - 1).bit_length()
    waves = torch.view_as_real(torch.fft.rfft(values, n=long))
    power = (waves * waves).sum(1).sum(-1)  # over both at once takes four times as long
    products: Tensor = torch.fft.irfft(power, n=long)[:, 1 : most + 1].double()
    return products


def _length(correlation: Tensor, error: Tensor) -> tuple[Tensor, Tensor]:
    """Sum over all lags up to where the correlation fades, 1 where nothing is certain, and that lag, (B,) each."""
    near = correlation[:, :8].sum(1) / torch.linalg.vector_norm(error[:, :8], dim=1)
    first = correlation[:, :2].amax(1) / error[:, 0]
    alive = (correlation > _FADED * error).to(torch.int64).cumprod(1)
    sums = 1 + 2 * (correlation * alive).sum(1)
    certain = torch.maximum(near, first) > _CERTAIN
    return torch.where(certain, sums.clamp_min(1), 1.0), alive.sum(1)


def block_weights(resamples: int, rows: int, block: int, seed: int) -> Tensor:
    """How often each row is drawn in each of ``resamples`` bootstraps of blocks of rows, (resamples, rows).

    Blocks start anywhere and go on at the first row after the last; as many rows are drawn as there are.
    """
    generator = torch.Generator().manual_seed(seed)
    count = math.ceil(rows / block)
    starts = torch.randint(rows, (resamples, count), generator=generator)
    drawn = ((starts[:, :, None] + torch.arange(block)) % rows).flatten(1)[:, :rows]
    one = torch.ones((), dtype=torch.float64).expand(drawn.shape)
    return torch.zeros(resamples, rows, dtype=torch.float64).scatter_add_(1, drawn, one)


def widening(rows: int, block: int) -> float:
    """By how much intervals from blocks of rows are too narrow: 1 where rows are drawn one by one.

    Few blocks scatter about their own mean, and their scatter is itself uncertain: Student's 97.5 % over the normal
    law's, by Cornish and Fisher, and the root of n over n - 1. Of Gaussians of 0.5 and 0.8 px 1.15 and 1.3.
    """
    if block == 1:
        return 1.0
    freedom, z = max(rows / block - 1, 3.0), 1.96
    student = 1 + (z**2 + 1) / (4 * freedom) + (5 * z**4 + 16 * z**2 + 3) / (96 * freedom**2)
    return student * math.sqrt(1 + 1 / freedom)
