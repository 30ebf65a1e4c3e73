"""Demosaicing: the plane of a mosaic to three colours a pixel, or of RCCC to grey.

Domain: values of any offset and scale, balanced, so that white is the same behind every filter. "bilinear": the mean
of the nearest pixels behind a filter. "edge": OpenCV's edge-aware one, of which only the values are known; its
derivatives are those of "bilinear", as is all of RCCC. Pictures continue by reflection about their border pixels,
which keeps the pattern, so that sides may be odd.
"""

from __future__ import annotations

from typing import Any, Literal

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

Method = Literal["bilinear", "edge"]
MARGIN = 2
"""Pixels of border that :func:`by_opencv` wants around a picture and takes off."""
OFFSET, SCALE = 8192.0, 32768.0
"""Where integers of 16 bits hold linear light: 0 and the steps to 1, so that noise below black stays."""


def as_bayer(cfa: str) -> str:
    """The Bayer pattern with a pattern's places: clear in place of green."""
    return cfa.replace("C", "G")


def demosaic(plane: Tensor, cfa: str, method: Method) -> Tensor:
    """Colours (B, 3, H, W) of planes (B, 1, H, W); of RCCB clear in green's place, of RCCC three times grey."""
    if method == "bilinear" or cfa == "RCCC":
        return _bilinear(plane, cfa)
    with torch.no_grad():
        codes = (plane * SCALE + OFFSET).round().clamp(0, 65535).cpu().numpy().astype(np.uint16)
        found = np.stack([by_opencv(padded(picture[0]), cfa, method) for picture in codes])
        seen = torch.from_numpy(found.astype(np.float32)).permute(0, 3, 1, 2)
        edge = (seen.to(plane) - OFFSET) / SCALE
    if not (plane.requires_grad and torch.is_grad_enabled()):
        return edge
    smooth = _bilinear(plane, cfa)
    return smooth + (edge - smooth).detach()


def padded(plane: NDArray[Any]) -> NDArray[Any]:
    """A plane (H, W) with ``MARGIN`` pixels around it."""
    framed: NDArray[Any] = cv2.copyMakeBorder(plane, MARGIN, MARGIN, MARGIN, MARGIN, cv2.BORDER_REFLECT_101)
    return framed


def by_opencv(raw: NDArray[np.uint16], cfa: str, method: Method) -> NDArray[np.uint16]:
    """Colours (H, W, 3) of a plane with its margin, in integers of 16 bits; of RCCC grey, (H, W, 3) too."""
    inner = slice(MARGIN, -MARGIN)
    if cfa != "RCCC":
        # names of four letters count from the first row, those of two from the second
        conversion = getattr(cv2, f"COLOR_Bayer{as_bayer(cfa)}2RGB{'_EA' if method == 'edge' else ''}")
        colours: NDArray[np.uint16] = cv2.cvtColor(raw, conversion)
        return colours[inner, inner]
    grey = raw.copy()
    up, down, left, right = raw[1:-2:2, 2:-1:2], raw[3::2, 2:-1:2], raw[2:-1:2, 1:-2:2], raw[2:-1:2, 3::2]
    total = up.astype(np.uint32) + down + left + right
    grey[2:-1:2, 2:-1:2] = (total + 2) // 4
    merged: NDArray[np.uint16] = cv2.merge([grey[inner, inner]] * 3)
    return merged


def _bilinear(plane: Tensor, cfa: str) -> Tensor:
    sites = plane.new_zeros((3, 1, 2, 2))
    for place, letter in enumerate(cfa):
        sites["RGB".index(as_bayer(letter)), 0, place // 2, place % 2] = 1.0
    height, width = plane.shape[-2:]
    here = sites.repeat(1, 1, (height + 1) // 2, (width + 1) // 2)[None, :, 0, :height, :width]
    cross = plane.new_tensor([[0, 1, 0], [1, 4, 1], [0, 1, 0]]) / 4
    square = plane.new_tensor([[1, 2, 1], [2, 4, 2], [1, 2, 1]]) / 4
    if cfa == "RCCC":  # the four neighbours of a red pixel are clear
        red = here[:, :1]
        around = (
            nn.functional.conv2d(nn.functional.pad(plane, (1, 1, 1, 1), mode="reflect"), cross[None, None])
            - plane
        )
        return torch.where(red > 0, around, plane).expand(-1, 3, -1, -1)
    around = nn.functional.pad(plane * here, (1, 1, 1, 1), mode="reflect")
    return nn.functional.conv2d(around, torch.stack([square, cross, square])[:, None], groups=3)
