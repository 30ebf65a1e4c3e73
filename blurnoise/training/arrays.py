"""Pictures as NumPy arrays: functions for training loops that hold them as OpenCV, Ultralytics and MMDetection do.

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
from blurnoise.scene.cutting import checked_masks
from blurnoise.scene.exposure import Exposure
from blurnoise.training.labels import boxes_after, keypoints_after, masks_after, of_targets
from blurnoise.training.pictures import expose_pictures, exposures_of

Array = NDArray[Any]
CHANNELS = ("rgb", "bgr")


def expose_numpy(
    image: Array,
    exposure: Exposure | Sequence[Exposure],
    *,
    channels: str = "rgb",
    masks: Array | Tensor | None = None,
    **options: Any,
) -> Array:
    """Take pictures with a camera: :func:`blurnoise.expose_pictures` for arrays.

    image: (H, W), (H, W, C) or (B, H, W, C), uint8 or float in [0, 1]. exposure: one for all pictures, or one for
    each. channels: their order, "rgb" or, as OpenCV and Ultralytics have it, "bgr". masks: (B, N, H, W). options: the
    others of ``expose_pictures``. Returns an array of image's shape and type. Raises ``TypeError`` or ``ValueError``
    naming the argument.

    >>> from blurnoise import Camera, Exposure
    >>> grey = np.full((4, 6, 3), 128, np.uint8)
    >>> expose_numpy(grey, Exposure(Camera.preset("imx250"), 0.01, 50.0)).shape
    (4, 6, 3)
    """
    one_of("channels", channels, CHANNELS)
    pictures = _flipped(_to_tensor(image), channels)
    exposed = expose_pictures(pictures, exposure, masks=_tensor_of(masks), **options)
    return _to_array(_flipped(exposed, channels), image)


class PictureLabels(NamedTuple):
    """PictureLabels of pictures; None for those that were not given.

    >>> PictureLabels(boxes=np.array([[10.0, 10.0, 30.0, 20.0]])).keypoints is None
    True
    """

    boxes: Array | None = None
    keypoints: Array | None = None
    label_masks: Array | None = None


def labels_numpy(
    shape: tuple[int, ...],
    exposure: Exposure | Sequence[Exposure],
    *,
    boxes: Array | None = None,
    keypoints: Array | None = None,
    label_masks: Array | None = None,
    masks: Array | Tensor | None = None,
    grow_boxes: bool = False,
) -> PictureLabels:
    """The labels of :func:`expose_numpy`'s pictures at mid-exposure, under the same exposure.

    shape: of the pictures, (H, W), (H, W, C) or (B, H, W, C). boxes: (N, 4), x0, y0, x1, y1 in px from the corner of
    the picture. keypoints: (N, 2), x, y in px from the centre of the first pixel. label_masks: (H, W) or (..., H, W)
    of any type. For shapes with B each label has an axis B before. masks: (B, N, H, W) of the targets, where they or
    the background alone move. grow_boxes: extend boxes to the swept boxes.

    Returns the labels that were given, as :mod:`blurnoise.training.labels` says, in the same shapes; boxes and
    keypoints are float64. Raises ``TypeError`` or ``ValueError`` naming the argument.

    A rolling shutter displaces what is far from the middle row:

    >>> from blurnoise import Camera, Exposure
    >>> exposure = Exposure(Camera.preset("ar0237"), 0.01, 50.0, velocity_px_s=(1000.0, 0.0))
    >>> labels_numpy((240, 320), exposure, keypoints=np.array([[160.0, 10.0]])).keypoints.round(1)
    array([[152.4,  10. ]])
    """
    axes, size = _axes_of(shape)
    batch = axes[0] if axes else 1
    targets = _tensor_of(masks)
    if targets is not None:
        checked_masks(targets, batch, size)
    exposures = of_targets(exposures_of(exposure, batch), targets)

    def with_batch(name: str, label: Any, *last: int) -> Tensor:
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

    def as_given(moved: Tensor) -> Array:
        array: Array = (moved if axes else moved[0]).numpy()
        return array

    labels = PictureLabels()
    if boxes is not None:
        moved = boxes_after(with_batch("boxes", boxes, 4), exposures, size, grow=grow_boxes)
        labels = labels._replace(boxes=as_given(moved))
    if keypoints is not None:
        moved = keypoints_after(with_batch("keypoints", keypoints, 2), exposures, size)
        labels = labels._replace(keypoints=as_given(moved))
    if label_masks is not None:
        moved = masks_after(with_batch("label_masks", label_masks, *size), exposures)
        labels = labels._replace(label_masks=as_given(moved))
    return labels


def _axes_of(shape: Any) -> tuple[tuple[int, ...], tuple[int, int]]:
    """(B,) or (), and (H, W), of the shape of an array of pictures. Raises ``ValueError``."""
    sides = tuple(shape) if isinstance(shape, Sequence) and not isinstance(shape, str) else ()
    if len(sides) not in (2, 3, 4):
        raise ValueError(f"shape = {shown(shape)}: must be (H, W), (H, W, C) or (B, H, W, C)")
    several = len(sides) == 4
    return tuple(integer("shape", n, 1, LARGEST_PICTURE) for n in sides[:several]), picture_size(
        "shape", sides[several:][:2]
    )


def _tensor_of(masks: object) -> Tensor | None:
    """Masks as a tensor. Raises ``TypeError``."""
    if masks is None:
        return None
    try:
        return torch.as_tensor(masks)
    except (TypeError, ValueError, RuntimeError):
        raise TypeError(f"masks = {shown(masks)}: must be an array or tensor (B, N, H, W)") from None


def _to_tensor(image: Array) -> Tensor:
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


def _to_array(pictures: Tensor, like: Array) -> Array:
    """Pictures (B, C, H, W) as an array of the shape and type of ``like``."""
    coded = like.dtype == np.uint8
    planes = pictures.mul(255.0).round_().to(torch.uint8) if coded else pictures
    return planes.permute(0, 2, 3, 1).contiguous().numpy().reshape(like.shape).astype(like.dtype, copy=False)


def _flipped(pictures: Tensor, channels: str) -> Tensor:
    return pictures.flip(1) if channels == "bgr" and pictures.shape[1] == 3 else pictures
