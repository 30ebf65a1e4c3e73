"""The two chains: how the paper's tool makes a picture for a network, and how a camera makes one.

"paper": grey = 0.2989 R + 0.5870 G + 0.1140 B of sRGB-coded values, which are taken for light; one plane of noise;
8 bits linear in light. "camera": linear light of three colours, 8 bits sRGB-coded.

The paper's needs no switch of the simulator: its light enters as a 16-bit picture coded so that it decodes to the
coded grey (to 1e-5 of white), and its camera has one plane and a straight tone curve.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any, Literal

import numpy as np
import torch
from numpy.typing import NDArray

from blurnoise import charts
from blurnoise.optics.camera import Camera
from blurnoise.optics.colour import srgb_from_linear
from blurnoise_eval.datasets import RENDERED_SIZE_PX, Image, Picture, PictureSet, Target

Chain = Literal["paper", "camera"]
CHAINS: tuple[Chain, ...] = ("paper", "camera")
LUMA = (0.2989, 0.5870, 0.1140)
_STRAIGHT = ((0.0, 0.0), (1.0, 1.0))


def camera_of(chain: Chain, name: str = "lin2024") -> Camera:
    """The preset as the chain has it."""
    camera = Camera.preset(name)
    return replace(camera, cfa="mono", tone=_STRAIGHT) if chain == "paper" else camera


def signs(chain: Chain, sizes_px: tuple[int, ...], *, read: bool) -> PictureSet:
    """A stop sign of each size in the middle of 320 px of 18 % grey, to be found or to be read; group "SIZE px"."""
    frame: Any = {"height_px": RENDERED_SIZE_PX, "width_px": RENDERED_SIZE_PX}
    pictures = []
    for place, size in enumerate(sizes_px, 1):
        group = f"{size} px"
        if read:
            target = Target("text", group, charts.stop_sign_text_box(size, **frame), text="STOP")
        else:
            target = Target("stop sign", group, charts.stop_sign_box(size, **frame))
        name = f"stop-sign-{size}px-{chain}"
        pictures.append(Picture(name, (target,), partial(picture, chain, size), name, place))
    return PictureSet("rendered", f"stop signs on 18 % grey, {chain} chain", tuple(pictures))


def picture(chain: Chain, size_px: int) -> Image:
    """The sign as the chain's scene, (320, 320, 3), sRGB-coded: 16 bits of grey, or 8 of colour."""
    side = RENDERED_SIZE_PX
    coded = srgb_from_linear(charts.stop_sign(size_px, height_px=side, width_px=side)[0])
    if chain == "camera":
        return _codes(coded, np.uint8)
    grey = torch.einsum("c,chw->hw", torch.tensor(LUMA), coded)
    return _codes(srgb_from_linear(grey).expand(3, -1, -1), np.uint16)


def _codes(coded: torch.Tensor, kind: type[np.uint8 | np.uint16]) -> Image:
    codes: NDArray[np.float64] = coded.double().mul(np.iinfo(kind).max).round().permute(1, 2, 0).numpy()
    return np.ascontiguousarray(codes.astype(kind))
