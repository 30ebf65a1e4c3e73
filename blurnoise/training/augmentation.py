"""Training pictures taken as cameras would: a function, and augmentations that draw the conditions of each picture.

Domain: pictures (B, C, H, W) in [0, 1], sRGB-coded or linear, of any float type; the result has the same shape,
type and range. Values down to -1 and up to 2, which earlier augmentations leave, are clamped. Boxes in px, x right, y
down. Directions run counter-clockwise as displayed, 0 to the right, as Kornia's angles do. A blur keeps its centroid:
what moves is swept half the displacement to either side of its place. Without a gain, little light is dark.
"""

from __future__ import annotations

import inspect
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any, Self, TypeVar

import torch
from kornia.augmentation import IntensityAugmentationBase2D
from kornia.geometry.boxes import Boxes
from torch import Tensor

from blurnoise._core import rng
from blurnoise._core.checks import (
    Numbers,
    an_instance,
    dense,
    image_batch,
    in_range,
    limited,
    limited_per_image,
    one_of,
    shown,
)
from blurnoise._core.threads import same_bits
from blurnoise.light import effects
from blurnoise.light.flicker import Flicker, Pwm
from blurnoise.motion.ego import USUAL_VEHICLE, Vehicle
from blurnoise.motion.trajectory import Trajectory, per_picture
from blurnoise.optics.camera import Camera
from blurnoise.optics.colour import PictureTone, picture_tone
from blurnoise.picture.develop import in_channels
from blurnoise.scene import hdr
from blurnoise.scene.cutting import Cut, checked_masks, in_motion, matte_of
from blurnoise.scene.exposure import MOVES, Exposure
from blurnoise.scene.metering import AutoExposure, mean_luma
from blurnoise.scene.scene import ExposedScene, extremes, scene_reflectance
from blurnoise.sensor.readout import Fidelity
from blurnoise.training.ranges import (
    Cameras,
    Draws,
    ExposureRanges,
    Lights,
    Params,
    Range,
    cameras_of,
    check_vehicle,
)
from blurnoise.training.table import ExposureTable

T = TypeVar("T")
Gains = Numbers | AutoExposure | Sequence[float | AutoExposure]
"""A number or one per picture; auto-exposure, or either for each picture."""
_RANGES = dict(inspect.signature(ExposureRanges).parameters)
del _RANGES["camera"]
_FAR = [[False, False], [True, False], [True, True], [False, True]]
"""Which corners of Kornia's boxes lie at the right, at the bottom."""


