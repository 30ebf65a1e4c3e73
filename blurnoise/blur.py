"""Applies blur to batches of pictures (B, C, H, W) in linear light.

Convention: x right, y down, px. A blur keeps the mean of what it sees and its centroid; the border is
continued by ``border`` ("reflect", "replicate", "circular" or "constant" for black), by default "reflect".
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal, cast

import cv2
import torch
from kornia.filters import filter2d
from torch import Tensor

from blurnoise import psf
from blurnoise.checks import image_batch, non_negative, one_of

Border = Literal["reflect", "replicate", "circular", "constant"]
BORDERS = ("reflect", "replicate", "circular", "constant")
_OPENCV_BORDERS = {
    "reflect": cv2.BORDER_REFLECT_101,
    "replicate": cv2.BORDER_REPLICATE,
    "constant": cv2.BORDER_CONSTANT,
}


def motion_blur(
    image: Tensor, displacement_px: Tensor | Iterable[float], *, border: Border = "reflect"
) -> Tensor:
    """Blur each picture by uniform straight motion during its exposure.

    image: (B, C, H, W). displacement_px: (2,) or (B, 2), motion (x, y) during the exposure, any length and
    angle, another for each picture if wished. Returns the shape of ``image``; differentiable in both.

    The kernel is :func:`blurnoise.psf.line`, applied by ``kornia.filters.filter2d``; motion along a row or a
    column, which needs one line of taps, goes through OpenCV on the CPU. No motion returns ``image`` itself.
    Raises ``TypeError`` or ``ValueError`` for anything but finite values of these shapes.
    """
    image_batch("image", image)
    displacement = _displacement(displacement_px, image)
    if not _differentiable(displacement) and not bool(displacement.any()):
        return image
    if _differentiable(image, displacement) or image.device.type != "cpu":
        return _apply(image, psf.line(displacement), border)
    if len(image) == 1:
        return _apply(image, psf.line(displacement), border)
    pairs = zip(torch.split(image, 1), torch.split(displacement, 1), strict=True)
    return torch.cat([_apply(item, psf.line(by), border) for item, by in pairs])


def defocus(image: Tensor, radius_px: float, *, border: Border = "reflect") -> Tensor:
    """Blur by a disc of ``radius_px`` >= 0, with exact pixel areas; up to half a pixel it is the identity."""
    image_batch("image", image)
    kernel = psf.disc(non_negative("radius_px", radius_px))
    if kernel.size == 1:
        return image
    return _apply(image, torch.from_numpy(kernel).to(image)[None], border)


def _displacement(value: Tensor | Iterable[float], image: Tensor) -> Tensor:
    displacement = value if isinstance(value, Tensor) else torch.as_tensor(value, dtype=torch.float64)
    displacement = displacement.to(device=image.device, dtype=image.dtype)
    if displacement.shape not in {(2,), (1, 2), (len(image), 2)}:
        raise ValueError(
            f"displacement_px: shape must be (2,) or ({len(image)}, 2), got {tuple(displacement.shape)}"
        )
    if not bool(torch.isfinite(displacement.detach()).all()):
        raise ValueError(f"displacement_px = {displacement.tolist()}: must be finite")
    return displacement.expand(len(image), 2)


def _apply(image: Tensor, kernel: Tensor, border: Border) -> Tensor:
    one_of("border", border, BORDERS)
    pad_y, pad_x = kernel.shape[-2] // 2, kernel.shape[-1] // 2
    one_line = pad_y == 0 or pad_x == 0
    if one_line and len(kernel) == 1 and image.device.type == "cpu" and not _differentiable(image, kernel):
        return _filter_line(image, kernel[0], border)
    return cast(Tensor, filter2d(_pad(image, pad_y, pad_x, border), kernel, padding="valid"))


def _differentiable(*tensors: Tensor) -> bool:
    return torch.is_grad_enabled() and any(tensor.requires_grad for tensor in tensors)


def _filter_line(image: Tensor, kernel: Tensor, border: Border) -> Tensor:
    """Correlate with one row or one column of taps by OpenCV's direct sums: much faster than a convolution."""
    pad_y, pad_x = kernel.shape[0] // 2, kernel.shape[1] // 2
    if border == "circular":  # which filter2D does not know
        image, border = _pad(image, pad_y, pad_x, border), "constant"
    else:
        pad_y = pad_x = 0
    out = torch.empty_like(image, memory_format=torch.contiguous_format)
    taps = kernel.numpy()
    for plane, target in zip(image.flatten(0, 1), out.flatten(0, 1), strict=True):
        cv2.filter2D(plane.numpy(), -1, taps, dst=target.numpy(), borderType=_OPENCV_BORDERS[border])
    return out[..., pad_y : out.shape[-2] - pad_y, pad_x : out.shape[-1] - pad_x]


def _pad(image: Tensor, pad_y: int, pad_x: int, border: Border) -> Tensor:
    """Continue the picture by any number of pixels, more than its own size included."""
    if border == "constant":
        return torch.nn.functional.pad(image, (pad_x, pad_x, pad_y, pad_y))
    for dim, pad in ((-2, pad_y), (-1, pad_x)):
        if pad:
            size = image.shape[dim]
            image = image.index_select(dim, _border_index(size, pad, border).to(image.device))
    return image


def _border_index(size: int, pad: int, border: Border) -> Tensor:
    index = torch.arange(-pad, size + pad)
    if border == "replicate" or size == 1:
        return index.clamp(0, size - 1)
    if border == "circular":
        return index % size
    folded = index % (2 * size - 2)
    return torch.minimum(folded, 2 * size - 2 - folded)
