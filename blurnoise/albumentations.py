"""The augmentation of :mod:`blurnoise.training.augmentation` as an albumentations transform; needs albumentations 2.

Domain: images (H, W) or (H, W, C), RGB, uint8 or float32 in [0, 1], each comes back as it came; boxes of any of
albumentations' formats. Convention: all images of one call get the same conditions; each has its own noise.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from albumentations.core.transforms_interface import DualTransform
from albumentations.core.type_definitions import Targets

from blurnoise._core import rng
from blurnoise._core.checks import in_range, one_of
from blurnoise.optics.colour import Encoding
from blurnoise.sensor.readout import Fidelity
from blurnoise.training.arrays import Array, to_array, to_tensor
from blurnoise.training.augmentation import OverConditions, boxes_after, expose_pictures
from blurnoise.training.ranges import Cameras, Draws, ExposureRanges


class RandomExposure(OverConditions, DualTransform):  # type: ignore[misc]  # mypy does not follow albumentations
    """:class:`blurnoise.RandomExposure` for albumentations, with the same ranges, ``p`` and defaults.

    Boxes stay unchanged or, with ``grow_boxes``, grow to the swept boxes; masks and keypoints stay. With ``moves``
    the masks of a call are its targets. All randomness comes from the transform's own generators, which
    ``A.Compose(seed=...)`` sets; ``A.ReplayCompose`` gives the same pixels again.

    Raises ``TypeError`` or ``ValueError`` naming the argument, its value and what is allowed.
    """

    _targets = (Targets.IMAGE, Targets.MASK, Targets.BBOXES, Targets.KEYPOINTS)

    def __init__(
        self,
        camera: Cameras = ExposureRanges.camera,
        *,
        encoding: Encoding = "srgb",
        fidelity: Fidelity = "auto",
        grow_boxes: bool = False,
        p: float = 0.5,
        **ranges: Any,
    ) -> None:
        super().__init__(p=in_range("p", p, 0.0, 1.0))
        self.given = {"camera": camera, **ranges}
        self.ranges = ExposureRanges(**self.given)
        self.flags: dict[str, Any] = {
            "encoding": one_of("encoding", encoding, ("srgb", "linear")),
            "fidelity": one_of("fidelity", fidelity, ("auto", "full")),
            "grow_boxes": grow_boxes,
        }

    def get_transform_init_args(self) -> dict[str, Any]:
        """The arguments of the transform, as albumentations displays and replays them."""
        return {**self.given, **self.flags}

    def get_params_dependent_on_data(self, params: dict[str, Any], data: dict[str, Any]) -> dict[str, Any]:
        """The conditions and noise seed, (1,) each, and the masks, if something is done with them."""
        numbers = self.random_generator.random((1, self.ranges.draws), dtype=np.float32)
        drawn = dict(self.ranges.conditions(torch.from_numpy(numbers)))
        drawn["noise_seed"] = torch.from_numpy(self.random_generator.integers(2**63 - 1, size=1))
        found = [*data.get("masks", ()), *([data["mask"]] if data.get("mask") is not None else [])]
        if found and self.ranges.uses_masks:
            drawn["masks"] = torch.from_numpy(np.stack(found).astype(np.float32))[None]
        return {"drawn": drawn, "ranges": self.ranges}

    def apply(self, img: Array, drawn: dict[str, Any], ranges: Draws, **params: Any) -> Array:
        """The image exposed."""
        batch = img.reshape(1, *img.shape[:2], -1)
        return self.apply_to_images(batch, drawn, ranges).reshape(img.shape)

    def apply_to_images(self, images: Array, drawn: dict[str, Any], ranges: Draws, **params: Any) -> Array:
        """The images (B, H, W, C) exposed."""
        noise = torch.Generator().manual_seed(int(drawn["noise_seed"]))
        conditions = ranges.arguments(drawn, [0] * len(images))
        seeds = rng.item_seeds(noise, len(images))
        flags = {name: self.flags[name] for name in ("encoding", "fidelity")}
        return to_array(expose_pictures(to_tensor(images), **conditions, generator=seeds, **flags), images)

    def apply_to_bboxes(self, bboxes: Array, drawn: dict[str, Any], ranges: Draws, **params: Any) -> Array:
        """The boxes (N, 4 and more) in shares of the image's sides, grown if asked for."""
        grow = self.flags["grow_boxes"]
        if not self._moves_boxes(grow) or not len(bboxes):
            return bboxes
        height, width = params["shape"][:2]
        sides, out = np.array([width, height, width, height], float), bboxes.copy()
        edges = torch.from_numpy(bboxes[:, :4].astype(float) * sides)[None]
        out[:, :4] = boxes_after(edges, drawn, ranges, (height, width), grow=grow)[0].numpy() / sides
        return out

    def apply_to_mask(self, mask: Array, **params: Any) -> Array:
        """The mask as it is."""
        return mask

    def apply_to_keypoints(self, keypoints: Array, **params: Any) -> Array:
        """The keypoints as they are."""
        return keypoints