@same_bits
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
    lamp: Pwm | Sequence[Pwm | None] | None = None,
    lamp_lights: Lights = "all",
    generator: rng.Randomness = None,
    encoding: PictureTone = "srgb",
    fidelity: Fidelity = "auto",
) -> Tensor:
    """Expose ``image`` and develop it: :func:`blurnoise.simulate`, then :func:`blurnoise.develop`.

    image: (B, C, H, W), float, in [0, 1]; half precision is computed in float32. camera: one, or one for each
    picture, presets by name. exposure_s, illuminance_lux, speed_px_s, direction_deg (counter-clockwise as
    displayed), temperature_c: a number or one per picture. gain_db: the same, analogue up to the camera's limit, then
    digital; or an auto-exposure, which sets the gain by the mean light and exposure of each picture; or a list of
    both.

    masks: (B, N, H, W) within [0, 1], the pixels that the targets of each picture cover; surplus masks are empty.
    moves: the part that moves, "all", "targets" or "background", one for all or one for each picture. The background
    behind the targets is filled in from the pixels around them. Pictures without masks move as a whole, and so do
    pictures that the masks cover entirely.

    ego_kmh: a number or one per picture, in place of speed_px_s: the camera drives over a flat road on ``vehicle``.
    The motion of each pixel follows from the camera's focal length and the picture's size. With masks and
    moves = "background" the targets drive along. If one blur is accurate enough for the whole picture, one is used.

    The captures of an HDR camera are taken one after the other and fused (:func:`blurnoise.scene.hdr.pictures`);
    exposure_s is that of the first. lamp: a pulsed lamp for all pictures, or a lamp or None for each. lamp_lights:
    the lamp lights "all", or the "targets" of pictures with masks.

    trajectory, generator, encoding, fidelity: see :func:`blurnoise.simulate`; picture i depends on its own conditions
    and seed alone. Returns pictures in [0, 1] of image's shape and dtype, coded by the camera's tone curve, or linear
    if image is linear.

    Gradients reach image and conditions. Raises ``TypeError`` or ``ValueError`` that names the argument.
    """
    scene = _clamped(image)
    batch, size = len(scene), (scene.shape[-2], scene.shape[-1])
    cameras = _for_each("camera", cameras_of(camera), batch)
    speed = limited_per_image("speed_px_s", speed_px_s, batch, scene)
    direction = limited_per_image("direction_deg", direction_deg, batch, scene)
    names = _for_each("moves", [moves] if isinstance(moves, str) else moves, batch)
    for each in names:
        one_of("moves", each, MOVES)
    ego = None if ego_kmh is None else limited_per_image("ego_kmh", ego_kmh, batch, scene)
    check_vehicle(vehicle, drives=ego is not None)
    if ego is not None and (bool(speed.detach().any()) or "targets" in names):
        raise ValueError("ego_kmh: needs speed_px_s = 0 and moves = 'all' or 'background'")
    still = speed == 0 if ego is None else (ego == 0) & (not vehicle.turns)
    exposure = limited_per_image("exposure_s", exposure_s, batch, scene)
    lux = limited_per_image("illuminance_lux", illuminance_lux, batch, scene)
    temperature = limited_per_image("temperature_c", temperature_c, batch, scene)
    velocity = velocity_px_s(speed, direction)
    paths = per_picture(trajectory, batch)
    seeds = rng.item_seeds(generator, batch)
    cuts: dict[int, Cut] = {}  # pictures of which a part moves: background and layers, in linear light
    if masks is not None:
        checked_masks(masks, batch, size)
        for item in range(batch):
            moving = names[item] != "all" and not bool(still[item])
            matte = matte_of(masks[item]) if moving else None
            if matte is not None:
                light = scene_reflectance(scene[item : item + 1], encoding)
                own = velocity[item] * (names[item] == "targets")
                cuts[item] = in_motion(light, matte, own, float(exposure[item].detach()))

    lamps = _flickers(lamp, lamp_lights, masks, batch)

    def pictures(camera: Camera, gain: float, items: list[int]) -> Tensor:  # all with objects, or none
        own = [cuts[item] for item in items if item in cuts]
        of: Any = slice(None) if len(items) == batch else items  # without a copy of all
        moved = velocity[of]
        if ego is not None:
            moved = vehicle.flow_px_s(camera, size, ego[of] / 3.6)
        elif own:
            moved = moved * moved.new_tensor([[names[item] == "background"] for item in items])
        light = torch.cat([cut.background for cut in own]) if own else scene_reflectance(scene[of], encoding)
        developed = hdr.pictures(
            ExposedScene(light, fidelity=fidelity, layers=[cut.layers for cut in own]),
            camera,
            exposure_s=exposure[of],
            illuminance_lux=lux[of],
            gain_db=gain,
            velocity_px_s=moved,
            trajectory=[paths[item] for item in items] if paths else None,
            temperature_c=temperature[of],
            generator=[seeds[item] for item in items],
            flicker=[lamps[item] for item in items] if lamps else None,
            encoding="linear" if encoding == "linear" else "srgb",
        )
        return in_channels(developed, scene.shape[1]).to(image.dtype)

    taken_by: dict[tuple[Camera, float, bool], list[int]] = {}
    for item, gain in enumerate(_gains_db(gain_db, scene, encoding, cameras, (exposure, lux, temperature))):
        taken_by.setdefault((cameras[item], gain, item in cuts), []).append(item)
    parts = [pictures(taker, gain, items) for (taker, gain, _), items in taken_by.items()]
    if len(parts) == 1:
        return parts[0]
    out = torch.empty_like(image)
    for items, part in zip(taken_by.values(), parts, strict=True):
        out[items] = part
    return out


