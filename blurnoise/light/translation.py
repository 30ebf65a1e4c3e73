"""Translation of pictures in linear light by any real distance: where a moving scene is at another moment.

Convention: x right, y down, px; what leaves at one side is replaced by the border's continuation at the other. Whole
pixels are copied. The rest is a phase in the Fourier transform, exact for what the samples hold: beside a step that
they do not resolve it rings, as :mod:`blurnoise.blur.convolution` does.
"""

from __future__ import annotations

from collections.abc import Iterable

import torch
from torch import Tensor

from blurnoise._core.borders import BORDERS, Border, extended
from blurnoise._core.checks import image_batch, one_of
from blurnoise.blur import convolution

_MARGIN_PX = 64  # of the phase's tail, which falls as one over the distance
_WHOLE_PX = 1e-4  # a shift nearer than this to a whole pixel is one: 3e-4 of the finest detail


def translated(light: Tensor, shift_px: Tensor | Iterable[float], border: Border = "reflect") -> Tensor:
    """Pictures (B, C, H, W) displaced by (x, y) px, (2,) or (B, 2); ``light`` itself where that is nothing.

    Differentiable in the light. Raises ``TypeError`` or ``ValueError``.
    """
    image_batch("light", light)
    one_of("border", border, BORDERS)
    shifts = convolution.motions("displacement_px", shift_px, light).detach().tolist()
    if all(abs(along) < _WHOLE_PX for shift in shifts for along in shift):
        return light
    pictures = zip(torch.split(light, 1), shifts, strict=True)
    return torch.cat([_translated(picture, x, y, border) for picture, (x, y) in pictures])


def _translated(picture: Tensor, x: float, y: float, border: Border) -> Tensor:
    size, whole = picture.shape[-2:], (round(y), round(x))
    rest = [along - steps for along, steps in zip((y, x), whole, strict=True)]
    moves = [abs(part) >= _WHOLE_PX for part in rest]
    margins = [_MARGIN_PX if moving else 0 for moving in moves]
    before = [max(0, steps) + margin for steps, margin in zip(whole, margins, strict=True)]
    after = [max(0, -steps) + margin for steps, margin in zip(whole, margins, strict=True)]
    spans = [first + n + last for first, n, last in zip(before, size, after, strict=True)]
    plane = extended(picture, (before[0], before[1]), (spans[0], spans[1]), border)
    for dim, part, moving in zip((-2, -1), rest, moves, strict=True):
        if moving:
            plane = _phased(plane, part, dim)
    top, left = (first - steps for first, steps in zip(before, whole, strict=True))
    return plane[..., top : top + size[0], left : left + size[1]].contiguous()


def _phased(plane: Tensor, shift_px: float, dim: int) -> Tensor:
    """Displaced by less than a pixel along one axis, which wraps round."""
    length = plane.shape[dim]
    phase = -2 * torch.pi * shift_px * torch.fft.rfftfreq(length, dtype=plane.dtype, device=plane.device)
    factors = torch.polar(torch.ones_like(phase), phase)
    shaped = factors[:, None] if dim == -2 else factors
    spectrum = torch.fft.rfft(plane, dim=dim) * shaped
    moved: Tensor = torch.fft.irfft(spectrum, n=length, dim=dim)
    return moved
