"""Taking pictures: an exposure of a scene to the digital numbers of a camera, and to the picture made of them.

One capture, in causal order: the scene as the capture finds it, lens and motion, the colour filters, the sensor's
stages. A camera of several captures takes one after the other, and the picture steps fuse them. Times count from the
start of the first capture. Each capture has its own window of time and its own noise, except for two gains on one
exposure, which read the same electrons.
"""

from __future__ import annotations

import time
from collections.abc import Hashable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any, Literal, cast

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from blurnoise._core import rng
from blurnoise._core.checks import an_instance, in_range, integer, limited, limited_per_image, one_of
from blurnoise._core.threads import differentiable, no_torch_compile, same_bits
from blurnoise.camera import Camera, radiometry
from blurnoise.camera.colour import Encoding
from blurnoise.light import effects
from blurnoise.light.resolved import Resolved
from blurnoise.picture.develop import develop, develop_8bit, in_channels, tabulated, tones_8bit, tones_of
from blurnoise.picture.fusion import captures_of, readers
from blurnoise.picture.steps import magnification
from blurnoise.scene.captures import captures_of_exposure
from blurnoise.scene.exposure import Exposure
from blurnoise.scene.metering import AutoExposure
from blurnoise.scene.plan import TOLERANCE_DN, Plan, plan_at
from blurnoise.scene.scene import Scene, brightest
from blurnoise.sensor.readout import Fidelity, ReadoutOptions, digitised

Shared = dict[Hashable, Tensor]
"""The only picture's light after all effects, by their key, which exposures share."""
Wanted = Literal["raw", "picture", "8 bit"]
WANTED: tuple[Wanted, ...] = ("raw", "picture", "8 bit")


@dataclass(frozen=True)
class TakeOptions:
    """What to compute of an exposure, and how accurately.

    wanted: any of "raw", the digital numbers of every capture; "picture", developed, floats in [0, 1]; "8 bit", the
    sRGB picture as uint8. fidelity: "full" models everything; "auto" models the parts whose omission would exceed
    ``tolerance_dn``, DN RMS of a raw frame, or of the developed picture where "8 bit" alone is wanted. noise: False
    gives mean frames. quantised: False omits rounding. pattern_seed: selects the specimen of the camera (its fixed
    pattern). encoding: of the picture, "srgb" for the camera's tone curve or "linear". white: the light that becomes
    white in a picture of several captures. Raises ``TypeError`` or ``ValueError`` naming the option.

    >>> import torch
    >>> from blurnoise import Camera, Exposure, Scene, TakeOptions, take
    >>> exposure = Exposure(Camera.preset("imx250"), exposure_s=0.005, illuminance_lux=60.0)
    >>> options = TakeOptions(wanted=("raw",), noise=False, quantised=False)
    >>> frames = take(Scene(torch.full((1, 1, 4, 6), 0.18)), exposure, options)
    >>> len(frames.raw), frames.picture.numel()  # what was not wanted is empty
    (1, 0)
    """

    wanted: tuple[Wanted, ...] = ("picture",)
    fidelity: Fidelity = "auto"
    tolerance_dn: float = TOLERANCE_DN
    noise: bool = True
    quantised: bool = True
    pattern_seed: int = 0
    encoding: Encoding = "srgb"
    white: float = 1.0

    def __post_init__(self) -> None:
        for name in self.wanted:
            one_of("wanted", name, WANTED)
        one_of("fidelity", self.fidelity, ("auto", "full"))
        limited("tolerance_dn", self.tolerance_dn)
        an_instance("noise", self.noise, bool)
        an_instance("quantised", self.quantised, bool)
        integer("pattern_seed", self.pattern_seed, 0, rng.LAST_SEED)
        in_range("white", self.white, 1e-6, 1e6)


_NOT_WANTED = torch.empty(0)
USUAL = TakeOptions()
EIGHT_BIT = TakeOptions(("8 bit",))


