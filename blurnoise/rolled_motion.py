"""Uniform motion before a rolling shutter: pictures (B, C, H, W) of linear light blurred and read row by row at once.

Convention: as :mod:`blurnoise.rolling_shutter`. Motion along rows is one transform of rows. Motion down them is a
mean of rows, which Lanczos's window resamples and averages at once. Other motion is blurred by its transfer function,
resampled while rows are still spectra, and displaced as they are brought back. The picture is continued before all
that, so that what rows bring in from beyond the border is what was blurred there.
"""

from __future__ import annotations

import math
from itertools import count

import numpy as np
import torch
from torch import Tensor

from blurnoise import blur, fourier
from blurnoise._core.borders import Border, extended
from blurnoise.moved_rows import (
    CLOSING_PX,
    MARGIN_PX,
    closing,
    resampled,
    row_phases,
    rows_mixed,
    shifted_rows,
    swept_taps,
)
from blurnoise.rolling_shutter import stretch, warped
from blurnoise.transfer import SHARP

_STILL_PX = 1e-3  # motion across that is not worth its transform
_BEYOND_PX = 16  # rows of a continued picture: of the blur's ends, and of the taps
_LONGEST_TAPS_PX = 256  # beyond that a transform is faster


def along_rows(velocity_px_s: tuple[float, float], lasting_s: float) -> bool:
    """Whether motion is along rows alone, for as long as it matters, so that :func:`blurred_rows` serves."""
    return velocity_px_s[0] != 0 and abs(velocity_px_s[1]) * lasting_s <= _STILL_PX


def blurred_rows(
    light: Tensor, displacement_px: Tensor, exposure_s: Tensor, row_s: float, border: Border
) -> Tensor:
    """Pictures in motion along rows, (2,) px in an exposure (), blurred and displaced."""
    velocity = displacement_px / exposure_s
    if not _plain(light, displacement_px, exposure_s):
        blurred = blur.motion_blur(light, displacement_px[None].expand(len(light), 2), border=border)
        return warped(blurred, velocity, row_s, border)
    tau = (torch.arange(light.shape[-2], dtype=torch.float64) - (light.shape[-2] - 1) / 2) * row_s
    return shifted_rows(light, velocity[0] * tau, border, float(displacement_px[0]))


def blurred_and_warped(
    light: Tensor, displacement_px: Tensor, exposure_s: Tensor, row_s: float, border: Border
) -> Tensor:
    """Pictures in uniform motion, (2,) px in an exposure (), blurred and warped; differentiable.

    Raises as :func:`blurnoise.rolling_shutter.stretch` does, and where the continued picture would be too large.
    """
    height, width = light.shape[-2:]
    velocity = displacement_px / exposure_s
    stretch(float(velocity[1].detach()), row_s)
    tau = (torch.arange(height, dtype=torch.float64, device=light.device) - (height - 1) / 2) * row_s
    skew_px = (velocity.detach() * row_s).abs() * (height - 1) / 2
    across, down = (skew_px + displacement_px.detach().abs() / 2).tolist()
    plain = _plain(light, displacement_px, exposure_s)
    if plain and across <= _STILL_PX and float(displacement_px[1].abs()) <= _LONGEST_TAPS_PX:
        taps = swept_taps((-velocity[1] * tau).numpy(), float(displacement_px[1].abs()))
        return rows_mixed(light, *taps, border)
    before = math.ceil(down) + _BEYOND_PX, math.ceil(across) + MARGIN_PX
    high, wide = (_length(side + 2 * each) for side, each in zip((height, width), before, strict=True))
    if high * wide > fourier.LARGEST_PLANE:
        raise ValueError(
            f"displacement_px = {displacement_px.tolist()}: rows that are read one after another need a plane of "
            f"{high}x{wide} pixels; at most {fourier.LARGEST_PLANE} are allowed"
        )
    plane = extended(light, before, (high, wide), border)
    if plain:
        plane[..., -CLOSING_PX:] = closing(plane)
    else:
        plane = torch.cat([plane[..., :-CLOSING_PX], closing(plane)], -1)
    response = fourier.response(displacement_px[None].to(light), SHARP, (high, wide))
    spectra = torch.fft.rfft2(plane)
    spectra = spectra.mul_(response) if plain else spectra * response
    spectra = torch.fft.ifft(spectra, dim=-2).contiguous()  # of rows
    places, shift_px = before[0] - velocity[1] * tau, velocity[0] * tau
    seen = resampled(torch.view_as_real(spectra).flatten(-2), places, "replicate")
    rows = torch.view_as_complex(seen.reshape(*seen.shape[:-1], -1, 2))
    if plain:
        kind = np.complex64 if light.dtype == torch.float32 else np.complex128
        rows = rows.mul_(torch.from_numpy(row_phases(shift_px.numpy(), wide, kind)))
    else:
        turn = -2 * math.pi * torch.outer(shift_px, torch.fft.rfftfreq(wide).to(shift_px))
        rows = rows * torch.polar(torch.ones_like(turn), turn).to(rows.dtype)
    out: Tensor = torch.fft.irfft(rows, n=wide)
    return out[..., before[1] : before[1] + width].contiguous()


def _plain(light: Tensor, *asked: Tensor) -> bool:
    """Whether light is on the CPU and nobody asks for gradients."""
    follows = torch.is_grad_enabled() and any(each.requires_grad for each in (light, *asked))
    return light.device.type == "cpu" and not follows


def _length(least: int) -> int:
    """The next even length without a prime above 7."""
    return next(n for n in count(least + least % 2, 2) if 210**30 % n == 0)
