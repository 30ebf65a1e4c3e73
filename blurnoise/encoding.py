"""Between sRGB-coded pictures and linear light, both in [0, 1]: IEC 61966-2-1, any number of channels."""

from __future__ import annotations

from typing import Literal

import torch
from torch import Tensor

from blurnoise.threads import in_pieces

Encoding = Literal["srgb", "linear"]


def linear_from_srgb(coded: Tensor) -> Tensor:
    """Linear light of sRGB-coded values, any shape; values outside [0, 1] are clamped."""
    if coded.device.type != "cpu" or (coded.requires_grad and torch.is_grad_enabled()):
        return _linear(coded)
    flat = coded.reshape(-1)
    out = torch.empty_like(flat)

    def decode(piece: slice) -> None:
        out[piece] = _linear(flat[piece])

    with torch.no_grad():
        in_pieces(decode, len(flat), torch.get_num_threads())
    return out.view(coded.shape)


def _linear(coded: Tensor) -> Tensor:
    coded = coded.clamp(0.0, 1.0)
    # torch's power rounds by a number's place in memory, its exp and log do not, and take half the time.
    power = torch.exp(2.4 * torch.log((coded + 0.055) / 1.055))
    return torch.where(coded <= 0.04045, coded / 12.92, power)


def srgb_from_linear(linear: Tensor) -> Tensor:
    """sRGB-coded values of linear light, any shape; values outside [0, 1] are clamped."""
    linear = linear.clamp(0.0, 1.0)
    # The inner clamp keeps the unused branch's gradient finite at 0.
    return torch.where(
        linear <= 0.0031308, 12.92 * linear, 1.055 * linear.clamp_min(1e-4) ** (1 / 2.4) - 0.055
    )
