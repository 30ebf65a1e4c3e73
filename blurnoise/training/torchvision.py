"""The augmentation of :mod:`blurnoise.training.augmentation` as a torchvision v2 transform; needs torchvision.

Domain: images and videos (..., C, H, W), uint8 or float in [0, 1], and PIL images; each comes back as it came,
uint8 rounded. Convention: as in v2, all images of one call get the same conditions; each frame has its own noise.
"""

from __future__ import annotations

from typing import Any

import PIL.Image
import torch
from torch import Tensor

try:
    from torchvision import tv_tensors
    from torchvision.transforms import v2
except RuntimeError as error:  # "operator torchvision::nms does not exist"
    raise ImportError(
        f"torchvision and torch are different builds ({error}); install both in one command, for example the CPU "
        "builds of PyTorch's page 'Get started'"
    ) from error

from blurnoise._core import rng
from blurnoise._core.checks import in_range, one_of
from blurnoise.training.augmentation import OverConditions
from blurnoise.training.labels import boxes_after, keypoints_after, masks_after
from blurnoise.training.source import Cameras

_POINTS = getattr(tv_tensors, "KeyPoints", tv_tensors.Mask)  # from torchvision 0.23 on
_LABELS = (tv_tensors.BoundingBoxes, tv_tensors.Mask, _POINTS)


class RandomExposureV2(OverConditions, v2.Transform):  # type: ignore[misc]  # torchvision is not followed by mypy
    """:class:`blurnoise.RandomExposure` for torchvision's v2, with the same ranges, ``p`` and defaults.

    Boxes, keypoints and masks (of a video, of all its frames) are as at mid-exposure
    (:mod:`blurnoise.training.labels`), in whole pixels if they are integers; ``grow_boxes`` grows boxes to the swept
    boxes. ``make_params`` draws everything, the noise seed included, from torch's generator:
    ``transform`` with the same parameters gives the same bits. With ``moves`` all masks of a sample, (N, H, W) within
    [0, 1], are its targets, in every frame of a video.

    Raises ``TypeError`` or ``ValueError`` naming the argument, its value and what is allowed; ``TypeError`` for
    pictures that are neither uint8 nor float, and for rotated boxes that would have to move.

    >>> expose = RandomExposureV2("imx250", exposure_s=0.01, illuminance_lux=50.0, p=1.0)
    >>> picture = tv_tensors.Image(torch.full((3, 32, 48), 128, dtype=torch.uint8))
    >>> expose(picture).shape, expose(picture).dtype
    (torch.Size([3, 32, 48]), torch.uint8)
    """

    def __init__(self, camera: Cameras | None = None, *, p: float = 0.5, **options: Any) -> None:
        super().__init__()
        self.set_conditions(camera, **options)
        self.p = in_range("p", p, 0.0, 1.0)

    def extra_repr(self) -> str:
        """The ranges, then the rest."""
        return f"{self.ranges}, {super().extra_repr()}"

    def make_params(self, flat_inputs: list[Any]) -> dict[str, Any]:
        """Conditions and noise seed, (1,) each, whether they apply, and the masks if the conditions use them."""
        drawn = {**self._drawn(1, torch.float32), "applies": bool(torch.rand(()) < self.p)}
        masks = [each.as_subclass(Tensor) for each in flat_inputs if isinstance(each, tv_tensors.Mask)]
        if masks and self.ranges.uses_masks:
            drawn["masks"] = torch.cat([mask.reshape(-1, *mask.shape[-2:]) for mask in masks])[None]
        return drawn

    def transform(self, inpt: Any, params: dict[str, Any]) -> Any:
        """One input under ``params``: an image or video exposed, labels at mid-exposure, anything else unchanged."""
        if not params["applies"]:
            return inpt
        if isinstance(inpt, _LABELS):
            return self._label(inpt, params)
        if isinstance(inpt, PIL.Image.Image):
            one_of("image: PIL mode", inpt.mode, ("L", "RGB"))
            picture = v2.functional.pil_to_tensor(inpt)
            return v2.functional.to_pil_image(self._frames(picture, params), mode=inpt.mode)
        pictures = (tv_tensors.Image, tv_tensors.Video)
        if isinstance(inpt, tv_tensors.TVTensor) and not isinstance(inpt, pictures):
            return inpt
        exposed = self._frames(inpt.as_subclass(Tensor), params)
        return tv_tensors.wrap(exposed, like=inpt) if isinstance(inpt, tv_tensors.TVTensor) else exposed

    def _frames(self, picture: Tensor, params: dict[str, Any]) -> Tensor:
        coded = picture.dtype == torch.uint8
        if not coded and not picture.is_floating_point():
            raise TypeError(f"image: must be uint8 or float in [0, 1], got {picture.dtype}")
        frames = (picture.float() / 255 if coded else picture).reshape(-1, *picture.shape[-3:])
        noise = torch.Generator().manual_seed(int(params["noise_seed"]))
        seeds = rng.item_seeds(noise, len(frames))
        exposed = self._exposed(frames, params, [0] * len(frames), seeds).reshape(picture.shape)
        return exposed.mul(255).round().to(torch.uint8) if coded else exposed

    def _label(self, label: Any, params: dict[str, Any]) -> Any:
        """A mask, keypoints or boxes at mid-exposure."""
        if isinstance(label, tv_tensors.BoundingBoxes):
            moves = self.flags["grow_boxes"] or self._moves_labels
            return tv_tensors.wrap(self._boxes(label, params), like=label) if moves else label
        if not self._moves_labels:
            return label
        plain, exposures = label.as_subclass(Tensor), self._of_targets(params)
        if isinstance(label, tv_tensors.Mask):
            return tv_tensors.wrap(masks_after(plain[None], exposures)[0], like=label)
        points = plain.reshape(1, -1, 2).double()
        moved = keypoints_after(points, exposures, label.canvas_size).view(plain.shape)
        return tv_tensors.wrap((moved if plain.is_floating_point() else moved.round()).to(plain), like=label)

    def _boxes(self, boxes: Any, params: dict[str, Any]) -> Tensor:
        if boxes.format.value not in ("XYXY", "XYWH", "CXCYWH"):
            cause = "grow_boxes" if self.flags["grow_boxes"] else "a rolling shutter or distortion"
            raise TypeError(
                f"boxes: rotated boxes ({boxes.format.value}) cannot be moved by {cause}; must be upright"
            )
        upright = tv_tensors.BoundingBoxFormat.XYXY
        edges = v2.functional.convert_bounding_box_format(boxes, new_format=upright).as_subclass(Tensor)
        moved = boxes_after(
            edges.reshape(1, -1, 4).double(),
            self._of_targets(params),
            boxes.canvas_size,
            grow=self.flags["grow_boxes"],
        ).view_as(edges)
        if not edges.is_floating_point():  # the smallest whole box that contains it
            moved = torch.cat([moved[..., :2].floor(), moved[..., 2:].ceil()], -1)
        back = v2.functional.convert_bounding_box_format(
            moved.to(edges), old_format=upright, new_format=boxes.format
        )
        plain: Tensor = back.as_subclass(Tensor)
        return plain
