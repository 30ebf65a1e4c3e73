"""Training pictures as cameras would take them: a Kornia augmentation that draws conditions in real units.

Domain: pictures (B, C, H, W) in [0, 1], sRGB-coded or linear, of any float type; the result has the same shape,
type and range. Values down to -1 and up to 2, which earlier augmentations leave, are clamped. Without a gain,
little light gives a dark picture.

Convention: directions run counter-clockwise as displayed, 0 to the right, as Kornia's angles do. A blur keeps
its centroid, so what moves is swept half the displacement to either side of its place.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import torch
from kornia.augmentation import IntensityAugmentationBase2D
from kornia.augmentation.random_generator import RandomGeneratorBase, UniformDistribution
from kornia.geometry.boxes import Boxes
from torch import Tensor

from blurnoise._core import rng
from blurnoise._core.checks import Numbers, image_batch, in_range, one_of, shown
from blurnoise._core.limits import DRAWN_FROM, LIMITS, limited, limited_per_image
from blurnoise._core.uncompiled import uncompiled
from blurnoise.auto_exposure import AutoExposure, mean_luma
from blurnoise.camera import Amplified, Camera
from blurnoise.encoding import Encoding
from blurnoise.exposure import scene_reflectance
from blurnoise.light import effects, motion
from blurnoise.operating_point import OperatingPoint
from blurnoise.picture.develop import develop, in_channels
from blurnoise.radiometry import photoelectrons
from blurnoise.sensor.readout import Fidelity
from blurnoise.simulation import simulate

Range = float | Sequence[float]
"""A number that stays, or the bounds (low, high) to draw between."""
Cameras = Camera | str | Sequence[Camera | str]
Params = dict[str, Tensor]
Gain = Range | Literal["auto"] | AutoExposure
"""dB, or what auto-exposure sets for the exposure at hand."""


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
    gain_db: Numbers | AutoExposure = 0.0,
    generator: rng.Randomness = None,
    encoding: Encoding = "srgb",
    fidelity: Fidelity = "auto",
) -> Tensor:
    """Expose ``image`` and develop it: :func:`blurnoise.simulate`, then :func:`blurnoise.develop`.

    image: (B, C, H, W), float, in [0, 1]; half precision is computed in float32. camera: one, or one for each
    picture, presets by name. exposure_s, illuminance_lux, speed_px_s, direction_deg (counter-clockwise as
    displayed), temperature_c: a number or one per picture. gain_db: the same, analogue as far as the camera goes,
    then digital; or auto-exposure, which sets it for each picture's mean light and exposure. generator, encoding,
    fidelity: as ``simulate`` takes them; picture i depends on its own conditions and seed alone. Returns image's
    shape and dtype, in [0, 1].

    Gradients reach image and conditions. Raises ``TypeError`` or ``ValueError`` that names the argument.
    """
    scene = _clamped(image)
    cameras, batch = _cameras(camera), len(scene)
    if len(cameras) not in (1, batch):
        raise ValueError(f"camera: got {len(cameras)}; must be one, or {batch}, one for each picture")
    exposure = limited_per_image("exposure_s", exposure_s, batch, scene)
    lux = limited_per_image("illuminance_lux", illuminance_lux, batch, scene)
    temperature = limited_per_image("temperature_c", temperature_c, batch, scene)
    speed = limited_per_image("speed_px_s", speed_px_s, batch, scene)
    velocity = velocity_px_s(speed, limited_per_image("direction_deg", direction_deg, batch, scene))
    seeds = rng.item_seeds(generator, batch)
    if isinstance(gain_db, AutoExposure):
        with torch.no_grad():
            light = scene_reflectance(scene, encoding)
            by_camera = {each: mean_luma(light, each).tolist() for each in {*cameras}}
            means = [by_camera[cameras[item % len(cameras)]][item] for item in range(batch)]
        set_by = zip(means, lux.tolist(), exposure.tolist(), temperature.tolist(), strict=True)
        gains = [
            gain_db.gain_db(
                cameras[item % len(cameras)],
                mean_light=mean,
                illuminance_lux=light,
                exposure_s=exposure_s,
                temperature_c=celsius,
            )
            for item, (mean, light, exposure_s, celsius) in enumerate(set_by)
        ]
    else:
        gains = limited_per_image("gain_db", gain_db, batch, scene).tolist()

    def pictures(taker: Amplified, of: list[int]) -> Tensor:
        camera, digital_db = taker
        dn = simulate(
            scene if len(of) == batch else scene[of],
            camera,
            exposure_s=exposure[of],
            illuminance_lux=lux[of],
            velocity_px_s=velocity[of],
            temperature_c=temperature[of],
            encoding=encoding,
            generator=[seeds[item] for item in of],
            fidelity=fidelity,
        )
        return in_channels(
            develop(dn, camera, encoding=encoding, gain_db=digital_db, whole=True), scene.shape[1]
        )

    taken_by: dict[Amplified, list[int]] = {}
    for item, gain in enumerate(gains):
        taken_by.setdefault(cameras[item % len(cameras)].at_gain(gain), []).append(item)
    with torch.autocast(scene.device.type, enabled=False):
        parts = {each: pictures(each, items) for each, items in taken_by.items()}
    if len(parts) == 1:
        return next(iter(parts.values())).to(image.dtype)
    out = torch.empty_like(image)
    for each, items in taken_by.items():
        out[items] = parts[each].to(image.dtype)
    return out


@dataclass(frozen=True)
class ExposureRanges:
    """What conditions are drawn from; each range a number or (low, high).

    camera: one or several, presets by name, each as likely as the others; kept as a tuple. exposure_s and
    illuminance_lux, from 1e-9 s and 1e-6 lux on, are log-uniform: they multiply the light, so that each doubling
    is as likely as the next, where a uniform draw would hardly ever be dark. speed_px_s >= 0, direction_deg and
    temperature_c (-273.15 to 300) are uniform, as is gain_db; "auto", or an :class:`blurnoise.AutoExposure`, sets it
    for each picture. The longest exposure at the highest speed moves 1e5 px at most.

    Raises ``ValueError`` or ``TypeError`` naming the range, its value and what is allowed.
    """

    camera: Cameras = "imx250"
    exposure_s: Range = (0.001, 0.060)
    illuminance_lux: Range = (5.0, 500.0)
    speed_px_s: Range = (0.0, 1000.0)
    direction_deg: Range = (0.0, 360.0)
    temperature_c: Range = 25.0
    gain_db: Gain = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "camera", _cameras(self.camera))
        object.__setattr__(self, "gain_db", _gain(self.gain_db, self.cameras))
        for name in _DRAWN:
            object.__setattr__(self, name, _bounds(name, getattr(self, name)))
        (_, longest), (_, fastest) = (
            _bounds("exposure_s", self.exposure_s),
            _bounds("speed_px_s", self.speed_px_s),
        )
        if longest * fastest > LIMITS["displacement_px"].high:
            raise ValueError(
                f"exposure_s, speed_px_s = {longest:g}, {fastest:g} at most: their product, the motion during the "
                f"exposure, must be <= {LIMITS['displacement_px'].high:g} px"
            )

    @property
    def cameras(self) -> tuple[Camera, ...]:
        """The cameras to choose from; ``camera_index`` of the conditions counts in them."""
        return _cameras(self.camera)

    def gain(self, params: Params, of: slice | list[int] = slice(None)) -> Tensor | float | AutoExposure:
        """What was drawn for these pictures, or what holds for all."""
        return params["gain_db"][of] if "gain_db" in params else self.gain_db  # type: ignore[return-value]

    @property
    def draws(self) -> int:
        """How many uniform values the conditions of one picture take."""
        return len(_DRAWN) + 1 + isinstance(self.gain_db, tuple)

    def conditions(self, uniform: Tensor) -> Params:
        """The conditions at ``uniform`` (B, ``draws``), values in [0, 1): (B,) each, and ``camera_index``, int64.

        ``gain_db`` is among them where it is drawn.
        """
        shares, camera_share = uniform.unbind(-1)[: len(_DRAWN)], uniform[..., len(_DRAWN)]
        drawn = {}
        for name, share in zip(_DRAWN, shares, strict=True):
            low, high = getattr(self, name)
            value = low * (high / low) ** share if name in DRAWN_FROM else low + (high - low) * share
            drawn[name] = value.clamp(low, high)
        if isinstance(self.gain_db, tuple):
            low, high = self.gain_db
            drawn["gain_db"] = (low + (high - low) * uniform[..., -1]).clamp(low, high)
        index = (camera_share * len(self.cameras)).long()
        return {**drawn, "camera_index": index.clamp_max(len(self.cameras) - 1)}

    def __str__(self) -> str:
        cameras = ", ".join(camera.name for camera in self.cameras)
        return ", ".join(
            [f"camera=({cameras})", *(f"{name}={getattr(self, name)}" for name in (*_DRAWN, "gain_db"))]
        )


class ExposureGenerator(RandomGeneratorBase):  # type: ignore[misc]  # kornia is not followed by mypy
    """Draws from ``ranges`` by torch's global generator, as all of Kornia does: conditions and noise seeds.

    Returns, for a batch of B, (B,) tensors: what :meth:`ExposureRanges.conditions` returns, and ``noise_seed``,
    int64. Under ``same_on_batch`` they are equal, the noise seed too, so equal pictures stay equal.
    """

    def __init__(self, ranges: ExposureRanges) -> None:
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
        encoding: Encoding = "srgb",
        fidelity: Fidelity = "auto",
        grow_boxes: bool = False,
        same_on_batch: bool = False,
        p: float = 0.5,
        keepdim: bool = False,
    ) -> None:
        super().__init__(p=in_range("p", p, 0.0, 1.0), same_on_batch=same_on_batch, keepdim=keepdim)
        self.ranges = ExposureRanges(
            camera, exposure_s, illuminance_lux, speed_px_s, direction_deg, temperature_c, gain_db
        )
        self._param_generator = ExposureGenerator(self.ranges)
        self.flags = {
            "encoding": one_of("encoding", encoding, ("srgb", "linear")),
            "fidelity": one_of("fidelity", fidelity, ("auto", "full")),
            "grow_boxes": grow_boxes,
        }

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
        cameras = self.ranges.cameras
        exposed = expose_pictures(
            input[of],
            [cameras[index] for index in params["camera_index"][of].tolist()],
            **{name: params[name][of] for name in _DRAWN},
            gain_db=self.ranges.gain(params, of),
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
        corners = moved_corners(input.data, params, self.ranges.cameras, (height, width))
        if corners is not input.data:
            input = input.clone()
            input.data.copy_(corners)
        if not flags["grow_boxes"]:
            return input
        # (B, N, 4, 2), or (N, 4, 2) of one picture; the last pixel, not its outer edge
        half = swept_half_px(params).to(corners).reshape(-1, *[1] * (corners.ndim - 2), 2)
        centre = (corners.amin(-2, keepdim=True) + corners.amax(-2, keepdim=True)) / 2
        outward = (corners - centre).sign()
        # A box of one pixel has all its corners in the centre: there they go by their order.
        outward = torch.where((outward == 0).all(-2, keepdim=True), corners.new_tensor(_CORNERS), outward)
        grown = input.clone()
        grown.data.copy_(within_picture(corners, outward * half, (width - 1, height - 1)))
        return grown

    def _chosen(self, params: Params, batch: int) -> list[int]:
        """Which pictures to expose. Kornia computes all and discards those that were not to be."""
        if self.p == 1 and self.p_batch == 1:  # then Kornia asks no gate, either
            return list(range(batch))
        return [item for item, gate in enumerate(params["batch_prob"].tolist()) if gate > 0.5]


def velocity_px_s(speed_px_s: Tensor, direction_deg: Tensor) -> Tensor:
    """Velocities (B, 2), x right and y down, of speeds (B,) in directions (B,), counter-clockwise as displayed."""
    angle = torch.deg2rad(direction_deg)
    return torch.stack([angle.cos(), -angle.sin()], dim=-1) * speed_px_s[:, None]


def swept_half_px(params: Params) -> Tensor:
    """Half the displacement during the exposure, (B, 2), px, >= 0: what is swept to either side of a place."""
    velocity = velocity_px_s(params["speed_px_s"], params["direction_deg"])
    return motion.swept_half_px(velocity * params["exposure_s"][:, None])


def moved_corners(
    corners: Tensor, params: Params, cameras: Sequence[Camera], size: tuple[int, int]
) -> Tensor:
    """Corners (B, N, 4, 2) or (N, 4, 2) of boxes, px, where the light effects have them at mid-exposure.

    Where no effect displaces the picture (H, W) = ``size``, ``corners`` itself.
    """
    if not any(map(effects.displace, cameras)):
        return corners
    numbers = [params[name].tolist() for name in ("exposure_s", "illuminance_lux", "temperature_c")]
    moved_px = velocity_px_s(params["speed_px_s"], params["direction_deg"]) * params["exposure_s"][:, None]
    rows = zip(params["camera_index"].tolist(), *numbers, moved_px.tolist(), strict=True)
    points = [
        OperatingPoint(
            cameras[index],
            exposure_s,
            temperature_c,
            photoelectrons(cameras[index], lux, exposure_s),
            (x, y),
            size=size,
        )
        for index, exposure_s, lux, temperature_c, (x, y) in rows
    ]
    batched = corners if len(points) > 1 or corners.ndim == 4 else corners[None]
    moved = batched.clone()
    for item, (boxes, at) in enumerate(zip(batched.double(), points, strict=True)):
        low, high = boxes.amin(-2), boxes.amax(-2)
        new = effects.moved_boxes(torch.cat([low, high], -1), at)
        share = (boxes - low[:, None]) / (high - low)[:, None].clamp_min(1e-12)
        moved[item] = (new[:, None, :2] + share * (new[:, None, 2:] - new[:, None, :2])).to(moved)
    return moved.view_as(corners)


def within_picture(corners: Tensor, by: Tensor, last: tuple[float, float]) -> Tensor:
    """``corners`` (..., 2) moved outward ``by``, not beyond 0 or ``last`` (x, y); what lies beyond stays there."""
    moved = torch.maximum(corners + by, corners.clamp(max=0))
    return torch.minimum(moved, torch.maximum(corners, corners.new_tensor(last)))


_DRAWN = ("exposure_s", "illuminance_lux", "speed_px_s", "direction_deg", "temperature_c")
_CORNERS = [[-1, -1], [1, -1], [1, 1], [-1, 1]]


def _bounds(name: str, value: Range) -> tuple[float, float]:
    if isinstance(value, (int, float)):
        value = (value, value)
    if not isinstance(value, Sequence) or isinstance(value, str) or len(value) != 2:
        raise TypeError(f"{name} = {shown(value)}: must be a number or (low, high)")
    first, last = (limited(name, each) for each in value)
    if first > last:
        raise ValueError(f"{name} = {shown(value)}: must be (low, high), low <= high")
    least = DRAWN_FROM.get(name, first)
    if first < least:
        above = "> 0" if first == 0 else f">= {least:g}"
        raise ValueError(f"{name} = {shown(value)}: must be {above}, as it is drawn log-uniformly")
    return first, last


def _gain(gain_db: Gain, cameras: Sequence[Camera]) -> float | tuple[float, float] | AutoExposure:
    if isinstance(gain_db, AutoExposure):
        return gain_db
    if gain_db == "auto":
        return AutoExposure()
    if not isinstance(gain_db, (int, float, Sequence)) or isinstance(gain_db, str):
        raise TypeError(
            f"gain_db = {shown(gain_db)}: must be a number, (low, high), 'auto' or an AutoExposure"
        )
    low, high = _bounds("gain_db", gain_db)
    for camera in cameras:
        camera.at_gain(low), camera.at_gain(high)
    return low if low == high else (low, high)


def _cameras(camera: Cameras) -> tuple[Camera, ...]:
    if not isinstance(camera, (Camera, str, Sequence)):
        raise TypeError(f"camera: must be cameras or names of presets, got {type(camera).__name__}")
    given = [camera] if isinstance(camera, (Camera, str)) else list(camera)
    if not given:
        raise ValueError("camera = []: must be at least one camera")
    for each in given:
        if not isinstance(each, (Camera, str)):
            raise TypeError(f"camera: must be cameras or names of presets, got {type(each).__name__}")
    return tuple(Camera.preset(each) if isinstance(each, str) else each for each in given)


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
