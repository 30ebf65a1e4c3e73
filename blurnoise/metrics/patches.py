"""Metrics of uniform patches: signal-to-noise ratio, contrast and its transfer, glare; similarity of pictures.

Domain: digital numbers with the black level removed, (..., H, W). Results have the leading shape (batch, channel); a
flag is True where the number should not be trusted. NaN or Inf in a patch gives NaN there, and "not_finite". All
raise ``TypeError`` or ``ValueError`` that names the argument.
"""

from __future__ import annotations

import math
from statistics import NormalDist
from typing import NamedTuple

import kornia.metrics
import torch
from torch import Tensor

from blurnoise._core import checks
from blurnoise._core.checks import LIMITS, limited
from blurnoise.metrics import values
from blurnoise.metrics.values import BatchEstimate

Z = NormalDist().inv_cdf(0.975)
TREND_SHARE = 0.1  # variance of the trend over the noise's from which on a patch is not uniform
FEWEST_PIXELS = 100  # below it the deviation is known to 7 % at best: the normal interval is too narrow
SSIM_WINDOW_PX = 11  # Gaussian of sigma 1.5 px, Z. Wang et al. 2004


def patch_snr(patch: Tensor, *, limits_dn: tuple[float, float] | None = None) -> BatchEstimate:
    """SNR of a uniform patch (..., H, W): mean over standard deviation, a ratio.

    A surface of second order, with six degrees of freedom, is subtracted to remove shading; the flag "non_uniform"
    tests for it. limits_dn: smallest and largest value of a pixel, black level removed; by default 0 and 255 for 8
    bits, else clipping is not tested. If the deviation is 0, the ratio is infinite without interval, and the flag is
    "noiseless".

    With n pixels, v degrees of freedom and independent normal noise the ratio r has the variance 1/n + r²/(2v);
    the 95 % interval is too narrow for noise that is correlated between pixels.
    Source: EMVA 1288 release 4, SNR.

    >>> patch = 100 + torch.randn(40, 40, generator=torch.Generator().manual_seed(0))
    >>> round(float(patch_snr(patch).value))
    97
    """
    if limits_dn is None and isinstance(patch, Tensor) and patch.dtype == torch.uint8:
        limits_dn = (0, 255)
    patch = values.real("patch", patch, dims=2)
    count, finite = patch.shape[-2] * patch.shape[-1], torch.isfinite(patch).all(-1).all(-1)
    mean = patch.mean((-2, -1))
    trend, order = _trend(patch)
    freedom = max(count - order, 1)
    noise_variance = (patch - trend).square().sum((-2, -1)) / freedom
    trend_variance = (trend - mean[..., None, None]).square().mean((-2, -1))
    rounding = patch.abs().amax((-2, -1)) * values.ROUNDING
    std = noise_variance.sqrt()
    std = torch.where(rounding >= std, 0.0, std) if count > order else torch.full_like(std, math.nan)
    snr = torch.where(finite, mean / std, math.nan)
    margin = Z * torch.sqrt(1 / count + snr**2 / (2 * freedom))
    margin = torch.where(torch.isfinite(margin), margin, math.nan)
    # The trend's terms share out the noise evenly: of count values, order - 1 of them beside the mean.
    tolerated = (
        TREND_SHARE + 5 * (order - 1) / count
    )  # noise alone has a trend of (order - 1)/count on average
    flags = {
        "clipped": _clipped(patch, limits_dn),
        "non_uniform": finite & (trend_variance > tolerated * noise_variance + rounding**2),
        "noiseless": std == 0,
        "too_few_pixels": torch.full_like(finite, count < FEWEST_PIXELS),
        "not_finite": ~finite,
    }
    return BatchEstimate(snr, snr - margin, snr + margin, flags)


class PatchContrast(NamedTuple):
    """Two contrasts of two patches.

    michelson: (bright - dark)/(bright + dark) of the means. cnr: difference of the means over the root of the mean
    variance, a ratio.

    >>> dark = 100 + torch.randn(100, 100, generator=torch.Generator().manual_seed(0))
    >>> contrast = patch_contrast(dark + 50, dark)
    >>> round(float(contrast.michelson.value), 2), round(float(contrast.cnr.value))  # 50 DN above noise of 1 DN
    (0.2, 50)
    """

    michelson: BatchEstimate
    cnr: BatchEstimate


