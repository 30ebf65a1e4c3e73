"""The picture steps that only a mosaic needs: white balance, demosaicing, colour matrix.

Domain: linear light, 1 is full scale; one plane (B, 1, H, W) up to the demosaicing, three colours after it.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import torch
from torch import Tensor

from blurnoise import colour
from blurnoise.camera import Camera
from blurnoise.colour import Matrix
from blurnoise.picture.demosaic import demosaic
from blurnoise.picture.step import Development, PictureStep
from blurnoise.radiometry import clear_shares, filter_electrons
from blurnoise.spectra import Curve

GAIN_MAX = 16.0
"""Of the automatic white balance: where the light lacks a colour by more, a tint stays."""


class WhiteBalance(PictureStep):
    """A gain per filter, the least of them 1, and one level of clipping for all, so that highlights stay white."""

    name = "white balance"
    pointwise = False

    def active(self, camera: Camera) -> bool:
        """Behind filters."""
        return camera.cfa not in colour.PLANES

    def apply(self, picture: Tensor, at: Development) -> Tensor:
        """Times the gain of the pixel's filter, then clipped where the first of all filters saturates."""
        height, width = picture.shape[-2:]
        tile = picture.new_tensor(site_gains(at.camera, at.illuminant)).view(2, 2)
        gains = tile.repeat((height + 1) // 2, (width + 1) // 2)[:height, :width]
        return (picture * gains).clamp(max=highest(at.camera))


class Demosaic(PictureStep):
    """Three colours a pixel of one."""

    name = "demosaic"
    pointwise = False

    def active(self, camera: Camera) -> bool:
        """Behind filters."""
        return camera.cfa not in colour.PLANES

    def apply(self, picture: Tensor, at: Development) -> Tensor:
        """By ``Camera.demosaic``."""
        return demosaic(picture, at.camera.cfa, at.camera.demosaic)


class ColourMatrix(PictureStep):
    """Camera colours to linear sRGB; of RCCB green first, by difference."""

    name = "colour matrix"
    pointwise = False

    def active(self, camera: Camera) -> bool:
        """Where there is one, or clear pixels stand for green."""
        return camera.ccm is not None or camera.cfa == "RCCB"

    def apply(self, picture: Tensor, at: Development) -> Tensor:
        """The product."""
        rows = picture.new_tensor(matrix(at.camera, at.illuminant))
        return torch.einsum("ij,bjhw->bihw", rows, picture)


@lru_cache(maxsize=64)
def site_gains(camera: Camera, illuminant: str | Curve = "D55") -> tuple[float, ...]:
    """White-balance gains of the pattern's four places."""
    letters = dict.fromkeys(camera.cfa)
    if isinstance(camera.white_balance, str):
        electrons = filter_electrons(camera, illuminant)
        most = max(electrons.values())
        gains = {each: min(most / max(electrons[each], 1e-30), GAIN_MAX) for each in letters}
    else:
        red, middle, blue = camera.white_balance
        stated = {"R": red, "G": middle, "C": middle, "B": blue}
        least = min(stated[each] for each in letters)
        gains = {each: stated[each] / least for each in letters}
    return tuple(gains[letter] for letter in camera.cfa)


def highest(camera: Camera) -> float:
    """The level of linear light from which on a pixel counts as saturated."""
    return (camera.saturated_dn - camera.black_level_dn) / (camera.full_scale_dn - camera.black_level_dn)


@lru_cache(maxsize=64)
def matrix(camera: Camera, illuminant: str | Curve = "D55") -> Matrix:
    """From the demosaiced colours to linear sRGB; rows sum to 1."""
    corrected = colour.normalised(camera.ccm)
    if camera.cfa != "RCCB":
        return corrected
    red, green, blue = clear_shares(camera, illuminant)
    by_difference = ((1.0, 0.0, 0.0), (-red / green, 1 / green, -blue / green), (0.0, 0.0, 1.0))
    return colour.product(corrected, by_difference)


@lru_cache(maxsize=64)
def magnification(camera: Camera, illuminant: str | Curve = "D55") -> float:
    """By how much development to linear light magnifies noise of the plane, RMS, at most; 1 without a mosaic."""
    if camera.cfa in colour.PLANES:
        return 1.0
    gains = dict(zip(camera.cfa, site_gains(camera, illuminant), strict=True))
    if camera.cfa == "RCCC":
        return gains["C"]
    each = [gains["R"], gains.get("G", gains.get("C", 1.0)), gains["B"]]
    return max(1.0, float(np.sqrt(((np.array(matrix(camera, illuminant)) * each) ** 2).sum(1)).max()))
