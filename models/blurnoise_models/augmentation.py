"""What a training changes in its pictures: headlamps and RandomExposure for a share of them that rises and falls.

Domain: batches (B, 3, H, W), sRGB-coded RGB in [0, 1]; what in them returns the light of headlamps, (B, 1, H, W), as
shares of pixels. Draws come from torch's global generator, as all of Kornia's.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor, nn

from blurnoise.camera.colour import linear_from_srgb, srgb_from_linear
from blurnoise.training.augmentation import RandomExposure

MIX = 4
"""Version of :func:`exposures`, which a network's file states."""
MOST = 0.45
"""The share of pictures that are changed in the middle of a training."""
_LAST = 0.2  # at its end
LIT = 0.4
"""The share of changed pictures that are taken in the light of headlamps."""
MOST_TIMES = 1000.0
"""How many times brighter headlamps make a sign, at most: high beam at 50 m on a road with a few lux, low beam on an
unlit one. Beyond it the rest of the picture is black in any case."""
_RISEN, _FALLING = 0.3, 0.6  # of a training: from where the share stays, and from where it falls


class InShare(nn.Module):
    """Changes a share of the pictures, each by one of ``changes``, all equally likely.

    The share rises from 0, so that targets are learnt before they are hidden, and falls at the end, where the small
    learning rate settles what clean pictures look like. lit: the share of changed pictures that headlamps light, see
    :func:`in_headlamps`.

    >>> negative = InShare([nn.Threshold(1.0, 1.0)])  # turns a picture white
    >>> pictures = torch.zeros(100, 3, 8, 8)
    >>> int(negative(pictures, pictures, progress=0.001).amax((1, 2, 3)).sum()) < 10  # few of them at the beginning
    True
    """

    def __init__(self, changes: Sequence[nn.Module], lit: float = 0.0) -> None:
        super().__init__()
        self.changes = nn.ModuleList(changes)
        self.lit = lit

    def forward(self, pictures: Tensor, returns: Tensor, progress: float) -> Tensor:
        """The pictures, some changed, when ``progress``, 0 to 1, of the training is done.

        returns: what in them returns the light of headlamps, (B, 1, H, W).
        """
        drawn, changed = torch.rand(len(pictures)) / share_at(progress), pictures.clone()
        if self.lit:
            # log-uniform: each doubling of the light is as likely as the next
            times = MOST_TIMES ** torch.rand(len(pictures)) * (torch.rand(len(pictures)) < self.lit)
            pictures = in_headlamps(pictures, returns, times.clamp_min(1.0))
        for number, change in enumerate(self.changes):
            chosen = (drawn * len(self.changes)).floor() == number
            if chosen.any():
                changed[chosen] = change(pictures[chosen])
        return changed


def share_at(progress: float) -> float:
    """The share of pictures that are changed when ``progress``, 0 to 1, of a training is done.

    >>> [round(share_at(progress), 3) for progress in (0.0, 0.15, 0.3, 0.8, 1.0)]
    [0.0, 0.225, 0.45, 0.325, 0.2]
    """
    if progress < _FALLING:
        return MOST * min(1.0, progress / _RISEN)
    return MOST + (_LAST - MOST) * (progress - _FALLING) / (1.0 - _FALLING)


def in_headlamps(pictures: Tensor, returns: Tensor, times: Tensor) -> Tensor:
    """Pictures in which what retroreflects is ``times`` (B,), >= 1, as bright beside the rest as before.

    The rest becomes darker, so that values stay within [0, 1]: white is that of a sign.

    >>> white = torch.ones(1, 3, 1, 2)
    >>> in_headlamps(white, torch.tensor([[[[1.0, 0.0]]]]), torch.tensor([10.0]))[0, 0].round(decimals=2)
    tensor([[1.0000, 0.3500]])
    """
    dimmed = 1 / times.view(-1, 1, 1, 1)
    return srgb_from_linear(linear_from_srgb(pictures) * (dimmed + (1 - dimmed) * returns))


def exposures(lit: float = LIT) -> InShare:
    """The augmentation of the built-in detector. lit: the share of changed pictures that headlamps light.

    Pictures of a camera with a sensor for each colour or with a colour filter array, at 0 dB or with automatic gain.
    Half of them move by up to 60 px in enough light (700 to 35 000 electrons of white); the others are dark or
    saturated (70 to 70 000 electrons) and move by up to 8 px: in pictures both dark and blurred far, no sign is left
    to learn from.

    >>> len(exposures().changes)  # two ranges of light and blur, each with two gains
    4
    """
    ranges: list[dict[str, Any]] = [
        {"white_e": (70.0, 70e3), "blur_px": (0.0, 8.0)},
        {"white_e": (700.0, 35e3), "blur_px": (0.0, 60.0)},
    ]
    gains: list[Any] = [0.0, "auto"]
    cameras = ("imx250", "imx250c")
    return InShare(
        [
            RandomExposure(cameras, exposure_s=(1e-3, 40e-3), gain_db=gain, p=1.0, **each)
            for each in ranges
            for gain in gains
        ],
        lit,
    )