def patch_contrast(bright: Tensor, dark: Tensor) -> PatchContrast:
    """Michelson contrast and contrast-to-noise ratio of two patches (..., H, W) of any sizes, of two pixels or more.

    Clipping and shading are not tested; see :func:`patch_snr`. Intervals: normal, with the means' and
    variances' sampling errors carried through to first order. Flags: "noiseless", both variances are 0, so cnr is
    infinite or NaN without interval; of michelson "near_black", a mean is less than three of its own standard errors
    above black.

    >>> dark = 100 + torch.randn(40, 40, generator=torch.Generator().manual_seed(0))
    >>> round(float(patch_contrast(3 * dark, dark).michelson.value), 3)
    0.5
    """
    a, b = _pixels(bright=bright, dark=dark)
    n_a, n_b = a.shape[-1], b.shape[-1]
    mean_a, mean_b, var_a, var_b = a.mean(-1), b.mean(-1), _variance(a), _variance(b)
    step, total = mean_a - mean_b, mean_a + mean_b
    se_a, se_b = (var_a / n_a).sqrt(), (var_b / n_b).sqrt()
    # d/da (a - b)/(a + b) = 2b/(a + b)², d/db = -2a/(a + b)²
    michelson, margin = step / total, 2 * Z * torch.hypot(mean_b * se_a, mean_a * se_b) / total**2
    noise = (var_a + var_b) / 2
    cnr = step / noise.sqrt()
    # of the mean variance: each variance has 2 var²/(n - 1), and its root halves the relative error
    noise_se2 = (var_a**2 / (n_a - 1) + var_b**2 / (n_b - 1)) / (2 * noise**2)
    cnr_margin = Z * torch.sqrt((se_a**2 + se_b**2) / noise + cnr**2 * noise_se2 / 4)
    flags = {"noiseless": noise == 0, "not_finite": ~torch.isfinite(a.sum(-1) + b.sum(-1))}
    near_black = {"near_black": (mean_a <= 3 * se_a) | (mean_b <= 3 * se_b)}
    return PatchContrast(
        BatchEstimate(michelson, michelson - margin, michelson + margin, flags | near_black),
        BatchEstimate(cnr, cnr - cnr_margin, cnr + cnr_margin, flags),
    )


def veiling_glare(black: Tensor, white: Tensor) -> BatchEstimate:
    """Veiling glare index of a light trap (..., H, W) before a white field: the mean of the one over the other's.

    The trap itself sends no light, so the index is the share that lens and camera scatter onto it. Interval and
    flags, "noiseless" and "not_finite", are as those of :func:`patch_contrast`.
    Source: ISO 18844:2017 and ISO 9358, which state it in per cent.

    >>> veiling_glare(torch.full((8, 8), 2.0), torch.full((8, 8), 80.0)).value
    tensor(0.0250, dtype=torch.float64)
    """
    a, b = _pixels(black=black, white=white)
    mean_a, mean_b, var_a, var_b = a.mean(-1), b.mean(-1), _variance(a), _variance(b)
    index = mean_a / mean_b
    margin = Z * torch.sqrt(var_a / a.shape[-1] + index**2 * var_b / b.shape[-1]) / mean_b
    flags = {"noiseless": var_a + var_b == 0, "not_finite": ~torch.isfinite(index)}
    return BatchEstimate(index, index - margin, index + margin, flags)


def contrast_transfer_accuracy(
    patch_a: Tensor, patch_b: Tensor, *, nominal: float, tolerance: float
) -> BatchEstimate:
    """Contrast transfer accuracy (CTA) of two patches (..., H, W) of any sizes and any distributions.

    The name is that of IEEE Std 2020-2024; drafts and earlier papers say contrast detection probability (CDP). The
    probability that the Weber contrast A/B - 1 of a pixel of A to one of B lies within ``nominal``
    (1 -+ ``tolerance``), where ``nominal`` is the scene's. A pair of pixels counts where both are above
    black and rL B <= A <= rH B, r = 1 + contrast. The share of all pairs is a two-sample U-statistic of variance
    var_A/nA + var_B/nB of the pixels' own shares (E. DeLong et al. 1988). The interval is Wilson's for as many coin
    flips as have that variance; it stays within [0, 1], and open where all pairs agree.
    Flags: "noiseless", both patches are constant (often: saturated); "too_few_pixels", below 30 in a patch.
    Source: M. Geese, U. Seger, A. Paolillo 2018, "Detection Probabilities: Performance Prediction for Sensors of
    Autonomous Vehicles".

    >>> dark, bright = torch.full((8, 8), 10.0), torch.linspace(10, 30, 64).reshape(8, 8)
    >>> round(float(contrast_transfer_accuracy(bright, dark, nominal=1.0, tolerance=0.5).value), 2)
    0.5
    """
    middle = checks.in_range("nominal", nominal, -1.0, LIMITS["contrast"].high)
    tolerance = limited("tolerance", tolerance, "contrast")
    low, high = sorted((1 + middle * (1 - tolerance), 1 + middle * (1 + tolerance)))
    if not 0 < low < high:
        must = f"the contrasts {low - 1:g} to {high - 1:g} must differ and lie above -1"
        raise ValueError(f"nominal = {nominal:g}, tolerance = {tolerance:g}: {must}")
    a, b = _pixels(patch_a=patch_a, patch_b=patch_b)
    n_a, n_b = a.shape[-1], b.shape[-1]
    finite = torch.isfinite(a.sum(-1) + b.sum(-1))
    share_a = _share_between(a, b, 1 / high, 1 / low)
    share_b = _share_between(b, a, low, high)
    p = torch.where(finite, share_a.mean(-1), math.nan)
    variance = share_a.var(-1) / n_a + share_b.var(-1) / n_b
    # As many coin flips as have this variance: pairs share pixels, so that they are fewer than there are pairs.
    flips = torch.where(variance > 0, p * (1 - p) / variance, float(min(n_a, n_b)))
    centre = (p + Z**2 / (2 * flips)) / (1 + Z**2 / flips)
    margin = Z / (1 + Z**2 / flips) * torch.sqrt(p * (1 - p) / flips + (Z / (2 * flips)) ** 2)
    flags = {
        "noiseless": _variance(a) + _variance(b) == 0,
        "too_few_pixels": torch.full_like(finite, min(n_a, n_b) < 30),
        "not_finite": ~finite,
    }
    return BatchEstimate(p, (centre - margin).clamp(min=0), (centre + margin).clamp(max=1), flags)


