"""None"""

from __future__ import annotations

import math
import threading
import time
from collections import OrderedDict
from collections.abc import Hashable, Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import groupby
from typing import Any, NamedTuple, TypeVar

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from blurnoise._core import rng
from blurnoise._core.borders import BORDERS, Border
from blurnoise._core.checks import Numbers, batch_shaped, image_batch, integer, one_of
from blurnoise._core.limits import limited
from blurnoise._core.uncompiled import uncompiled
from blurnoise.blur.layers import Layer, Layers, of_each
from blurnoise.light import effects
from blurnoise.light.conditions import Conditions
from blurnoise.light.motion import MOTION_VARIATION
from blurnoise.motion.trajectory import Trajectory
from blurnoise.optics.camera import Camera
from blurnoise.optics.colour import Encoding, linear_from_srgb
from blurnoise.optics.spectra import Curve, check_illuminant
from blurnoise.picture.develop import develop_8bit, in_channels, tabulated, tones_8bit
from blurnoise.picture.steps import magnification
from blurnoise.scene.exposure import MOVES as MOVES
from blurnoise.scene.exposure import Exposure as Exposure
from blurnoise.scene.metering import anchored
from blurnoise.scene.plan import TOLERANCE_DN, Plan, plan_at
from blurnoise.sensor import mosaic
from blurnoise.sensor.readout import Fidelity, FixedPattern, ReadoutOptions, digitised

Point = TypeVar("Point", Conditions[float], Conditions[Tensor])
_FIELDS = 2  # noise fields that a scene keeps


class Frame(NamedTuple):
    """A developed frame, (H, W, C) uint8, and the ms it took."""

    picture: NDArray[np.uint8]
    simulate_ms: float


