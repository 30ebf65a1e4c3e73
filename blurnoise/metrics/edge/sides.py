"""Sides of an edge: how far the blur reaches, the two levels beyond it, and the noise upon them.

Domain: upright regions of :mod:`blurnoise.metrics.edge.geometry`, linear. Of the last dimension of size 2, entry 0
is the left side, 1 the right one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from blurnoise.metrics.edge.geometry import Upright

# Shares of the step:
FLAT = 0.005  # within which the edge counts as having reached its level
SLOPING, LIT = 0.1, 0.35  # by which a side may rise over its length before it is none; by light that grows
STRUCTURE = 0.1  # by which anything beside the edge may stand out
NOISELESS = 1e-8  # squared, of noise variance below which there is no noise

REACH_FACTOR, REACH_PX = 1.35, 1.0
"""Beyond the place where the edge is flat: a Gaussian within 0.5 % at 2.6 sigma is within 0.02 % at 3.5 sigma."""
STRIP_PX = 10.0  # least width of the strips in which levels and noise are measured
_BLOCK_PX = 8
_WHOLE = 0.98  # share of the rows that a whole column has
_RISING = 4.0  # standard errors of a rise that is no accident
_CERTAIN = 4.0  # and of a correlation: one in 3 000 edges with white noise at the lags looked at
_ALTERNATES = 5.0  # and of neighbours alone, by which they must alternate
_FADED = 1.5  # standard errors below which a correlation has ended
_ACROSS_PX, _ALONG_PX = 6, 24
_LENGTHS_PER_BLOCK, _REACHES_PER_BLOCK, _FEWEST_BLOCKS = 4, 2, 7


@dataclass(frozen=True)
class Reach:
    """px: how far to both sides the edge is looked at, (B,). rise: of the sides from left to right, per px, (B, 2), 0
    where there is none for certain. too_small, structured: (B,) bool.
    """

    px: Tensor
    rise: Tensor
    too_small: Tensor
    structured: Tensor


@dataclass(frozen=True)
class Sides:
    """level, variance, place_px: of the sides, (B, 2); the variance about a plane through the strip.

    count, total, square: sums over the strips' pixels in every row, (B, H, 2), of 1, of the values, and of the
    squared deviation from that plane: what a bootstrap over rows needs. too_small: (B,) bool. The others, (B,) each:
    of :func:`correlation_of`.
    """

    level: Tensor
    variance: Tensor
    place_px: Tensor
    count: Tensor
    total: Tensor
    square: Tensor
    too_small: Tensor
    power_at_0: Tensor
    block: Tensor
    correlated: Tensor
    alternates: Tensor

    @property
    def step(self) -> Tensor:
        """Right level minus left level, (B,)."""
        return self.level[:, 1] - self.level[:, 0]

    def level_by_row(self) -> Tensor:
        """The sides' levels at every row, (B, H, 2), on a straight line: light falls off along an edge."""
        row = torch.linspace(-1, 1, self.count.shape[1], dtype=torch.float64)[:, None]
        pixels = self.count.sum(1, keepdim=True)
        away = row - (self.count * row).sum(1, keepdim=True) / pixels
        above = self.total - self.count * self.level[:, None]
        rise = (above * away).sum(1, keepdim=True) / (self.count * away**2).sum(1, keepdim=True)
        return self.level[:, None] + rise * away

    def resampled(self, weights: Tensor) -> tuple[Tensor, Tensor]:
        """Level and variance, (B, n, 2) each, with row r counted weights[:, r] times; weights: (n, H)."""
        count, total, square = (weights @ rows for rows in (self.count, self.total, self.square))
        return total / count, square / (count - 3)


