"""What a training changes in its pictures: RandomExposure for a share of them that rises and falls.

Domain: batches (B, 3, H, W), sRGB-coded RGB in [0, 1]. Draws come from torch's global generator, as all of Kornia's.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor, nn

from blurnoise.training.augmentation import RandomExposure

MIX = 3
"""Version of :func:`exposures`, which a network's file states."""
MOST = 0.45
"""The share of pictures that are changed in the middle of a training."""
_LAST = 0.2  # at its end
_RISEN, _FALLING = 0.3, 0.6  # of a training: from where the share stays, and from where it falls


class InShare(nn.Module):
    """Changes a share of the pictures, each by one of ``changes``, all equally likely.

    The share rises from 0, so that targets are learnt before they are hidden, and falls at the end, where the small
    learning rate settles what clean pictures look like.

    >>> negative = InShare([nn.Threshold(1.0, 1.0)])  # turns a picture white
    >>> pictures = torch.zeros(100, 3, 8, 8)
    >>> int(negative(pictures, progress=0.001).amax((1, 2, 3)).sum()) < 10  # few of them at the beginning
    True
    """

    def __init__(self, changes: Sequence[nn.Module]) -> None:
        super().__init__()
        self.changes = nn.ModuleList(changes)

    def forward(self, pictures: Tensor, progress: float) -> Tensor:
        """The pictures, some changed, when ``progress``, 0 to 1, of the training is done."""
        drawn, changed = torch.rand(len(pictures)) / share_at(progress), pictures.clone()
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


def exposures() -> InShare:
    """The augmentation of the built-in detector.

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
        ]
    )
