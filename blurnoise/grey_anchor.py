"""Grey anchor: what of a picture is taken for 18 % reflectance, so that its own exposure does not count as light.

Domain: linear light (B, C, H, W), by its luminance (ITU-R BT.709 for three colours, else the channels' mean). A
photograph's brightness is not reflectance: the same scene photographed 1 EV darker has half of it everywhere. An
anchor scales each picture so that its mean, a percentile, or the mean of a region is 0.18, the grey card's.
What then exceeds 1, the reflectance of white, stays: sky, lamps and gloss do send more light than what scatters it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from blurnoise._core.checks import shown

GREY = 0.18
_LUMINANCE = (0.2126, 0.7152, 0.0722)
_ALLOWED = "must be mean, pNN (a percentile above 0, up to 100) or x0,y0,x1,y1 (px, x1 and y1 not included)"


@dataclass(frozen=True)
class GreyAnchor:
    """A percentile of the luminance, or the mean of a region (x0, y0, x1, y1), px; neither: the mean of all."""

    percentile: float | None = None
    region_px: tuple[int, int, int, int] | None = None

    @classmethod
    def parse(cls, text: str) -> GreyAnchor:
        """Of "mean", "pNN" or "x0,y0,x1,y1". Raises ``ValueError``."""
        word = text.strip().lower() if isinstance(text, str) else ""
        try:
            if word == "mean":
                return cls()
            if word.startswith("p"):
                percentile = float(word[1:])
                if 0 < percentile <= 100:
                    return cls(percentile=percentile)
            else:
                x0, y0, x1, y1 = (int(part) for part in word.split(","))
                if 0 <= x0 < x1 and 0 <= y0 < y1:
                    return cls(region_px=(x0, y0, x1, y1))
        except ValueError:
            pass
        raise ValueError(f"grey_anchor = {shown(text)}: {_ALLOWED}")

    def __str__(self) -> str:
        """As it is parsed."""
        if self.region_px is not None:
            return ",".join(map(str, self.region_px))
        return "mean" if self.percentile is None else f"p{self.percentile:g}"

    @property
    def words(self) -> str:
        """In running text."""
        if self.region_px is not None:
            return f"the mean of the region {self}"
        return "the mean" if self.percentile is None else f"the {self.percentile:g} % percentile"

    def anchored(self, light: Tensor) -> Tensor:
        """Pictures (B, C, H, W) scaled so that the anchor is 0.18, each by itself.

        Raises ``ValueError`` for a region outside the picture, and where the anchor is black.
        """
        return torch.stack([picture * self._scale(picture) for picture in light])

    def _scale(self, picture: Tensor) -> float:
        channels, height, width = picture.shape
        weights = _LUMINANCE if channels == 3 else (1 / channels,) * channels
        seen = picture.detach().cpu().numpy()
        if self.region_px is not None:
            x0, y0, x1, y1 = self.region_px
            if x1 > width or y1 > height:
                raise ValueError(f"grey_anchor = {self}: lies outside the picture of {width} x {height} px")
            seen = seen[:, y0:y1, x0:x1]
        luminance = np.tensordot(np.array(weights), seen.astype(float), 1)
        grey = float(
            luminance.mean() if self.percentile is None else np.percentile(luminance, self.percentile)
        )
        if grey <= 0 or not math.isfinite(GREY / grey):
            raise ValueError(f"grey_anchor = {self}: is black here; must have some light to be 18 % grey")
        return GREY / grey


def share_above_white(light: Tensor) -> float:
    """Share of the pixels of pictures (B, C, H, W) any of whose colours exceeds the reflectance of white."""
    return float((light.detach().amax(1) > 1).double().mean())


def reflectance_text(anchor: str | None) -> str:
    """What light on a photograph's scene means, in half a line."""
    if anchor is None:
        return "brightness is taken for reflectance, 1 EV darker for half of it; --grey-anchor ties it to 18 % grey"
    return f"18 % reflectance is {GreyAnchor.parse(anchor).words} of each picture (--grey-anchor {anchor})"