def reach_of(upright: Upright) -> Reach:
    """Find how far the edge departs from straight lines through the outer halves of its two sides."""
    inside, height = upright.inside, upright.values.shape[1]
    seen = upright.values * inside
    counts, totals = (
        torch.stack([part.sum(1) for part in torch.split(each, max(height // 4, 1), 1)], 1)
        for each in (inside, seen)
    )
    count = counts.sum(1)
    profile = totals.sum(1) / count.clamp_min(1)
    scatter = torch.linalg.vector_norm(seen, dim=1) ** 2 / count.clamp_min(1) - profile**2
    patches = totals - profile[:, None] * counts, counts
    # Left and right alike, outward from the edge: (B, 2, J + 1).
    profile, scatter, count = (_outward(each) for each in (profile, scatter, count))
    place = torch.arange(profile.shape[2], dtype=torch.float64)
    valid = count >= height / 4
    length = valid.sum(2)
    start = length / 2
    for _ in range(2):  # once the reach is known, all that lies beyond it tells the lines
        outer = valid & (place >= start[..., None])
        whole = outer & (
            count >= _WHOLE * height
        )  # of some rows alone, light that grows along the edge shows
        outer = torch.where(whole.sum(2, keepdim=True) >= _BLOCK_PX, whole, outer)
        noise = (scatter.clamp_min(0) * outer).sum(2) / outer.sum(2).clamp_min(1)
        rise, level, middle, error, error_of_rise = _line(place, profile, noise[..., None], count, outer)
        step = (level[:, 1] - level[:, 0]).abs()[:, None, None]
        off = (profile - level[..., None] - rise[..., None] * (place - middle[..., None])).abs()
        flat = (off <= torch.maximum(FLAT * step, 3 * error)) & valid
        three = flat[..., :-2] & flat[..., 1:-1] & flat[..., 2:]
        blur = three.to(torch.uint8).argmax(2).amax(1).to(torch.float64)
        start = torch.minimum(REACH_FACTOR * blur[:, None] + REACH_PX, length / 2)
    sure = _RISING * error_of_rise
    sloping = (rise * length).abs() > SLOPING * step[..., 0]
    too_small = (~three.any(2)).any(1) | (sloping.any(1) & ~_lit(rise, level, length, step[:, 0, 0], sure))
    rise = torch.where(rise.abs() > sure, rise, 0.0) * torch.tensor([-1.0, 1.0], dtype=torch.float64)
    px = REACH_FACTOR * blur + REACH_PX
    beyond = (place > px[:, None, None]) & valid
    structured = (beyond & (off > torch.maximum(STRUCTURE * step, 6 * error))).any(2).any(1)
    structured |= _shelf(profile, level, error[..., 0].amax(1))
    structured |= _patchy(*patches, px, step[:, 0], noise.amax(1).sqrt())
    return Reach(px, rise, too_small, structured)


def measure_sides(upright: Upright, position_px: Tensor, reach_px: Tensor) -> Sides:
    """Levels and noise in strips beside the reach of the edge, as wide as it reaches, at least ``STRIP_PX``."""
    end = reach_px + reach_px.clamp_min(STRIP_PX)
    middle = upright.values.shape[2] // 2
    distance = upright.distance_px(position_px)
    counts, totals, levels, places, left = [], [], [], [], []
    for side, outward in ((slice(None, middle + 1), -1), (slice(middle, None), 1)):
        away, values = outward * distance[..., side], upright.values[..., side]
        strip = upright.inside[..., side] * ((away > reach_px[:, None, None]) & (away <= end[:, None, None]))
        counts.append(strip.sum(2))
        totals.append((values * strip).sum(2))
        levels.append(totals[-1].sum(1) / counts[-1].sum(1).clamp_min(1))
        places.append((distance[..., side] * strip).sum((1, 2)) / counts[-1].sum(1).clamp_min(1))
        left.append((_about_plane(values, strip, levels[-1]), strip))
    squares = [(off**2).sum(2) for off, _ in left]
    count, total, square = (torch.stack(each, dim=-1) for each in (counts, totals, squares))
    pixels = count.sum(1)
    variance = square.sum(1) / (pixels - 3).clamp_min(1)
    too_small = (pixels < 2 * upright.values.shape[1]).any(1)
    level = torch.stack(levels, dim=-1)
    noisy = variance.amax(1) > NOISELESS * (level[:, 1] - level[:, 0]) ** 2  # rounding errors are correlated
    place = torch.stack(places, dim=-1)
    return Sides(level, variance, place, count, total, square, too_small, *correlation_of(left, noisy))


def _lit(rise: Tensor, level: Tensor, length: Tensor, step: Tensor, sure: Tensor) -> Tensor:
    """Whether the sides rise as light does that grows across the region, (B,): in proportion to their levels.

    Of a blur that fills the region the two sides rise alike, whatever their levels. rise, sure: outward, per px.
    """
    rises, levels = rise * length, level.clamp_min(0)
    bright = levels.amax(1)
    apart = (rises[:, 0] * levels[:, 1] + rises[:, 1] * levels[:, 0]).abs() / bright
    noise = (sure * length).amax(1)
    return (apart < (0.03 * step).maximum(noise)) & (rises.abs().amax(1) < LIT * step)


def _outward(columns: Tensor) -> Tensor:
    middle = columns.shape[1] // 2
    return torch.stack([columns[:, : middle + 1].flip(1), columns[:, middle:]], dim=1)


def _line(
    place: Tensor, profile: Tensor, noise: Tensor, count: Tensor, used: Tensor
) -> tuple[Tensor, Tensor, Tensor, Tensor, Tensor]:
    """Slope, mean and mean place of the profile (B, 2, n) where ``used``; its error about that line, (B, 2, n).

    The last one is the slope's error, (B, 2).
    """
    number = used.sum(-1, keepdim=True).clamp_min(1)
    share = used / number
    middle, mean = (share * place).sum(-1), (share * profile).sum(-1)
    about = place - middle[..., None]
    spread = (share * about**2).sum(-1).clamp_min(1e-12)
    rise = (share * about * profile).sum(-1) / spread
    pixels = (count * used).sum(-1, keepdim=True).clamp_min(1)
    of_line = (1 + about**2 / spread[..., None]) / pixels
    of_rise = torch.sqrt(noise / pixels)[..., 0] / spread.sqrt()
    return rise, mean, middle, torch.sqrt(noise * (1 / count.clamp_min(1) + of_line)), of_rise


def _shelf(profile: Tensor, level: Tensor, error: Tensor) -> Tensor:
    """Whether the profile rests half-way up, (B,): two steps with flat ground between them."""
    whole = torch.cat([profile[:, 0].flip(1), profile[:, 1, 1:]], dim=1)
    share = (whole - level[:, :1]) / (level[:, 1:] - level[:, :1])
    noise = error / (level[:, 1] - level[:, 0]).abs()
    core = (share > 0.1) & (share < 0.9)
    length = core.sum(1)
    width = (length // 3).clamp_min(4)
    later = (torch.arange(share.shape[1]) + width[:, None]).clamp_max(share.shape[1] - 1)
    rise = share.gather(1, later) - share
    resting = core & core.gather(1, later) & (rise + 4 * noise[:, None] < 0.16 * (width / length)[:, None])
    return resting.any(1)


def _patchy(off: Tensor, count: Tensor, reach_px: Tensor, step: Tensor, noise: Tensor) -> Tensor:
    """Whether blocks beside the edge differ from the mean of their columns, (B,): anything not along the edge.

    off: (B, groups of rows, columns), sums of the differences; count: of the pixels in them.
    """
    batch, groups, width = off.shape
    columns = width // _BLOCK_PX * _BLOCK_PX
    beside = (torch.arange(width) - width // 2).abs() > reach_px[:, None]
    off, count = (
        (each * beside[:, None])[..., :columns].reshape(batch, groups, -1, _BLOCK_PX).sum(-1)
        for each in (off, count)
    )
    limit = torch.maximum(STRUCTURE * step[..., None], 6 * noise[:, None, None] / count.clamp_min(1).sqrt())
    return ((off.abs() / count.clamp_min(1) > limit) & (count >= 2 * _BLOCK_PX)).any(2).any(1)


def _about_plane(values: Tensor, mask: Tensor, level: Tensor) -> Tensor:
    """Deviations of the masked values from their plane, 0 elsewhere, (B, H, W)."""
    batch, rows, columns = values.shape
    row, column = (torch.linspace(-1, 1, count, dtype=torch.float64) for count in (rows, columns))
    masked = mask * (values - level[:, None, None])
    by_row, by_column = mask.sum(2), mask.sum(1)
    moments = torch.empty(batch, 3, 3, dtype=torch.float64)
    moments[:, 0, 0] = by_row.sum(1)
    moments[:, 0, 1] = moments[:, 1, 0] = by_row @ row
    moments[:, 0, 2] = moments[:, 2, 0] = by_column @ column
    moments[:, 1, 1], moments[:, 2, 2] = by_row @ row**2, by_column @ column**2
    moments[:, 1, 2] = moments[:, 2, 1] = (mask @ column) @ row
    sums = torch.stack([masked.sum((1, 2)), masked.sum(2) @ row, masked.sum(1) @ column], dim=1)
    plane = (torch.linalg.pinv(moments, hermitian=True) @ sums[..., None])[..., 0]
    fitted = plane[:, :1, None] + plane[:, 1:2, None] * row[:, None] + plane[:, 2:, None] * column
    about: Tensor = masked - mask * fitted
    return about


def correlation_of(
    sides: Sequence[tuple[Tensor, Tensor]], noisy: Tensor
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """How the noise in ``sides`` is correlated, each what is left of it, 0 outside, and where it is: (B, H, W).

    Of each region, (B,): NPS(0) over the variance, 1 where noise is white; the rows that a bootstrap draws together;
    whether there are fewer than seven such blocks; and whether neighbours certainly differ more than white noise
    does, as sharpening leaves them. noisy: (B,) bool, of which regions to ask.

    Noise behind a Gaussian of 0.5, 0.8 and 1.5 px has a power of 2.3, 8 and 28 variances at 0, and intervals that
    draw row by row hold in 89, 77 and 64 % in place of 95 %.
    """
    height = sides[0][0].shape[1]
    noise, there = [], []
    for off, where in sides:
        pixels = where.sum((1, 2), keepdim=True).clamp_min(1)
        power = torch.linalg.vector_norm(off, dim=(1, 2), keepdim=True) / pixels.sqrt()
        # Single precision is enough of sums that are told to some parts in a hundred.
        noise.append((off / power.clamp_min(1e-15)).float())
        there.append(where.float())
    along = _at_lags([each.mT for each in noise], [each.mT for each in there], min(_ALONG_PX, height // 3))
    across = _at_lags(noise, there, _ACROSS_PX)
    (length_x, _), (length_y, alive) = _length(*across), _length(*along)
    next_to = (across[0][:, 0] / across[1][:, 0] + along[0][:, 0] / along[1][:, 0]) / math.sqrt(2)
    lengths = (_LENGTHS_PER_BLOCK * length_y).maximum(_REACHES_PER_BLOCK * alive)
    wanted = torch.where(noisy & (length_y > 1), lengths, 1.0)
    most = max(height // _FEWEST_BLOCKS, 1)
    block = wanted.ceil().long().clamp(1, most)
    power_at_0 = torch.where(noisy, length_x * length_y, 1.0)
    return power_at_0, block, wanted > most, noisy & (next_to < -_ALTERNATES)


def _at_lags(noise: Sequence[Tensor], there: Sequence[Tensor], most: int) -> tuple[Tensor, Tensor]:
    """Correlation at lags 1 to ``most`` along the last axis and its error for white noise, (B, most) each."""

    def products(values: Tensor) -> Tensor:
        """Sum of the products of all values that lie 1 to ``most`` apart."""
        long = 1 << (values.shape[2] + most - 1).bit_length()
        waves = torch.view_as_real(torch.fft.rfft(values, n=long))
        power = (waves * waves).sum(1).sum(-1)  # over both at once takes four times as long
        summed: Tensor = torch.fft.irfft(power, n=long)[:, 1 : most + 1].double()
        return summed

    pairs = torch.stack([products(each) for each in there]).sum(0).round().clamp_min(1)
    return torch.stack([products(each) for each in noise]).sum(0) / pairs, 1 / pairs.sqrt()


def _length(correlation: Tensor, error: Tensor) -> tuple[Tensor, Tensor]:
    """Sum over all lags up to where the correlation fades, 1 where nothing is certain, and that lag, (B,) each."""
    near = correlation[:, :8].sum(1) / torch.linalg.vector_norm(error[:, :8], dim=1)
    first = correlation[:, :2].amax(1) / error[:, 0]
    alive = (correlation > _FADED * error).to(torch.int64).cumprod(1)
    sums = 1 + 2 * (correlation * alive).sum(1)
    certain = torch.maximum(near, first) > _CERTAIN
    return torch.where(certain, sums.clamp_min(1), 1.0), alive.sum(1)
