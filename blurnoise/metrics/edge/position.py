"""Position of an edge in its region: its line, the reach of its blur, and the levels and noise of its two sides.

Domain: linear regions (B, H, W) float64, the edge near vertical. Positions are the columns, px, at which it crosses
a row, pixel centres at integer + 0.5. Of a last dimension of size 2, entry 0 is the left side, 1 the right one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import torch
from torch import Tensor

from blurnoise.metrics.values import ROUNDING

MARGIN_PX = 2.0  # an edge that comes closer to the left or right border leaves its region
FLAT_AT_LEAST = 0.05  # share of the width at either border that is assumed flat in the first iteration
SIGNIFICANT = 6.0  # standard errors that a step must have
# Shares of the step:
FLAT = 0.005  # within which the edge counts as having reached its level
SLOPING, LIT = 0.1, 0.35  # by which a side may rise over its length; by light that grows across the region
STRUCTURE = 0.1  # by which the sides may deviate from flat
NOISELESS = 1e-8  # squared, of noise variance below which there is no noise

REACH_FACTOR, REACH_PX = 1.35, 1.0
"""Factor and px beyond the distance at which the edge is flat: a Gaussian is within 0.5 % of its level at 2.6 sigma,
within 0.02 % at 3.5 sigma."""
STRIP_PX = 10.0  # least width of the strips in which levels and noise are measured
WHOLE, WHOLE_COLUMNS = 0.98, 8  # share of the rows that a whole column has, and how many of them are enough
RISING = 4.0  # standard errors of a significant rise
CERTAIN = 4.0  # standard errors of a correlation: one in 3 000 edges with white noise has it
ALTERNATES = 5.0  # standard errors by which neighbours must alternate
FADED = 1.5  # standard errors below which a correlation has ended
# Lags of the noise's correlation: across the edge filters reach a few pixels, along it columns go on.
ACROSS_PX, ALONG_PX = 6, 24
LENGTHS_PER_BLOCK, REACHES_PER_BLOCK, FEWEST_BLOCKS = 4, 2, 7


@dataclass(frozen=True)
class EdgeLine:
    """The straight line of each edge.

    position_px: (B, H). left, right: levels of the sides, (B,). no_edge, structured, leaves: (B,) bool.

    >>> values = torch.zeros(1, 8, 20, dtype=torch.float64)
    >>> values[:, :, 8:] = 100.0
    >>> line = find_line(values)
    >>> float(line.left), float(line.right), bool(line.no_edge)
    (0.0, 100.0, False)
    """

    position_px: Tensor
    left: Tensor
    right: Tensor
    no_edge: Tensor
    structured: Tensor
    leaves: Tensor


@dataclass(frozen=True)
class Upright:
    """Rows shifted by whole pixels so that the edge is in the middle column. values, and inside (1 for pixels of the
    region, else 0), (B, H, 2 J + 1); first: original column of each row's first entry, (B, H).

    >>> rows = Upright(torch.zeros(1, 1, 5), torch.ones(1, 1, 5), first=torch.tensor([[10]]))
    >>> rows.distance_px(torch.tensor([[12.0]])).tolist()  # centres of columns 10 to 14 from 12.0
    [[[-1.5, -0.5, 0.5, 1.5, 2.5]]]
    """

    values: Tensor
    inside: Tensor
    first: Tensor

    def distance_px(self, position_px: Tensor) -> Tensor:
        """Distance along the row of every pixel's centre from ``position_px`` (B, H), positive to the right."""
        columns = torch.arange(self.values.shape[2], dtype=torch.float64) + 0.5
        return columns + (self.first - position_px)[:, :, None]

    def within(self, reach_px: int) -> Upright:
        """Only ``reach_px`` pixels to both sides of the edge."""
        middle = self.values.shape[2] // 2
        cut = slice(max(middle - reach_px, 0), middle + reach_px + 1)
        return Upright(self.values[:, :, cut], self.inside[:, :, cut], self.first + cut.start)


