"""The augmentation of :mod:`blurnoise.training.augmentation` for albumentations 2 and its successor AlbumentationsX.

Domain: images (H, W) or (H, W, C), RGB or BGR, uint8 or float32 in [0, 1], each comes back as it came; boxes in any
format of albumentations. Convention: all images of one call get the same conditions; each has its own noise.
"""

from __future__ import annotations

import random
from collections.abc import Mapping
from dataclasses import asdict, fields, is_dataclass
from functools import partial
from typing import Any

import numpy as np
import torch
from albumentations.core.transforms_interface import DualTransform
from albumentations.core.type_definitions import Targets
from torch.utils.data import get_worker_info

from blurnoise._core import rng
from blurnoise._core.checks import in_range, one_of
from blurnoise.camera import Camera
from blurnoise.camera.spectra import Curve
from blurnoise.light.lights import Light
from blurnoise.motion.ego import Vehicle
from blurnoise.scene.exposure import Exposure
from blurnoise.scene.metering import AutoExposure
from blurnoise.training.arrays import CHANNELS, Array, expose_numpy
from blurnoise.training.augmentation import OverConditions
from blurnoise.training.labels import boxes_after, keypoints_after, of_targets, pixels_after
from blurnoise.training.ranges import ExposureRanges
from blurnoise.training.source import Cameras, ExposureSource
from blurnoise.training.table import ConditionRow, ExposureTable

try:
    from albumentations.core.transform_params import SampledParams  # AlbumentationsX
except ImportError:
    SampledParams = None

_TARGETS = (
    "IMAGE", "IMAGES", "MASK", "MASKS", "BBOXES", "KEYPOINTS", "VOLUME", "VOLUMES", "MASK3D", "MASKS3D",
)  # fmt: skip
_RECORDS: dict[str, type] = {
    "camera": Camera, "gain_db": AutoExposure, "vehicle": Vehicle, "illuminant": Curve, "light": Light,
}  # fmt: skip
"""Arguments that ``A.to_dict`` writes as mappings."""


