"""Windows of pictures (..., H, W): rectangles of whole pixels, beyond the picture too, and what is seen in them."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from blurnoise._core.borders import Border, extended


class Window(NamedTuple):
    """Pixels of a picture, and beyond it."""

    top: int
    left: int
    height: int
    width: int

    def grown(self, down: int, across: int) -> Window:
        """By so many pixels on either side."""
        return Window(self.top - down, self.left - across, self.height + 2 * down, self.width + 2 * across)

    def clipped(self, size: tuple[int, int]) -> Window:
        """What of it lies in a picture (H, W); of no or negative size where nothing does."""
        top, left = max(0, self.top), max(0, self.left)
        return Window(
            top, left, min(size[0], self.top + self.height) - top, min(size[1], self.left + self.width) - left
        )

    def joined(self, other: Window) -> Window:
        """The smallest that holds both."""
        top, left = min(self.top, other.top), min(self.left, other.left)
        bottom = max(self.top + self.height, other.top + other.height)
        right = max(self.left + self.width, other.left + other.width)
        return Window(top, left, bottom - top, right - left)

    def meets(self, other: Window) -> bool:
        """Whether they have a pixel in common."""
        apart_y = self.top >= other.top + other.height or other.top >= self.top + self.height
        apart_x = self.left >= other.left + other.width or other.left >= self.left + self.width
        return not (apart_y or apart_x)

    @property
    def within(self) -> tuple[slice, slice]:
        """Rows and columns of a picture that holds it."""
        return slice(self.top, self.top + self.height), slice(self.left, self.left + self.width)


def cut(plane: Tensor, work: Window, window: Window) -> Tensor:
    """Of a plane over ``work`` what lies in ``window``."""
    top, left = window.top - work.top, window.left - work.left
    return plane[..., top : top + window.height, left : left + window.width]


def continued_in(picture: Tensor, work: Window, border: Border) -> Tensor:
    """The picture in ``work``, beyond its border too."""
    inner = work.clipped((picture.shape[-2], picture.shape[-1]))
    before = (inner.top - work.top, inner.left - work.left)
    return extended(picture[..., *inner.within], before, (work.height, work.width), border)


def placed(
    own: Tensor, place_px: tuple[int, int], window: Window, size: tuple[int, int], border: Border
) -> Tensor:
    """Planes (1, C, h, w), their corner at (left, top) of a picture (H, W), in a window; around them is nothing.

    Where they end at the picture's border they go on beyond it as the border does.
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
    """From where to where a layer is as it says, along one axis; beyond that the border continues it."""
    if border == "circular":
        return 0, size
    first = max(0, work_start) if start == 0 else work_start
    last = work_start + work_length
    return first, min(size, last) if start + length == size else last