@dataclass(frozen=True)
class Sides:
    """The two sides of each edge.

    reach_px: how far the blur reaches, (B,). rise: of the sides from left to right, per px, 0 unless significant.

    level, variance, place_px: of the strips beside the reach, (B, 2), the variance about a plane. count, total,
    square: sums over each strip's pixels in every row, (B, H, 2), of 1, the values, and their squared deviations from
    that plane. The last four, (B,): of :func:`correlation_of`.

    >>> values = torch.zeros(1, 40, 60, dtype=torch.float64)
    >>> values[:, :, 30:] = 100.0
    >>> sides, _ = measure_sides(values, find_line(values).position_px)
    >>> float(sides.step), sides.variance.tolist()
    (100.0, [[0.0, 0.0]])
    """

    reach_px: Tensor
    rise: Tensor
    level: Tensor
    variance: Tensor
    place_px: Tensor
    count: Tensor
    total: Tensor
    square: Tensor
    too_small: Tensor
    structured: Tensor
    power_at_0: Tensor
    block: Tensor
    correlated: Tensor
    alternates: Tensor

    @property
    def step(self) -> Tensor:
        """Right level minus left level, (B,)."""
        return self.level[:, 1] - self.level[:, 0]

    def scaled(self, upright: Upright, position_px: Tensor) -> Tensor:
        """The values scaled so that the sides are 0 and 1; light may grow along the edge and across it."""
        row = torch.linspace(-1, 1, self.count.shape[1], dtype=torch.float64)[:, None]
        pixels = self.count.sum(1, keepdim=True)
        away = row - (self.count * row).sum(1, keepdim=True) / pixels
        above = self.total - self.count * self.level[:, None]
        along = (above * away).sum(1, keepdim=True) / (self.count * away**2).sum(1, keepdim=True)
        by_row = self.level[:, None] + along * away
        distance = upright.distance_px(position_px)
        left, right = (
            by_row[..., side, None]
            + self.rise[:, side, None, None] * (distance - self.place_px[:, side, None, None])
            for side in (0, 1)
        )
        return (upright.values - left) / (right - left)

    def resampled(self, weights: Tensor) -> tuple[Tensor, Tensor]:
        """Level and variance, (B, n, 2) each, with row r counted weights[:, r] times; weights: (n, H)."""
        count, total, square = (weights @ rows for rows in (self.count, self.total, self.square))
        return total / count, square / (count - 3)


