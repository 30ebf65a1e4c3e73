"""Batches of pictures for the augmentations' tests."""

from __future__ import annotations

import torch
from torch import Tensor


def pictures(batch: int = 4, channels: int = 3, height: int = 21, width: int = 34) -> Tensor:
    """The same noise every time, (B, C, H, W) in [0, 1]."""
    generator = torch.Generator().manual_seed(5)
    return torch.rand(batch, channels, height, width, generator=generator)


def one_of(params: dict[str, Tensor], index: int) -> dict[str, Tensor]:
    """The parameters of one picture of a batch, which is exposed."""
    shape = params["forward_input_shape"]
    one = {name: value[index : index + 1] for name, value in params.items() if value is not shape}
    return {**one, "batch_prob": torch.ones(1), "forward_input_shape": shape}
