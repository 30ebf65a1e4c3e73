"""Placement of a picture in the network's input, and of boxes back from there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.detectors.contract import Contract
from blurnoise_eval.detectors.records import FloatArray

Blob = NDArray[Any]  # float32, or uint8 for the graphs that take bytes


@dataclass(frozen=True)
class Placement:
    """Where a picture of ``width_px`` x ``height_px`` lies in the network's input.

    Convention: input x = picture x · scale_x + left_px, edges at integers; y likewise.
    """

    width_px: int
    height_px: int
    scale_x: float
    scale_y: float
    left_px: int
    top_px: int

    def to_picture(self, boxes_xyxy: FloatArray) -> FloatArray:
        """Return boxes (N, 4), px of the input, in px of the picture, clipped to it."""
        boxes = boxes_xyxy - np.array([self.left_px, self.top_px] * 2, np.float32)
        boxes /= np.array([self.scale_x, self.scale_y] * 2, np.float32)
        np.maximum(boxes, 0, out=boxes)
        np.minimum(boxes, np.array([self.width_px, self.height_px] * 2, np.float32), out=boxes)
        return boxes


def picture_size(image: NDArray[np.uint8]) -> tuple[int, int]:
    """Return (height, width). Raises ``TypeError`` or ``ValueError`` for anything but RGB (H, W, 3), uint8."""
    if not isinstance(image, np.ndarray) or image.dtype != np.uint8:
        kind = getattr(image, "dtype", type(image).__name__)
        raise TypeError(f"image: must be a numpy array of uint8, shape (H, W, 3), got {kind}")
    if image.ndim != 3 or image.shape[2] != 3 or 0 in image.shape:
        raise ValueError(f"image: shape must be (H, W, 3), none of them 0, got {image.shape}")
    return image.shape[0], image.shape[1]


def blob_shape(axes: str, size_px: tuple[int, int]) -> tuple[int, ...]:
    """The shape of an input "nchw", "nhwc" or "chw" of (height, width) px that holds one picture."""
    if axes == "chw":
        return (3, *size_px)
    return (1, *size_px, 3) if axes == "nhwc" else (1, 3, *size_px)


def lay_in(
    image: NDArray[np.uint8],
    contract: Contract,
    size_px: tuple[int, int],
    out: Blob | None = None,
    *,
    axes: str = "nchw",
    dtype: type[np.generic] = np.float32,
) -> tuple[Blob, Placement]:
    """Return the network's input for an RGB picture (h, w, 3), and where the picture lies in it.

    ``size_px``: the input's (H, W), which ``resize`` "none" replaces by the picture's. ``out``: a buffer to
    fill, if its shape is right, instead of a new one. ``axes``: "nchw" (1, 3, H, W), "nhwc" or "chw".
    ``dtype``: float32, or uint8 where the contract leaves values as they are.
    Resizing is bilinear, as the families' own code does it. Raises ``TypeError`` for anything but uint8,
    ``ValueError`` for a wrong shape.
    """
    height, width = picture_size(image)
    size_px = (height, width) if contract.resize == "none" else size_px
    if contract.resize.startswith("letterbox"):
        scale = min(size_px[0] / height, size_px[1] / width)
        new_height, new_width = max(1, round(height * scale)), max(1, round(width * scale))
    else:
        new_height, new_width = size_px
    centred = contract.resize == "letterbox"
    top, left = ((size_px[0] - new_height) // 2, (size_px[1] - new_width) // 2) if centred else (0, 0)
    if (new_height, new_width) != (height, width):
        image = cv2.resize(image, (new_width, new_height), interpolation=cv2.INTER_LINEAR)

    planes = cv2.split(np.ascontiguousarray(image))
    planes = planes[::-1] if contract.colour == "bgr" else planes
    shape = blob_shape(axes, size_px)
    blob = np.empty(shape, dtype) if out is None or out.shape != shape else out
    channels = blob if axes == "chw" else blob[0].transpose(2, 0, 1) if axes == "nhwc" else blob[0]
    full_scale = 255.0 if contract.value_range == "0-1" else 1.0
    for channel, plane, index in zip(channels, planes, range(3), strict=True):
        mean = contract.mean[index] if contract.mean else 0.0
        std = contract.std[index] if contract.std else 1.0
        gain = np.float32(1 / (full_scale * std))
        window = channel[top : top + new_height, left : left + new_width]
        if window.size < channel.size:
            channel[...] = (contract.pad_value / full_scale - mean) / std
        np.copyto(window, plane)  # converts faster than a multiplication that has to
        if gain != 1:
            np.multiply(window, gain, out=window)
        if mean:
            window -= np.float32(mean / std)
    return blob, Placement(width, height, new_width / width, new_height / height, left, top)