class ExposedScene:
    """Pictures as linear light (B, C, H, W), before cameras; 1 is white. Any number of threads may use it.

    layers: objects before the pictures, of all of them or a sequence for each (:mod:`blurnoise.blur.layered`).
    border, illuminant, pattern_seed, fidelity and tolerance_dn: as :func:`blurnoise.simulate` takes them. Raises
    ``TypeError`` or ``ValueError`` naming the argument.
    """

    def __init__(
        self,
        light: Tensor,
        *,
        border: Border = "reflect",
        illuminant: str | Curve = "D55",
        pattern_seed: int = 0,
        fidelity: Fidelity = "auto",
        tolerance_dn: float = TOLERANCE_DN,
        layers: Layers = (),
    ) -> None:
        self.light = image_batch("light", light)
        own = of_each(layers, light)
        self._layers = own if any(own) else ()
        seen = light.detach().flatten(1)
        brightest = seen.amax(1).tolist() if seen.device.type != "cpu" else seen.numpy().max(1).tolist()
        self._brightest = [
            max(1.0, most, *(float(layer.light.detach().amax()) for layer in some))
            for most, some in zip(brightest, own, strict=True)
        ]
        self.fidelity: Fidelity = one_of("fidelity", fidelity, ("auto", "full"))  # type: ignore[assignment]
        one_of("border", border, BORDERS)
        check_illuminant(illuminant)
        integer("pattern_seed", pattern_seed, 0, rng.LAST_SEED)
        limited("tolerance_dn", tolerance_dn)
        self._border, self._illuminant, self._pattern_seed = border, illuminant, pattern_seed
        self._tolerance_dn = tolerance_dn
        self._fields: OrderedDict[tuple[int, str, int], Tensor] = OrderedDict()
        self._lock = threading.Lock()

    @classmethod
    def of_picture(
        cls, picture: NDArray[Any], grey_anchor: str | None = None, **options: Any
    ) -> ExposedScene:
        """The scene of an 8- or 16-bit sRGB-coded picture (H, W, C); the further options are the constructor's.

        grey_anchor: what is 18 % reflectance, see :class:`.metering.GreyAnchor`; None: its brightness is reflectance.
        """
        return cls(anchored(_decoded(picture), grey_anchor), **options)

    def expose(
        self,
        camera: Camera,
        *,
        exposure_s: Numbers,
        illuminance_lux: Numbers,
        velocity_px_s: Tensor | Iterable[float] = (0.0, 0.0),
        trajectory: Trajectory | Sequence[Trajectory | None] | None = None,
        temperature_c: Numbers = 25.0,
        generator: rng.Randomness = None,
        noise: bool = True,
        quantised: bool = True,
    ) -> Tensor:
        """Frame i of picture i, digital numbers (B, C, H, W), of a mosaic or one plane (B, 1, H, W).

        Arguments as :func:`blurnoise.simulate` takes them.
        """
        points = Conditions.of(
            self.light,
            camera,
            exposure_s=exposure_s,
            illuminance_lux=illuminance_lux,
            velocity_px_s=velocity_px_s,
            temperature_c=temperature_c,
            illuminant=self._illuminant,
            trajectory=trajectory,
            objects=self._layers,
        )
        batch = len(self.light)
        seeds = rng.item_seeds(generator, batch)
        moved = points.displacement_px if points.flow_px is None else points.flow_px
        given = (self.light, points.exposure_s, points.white_e, moved, points.temperature_c)
        asked = [torch.as_tensor(each).requires_grad for each in given]
        asked += [layer.requires_grad for some in self._layers for layer in some]
        differentiable = torch.is_grad_enabled() and any(asked)

        def frames(of: list[int], needs: Plan | None) -> Tensor:
            every = len(of) == batch
            some = points if every else points.part(of)
            light = self.light if every else self.light[of]
            return self._read(light, some, needs, [seeds[item] for item in of], noise, quantised)

        if self.fidelity == "full" or differentiable:
            return frames(list(range(batch)), None)
        groups: dict[tuple[Camera, frozenset[str], bool], tuple[Plan, list[int]]] = {}
        peak = mosaic.peak(camera, self._illuminant)
        for item, at in enumerate(points.each()):
            needs = plan_at(_brighter(at, self._brightest[item] * peak), self._tolerance_dn)
            _, of = groups.setdefault((needs.camera, needs.without, needs.noisy), (needs, []))
            of.append(item)
        if len(groups) == 1:
            ((needs, of),) = groups.values()
            return frames(of, needs)
        planes = mosaic.planes(camera, self.light.shape[1])
        out = torch.empty_like(self.light[:, :planes], memory_format=torch.contiguous_format)
        for needs, of in groups.values():
            out[of] = frames(of, needs)
        return out

    def frames(self, exposures: Sequence[Exposure]) -> Iterator[Frame]:
        """The only picture under each exposure, developed to 8 bits; neighbours share what they have in common.

        Raises ``ValueError`` where the scene has several pictures.
        """
        if len(self.light) != 1:
            raise ValueError(
                f"light: has {len(self.light)} pictures; must be one, which every exposure is of"
            )
        after_effects: dict[Hashable, Tensor] = {}
        for shared, group in groupby(self._planned(exposures), key=lambda each: each.alike):
            started = time.perf_counter()
            alike = list(group)
            points, needs = alike[0].points, alike[0].needs
            if shared.light not in after_effects:
                reduced = _reduced(points, needs)
                after_effects[shared.light] = effects.through(
                    self.light, reduced, border=self._border, without=shared.without
                )
            pictures = self._developed(after_effects[shared.light], shared, alike)
            simulate_ms = 1e3 * (time.perf_counter() - started) / len(alike)
            yield from (Frame(picture, simulate_ms) for picture in pictures)

    def _developed(
        self, light: Tensor, shared: _Alike, alike: Sequence[_Planned]
    ) -> Sequence[NDArray[np.uint8]]:
        count, (_, colours, height, width) = len(alike), self.light.shape
        sensed = mosaic.on_sensor(light, shared.camera, self._illuminant)
        planes = sensed.shape[1]
        at = Conditions(
            shared.camera,
            torch.cat([each.points.exposure_s for each in alike]),
            torch.cat([each.points.temperature_c for each in alike]),
            torch.cat([each.points.white_e for each in alike]),
        )
        options = ReadoutOptions(
            [shared.seed] * count,
            self._pattern(shared.camera),
            self.fidelity,
            noise=shared.noisy,
            without=shared.without,
            draw=self._normal,
        )
        expanded = sensed.expand(count, -1, -1, -1)
        if tabulated(shared.delivering):
            seen = torch.empty((count, height, width, planes), dtype=torch.uint8)
            tones = tones_8bit(shared.delivering, shared.digital_db, self._illuminant)
            digitised(expanded, at, replace(options, tones=tones, out=seen.permute(0, 3, 1, 2)))
            if planes == colours:
                return list(seen.numpy())
            developed = seen.permute(0, 3, 1, 2)
        else:
            dn = digitised(expanded, at, options)
            developed = develop_8bit(dn, shared.delivering, shared.digital_db, self._illuminant)
        return list(in_channels(developed, colours).permute(0, 2, 3, 1).contiguous().numpy())

    def _planned(self, exposures: Sequence[Exposure]) -> Iterator[_Planned]:
        for (camera, drives), of_camera in groupby(
            exposures, key=lambda each: (each.amplified.camera, each if each.drives else None)
        ):  # one flow at a time
            some = list(of_camera)
            motion = [self._velocity(each) for each in some]
            points = Conditions.of(
                self.light.expand(len(some), -1, -1, -1),
                camera,
                exposure_s=[each.exposure_s for each in some],
                illuminance_lux=[each.illuminance_lux for each in some],
                velocity_px_s=motion if drives is None else self._flow(drives, camera),
                temperature_c=[each.temperature_c for each in some],
                illuminant=self._illuminant,
                trajectory=[each.trajectory for each in some],
                objects=tuple(map(self._objects, some)) if self._layers else (),
            )
            for place, (exposure, at) in enumerate(zip(some, points.each(), strict=True)):
                digital_db = exposure.amplified.digital_db
                gain = max(1.0, 10 ** (digital_db / 20))  # which magnifies what is left out, as do colours
                gain *= magnification(camera, self._illuminant)
                lit = _brighter(at, self._brightest[0] * mosaic.peak(camera, self._illuminant))
                needs = plan_at(lit, self._tolerance_dn / gain) if self.fidelity == "auto" else None
                without = needs.without if needs else effects.NOTHING
                alike = _Alike(
                    needs.camera if needs else camera,
                    without,
                    needs.noisy if needs else True,
                    camera,
                    digital_db,
                    exposure.seed,
                    (
                        effects.key(_reduced(at, needs), without),
                        drives and (drives.vehicle, drives.ego_speed_m_s),
                    ),
                )
                yield _Planned(alike, points.part(slice(place, place + 1)), needs)

    def _velocity(self, exposure: Exposure) -> tuple[float, float]:
        if exposure.moves != "all":
            raise ValueError(
                f"moves = {exposure.moves!r}: must be 'all' of a scene from which nothing is cut out"
            )
        return exposure.velocity_px_s

    def _flow(self, exposure: Exposure, camera: Camera) -> Tensor:
        return exposure.vehicle.flow_px_s(camera, self._size, exposure.ego_speed_m_s)

    def _objects(self, exposure: Exposure) -> tuple[Layer, ...]:
        return self._layers[0]

    def _read(
        self,
        light: Tensor,
        points: Conditions[Tensor],
        needs: Plan | None,
        seeds: list[int],
        noise: bool,
        quantised: bool,
    ) -> Tensor:
        reduced = _reduced(points, needs)
        without = needs.without if needs else effects.NOTHING
        moved = effects.through(light, reduced, border=self._border, without=without)
        sensed = mosaic.on_sensor(moved, reduced.camera, self._illuminant)
        noisy = noise and (needs is None or needs.noisy)
        pattern = self._pattern(reduced.camera)
        own = sensed if sensed is not light and sensed.is_contiguous() else None
        options = ReadoutOptions(seeds, pattern, self.fidelity, noisy, quantised, without, out=own)
        return digitised(sensed, reduced, options)

    @property
    def _size(self) -> tuple[int, int]:
        return self.light.shape[-2], self.light.shape[-1]

    def _pattern(self, camera: Camera) -> FixedPattern | None:
        if camera.prnu == 0 and camera.dsnu_e == 0:
            return None
        _, colours, *size = self.light.shape
        return camera.fixed_pattern((mosaic.planes(camera, colours), *size), self._pattern_seed)

    def _normal(self, seeds: Sequence[int], like: Tensor, stream: str) -> Tensor:
        """``rng.standard_normal`` of one seed for all items; the last ``_FIELDS`` are kept."""
        key = (seeds[0], stream, like.shape[1])
        with self._lock:
            if key not in self._fields:
                self._fields[key] = rng.standard_normal(seeds[:1], like[:1], stream)
                while len(self._fields) > _FIELDS:
                    self._fields.popitem(last=False)
            return self._fields[key].expand(like.shape)