class RandomExposure(OverConditions, DualTransform):  # type: ignore[misc]  # mypy does not follow albumentations
    """:class:`blurnoise.RandomExposure` for albumentations, with the same ranges, ``p`` and defaults.

    Boxes, keypoints and masks are as at mid-exposure (:mod:`blurnoise.training.labels`); ``grow_boxes`` grows boxes
    to the swept boxes. With ``moves`` the masks of a call are its targets. channels: order of the images' channels,
    "rgb" or, as OpenCV and Ultralytics have it, "bgr".

    All randomness comes from the transform's own generators, which ``A.Compose(seed=...)`` sets; in workers of a
    ``DataLoader`` they start from torch's seed of the worker too, so that workers and epochs differ.
    ``A.ReplayCompose`` and ``A.from_dict`` of ``A.to_dict`` give the same pixels again.

    Raises ``TypeError`` or ``ValueError`` naming the argument, its value and what is allowed.

    >>> expose = RandomExposure("imx250", exposure_s=0.01, illuminance_lux=50.0, channels="bgr", p=1.0)
    >>> expose(image=np.full((32, 48, 3), 128, np.uint8))["image"].shape
    (32, 48, 3)
    """

    _targets = tuple(Targets[name] for name in _TARGETS if name in Targets.__members__)
    _worker_seed: int | None = None

    def __init__(
        self,
        camera: Cameras | Mapping[str, Any] | None = None,
        *,
        channels: str = "rgb",
        table: ExposureTable | Mapping[str, Any] | None = None,
        p: float = 0.5,
        **options: Any,
    ) -> None:
        super().__init__(p=in_range("p", p, 0.0, 1.0))
        self.channels = one_of("channels", channels, CHANNELS)
        opened = table if table is None or isinstance(table, ExposureTable) else _table(table)
        self.set_conditions(**_opened({"camera": camera, **options}), table=opened)

    def get_transform_init_args(self) -> dict[str, Any]:
        """The arguments of the transform, as albumentations displays, saves and replays them."""
        source: Any = self.ranges
        values = {field.name: _plain(getattr(source, field.name)) for field in fields(source)}
        ranges = values if isinstance(source, ExposureRanges) else {"table": values}
        return {**ranges, **_plain(self.flags), "channels": self.channels}

    @classmethod
    def _get_valid_config_keys(cls) -> frozenset[str]:
        """Arguments that AlbumentationsX reports of an applied transform, the ranges included."""
        flags = {"encoding", "fidelity", "grow_boxes", "channels", "table", "p"}
        return frozenset({field.name for field in fields(ExposureRanges)} | flags)

    def __repr__(self) -> str:
        return f"RandomExposure({self.ranges}, p={self.p:g})"

    def __call__(self, *args: Any, **data: Any) -> Any:
        """Apply the transform; the first call in a worker mixes the worker's seed into the generators."""
        worker = get_worker_info() if SampledParams is None else None  # AlbumentationsX does it itself
        if worker is not None and worker.seed != self._worker_seed:
            self._worker_seed = worker.seed
            seed = rng.derived(int(self.random_generator.integers(2**63)), f"worker {worker.seed}")
            self.set_random_state(np.random.default_rng(seed), random.Random(seed))
        return super().__call__(*args, **data)

    def add_targets(self, additional_targets: dict[str, str]) -> None:
        """Further names of targets; each image has its own noise."""
        super().add_targets(additional_targets)
        for name, of in additional_targets.items():
            if of == "image" and name in self._key2func:
                self._key2func[name] = partial(self.apply, stream=name)

    if SampledParams is None:

        def get_params_dependent_on_data(self, params: Any, data: dict[str, Any]) -> dict[str, Any]:
            """The parameters of a call, for albumentations 2.0."""
            return self._drawn_for(data, self.random_generator)
    else:

        def sample_parameters(self, params: Any, data: dict[str, Any], targets: Any, sampling: Any) -> Any:
            """The parameters of a call, for AlbumentationsX."""
            return SampledParams(params=self._drawn_for(data, sampling.random_generator))

    def _drawn_for(self, data: dict[str, Any], generator: np.random.Generator) -> dict[str, Any]:
        """The conditions and noise seed, (1,) each, and the masks if the conditions use them."""
        numbers = generator.random((1, self.ranges.draws), dtype=np.float32)
        drawn = dict(self.ranges.conditions(torch.from_numpy(numbers)))
        drawn["noise_seed"] = torch.from_numpy(generator.integers(2**63 - 1, size=1))
        masks = [] if data.get("masks") is None else [*data["masks"]]
        masks += [] if data.get("mask") is None else [data["mask"]]
        if masks and self.ranges.uses_masks:
            planes = [mask.reshape(*mask.shape[:2], -1).max(-1) for mask in map(np.asarray, masks)]
            drawn["masks"] = torch.from_numpy(np.stack(planes).astype(np.float32))[None]
        return {"drawn": drawn, "ranges": self.ranges}

    def apply(
        self, img: Array, drawn: dict[str, Any], ranges: ExposureSource, *, stream: str = "", **params: Any
    ) -> Array:
        """The image exposed."""
        batch = img.reshape(1, *img.shape[:2], -1)
        return self.apply_to_images(batch, drawn, ranges, stream=stream).reshape(img.shape)

    def apply_to_images(
        self, images: Array, drawn: dict[str, Any], ranges: ExposureSource, *, stream: str = "", **params: Any
    ) -> Array:
        """The images (B, H, W, C) or (B, H, W) exposed."""
        if not len(images):
            return images
        seed = int(drawn["noise_seed"])
        noise = torch.Generator().manual_seed(rng.derived(seed, stream) if stream else seed)
        items = [0] * len(images)
        exposed = expose_numpy(
            images if images.ndim == 4 else images[..., None],
            ranges.exposures(drawn, items, rng.item_seeds(noise, len(images)), torch.float32),
            channels=self.channels,
            masks=drawn["masks"][items] if "masks" in drawn else None,
            lamp_lights=ranges.lamp_lights,
            encoding=self.flags["encoding"],
            fidelity=self.flags["fidelity"],
        )
        return exposed.reshape(images.shape)

    def apply_to_bboxes(
        self, bboxes: Array, drawn: dict[str, Any], ranges: ExposureSource, **params: Any
    ) -> Array:
        """The boxes (N, 4 and more) in shares of the image's sides, at mid-exposure, grown if asked for."""
        grow = self.flags["grow_boxes"]
        if not (grow or self._moves_labels) or not len(bboxes):
            return bboxes
        height, width = params["shape"][:2]
        sides, out = np.array([width, height, width, height], float), bboxes.copy()
        edges = torch.from_numpy(bboxes[:, :4].astype(float) * sides)[None]
        out[:, :4] = (
            boxes_after(edges, _of_targets(drawn, ranges), (height, width), grow=grow)[0].numpy() / sides
        )
        return out

    def apply_to_keypoints(
        self, keypoints: Array, drawn: dict[str, Any], ranges: ExposureSource, **params: Any
    ) -> Array:
        """The keypoints (N, 2 and more) at mid-exposure."""
        out = keypoints.copy()
        if self._moves_labels and len(keypoints):
            points = torch.from_numpy(keypoints[:, :2].astype(float))[None]
            moved = keypoints_after(points, _of_targets(drawn, ranges), params["shape"][:2])
            out[:, :2] = moved[0].numpy()
        return out

    def apply_to_mask(
        self, mask: Array, drawn: dict[str, Any], ranges: ExposureSource, **params: Any
    ) -> Array:
        """The mask (H, W) or (H, W, C) at mid-exposure."""
        moved: Array = self.apply_to_masks(mask[None], drawn, ranges)[0]
        return moved

    def apply_to_masks(
        self, masks: Array, drawn: dict[str, Any], ranges: ExposureSource, **params: Any
    ) -> Array:
        """The masks (N, H, W) or (N, H, W, C) at mid-exposure."""
        masks = np.asarray(masks)
        if not self._moves_labels or not len(masks):
            return masks
        pixels = pixels_after(_of_targets(drawn, ranges)[0], masks.shape[1:3])
        if pixels is None:
            return masks
        row, column, inside = pixels
        inside = inside[..., None] if masks.ndim == 4 else inside
        moved: Array = np.where(inside, masks[:, row, column], np.zeros((), masks.dtype))
        return moved

    apply_to_mask3d = apply_to_masks