def _gains_db(
    gain_db: Gains, scene: Tensor, encoding: PictureTone, cameras: list[Camera], numbers: Sequence[Tensor]
) -> list[float]:
    """The gain of each picture; numbers: exposure, light and temperature, (B,) each."""
    each = [gain_db] if isinstance(gain_db, AutoExposure) else gain_db
    if not isinstance(each, Sequence) or not any(isinstance(own, AutoExposure) for own in each):
        given: Numbers = each  # type: ignore[assignment]
        return limited_per_image("gain_db", given, len(scene), scene).tolist()
    light = scene_reflectance(scene.detach(), encoding)
    means = {camera: mean_luma(light, camera).tolist() for camera in {*cameras}}
    found = []
    for item, own in enumerate(_for_each("gain_db", each, len(scene))):
        if isinstance(own, AutoExposure):
            exposure_s, lux, celsius = (float(given[item]) for given in numbers)
            own = own.setting(
                cameras[item],
                mean_light=means[cameras[item]][item],
                illuminance_lux=lux,
                exposure_s=exposure_s,
                temperature_c=celsius,
            ).gain_db
        found.append(limited("gain_db", own))
    return found


def _flickers(
    lamp: Pwm | Sequence[Pwm | None] | None, lights: Lights, masks: Tensor | None, batch: int
) -> list[Flicker | None]:
    """Each picture's lamp where it lights; None for a lamp of targets where there are none; [] without lamps."""
    one_of("lamp_lights", lights, ("all", "targets"))
    each = [] if lamp is None else _for_each("lamp", [lamp] if isinstance(lamp, Pwm) else lamp, batch)
    found: list[Flicker | None] = []
    for item, own in enumerate(each):
        if own is not None:
            an_instance("lamp", own, Pwm)
        dark = lights == "targets" and (masks is None or not masks.shape[1])
        mask = None if lights == "all" or masks is None else masks[item].amax(0).float()
        found.append(None if own is None or dark else Flicker(own, mask))
    return found


def velocity_px_s(speed_px_s: Tensor, direction_deg: Tensor) -> Tensor:
    """Velocities (B, 2), x right and y down, from speeds (B,) and directions (B,), counter-clockwise as displayed."""
    angle = torch.deg2rad(direction_deg)
    return torch.stack([angle.cos(), -angle.sin()], dim=-1) * speed_px_s[:, None]


def boxes_after(
    boxes_xyxy: Tensor, params: Params, ranges: Draws, size: tuple[int, int], *, grow: bool
) -> Tensor:
    """Boxes (B, N, 4), float64, counted from the corner of pictures (H, W), as they are at mid-exposure.

    grow: with what they sweep, as :meth:`Exposure.sweep_boxes` has it, but no further than the picture.
    """
    moved, swept = boxes_xyxy.clone(), boxes_xyxy.clone()
    for boxes, out, covered, taken in zip(boxes_xyxy, moved, swept, _taken(params, ranges), strict=True):
        out[:] = taken.move_boxes(boxes, size) if effects.displace(taken.camera) else boxes
        if grow:
            path = taken.trajectory if taken.drives else None
            covered[:] = (replace(taken, trajectory=None) if path else taken).sweep_boxes(boxes, size)
            if path:  # flow and shake each by itself: a bound, found for all places at once
                covered += boxes.new_tensor(path.seen(taken.exposure_s).box)
    if not grow:
        return moved
    end = torch.maximum(moved[..., 2:], moved.new_tensor([size[1], size[0]]))
    first = torch.maximum(swept[..., :2], moved[..., :2].clamp(max=0))
    return torch.cat([first, torch.minimum(swept[..., 2:], end)], -1)


