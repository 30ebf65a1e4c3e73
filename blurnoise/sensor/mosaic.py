"""Mosaics: a colour picture's light as the pixels behind a colour filter array receive it, one plane.

Domain: linear light, 1 is white; of the plane 1 is white behind the strongest filter, whose electrons
``radiometry.electrons_per_lux_s`` gives. Linear sRGB becomes camera colours by the inverse of the colour matrix;
negative ones, outside the camera's gamut, are no light. Behind a clear filter all colours add up.
"""

from __future__ import annotations

from functools import lru_cache, reduce
from operator import add
from typing import Any

import numpy as np
import torch
from torch import Tensor

from blurnoise._core.threads import plain
from blurnoise.optics import colour
from blurnoise.optics.camera import Camera
from blurnoise.optics.colour import Row
from blurnoise.optics.radiometry import clear_shares, colour_shares, filter_electrons
from blurnoise.optics.spectra import Curve


def planes(camera: Camera, colours: int) -> int:
    """Number of planes read out of pictures with so many colours. Raises ``ValueError`` naming the image."""
    if camera.cfa == "none":
        return colours
    if colours not in (1, 3):
        raise ValueError(f"image: has {colours} channels; cfa = {camera.cfa!r} needs 1 (grey) or 3 (RGB)")
    return 1


def on_sensor(light: Tensor, camera: Camera, illuminant: str | Curve = "D55") -> Tensor:
    """Light (B, C, H, W) on the camera's pixels: (B, 1, H, W) of a mosaic or one plane, else ``light`` itself.

    Differentiable. Raises ``ValueError`` for other than 1 or 3 colours where there is one plane.
    """
    if camera.cfa == "none":
        return light
    planes(camera, light.shape[1])
    quick = plain(light)  # NumPy wakes no threads
    seen: Any = light.detach().numpy() if quick else light
    out = torch.empty_like(light[:, :1], requires_grad=False, memory_format=torch.contiguous_format)
    to: Any = out.numpy() if quick else out
    if camera.cfa == "mono":
        to[:, 0] = _weighted(seen, weights(camera, illuminant)[0])
        return out
    for site, of_site in enumerate(weights(camera, illuminant)):
        y, x = divmod(site, 2)
        to[:, 0, y::2, x::2] = _weighted(seen[..., y::2, x::2], of_site).clip(min=0.0)
    return out


@lru_cache(maxsize=64)
def weights(camera: Camera, illuminant: str | Curve = "D55") -> tuple[Row, ...]:
    """Weights of red, green and blue of linear sRGB in a plane: for each of the four sites, or for all pixels."""
    if camera.cfa == "mono":
        return (colour_shares(camera, illuminant),)
    electrons = filter_electrons(camera, illuminant)
    most = max(electrons.values()) or 1.0
    red, green, blue = (np.array(row) for row in colour.inverse(camera.ccm))
    rows = {"R": red, "G": green, "B": blue}
    if camera.cfa == "RCCB":
        rows["C"] = np.array(clear_shares(camera, illuminant)) @ np.array([red, green, blue])
    elif "C" in camera.cfa:
        rows["C"] = np.array(colour_shares(camera, illuminant))
    return tuple(colour.as_rows(rows[letter] * electrons[letter] / most for letter in camera.cfa))


def peak(camera: Camera, illuminant: str | Curve = "D55") -> float:
    """The largest value that pictures within [0, 1] can have on the plane, 1 without a mosaic."""
    if camera.cfa in colour.PLANES:
        return 1.0
    return max(1.0, *(sum(max(0.0, weight) for weight in row) for row in weights(camera, illuminant)))


def outside_share(light: Tensor, camera: Camera) -> float:
    """Share of the pixels of pictures (B, 3, H, W) with a negative camera colour; 0 without a colour matrix."""
    if camera.ccm is None or light.shape[1] != 3:
        return 0.0
    rows = light.new_tensor(colour.inverse(camera.ccm))
    seen = torch.einsum("ij,bjhw->bihw", rows, light.detach())
    return float((seen.amin(1) < -1e-6).double().mean())


def _weighted(light: Any, row: Row) -> Any:
    """The weighted sum of the channels of (B, C, H, W), an array or a tensor."""
    if light.shape[1] == 1:
        return light[:, 0] * sum(row)
    return reduce(add, [light[:, place] * weight for place, weight in enumerate(row) if weight])
