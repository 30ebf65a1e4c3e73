"""Response of an edge to spatial frequency, from its shape: the noise in it, and the numbers read off it.

Domain: frequencies in cycles/px along the edge's normal. A response is kept as power, its squared modulus less the
power that noise adds to it, which is right on the average and may be negative where only noise is left.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import torch
from torch import Tensor

from blurnoise.metrics.edge.place import Sides
from blurnoise.metrics.edge.spline import KNOT_PX, Spline

NYQUIST = 0.5  # cycles/px
PEAK_CERTAIN = 3.0  # standard errors by which a peak must exceed the response at 0
FREQUENCIES = torch.arange(513, dtype=torch.float64) / 512
"""0 to 1 cycle/px, at which the response of a spline is given."""


@dataclass(frozen=True)
class Response:
    """power: (B, F), at frequencies from 0 on, evenly spaced by ``spacing`` (B,) cycles/px.

    noise: (B, F), the variance of the complex response that was taken off it, or in ``iso`` mode, which takes
    nothing off, the one that is in it. resampled: (B, n, F), the power of resamples, if any.
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
        """Index of the highest power up to 0.5 cycle/px that is certain to exceed that at 0, else 0, (B,)."""
        power = self.power.clamp_min(0)
        # Without noise, rounding leaves its power a little below 0 here and there.
        certain = power - PEAK_CERTAIN * torch.sqrt(2 * power * self.noise.clamp_min(0))
        found = torch.where(self.frequencies <= NYQUIST, certain, 0.0).max(1)
        return torch.where(found.values > 1, found.indices, 0)

    def scatter(self, mtf50: Tensor) -> Tensor:
        """Standard deviation of MTF50 that the noise causes, as a share of it, (B,).

        Noise along the response, half of all, moves the crossing by itself over the response's slope.
        """
        index = (mtf50.nan_to_num(0, 0, 0) / self.spacing).long().clamp(1, self.power.shape[1] - 2)[:, None]
        rise = (self.power.gather(1, index + 1) - self.power.gather(1, index - 1))[:, 0] / (2 * self.spacing)
        along = torch.sqrt(self.noise.gather(1, index)[:, 0].clamp_min(0) / 2)
        return along / (rise.abs().clamp_min(1e-12) * mtf50)  # at 1/2, power changes as the response does


def exact_response(spline: Spline, sides: Sides, weights: Tensor | None) -> Response:
    """Response at FREQUENCIES of the spline, and of its resamples by ``weights`` (n, H).

    The derivative of a cubic B-spline is a difference of two quadratic ones, hence the response is the Fourier sum
    of the coefficients' differences times sinc^3. A resample carries the noise twice.
    """
    noise, resampled = _noise_power(spline.covariance), None
    if weights is not None:
        level, _ = sides.resampled(weights)
        taller = (level[..., 1] - level[..., 0]) / sides.step[:, None]
        resampled = _modulus_squared(spline.resampled(weights)) / taller[..., None] ** 2 - 2 * noise[:, None]
    spacing = FREQUENCIES[1].expand(len(noise))
    return Response(spacing, _modulus_squared(spline.coefficients) - noise, noise, resampled)


def _modulus_squared(coefficients: Tensor) -> Tensor:
    steps = torch.diff(coefficients, dim=-1)
    cosine, sine = _waves(steps.shape[-1])
    return (steps @ cosine).square_() + (steps @ sine).square_()


@cache
def _waves(count: int) -> tuple[Tensor, Tensor]:
    place = KNOT_PX * (torch.arange(count, dtype=torch.float64) - (count - 1) / 2)
    angle = 2 * math.pi * place[:, None] * FREQUENCIES
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


def crossing(power: Tensor, spacing: Tensor, level: Tensor) -> Tensor:
    """First frequency at which ``power`` (..., F) falls below ``level`` (...), inf where it never does.

    spacing: of its frequencies, cycles/px. The cubic through the four points around it is followed, in 32 steps.
    """
    level = level[..., None]
    below = power < level
    index = below.to(torch.uint8).argmax(-1, keepdim=True)
    start = (index - 2).clamp(0, power.shape[-1] - 4)
    y = [power.gather(-1, start + k) - level for k in range(4)]
    # Newton's form on the places 0, 1, 2, 3.
    first, second = y[1] - y[0], (y[2] - 2 * y[1] + y[0]) / 2
    third = (y[3] - 3 * y[2] + 3 * y[1] - y[0]) / 6
    t = (index - start - 1).clamp_min(0) + torch.linspace(0, 1, 33, dtype=torch.float64)
    cubic = y[0] + t * (first + (t - 1) * (second + (t - 2) * third))
    after = (cubic < 0).to(torch.uint8).argmax(-1, keepdim=True).clamp_min(1)
    above, under = cubic.gather(-1, after - 1), cubic.gather(-1, after)
    place = start + t.gather(-1, after) - under / (under - above) / 32
    return torch.where(below.any(-1), place[..., 0] * spacing, torch.inf)


def numbers(
    power: Tensor, spacing: Tensor, peak: Tensor, level: Tensor, variance: Tensor
) -> dict[str, Tensor]:
    """Every scalar by its name in SlantedEdge, (...) each; where 50 % is never reached, inf. peak: its index."""
    step = (level[..., 1] - level[..., 0]).abs()
    cnr = step / (variance.sum(-1) / 2).sqrt()
    index = peak.expand(power.shape[:-1])[..., None]
    height = power.gather(-1, index)
    after_peak = torch.where(torch.arange(power.shape[-1]) < index, height, power)
    place = (NYQUIST / torch.tensor([1.0, 2.0, 4.0]) / spacing[..., None]).expand(*power.shape[:-1], 3)
    before = place.long().clamp(0, power.shape[-1] - 2)
    between = torch.lerp(power.gather(-1, before), power.gather(-1, before + 1), place - before)
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
    """Of n resamples (B, n) the range (B, 2) that holds 95 %, made wider about the number itself, (B,)."""
    ends = torch.tensor([0.025, 0.975], dtype=torch.float64)
    found = {name: torch.quantile(values, ends, dim=1).T for name, values in resampled.items()}
    if wider == 1:
        return found
    for name, each in found.items():
        about = plain[name][:, None]
        found[name] = torch.where(about.isfinite(), about + wider * (each - about), each)
    return found
