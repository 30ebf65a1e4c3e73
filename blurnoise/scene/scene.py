"""Scenes in linear light, exposed: a batch of pictures, one picture many times, or all in one call."""

from __future__ import annotations

import math
import time
from collections.abc import Hashable, Iterable, Iterator, Sequence
from dataclasses import KW_ONLY, dataclass, replace
from functools import lru_cache, partial
from itertools import groupby
from typing import Any, NamedTuple, Self

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from blurnoise._core import rng
from blurnoise._core.borders import BORDERS, Border
from blurnoise._core.checks import Numbers, an_instance, batch_shaped, image_batch, integer, limited, one_of
from blurnoise._core.threads import differentiable, same_bits
from blurnoise.blur.layers import Layer, Layers, layers_per_picture
from blurnoise.camera import Camera, radiometry
from blurnoise.camera.colour import PictureTone, picture_tone, untoned
from blurnoise.camera.spectra import Curve, check_illuminant
from blurnoise.light import effects
from blurnoise.light.conditions import Conditions
from blurnoise.motion.trajectory import Trajectory
from blurnoise.picture.develop import develop_8bit, in_channels, tabulated, tones_8bit
from blurnoise.picture.steps import magnification
from blurnoise.scene.exposure import Exposure as Exposure
from blurnoise.scene.metering import anchored
from blurnoise.scene.plan import TOLERANCE_DN, Plan, plan_at
from blurnoise.sensor.readout import Fidelity, ReadoutOptions, digitised

_FIELDS = 2  # noise fields that a scene keeps


class Frame(NamedTuple):
    """A developed frame, (H, W, C) uint8, and its computing time, ms."""

    picture: NDArray[np.uint8]
    simulate_ms: float


