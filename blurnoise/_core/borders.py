"""Pictures (..., H, W) continued beyond their border, by any number of pixels, and windows of whole pixels."""

from __future__ import annotations

from typing import Any, Literal, NamedTuple

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

    >>> row = torch.tensor([[[[1.0, 2.0, 3.0]]]])
    >>> extended(row, (0, 1), (1, 6), "reflect")
    tensor([[[[2., 1., 2., 3., 2., 1.]]]])
    """
    height, width = spans
    if (height, width) == tuple(image.shape[-2:]):
        return image
    after = (height - image.shape[-2] - before[0], width - image.shape[-1] - before[1])
    if plain(image):  # OpenCV copies several times faster than torch indexes
        out = image.new_empty(*image.shape[:2], height, width)
        for plane, target in zip(image.flatten(0, 1), out.flatten(0, 1), strict=True):
            continued(plane.numpy(), target.numpy(), before, border)
        return out
    if border == "constant":
        return torch.nn.functional.pad(image, (before[1], after[1], before[0], after[0]))
    for dim, first, span in ((-2, before[0], height), (-1, before[1], width)):
        indices = torch.arange(-first, span - first, device=image.device)
        image = image.index_select(dim, folded(indices, image.shape[dim], border))
    return image


def continued(plane: NDArray[Any], into: NDArray[Any], before: tuple[int, int], border: Border) -> None:
    """``extended`` for one plane (H, W) of an array, into memory of the span.

    >>> into = np.empty((1, 5))
    >>> continued(np.array([[1.0, 2.0, 3.0]]), into, (0, 1), "circular")
    >>> into.tolist()
    [[3.0, 1.0, 2.0, 3.0, 1.0]]
    """
    after = [span - n - first for span, n, first in zip(into.shape, plane.shape, before, strict=True)]
    plane = np.ascontiguousarray(plane)
    cv2.copyMakeBorder(plane, before[0], after[0], before[1], after[1], OPENCV[border], dst=into, value=0)


def folded(indices: Tensor, size: int, border: Border) -> Tensor:
    """Indices along an axis of ``size`` pixels that a border shows at ``indices``, any integers; not "constant".

    >>> folded(torch.arange(-2, 5), 3, "circular")
    tensor([1, 2, 0, 1, 2, 0, 1])
    """
    if border == "replicate" or size == 1:
        return indices.clamp(0, size - 1)
    if border == "circular":
        return indices % size
    # Reflection repeats after there and back, without the outermost pixels twice.
    inside = indices % (2 * size - 2)
    return torch.minimum(inside, 2 * size - 2 - inside)


class Window(NamedTuple):
    """A rectangle of pixels, which may extend beyond the picture.

    >>> Window(0, 0, 4, 6).grown(1, 2)
    Window(top=-1, left=-2, height=6, width=10)
    >>> Window(2, 3, 4, 6).clipped((5, 5))
    Window(top=2, left=3, height=3, width=2)
    """

    top: int
    left: int
    height: int
    width: int

    def grown(self, down: int, across: int) -> Window:
        """The window, larger by this many pixels on each side."""
        return Window(self.top - down, self.left - across, self.height + 2 * down, self.width + 2 * across)

    def clipped(self, size: tuple[int, int]) -> Window:
        """The part inside a picture (H, W); of size 0 or below where the two do not overlap."""
        top, left = max(0, self.top), max(0, self.left)
        return Window(
            top, left, min(size[0], self.top + self.height) - top, min(size[1], self.left + self.width) - left
        )

    def joined(self, other: Window) -> Window:
        """The smallest window that holds both."""
        top, left = min(self.top, other.top), min(self.left, other.left)
        bottom = max(self.top + self.height, other.top + other.height)
        right = max(self.left + self.width, other.left + other.width)
        return Window(top, left, bottom - top, right - left)

    def meets(self, other: Window) -> bool:
        """Whether they have a pixel in common."""
        down = -other.height < other.top - self.top < self.height
        return down and -other.width < other.left - self.left < self.width

    @property
    def within(self) -> tuple[slice, slice]:
        """The window as slices of a picture's rows and columns."""
        return slice(self.top, self.top + self.height), slice(self.left, self.left + self.width)


def cut(plane: Tensor, work: Window, window: Window) -> Tensor:
    """Crop a plane that covers the window ``work`` to ``window``.

    >>> plane = torch.arange(6.0).view(1, 1, 2, 3)  # of the window from row -1, column 0
    >>> cut(plane, Window(-1, 0, 2, 3), Window(0, 1, 1, 2)).tolist()
    [[[[4.0, 5.0]]]]
    """
    top, left = window.top - work.top, window.left - work.left
    return plane[..., top : top + window.height, left : left + window.width]


def continued_in(picture: Tensor, work: Window, border: Border) -> Tensor:
    """Crop a picture to ``work``, continuing it beyond its border.

    >>> picture = torch.tensor([[[[1.0, 2.0, 3.0]]]])
    >>> continued_in(picture, Window(0, -2, 1, 4), "replicate").tolist()
    [[[[1.0, 1.0, 1.0, 2.0]]]]
    """
    inner = work.clipped((picture.shape[-2], picture.shape[-1]))
    before = (inner.top - work.top, inner.left - work.left)
    return extended(picture[..., *inner.within], before, (work.height, work.width), border)


def placed(
    own: Tensor, place_px: tuple[int, int], window: Window, size: tuple[int, int], border: Border
) -> Tensor:
    """Place planes (1, C, h, w) with their corner at (left, top) of a picture (H, W) into a window, 0 around them.

    Planes that end at the picture's border are continued beyond it by the border mode.

    >>> placed(torch.ones(1, 1, 1, 2), (0, 0), Window(0, -1, 1, 4), (1, 5), "replicate")
    tensor([[[[1., 1., 1., 0.]]]])
    """
    left, top = place_px
    height, width = own.shape[-2:]
    first_y, last_y = _domain(top, height, window.top, window.height, size[0], border)
    first_x, last_x = _domain(left, width, window.left, window.width, size[1], border)
    within = own[
        ..., max(0, first_y - top) : max(0, last_y - top), max(0, first_x - left) : max(0, last_x - left)
    ]
    before_y, before_x = max(0, top - first_y), max(0, left - first_x)
    after_y = last_y - first_y - before_y - within.shape[-2]
    after_x = last_x - first_x - before_x - within.shape[-1]
    canvas = torch.nn.functional.pad(within, (before_x, after_x, before_y, after_y))
    return extended(
        canvas, (first_y - window.top, first_x - window.left), (window.height, window.width), border
    )


def _domain(
    start: int, length: int, work_start: int, work_length: int, size: int, border: Border
) -> tuple[int, int]:
    """Start and end of a layer along one axis, beyond which the border continues it."""
    if border == "circular":
        return 0, size
    first = max(0, work_start) if start == 0 else work_start
    last = work_start + work_length
    return first, min(size, last) if start + length == size else last
