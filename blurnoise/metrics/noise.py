"""Noise of a patch that should be even: its signal-to-noise ratio.

Domain: digital numbers with the black level removed. Any leading axes (batch, channel) stay: every number of a
result is a tensor of their shape, and so is every flag, True where that number is not to be trusted plainly.
NaN or Inf in a patch gives NaN there and leaves the rest alone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from blurnoise._core import checks
from blurnoise.metrics import values

CLIPPED_SHARE = 0.005
"""Share of the pixels at either limit from which on mean and deviation are those of a cut distribution."""
TREND_SHARE = 0.1
"""Variance of the trend over that of the noise from which on a patch is not even."""
FEWEST_PIXELS = 100
"""Below it the deviation is known to no better than 7 %, and the normal interval is too narrow."""


@dataclass(frozen=True)
class PatchSnr:
    """Mean over standard deviation of a patch, as a ratio, between ``low`` and ``high`` at the level asked for.

    snr, low, high, mean_dn, std_dn and the flags are tensors (...). A deviation of 0 gives an infinite ratio,
    no interval (NaN), and ``noiseless``: the noise is below the converter's step, or the patch is saturated.
    """

    snr: Tensor
    low: Tensor
    high: Tensor
    mean_dn: Tensor
    std_dn: Tensor
    clipped: Tensor
    non_uniform: Tensor
    noiseless: Tensor
    too_few_pixels: Tensor
    not_finite: Tensor

    @property
    def snr_db(self) -> Tensor:
        """20 log10 of the ratio, dB; NaN where the mean is below black."""
        return 20 * torch.log10(self.snr)


def patch_snr(
    image: Tensor,
    *,
    roi: tuple[int, int, int, int] | float = 0.5,
    detrend: bool = True,
    limits_dn: tuple[float, float] | None = None,
    level: float = 0.95,
) -> PatchSnr:
    """SNR of an even patch of ``image`` (..., H, W), per picture and channel.

    roi: (x, y, width, height) in px, or the centre's share of each side. detrend: take a surface of second
    order off before the deviation is formed (shading is no noise), with its six degrees of freedom; the
    flag ``non_uniform`` looks at that surface in either case. limits_dn: least and greatest number a pixel can
    have, black level removed; without it 8-bit pictures have 0 and 255, and clipping goes unseen in others.

    With n pixels, v degrees of freedom and independent normal noise the ratio r has the variance
    1/n + r²/(2v); the interval is r -+ z times its root. Noise that is correlated between pixels has a wider
    one. Source: EMVA 1288 release 4, SNR; the paper takes a centre patch of 240 x 240 px (Lin et al., 4.1).
    Raises ``TypeError`` or ``ValueError`` naming the argument and what is allowed.
    """
    z = normal_quantile(level)
    if limits_dn is None and isinstance(image, Tensor) and image.dtype == torch.uint8:
        limits_dn = (0, 255)
    patch = _region(values.real("image", image, dims=2), roi)
    count, finite = patch.shape[-2] * patch.shape[-1], torch.isfinite(patch).all(-1).all(-1)
    mean = patch.mean((-2, -1))
    trend, order = _trend(patch)
    noise = patch - trend
    freedom = max(count - order, 1)
    noise_variance = noise.square().sum((-2, -1)) / freedom
    trend_variance = (trend - mean[..., None, None]).square().mean((-2, -1))
    total = (patch - mean[..., None, None]).square().sum((-2, -1)) / max(count - 1, 1)
    std = (noise_variance if detrend else total).sqrt()
    std = torch.where(_rounding(patch) >= std, 0.0, std) if count > order else torch.full_like(std, math.nan)
    snr = torch.where(finite, mean / std, math.nan)
    margin = z * torch.sqrt(1 / count + snr**2 / (2 * freedom))
    known = torch.isfinite(margin)
    seen = TREND_SHARE + 5 * (order - 1) / count  # noise alone has a trend, too: on average (order - 1)/count
    return PatchSnr(
        snr=snr,
        low=torch.where(known, snr - margin, math.nan),
        high=torch.where(known, snr + margin, math.nan),
        mean_dn=torch.where(finite, mean, math.nan),
        std_dn=torch.where(finite, std, math.nan),
        clipped=_clipped(patch, limits_dn),
        non_uniform=finite & (trend_variance > seen * noise_variance + _rounding(patch) ** 2),
        noiseless=std == 0,
        too_few_pixels=torch.full_like(finite, count < FEWEST_PIXELS),
        not_finite=~finite,
    )


def normal_quantile(level: float) -> float:
    """z for which a normal number lies within -+z with probability ``level``, which must be 0.5 to 0.9999."""
    share = checks.in_range("level", level, 0.5, 0.9999)
    return float(torch.special.ndtri(torch.tensor((1 + share) / 2, dtype=torch.float64)))


def _region(image: Tensor, roi: tuple[int, int, int, int] | float) -> Tensor:
    height, width = image.shape[-2:]
    if isinstance(roi, (int, float)):
        share = checks.in_range("roi", roi, 0.0, 1.0, above=True)
        w, h = max(1, round(width * share)), max(1, round(height * share))
        x, y = (width - w) // 2, (height - h) // 2
    elif not isinstance(roi, (tuple, list)):
        raise TypeError(
            f"roi = {checks.shown(roi)}: must be four integers (x, y, width, height) or a share of each side"
        )
    else:
        x, y, w, h = checks.rectangle("roi", roi)
    if x < 0 or y < 0 or w < 1 or h < 1 or x + w > width or y + h > height:
        raise ValueError(f"roi = {checks.shown(roi)}: must lie inside the picture, {width} x {height} px")
    return image[..., y : y + h, x : x + w]


def _trend(patch: Tensor) -> tuple[Tensor, int]:
    """Least-squares surface of second order of ``patch`` (..., H, W), and how many coefficients it has."""
    y, x = (torch.linspace(-1, 1, n, dtype=patch.dtype, device=patch.device) for n in patch.shape[-2:])
    powers = [(i, j) for i in range(3) for j in range(3 - i) if i < patch.shape[-1] and j < patch.shape[-2]]
    terms = torch.stack([(x**i * y[:, None] ** j).flatten() for i, j in powers], dim=-1)
    basis, _ = torch.linalg.qr(terms)
    return (patch.flatten(-2) @ basis @ basis.T).unflatten(-1, patch.shape[-2:]), len(powers)


def _clipped(patch: Tensor, limits_dn: tuple[float, float] | None) -> Tensor:
    if limits_dn is None:
        return torch.zeros(patch.shape[:-2], dtype=torch.bool, device=patch.device)
    ends = checks.real_tensor("limits_dn", limits_dn)
    if ends.shape != (2,) or not ends[0] < ends[1]:
        raise ValueError(f"limits_dn = {checks.shown(limits_dn)}: must be two numbers, the lower first")
    at_limit = (patch <= float(ends[0])) | (patch >= float(ends[1]))
    return at_limit.double().mean((-2, -1)) > CLIPPED_SHARE


def _rounding(patch: Tensor) -> Tensor:
    """What double precision leaves of a constant patch once its mean or trend is taken off."""
    return patch.abs().amax((-2, -1)) * 1e-12