def _of_targets(drawn: dict[str, Any], ranges: ExposureSource) -> list[Exposure]:
    """The exposure of the targets, as a list of one."""
    return of_targets(ranges.exposures(drawn), drawn.get("masks"))


def _plain(value: Any) -> Any:
    """Records as mappings and tuples as lists, so that JSON and YAML can hold them."""
    if isinstance(value, Camera):
        return value.to_dict()
    if is_dataclass(value) and not isinstance(value, type):
        return asdict(value)
    if isinstance(value, Mapping):
        return {name: _plain(each) for name, each in value.items()}
    return [_plain(item) for item in value] if isinstance(value, (tuple, list)) else value


def _opened(arguments: Mapping[str, Any]) -> dict[str, Any]:
    """Arguments with records in place of their mappings."""
    return {
        name: _record(_RECORDS[name], given) if name in _RECORDS else given
        for name, given in arguments.items()
    }


def _record(kind: type, given: Any) -> Any:
    if isinstance(given, (list, tuple)):
        return [_record(kind, one) for one in given]
    if not isinstance(given, Mapping):
        return given
    return Camera.from_dict(given) if kind is Camera else kind(**given)


def _table(saved: Mapping[str, Any]) -> ExposureTable:
    rows = tuple(ConditionRow(*row) for row in saved["rows"])
    return ExposureTable(**{**_opened(saved), "rows": rows})