def psnr(picture: Tensor, reference: Tensor, *, data_range: float) -> Tensor:
    """Peak signal-to-noise ratio ``kornia.metrics.psnr``, dB, (B,): infinite for equal pictures.

    picture, reference: (B, C, H, W), of one shape. data_range: white minus black, in their units. Differentiable,
    like :func:`ssim`; NaN for a picture with NaN. Both raise ``ValueError`` if the values span more than the range.

    >>> grey = torch.full((1, 1, 16, 16), 0.5)
    >>> psnr(grey, grey + 0.1, data_range=1.0)
    tensor([20.0000], dtype=torch.float64)
    """
    a, b, peak = _checked(picture, reference, data_range)
    return torch.stack([kornia.metrics.psnr(one, other, peak) for one, other in zip(a, b, strict=True)])


def ssim(picture: Tensor, reference: Tensor, *, data_range: float) -> Tensor:
    """Structural similarity ``kornia.metrics.ssim``, (B,), 1 for equal pictures, mean over pixels and channels.

    K1 = 0.01, K2 = 0.03. The whole window must lie inside the picture, so its sides must be at least 11 px.

    >>> grey = torch.full((1, 1, 16, 16), 0.5)
    >>> ssim(grey, grey, data_range=1.0)
    tensor([1.], dtype=torch.float64)
    """
    a, b, peak = _checked(picture, reference, data_range)
    if min(a.shape[-2:]) < SSIM_WINDOW_PX:
        raise ValueError(f"picture: must be {SSIM_WINDOW_PX} px or more per side, got {tuple(a.shape[-2:])}")
    per_pixel: Tensor = kornia.metrics.ssim(a, b, SSIM_WINDOW_PX, peak, eps=0.0, padding="valid")
    return per_pixel.mean((1, 2, 3))


def _trend(patch: Tensor) -> tuple[Tensor, int]:
    """Least-squares surface of second order of ``patch`` (..., H, W), and how many coefficients it has."""
    y, x = (torch.linspace(-1, 1, n, dtype=patch.dtype, device=patch.device) for n in patch.shape[-2:])
    # x^i y^j up to second order, without powers that so few columns or rows cannot tell apart.
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
    return at_limit.double().mean((-2, -1)) > values.CLIPPED_SHARE


def _share_between(own: Tensor, other: Tensor, low: float, high: float) -> Tensor:
    """For each pixel x of ``own`` (..., N) > 0 the share of ``other``'s in [low x, high x], (..., N)."""
    ordered = other.sort(-1).values.contiguous()
    below = torch.searchsorted(ordered, (own * low).contiguous())
    up_to = torch.searchsorted(ordered, (own * high).contiguous(), right=True)
    return torch.where(own > 0, (up_to - below) / other.shape[-1], 0.0).double()


def _variance(pixels: Tensor) -> Tensor:
    """Variance of pixels (..., N); 0 where it is rounding alone."""
    variance = pixels.var(-1)
    return torch.where(variance.sqrt() <= pixels.abs().amax(-1) * values.ROUNDING, 0.0, variance)


def _pixels(**patches: Tensor) -> list[Tensor]:
    """Patches as (..., N) float64, N >= 2."""
    flat = [values.real(name, patch, dims=2).flatten(-2) for name, patch in patches.items()]
    leading = tuple(flat[0].shape[:-1])
    for name, pixels in zip(patches, flat, strict=True):
        if pixels.shape[-1] < 2 or pixels.shape[:-1] != leading:
            got = tuple(patches[name].shape)
            raise ValueError(f"{name}: must be two pixels or more, and {leading} before H and W, got {got}")
    return flat


def _checked(picture: Tensor, reference: Tensor, data_range: float) -> tuple[Tensor, Tensor, float]:
    a, b = values.real("picture", picture, dims=4), values.real("reference", reference, dims=4)
    shapes = tuple(a.shape), tuple(b.shape)
    if a.ndim != 4 or shapes[0] != shapes[1]:
        raise ValueError(f"picture, reference: must both be (B, C, H, W), got {shapes[0]} and {shapes[1]}")
    peak = limited("data_range", data_range)
    for finite in (pixels.detach()[torch.isfinite(pixels)] for pixels in (a, b)):
        if len(finite) and float(span := finite.max() - finite.min()) > peak * (1 + 1e-6):
            raise ValueError(
                f"data_range = {data_range!r}: must be from black to white, but the pictures span {span:g}"
            )
    return a, b, peak