def _taken(params: Params, ranges: Draws) -> Iterator[Exposure]:
    """The exposures of each picture's targets, without gain."""
    given = ranges.arguments(params)
    velocities = velocity_px_s(given["speed_px_s"], given["direction_deg"]).tolist()
    masks, ego = given["masks"], given["ego_kmh"]
    numbers = (given[name].tolist() for name in ("exposure_s", "illuminance_lux", "temperature_c"))
    columns = given["camera"], *numbers, velocities, given["moves"], given["trajectory"]
    for item, (camera, exposure_s, lux, celsius, (x, y), moves, path) in enumerate(
        zip(*columns, strict=True)
    ):
        taken = Exposure(camera, exposure_s, lux, temperature_c=celsius, trajectory=path)
        if moves == "background" and masks is not None and matte_of(masks[item]) is not None:
            yield taken  # the camera follows them
        elif ego is None:
            yield replace(taken, velocity_px_s=(x, y))
        else:
            yield replace(taken, ego_speed_m_s=ego[item].item() / 3.6, vehicle=ranges.vehicle)


def _for_each(name: str, given: Sequence[T], batch: int) -> list[T]:
    """Broadcast to one per picture. Raises ``ValueError`` for another number."""
    if len(given) not in (1, batch):
        raise ValueError(f"{name}: got {len(given)}; must be one, or {batch}, one for each picture")
    return [*given] * (batch if len(given) == 1 else 1)


def _clamped(image: Tensor) -> Tensor:
    """``image``, at least float32, within [0, 1]; far outside, clamping would hide a mistake."""
    halves = (torch.float16, torch.bfloat16)  # which cannot hold a full well's electrons
    image = image.float() if isinstance(image, Tensor) and image.dtype in halves else image
    image_batch("image", image)
    low, high = extremes(image)
    if low < -1.0 or high > 2.0:
        must = "must lie within [0, 1]: divide 8-bit values by 255, and normalise after this augmentation"
        raise ValueError(f"image: values span [{low:g}, {high:g}]; {must}")
    return image.clamp(0.0, 1.0) if low < 0.0 or high > 1.0 else image


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
        """The augmentation under the conditions of a finished sweep.

        The conditions are the sweep's cameras, exposures, lights, speeds, gains and ``moves``, as
        :class:`blurnoise.training.table.ExposureTable` reads and interpolates them. run: the sweep's folder, or
        ``blurnoise_eval.system.urls.location(URL)``. direction_deg: of the motion; None: as in the run. options: the
        options of the class that are not ranges; encoding is by default that of the run. Raises ``TypeError`` or
        ``ValueError`` naming the argument, ``OSError`` for a file that cannot be read.
        """
        return cls.for_conditions(ExposureTable.of_run(run, direction_deg=direction_deg), **options)

    @classmethod
    def for_conditions(cls, table: ExposureTable, **options: Any) -> Self:
        """The augmentation under the conditions of a table, as ``ExposureTable.of_grid`` makes one."""
        an_instance("table", table, ExposureTable)
        for name in {"camera", *_RANGES} & options.keys():
            raise TypeError(f"{name} = {shown(options[name])}: is part of the conditions; must not be given")
        augmentation = cls(**{"encoding": table.encoding, **options})
        augmentation.ranges = table
        return augmentation

    def _drawn(self, count: int, dtype: torch.dtype, device: torch.device | None = None) -> Params:
        """Conditions and noise seeds of so many pictures, (count,) each, by torch's global generator."""
        drawn = self.ranges.conditions(torch.rand(count, self.ranges.draws, device=device, dtype=dtype))
        return {**drawn, "noise_seed": torch.randint(2**63 - 1, (count,), device=device)}

    def _exposed(self, seen: Tensor, params: Params, of: list[int], seeds: list[int], flags: Any) -> Tensor:
        """Pictures exposed under the conditions of these places in ``params``; flags: encoding and fidelity."""
        how = {name: flags[name] for name in ("encoding", "fidelity")}
        return expose_pictures(seen, **self.ranges.arguments(params, of), generator=seeds, **how)

    def _moves_boxes(self, grow: bool) -> bool:
        return grow or any(map(effects.displace, self.ranges.cameras))


