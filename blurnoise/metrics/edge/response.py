"""Response of an edge to spatial frequency, from its spline or by ISO 12233's steps, and the numbers read off it.

Domain: frequencies in cycles/px along the edge's normal. A response is represented by its power: its squared modulus
less the power of the noise. This has no bias, and may be negative where only noise is left.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import torch
from torch import Tensor

from blurnoise.metrics.edge.position import Sides, cosine, slope, smooth
from blurnoise.metrics.edge.spline import KNOT_PX, Spline

NYQUIST = 0.5  # cycles/px
PEAK_CERTAIN = 3.0  # standard errors by which a peak must exceed the response at 0
FREQUENCIES = torch.arange(513, dtype=torch.float64) / 512
"""0 to 1 cycle/px, at which the response of a spline is given."""
ISO_EDITION = (
    "ISO 12233:2023 (4th edition), as sfrmat5: an edge of 5th order, Tukey's window; "
    "earlier editions take a straight edge and Hamming's window"
)
"""What ``iso`` mode computes."""
BINS_PER_PX, ISO_LINE_ORDER, PADDING, LARGEST_CORRECTION = 4, 5, 8, 10.0  # of the standard's steps


@dataclass(frozen=True)
class EdgeResponse:
    """power: (B, F), at frequencies from 0 on, evenly spaced by ``spacing`` (B,); of resamples: resampled, (B, n, F).

    noise: (B, F), the variance of the complex response that was taken off it, or in ``iso`` mode is in it.

    >>> power, no_noise = torch.tensor([[1.0, 0.5, 0.1]]), torch.zeros(1, 3)
    >>> response = EdgeResponse(torch.tensor([0.25]), power, no_noise, None)
    >>> response.frequencies.tolist(), response.peak().tolist()  # the highest power is at 0
    ([[0.0, 0.25, 0.5]], [0])
    """

    spacing: Tensor
    power: Tensor
    noise: Tensor
    resampled: Tensor | None

    @property
    def frequencies(self) -> Tensor:
        """Cycles/px, (B, F)."""
        return torch.arange(self.power.shape[1], dtype=torch.float64) * self.spacing[:, None]

    def peak(self) -> Tensor:
        """Index of the highest power up to 0.5 cycle/px that significantly exceeds the one at 0, else 0, (B,)."""
        power = self.power.clamp_min(0)
        # Without noise, rounding leaves its power a little below 0 here and there.
        certain = power - PEAK_CERTAIN * torch.sqrt(2 * power * self.noise.clamp_min(0))
        highest = torch.where(self.frequencies <= NYQUIST, certain, 0.0).max(1)
        return torch.where(highest.values > 1, highest.indices, 0)

    def scatter(self, mtf50: Tensor) -> Tensor:
        """Relative standard deviation of MTF50 by noise, (B,); only the half in phase with the response counts."""
        index = (mtf50.nan_to_num(0, 0, 0) / self.spacing).long().clamp(1, self.power.shape[1] - 2)[:, None]
        rise = (self.power.gather(1, index + 1) - self.power.gather(1, index - 1))[:, 0] / (2 * self.spacing)
        along = torch.sqrt(self.noise.gather(1, index)[:, 0].clamp_min(0) / 2)
        return along / (rise.abs().clamp_min(1e-12) * mtf50)  # at 1/2, power changes as the response does


def exact_response(spline: Spline, sides: Sides, weights: Tensor | None) -> EdgeResponse:
    """Response at FREQUENCIES of the spline, and of its resamples by ``weights`` (n, H), which carry the noise twice.

    The derivative of a cubic B-spline is a difference of two quadratic ones, hence the response is the Fourier sum
    of the coefficients' differences times sinc^3.

    >>> from blurnoise import charts
    >>> from blurnoise.metrics.edge.measurement import shape_of
    >>> from blurnoise.metrics.edge.position import find_line, measure_sides
    >>> picture = charts.slanted_edge(60, 60)[0].double()
    >>> line = find_line(picture).position_px
    >>> sides, upright = measure_sides(picture, line)
    >>> response = exact_response(shape_of(upright, line, sides, block=1).spline, sides, None)
    >>> round(float(response.power[0, 256].sqrt()), 2)  # at 1/2 cycle/px a pixel has 2 / pi
    0.64
    """
    noise, resampled = _noise_power(spline.covariance), None
    if weights is not None:
        level, _ = sides.resampled(weights)
        taller = (level[..., 1] - level[..., 0]) / sides.step[:, None]
        drawn = spline.coefficients[:, None] + (weights - 1) @ spline.pulls  # to first order
        resampled = _modulus_squared(drawn) / taller[..., None] ** 2 - 2 * noise[:, None]
    spacing = FREQUENCIES[1].expand(len(noise))
    return EdgeResponse(spacing, _modulus_squared(spline.coefficients) - noise, noise, resampled)


def _modulus_squared(coefficients: Tensor) -> Tensor:
    steps = torch.diff(coefficients, dim=-1)
    real, imaginary = _waves(steps.shape[-1])
    return (steps @ real).square_() + (steps @ imaginary).square_()


@cache
def _waves(count: int) -> tuple[Tensor, Tensor]:
    knot_px = KNOT_PX * (torch.arange(count, dtype=torch.float64) - (count - 1) / 2)
    angle = 2 * math.pi * knot_px[:, None] * FREQUENCIES
    smooth = torch.sinc(KNOT_PX * FREQUENCIES) ** 3
    return torch.cos(angle) * smooth, torch.sin(angle) * smooth


def _noise_power(covariance: Tensor) -> Tensor:
    """Variance of the Fourier sum over coefficients' differences: a cosine sum over their lagged covariances."""
    about = torch.diff(torch.diff(covariance, dim=1), dim=2)
    count = about.shape[-1]
    # Rows, the last one first, each moved by its number: a column then holds equal lags, 1 - count to count - 1.
    moved = torch.nn.functional.pad(about.flip(1), (0, count)).flatten(1)[:, :-count]
    lagged = moved.view(len(about), count, 2 * count - 1).sum(1)
    lags = torch.cat([lagged[:, count - 1 : count], 2 * lagged[:, count:]], dim=1)
    angle = 2 * math.pi * KNOT_PX * torch.arange(count, dtype=torch.float64)[:, None] * FREQUENCIES
    return (lags @ torch.cos(angle)) * torch.sinc(KNOT_PX * FREQUENCIES) ** 6