@dataclass(eq=False, repr=False)
class ExposedScene:
    """Pictures as linear light (B, C, H, W) to expose with cameras; 1 is white. Any number of threads may use it.

    layers: objects in front of the pictures, the same for all, or a sequence for each (:mod:`blurnoise.blur.layers`).
    border, illuminant, pattern_seed, fidelity and tolerance_dn: as :func:`blurnoise.simulate` takes them. Raises
    ``TypeError`` or ``ValueError`` naming the argument.
    """

    light: Tensor
    _: KW_ONLY
    border: Border = "reflect"
    illuminant: str | Curve = "D55"
    pattern_seed: int = 0
    fidelity: Fidelity = "auto"
    tolerance_dn: float = TOLERANCE_DN
    layers: Layers = ()

    def __post_init__(self) -> None:
        light = image_batch("light", self.light)
        own = layers_per_picture(self.layers, light)
        self._layers = own if any(own) else ()
        self._brightest = [
            max(1.0, extremes(picture)[1], *(float(layer.light.detach().amax()) for layer in some))
            for picture, some in zip(light, own, strict=True)
        ]
        one_of("fidelity", self.fidelity, ("auto", "full"))
        one_of("border", self.border, BORDERS)
        check_illuminant(self.illuminant)
        integer("pattern_seed", self.pattern_seed, 0, rng.LAST_SEED)
        limited("tolerance_dn", self.tolerance_dn)
        self._field = lru_cache(_FIELDS)(partial(_noise_field, self.light[:1, :1]))  # no cycle: freed at once

    @classmethod
    def of_picture(
        cls,
        picture: NDArray[Any],
        grey_anchor: str | None = None,
        encoding: PictureTone = "srgb",
        **options: Any,
    ) -> Self:
        """The scene of an 8- or 16-bit picture (H, W, C); the other options are those of the constructor.

        grey_anchor: the part that reflects 18 %, see :class:`.metering.GreyAnchor`; None: brightness is reflectance.
        encoding: the picture's tone curve.
        """
        return cls(anchored(_decoded(picture, encoding), grey_anchor), **options)

    @same_bits
    def expose(
        self,
        camera: Camera,
        *,
        generator: rng.Randomness = None,
        noise: bool = True,
        quantised: bool = True,
        **conditions: Any,
    ) -> Tensor:
        """Expose picture i for frame i; returns digital numbers (B, C, H, W), for a mosaic or one plane (B, 1, H, W).

        conditions: exposure_s, illuminance_lux, velocity_px_s, trajectory and temperature_c. All arguments as
        :func:`blurnoise.simulate` takes them.
        """
        an_instance("noise", noise, bool)
        an_instance("quantised", quantised, bool)
        at = Conditions.of(self.light, camera, illuminant=self.illuminant, objects=self._layers, **conditions)
        seeds = rng.item_seeds(generator, len(self.light))
        moved = torch.as_tensor(at.displacement_px) if at.flow_px is None else at.flow_px
        asked = differentiable(self.light, at.exposure_s, at.white_e, moved, at.temperature_c)
        asked |= any(layer.requires_grad for own in self._layers for layer in own)
        alike: dict[tuple[Plan, bool], list[int]] = {}
        for item, one in enumerate(at.each()):
            needs = Plan((), at.camera) if asked else self._plan(one, self._brightest[item])
            alike.setdefault((needs, bool(one.objects)), []).append(item)
        planes = radiometry.planes(at.camera, self.light.shape[1])
        out = torch.empty_like(self.light[:, :planes], memory_format=torch.contiguous_format)
        for (needs, _), of in alike.items():
            every, run = len(alike) == 1, of[-1] - of[0] < len(of)
            places: Any = slice(of[0], of[-1] + 1) if run else of  # without a copy
            light, some = self.light[places], at if every else at.part(of)
            sensed = radiometry.on_sensor(self._through(light, some, needs), needs.camera, self.illuminant)
            own = sensed.untyped_storage().data_ptr() != light.untyped_storage().data_ptr()
            into = sensed if own and sensed.is_contiguous() else None
            options = replace(
                self._readout(needs, [seeds[item] for item in of]),
                noise=noise and needs.noisy,
                quantised=quantised,
                out=out[places] if run and not every else into,
            )
            dn = digitised(sensed, needs.reduced(some), options)
            if every:
                return dn
            if dn is not options.out or not run:
                out[places] = dn
        return out

    def frames(self, exposures: Iterable[Exposure]) -> Iterator[Frame]:
        """Frames of the only picture, one per exposure, developed to 8 bits; adjacent exposures share common steps.

        Raises ``ValueError`` where the scene has several pictures.
        """
        if len(self.light) != 1:
            raise ValueError(f"light: has {len(self.light)} pictures; must be one, for all the exposures")
        after_effects: dict[Hashable, Tensor] = {}
        for alike, group in groupby(map(self._planned, exposures), key=lambda planned: planned[0]):
            started = time.perf_counter()
            points = [at for _, at in group]
            if alike.light not in after_effects:
                after_effects[alike.light] = self._through(self.light, points[0], alike.needs)
            sensed = radiometry.on_sensor(after_effects[alike.light], alike.needs.camera, self.illuminant)
            pictures = self._developed(sensed, alike, points)
            simulate_ms = 1e3 * (time.perf_counter() - started) / len(points)
            yield from (Frame(picture, simulate_ms) for picture in pictures)

    def plan(self, exposure: Exposure) -> Plan:
        """The parts of an exposure that :meth:`frames` models and omits, and why."""
        return self._planned(exposure)[0].needs

    def _planned(self, exposure: Exposure) -> tuple[_Alike, Conditions[Tensor]]:
        camera, digital_db = exposure.amplified
        velocity, objects = self.motions(exposure)
        same = ("exposure_s", "illuminance_lux", "temperature_c", "trajectory")
        at = Conditions.of(
            self.light,
            camera,
            **{name: getattr(exposure, name) for name in same},
            velocity_px_s=velocity,
            illuminant=self.illuminant,
            objects=(objects,) if objects else (),
        )
        (one,) = at.each()
        magnified = max(1.0, 10 ** (digital_db / 20)) * magnification(camera, self.illuminant)
        needs = self._plan(one, self._brightest[0], magnified)
        drives = (exposure.vehicle, exposure.ego_speed_m_s) if exposure.drives else None
        light = effects.key(needs.reduced(one), needs.without), drives
        return _Alike(needs, camera, digital_db, exposure.seed, light), at

    def _plan(self, one: Conditions[float], brightest: float, magnified: float = 1.0) -> Plan:
        """Plan for a picture with this light, whose errors gain and colour matrix magnify later."""
        if self.fidelity == "full":
            return Plan((), one.camera)
        brightest *= radiometry.peak(one.camera, self.illuminant)
        lit = one if brightest == 1.0 else replace(one, white_e=one.white_e * brightest)
        return plan_at(lit, self.tolerance_dn / magnified)

    def _through(self, light: Tensor, at: Conditions[Tensor], needs: Plan) -> Tensor:
        return effects.through(light, needs.reduced(at), border=self.border, without=needs.without)

    def _developed(
        self, sensed: Tensor, alike: _Alike, points: Sequence[Conditions[Tensor]]
    ) -> Sequence[NDArray[np.uint8]]:
        """Light on the sensor, of one picture, under conditions that share all that ``alike`` has."""
        count, (_, planes, height, width) = len(points), sensed.shape
        camera, colours = alike.needs.camera, self.light.shape[1]
        numbers = ("exposure_s", "temperature_c", "white_e")
        joined: Any = {name: torch.cat([getattr(each, name) for each in points]) for name in numbers}
        at = Conditions(camera, **joined)
        options = replace(self._readout(alike.needs, [alike.seed] * count), draw=self._normal)
        expanded = sensed.expand(count, -1, -1, -1)
        if tabulated(alike.delivering):
            developed = torch.empty((count, planes, height, width), dtype=torch.uint8)
            tones = tones_8bit(alike.delivering, alike.digital_db, self.illuminant)
            digitised(expanded, at, replace(options, tones=tones, out=developed))
        else:
            dn = digitised(expanded, at, options)
            developed = develop_8bit(dn, alike.delivering, alike.digital_db, self.illuminant)
        seen = in_channels(developed, colours)
        if seen.is_contiguous():
            return [cv2.merge(list(each)).reshape(height, width, colours) for each in seen.numpy()]
        return list(seen.permute(0, 2, 3, 1).contiguous().numpy())

    def motions(self, exposure: Exposure) -> tuple[tuple[float, float] | Tensor, tuple[Layer, ...]]:
        """Velocity of the picture, or the flow of its pixels, and the layers in front of it, for an exposure."""
        if exposure.moves != "all":
            raise ValueError(f"moves = {exposure.moves!r}: must be 'all' of a scene without cut-out parts")
        objects = self._layers[0] if self._layers else ()
        if not exposure.drives:
            return exposure.velocity_px_s, objects
        size = (self.light.shape[-2], self.light.shape[-1])
        return exposure.vehicle.flow_px_s(exposure.camera, size, exposure.ego_speed_m_s), objects

    def _readout(self, needs: Plan, seeds: list[int]) -> ReadoutOptions:
        camera, pattern = needs.camera, None
        if camera.sensor.prnu_total or camera.sensor.dsnu_total_e:
            _, colours, *size = self.light.shape
            pattern = camera.sensor.fixed_pattern(
                (radiometry.planes(camera, colours), *size), self.pattern_seed
            )
        return ReadoutOptions(seeds, pattern, self.fidelity, needs.noisy, without=needs.without)

    def _normal(self, seeds: Sequence[int], like: Tensor, stream: str) -> Tensor:
        """``rng.standard_normal`` of one seed for all items; the last ``_FIELDS`` are kept."""
        return self._field(seeds[0], stream, like.shape[1]).expand(like.shape)


