"""What the light of photographs is taken for, in words and numbers."""

from __future__ import annotations

from torch import Tensor

from blurnoise.scene.metering import GreyAnchor


def share_above_white(light: Tensor) -> float:
    """Share of the pixels of pictures (B, C, H, W) any of whose colours exceeds the reflectance of white."""
    return float((light.detach().amax(1) > 1).double().mean())


def reflectance_text(anchor: str | None) -> str:
    """What light on a photograph's scene means, in half a line."""
    if anchor is None:
        return "brightness is taken for reflectance, 1 EV darker for half of it; --grey-anchor ties it to 18 % grey"
    of = GreyAnchor.parse(anchor)
    words = "the mean" if of.percentile is None else f"the {of.percentile:g} % percentile"
    if of.region_px is not None:
        words = f"the mean of the region {of}"
    return f"18 % reflectance is {words} of each picture (--grey-anchor {anchor})"
