"""Kornia's augmentation that takes each picture as a camera would, under conditions drawn from ranges or a table.

Domain: pictures (B, C, H, W) as :mod:`blurnoise.training.pictures` takes them, labels as
:mod:`blurnoise.training.labels` has them.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import fields, replace
from typing import Any, Self

import torch
from kornia.augmentation import IntensityAugmentationBase2D
from kornia.geometry.boxes import Boxes
from kornia.geometry.keypoints import Keypoints
from torch import Tensor

from blurnoise._core import rng
from blurnoise._core.beams import checked_planes
from blurnoise._core.checks import (
    an_instance,
    dense,
    in_range,
    one_of,
    shown,
)
from blurnoise._core.threads import no_torch_compile
from blurnoise.camera.colour import PictureTone, picture_tone
from blurnoise.light import effects
from blurnoise.scene.cutting import checked_masks
from blurnoise.scene.exposure import Exposure
from blurnoise.scene.metering import GreyAnchor
from blurnoise.sensor.readout import Fidelity
from blurnoise.training.labels import (
    boxes_after,
    keypoints_after,
    masks_after,
    of_targets,
)
from blurnoise.training.pictures import expose_pictures
from blurnoise.training.ranges import ExposureRanges
from blurnoise.training.source import Cameras, ExposureSource, Params, Range
from blurnoise.training.table import ExposureTable

_FAR = [[False, False], [True, False], [True, True], [False, True]]
"""Which corners of Kornia's boxes lie at the right, at the bottom."""


class OverConditions:
    """Shared by the augmentations of all libraries: where exposures are drawn from, and pictures and labels by them.

    ranges: ranges or a table. flags: encoding, grey_anchor, fidelity and grow_boxes.

    >>> expose = RandomExposure("imx250", exposure_s=0.01, illuminance_lux=50.0)
    >>> isinstance(expose, OverConditions), expose.flags["encoding"]
    (True, 'srgb')
    """

    ranges: ExposureSource
    flags: dict[str, Any]

    def set_conditions(
        self,
        camera: Cameras | None = None,
        *,
        table: ExposureTable | None = None,
        encoding: PictureTone | None = None,
        grey_anchor: str | None = None,
        fidelity: Fidelity = "auto",
        grow_boxes: bool = False,
        **ranges: Any,
    ) -> None:
        """Check and keep the arguments that all augmentations have.

        ranges: fields of :class:`ExposureRanges`. table: in place of camera and ranges. encoding, grey_anchor: of the
        pictures; by default those of the table, or "srgb" and None.
        """
        known = [field.name for field in fields(ExposureRanges) if field.name != "camera"]
        if unknown := sorted(ranges.keys() - set(known)):
            raise TypeError(f"{unknown[0]}: is no range of conditions; ranges are {', '.join(known)}")
        if camera is not None:
            ranges["camera"] = camera
        if table is not None:
            an_instance("table", table, ExposureTable)
            for name, value in ranges.items():
                raise TypeError(f"{name} = {shown(value)}: is part of the table; must not be given")
        self.ranges = ExposureRanges(**ranges) if table is None else table
        usual, own = ("srgb", None) if table is None else (table.encoding, table.grey_anchor)
        anchor = own if grey_anchor is None else grey_anchor
        self.flags = {
            "encoding": picture_tone(usual if encoding is None else encoding),
            "grey_anchor": None if anchor is None else str(GreyAnchor.parse(anchor)),
            "fidelity": one_of("fidelity", fidelity, ("auto", "full")),
            "grow_boxes": grow_boxes,
        }

    @classmethod
    def for_run(cls, run: Any, *, direction_deg: Range | None = None, **options: Any) -> Self:
        """The augmentation under the conditions of a finished sweep.

        The conditions are the sweep's cameras, exposures, lights, speeds, gains and ``moves``, as
        :class:`blurnoise.training.table.ExposureTable` reads and interpolates them. run: the sweep's folder, or
        ``blurnoise_eval.system.urls.location(URL)``. direction_deg: of the motion; None: as in the run. options: the
        options of the class that are not ranges; encoding and grey_anchor are by default those of the run. Raises
        ``TypeError`` or ``ValueError`` naming the argument, ``OSError`` for a file that cannot be read.
        """
        options["table"] = ExposureTable.of_run(run, direction_deg=direction_deg)
        return cls(**options)

    def _drawn(self, count: int, dtype: torch.dtype, device: torch.device | None = None) -> Params:
        """Conditions and noise seeds of so many pictures, (count,) each, by torch's global generator."""
        drawn = self.ranges.conditions(torch.rand(count, self.ranges.draws, device=device, dtype=dtype))
        return {**drawn, "noise_seed": torch.randint(2**63 - 1, (count,), device=device)}

    def _exposed(self, pictures: Tensor, params: Params, items: list[int], seeds: list[int]) -> Tensor:
        """Pictures (B, C, H, W), each taken under the conditions of an item of ``params``, with a seed of its own."""
        dtype = torch.promote_types(pictures.dtype, torch.float32)  # halves are computed in single precision
        exposures, lit = self.ranges.exposures(params, items, seeds, dtype), "headlamp_lux" in params
        beams = self.ranges.beams(params, items) if lit else ["off"] * len(items)
        return expose_pictures(
            pictures,
            [replace(one, headlamp=beam) for one, beam in zip(exposures, beams, strict=True)],
            masks=params["masks"][items] if "masks" in params else None,
            headlamp_lux=dict.fromkeys({*beams} - {"off"}, params["headlamp_lux"][items]) if lit else {},
            lamp_lights=self.ranges.lamp_lights,
            encoding=self.flags["encoding"],
            grey_anchor=self.flags["grey_anchor"],
            fidelity=self.flags["fidelity"],
        )

    def _of_targets(self, params: Params) -> list[Exposure]:
        """The exposure of each picture's targets."""
        return of_targets(self.ranges.exposures(params), params.get("masks"))

    @property
    def _moves_labels(self) -> bool:
        """Whether a camera moves labels: by distortion, or by rows that are exposed in turn."""
        return any(map(effects.displace, self.ranges.cameras))


