"""Similarity of a picture to its reference: PSNR and SSIM, as Kornia computes them.

Domain: pictures (B, C, H, W) of one shape, integers or floats, any range that ``data_range`` states. One number
per picture, (B,); NaN in a picture gives NaN for it. These are exact functions of the two pictures, not
estimates, so they carry no interval. Differentiable.
"""

from __future__ import annotations

import torch
from kornia.metrics import psnr as kornia_psnr
from kornia.metrics import ssim as kornia_ssim
from torch import Tensor

from blurnoise._core.limits import limited
from blurnoise.metrics import values

SSIM_WINDOW_PX = 11
"""Gaussian of sigma 1.5 px, as in the paper that brought it."""


def psnr(picture: Tensor, reference: Tensor, *, data_range: float) -> Tensor:
    """Peak signal-to-noise ratio ``kornia.metrics.psnr``, dB, (B,): 10 log10(data_range²/MSE).

    Infinite for equal pictures. Raises as :func:`ssim` does.
    """
    a, b = _pair(picture, reference)
    peak = _range(data_range, a, b)
    return torch.stack([kornia_psnr(one, other, peak) for one, other in zip(a, b, strict=True)])


def ssim(picture: Tensor, reference: Tensor, *, data_range: float) -> Tensor:
    """Structural similarity ``kornia.metrics.ssim``, (B,), 1 for equal pictures, mean over pixels and channels.

    Z. Wang et al. 2004: Gaussian window of 11 px, sigma 1.5 px, K1 0.01, K2 0.03, only where the whole window
    lies inside the picture. data_range: distance from black to white in the pictures' units. Raises
    ``TypeError`` for what is no tensor of real numbers, ``ValueError`` for shapes that are not one
    (B, C, H, W), pictures smaller than 11 px, a range that is not positive, or values further apart than it.
    """
    a, b = _pair(picture, reference)
    if min(a.shape[-2:]) < SSIM_WINDOW_PX:
        raise ValueError(f"picture: must be {SSIM_WINDOW_PX} px or more per side, got {tuple(a.shape[-2:])}")
    peak = _range(data_range, a, b)
    per_pixel: Tensor = kornia_ssim(a, b, SSIM_WINDOW_PX, peak, eps=0.0, padding="valid")
    return per_pixel.mean((1, 2, 3))


def _pair(picture: Tensor, reference: Tensor) -> tuple[Tensor, Tensor]:
    a, b = values.real("picture", picture, dims=4), values.real("reference", reference, dims=4)
    if a.ndim != 4 or a.shape != b.shape:
        raise ValueError(
            f"picture, reference: must both be (B, C, H, W), got {tuple(a.shape)} and {tuple(b.shape)}"
        )
    return a, b


def _range(data_range: float, *pictures: Tensor) -> float:
    peak = limited("data_range", data_range)
    for picture in pictures:
        seen = picture.detach()
        seen = seen[torch.isfinite(seen)]
        if len(seen) and float(seen.max() - seen.min()) > peak * (1 + 1e-6):
            raise ValueError(
                f"data_range = {data_range!r}: must be from black to white, but the pictures' values span "
                f"{float(seen.max() - seen.min()):g}"
            )
    return peak
