"""Between sRGB-coded pictures and linear light, both in [0, 1]: IEC 61966-2-1, any number of channels."""

from __future__ import annotations

from typing import Literal

import numpy as np
import torch
from torch import Tensor

from blurnoise._core.threads import in_pieces, plain

Encoding = Literal["srgb", "linear"]


def linear_from_srgb(coded: Tensor) -> Tensor:
    """Linear light of sRGB-coded values, any shape; values outside [0, 1] are clamped."""
    # torch's power rounds by a number's place in memory; exponential and logarithm do not, and take half the time.
    if not plain(coded):
        coded = coded.clamp(0.0, 1.0)
        power = torch.exp(2.4 * torch.log((coded + 0.055) / 1.055))
        return torch.where(coded <= 0.04045, coded / 12.92, power)
    flat = coded.detach().reshape(-1).numpy()
    light = np.empty_like(flat)

    def decode(piece: slice) -> None:  # NumPy wakes no threads of its own
        clamped, power = np.clip(flat[piece], 0.0, 1.0), light[piece]
        np.divide(np.add(clamped, 0.055, out=power), 1.055, out=power)
        np.exp(np.multiply(np.log(power, out=power), 2.4, out=power), out=power)
        np.copyto(power, clamped / 12.92, where=clamped <= 0.04045)

    in_pieces(decode, len(flat), torch.get_num_threads())
    return torch.from_numpy(light).view(coded.shape)


def srgb_from_linear(linear: Tensor) -> Tensor:
    """sRGB-coded values of linear light, any shape; values outside [0, 1] are clamped."""
    linear = linear.clamp(0.0, 1.0)
    # The inner clamp keeps the unused branch's gradient finite at 0.
    return torch.where(
        linear <= 0.0031308, 12.92 * linear, 1.055 * linear.clamp_min(1e-4) ** (1 / 2.4) - 0.055
    )
