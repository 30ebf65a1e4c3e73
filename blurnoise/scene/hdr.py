"""HDR: several captures of one scene, each taken, fused and developed; one capture is the plain picture.

Convention: times count from the start of the first capture. Each capture has its own window of time. So each shows a
moving scene with a blur of its own length, displaced by velocity times the time between the middles of the windows:
this makes ghosts. Each capture has its own noise, except for two gains on one exposure, which read the same
electrons.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import groupby
from typing import Any

import torch
from torch import Tensor

from blurnoise._core import rng
from blurnoise._core.checks import (
    LIMITS,
    Numbers,
    an_instance,
    image_batch,
    in_range,
    limited_per_image,
    shown,
)
from blurnoise.blur import convolution
from blurnoise.blur.layers import Layer, Layers, layers_per_picture
from blurnoise.blur.rows import translated
from blurnoise.blur.sub_exposures import flow_warp, flows
from blurnoise.camera import Camera
from blurnoise.camera.captures import Capture, windows
from blurnoise.camera.colour import Encoding
from blurnoise.camera.radiometry import electrons_per_lux_s
from blurnoise.camera.spectra import Curve
from blurnoise.light.conditions import Conditions
from blurnoise.light.flicker import Flicker as Flicker
from blurnoise.light.motion import displaced, readout_of
from blurnoise.motion.trajectory import Trajectory, per_picture
from blurnoise.picture.develop import develop, develop_8bit, in_channels
from blurnoise.scene.exposure import Exposure
from blurnoise.scene.fusion import developed as developed
from blurnoise.scene.fusion import dynamic_range_db as dynamic_range_db
from blurnoise.scene.fusion import fuse as fuse
from blurnoise.scene.fusion import noise_e as noise_e
from blurnoise.scene.fusion import readers_of
from blurnoise.scene.fusion import saturations_e as saturations_e
from blurnoise.scene.fusion import snr_db as snr_db
from blurnoise.scene.scene import ExposedScene, Frame


def pictures(
    scene: ExposedScene | Tensor,
    camera: Camera,
    *,
    exposure_s: Numbers,
    illuminance_lux: Numbers,
    gain_db: float = 0.0,
    white: float = 1.0,
    encoding: Encoding = "srgb",
    **options: Any,
) -> Tensor:
    """Take pictures with a camera of any number of captures and develop them: (B, C, H, W) in [0, 1].

    Picture i depends on its own conditions and seed alone. exposure_s: of the first capture. gain_db: added to the
    gain of every capture, up to the limit of the amplifier. With one capture the remaining gain is digital, and the
    picture equals :func:`blurnoise.develop` of :func:`blurnoise.simulate` to the bit. Several captures are fused;
    ``white`` is then the light that becomes white, at any exposure and gain.
    options: velocity_px_s, trajectory, temperature_c, generator, flicker, noise and quantised, as :func:`captured`
    takes them. Raises ``TypeError`` or ``ValueError`` naming the argument.
    """
    scene = _scene(scene)
    lit: dict[str, Any] = {"exposure_s": exposure_s, "illuminance_lux": illuminance_lux}
    shown_as: dict[str, Any] = {"encoding": encoding, "illuminant": scene.illuminant}
    an_instance("camera", camera, Camera)
    if (
        not camera.sensor.captures and options.get("flicker") is None
    ):  # the usual case, as fast as it was without captures
        reader, digital_db = camera.at_gain(gain_db)
        dn = scene.expose(
            reader, **lit, **{name: value for name, value in options.items() if name != "flicker"}
        )
        return develop(dn, reader, gain_db=digital_db, **shown_as)
    captures, digital_db = amplified(camera, gain_db)
    taken = captured(scene, camera, captures, **lit, **options)
    white_e = _white_e(camera, captures, len(scene.light), **lit, white=white, illuminant=scene.illuminant)
    return merged(taken, camera, captures, white_e=white_e, digital_db=digital_db, **shown_as)


def frames(
    scene: ExposedScene, exposures: Iterable[Exposure], *, white: float = 1.0, lamp_mask: Tensor | None = None
) -> Iterator[Frame]:
    """:meth:`ExposedScene.frames` for cameras with any number of captures, with or without a pulsed lamp.

    white: as :func:`pictures` takes it. lamp_mask: (H, W), the pixels that the lamp lights, see :class:`Flicker`.
    """
    for plain, group in groupby(
        exposures, key=lambda each: not each.camera.sensor.captures and each.lamp is None
    ):
        if plain:
            yield from scene.frames(group)
        else:
            yield from (_frame(scene, each, white, lamp_mask) for each in group)


def _frame(scene: ExposedScene, exposure: Exposure, white: float, lamp_mask: Tensor | None) -> Frame:
    started = time.perf_counter()
    velocity, objects = scene.motions(exposure)
    captures, digital_db = amplified(exposure.camera, exposure.gain_db)
    at: dict[str, Any] = {"exposure_s": exposure.exposure_s, "illuminance_lux": exposure.illuminance_lux}
    taken = captured(
        _of(scene, scene.light, objects),
        exposure.camera,
        captures,
        **at,
        velocity_px_s=velocity,
        trajectory=exposure.trajectory,
        temperature_c=exposure.temperature_c,
        generator=[exposure.seed],
        flicker=None if exposure.lamp is None else Flicker(exposure.lamp, lamp_mask),
    )
    white_e = _white_e(exposure.camera, captures, 1, **at, white=white, illuminant=scene.illuminant)
    seen = merged(taken, exposure.camera, captures, white_e=white_e, digital_db=digital_db,
                  illuminant=scene.illuminant, eight_bit=True)  # fmt: skip
    picture = in_channels(seen, scene.light.shape[1])[0].permute(1, 2, 0).contiguous().numpy()
    return Frame(picture, 1e3 * (time.perf_counter() - started))


def amplified(camera: Camera, gain_db: float) -> tuple[tuple[Capture, ...], float]:
    """The camera's captures with ``gain_db`` added to the gain of each, and the remaining digital gain, dB.

    A camera without captures has one. The gain of each capture ends at ``analogue_gain_max_db``; the remaining gain
    is that of the first capture. Raises ``ValueError`` beyond ``gain_max_db``.
    """
    an_instance("camera", camera, Camera)
    captures = camera.sensor.captures or (Capture(),)
    in_range("gain_db", gain_db, LIMITS["gain_db"].low, camera.sensor.gain_max_db)
    each = [min(max(gain_db, 0.0) + one.gain_db, camera.sensor.analogue_gain_max_db) for one in captures]
    used = tuple(replace(one, gain_db=total) for one, total in zip(captures, each, strict=True))
    return used, gain_db + captures[0].gain_db - each[0]


def _white_e(
    camera: Camera,
    captures: Sequence[Capture],
    batch: int,
    *,
    exposure_s: Numbers,
    illuminance_lux: Numbers,
    white: float,
    illuminant: str | Curve,
) -> Tensor:
    """Electrons, (B,), that the light ``white`` gives in the first capture."""
    like = torch.empty(0, dtype=torch.float64)
    exposure = limited_per_image("exposure_s", exposure_s, batch, like)
    lux = limited_per_image("illuminance_lux", illuminance_lux, batch, like)
    per_lux_s = electrons_per_lux_s(camera, illuminant) * captures[0].sensitivity
    return lux * exposure * per_lux_s * in_range("white", white, 1e-6, 1e6)


def captured(
    scene: ExposedScene | Tensor,
    camera: Camera,
    captures: Sequence[Capture],
    *,
    exposure_s: Numbers,
    illuminance_lux: Numbers,
    velocity_px_s: Tensor | Iterable[float] = (0.0, 0.0),
    trajectory: Trajectory | Sequence[Trajectory | None] | None = None,
    generator: rng.Randomness = None,
    flicker: Flicker | Sequence[Flicker | None] | None = None,
    **options: Any,
) -> list[Tensor]:
    """The digital numbers of every capture, each (B, C, H, W), of a scene or of light, which may exceed 1.

    exposure_s: of the first capture. flicker: a pulsed lamp, one for all pictures, or a lamp or None for each. Its
    phase refers to the start of the first row of the first capture; the lamp runs on from row to row and capture to
    capture. trajectory: centred on the middle of the first capture; it must reach the end of the last. The other
    arguments and the options temperature_c, noise and quantised are those of :func:`blurnoise.simulate`. The first
    capture equals the result of :func:`blurnoise.simulate` to the bit. Raises ``TypeError`` or ``ValueError`` naming
    the argument, also for captures that overlap.
    """
    scene = _scene(scene)
    light, batch = scene.light, len(scene.light)
    readers = readers_of(camera, captures)
    like = torch.empty(0, dtype=torch.float64)
    exposure = limited_per_image("exposure_s", exposure_s, batch, like)
    lux = limited_per_image("illuminance_lux", illuminance_lux, batch, like)
    times = [windows(captures, each) for each in exposure.tolist()]
    by_flow = getattr(velocity_px_s, "ndim", 0) > 2
    velocity = (flows if by_flow else convolution.motions)("velocity_px_s", velocity_px_s, light)
    paths = per_picture(trajectory, batch)
    lamps = _for_each(flicker, batch)
    seeds = rng.item_seeds(generator, batch)
    found = []
    for place, (capture, reader) in enumerate(zip(captures, readers, strict=True)):
        own = [each[place] for each in times]
        # two gains on one exposure read the same electrons
        first = [each.index(each[place]) for each in times]
        streams = [one if captures[one].sensitivity == capture.sensitivity else place for one in first]
        lit, later_s = _lit(scene, lamps, reader, own), [0.0] * batch
        if place:
            later_s = [
                start_s + taken_s / 2 - each[0][1] / 2
                for each, (start_s, taken_s) in zip(times, own, strict=True)
            ]
            lit = _displaced(lit, velocity, paths, times, place, later_s)
        frame = lit.expose(
            reader,
            exposure_s=exposure * captures[0].exposure_ratio / capture.exposure_ratio,
            illuminance_lux=lux * capture.sensitivity,
            velocity_px_s=velocity,
            trajectory=[path and path.later(by_s) for path, by_s in zip(paths, later_s, strict=False)]
            or None,
            generator=[
                rng.derived(seed, f"capture {stream}") if stream else seed
                for seed, stream in zip(seeds, streams, strict=True)
            ],
            **options,
        )
        found.append(frame)
    return found


def _for_each(flicker: Flicker | Sequence[Flicker | None] | None, batch: int) -> Sequence[Flicker | None]:
    """A lamp or None for each picture. Raises ``TypeError`` or ``ValueError``."""
    if flicker is None or isinstance(flicker, Flicker):
        return [flicker] * batch
    if not isinstance(flicker, Sequence) or not all(isinstance(one, Flicker | None) for one in flicker):
        must = "must be a Flicker, or a sequence of one or None for each picture"
        raise TypeError(f"flicker = {shown(flicker)}: {must}")
    if len(flicker) != batch:
        raise ValueError(f"flicker: got {len(flicker)} for a batch of {batch}; must be one per picture")
    return flicker


def merged(
    frames: Sequence[Tensor],
    camera: Camera,
    captures: Sequence[Capture],
    *,
    white_e: Tensor | float,
    digital_db: float = 0.0,
    encoding: Encoding = "srgb",
    illuminant: str | Curve = "D55",
    eight_bit: bool = False,
) -> Tensor:
    """The picture of the digital numbers of all captures: one capture is developed, several are fused first.

    white_e: white in electrons of the first capture, for several captures. digital_db: digital gain, for one capture.
    eight_bit: return uint8, sRGB-coded.
    """
    if len(captures) == 1:
        (reader,) = readers_of(camera, captures)
        if eight_bit:
            return develop_8bit(frames[0], reader, digital_db, illuminant)
        return develop(frames[0], reader, encoding=encoding, gain_db=digital_db, illuminant=illuminant)
    fused = fuse(frames, camera, captures)
    picture = developed(fused, camera, white_e=white_e, encoding=encoding, illuminant=illuminant)
    return picture.mul(255.0).round().to(torch.uint8) if eight_bit else picture


def _scene(scene: ExposedScene | Tensor) -> ExposedScene:
    scene = ExposedScene(image_batch("scene", scene)) if isinstance(scene, Tensor) else scene
    an_instance("scene", scene, ExposedScene)
    return scene


def _of(scene: ExposedScene, light: Tensor, layers: Layers) -> ExposedScene:
    """The scene with other light and layers."""
    return ExposedScene(
        light,
        border=scene.border,
        illuminant=scene.illuminant,
        pattern_seed=scene.pattern_seed,
        fidelity=scene.fidelity,
        tolerance_dn=scene.tolerance_dn,
        layers=layers,
    )


def _lit(
    scene: ExposedScene,
    lamps: Sequence[Flicker | None],
    reader: Camera,
    times: Sequence[tuple[float, float]],
) -> ExposedScene:
    """The scene in the light of pulsed lamps, in an exposure with a start and a duration for each picture."""
    if all(lamp is None or lamp.pwm.duty == 1 for lamp in lamps):
        return scene
    size = (scene.light.shape[-2], scene.light.shape[-1])
    seen, layers = [], []
    each = zip(
        torch.split(scene.light, 1), layers_per_picture(scene.layers, scene.light), lamps, times, strict=True
    )
    for light, own, lamp, (start_s, taken_s) in each:
        if lamp is not None:
            rows = readout_of(Conditions(reader, taken_s, 0.0, 0.0), size)
            begin, end = map(torch.from_numpy, rows.windows_s)
            by = lamp.factors(size, end - begin, begin - begin.min() + start_s).to(light)
            light, own = light * by, tuple(_lit_layer(layer, by) for layer in own)
        seen.append(light)
        layers.append(own)
    return _of(scene, seen[0] if len(seen) == 1 else torch.cat(seen), layers)


def _lit_layer(layer: Layer, by: Tensor) -> Layer:
    """The layer in the light of its place, beyond the picture of the nearest."""
    starts = zip(layer.place_px[::-1], layer.alpha.shape, by.shape, strict=True)
    rows, columns = (
        (start + torch.arange(count)).clamp(0, most - 1).to(by.device) for start, count, most in starts
    )
    return replace(layer, light=layer.light * by[rows][:, columns])


def _displaced(
    scene: ExposedScene,
    velocity: Tensor,
    paths: Sequence[Trajectory | None],
    times: Sequence[Sequence[tuple[float, float]]],
    place: int,
    later_s: Sequence[float],
) -> ExposedScene:
    """The scene displaced by its motion between the middle of the first capture and the middle of this one."""
    light, later = scene.light, scene.light.new_tensor(later_s)
    offsets = light.new_zeros(len(light), 2)
    for item, path in enumerate(paths):
        if path is not None:
            (_, first_s), (_, taken_s) = times[item][0], times[item][place]
            x, y = path.later(later_s[item]).origin_px(taken_s)
            was_x, was_y = path.origin_px(first_s)
            offsets[item] = offsets.new_tensor([x - was_x, y - was_y])
    more = [1] * (velocity.ndim - 2)
    shift = velocity * later.view(-1, 1, *more) + offsets.view(-1, 2, *more)
    layers = [
        [displaced(layer, layer.displacement_px(by_s) + by_px) for layer in own]
        for own, by_s, by_px in zip(layers_per_picture(scene.layers, light), later, offsets, strict=True)
    ]
    moved = (flow_warp if velocity.ndim > 2 else translated)(light, shift, border=scene.border)
    return scene if moved is light and not any(layers) else _of(scene, moved, layers)
