"""Pictures as NumPy arrays: one function for training loops that hold them as OpenCV, Ultralytics and MMDetection do.

Domain: (H, W), (H, W, C) or, of several, (B, H, W, C), uint8 or float in [0, 1]; the result has the same shape and
type, uint8 rounded. C is 1 or 3.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from blurnoise._core.checks import LARGEST_PICTURE, integer, one_of, picture_size, real_tensor, shown
from blurnoise.training.labels import boxes_after, keypoints_after, masks_after, of_targets
from blurnoise.training.pictures import expose_pictures
from blurnoise.training.ranges import Cameras

Array = NDArray[Any]
CHANNELS = ("rgb", "bgr")


def expose_numpy(image: Array, camera: Cameras, *, channels: str = "rgb", **conditions: Any) -> Array:
    """Take pictures with a camera: :func:`blurnoise.training.pictures.expose_pictures` for arrays.

    image: (H, W), (H, W, C) or (B, H, W, C), uint8 or float in [0, 1]. channels: their order, "rgb" or, as OpenCV
    and Ultralytics have it, "bgr". conditions: the other arguments of ``expose_pictures``, at least exposure_s and
    illuminance_lux; masks are (B, N, H, W), arrays or tensors. Returns an array of image's shape and type. Raises
    ``TypeError`` or ``ValueError`` naming the argument.
    """
    one_of("channels", channels, CHANNELS)
    return exposed(image, channels=channels, camera=camera, **_masked(conditions))


class Labels(NamedTuple):
    """Labels of pictures, those that there are."""

    boxes: Array | None = None
    keypoints: Array | None = None
    label_masks: Array | None = None


def labels_numpy(
    shape: tuple[int, ...],
    camera: Cameras,
    *,
    boxes: Array | None = None,
    keypoints: Array | None = None,
    label_masks: Array | None = None,
    grow_boxes: bool = False,
    **conditions: Any,
) -> Labels:
    """The labels of :func:`expose_numpy`'s pictures under the same camera and conditions, at mid-exposure.

    shape: of the pictures, (H, W), (H, W, C) or (B, H, W, C). boxes: (N, 4), x0, y0, x1, y1 in px from the corner of
    the picture. keypoints: (N, 2), x, y in px from the centre of the first pixel. label_masks: (H, W) or (..., H, W)
    of any type. For shapes with B each label has an axis B before. grow_boxes: boxes cover what their targets sweep.

    Returns the labels that were given, as :mod:`blurnoise.training.labels` says, in the same shapes; boxes and
    keypoints are float64. Raises ``TypeError`` or ``ValueError`` naming the argument.

    Example: a rolling shutter displaces what is far from the middle row.

    >>> import numpy as np
    >>> from blurnoise import labels_numpy
    >>> at = {"exposure_s": 0.01, "speed_px_s": 1000.0}
    >>> labels_numpy((240, 320), "ar0237", keypoints=np.array([[160.0, 10.0]]), **at).keypoints.round(1)
    array([[152.4,  10. ]])
    """
    axes, size = _axes_of(shape)
    by = list(of_targets(axes[0] if axes else 1, camera, **_masked(conditions)))

    def known(name: str, label: Any, *last: int) -> Tensor:
        """A label with an axis of pictures."""
        if name != "label_masks":
            tensor = real_tensor(name, label).double()
        elif isinstance(label, np.ndarray) and label.dtype.kind in "biuf":
            tensor = torch.from_numpy(np.ascontiguousarray(label))
        else:
            raise TypeError(f"{name} = {shown(label)}: must be an array of numbers")
        before = tensor.ndim - len(axes) - len(last)
        fits = before == 1 if len(last) == 1 else before >= 0
        if not fits or tuple(tensor.shape[: len(axes)]) != axes or tuple(tensor.shape[-len(last) :]) != last:
            must = ", ".join(map(str, (*axes, "N" if len(last) == 1 else "...", *last)))
            raise ValueError(f"{name}: shape must be ({must}), got {tuple(tensor.shape)}")
        return tensor if axes else tensor[None]

    def given(moved: Tensor) -> Array:
        found: Array = (moved if axes else moved[0]).numpy()
        return found

    found: dict[str, Array] = {}
    if boxes is not None:
        found["boxes"] = given(boxes_after(known("boxes", boxes, 4), by, size, grow=grow_boxes))
    if keypoints is not None:
        found["keypoints"] = given(keypoints_after(known("keypoints", keypoints, 2), by, size))
    if label_masks is not None:
        found["label_masks"] = given(masks_after(known("label_masks", label_masks, *size), by))
    return Labels(**found)


def _axes_of(shape: Any) -> tuple[tuple[int, ...], tuple[int, int]]:
    """The axis of pictures, if there is one, and their size, of the shape of an array of pictures."""
    sides = tuple(shape) if isinstance(shape, Sequence) and not isinstance(shape, str) else ()
    if len(sides) not in (2, 3, 4):
        raise ValueError(f"shape = {shown(shape)}: must be (H, W), (H, W, C) or (B, H, W, C)")
    several = len(sides) == 4
    return tuple(integer("shape", n, 1, LARGEST_PICTURE) for n in sides[:several]), picture_size(
        "shape", sides[several:][:2]
    )


def exposed(image: Array, *, channels: str, **conditions: Any) -> Array:
    """Pictures (H, W), (H, W, C) or (B, H, W, C) under arguments of ``expose_pictures``."""
    return to_array(
        _flipped(expose_pictures(_flipped(to_tensor(image), channels), **conditions), channels), image
    )


def _masked(conditions: dict[str, Any]) -> dict[str, Any]:
    """The conditions, masks as a tensor."""
    if conditions.get("masks") is None:
        return conditions
    return {**conditions, "masks": _masks(conditions["masks"])}


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