def find_line(values: Tensor) -> EdgeLine:
    """Fit the straight line of each edge, from the dark share of every row's mean.

    The mean of a row does not change with blur, so it gives the position of any symmetric edge. The levels come from
    the columns beside the line, so line and levels are iterated.

    >>> values = torch.zeros(1, 8, 20, dtype=torch.float64)
    >>> values[:, :, 8:] = 100.0
    >>> find_line(values).position_px.round(decimals=3)[0, 0].item()  # between columns 7 and 8
    8.0
    """
    _, height, width = values.shape
    columns, rows = values.mean(1), values.mean(2)
    from_left, from_right = columns.cumsum(1), columns.flip(1).cumsum(1)
    near = far = torch.full((len(values),), max(2, int(FLAT_AT_LEAST * width)))
    for _ in range(3):
        left = from_left.gather(1, near[:, None] - 1)[:, 0] / near
        right = from_right.gather(1, far[:, None] - 1)[:, 0] / far
        step = torch.where(right == left, torch.nan, right - left)
        position = smooth((right[:, None] - rows) / step[:, None] * width, order=1).nan_to_num(width / 2)
        near = (position.amin(1) / 2).long().clamp(2, width // 2)
        far = ((width - position.amax(1)) / 2).long().clamp(2, width // 2)
    mean_square = torch.linalg.vector_norm(values, dim=(1, 2)) ** 2 / (height * width)
    total = (mean_square - rows.mean(1) ** 2).clamp_min(0)
    # Second differences: of white noise six times its variance, of smooth pictures next to nothing.
    curved = torch.diff(values[:, ::4], n=2, dim=2)
    noise = (curved * curved).mean((1, 2)) / 6
    standing = SIGNIFICANT * torch.sqrt(noise * (1 / near + 1 / far) / height)
    step_squared = (right - left) ** 2
    # An edge has a variance of at most a quarter of its squared step; more variance is other structure.
    structured = (total - noise > 0.35 * step_squared) & (total > 1.2 * noise)
    no_edge = ~structured & (step_squared <= standing**2)
    leaves = (position.amin(1) < MARGIN_PX) | (position.amax(1) > width - MARGIN_PX)
    return EdgeLine(position, left, right, no_edge, structured, leaves)


def smooth(position_px: Tensor, *, order: int) -> Tensor:
    """Least-squares polynomial of ``order`` through ``position_px`` (B, H) over the rows, at the rows.

    >>> smooth(torch.tensor([[1.0, 2.1, 2.9, 4.0]], dtype=torch.float64), order=1).round(decimals=2)
    tensor([[1.0300, 2.0100, 2.9900, 3.9700]], dtype=torch.float64)
    """
    basis = row_basis(position_px.shape[1], order)
    return position_px @ basis @ basis.T


@cache
def row_basis(rows: int, order: int) -> Tensor:
    """Orthonormal polynomials up to ``order`` over the rows, (rows, order + 1).

    >>> basis = row_basis(5, 1)
    >>> (basis.T @ basis).round(decimals=6).abs().tolist()  # orthonormal
    [[1.0, 0.0], [0.0, 1.0]]
    """
    row = torch.linspace(-1, 1, rows, dtype=torch.float64)
    basis: Tensor = torch.linalg.qr(torch.stack([row**power for power in range(order + 1)], dim=1)).Q
    return basis


def slope(values: Tensor) -> Tensor:
    """Slope of the straight line through evenly spaced values (B, n), per step: of an edge, columns per row.

    >>> slope(torch.tensor([[1.0, 1.5, 2.0]], dtype=torch.float64))
    tensor([0.5000], dtype=torch.float64)
    """
    index = torch.arange(values.shape[1], dtype=torch.float64) - (values.shape[1] - 1) / 2
    return values @ (index / (index @ index))


def cosine(position_px: Tensor) -> Tensor:
    """Pixels along the normal for one along the row, (B,).

    >>> cosine(torch.tensor([[0.0, 1.0, 2.0]], dtype=torch.float64))
    tensor([0.7071], dtype=torch.float64)
    """
    return 1 / torch.sqrt(1 + slope(position_px) ** 2)


def largest_phase_gap_px(position_px: Tensor) -> Tensor:
    """Widest gap between the rows' sampling phases, px along the normal, (B,).

    >>> quarters = torch.tensor([[4.0, 4.25, 4.5, 4.75]], dtype=torch.float64)
    >>> round(float(largest_phase_gap_px(quarters)), 4)  # 0.25 px along the row of an edge 14 degrees off
    0.2425
    """
    phases = torch.sort(position_px.remainder(1.0), dim=1).values
    around = torch.cat([phases, phases[:, :1] + 1], dim=1)
    return torch.diff(around, dim=1).amax(1) * cosine(position_px)


def measure_sides(values: Tensor, position_px: Tensor) -> tuple[Sides, Upright]:
    """Measure the reach of each edge, and level and noise in strips beside it; also return the upright edge.

    A strip is as wide as the reach, at least ``STRIP_PX``.

    >>> values = torch.zeros(1, 40, 60, dtype=torch.float64)
    >>> values[:, :, 30:] = 100.0
    >>> sides, _ = measure_sides(values, find_line(values).position_px)
    >>> sides.level.tolist(), float(sides.reach_px)
    ([[0.0, 100.0]], 2.35)
    """
    width = values.shape[2]
    half = int(torch.maximum(position_px.amax(), width - position_px.amin()).ceil()) + 1
    first = position_px.floor().long() - half
    columns = first[:, :, None] + torch.arange(2 * half + 1)
    inside = ((columns >= 0) & (columns < width)).to(torch.float64)
    upright = Upright(values.gather(2, columns.clamp_(0, width - 1)), inside, first)
    reach_px, rise, too_small, structured = _reach(upright)
    upright = upright.within(2 * max(int(reach_px.max().ceil()), int(STRIP_PX)) + 3)
    end = reach_px + reach_px.clamp_min(STRIP_PX)
    middle = upright.values.shape[2] // 2
    distance = upright.distance_px(position_px)
    of_sides, left = [], []
    for side, outward in ((slice(None, middle + 1), -1), (slice(middle, None), 1)):
        away, near = outward * distance[..., side], upright.values[..., side]
        strip = upright.inside[..., side] * ((away > reach_px[:, None, None]) & (away <= end[:, None, None]))
        count, total = strip.sum(2), (near * strip).sum(2)
        pixels = count.sum(1).clamp_min(1)
        level, place = total.sum(1) / pixels, (distance[..., side] * strip).sum((1, 2)) / pixels
        off = _about_plane(near, strip, level)
        of_sides.append((level, place, count, total, (off**2).sum(2)))
        left.append((off, strip))
    level, place, count, total, square = (torch.stack(each, dim=-1) for each in zip(*of_sides, strict=True))
    pixels = count.sum(1)
    least = (ROUNDING * values.abs().amax((1, 2))[:, None]) ** 2
    square = torch.where((square.sum(1) <= least * pixels)[:, None], 0.0, square)
    variance = square.sum(1) / (pixels - 3).clamp_min(1)
    too_small |= (pixels < 2 * upright.values.shape[1]).any(1)
    # Without noise only rounding errors are left, which are correlated.
    noisy = variance.amax(1) > NOISELESS * (level[:, 1] - level[:, 0]) ** 2
    sums = count, total, square, too_small, structured
    return Sides(reach_px, rise, level, variance, place, *sums, *correlation_of(left, noisy)), upright


def _reach(upright: Upright) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Distance up to which the edge leaves the lines through its sides; their rise; too_small; structured."""
    inside, height = upright.inside, upright.values.shape[1]
    inside_values = upright.values * inside
    count = inside.sum(1)
    profile = inside_values.sum(1) / count.clamp_min(1)
    scatter = torch.linalg.vector_norm(inside_values, dim=1) ** 2 / count.clamp_min(1) - profile**2
    # Left and right alike, outward from the edge: (B, 2, J + 1).
    middle = profile.shape[1] // 2
    profile, scatter, count = (
        torch.stack([each[:, : middle + 1].flip(1), each[:, middle:]], dim=1)
        for each in (profile, scatter, count)
    )
    outward = torch.arange(profile.shape[2], dtype=torch.float64)
    valid = count >= height / 4
    length = valid.sum(2)
    start = length / 2
    for _ in range(2):  # first from the outer halves, then from everything beyond the reach
        outer = valid & (outward >= start[..., None])
        whole = outer & (
            count >= WHOLE * height
        )  # columns of some rows only would take light that grows along the edge for a rise
        outer = torch.where(whole.sum(2, keepdim=True) >= WHOLE_COLUMNS, whole, outer)
        noise = (scatter.clamp_min(0) * outer).sum(2) / outer.sum(2).clamp_min(1)
        rise, level, centre, error, error_of_rise = _line(outward, profile, noise[..., None], count, outer)
        step = (level[:, 1] - level[:, 0]).abs()[:, None, None]
        off = (profile - level[..., None] - rise[..., None] * (outward - centre[..., None])).abs()
        flat = (off <= torch.maximum(FLAT * step, 3 * error)) & valid
        three = flat[..., :-2] & flat[..., 1:-1] & flat[..., 2:]
        blur = three.to(torch.uint8).argmax(2).amax(1).to(torch.float64)
        start = torch.minimum(REACH_FACTOR * blur[:, None] + REACH_PX, length / 2)
    sure = RISING * error_of_rise
    # Growing light multiplies: the sides rise in proportion to their levels. Blur that fills the region makes both
    # rise alike.
    rises, levels, tall = rise * length, level.clamp_min(0), step[:, 0, 0]
    apart = (rises[:, 0] * levels[:, 1] + rises[:, 1] * levels[:, 0]).abs() / levels.amax(1)
    lit = (apart < (0.03 * tall).maximum((sure * length).amax(1))) & (rises.abs().amax(1) < LIT * tall)
    too_small = (~three.any(2)).any(1) | ((rises.abs().amax(1) > SLOPING * tall) & ~lit)
    rise = torch.where(rise.abs() > sure, rise, 0.0) * torch.tensor([-1.0, 1.0], dtype=torch.float64)
    px = REACH_FACTOR * blur + REACH_PX
    beyond = (outward > px[:, None, None]) & valid
    structured = (beyond & (off > torch.maximum(STRUCTURE * step, 6 * error))).any(2).any(1)
    structured |= _shelf(profile, level, error[..., 0].amax(1))
    return px, rise, too_small, structured


def _line(
    outward: Tensor, profile: Tensor, noise: Tensor, count: Tensor, used: Tensor
) -> tuple[Tensor, Tensor, Tensor, Tensor, Tensor]:
    """Slope, mean and mean place of the profile (B, 2, n) where ``used``; its error about that line; the slope's."""
    number = used.sum(-1, keepdim=True).clamp_min(1)
    share = used / number
    middle, mean = (share * outward).sum(-1), (share * profile).sum(-1)
    about = outward - middle[..., None]
    spread = (share * about**2).sum(-1).clamp_min(1e-12)
    rise = (share * about * profile).sum(-1) / spread
    pixels = (count * used).sum(-1, keepdim=True).clamp_min(1)
    of_line = (1 + about**2 / spread[..., None]) / pixels
    of_rise = torch.sqrt(noise / pixels)[..., 0] / spread.sqrt()
    return rise, mean, middle, torch.sqrt(noise * (1 / count.clamp_min(1) + of_line)), of_rise


def _shelf(profile: Tensor, level: Tensor, error: Tensor) -> Tensor:
    """Whether the profile has a plateau between its levels, (B,): two steps with flat ground between them."""
    whole = torch.cat([profile[:, 0].flip(1), profile[:, 1, 1:]], dim=1)
    step = level[:, 1:] - level[:, :1]
    share, noise = (whole - level[:, :1]) / step, error[:, None] / step.abs()
    core = (share > 0.1) & (share < 0.9)
    length = core.sum(1, keepdim=True)
    width = (length // 3).clamp_min(4)
    later = (torch.arange(share.shape[1]) + width).clamp_max(share.shape[1] - 1)
    rise = share.gather(1, later) - share
    return (core & core.gather(1, later) & (rise + 4 * noise < 0.16 * (width / length))).any(1)


def _about_plane(values: Tensor, mask: Tensor, level: Tensor) -> Tensor:
    """Deviations of the masked values from their plane, 0 elsewhere, (B, H, W)."""
    row, column = (torch.linspace(-1, 1, count, dtype=torch.float64) for count in values.shape[1:])
    terms = torch.stack([torch.ones(values.shape[1:]), *torch.meshgrid(row, column, indexing="ij")], dim=-1)
    masked = mask * (values - level[:, None, None])
    products = (terms[..., None] * terms[..., None, :]).flatten(0, 1).flatten(1)
    moments = (mask.flatten(1) @ products).view(-1, 3, 3)
    sums = masked.flatten(1) @ terms.flatten(0, 1)
    plane = torch.linalg.pinv(moments, hermitian=True) @ sums[..., None]
    about: Tensor = masked - mask * (terms @ plane[:, None])[..., 0]
    return about


def correlation_of(
    sides: Sequence[tuple[Tensor, Tensor]], noisy: Tensor
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Correlation of the noise of ``sides`` (values and mask, (B, H, W)) in regions that are ``noisy`` (B,).

    Returns, (B,) each: NPS(0) over the variance, 1 for white noise; how many rows a bootstrap draws together;
    whether there are fewer than seven such blocks; whether neighbours alternate, which sharpening causes.

    >>> noise = torch.randn(2, 1, 60, 20, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    >>> sides = [(side, torch.ones_like(side)) for side in noise]
    >>> power_at_0, block, *_ = correlation_of(sides, torch.tensor([True]))
    >>> power_at_0.tolist(), block.tolist()  # white: rows are drawn one by one
    ([1.0], [1])
    """
    height = sides[0][0].shape[1]
    noise, there = [], []
    for off, where in sides:
        pixels = where.sum((1, 2), keepdim=True).clamp_min(1)
        power = torch.linalg.vector_norm(off, dim=(1, 2), keepdim=True) / pixels.sqrt()
        noise.append(
            (off / power.clamp_min(1e-15)).float()
        )  # single precision: the sums are known to parts in a hundred
        there.append(where.float())
    along = _at_lags([each.mT for each in noise], [each.mT for each in there], min(ALONG_PX, height // 3))
    across = _at_lags(noise, there, ACROSS_PX)
    (length_x, _), (length_y, alive) = _length(*across), _length(*along)
    next_to = (across[0][:, 0] / across[1][:, 0] + along[0][:, 0] / along[1][:, 0]) / math.sqrt(2)
    lengths = (LENGTHS_PER_BLOCK * length_y).maximum(REACHES_PER_BLOCK * alive)
    wanted = torch.where(noisy & (length_y > 1), lengths, 1.0)
    most = max(height // FEWEST_BLOCKS, 1)
    block = wanted.ceil().long().clamp(1, most)
    power_at_0 = torch.where(noisy, length_x * length_y, 1.0)
    return power_at_0, block, wanted > most, noisy & (next_to < -ALTERNATES)


def _at_lags(noise: Sequence[Tensor], there: Sequence[Tensor], most: int) -> tuple[Tensor, Tensor]:
    """Correlation at lags 1 to ``most`` along the last axis and its error for white noise, (B, most) each."""

    def products(values: Tensor) -> Tensor:
        long = 1 << (values.shape[2] + most - 1).bit_length()
        waves = torch.view_as_real(torch.fft.rfft(values, n=long))
        power = (waves * waves).sum(1).sum(-1)  # over both at once takes four times as long
        summed: Tensor = torch.fft.irfft(power, n=long)[:, 1 : most + 1].double()
        return summed

    pairs = torch.stack([products(each) for each in there]).sum(0).round().clamp_min(1)
    return torch.stack([products(each) for each in noise]).sum(0) / pairs, 1 / pairs.sqrt()


def _length(correlation: Tensor, error: Tensor) -> tuple[Tensor, Tensor]:
    """Correlation length, the sum over lags until the correlation fades (1 if none is significant); and that lag."""
    near = correlation[:, :8].sum(1) / torch.linalg.vector_norm(error[:, :8], dim=1)
    first = correlation[:, :2].amax(1) / error[:, 0]
    alive = (correlation > FADED * error).to(torch.int64).cumprod(1)
    sums = 1 + 2 * (correlation * alive).sum(1)
    certain = torch.maximum(near, first) > CERTAIN
    return torch.where(certain, sums.clamp_min(1), 1.0), alive.sum(1)
