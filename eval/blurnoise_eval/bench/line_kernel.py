"""Kernels of uniform straight motion, as a contender of the transfer function: tap weights on the pixel grid.

Convention: x right, y down, px. Kernels have odd sides, unit sum and their centroid on the centre pixel, and are
symmetric under a half turn, so correlation and convolution agree.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor


def line_kernel(displacement_px: Tensor) -> Tensor:
    """Kernels of uniform motion along straight lines of exact length and angle.

    displacement_px: (B, 2), motion (x, y) during the exposure. Returns (B, kh, kw), kh and kw odd and just
    large enough for the longest; a direction without motion has one tap. Differentiable.

    Tap (i, j) = integral over t in [-1/2, 1/2] of c(x t - j) c(y t - i) dt, c the cubic convolution kernel
    (Keys 1981, a = -1/2). It reproduces second-degree polynomials, so the taps sum to 1, have their centroid
    at 0 and the covariance of the line itself, d d^T / 12: the length is exact, not rounded to pixels. A few
    taps are slightly negative, as in any interpolation sharper than linear. Gauss-Legendre nodes, two to
    each quarter pixel of motion, keep those moments exact whatever their number.
    """
    longest = float(displacement_px.detach().abs().max()) if displacement_px.numel() else 0.0
    pieces = max(1, math.ceil(4 * longest))
    node = 0.5 / math.sqrt(3.0)
    centres = (torch.arange(pieces, dtype=torch.float64) + 0.5) / pieces - 0.5
    t = torch.cat([centres - node / pieces, centres + node / pieces]).to(displacement_px)
    along_x = _taps(displacement_px[:, 0], t)
    along_y = _taps(displacement_px[:, 1], t)
    return along_y.transpose(1, 2) @ along_x / len(t)


def _taps(extent_px: Tensor, t: Tensor) -> Tensor:
    """Cubic convolution weights (B, len(t), taps) of the positions extent_px * t."""
    extent = float(extent_px.detach().abs().max())
    half = 0 if extent == 0 else math.ceil(extent / 2) + 1
    taps = torch.arange(-half, half + 1, dtype=t.dtype, device=t.device)
    s = (extent_px[:, None, None] * t[None, :, None] - taps).abs()
    inner = (1.5 * s - 2.5) * s * s + 1
    outer = ((-0.5 * s + 2.5) * s - 4) * s + 2
    return torch.where(s < 1, inner, torch.where(s < 2, outer, torch.zeros_like(s)))
