"""Blurs and warps that tests need alone: by a lens, by each pixel's displacement, of rows read one after another."""

import torch

from blurnoise._core.threads import differentiable
from blurnoise.blur.convolution import exposure_blur
from blurnoise.blur.displacement import STILL_PX, stretch
from blurnoise.blur.rows import _lanczos_taps, mixed, shifted_rows
from blurnoise.blur.sub_exposures import exposed, flowing


def flow_blur(image, displacement_px, *, border="reflect"):
    """Pictures (B, C, H, W) of which each pixel averages from d/2 before it to d/2 behind, d (2, H, W) or
    (B, 2, H, W), px."""
    sheets = flowing(image, displacement_px, border)
    if all(sheet.moves.still for sheet in sheets):
        return image
    return torch.stack([exposed(sheet) for sheet in sheets])


def optical_blur(image, optics, *, border="reflect"):
    """Blur by the lens."""
    return exposure_blur(image, (0.0, 0.0), optics, border=border)


def warped(light, velocity_px_s, row_s, border):
    """Pictures of which row i shows what was at (x - v_x tau_i, i - v_y tau_i); differentiable, in the velocity too.

    Light is not kept: what moves along with the readout is read longer. Raises as
    :func:`blurnoise.blur.displacement.stretch` does.
    """
    velocity = torch.as_tensor(velocity_px_s, dtype=light.dtype, device=light.device)
    stretch(float(velocity[1].detach()), row_s)
    height = light.shape[-2]
    tau = (torch.arange(height, dtype=torch.float64, device=light.device) - (height - 1) / 2) * row_s
    x, y = (velocity.detach().abs() * float(tau.abs().max())).tolist()
    if differentiable(velocity) or y > STILL_PX:
        light = mixed(light, *_lanczos_taps(-velocity[1] * tau), border)
    if differentiable(velocity) or x > STILL_PX:
        light = shifted_rows(light, velocity[0] * tau, border)  # of rows as they are read, hence afterwards
    return light
