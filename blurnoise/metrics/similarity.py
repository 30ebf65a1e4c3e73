"""Similarity of a picture to its reference: PSNR and SSIM by Kornia, in double precision.

Domain: pictures (B, C, H, W) of one shape, integers or floats; data_range: distance from black to white in their
units. One number per picture, (B,), NaN where the picture holds NaN. Differentiable. Both raise ``TypeError`` for
what is no tensor of real numbers, ``ValueError`` for other shapes, a range that is not positive, or values further
apart than it.
"""

from __future__ import annotations

import kornia.metrics
import torch
from torch import Tensor

from blurnoise._core.checks import limited
from blurnoise.metrics import values

SSIM_WINDOW_PX = 11
"""Gaussian of sigma 1.5 px, Z. Wang et al. 2004."""


def psnr(picture: Tensor, reference: Tensor, *, data_range: float) -> Tensor:
    """Peak signal-to-noise ratio ``kornia.metrics.psnr``, dB, (B,): infinite for equal pictures."""
    a, b, peak = _checked(picture, reference, data_range)
    return torch.stack([kornia.metrics.psnr(one, other, peak) for one, other in zip(a, b, strict=True)])


def ssim(picture: Tensor, reference: Tensor, *, data_range: float) -> Tensor:
    """Structural similarity ``kornia.metrics.ssim``, (B,), 1 for equal pictures, mean over pixels and channels.

    K1 0.01, K2 0.03, only where the whole window lies inside the picture, which must be 11 px or more per side.
    """
    a, b, peak = _checked(picture, reference, data_range)
    if min(a.shape[-2:]) < SSIM_WINDOW_PX:
        raise ValueError(f"picture: must be {SSIM_WINDOW_PX} px or more per side, got {tuple(a.shape[-2:])}")
    per_pixel: Tensor = kornia.metrics.ssim(a, b, SSIM_WINDOW_PX, peak, eps=0.0, padding="valid")
    return per_pixel.mean((1, 2, 3))


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
