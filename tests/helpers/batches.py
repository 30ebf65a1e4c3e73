"""Batches of pictures for the augmentations' tests."""

import torch


def pictures(batch=4, channels=3, height=21, width=34):
    """The same noise every time, (B, C, H, W) in [0, 1]."""
    generator = torch.Generator().manual_seed(5)
    return torch.rand(batch, channels, height, width, generator=generator)


def one_of(params, index):
    """The parameters of one picture of a batch, which is exposed."""
    shape = params["forward_input_shape"]
    one = {name: value[index : index + 1] for name, value in params.items() if value is not shape}
    return {**one, "batch_prob": torch.ones(1), "forward_input_shape": shape}