@dataclass(frozen=True)
class Frames:
    """Frames of a batch; what was not wanted is empty.

    exposure: with the gain and time that an auto-exposure set. raw: digital numbers of every capture, (B, C, H, W)
    each, for a mosaic or one plane (B, 1, H, W). picture: floats in [0, 1], (B, C, H, W), C at least the scene's.
    eight_bit: the sRGB picture, uint8. simulate_ms: computing time of each frame.

    >>> import torch
    >>> from blurnoise import Camera, Exposure, Scene, TakeOptions, take
    >>> exposure = Exposure(Camera.preset("imx250"), exposure_s=0.005, illuminance_lux=60.0)
    >>> frames = take(Scene(torch.full((1, 3, 4, 6), 0.18)), exposure, TakeOptions(("raw", "8 bit")))
    >>> frames.images()[0].shape, frames.native_images()[0].dtype
    ((4, 6, 3), dtype('uint16'))
    """

    exposure: Exposure[Any]
    raw: tuple[Tensor, ...] = ()
    picture: Tensor = _NOT_WANTED
    eight_bit: Tensor = _NOT_WANTED
    simulate_ms: float = 0.0

    def images(self) -> list[NDArray[np.uint8]]:
        """The 8-bit pictures, (H, W, C) each."""
        if not len(self.eight_bit):
            raise ValueError("wanted: must include '8 bit'")
        if not self.eight_bit.is_contiguous():
            return list(self.eight_bit.permute(0, 2, 3, 1).contiguous().numpy())
        _, channels, height, width = self.eight_bit.shape
        # OpenCV interleaves planes faster than a permutation copies them.
        planes = self.eight_bit.numpy()
        return [cv2.merge(list(picture)).reshape(height, width, channels) for picture in planes]

    def native_images(self) -> list[NDArray[np.uint16]]:
        """The digital numbers of each capture of the first picture, (H, W, C), 16 bits."""
        return [dn[0].permute(1, 2, 0).to(torch.int32).numpy().astype("uint16") for dn in self.raw]


@no_torch_compile
def take(scene: Scene, exposure: Exposure[Any], options: TakeOptions = USUAL) -> Frames:
    """Take the pictures of a scene with a camera, picture i under the i-th values of the exposure.

    Frame i depends on its own picture, values and seed alone. Gradients reach the scene's light and the values of the
    exposure. They are those of the full model, with one exception: the gradient by ``exposure_s`` ignores the pulses
    of a lamp and the motion between captures. The numbers are the same with gradients and without. Raises
    ``TypeError`` or ``ValueError`` naming the argument, its value and what is allowed.

    >>> from blurnoise import Camera, Exposure, Scene
    >>> scene = Scene(torch.full((1, 1, 4, 6), 0.18))
    >>> exposure = Exposure(Camera.preset("imx250"), exposure_s=0.005, illuminance_lux=60.0, seed=1)
    >>> frames = take(scene, exposure, TakeOptions(("raw", "8 bit"), noise=False))
    >>> frames.raw[0].shape, frames.eight_bit.shape
    (torch.Size([1, 1, 4, 6]), torch.Size([1, 1, 4, 6]))
    """
    an_instance("scene", scene, Scene)
    an_instance("options", options, TakeOptions)
    return _taken(scene, _metered(scene, exposure), options, len(scene.light))


def take_each(
    scene: Scene, exposures: Iterable[Exposure[float]], options: TakeOptions = EIGHT_BIT
) -> Iterator[Frames]:
    """Take the only picture of a scene under each exposure: the frames of one exposure after the other.

    Exposures whose picture is equal behind the lens share the effects of light; adjacent ones that differ in light,
    time and temperature alone are read out together. Raises ``ValueError`` where the scene has several pictures.

    >>> from blurnoise import Camera, Exposure, Scene
    >>> scene = Scene(torch.full((1, 1, 4, 6), 0.18))
    >>> camera = Camera.preset("imx250")
    >>> exposures = [Exposure(camera, 0.005, lux, seed=1) for lux in (20.0, 60.0)]
    >>> [frames.images()[0].shape for frames in take_each(scene, exposures)]
    [(4, 6, 1), (4, 6, 1)]
    """
    an_instance("scene", scene, Scene)
    an_instance("exposures", exposures, Iterable)
    an_instance("options", options, TakeOptions)
    if len(scene.light) != 1:
        raise ValueError(f"light: has {len(scene.light)} pictures; must be one, for all the exposures")
    return _each_taken(scene, exposures, options)


def _each_taken(scene: Scene, exposures: Iterable[Exposure[float]], options: TakeOptions) -> Iterator[Frames]:
    behind_lens: dict[Hashable, Shared] = {}
    settled = (_metered(scene, exposure) for exposure in exposures)
    for _, group in groupby(settled, key=_reads_alike):
        alike = list(group)
        started = time.perf_counter()
        shared = behind_lens.setdefault((alike[0].vehicle, alike[0].ego_speed_m_s, alike[0].moves), {})
        frames = _taken(scene, Exposure.stack(alike), options, len(alike), shared)
        simulate_ms = 1e3 * (time.perf_counter() - started) / len(alike)
        for item, exposure in enumerate(alike):
            one = slice(item, item + 1)
            raw = tuple(dn[one] for dn in frames.raw)
            yield Frames(exposure, raw, frames.picture[one], frames.eight_bit[one], simulate_ms)


def _metered(scene: Scene, exposure: Exposure[Any]) -> Exposure[Any]:
    """The exposure with the gain, and the time, that an auto-exposure sets for the scene's only picture."""
    an_instance("exposure", exposure, Exposure)
    if not isinstance(exposure.gain_db, AutoExposure):
        return exposure
    if len(scene.light) != 1 or exposure.batched:
        must = "must be a number for several pictures; blurnoise.expose_pictures meters each"
        raise ValueError(f"gain_db: is automatic; {must}")
    return exposure.metered(scene.mean_light(exposure))