def scene_reflectance(image: Tensor, encoding: Encoding) -> Tensor:
    """Reflectance, linear light in [0, 1], of a picture (B, C, H, W) coded as ``encoding`` says."""
    batch_shaped("image", image)
    one_of("encoding", encoding, ("srgb", "linear"))
    seen = image.detach()  # NumPy's extremes wake no threads, which would spin beside the work that follows
    bounds = seen.aminmax() if seen.device.type != "cpu" else (seen.numpy().min(), seen.numpy().max())
    low, high = (float(bound) for bound in bounds)
    if not math.isfinite(low + high):  # extremes hand NaN on
        raise ValueError("image: contains NaN or Inf")
    if low < 0.0 or high > 1.0:
        raise ValueError(f"image: values span [{low:g}, {high:g}]; must lie within [0, 1]")
    return linear_from_srgb(image) if encoding == "srgb" else image


class _Alike(NamedTuple):
    """What exposures must have in common to be read out together; light: the key of what the effects make."""

    camera: Camera
    without: frozenset[str]
    noisy: bool
    delivering: Camera
    digital_db: float
    seed: int
    light: Hashable


class _Planned(NamedTuple):
    alike: _Alike
    points: Conditions[Tensor]
    needs: Plan | None


def _brighter(at: Conditions[float], brightest: float) -> Conditions[float]:
    """Where the brightest of a picture stands: bounds are for light up to 1."""
    return at if brightest == 1.0 else replace(at, white_e=at.white_e * brightest)