def iso_response(values: Tensor, noise: Tensor, weights: Tensor | None) -> EdgeResponse:
    """Response by the standard's steps, with sfrmat5's quirks: bins are filled by ceil(), and the derivative's
    correction, capped at 10, counts frequencies from 1 (ISO 12233:2023, annex D; P. D. Burns, sfrmat5, 2023).

    values: (B, H, W), bright on the right, with noise of variance ``noise`` (B,); weights: (n, H), of resamples. The
    transform is padded, which gives values between its frequencies and changes none at them. A bin's mean has the
    noise over its pixels; the difference of two bins, 2/4 px apart, passes sin^2 of it.

    >>> from blurnoise import charts
    >>> response = iso_response(charts.slanted_edge(60, 60)[0].double(), torch.zeros(1, dtype=torch.float64), None)
    >>> round(float(crossing(response.power, response.spacing, torch.tensor([0.25]))), 2)  # MTF50 of a pixel: 0.603
    0.6
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
    return EdgeResponse(BINS_PER_PX / (bins * PADDING) / cosine(position), power(line), passed, resampled)


def _binned(values: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Sums and numbers of the pixels in bins of 1/4 px along the row, (B, H, N), of as many rows as take the edge
    over whole pixels; and its line, (B, H), found row by row."""
    _, height, width = values.shape
    column, row = torch.arange(width, dtype=torch.float64), torch.arange(height)
    across = torch.diff(values, dim=2, prepend=2 * values[:, :, :1] - values[:, :, 1:2]) / 2
    position = torch.tensor([(width - 1) / 2], dtype=torch.float64)
    for _ in range(2):
        weighted = across * (0.95 * _window(column, position) + 0.05)  # on a pedestal here, not below
        mass = weighted.sum(2)
        # A row's centre of mass, half a pixel back, for a difference lies between two pixels.
        centre = (weighted @ column) / torch.where(mass.abs() > 1e-12, mass, torch.inf) - 0.5
        position = smooth(centre, order=ISO_LINE_ORDER)
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
    """Central difference of the bins' means (..., N), empty ones from their neighbours, centred, under the window."""
    mean = total / count.clamp_min(1e-9)
    left = torch.cat([mean[..., :1], mean[..., :-1]], -1)
    right = torch.cat([mean[..., 1:], mean[..., -1:]], -1)
    spread = torch.where(count > 0, mean, (left + right) / 2)
    line = torch.zeros_like(spread)
    line[..., 1:-1] = (spread[..., 2:] - spread[..., :-2]) / 2
    line[..., 0], line[..., -1] = line[..., 1], line[..., -2]
    bins = line.shape[-1]
    index = torch.arange(bins)
    source = index + line.argmax(-1, keepdim=True) - bins // 2
    moved = line.gather(-1, source.clamp(0, bins - 1)) * ((source >= 0) & (source < bins))
    return moved * _window(index, torch.tensor([bins // 2]))


def _window(place: Tensor, middle: Tensor) -> Tensor:
    """Tukey's window of alpha 1, a cosine bell, about ``middle`` (...); it ends at the farther end of ``place``."""
    half = torch.maximum(middle, float(place[-1]) - middle)[..., None]
    return 0.5 + 0.5 * torch.cos(math.pi * (place - middle[..., None]) / half)


def crossing(power: Tensor, spacing: Tensor, level: Tensor) -> Tensor:
    """First frequency at which ``power`` (..., F), sampled by ``spacing``, falls below ``level`` (...), else inf.

    >>> power = torch.linspace(1, 0, 11, dtype=torch.float64)  # at 0 to 1 cycle/px
    >>> crossing(power[None], torch.tensor([0.1]), torch.tensor([0.25])).round(decimals=3)
    tensor([0.7500], dtype=torch.float64)
    """
    level = level[..., None]
    below = power < level
    index = below.to(torch.uint8).argmax(-1, keepdim=True)
    start = (index - 2).clamp(0, power.shape[-1] - 4)
    y = [power.gather(-1, start + k) - level for k in range(4)]
    # The cubic through the four points around it, in 32 steps: Newton's form on the places 0, 1, 2, 3.
    first, second = y[1] - y[0], (y[2] - 2 * y[1] + y[0]) / 2
    third = (y[3] - 3 * y[2] + 3 * y[1] - y[0]) / 6
    t = (index - start - 1).clamp_min(0) + torch.linspace(0, 1, 33, dtype=torch.float64)
    cubic = y[0] + t * (first + (t - 1) * (second + (t - 2) * third))
    after = (cubic < 0).to(torch.uint8).argmax(-1, keepdim=True).clamp_min(1)
    above, under = cubic.gather(-1, after - 1), cubic.gather(-1, after)
    position = start + t.gather(-1, after) - under / (under - above) / 32
    return torch.where(below.any(-1), position[..., 0] * spacing, torch.inf)


def numbers(
    power: Tensor, spacing: Tensor, peak: Tensor, level: Tensor, variance: Tensor
) -> dict[str, Tensor]:
    """All scalars by their names in SlantedEdge, (...) each; inf if 50 % is never reached. peak: its index.

    >>> power = torch.linspace(1, 0, 11, dtype=torch.float64)[None]  # at 0 to 1 cycle/px
    >>> level, variance = torch.tensor([[100.0, 300.0]]), torch.tensor([[16.0, 16.0]])
    >>> spacing = torch.tensor([0.1], dtype=torch.float64)
    >>> of_edge = numbers(power, spacing, torch.tensor([0]), level.double(), variance.double())
    >>> {name: round(float(of_edge[name]), 3) for name in ("mtf50", "cnr", "michelson")}
    {'mtf50': 0.75, 'cnr': 50.0, 'michelson': 0.5}
    """
    step = (level[..., 1] - level[..., 0]).abs()
    cnr = step / (variance.sum(-1) / 2).sqrt()
    index = peak.expand(power.shape[:-1])[..., None]
    height = power.gather(-1, index)
    after_peak = torch.where(torch.arange(power.shape[-1]) < index, height, power)
    position = (NYQUIST / torch.tensor([1.0, 2.0, 4.0]) / spacing[..., None]).expand(*power.shape[:-1], 3)
    before = position.long().clamp(0, power.shape[-1] - 2)
    between = torch.lerp(power.gather(-1, before), power.gather(-1, before + 1), position - before)
    mtf_nyquist, mtf_nyquist_2, mtf_nyquist_4 = between.clamp_min(0).sqrt().unbind(-1)
    return {
        "mtf50": crossing(power, spacing, torch.full_like(step, 0.25)),
        "mtf50p": crossing(after_peak, spacing, height[..., 0] / 4),
        "mtf_nyquist": mtf_nyquist,
        "mtf_nyquist_2": mtf_nyquist_2,
        "mtf_nyquist_4": mtf_nyquist_4,
        "cnr": cnr,
        "edge_snr_db": 20 * torch.log10(cnr),
        "michelson": step / level.sum(-1),
    }


def intervals(resampled: dict[str, Tensor], plain: dict[str, Tensor], wider: float) -> dict[str, Tensor]:
    """95 % intervals (B, 2) from n resamples (B, n), widened about the number itself, (B,), by a factor.

    >>> drawn = {"mtf50": torch.linspace(0.2, 0.4, 201, dtype=torch.float64)[None]}
    >>> intervals(drawn, {"mtf50": torch.tensor([0.3])}, wider=2.0)["mtf50"].round(decimals=3).tolist()
    [[0.11, 0.49]]
    """
    ends = torch.tensor([0.025, 0.975], dtype=torch.float64)
    bounds = {name: torch.quantile(values, ends, dim=1).T for name, values in resampled.items()}
    if wider == 1:
        return bounds
    for name, each in bounds.items():
        about = plain[name][:, None]
        bounds[name] = torch.where(about.isfinite(), about + wider * (each - about), each)
    return bounds


def block_weights(resamples: int, rows: int, block: int, seed: int) -> Tensor:
    """Number of times that each row is drawn, (resamples, rows), in blocks that wrap around the end.

    >>> weights = block_weights(resamples=2, rows=6, block=3, seed=0)
    >>> weights.shape, weights.sum(1).tolist()  # six rows are drawn each time, in two blocks of three
    (torch.Size([2, 6]), [6.0, 6.0])
    """
    generator = torch.Generator().manual_seed(seed)
    count = math.ceil(rows / block)
    starts = torch.randint(rows, (resamples, count), generator=generator)
    drawn = ((starts[:, :, None] + torch.arange(block)) % rows).flatten(1)[:, :rows]
    one = torch.ones((), dtype=torch.float64).expand(drawn.shape)
    return torch.zeros(resamples, rows, dtype=torch.float64).scatter_add_(1, drawn, one)


def widening(rows: int, block: int) -> float:
    """Factor by which intervals from few blocks of rows are too narrow; 1 if rows are drawn one by one.

    >>> widening(100, 1)
    1.0"""
    if block == 1:
        return 1.0
    # Student's 97.5 % over the normal law's, by Cornish and Fisher, and the root of n over n - 1.
    freedom, z = max(rows / block - 1, 3.0), 1.96
    student = 1 + (z**2 + 1) / (4 * freedom) + (5 * z**4 + 16 * z**2 + 3) / (96 * freedom**2)
    return student * math.sqrt(1 + 1 / freedom)