def _noise_field(plane: Tensor, seed: int, stream: str, planes: int) -> Tensor:
    return rng.standard_normal([seed], plane.expand(-1, planes, -1, -1), stream)


def scene_reflectance(image: Tensor, encoding: PictureTone) -> Tensor:
    """Reflectance, linear light in [0, 1], of a picture (B, C, H, W) coded by the tone curve ``encoding``."""
    batch_shaped("image", image)
    curve = picture_tone(encoding)
    low, high = extremes(image)
    if not math.isfinite(low + high):  # extremes hand NaN on
        raise ValueError("image: contains NaN or Inf")
    if low < 0.0 or high > 1.0:
        raise ValueError(f"image: values span [{low:g}, {high:g}]; must lie within [0, 1]")
    return image if curve == "linear" else untoned(image, curve)


def extremes(values: Tensor) -> tuple[float, float]:
    """Smallest and largest value; NumPy's wake no threads, which would spin beside the work that follows."""
    seen = values.detach()
    low, high = seen.aminmax() if seen.device.type != "cpu" else (seen.numpy().min(), seen.numpy().max())
    return float(low), float(high)


class _Alike(NamedTuple):
    """Properties that exposures must share to be read out together; light: the key of the light effects."""

    needs: Plan
    delivering: Camera
    digital_db: float
    seed: int
    light: Hashable


