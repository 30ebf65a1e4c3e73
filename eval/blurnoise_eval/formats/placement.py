"""Lays a picture into the network's input, and carries boxes back from there."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from blurnoise_eval.contract import Contract
from blurnoise_eval.formats.candidates import FloatArray


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
        offset = np.array([self.left_px, self.top_px] * 2, np.float32)
        scale = np.array([self.scale_x, self.scale_y] * 2, np.float32)
        limit = np.array([self.width_px, self.height_px] * 2, np.float32)
        clipped: FloatArray = np.clip((boxes_xyxy - offset) / scale, 0, limit)
        return clipped


def lay_in(
    image: NDArray[np.uint8],
    contract: Contract,
    size_px: tuple[int, int],
    out: FloatArray | None = None,
) -> tuple[FloatArray, Placement]:
    """Return the network's input (1, 3, H, W) for an RGB picture (h, w, 3), and where the picture lies in it.

    ``size_px``: the input's (H, W). ``out``: a buffer of that shape to fill instead of a new one.
    Resizing is bilinear, as the families' own code does it. Raises ``TypeError`` for anything but uint8,
    ``ValueError`` for a wrong shape.
    """
    if not isinstance(image, np.ndarray) or image.dtype != np.uint8:
        kind = getattr(image, "dtype", type(image).__name__)
        raise TypeError(f"image: must be a numpy array of uint8, shape (H, W, 3), got {kind}")
    if image.ndim != 3 or image.shape[2] != 3 or 0 in image.shape:
        raise ValueError(f"image: shape must be (H, W, 3), none of them 0, got {image.shape}")
    height, width = image.shape[:2]
    if contract.resize == "stretch":
        new_height, new_width = size_px
    else:
        scale = min(size_px[0] / height, size_px[1] / width)
        new_height, new_width = max(1, round(height * scale)), max(1, round(width * scale))
    centred = contract.resize == "letterbox"
    top, left = ((size_px[0] - new_height) // 2, (size_px[1] - new_width) // 2) if centred else (0, 0)
    if (new_height, new_width) != (height, width):
        image = cv2.resize(image, (new_width, new_height), interpolation=cv2.INTER_LINEAR)

    planes = cv2.split(np.ascontiguousarray(image))
    planes = planes[::-1] if contract.colour == "bgr" else planes
    blob = np.empty((1, 3, *size_px), np.float32) if out is None else out
    full_scale = 255.0 if contract.value_range == "0-1" else 1.0
    padded = (new_height, new_width) != size_px
    for channel, plane in enumerate(planes):
        mean = contract.mean[channel] if contract.mean else 0.0
        std = contract.std[channel] if contract.std else 1.0
        if padded:
            blob[0, channel] = (contract.pad_value / full_scale - mean) / std
        window = blob[0, channel, top : top + new_height, left : left + new_width]
        np.multiply(plane, np.float32(1 / (full_scale * std)), out=window, dtype=np.float32)
        if mean:
            window -= np.float32(mean / std)
    return blob, Placement(width, height, new_width / width, new_height / height, left, top)
