"""Mixes of training pictures: what each of the augmentations to be compared changes, how, and when in a training.

Domain: batches (B, 3, H, W), sRGB-coded RGB in [0, 1]. Draws come from torch's global generator, as all of Kornia's.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Literal

import torch
from torch import Tensor, nn

from blurnoise._core import checks
from blurnoise.training.augmentation import RandomExposure

Arm = Literal["none", "kornia", "exposure"]
ARMS: tuple[Arm, ...] = ("none", "kornia", "exposure")
MIX = 2
"""The mix that stands here; networks of the first one (the same share all the while, short blurs) name none."""
MOST = 0.45
"""The share of pictures that are changed in the middle of a training."""
_LAST = 0.2  # at its end
_RISEN, _FALLING = 0.3, 0.6  # of a training: from where the share stays, and from where it falls


class InShare(nn.Module):
    """Changes for a ``share`` of the pictures, one for each; ``parts``: how many of these get which."""

    def __init__(self, share: float, parts: Sequence[tuple[float, nn.Module]]) -> None:
        super().__init__()
        self.share = share
        self.parts = [part for part, _ in parts]
        self.changes = nn.ModuleList(change for _, change in parts)

    def forward(self, seen: Tensor) -> Tensor:
        """The pictures, those that the share chooses changed."""
        drawn, out, low = torch.rand(len(seen)), seen.clone(), 0.0
        for part, change in zip(self.parts, self.changes, strict=True):
            high = low + part * self.share
            chosen = (drawn >= low) & (drawn < high)
            if chosen.any():
                out[chosen] = change(seen[chosen])
            low = high
        return out


def augmentation(arm: Arm, share: float = MOST) -> nn.Module:
    """What an arm does to a batch of pictures: nothing; to a share of them Kornia's blur and noise, or ours.

    Both blur by up to 60 px, as likely far as near, in any direction. Of ours, every other picture moves in enough
    light, 700 to 35 000 electrons of white; the rest is dark or saturated, 70 to 70 000 electrons, and moves by up
    to 8 px: what is both dark and far smeared shows no target, and would teach to guess.
    """
    checks.one_of("arm", arm, ARMS)
    if arm == "none":
        return nn.Identity()
    if arm == "kornia":
        return InShare(share, [(1.0, blur_and_noise(0.8))])
    exposure_s = (1e-3, 40e-3)
    dark = RandomExposure("imx250", exposure_s=exposure_s, white_e=(70.0, 70e3), blur_px=(0.0, 8.0), p=1.0)
    moving = RandomExposure(
        "imx250", exposure_s=exposure_s, white_e=(700.0, 35e3), blur_px=(0.0, 60.0), p=1.0
    )
    return InShare(share, [(1 / 2, dark), (1 / 2, moving)])


def blur_and_noise(p: float) -> nn.Module:
    """Kornia's motion blur and Gaussian noise, each in a share ``p`` of the pictures."""
    import kornia.augmentation as kornia

    blur = kornia.RandomMotionBlur((3, 61), (-180.0, 180.0), 0.0, border_type="reflect", p=p)
    return nn.Sequential(blur, kornia.RandomGaussianNoise(std=0.05, p=p), nn.Hardtanh(0.0, 1.0))


def mix(arm: Arm) -> Callable[[Tensor, float], Tensor]:
    """What becomes of a batch in a training under ``arm`` of which a part, 0 to 1, is done; see :func:`share_at`."""
    change = augmentation(arm)

    def changed(seen: Tensor, done: float) -> Tensor:
        if isinstance(change, InShare):
            change.share = share_at(done)
        return change(seen)  # type: ignore[no-any-return]

    return changed


def mix_facts(arm: Arm) -> dict[str, int]:
    """What tells networks of this mix from those of the one before it, under the same name."""
    return {} if arm == "none" else {"mix": MIX}


def share_at(done: float) -> float:
    """The share of pictures that are changed once ``done`` of a training, 0 to 1, is behind, whatever changes them.

    Rising from 0, so that targets are learnt before they are hidden, and falling at the end, where the small learning
    rate settles what clean pictures look like.
    """
    if done < _FALLING:
        return MOST * min(1.0, done / _RISEN)
    return MOST + (_LAST - MOST) * (done - _FALLING) / (1.0 - _FALLING)