def _decoded(picture: NDArray[Any], encoding: PictureTone) -> Tensor:
    """``scene_reflectance`` of a picture (H, W, C), (1, C, H, W): looked up, since its codes are integers."""
    most = np.iinfo(picture.dtype).max
    codes = torch.arange(most + 1, dtype=torch.float32) / float(most)
    table = scene_reflectance(codes[None, None, None], encoding).flatten().numpy()
    return torch.from_numpy(np.stack([table[plane] for plane in cv2.split(picture)]))[None]


@same_bits
def simulate(
    image: Tensor,
    camera: Camera,
    *,
    exposure_s: Numbers,
    illuminance_lux: Numbers,
    velocity_px_s: Tensor | Iterable[float] = (0.0, 0.0),
    trajectory: Trajectory | Sequence[Trajectory | None] | None = None,
    temperature_c: Numbers = 25.0,
    encoding: PictureTone = "srgb",
    grey_anchor: str | None = None,
    illuminant: str | Curve = "D55",
    border: Border = "reflect",
    pattern_seed: int = 0,
    generator: rng.Randomness = None,
    fidelity: Fidelity = "auto",
    tolerance_dn: float = TOLERANCE_DN,
    noise: bool = True,
    quantised: bool = True,
    layers: Layers = (),
) -> Tensor:
    """Expose ``image`` with ``camera``; returns digital numbers, integral values, of the same shape.

    For a camera with a mosaic, or one plane of light, the result is the raw plane (B, 1, H, W); C must be 1 or 3.

    image: (B, C, H, W) in [0, 1], the scene's reflectance, 1 is white. encoding: its tone curve, "srgb", "linear",
    "filmic" or points (light, value), see :mod:`blurnoise.camera.colour`. exposure_s
    (s) and illuminance_lux (lux on the scene) >= 0, temperature_c (degC): a number or one per image.
    grey_anchor: "mean", "pNN" or "x0,y0,x1,y1": the part of each picture that reflects 18 %; None: brightness is
    reflectance (:mod:`blurnoise.scene.metering`). Light above white is kept. illuminant: the light's spectrum.
    velocity_px_s: (2,) or (B, 2), motion in the image, x right, y down; or of each pixel, (2, H, W) or (B, 2, H, W),
    as :mod:`blurnoise.motion.ego` computes it for a moving camera.
    trajectory: a :class:`blurnoise.Trajectory` for all images, or one or None for each: a path centred on
    mid-exposure, added to the velocity. It has no gradient (that of exposure_s is right to 1 %); use
    :func:`.convolution.path_blur` for one.
    layers: objects in front of ``image`` with motion of their own, in linear light, each a :class:`blurnoise.Layer`;
    the same for all pictures, or a sequence for each. ``velocity_px_s`` is then the velocity of the background.
    pattern_seed: selects the specimen of the camera (its fixed pattern). generator: a ``torch.Generator``, one
    seed per image, or None for torch's default generator; image i depends on its own seed alone.

    Order: linear light, :data:`blurnoise.light.effects.EFFECTS` (lens, motion), the colour filters, then
    :data:`blurnoise.sensor.stages.STAGES` (shot, dark and read noise, full well, gain, rounding, converter limits).

    fidelity: "full" models everything; "auto" models the parts that :func:`blurnoise.plan` keeps for each image
    within ``tolerance_dn`` (DN RMS). noise: False returns the mean frame. quantised: False omits rounding.
    Gradients reach image, exposure, illuminance, velocity and temperature; they are of the full model, and the
    numbers are the same with them and without.
    ``torch.compile`` breaks its graph here and runs it uncompiled, with the same result.
    Raises ``TypeError`` or ``ValueError`` naming the argument, its value and what is allowed: at most 3600 s,
    1e9 lux, 1e7 px/s, and 1e5 px of motion during the exposure.
    """
    scene = ExposedScene(
        anchored(scene_reflectance(image, encoding), grey_anchor),
        border=border,
        illuminant=illuminant,
        pattern_seed=pattern_seed,
        fidelity=fidelity,
        tolerance_dn=tolerance_dn,
        layers=layers,
    )
    return scene.expose(
        camera,
        exposure_s=exposure_s,
        illuminance_lux=illuminance_lux,
        velocity_px_s=velocity_px_s,
        trajectory=trajectory,
        temperature_c=temperature_c,
        generator=generator,
        noise=noise,
        quantised=quantised,
    )