def _reads_alike(exposure: Exposure[float]) -> Hashable:
    """Equal for exposures that differ in light, time and temperature alone, and move equally far."""
    moved = tuple(speed * exposure.exposure_s for speed in exposure.velocity_px_s)
    drives = (exposure.exposure_s, exposure.ego_speed_m_s, exposure.vehicle) if exposure.drives else None
    what = exposure.camera, exposure.illuminant, exposure.gain_db, exposure.seed, exposure.trajectory
    return *what, exposure.lamp, exposure.headlamp, exposure.moves, moved, drives


def _taken(
    scene: Scene,
    exposure: Exposure[Any],
    options: TakeOptions,
    batch: int,
    shared: Shared | None = None,
) -> Frames:
    """The frames of a batch: of each picture of the scene, or of its only one under each value of the exposure."""
    camera, digital_db = exposure.amplified
    reader, *later = readers(camera)
    tolerance_dn, tones, kind = options.tolerance_dn, None, scene.light.dtype
    if options.wanted == ("8 bit",) and not later:
        # Gain and colours amplify what a raw frame omits; the tolerance is that of the picture.
        tolerance_dn /= max(1.0, 10 ** (digital_db / 20)) * magnification(camera, exposure.illuminant)
        if tabulated(reader):  # each value depends on its own digital number alone: a table develops it
            tones = tones_8bit(reader, digital_db, exposure.illuminant)
            kind = tones.dtype
        elif options.quantised and scene.light.device.type == "cpu":
            kind = torch.uint16  # nobody but development reads them, which is faster with integers

    captures = list(captures_of_exposure(scene, exposure, batch))
    if options.wanted == ("picture",) and not later and options.quantised and _of_codes(scene, captures):
        kind = torch.uint16
        if tabulated(reader):
            tones = tones_of(reader, digital_db, exposure.illuminant, options.encoding)
            kind = tones.dtype

    raw = [_capture(scene, at, seeds, options, tolerance_dn, tones, kind, shared) for at, seeds in captures]

    channels = scene.light.shape[1]
    if tones is not None:
        seen = in_channels(raw[0], channels)
        return Frames(exposure, eight_bit=seen) if kind == torch.uint8 else Frames(exposure, picture=seen)
    lit_by: dict[str, Any] = {"illuminant": exposure.illuminant, "gain_db": digital_db}
    dn = raw[0]
    if later:  # fused in electrons of the first capture, of which those of white become 1 at any gain
        dn, reader = torch.stack(raw), camera
        lit_by = {"illuminant": exposure.illuminant, "white_e": _white_e(exposure, batch) * options.white}
    picture = eight_bit = _NOT_WANTED
    if "picture" in options.wanted:
        picture = develop(dn, reader, encoding=options.encoding, **lit_by)
        picture = in_channels(picture, max(channels, picture.shape[1]))
    if "8 bit" in options.wanted:
        eight_bit = develop_8bit(dn, reader, **lit_by)
        eight_bit = in_channels(eight_bit, max(channels, eight_bit.shape[1]))
    return Frames(exposure, tuple(raw) if "raw" in options.wanted else (), picture, eight_bit)