def _reduced(at: Point, needs: Plan | None) -> Point:
    """The conditions with what is left out set to 0."""
    if needs is None:
        return at
    one_motion = MOTION_VARIATION.name in needs.without
    return replace(at, camera=needs.camera, flow_px=None if one_motion else at.flow_px)


def _decoded(picture: NDArray[Any]) -> Tensor:
    """``scene_reflectance`` of a picture (H, W, C), (1, C, H, W): looked up, since its codes are integers."""
    most = np.iinfo(picture.dtype).max
    codes = torch.arange(most + 1, dtype=torch.float32) / float(most)
    table = scene_reflectance(codes[None, None, None], "srgb").flatten()
    planes = [torch.from_numpy(plane.astype(np.int32)).flatten() for plane in cv2.split(picture)]
    looked_up = torch.stack([table.index_select(0, plane) for plane in planes])
    return looked_up.view(1, len(planes), *picture.shape[:2]).contiguous()


@uncompiled
def simulate(
    image: Tensor,
    camera: Camera,
    *,
    exposure_s: Numbers,
    illuminance_lux: Numbers,
    velocity_px_s: Tensor | Iterable[float] = (0.0, 0.0),
    trajectory: Trajectory | Sequence[Trajectory | None] | None = None,
    temperature_c: Numbers = 25.0,
    encoding: Encoding = "srgb",
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

    Of a camera with a mosaic, or of one plane of light, it is the raw plane: (B, 1, H, W), C being 1 or 3.

    image: (B, C, H, W) in [0, 1], the scene's reflectance, sRGB-coded or "linear"; 1 is white. exposure_s
    (s) and illuminance_lux (lux on the scene) >= 0, temperature_c (degC): a number or one per image.
    grey_anchor: "mean", "pNN" or "x0,y0,x1,y1": what of each picture is 18 % reflectance instead of its brightness
    being reflectance (:mod:`blurnoise.scene.metering`); more than white stays.
    velocity_px_s: (2,) or (B, 2), motion in the image, x right, y down; or of each pixel, (2, H, W) or (B, 2, H, W),
    as :mod:`blurnoise.motion.ego` gives it for a moving camera. illuminant: the light's spectrum.
    trajectory: :class:`blurnoise.Trajectory`, one for all or one, or None, per image: a path about mid-exposure,
    added to the velocity, whose gradient it stops; :func:`blurnoise.blur.paths.polyline_blur` has one of its own.
    pattern_seed: which specimen of the camera (its fixed pattern). generator: a ``torch.Generator``, one
    seed per image, or None for torch's default generator; image i depends on its own seed alone.

    layers: objects that move for themselves before ``image``, in linear light, each a :class:`blurnoise.Layer` with
    its velocity; those of all pictures, or a sequence for each. ``velocity_px_s`` is then the background's.

    Order: linear light, then :data:`blurnoise.light.effects.EFFECTS` (lens, motion), the colour filters
    (:mod:`blurnoise.sensor.mosaic`), then
    :data:`blurnoise.sensor.stages.STAGES` (light level, shot, dark and read noise, full well, gain, black level,
    rounding, converter limits).

    fidelity: "full" models everything, "auto" what :func:`blurnoise.plan` keeps of it for each image
    within ``tolerance_dn`` (DN RMS). noise: without it, the mean frame. quantised: without it, before rounding.
    Gradients reach image, exposure, illuminance, velocity and temperature; with them, everything is modelled.
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
