"""Pictures continued beyond their border, by any number of pixels, more than their own size included."""

from __future__ import annotations

from typing import Any, Literal

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from blurnoise._core.threads import plain

Border = Literal["reflect", "replicate", "circular", "constant"]
BORDERS = ("reflect", "replicate", "circular", "constant")
OPENCV = {
    "reflect": cv2.BORDER_REFLECT_101,
    "replicate": cv2.BORDER_REPLICATE,
    "circular": cv2.BORDER_WRAP,
    "constant": cv2.BORDER_CONSTANT,
}


def extended(image: Tensor, before: tuple[int, int], spans: tuple[int, int], border: Border) -> Tensor:
    """The picture continued to ``spans`` pixels (down, across), ``before`` of them above and to the left.

    border: "reflect" without the outermost pixel twice, "replicate", "circular", or "constant" for black.
    """
    height, width = spans
    if (height, width) == tuple(image.shape[-2:]):
        return image
    after = (height - image.shape[-2] - before[0], width - image.shape[-1] - before[1])
    if plain(image):
        out = image.new_empty(*image.shape[:2], height, width)
        for plane, target in zip(image.flatten(0, 1), out.flatten(0, 1), strict=True):
            continued(plane.numpy(), target.numpy(), before, border)
        return out
    if border == "constant":
        return torch.nn.functional.pad(image, (before[1], after[1], before[0], after[0]))
    for dim, first, span in ((-2, before[0], height), (-1, before[1], width)):
        index = index_of(image.shape[dim], first, span, border)
        image = image.index_select(dim, index.to(image.device))
    return image


def continued(plane: NDArray[Any], into: NDArray[Any], before: tuple[int, int], border: Border) -> None:
    """``extended`` for one plane (H, W) of an array, into memory of the span."""
    after = [span - n - first for span, n, first in zip(into.shape, plane.shape, before, strict=True)]
    plane = np.ascontiguousarray(plane)
    cv2.copyMakeBorder(plane, before[0], after[0], before[1], after[1], OPENCV[border], dst=into, value=0)


def index_of(size: int, before: int, span: int, border: Border) -> Tensor:
    """What ``span`` pixels along an axis show, ``before`` of them ahead of ``size``; of borders but "constant"."""
    index = torch.arange(-before, span - before)
    if border == "replicate" or size == 1:
        return index.clamp(0, size - 1)
    if border == "circular":
        return index % size
    folded = index % (2 * size - 2)
    return torch.minimum(folded, 2 * size - 2 - folded)
