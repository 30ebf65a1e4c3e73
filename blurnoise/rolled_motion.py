"""Uniform motion before a rolling shutter: pictures (B, C, H, W) of linear light blurred and read row by row at once.

Convention: as :mod:`blurnoise.rolling_shutter`. Motion along rows is one transform of rows. Motion down them is a
mean of rows, which Lanczos's window resamples and averages at once. Other motion is blurred and then warped, all on
one plane: the picture is continued before, so that what rows bring in from beyond the border was blurred there.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
import torch
from torch import Tensor

from blurnoise import blur, fourier
from blurnoise._core.borders import Border, continued, extended
from blurnoise._core.scratch import borrowed
from blurnoise._core.threads import WORTH_IT, side_by_side
from blurnoise.moved_rows import (
    CLOSING_PX,
    MARGIN_PX,
    bands_of,
    closing,
    lanczos_taps,
    mixed,
    resampled,
    row_phases,
    rows_mixed,
    shifted_rows,
    swept_taps,
)
from blurnoise.rolling_shutter import stretch, warped

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
    from scipy.fft import next_fast_len

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
    high = next_fast_len(height + 2 * before[0])
    wide = fourier.fast_length(width + 2 * before[1])
    if high * wide > fourier.LARGEST_PLANE:
        raise ValueError(
            f"displacement_px = {displacement_px.tolist()}: rows that are read one after another need a plane of "
            f"{high}x{wide} pixels; at most {fourier.LARGEST_PLANE} are allowed"
        )
    places, shift_px = before[0] - velocity[1] * tau, velocity[0] * tau
    if plain:
        return _at_once(light, displacement_px, places, shift_px, before, (high, wide), border)
    plane = extended(light, before, (high, wide), border)
    plane = torch.cat([plane[..., :-CLOSING_PX], closing(plane)], -1)
    moved = displacement_px[None].expand(len(light), 2)
    plane = blur.motion_blur(plane, moved, method="transfer", border="circular")
    plane = shifted_rows(resampled(plane, places, "replicate"), shift_px, "circular", wraps=True)
    return plane[..., before[1] : before[1] + width].contiguous()


def _at_once(
    light: Tensor,
    displacement_px: Tensor,
    places: Tensor,
    shift_px: Tensor,
    before: tuple[int, int],
    spans: tuple[int, int],
    border: Border,
) -> Tensor:
    """The same between two transforms of rows: blurred there, and resampled and displaced while they are spectra.

    OpenCV packs the spectrum of a row as real 0, real 1, imaginary 1, ...: with a value before and one behind these
    are complex numbers, once the imaginary parts of the first and the last are 0.
    """
    from scipy.fft import fft, ifft

    (height, width), (high, wide) = light.shape[-2:], spans
    out = torch.empty_like(light, memory_format=torch.contiguous_format)
    sources, targets = light.detach().flatten(0, 1).numpy(), out.flatten(0, 1).numpy()
    kind, size = sources.dtype, (high, wide // 2 + 1)
    x, y = displacement_px.tolist()
    response = fourier.motion_response((x, y), spans, np.empty(size, kind), np.empty(size, kind))
    wave = np.complex64 if kind == np.float32 else np.complex128
    phases = row_phases(shift_px.numpy(), wide, wave) / wave(wide)
    first, weights = lanczos_taps(places)
    bands = bands_of(first.numpy(), weights.numpy(), high, "replicate", kind)

    def see(place: int) -> None:
        with borrowed([(high, wide), (high, wide + 2), (height, wide + 2)], kind) as (plane, waves, seen):
            continued(sources[place], plane, before, border)
            plane[:, -CLOSING_PX:] = closing(plane)
            cv2.dft(plane, waves[:, 1:-1], cv2.DFT_ROWS)
            waves[:, 0] = waves[:, 1]
            waves[:, [1, -1]] = 0
            spectra = fft(waves.view(wave), axis=0, overwrite_x=True)
            spectra *= response
            spectra = ifft(spectra, axis=0, overwrite_x=True)
            mixed(spectra.view(kind), bands, seen)
            rows = seen.view(wave)
            np.multiply(rows, phases, out=rows)
            seen[:, 1] = seen[:, 0]
            cv2.dft(seen[:, 1:-1], plane[:height], cv2.DFT_ROWS | cv2.DFT_INVERSE)
            targets[place] = plane[:height, before[1] : before[1] + width]

    threads = torch.get_num_threads() if light.numel() >= WORTH_IT else 1
    side_by_side(see, range(len(targets)), threads)
    return out


def _plain(light: Tensor, *asked: Tensor) -> bool:
    """Whether light is on the CPU and nobody asks for gradients."""
    follows = torch.is_grad_enabled() and any(each.requires_grad for each in (light, *asked))
    return light.device.type == "cpu" and not follows
