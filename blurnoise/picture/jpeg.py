"""JPEG: what a file of 8-bit values, baseline with colours at half resolution, leaves of a picture."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from blurnoise.camera import Camera
from blurnoise.picture.step import Development, PictureStep


class Jpeg(PictureStep):
    """A round trip through libjpeg at ``Camera.jpeg_quality``; linear light is not a file's, and stays."""

    name = "JPEG"
    pointwise = False

    def active(self, camera: Camera) -> bool:
        """Where a quality is stated."""
        return camera.jpeg_quality is not None

    def apply(self, picture: Tensor, at: Development) -> Tensor:
        """Each picture by itself; three planes are colours, any other number so many grey pictures.

        Its derivatives are those of nothing done.
        """
        if at.encoding != "srgb" or picture.ndim < 3 or at.camera.jpeg_quality is None:
            return picture
        quality = at.camera.jpeg_quality
        codes = (picture.detach() * 255).round().clamp(0, 255).to(torch.uint8).cpu().numpy()
        colours = codes.shape[-3] == 3
        each = codes.reshape(-1, *codes.shape[-3:]) if colours else codes.reshape(-1, *codes.shape[-2:])
        seen = np.stack([_round_trip(image, quality) for image in each]).reshape(codes.shape)
        found = torch.from_numpy(seen).to(picture) / 255
        return picture + (found - picture).detach() if picture.requires_grad else found


def _round_trip(image: NDArray[np.uint8], quality: int) -> NDArray[np.uint8]:
    """Of (3, H, W) or (H, W), 8 bits."""
    given = np.ascontiguousarray(image.transpose(1, 2, 0)[..., ::-1]) if image.ndim == 3 else image
    _, file = cv2.imencode(".jpg", given, [cv2.IMWRITE_JPEG_QUALITY, quality])
    seen: Any = cv2.imdecode(file, cv2.IMREAD_UNCHANGED)
    back: NDArray[np.uint8] = seen[..., ::-1].transpose(2, 0, 1) if image.ndim == 3 else seen
    return back