class RandomExposure(OverConditions, IntensityAugmentationBase2D):  # type: ignore[misc]
    """Take each picture with a camera under random conditions: :func:`expose_pictures` as a Kornia augmentation.

    options: the ranges of :class:`ExposureRanges`, drawn anew for each picture, or table, an :class:`ExposureTable`
    in place of camera and ranges; encoding, grey_anchor, fidelity, grow_boxes. Cameras may have several captures
    (HDR), and lamps may be pulsed.
    encoding: the pictures' tone curve, see :func:`blurnoise.simulate`; the result has the camera's tone curve, or is
    linear if encoding is "linear". grey_anchor: the part of each picture that reflects 18 %, such as "mean"; by
    default brightness is reflectance, so a photograph that is darker by 1 EV gets half of the light. fidelity: see
    :func:`blurnoise.simulate`.
    grow_boxes: grow boxes to the swept boxes, by half the displacement to each side, at most to the picture's last
    pixel (Kornia's boxes include it). Boxes, masks and keypoints are as at mid-exposure
    (:mod:`blurnoise.training.labels`).
    same_on_batch, p, keepdim: as in Kornia; only the pictures that p selects are computed.

    With masks, ``expose(pictures, masks=masks)``, parts of the picture can move: ``moves`` selects them.
    Kornia's containers do not pass masks to augmentations of pictures: there everything moves. So use a container
    for the other augmentations, with data_keys of pictures, boxes and masks, and call this one after it; transform
    boxes by
    ``expose.transform_boxes(Boxes.from_tensor(boxes), expose._params, expose.flags)``, and masks by
    ``expose.transform_masks(masks, expose._params, expose.flags)``.

    ``_params`` holds all randomness, the noise included: ``aug(x, params=aug._params)`` gives the same bits.
    The fixed pattern is that of one specimen of the camera, the same for all pictures of one size; it is drawn once.
    Under ``torch.compile`` the exposure itself runs uncompiled: equal ``_params`` give equal pictures. The compiler
    draws the conditions, and its random numbers may differ from torch's own for the same seed.

    Raises ``TypeError`` or ``ValueError`` naming the argument, its value and what is allowed.

    >>> import torch
    >>> from blurnoise import RandomExposure
    >>> expose = RandomExposure("imx250", exposure_s=(0.001, 0.02), illuminance_lux=(5.0, 500.0), p=1.0)
    >>> grey = torch.full((4, 3, 32, 48), 0.5)
    >>> pictures = expose(grey)
    >>> bool((expose(grey, params=expose._params) == pictures).all())  # the same conditions and noise again
    True
    """

    def __init__(
        self,
        camera: Cameras | None = None,
        *,
        same_on_batch: bool = False,
        p: float = 0.5,
        keepdim: bool = False,
        **options: Any,
    ) -> None:
        super().__init__(p=in_range("p", p, 0.0, 1.0), same_on_batch=same_on_batch, keepdim=keepdim)
        self.set_conditions(camera, **options)

    def __repr__(self) -> str:
        return str(super().__repr__().replace("(", f"({self.ranges}, ", 1))

    def generate_parameters(self, batch_shape: tuple[int, ...]) -> Params:
        """Conditions and noise seeds for a batch, (B,) each; under ``same_on_batch`` they are equal."""
        batch = batch_shape[0]
        # half precision has too few exposures and directions
        dtype = torch.promote_types(self.dtype, torch.float32)
        drawn = self._drawn(min(batch, 1) if self.same_on_batch else batch, dtype, self.device)
        return {name: value.expand(batch).clone() for name, value in drawn.items()}

    def forward(
        self,
        input: Tensor,
        params: Params | None = None,
        masks: Tensor | None = None,
        headlamp_lux: Tensor | None = None,
        **kwargs: Any,
    ) -> Tensor:
        """The pictures (B, C, H, W), or one (C, H, W), exposed; masks as :func:`expose_pictures` takes them.

        Of one picture masks are (N, H, W). headlamp_lux: what headlamps add to the illuminance that is drawn, lux,
        (B, 1, H, W) or (1, 1, H, W); where a named light has its headlamps off, nothing. Both are kept in
        ``_params``, as a replay needs them.
        """
        an_instance("input", input, Tensor)
        dense("input", input)
        if headlamp_lux is not None:
            batch = self.transform_tensor(input)
            of_batch = len(batch), 1, *batch.shape[-2:]
            plane = checked_planes("headlamp_lux", {"low": headlamp_lux}, of_batch, (1, *of_batch[1:]))["low"]
            params = self.forward_parameters(batch.shape) if params is None else params
            params = {**params, "headlamp_lux": plane.expand(of_batch)}
        if masks is not None:
            batch = self.transform_tensor(input)
            masks = masks[None] if input.ndim == 3 and masks.ndim == 3 else masks
            masks = checked_masks(masks, len(batch), (batch.shape[-2], batch.shape[-1]))
            params = {**(self.forward_parameters(batch.shape) if params is None else params), "masks": masks}
        exposed: Tensor = super().forward(input, params, **kwargs)
        return exposed

    def _noise_seeds(self, params: Params) -> list[int]:
        """Seeds of all pictures; frames of a clip, which share their conditions, get different ones."""
        seeds: list[int] = params["noise_seed"].tolist()
        if self.same_on_batch or len({*seeds}) == len(seeds):
            return seeds
        frames: Counter[int] = (
            Counter()
        )  # Kornia repeats a clip's parameters, seed included, for all its frames
        for item, seed in enumerate(seeds):
            seeds[item] = rng.derived(seed, f"frame {frames[seed]}") if frames[seed] else seed
            frames[seed] += 1
        return seeds

    @no_torch_compile
    def apply_transform(
        self, input: Tensor, params: Params, flags: dict[str, Any], transform: Tensor | None = None
    ) -> Tensor:
        """The pictures that ``batch_prob`` chooses, exposed; the others as they are."""
        every = self.p == 1 and self.p_batch == 1  # then Kornia has no gate
        gates = params["batch_prob"].tolist()
        chosen = [item for item in range(len(input)) if every or gates[item] > 0.5]
        if not chosen:
            return input
        of_all = self._noise_seeds(params)
        seeds = [of_all[item] for item in chosen]
        if len(chosen) == len(input):
            return self._exposed(input, params, chosen, seeds)
        exposed = self._exposed(input[chosen], params, chosen, seeds)
        return input.index_put((torch.tensor(chosen, device=input.device),), exposed)

    def apply_transform_box(
        self, input: Boxes, params: Params, flags: dict[str, Any], transform: Tensor | None = None
    ) -> Boxes:
        """The boxes at mid-exposure, or the swept boxes if ``grow_boxes`` is set."""
        grow = flags["grow_boxes"]
        if not grow and not self._moves_labels:
            return input
        corners = input.data if input.data.ndim == 4 else input.data[None]  # (B, N, 4, 2) or (N, 4, 2)
        # Kornia's boxes name their last pixels; ours end at the outer edges of these.
        low, high = corners.double().amin(-2, keepdim=True), corners.double().amax(-2, keepdim=True)
        edges = torch.cat([low, high + 1], -1)[..., 0, :]
        moved = boxes_after(edges, self._of_targets(params), _size(params), grow=grow)[..., None, :]
        share = (corners - low) / (high - low)
        share = torch.where(high > low, share, corners.new_tensor(_FAR))  # a box of one pixel has no share
        out = input.clone()
        out.data.copy_((moved[..., :2] + share * (moved[..., 2:] - 1 - moved[..., :2])).view_as(out.data))
        return out

    def apply_transform_keypoint(
        self, input: Keypoints, params: Params, flags: dict[str, Any], transform: Tensor | None = None
    ) -> Keypoints:
        """The keypoints at mid-exposure."""
        if not self._moves_labels:
            return input
        points = input.data if input.data.ndim == 3 else input.data[None]  # (B, N, 2) or (N, 2)
        out = input.clone()
        out.data.copy_(keypoints_after(points, self._of_targets(params), _size(params)).view_as(out.data))
        return out

    def apply_transform_mask(
        self, input: Tensor, params: Params, flags: dict[str, Any], transform: Tensor | None = None
    ) -> Tensor:
        """The masks (B, C, H, W) at mid-exposure."""
        if not self._moves_labels:
            return input
        if tuple(input.shape[-2:]) != _size(params):
            raise ValueError(
                f"masks: shape {tuple(input.shape)}; must have the pictures' size {_size(params)}"
            )
        return masks_after(input, self._of_targets(params))


def _size(params: Params) -> tuple[int, int]:
    height, width = params["forward_input_shape"][-2:].tolist()
    return height, width
