"""Contrast between two patches, and how surely a pixel pair shows it.

Domain: digital numbers with the black level removed. Leading axes (batch, channel) of two patches agree, and
every number of a result is a tensor of their shape.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from blurnoise._core import checks
from blurnoise._core.limits import LIMITS, limited
from blurnoise.metrics import values
from blurnoise.metrics.noise import normal_quantile

KINDS = ("weber", "michelson")


@dataclass(frozen=True)
class PatchContrast:
    """Contrasts of two patches, each between ``_low`` and ``_high`` at the level asked for; tensors (...).

    michelson: (bright - dark)/(bright + dark) of the means. cnr: their difference over the root of the mean of
    both variances, a ratio. Flags, tensors (...): noiseless, both variances are 0, so cnr is infinite or NaN
    and has no interval; near_black, a mean is less than three of its own standard errors above black, so
    michelson says little (without noise: a mean at black or below); not_finite.
    """

    michelson: Tensor
    michelson_low: Tensor
    michelson_high: Tensor
    cnr: Tensor
    cnr_low: Tensor
    cnr_high: Tensor
    noiseless: Tensor
    near_black: Tensor
    not_finite: Tensor


def patch_contrast(bright: Tensor, dark: Tensor, *, level: float = 0.95) -> PatchContrast:
    """Michelson contrast and contrast-to-noise ratio of two patches (..., H, W) of any sizes.

    Neither patch is clipped or tested for being even: :func:`blurnoise.metrics.noise.patch_snr` does that.
    Intervals: normal, with the means' and variances' sampling errors carried through to first order.
    Raises ``TypeError`` or ``ValueError`` for patches of one pixel or of different leading shapes.
    """
    z = normal_quantile(level)
    (a, b), (n_a, n_b) = _pixels(("bright", bright), ("dark", dark))
    mean_a, mean_b, var_a, var_b = a.mean(-1), b.mean(-1), a.var(-1), b.var(-1)
    ratio, step = michelson(mean_a, mean_b), mean_a - mean_b
    se_a, se_b = (var_a / n_a).sqrt(), (var_b / n_b).sqrt()
    # d/da (a - b)/(a + b) = 2b/(a + b)², d/db = -2a/(a + b)²
    ratio_margin = 2 * z * torch.hypot(mean_b * se_a, mean_a * se_b) / (mean_a + mean_b) ** 2
    noise = (var_a + var_b) / 2
    cnr = step / noise.sqrt()
    # of the mean variance: each variance has 2 var²/(n - 1), and its root halves the relative error
    noise_se2 = (var_a**2 / (n_a - 1) + var_b**2 / (n_b - 1)) / (2 * noise**2)
    cnr_margin = z * torch.sqrt((se_a**2 + se_b**2) / noise + cnr**2 * noise_se2 / 4)
    return PatchContrast(
        michelson=ratio,
        michelson_low=ratio - ratio_margin,
        michelson_high=ratio + ratio_margin,
        cnr=cnr,
        cnr_low=cnr - cnr_margin,
        cnr_high=cnr + cnr_margin,
        noiseless=noise == 0,
        near_black=(mean_a <= 3 * se_a) | (mean_b <= 3 * se_b),
        not_finite=~torch.isfinite(a.sum(-1) + b.sum(-1)),
    )


def michelson(bright: Tensor, dark: Tensor) -> Tensor:
    """Michelson contrast (bright - dark)/(bright + dark) of two signals, A. A. Michelson 1927; NaN for 0 and 0."""
    bright = values.real("bright", bright)
    dark = values.beside("dark", values.real("dark", dark), bright)
    return (bright - dark) / (bright + dark)


def gaussian_detection_probability(
    mean_a: Tensor,
    variance_a: Tensor,
    mean_b: Tensor,
    variance_b: Tensor,
    *,
    nominal: float,
    tolerance: float,
    kind: str,
) -> Tensor:
    """Contrast detection probability of two Gaussian patches (IEEE P2020), in closed form; tensors broadcast.

    The probability that the contrast of a pixel of A to one of B lies within ``nominal`` (1 -+ ``tolerance``),
    where ``nominal`` is the scene's, of ``kind`` "weber", A/B - 1, or "michelson", (A - B)/(A + B). With the
    ratio's bounds r = 1 + c, or (1 + c)/(1 - c), and the normal distribution function Phi it is

        Phi((muA - rL muB)/sqrt(varA + rL² varB)) - Phi((muA - rH muB)/sqrt(varA + rH² varB)).

    True while B stays above black; where B's mean is within three deviations of it, some ratios change sides.
    Differentiable. Source: M. Geese, U. Seger, A. Paolillo 2018, "Detection Probabilities: Performance
    Prediction for Sensors of Autonomous Vehicles". Raises ``TypeError`` or ``ValueError`` for a variance below
    0, another kind, or a tolerance or contrast without bounds.
    """
    low, high = _ratio_bounds(nominal, tolerance, kind)
    mean_a = values.real("mean_a", mean_a)
    mean_b = values.beside("mean_b", values.real("mean_b", mean_b), mean_a)
    means = mean_a + mean_b
    var_a = values.not_negative("variance_a", variance_a, means)
    var_b = values.not_negative("variance_b", variance_b, means + var_a)

    def above(ratio: float) -> Tensor:
        """Probability that A is larger than ``ratio`` times B; 1/2 at the very bound without noise."""
        distance, spread = mean_a - ratio * mean_b, (var_a + ratio**2 * var_b).sqrt()
        certain = (distance == 0) & (spread == 0)
        share: Tensor = torch.special.ndtr(distance / torch.where(certain, 1.0, spread))
        return share

    return above(low) - above(high)


@dataclass(frozen=True)
class DetectionProbability:
    """Contrast detection probability of two patches as they are, between ``low`` and ``high``; tensors (...).

    probability: share of all pixel pairs. gaussian: what their means and variances alone predict. Flags,
    tensors (...): noiseless, both patches are constant (often: saturated); too_few_pixels, below 30 in a
    patch; not_finite, the numbers are NaN.
    """

    probability: Tensor
    low: Tensor
    high: Tensor
    gaussian: Tensor
    noiseless: Tensor
    too_few_pixels: Tensor
    not_finite: Tensor


def detection_probability(
    patch_a: Tensor, patch_b: Tensor, *, nominal: float, tolerance: float, kind: str, level: float = 0.95
) -> DetectionProbability:
    """Contrast detection probability of two patches (..., H, W) of any sizes, whatever their distributions.

    ``nominal``, ``tolerance``, ``kind`` and source as in :func:`gaussian_detection_probability`. All pairs are
    counted, by sorting; a pair counts where both pixels are above black and rL B <= A <= rH B. It is a
    two-sample U-statistic, so its variance is that of the pixels' own shares, var_A/nA + var_B/nB (E. DeLong
    et al. 1988): what a bootstrap over the pixels tends to, without its draws. The interval is Wilson's, for the
    number of coin flips of the same variance; it stays within [0, 1], and open where all pairs agree.
    Raises ``TypeError`` or ``ValueError`` naming the argument and what is allowed.
    """
    z = normal_quantile(level)
    low, high = _ratio_bounds(nominal, tolerance, kind)
    (a, b), (n_a, n_b) = _pixels(("patch_a", patch_a), ("patch_b", patch_b))
    finite = torch.isfinite(a.sum(-1) + b.sum(-1))
    share_a = _share_between(a, b, 1 / high, 1 / low)
    share_b = _share_between(b, a, low, high)
    p = share_a.mean(-1)
    variance = share_a.var(-1) / n_a + share_b.var(-1) / n_b
    flips = torch.where(variance > 0, p * (1 - p) / variance, float(min(n_a, n_b)))
    centre = (p + z**2 / (2 * flips)) / (1 + z**2 / flips)
    margin = z / (1 + z**2 / flips) * torch.sqrt(p * (1 - p) / flips + (z / (2 * flips)) ** 2)
    gaussian = gaussian_detection_probability(
        a.mean(-1), a.var(-1), b.mean(-1), b.var(-1), nominal=nominal, tolerance=tolerance, kind=kind
    )
    p, centre, gaussian = (torch.where(finite, number, math.nan) for number in (p, centre, gaussian))
    return DetectionProbability(
        probability=p,
        low=(centre - margin).clamp(min=0),
        high=(centre + margin).clamp(max=1),
        gaussian=gaussian,
        noiseless=a.var(-1) + b.var(-1) == 0,
        too_few_pixels=torch.full_like(finite, min(n_a, n_b) < 30),
        not_finite=~finite,
    )


def _share_between(own: Tensor, other: Tensor, low: float, high: float) -> Tensor:
    """For each pixel x of ``own`` (..., N) > 0 the share of ``other``'s in [low x, high x], (..., N)."""
    ordered = other.sort(-1).values.contiguous()
    below = torch.searchsorted(ordered, (own * low).contiguous())
    up_to = torch.searchsorted(ordered, (own * high).contiguous(), right=True)
    return torch.where(own > 0, (up_to - below) / other.shape[-1], 0.0).double()


