"""Augmentations that draw conditions in real units for each picture: Kornia's, and what torchvision's twin shares.

Convention: directions run counter-clockwise as displayed, 0 to the right, as Kornia's angles do. A blur keeps
its centroid, so what moves is swept half the displacement to either side of its place.
"""

from __future__ import annotations

import inspect
from typing import Any, Self

import torch
from kornia.augmentation import IntensityAugmentationBase2D
from kornia.geometry.boxes import Boxes
from torch import Tensor

from blurnoise._core.checks import an_instance, in_range, one_of, shown
from blurnoise.light import effects
from blurnoise.optics.colour import Encoding
from blurnoise.scene.cutting import checked_masks
from blurnoise.sensor.readout import Fidelity
from blurnoise.training.expose import boxes_after, expose_pictures
from blurnoise.training.ranges import Cameras, Draws, ExposureRanges, Params, Range
from blurnoise.training.table import ExposureTable

_RANGES = dict(inspect.signature(ExposureRanges).parameters)
del _RANGES["camera"]
_FAR = [[False, False], [True, False], [True, True], [False, True]]
"""Which corners of Kornia's boxes lie at the right, at the bottom."""


class OverConditions:
    """Shared by the augmentations of Kornia and torchvision: the source of conditions, and the exposure."""

    ranges: Draws

    def __init_subclass__(cls) -> None:
        """Show the ranges, which ``**ranges`` stands for, in the signature."""
        _, *own, _ = inspect.signature(cls.__init__).parameters.values()
        ranges = [each.replace(kind=each.KEYWORD_ONLY) for each in _RANGES.values()]
        cls.__signature__ = inspect.Signature([*own, *ranges])  # type: ignore[attr-defined]

    @classmethod
    def for_run(cls, run: Any, *, direction_deg: Range | None = None, **options: Any) -> Self:
        """The augmentation under the conditions of a finished sweep: its camera, exposures, lights, speeds, gains and
        what moves, as :class:`blurnoise.training.table.ExposureTable` reads and spreads them.

        run: the sweep's folder, or what ``blurnoise_eval.system.urls.location`` makes of its URL. direction_deg:
        of the motion, None: the run's. options: the class's that are no ranges. Raises ``TypeError`` or
        ``ValueError`` naming the argument, ``OSError`` for a file that cannot be read.
        """
        return cls.for_conditions(ExposureTable.of_run(run, direction_deg=direction_deg), **options)

    @classmethod
    def for_conditions(cls, table: ExposureTable, **options: Any) -> Self:
        """The augmentation under the conditions of a table, as ``ExposureTable.of_grid`` makes one."""
        an_instance("table", table, ExposureTable)
        for name in {"camera", *_RANGES} & options.keys():
            raise TypeError(f"{name} = {shown(options[name])}: is stated by the conditions; must be left out")
        augmentation = cls(**options)
        augmentation.ranges = table
        return augmentation

    def _drawn(
        self, count: int, device: torch.device | None = None, dtype: torch.dtype = torch.float32
    ) -> Params:
        """Conditions and noise seeds of so many pictures, (count,) each, by torch's global generator."""
        drawn = self.ranges.conditions(torch.rand(count, self.ranges.draws, device=device, dtype=dtype))
        return {**drawn, "noise_seed": torch.randint(2**63 - 1, (count,), device=device)}

    def _exposed(
        self, pictures: Tensor, params: Params, of: list[int], seeds: list[int], flags: Any
    ) -> Tensor:
        """Pictures exposed under the conditions of these places in ``params``; flags: encoding and fidelity."""
        how = {name: flags[name] for name in ("encoding", "fidelity")}
        return expose_pictures(pictures, **self.ranges.arguments(params, of), generator=seeds, **how)

    def _moves_boxes(self, grow: bool) -> bool:
        return grow or any(map(effects.displace, self.ranges.cameras))


def checked_flags(encoding: Encoding, fidelity: Fidelity, grow_boxes: bool) -> dict[str, Any]:
    """The options of an augmentation that are no ranges. Raises ``ValueError``."""
    return {
        "encoding": one_of("encoding", encoding, ("srgb", "linear")),
        "fidelity": one_of("fidelity", fidelity, ("auto", "full")),
        "grow_boxes": grow_boxes,
    }


