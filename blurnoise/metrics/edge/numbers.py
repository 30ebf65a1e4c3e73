"""The numbers that a slanted edge is reported by, of one measurement or of a thousand resamples alike.

Domain: power (..., F) at frequencies from 0 on, spaced by cycles/px; levels and variances (..., 2) of the sides, left
and right, linear and without black level.
"""

from __future__ import annotations

import torch
from torch import Tensor

from blurnoise.metrics.edge.response import NYQUIST, at, crossing


def numbers(
    power: Tensor, spacing: Tensor, peak: Tensor, level: Tensor, variance: Tensor
) -> dict[str, Tensor]:
    """Every scalar by its name in SlantedEdge, (...) each; where 50 % is never reached, inf. peak: its index."""
    step = (level[..., 1] - level[..., 0]).abs()
    cnr = step / (variance.sum(-1) / 2).sqrt()
    return {
        "mtf50": crossing(power, spacing),
        "mtf50p": _after_peak(power, spacing, peak),
        "mtf_nyquist": at(power, spacing, NYQUIST),
        "mtf_nyquist_2": at(power, spacing, NYQUIST / 2),
        "mtf_nyquist_4": at(power, spacing, NYQUIST / 4),
        "cnr": cnr,
        "edge_snr_db": 20 * torch.log10(cnr),
        "michelson": step / level.sum(-1),
    }


def intervals(
    resampled: dict[str, Tensor], plain: dict[str, Tensor], wider: float = 1.0
) -> dict[str, Tensor]:
    """Of n resamples (B, n) the range (B, 2) that holds 95 %, made wider about the number itself, (B,)."""
    ends = torch.tensor([0.025, 0.975], dtype=torch.float64)
    found = {name: torch.quantile(values, ends, dim=1).T for name, values in resampled.items()}
    if wider == 1:
        return found
    about = {name: torch.where(plain[name].isfinite(), plain[name], 0.0)[:, None] for name in found}
    return {
        name: torch.where(plain[name].isfinite()[:, None], about[name] + wider * (each - about[name]), each)
        for name, each in found.items()
    }


def _after_peak(power: Tensor, spacing: Tensor, peak: Tensor) -> Tensor:
    """First frequency beyond the peak at which the response is half the peak's."""
    index = peak.expand(power.shape[:-1])[..., None]
    height = power.gather(-1, index)
    before = torch.arange(power.shape[-1]) < index
    return crossing(torch.where(before, height, power), spacing, height[..., 0] / 4)
