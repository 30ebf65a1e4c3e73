"""LinearPicture pictures: decoded by the sRGB curve, used as they are, or corrected by a curve from a grey scale.

Domain: pictures as files have them, (H, W) or (H, W, 3), 8 or 16 bit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from blurnoise._core import checks
from blurnoise._core.luminance import LUMINANCE
from blurnoise.camera.colour import linear_from_srgb
from blurnoise.metrics import SlantedEdge, slanted_edge
from blurnoise.metrics.edge.measurement import Mode
from blurnoise.metrics.values import CLIPPED_SHARE, Roi
from blurnoise_eval.calibration.tone import Oecf
from blurnoise_eval.datasets import Image

Coding = Literal["auto", "srgb", "linear"]
_UNDETECTED = (
    "a tone curve that is symmetric about the middle of an edge cannot be detected; --oecf FILE removes it"
)
_FEWEST_LEVELS = 255  # of a converter, for its full scale to be recognised


@dataclass(frozen=True)
class LinearPicture:
    """A linear picture (C, H, W) float64, with full scale and black level (the value without light) in ``unit``.

    notes: assumptions, a sentence each.

    >>> picture = LinearPicture(torch.full((3, 8, 8), 0.5), full_scale=1.0, black_level=0.1)
    >>> round(float(picture.grey[0, 0]), 3)
    0.4
    """

    picture: Tensor
    full_scale: float
    black_level: float = 0.0
    unit: Literal["DN", "of white"] = "of white"
    notes: tuple[str, ...] = ()

    @cached_property
    def grey(self) -> NDArray[np.float64]:
        """Luminance above the black level, (H, W)."""
        weights = LUMINANCE if len(self.picture) == 3 else (1.0,)
        return np.asarray(np.tensordot(weights, self.picture.numpy(), 1) - self.black_level)

    def edge(self, roi: Roi, mode: Mode = "exact", bootstrap: int = 0) -> SlantedEdge:
        """The slanted edge in a region. Raises ``ValueError`` for one outside the picture or below 8 x 8 px."""
        levels: Any = {"full_scale": self.full_scale, "black_level": self.black_level}
        edge = slanted_edge(self.picture[None], mode=mode, roi=roi, bootstrap=bootstrap, **levels)
        return edge[0] if isinstance(edge, list) else edge


def linear(
    picture: Image, coding: Coding = "auto", *, black_level: float | None = None, full_scale: float | None = None,
    oecf: Oecf | None = None,
) -> LinearPicture:  # fmt: skip
    """Make a picture linear. ``auto``: 8 bits are sRGB-coded, 16 bits are linear.

    black_level (default 0) and full_scale (default all bits set) are digital numbers of a linear picture; oecf, the
    measured curve of the camera, replaces both and the coding. Raises ``ValueError`` where they are combined with
    sRGB coding, and for numbers that do not fit the picture.

    >>> linear(np.full((8, 8), 1000, np.uint16), "linear", black_level=64, full_scale=4095).grey[0, 0]
    np.float64(936.0)
    """
    bits = 8 * picture.itemsize
    planes = torch.from_numpy(np.atleast_3d(picture).transpose(2, 0, 1).astype(np.float64))
    levels = {"black_level": black_level, "full_scale": full_scale}
    given = [f"{name} = {value:g}" for name, value in levels.items() if value is not None]
    if oecf is not None:
        if given or coding != "auto":
            raise ValueError(
                f"{[*given, 'coding'][0]}: cannot be combined with --oecf, which covers all numbers"
            )
        numbers, fields = oecf
        least, most = fields[0], fields[-1]  # numbers beyond the scale count as clipped
        light = (np.interp(planes.numpy(), numbers, fields) - least) / (most - least)
        note = f"made linear by a grey scale of {len(fields)} fields"
        return LinearPicture(torch.from_numpy(light), 1.0, 0.0, "of white", (note,))
    notes = ["colours are measured as luminance (ITU-R BT.709)"] if len(planes) == 3 else []
    coded = coding == "srgb" or (coding == "auto" and bits == 8)
    if coding == "auto":
        coding_text = (
            "sRGB-coded (use --coding linear if it is linear)"
            if coded
            else "linear (use --coding srgb if it is sRGB-coded)"
        )
        notes.append(f"the picture has {bits} bits and is read as {coding_text}")
    if coded and given:
        raise ValueError(
            f"{given[0]}: needs linear numbers, but the picture is read as sRGB; add --coding linear"
        )
    if coded:
        return LinearPicture(
            linear_from_srgb(planes / (2**bits - 1)), 1.0, 0.0, "of white", (*notes, _UNDETECTED)
        )
    largest, most = float(planes.max()), 2.0**bits - 1
    # 1023, 4095, ...: what a converter of fewer bits has at most.
    whole = math.log2(largest + 1).is_integer() and largest >= _FEWEST_LEVELS
    if full_scale is None and whole and float((planes == largest).double().mean()) > CLIPPED_SHARE:
        full_scale = largest  # a converter of fewer bits, which clips there
        notes.append(f"full scale is set to {largest:g}, the value of many pixels")
    top = most if full_scale is None else checks.in_range("full_scale", full_scale, 1.0, most)
    if largest > top:
        raise ValueError(f"full_scale = {top:g}: must be >= {largest:g}, the largest number of the picture")
    black = checks.in_range("black_level", black_level or 0.0, 0.0, top - 1)
    if full_scale is None and largest <= most / 4:
        text = f"full scale is set to {most:g}; the largest number is {largest:g}"
        notes.append(f"{text}. If the camera has fewer bits, set --full-scale to detect clipping")
    return LinearPicture(planes, top, black, "DN", (*notes, _UNDETECTED))