def _ratio_bounds(nominal: float, tolerance: float, kind: str) -> tuple[float, float]:
    checks.one_of("kind", kind, KINDS)
    limited("tolerance", tolerance, "contrast")
    centre = checks.in_range("nominal", nominal, -1.0, LIMITS["contrast"].high if kind == "weber" else 1.0)
    low, high = sorted((centre * (1 - tolerance), centre * (1 + tolerance)))
    most = math.inf if kind == "weber" else 1.0
    if low == high or low <= -1 or high >= most:
        raise ValueError(
            f"nominal = {nominal:g}, tolerance = {tolerance:g}: the {kind} contrasts {low:g} to {high:g} must "
            f"differ and lie between -1 and {most:g}"
        )
    return (1 + low, 1 + high) if kind == "weber" else ((1 + low) / (1 - low), (1 + high) / (1 - high))


def _pixels(*patches: tuple[str, Tensor]) -> tuple[list[Tensor], list[int]]:
    """Patches as (..., N) float64, and their N. Raises ``ValueError`` unless N >= 2 and the rest agrees."""
    flat = [values.real(name, patch, dims=2).flatten(-2) for name, patch in patches]
    for (name, patch), pixels in zip(patches, flat, strict=True):
        if pixels.shape[-1] < 2 or pixels.shape[:-1] != flat[0].shape[:-1]:
            raise ValueError(
                f"{name}: must be two pixels or more, and {tuple(flat[0].shape[:-1])} before H and W, "
                f"got {tuple(patch.shape)}"
            )
    return flat, [pixels.shape[-1] for pixels in flat]
