"""Pictures as NumPy arrays: one function for training loops that hold them as OpenCV, Ultralytics and MMDetection do.

Domain: (H, W), (H, W, C) or, of several, (B, H, W, C), uint8 or float in [0, 1]; the result has the same shape and
type, uint8 rounded. C is 1 or 3.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from blurnoise._core.checks import one_of, shown
from blurnoise.training.augmentation import expose_pictures
from blurnoise.training.ranges import Cameras

Array = NDArray[Any]


def expose_numpy(image: Array, camera: Cameras, *, channels: str = "rgb", **conditions: Any) -> Array:
    """Take pictures with a camera: :func:`blurnoise.training.augmentation.expose_pictures` for arrays.

    image: (H, W), (H, W, C) or (B, H, W, C), uint8 or float in [0, 1]. channels: their order, "rgb" or, as OpenCV
    and Ultralytics have it, "bgr". conditions: the other arguments of ``expose_pictures``, at least exposure_s and
    illuminance_lux; masks are (B, N, H, W), arrays or tensors. Returns an array of image's shape and type. Raises
    ``TypeError`` or ``ValueError`` naming the argument.
    """
    one_of("channels", channels, ("rgb", "bgr"))
    if conditions.get("masks") is not None:
        conditions["masks"] = _masks(conditions["masks"])
    seen = expose_pictures(_flipped(to_tensor(image), channels), camera, **conditions)
    return to_array(_flipped(seen, channels), image)


def _masks(given: object) -> Tensor:
    try:
        return torch.as_tensor(given)
    except (TypeError, ValueError, RuntimeError):
        raise TypeError(f"masks = {shown(given)}: must be an array or tensor (B, N, H, W)") from None


def to_tensor(image: Array) -> Tensor:
    """Pictures (B, C, H, W), float in [0, 1], of an array."""
    if not isinstance(image, np.ndarray) or image.ndim not in (2, 3, 4):
        got = f"shape {image.shape}" if isinstance(image, np.ndarray) else shown(image)
        raise TypeError(f"image: must be an array (H, W), (H, W, C) or (B, H, W, C), got {got}")
    if image.dtype != np.uint8 and not np.issubdtype(image.dtype, np.floating):
        raise TypeError(f"image: must be uint8 or float in [0, 1], got {image.dtype}")
    whole = image[..., None] if image.ndim == 2 else image
    if whole.shape[-1] not in (1, 3):
        raise ValueError(
            f"image: got {whole.shape[-1]} channels in shape {image.shape}; must be 1 or 3, the last axis"
        )
    batch = torch.from_numpy(np.ascontiguousarray(whole if whole.ndim == 4 else whole[None]))
    planes = batch.permute(0, 3, 1, 2)
    return planes.float() / 255.0 if image.dtype == np.uint8 else planes.contiguous()


def to_array(pictures: Tensor, like: Array) -> Array:
    """Pictures (B, C, H, W) as an array of the shape and type of ``like``."""
    coded = like.dtype == np.uint8
    planes = pictures.mul(255.0).round_().to(torch.uint8) if coded else pictures
    return planes.permute(0, 2, 3, 1).contiguous().numpy().reshape(like.shape).astype(like.dtype, copy=False)


def _flipped(pictures: Tensor, channels: str) -> Tensor:
    return pictures.flip(1) if channels == "bgr" and pictures.shape[1] == 3 else pictures
