"""Training pictures as cameras would take them: a Kornia augmentation that draws conditions in real units.

Domain: pictures (B, C, H, W) in [0, 1], sRGB-coded or linear, of any float type; the result has the same shape,
type and range. Values down to -1 and up to 2, which earlier augmentations leave, are clamped. Without a gain,
little light gives a dark picture.

Convention: directions run counter-clockwise as displayed, 0 to the right, as Kornia's angles do. A blur keeps
its centroid, so what moves is swept half the displacement to either side of its place.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Self

import torch
from kornia.augmentation import IntensityAugmentationBase2D
from kornia.augmentation.random_generator import RandomGeneratorBase, UniformDistribution
from kornia.geometry.boxes import Boxes
from torch import Tensor

from blurnoise._core import rng
from blurnoise._core.checks import Numbers, image_batch, in_range, one_of
from blurnoise._core.limits import limited_per_image
from blurnoise._core.uncompiled import uncompiled
from blurnoise.augment_boxes import moved_corners, swept_px, velocity_px_s, within_picture
from blurnoise.augment_gain import Gains, gains_db
from blurnoise.exposure_ranges import (
    DRAWN,
    Cameras,
    Draws,
    ExposureRanges,
    Gain,
    Params,
    Range,
    cameras_of,
    check_vehicle,
    shakes,
)
from blurnoise.exposure_table import ExposureTable, Place, beside_table
from blurnoise.mattes import Cut
from blurnoise.motion.ego import USUAL_VEHICLE, Vehicle
from blurnoise.motion.trajectory import Trajectory, per_picture
from blurnoise.moving_masks import Moves, checked, in_motion, matte_of
from blurnoise.optics.camera import Amplified
from blurnoise.optics.colour import Encoding
from blurnoise.picture.develop import develop, in_channels
from blurnoise.scene.scene import MOVES, scene_reflectance, simulate
from blurnoise.sensor.readout import Fidelity

__all__ = ["ExposureGenerator", "ExposureRanges", "RandomExposure", "expose_pictures", "velocity_px_s"]


@uncompiled
def expose_pictures(
    image: Tensor,
    camera: Cameras,
    *,
    exposure_s: Numbers,
    illuminance_lux: Numbers,
    speed_px_s: Numbers = 0.0,
    direction_deg: Numbers = 0.0,
    temperature_c: Numbers = 25.0,
    gain_db: Gains = 0.0,
    masks: Tensor | None = None,
    moves: str | Sequence[str] = "all",
    trajectory: Trajectory | Sequence[Trajectory | None] | None = None,
    ego_kmh: Numbers | None = None,
    vehicle: Vehicle = USUAL_VEHICLE,
    generator: rng.Randomness = None,
    encoding: Encoding = "srgb",
    fidelity: Fidelity = "auto",
) -> Tensor:
    """Expose ``image`` and develop it: :func:`blurnoise.simulate`, then :func:`blurnoise.develop`.

    image: (B, C, H, W), float, in [0, 1]; half precision is computed in float32. camera: one, or one for each
    picture, presets by name. exposure_s, illuminance_lux, speed_px_s, direction_deg (counter-clockwise as
    displayed), temperature_c: a number or one per picture. gain_db: the same, analogue as far as the camera goes,
    then digital; or auto-exposure, which sets it for each picture's mean light and exposure; or either for each.

    masks: (B, N, H, W) within [0, 1], what the targets of each picture cover, empty where there are fewer. moves:
    what the speed is of, "all", the "targets" or the "background" behind them, one or one for each picture; what the
    targets hide is invented from around them. A picture without masks, or with nothing beside them, moves as a whole.

    ego_kmh: a number or one per picture, in place of a speed in px/s: the camera drives over a flat road on
    ``vehicle``, and each place moves in its own way, by the camera's focal length and the picture's size. With masks
    and moves = "background" the targets drive along. Where one blur for all of a picture is enough, there is one.

    trajectory, generator, encoding, fidelity: as ``simulate`` takes them; picture i depends on its own conditions
    and seed alone. Returns image's shape and dtype, in [0, 1].

    Gradients reach image and conditions. Raises ``TypeError`` or ``ValueError`` that names the argument.
    """
    scene = _clamped(image)
    cameras, batch = cameras_of(camera), len(scene)
    if len(cameras) not in (1, batch):
        raise ValueError(f"camera: got {len(cameras)}; must be one, or {batch}, one for each picture")
    exposure = limited_per_image("exposure_s", exposure_s, batch, scene)
    lux = limited_per_image("illuminance_lux", illuminance_lux, batch, scene)
    temperature = limited_per_image("temperature_c", temperature_c, batch, scene)
    speed = limited_per_image("speed_px_s", speed_px_s, batch, scene)
    velocity = velocity_px_s(speed, limited_per_image("direction_deg", direction_deg, batch, scene))
    paths = per_picture(trajectory, batch)
    ego = None if ego_kmh is None else limited_per_image("ego_kmh", ego_kmh, batch, scene)
    check_vehicle(vehicle, drives=ego is not None)
    seeds = rng.item_seeds(generator, batch)
    names: list[str] = [moves] * batch if isinstance(moves, str) else list(moves)
    for each in names:
        one_of("moves", each, MOVES)
    if len(names) != batch:
        raise ValueError(f"moves: got {len(names)}; must be one, or {batch}, one for each picture")
    if ego is not None and (bool(velocity.detach().any()) or paths or "targets" in names):
        raise ValueError(
            "ego_kmh: a camera that drives moves each place in its own way; speed_px_s must be 0, trajectory None "
            "and moves 'all' or 'background'"
        )
    still = (velocity == 0).all(1) if ego is None else (ego == 0) & (not vehicle.turns)
    names = ["all" if rests else each for each, rests in zip(names, still.tolist(), strict=True)]
    own_masks = None if masks is None else checked(masks, batch, (scene.shape[-2], scene.shape[-1]))
    cuts = _cuts(scene, encoding, own_masks, names, velocity, exposure)
    gains = gains_db(
        gain_db,
        scene,
        cameras,
        exposure_s=exposure,
        illuminance_lux=lux,
        temperature_c=temperature,
        encoding=encoding,
    )

    def pictures(taker: Amplified, of: list[int]) -> Tensor:  # all with objects, or none
        camera, digital_db = taker
        own = [(item, cut) for item in of if (cut := cuts.get(item))]
        seen, coded, moved = scene if len(of) == batch else scene[of], encoding, velocity[of]
        if ego is not None:
            moved = vehicle.flows_px_s(camera, (scene.shape[-2], scene.shape[-1]), ego[of] / 3.6)
        if own:
            seen, coded = torch.cat([cut.background for _, cut in own]), "linear"
        if own and ego is None:
            moved = moved * moved.new_tensor([[names[item] == "background"] for item in of])
        dn = simulate(
            seen,
            camera,
            exposure_s=exposure[of],
            illuminance_lux=lux[of],
            velocity_px_s=moved,
            trajectory=[paths[item] for item in of] if paths else None,
            temperature_c=temperature[of],
            encoding=coded,
            generator=[seeds[item] for item in of],
            fidelity=fidelity,
            layers=[cut.layers for _, cut in own],
        )
        return in_channels(
            develop(dn, camera, encoding=encoding, gain_db=digital_db, whole=True), scene.shape[1]
        )

    taken_by: dict[tuple[Amplified, bool], list[int]] = {}
    for item, gain in enumerate(gains):
        taken_by.setdefault((cameras[item % len(cameras)].at_gain(gain), item in cuts), []).append(item)
    with torch.autocast(scene.device.type, enabled=False):
        parts = {key: pictures(key[0], items) for key, items in taken_by.items()}
    if len(parts) == 1:
        return next(iter(parts.values())).to(image.dtype)
    out = torch.empty_like(image)
    for key, items in taken_by.items():
        out[items] = parts[key].to(image.dtype)
    return out


class ExposureGenerator(RandomGeneratorBase):  # type: ignore[misc]  # kornia is not followed by mypy
    """Draws from ``ranges``, or a table, by torch's global generator, as all of Kornia does: conditions, noise seeds.

    Returns, for a batch of B, (B,) tensors: what their ``conditions`` returns, and ``noise_seed``,
    int64. Under ``same_on_batch`` they are equal, the noise seed too, so equal pictures stay equal.
    """

    def __init__(self, ranges: Draws) -> None:
        super().__init__()
        self.ranges = ranges

    def __repr__(self) -> str:
        return str(self.ranges)

    def make_samplers(self, device: torch.device, dtype: torch.dtype) -> None:
        """Samplers on ``device``, at least float32: half precision has too few exposures and directions."""
        ends = torch.tensor([0.0, 1.0], device=device, dtype=torch.promote_types(dtype, torch.float32))
        self.unit = UniformDistribution(ends[0], ends[1], validate_args=False)

    def forward(self, batch_shape: tuple[int, ...], same_on_batch: bool = False) -> Params:
        """Parameters for a batch of shape (B, C, H, W)."""
        batch = batch_shape[0]
        count = min(batch, 1) if same_on_batch else batch
        drawn = self.ranges.conditions(self.unit.rsample((count, self.ranges.draws)))
        drawn["noise_seed"] = torch.randint(2**63 - 1, (count,), device=self.device)
        return {name: value.expand(batch).clone() for name, value in drawn.items()}


class RandomExposure(IntensityAugmentationBase2D):  # type: ignore[misc]
    """Take each picture with a camera under conditions drawn for it: :func:`expose_pictures` for Kornia.

    The ranges are those of :class:`ExposureRanges`, the functional twin's arguments drawn anew for each picture.
    encoding: "srgb" or "linear", of the pictures, before and after. fidelity: as ``simulate`` takes it.
    grow_boxes: let boxes cover what the motion sweeps, half the displacement to each side, but not beyond the
    picture's last pixel (Kornia's boxes end in it); else boxes stay, as masks and keypoints always do.
    same_on_batch, p, keepdim: as everywhere in Kornia; only the pictures that p chooses are computed.

    With masks, ``expose(pictures, masks=masks)``, parts may move for themselves: moves says what is drawn from.
    Kornia's containers show masks to no augmentation of pictures: there everything moves, and masks come back as they
    are. So let a container do the rest, with data_keys of pictures, boxes and masks, and call this one after it;
    boxes follow by ``expose.transform_boxes(Boxes.from_tensor(boxes), expose._params, expose.flags)``.

    All randomness lies in ``_params``, the noise's too: ``aug(x, params=aug._params)`` gives the same bits.
    A camera's fixed pattern is one specimen's, the same part of it for pictures of one size; it is drawn once.
    Under ``torch.compile`` the exposure itself runs uncompiled: equal ``_params`` give equal pictures. What they are
    drawn from is the compiler's, whose random numbers may differ from torch's own for the same seed.

    Raises ``TypeError`` or ``ValueError`` naming the argument, its value and what is allowed.
    """

    def __init__(
        self,
        camera: Cameras = ExposureRanges.camera,
        exposure_s: Range = ExposureRanges.exposure_s,
        illuminance_lux: Range = ExposureRanges.illuminance_lux,
        speed_px_s: Range = ExposureRanges.speed_px_s,
        direction_deg: Range = ExposureRanges.direction_deg,
        temperature_c: Range = ExposureRanges.temperature_c,
        gain_db: Gain = ExposureRanges.gain_db,
        shake_px: Range = ExposureRanges.shake_px,
        moves: Moves | Sequence[Moves] = ExposureRanges.moves,
        white_e: Range | None = ExposureRanges.white_e,
        blur_px: Range | None = ExposureRanges.blur_px,
        ego_kmh: Range | None = ExposureRanges.ego_kmh,
        vehicle: Vehicle = ExposureRanges.vehicle,
        encoding: Encoding = "srgb",
        fidelity: Fidelity = "auto",
        grow_boxes: bool = False,
        same_on_batch: bool = False,
        p: float = 0.5,
        keepdim: bool = False,
    ) -> None:
        super().__init__(p=in_range("p", p, 0.0, 1.0), same_on_batch=same_on_batch, keepdim=keepdim)
        self.ranges: Draws = ExposureRanges(
            camera,
            exposure_s,
            illuminance_lux,
            speed_px_s,
            direction_deg,
            temperature_c,
            gain_db,
            shake_px,
            moves,
            white_e,
            blur_px,
            ego_kmh,
            vehicle,
        )
        self._param_generator = ExposureGenerator(self.ranges)
        self.flags = {
            "encoding": one_of("encoding", encoding, ("srgb", "linear")),
            "fidelity": one_of("fidelity", fidelity, ("auto", "full")),
            "grow_boxes": grow_boxes,
        }

    @classmethod
    def for_run(cls, run: str | Place, *, direction_deg: Range | None = None, **options: Any) -> Self:
        """The augmentation under the conditions of a finished sweep: its camera, exposures, lights, speeds, gains and
        what moves, as :class:`blurnoise.exposure_table.ExposureTable` reads and spreads them.

        run: the sweep's folder, or what ``blurnoise_eval.system.storage.location`` makes of its URL. direction_deg:
        of the motion, None: the run's. options: the class's that are no ranges. Raises ``TypeError`` or
        ``ValueError`` naming the argument, ``OSError`` for a file that cannot be read.
        """
        return cls.for_conditions(ExposureTable.of_run(run, direction_deg=direction_deg), **options)

    @classmethod
    def for_conditions(cls, table: ExposureTable, **options: Any) -> Self:
        """The augmentation under the conditions of a table, as ``ExposureTable.of_grid`` makes one."""
        augmentation = cls(**beside_table(table, options))
        augmentation.ranges = table
        augmentation._param_generator = ExposureGenerator(table)
        return augmentation

    def forward(
        self, input: Tensor, params: Params | None = None, masks: Tensor | None = None, **kwargs: Any
    ) -> Tensor:
        """The pictures (B, C, H, W), or one (C, H, W), exposed; masks as :func:`expose_pictures` takes them.

        Of one picture masks are (N, H, W). They are kept in ``_params``, as a replay needs them.
        """
        if masks is not None:
            batch = self.transform_tensor(input)
            own = masks[None] if input.ndim == 3 and masks.ndim == 3 else masks
            own = checked(own, len(batch), (batch.shape[-2], batch.shape[-1]))
            params = {**(self.forward_parameters(batch.shape) if params is None else params), "masks": own}
        seen: Tensor = super().forward(input, params, **kwargs)
        return seen

    @torch.compiler.disable  # type: ignore[untyped-decorator]  # threads, seeds and plans are Python
    def apply_transform(
        self, input: Tensor, params: Params, flags: dict[str, Any], transform: Tensor | None = None
    ) -> Tensor:
        """The pictures that ``batch_prob`` chooses, exposed; the others as they are."""
        chosen = self._chosen(params, len(input))
        if not chosen:
            return input
        every = len(chosen) == len(input)
        of = slice(None) if every else chosen
        cameras = [self.ranges.cameras[index] for index in params["camera_index"][of].tolist()]
        exposed = expose_pictures(
            input[of],
            cameras,
            **{name: params[name][of] for name in DRAWN},
            gain_db=self.ranges.gain(params, of),
            masks=params["masks"][of] if "masks" in params else None,
            moves=self.ranges.moving(params, of),
            trajectory=shakes(params, cameras, of),
            ego_kmh=params["ego_kmh"][of] if "ego_kmh" in params else None,
            vehicle=self.ranges.vehicle,
            generator=params["noise_seed"][of].tolist(),
            encoding=flags["encoding"],
            fidelity=flags["fidelity"],
        )
        return exposed if every else input.index_put((torch.tensor(chosen, device=input.device),), exposed)

    def apply_transform_box(
        self, input: Boxes, params: Params, flags: dict[str, Any], transform: Tensor | None = None
    ) -> Boxes:
        """The boxes at mid-exposure, grown by what the motion sweeps where ``grow_boxes`` asks for it."""
        height, width = params["forward_input_shape"][-2:].tolist()
        corners = moved_corners(input.data, params, self.ranges, (height, width))
        if corners is not input.data:
            input = input.clone()
            input.data.copy_(corners)
        if not flags["grow_boxes"]:
            return input
        # (B, N, 4, 2), or (N, 4, 2) of one picture; the last pixel, not its outer edge
        boxes = torch.cat([corners.amin(-2), corners.amax(-2) + 1], -1)
        swept = swept_px(params, self.ranges, boxes.view(-1, *boxes.shape[-2:]), (height, width)).to(corners)
        low, high = (side.reshape(*corners.shape[:-2], 1, 2) for side in swept.unbind(2))
        centre = (corners.amin(-2, keepdim=True) + corners.amax(-2, keepdim=True)) / 2
        outward = (corners - centre).sign()
        # A box of one pixel has all its corners in the centre: there they go by their order.
        outward = torch.where((outward == 0).all(-2, keepdim=True), corners.new_tensor(_CORNERS), outward)
        grown = input.clone()
        by = outward * torch.where(outward < 0, low, high)
        grown.data.copy_(within_picture(corners, by, (width - 1, height - 1)))
        return grown

    def _chosen(self, params: Params, batch: int) -> list[int]:
        """Which pictures to expose. Kornia computes all and discards those that were not to be."""
        if self.p == 1 and self.p_batch == 1:  # then Kornia asks no gate, either
            return list(range(batch))
        return [item for item, gate in enumerate(params["batch_prob"].tolist()) if gate > 0.5]


_CORNERS = [[-1, -1], [1, -1], [1, 1], [-1, 1]]


def _cuts(
    scene: Tensor,
    encoding: Encoding,
    masks: Tensor | None,
    moves: Sequence[str],
    velocity: Tensor,
    exposure: Tensor,
) -> dict[int, Cut]:
    """The pictures, by number, of which a part moves: as background and layers, in linear light."""
    if masks is None:
        return {}
    found = {}
    for item, moving in enumerate(moves):
        matte = None if moving == "all" else matte_of(masks[item])
        if matte is not None:
            light = scene_reflectance(scene[item : item + 1], encoding)
            own = velocity[item] if moving == "targets" else torch.zeros_like(velocity[item])
            found[item] = in_motion(light, matte, own, float(exposure[item].detach()))
    return found


def _clamped(image: Tensor) -> Tensor:
    """``image``, at least float32, within [0, 1]; far outside, clamping would hide a mistake."""
    halves = (torch.float16, torch.bfloat16)  # which cannot hold a full well's electrons
    image = image.float() if isinstance(image, Tensor) and image.dtype in halves else image
    seen = image_batch("image", image).detach()
    # NumPy's extremes wake no threads, which would spin beside the work that follows.
    bounds = seen.aminmax() if seen.device.type != "cpu" else (seen.numpy().min(), seen.numpy().max())
    low, high = (float(bound) for bound in bounds)
    if low < -1.0 or high > 2.0:
        raise ValueError(
            f"image: values span [{low:g}, {high:g}]; must lie within [0, 1]: divide 8-bit values by 255, and "
            "normalise after this augmentation"
        )
    return image.clamp(0.0, 1.0) if low < 0.0 or high > 1.0 else image