@same_bits
def _capture(
    scene: Scene,
    at: Resolved[Tensor],
    seeds: list[int],
    options: TakeOptions,
    tolerance_dn: float,
    tones: Tensor | None,
    kind: torch.dtype,
    shared: Shared | None,
) -> Tensor:
    """Digital numbers (B, C, H, W) of one capture, or their ``tones``, of this kind; of a mosaic (B, 1, H, W)."""
    # The scene as this capture finds it: in the light of a pulsed lamp, moved on since the first capture.
    batch = len(at.exposure_s)
    at_rest, before = scene.light.expand(batch, -1, -1, -1), at
    light, at = effects.scene_at(at_rest, at, border=scene.border)
    whites = scene.brightest * (batch // len(scene.brightest))
    if light is not at_rest or at is not before:
        whites = brightest(light, at.layers)

    # Which parts of the chain each frame needs. Frames that need the same ones are computed together.
    alike: dict[Hashable, tuple[Plan, list[int]]] = {}
    with_gradients = _differentiable(light, at)
    everything = options.fidelity == "full" or with_gradients
    kind = light.dtype if with_gradients and tones is None else kind
    for item, one in enumerate(at.each()):
        white = whites[item] * radiometry.peak(at.camera, at.illuminant)
        plan = Plan((), at.camera) if everything else plan_at(one, tolerance_dn, white)
        light_key = bool(one.objects) if shared is None else effects.key(plan.reduced(one), plan.without)
        alike.setdefault((plan, light_key), (plan, []))[1].append(item)

    planes = radiometry.planes(at.camera, light.shape[1])
    out = light.new_empty((batch, planes, *scene.size), dtype=kind) if len(alike) > 1 else None
    for key, (plan, items) in alike.items():
        indices = run_of(items)
        # Lens and motion.
        if shared is None:
            lit = _through(scene, light, at, plan, items)
        else:
            if key not in shared:
                shared[key] = _through(scene, light, at, plan, items[:1])
            lit = shared[key]
        # The colour filters.
        on_pixels = radiometry.on_sensor(lit, plan.camera, at.illuminant)
        # The sensor: photons to electrons, their noise, gain, and the converter.
        to = None if out is None or isinstance(indices, list) else out[indices]
        if to is None and shared is None and kind is light.dtype and _owned(on_pixels, light):
            to = on_pixels  # the light is not needed again: its memory takes the digital numbers
        elif to is None and kind is not light.dtype:
            to = light.new_empty((len(items), planes, *scene.size), dtype=kind)
        reading = ReadoutOptions(
            seeds=[seeds[item] for item in items],
            fixed_pattern=_fixed_pattern(scene, plan.camera, planes, options.pattern_seed),
            fidelity=options.fidelity,
            noise=options.noise and plan.noisy,
            quantised=options.quantised,
            without=plan.without,
            draw=rng.standard_normal if shared is None else scene.normal,
            tones=tones,
            out=to,
        )
        exposed = on_pixels.expand(len(items), -1, -1, -1)
        read_under = at if len(items) == batch else at.readout(indices)
        dn = digitised(exposed, plan.reduced(read_under), reading)
        if out is None:
            return dn
        if dn is not to or isinstance(indices, list) or to is on_pixels:
            for item, frame in zip(
                items, dn, strict=True
            ):  # PyTorch indexes no integers of 16 bits by a list
                out[item] = frame
    return cast(Tensor, out)


def run_of(items: list[int]) -> slice | list[int]:
    """Indices as a slice, which makes no copy, if they follow each other.

    >>> run_of([3, 4]), run_of([3, 5])
    (slice(3, 5, None), [3, 5])
    """
    return slice(items[0], items[-1] + 1) if items[-1] - items[0] < len(items) else items


def _through(scene: Scene, light: Tensor, at: Resolved[Tensor], plan: Plan, items: list[int]) -> Tensor:
    """Light of some frames behind the lens, after all motion, without what the plan omits."""
    some = at if len(items) == len(light) else at.part(items)
    return effects.through(
        light[run_of(items)], plan.reduced(some), border=scene.border, without=plan.without
    )


def _owned(on_pixels: Tensor, light: Tensor) -> bool:
    """Whether light on the pixels is stored apart from the scene's, and can be overwritten."""
    apart = on_pixels.untyped_storage().data_ptr() != light.untyped_storage().data_ptr()
    return apart and on_pixels.is_contiguous()


def _of_codes(scene: Scene, captures: Sequence[tuple[Resolved[Tensor], list[int]]]) -> bool:
    """Whether the scene's pictures can be developed from integers, which is faster: none carries gradients."""
    planes = [scene.light, *scene.headlamp_lux.values()]
    planes += [] if scene.lamp_mask is None else [scene.lamp_mask]
    learns = differentiable(*planes) or any(_differentiable(scene.light, at) for at, _ in captures)
    return scene.light.device.type == "cpu" and scene.light.dtype == torch.float32 and not learns


def _differentiable(light: Tensor, at: Resolved[Tensor]) -> bool:
    """Whether digital numbers will carry gradients."""
    moved = torch.as_tensor(at.displacement_px) if at.flow_px is None else at.flow_px
    numbers = differentiable(light, at.exposure_s, at.white_e, moved, at.temperature_c)
    return numbers or any(layer.requires_grad for layers in at.layers for layer in layers)


def _fixed_pattern(
    scene: Scene, camera: Camera, planes: int, pattern_seed: int
) -> tuple[Tensor, Tensor] | None:
    if not camera.sensor.prnu_total and not camera.sensor.dsnu_total_e:
        return None
    return camera.sensor.fixed_pattern((planes, *scene.size), pattern_seed)


def _white_e(exposure: Exposure[Any], batch: int) -> Tensor:
    """Electrons (B,) of white in the first capture."""
    like = torch.empty(0, dtype=torch.float64)
    exposure_s = limited_per_image("exposure_s", exposure.exposure_s, batch, like)
    lux = limited_per_image("illuminance_lux", exposure.illuminance_lux, batch, like)
    per_lux_s = radiometry.electrons_per_lux_s(exposure.camera, exposure.illuminant)
    return lux * exposure_s * (per_lux_s * captures_of(exposure.camera)[0].sensitivity)