class RandomExposure(OverConditions, IntensityAugmentationBase2D):  # type: ignore[misc]
    """Take each picture with a camera under random conditions: :func:`expose_pictures` as a Kornia augmentation.

    The ranges are those of :class:`ExposureRanges`, drawn anew for each picture. Cameras may have several captures
    (HDR), and lamps may be pulsed.
    encoding: the pictures' tone curve, see :func:`blurnoise.simulate`; the result has the camera's tone curve, or is
    linear if encoding is "linear". fidelity: see :func:`blurnoise.simulate`.
    grow_boxes: grow boxes to the swept boxes, by half the displacement to each side, at most to the picture's last
    pixel (Kornia's boxes include it). By default boxes stay unchanged; masks and keypoints always do.
    same_on_batch, p, keepdim: as in Kornia; only the pictures that p selects are computed.

    With masks, ``expose(pictures, masks=masks)``, parts of the picture can move: ``moves`` selects them.
    Kornia's containers do not pass masks to augmentations of pictures: there everything moves, and masks stay
    unchanged. So use a container for the other augmentations, with data_keys of pictures, boxes and masks, and call
    this one after it; transform boxes by
    ``expose.transform_boxes(Boxes.from_tensor(boxes), expose._params, expose.flags)``.

    ``_params`` holds all randomness, the noise included: ``aug(x, params=aug._params)`` gives the same bits.
    The fixed pattern is that of one specimen of the camera, the same for all pictures of one size; it is drawn once.
    Under ``torch.compile`` the exposure itself runs uncompiled: equal ``_params`` give equal pictures. The compiler
    draws the conditions, and its random numbers may differ from torch's own for the same seed.

    Raises ``TypeError`` or ``ValueError`` naming the argument, its value and what is allowed.
    """

    def __init__(
        self,
        camera: Cameras = ExposureRanges.camera,
        *,
        encoding: PictureTone = "srgb",
        fidelity: Fidelity = "auto",
        grow_boxes: bool = False,
        same_on_batch: bool = False,
        p: float = 0.5,
        keepdim: bool = False,
        **ranges: Any,
    ) -> None:
        super().__init__(p=in_range("p", p, 0.0, 1.0), same_on_batch=same_on_batch, keepdim=keepdim)
        self.ranges = ExposureRanges(camera, **ranges)
        self.flags = {
            "encoding": picture_tone(encoding),
            "fidelity": one_of("fidelity", fidelity, ("auto", "full")),
            "grow_boxes": grow_boxes,
        }

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
        self, input: Tensor, params: Params | None = None, masks: Tensor | None = None, **kwargs: Any
    ) -> Tensor:
        """The pictures (B, C, H, W), or one (C, H, W), exposed; masks as :func:`expose_pictures` takes them.

        Of one picture masks are (N, H, W). They are kept in ``_params``, as a replay needs them.
        """
        an_instance("input", input, Tensor)
        dense("input", input)
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
        if len(chosen) == len(input):
            return self._exposed(input, params, chosen, seeds, flags)
        exposed = self._exposed(input[chosen], params, chosen, seeds, flags)
        return input.index_put((torch.tensor(chosen, device=input.device),), exposed)

    def apply_transform_box(
        self, input: Boxes, params: Params, flags: dict[str, Any], transform: Tensor | None = None
    ) -> Boxes:
        """The boxes at mid-exposure, grown by what the motion sweeps where ``grow_boxes`` asks for it."""
        grow = flags["grow_boxes"]
        if not self._moves_boxes(grow):
            return input
        corners = input.data if input.data.ndim == 4 else input.data[None]  # (B, N, 4, 2) or (N, 4, 2)
        low, high = corners.double().amin(-2, keepdim=True), corners.double().amax(-2, keepdim=True)
        edges = torch.cat([low, high + 1], -1)[..., 0, :]  # the last pixel's outer edge
        height, width = params["forward_input_shape"][-2:].tolist()
        moved = boxes_after(edges, params, self.ranges, (height, width), grow=grow)[..., None, :]
        share = (corners - low) / (high - low)
        share = torch.where(high > low, share, corners.new_tensor(_FAR))  # of boxes of one pixel
        out = input.clone()
        out.data.copy_((moved[..., :2] + share * (moved[..., 2:] - 1 - moved[..., :2])).view_as(out.data))
        return out