class RandomExposure(OverConditions, IntensityAugmentationBase2D):  # type: ignore[misc]
    """Take each picture with a camera under conditions drawn for it: :func:`expose_pictures` for Kornia.

    The ranges are those of :class:`ExposureRanges`, drawn anew for each picture.
    encoding: "srgb" or "linear", of the pictures, before and after. fidelity: as ``simulate`` takes it.
    grow_boxes: let boxes cover what the motion sweeps, half the displacement to each side, but not beyond the
    picture's last pixel (Kornia's boxes end in it); else boxes stay, as masks and keypoints always do.
    same_on_batch, p, keepdim: as everywhere in Kornia; only the pictures that p chooses are computed.

    With masks, ``expose(pictures, masks=masks)``, parts may move for themselves: moves says which.
    Kornia's containers show masks to no augmentation of pictures: there everything moves, and masks come back as they
    are. So let a container do the rest, with data_keys of pictures, boxes and masks, and call this one after it;
    boxes follow by ``expose.transform_boxes(Boxes.from_tensor(boxes), expose._params, expose.flags)``.

    All randomness lies in ``_params``, the noise's too: ``aug(x, params=aug._params)`` gives the same bits.
    A camera's fixed pattern is one specimen's, the same part of it for pictures of one size; it is drawn once.
    Under ``torch.compile`` the exposure itself runs uncompiled: equal ``_params`` give equal pictures. The draws are
    the compiler's, whose random numbers may differ from torch's own for the same seed.

    Raises ``TypeError`` or ``ValueError`` naming the argument, its value and what is allowed.
    """

    def __init__(
        self,
        camera: Cameras = ExposureRanges.camera,
        *,
        encoding: Encoding = "srgb",
        fidelity: Fidelity = "auto",
        grow_boxes: bool = False,
        same_on_batch: bool = False,
        p: float = 0.5,
        keepdim: bool = False,
        **ranges: Any,
    ) -> None:
        super().__init__(p=in_range("p", p, 0.0, 1.0), same_on_batch=same_on_batch, keepdim=keepdim)
        self.ranges = ExposureRanges(camera, **ranges)
        self.flags = checked_flags(encoding, fidelity, grow_boxes)

    def __repr__(self) -> str:
        return str(super().__repr__().replace("(", f"({self.ranges}, ", 1))

    def generate_parameters(self, batch_shape: tuple[int, ...]) -> Params:
        """Conditions and noise seeds for a batch, (B,) each; under ``same_on_batch`` they are equal."""
        batch = batch_shape[0]
        # half precision has too few exposures and directions
        dtype = torch.promote_types(self.dtype, torch.float32)
        drawn = self._drawn(min(batch, 1) if self.same_on_batch else batch, self.device, dtype)
        return {name: value.expand(batch).clone() for name, value in drawn.items()}

    def forward(
        self, input: Tensor, params: Params | None = None, masks: Tensor | None = None, **kwargs: Any
    ) -> Tensor:
        """The pictures (B, C, H, W), or one (C, H, W), exposed; masks as :func:`expose_pictures` takes them.

        Of one picture masks are (N, H, W). They are kept in ``_params``, as a replay needs them.
        """
        if masks is not None:
            batch = self.transform_tensor(input)
            own = masks[None] if input.ndim == 3 and masks.ndim == 3 else masks
            own = checked_masks(own, len(batch), (batch.shape[-2], batch.shape[-1]))
            params = {**(self.forward_parameters(batch.shape) if params is None else params), "masks": own}
        seen: Tensor = super().forward(input, params, **kwargs)
        return seen

    @torch.compiler.disable  # type: ignore[untyped-decorator]  # threads, seeds and plans are Python
    def apply_transform(
        self, input: Tensor, params: Params, flags: dict[str, Any], transform: Tensor | None = None
    ) -> Tensor:
        """The pictures that ``batch_prob`` chooses, exposed; the others as they are."""
        every = self.p == 1 and self.p_batch == 1  # then Kornia has no gate
        gates = params["batch_prob"].tolist()
        chosen = [item for item in range(len(input)) if every or gates[item] > 0.5]
        if not chosen:
            return input
        seeds = params["noise_seed"][chosen].tolist()
        exposed = self._exposed(input[chosen], params, chosen, seeds, flags)
        return input.index_put((torch.tensor(chosen, device=input.device),), exposed)

    def apply_transform_box(
        self, input: Boxes, params: Params, flags: dict[str, Any], transform: Tensor | None = None
    ) -> Boxes:
        """The boxes at mid-exposure, grown by what the motion sweeps where ``grow_boxes`` asks for it."""
        if not self._moves_boxes(flags["grow_boxes"]):
            return input
        corners = input.data if input.data.ndim == 4 else input.data[None]  # (B, N, 4, 2) or (N, 4, 2)
        low, high = corners.double().amin(-2, keepdim=True), corners.double().amax(-2, keepdim=True)
        edges = torch.cat([low, high + 1], -1)[..., 0, :]  # the last pixel's outer edge
        height, width = params["forward_input_shape"][-2:].tolist()
        moved = boxes_after(edges, params, self.ranges, (height, width), grow=flags["grow_boxes"])[
            ..., None, :
        ]
        share = (corners - low) / (high - low)
        share = torch.where(high > low, share, corners.new_tensor(_FAR))  # of boxes of one pixel
        out = input.clone()
        out.data.copy_((moved[..., :2] + share * (moved[..., 2:] - 1 - moved[..., :2])).view_as(out.data))
        return out
