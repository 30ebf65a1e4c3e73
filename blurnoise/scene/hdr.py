"""HDR: several captures of one scene, linearised to electrons of the first and fused by level.

Convention: capture 1 is the reference, the most sensitive one. R_k = T_1 s_1 / (T_k s_k) times what capture k
collects is in electrons of capture 1. Each capture has its own window of time, so a scene in motion is blurred over
its own length and displaced by velocity times the distance between the middles of the windows: ghosts follow.
Each has its own noise, but for two gains on one exposure, which read the same electrons.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import groupby, pairwise
from typing import Any, cast

import numpy as np
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
from blurnoise.light.conditions import Conditions
from blurnoise.light.flicker import Flicker as Flicker
from blurnoise.light.motion import displaced, readout_of
from blurnoise.motion.trajectory import Trajectory, per_picture
from blurnoise.optics.camera import Camera, Capture, factors, windows
from blurnoise.optics.colour import Encoding
from blurnoise.optics.radiometry import electrons_per_lux_s
from blurnoise.optics.spectra import Curve
from blurnoise.picture import steps
from blurnoise.picture.develop import develop, develop_8bit, in_channels
from blurnoise.picture.steps import Development
from blurnoise.scene.exposure import Exposure
from blurnoise.scene.scene import ExposedScene, Frame

BLEND = (0.8, 0.95)
"""Shares of a capture's range between which the next takes over, linearly: high enough that range is not wasted, far
enough below 1 that nothing clipped takes part. The weight follows the noisy value, which takes 1 / (saturation_e
(high - low)) off the mean in between: 0.06 % at 10 715 e-; smaller wells want it wider."""
_LEAST_WHITE_E = 1e-9  # of a picture without light


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

    Picture i of the scene depends on its own conditions and seed alone. exposure_s: of the first capture.
    gain_db: of every capture, beside its own, as far as the amplifier goes. Of a camera of one capture the rest is
    digital, and the picture is what :func:`blurnoise.develop` makes of :func:`blurnoise.simulate`'s numbers, to the
    bit. Several captures are fused, and ``white`` is the light whose picture is white, whatever exposure and gain.
    options: velocity_px_s, trajectory, temperature_c, generator, flicker, noise and quantised, as :func:`captured`
    takes them. Raises ``TypeError`` or ``ValueError`` naming the argument.
    """
    scene = _scene(scene)
    captures, digital_db = amplified(camera, gain_db)
    at: dict[str, Any] = {"exposure_s": exposure_s, "illuminance_lux": illuminance_lux}
    frames = captured(scene, camera, captures, **at, **options)
    white_e = _white_e(camera, captures, len(scene.light), **at, white=white, illuminant=scene.illuminant)
    return merged(frames, camera, captures, white_e=white_e, digital_db=digital_db, encoding=encoding,
                  illuminant=scene.illuminant)  # fmt: skip


def frames(
    scene: ExposedScene, exposures: Iterable[Exposure], *, white: float = 1.0, lamp_mask: Tensor | None = None
) -> Iterator[Frame]:
    """:meth:`ExposedScene.frames` of exposures by cameras of any number of captures, under a pulsed lamp or none.

    white: as :func:`pictures` takes it. lamp_mask: (H, W), where the exposures' lamp is, see :class:`Flicker`.
    """
    for plain, group in groupby(exposures, key=lambda each: not each.camera.captures and each.lamp is None):
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
    """The camera's captures, one where it states none, each at a further gain; and the remaining digital gain, dB.

    The gain of each ends at ``analogue_gain_max_db``. The remainder is that of the first. Raises ``ValueError``
    beyond ``gain_max_db``.
    """
    an_instance("camera", camera, Camera)
    captures = camera.captures or (Capture(),)
    in_range("gain_db", gain_db, LIMITS["gain_db"].low, camera.gain_max_db)
    each = [min(max(gain_db, 0.0) + one.gain_db, camera.analogue_gain_max_db) for one in captures]
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
    """Electrons of the first capture, (B,), of the light that is to be white."""
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
    """The digital numbers of every capture, each (B, C, H, W), of a scene or of its light alone, which may exceed 1.

    exposure_s: of the first. flicker: a pulsed lamp, one for all or one, or None, for each picture; its phase is
    where it is when the first row of the first capture begins, and goes on from row to row and capture to capture.
    trajectory: about the middle of the first capture; it has to go on to the end of the last. options: temperature_c,
    noise and quantised as :func:`blurnoise.simulate` takes them, like the other arguments. The first is what
    :func:`blurnoise.simulate` gives, to the bit. Raises ``TypeError`` or ``ValueError`` naming the argument, among
    them captures that overlap.
    """
    scene = _scene(scene)
    light, batch = scene.light, len(scene.light)
    readers = _readers(camera, captures)
    like = light.new_empty(0, dtype=torch.float64)
    exposure = limited_per_image("exposure_s", exposure_s, batch, like)
    lux = limited_per_image("illuminance_lux", illuminance_lux, batch, like)
    times = [windows(captures, each) for each in exposure.tolist()]
    by_flow = getattr(velocity_px_s, "ndim", 0) > 2
    velocity = (flows if by_flow else convolution.motions)("velocity_px_s", velocity_px_s, light)
    paths = per_picture(trajectory, batch)
    lamps = [flicker] * batch if isinstance(flicker, Flicker) else flicker or [None] * batch
    if len(lamps) != batch:
        raise ValueError(f"flicker: got {len(lamps)} for a batch of {batch}; must be one per picture")
    seeds = rng.item_seeds(generator, batch)
    found = []
    for place, (capture, reader) in enumerate(zip(captures, readers, strict=True)):
        own = [each[place] for each in times]
        later_s = [
            start_s + taken_s / 2 - each[0][1] / 2
            for each, (start_s, taken_s) in zip(times, own, strict=True)
        ]
        along = tuple(path and path.later(by_s) for path, by_s in zip(paths, later_s, strict=False))
        lit = _lit(scene, lamps, reader, own)
        if any(later_s):
            offsets_px = [
                (0.0, 0.0) if path is None or then is None else
                np.subtract(then.origin_px(taken_s), path.origin_px(each[0][1]))
                for path, then, (_, taken_s), each in zip(paths, along, own, times, strict=False)
            ]  # fmt: skip
            offset = light.new_tensor(np.array(offsets_px or [(0.0, 0.0)] * batch))
            lit = _displaced(lit, velocity, light.new_tensor(later_s), offset)
        # two gains on one exposure read the same electrons
        streams = [each.index(each[place]) for each in times]
        streams = [
            first if captures[first].sensitivity == capture.sensitivity else place for first in streams
        ]
        frame = lit.expose(
            reader,
            exposure_s=exposure * captures[0].exposure_ratio / capture.exposure_ratio,
            illuminance_lux=lux * capture.sensitivity,
            velocity_px_s=velocity,
            trajectory=along or None,
            generator=[
                rng.derived(seed, f"capture {stream}") if stream else seed
                for seed, stream in zip(seeds, streams, strict=True)
            ],
            **options,
        )
        found.append(frame)
    return found


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
    """The picture of every capture's numbers, as :func:`pictures` has it: of one capture developed, else fused.

    white_e: of the first capture, for several. digital_db: for one. eight_bit: as uint8, sRGB-coded.
    """
    if len(captures) == 1:
        (reader,) = _readers(camera, captures)
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
    """The scene in the light of pulsed lamps, in exposures of so much start and duration for each picture."""
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


def _displaced(scene: ExposedScene, velocity: Tensor, later_s: Tensor, offset_px: Tensor) -> ExposedScene:
    """The scene a time later, of each picture, (B,), and displaced by (B, 2) px more."""
    light, more = scene.light, [1] * (velocity.ndim - 2)
    shift = velocity * later_s.view(-1, 1, *more) + offset_px.view(-1, 2, *more)
    own = layers_per_picture(scene.layers, light)
    layers = [
        [displaced(layer, layer.displacement_px(by_s) + by_px) for layer in some]
        for some, by_s, by_px in zip(own, later_s, offset_px, strict=True)
    ]
    moved = (flow_warp if velocity.ndim > 2 else translated)(light, shift, border=scene.border)
    return _of(scene, moved, layers)


def fuse(frames: Sequence[Tensor], camera: Camera, captures: Sequence[Capture]) -> Tensor:
    """Electrons of the first capture, of digital numbers of all of them; floats of any sign.

    Black level off, over K, times R_k; up to ``BLEND[0]`` of its range a capture counts alone, from ``BLEND[1]`` on
    the next, between them both, linearly. Raises ``ValueError`` naming the argument.
    """
    low, high = BLEND
    readers = _readers(camera, captures)
    if len(frames) != len(captures) or any(frame.shape != frames[0].shape for frame in frames):
        raise ValueError(f"frames: got {len(frames)}; must be one per capture, {len(captures)}, of one shape")
    whole: Tensor | None = None
    for dn, reader, factor in reversed(list(zip(frames, readers, factors(captures), strict=True))):
        signal_dn = dn - reader.black_level_dn
        electrons = signal_dn * (factor / reader.system_gain_dn_per_e)
        level = signal_dn / (reader.saturated_dn - reader.black_level_dn)
        weight = ((high - level) / (high - low)).clamp(0.0, 1.0)
        whole = electrons if whole is None else torch.lerp(whole, electrons, weight)
    return cast(Tensor, whole)


def developed(
    electrons: Tensor,
    camera: Camera,
    *,
    white_e: Tensor | float,
    encoding: Encoding = "srgb",
    illuminant: str | Curve = "D55",
) -> Tensor:
    """Fused electrons as a picture in [0, 1] whose white is ``white_e``, (B,) or one: what is brighter clips there.

    By the camera's picture steps behind the black level, a mosaic's included; ``encoding`` "linear" leaves its tone
    curve out. Raises ``TypeError`` or ``ValueError`` naming the argument.
    """
    image_batch("electrons", electrons)
    an_instance("camera", camera, Camera)
    least = _LEAST_WHITE_E if isinstance(white_e, Tensor) else in_range("white_e", white_e, 0.0, above=True)
    picture = electrons / torch.as_tensor(white_e).to(electrons).clamp_min(least).view(-1, 1, 1, 1)
    at = Development(replace(camera, full_well_e=LIMITS["full_well_e"].high), 0.0, encoding, illuminant)
    for step in steps.active(camera):
        if step is not steps.BLACK_LEVEL:
            picture = step.apply(picture, at)
    return picture


def noise_e(camera: Camera, captures: Sequence[Capture], electrons: float, *, dark_e: float = 0.0) -> float:
    """Temporal noise of a fused pixel of so many mean electrons of the first capture, rms, rounding included.

    dark_e: those of dark current beside them. With the weights of the mean between the levels ``BLEND``. A capture k
    alone has R_k sqrt(n / R_k + t_k dark_e + sigma_k^2), t_k its share of the first exposure. Two gains on one
    exposure read the same electrons with the same noise: their weights add up before the square. Raises
    ``ValueError``.
    """
    low, high = BLEND
    in_range("electrons", electrons, 0.0, LIMITS["white_e"].high)
    in_range("dark_e", dark_e, 0.0, LIMITS["white_e"].high)
    remaining, rounding_e2 = 1.0, 0.0
    shared: dict[tuple[float, ...], list[float]] = {}  # by exposure: weight, weighted dark noise, shot noise
    each = zip(captures, _readers(camera, captures), factors(captures), windows(captures, 1.0), strict=True)
    for count, (capture, reader, factor, (start_s, taken_s)) in enumerate(each, 1):
        seen, gain = electrons / factor + dark_e * taken_s, reader.system_gain_dn_per_e
        level = seen * gain / (reader.saturated_dn - reader.black_level_dn)
        share = 1.0 if count == len(captures) else min(1.0, max(0.0, (high - level) / (high - low)))
        weight = remaining * share * factor
        remaining *= 1 - share
        rounding_e2 += (weight / gain) ** 2 / 12
        shot_e2 = seen * reader.variance_factor(seen)
        sums = shared.setdefault((start_s, taken_s, capture.sensitivity), [0.0, 0.0, shot_e2])
        sums[0] += weight
        sums[1] += weight * reader.dark_noise_e
    return math.sqrt(
        rounding_e2 + sum(light**2 * shot_e2 + dark**2 for light, dark, shot_e2 in shared.values())
    )


def snr_db(camera: Camera, captures: Sequence[Capture], electrons: float, **beside: Any) -> float:
    """20 log10 of so many electrons over :func:`noise_e`: it falls by 10 log10 R and dark noise at each switch."""
    signal = in_range("electrons", electrons, 0.0, above=True)
    return 20 * math.log10(signal / noise_e(camera, captures, electrons, **beside))


def dynamic_range_db(camera: Camera, captures: Sequence[Capture]) -> float:
    """Saturation of the last capture over the first one's signal at SNR 1, 20 log10."""
    return 20 * math.log10(saturations_e(camera, captures)[-1] / _readers(camera, captures)[0].threshold_e)


def saturations_e(camera: Camera, captures: Sequence[Capture]) -> list[float]:
    """Saturation of each capture in electrons of the first, never falling."""
    readers = _readers(camera, captures)
    return [reader.saturation_e * by for reader, by in zip(readers, factors(captures), strict=True)]


def _readers(camera: Camera, captures: Sequence[Capture]) -> list[Camera]:
    """The camera at each capture's gain; raises unless each capture takes over where the one before it ends."""
    an_instance("camera", camera, Camera)
    if not isinstance(captures, Sequence) or not captures:
        raise ValueError(f"captures = {shown(captures)}: must be a list of at least one")
    for capture in captures:
        an_instance("captures", capture, Capture)
        in_range("captures: gain_db", capture.gain_db, 0.0, camera.analogue_gain_max_db)
    alone = replace(camera, captures=()) if camera.captures else camera
    readers = [alone.at_gain(capture.gain_db).camera for capture in captures]
    ends = [reader.saturation_e * by for reader, by in zip(readers, factors(captures), strict=True)]
    for place, (end, following) in enumerate(pairwise(ends), 2):
        if following < end * (1 - 1e-9):
            raise ValueError(
                f"captures: number {place} saturates at {following:.4g} e- of the first, the one before it at "
                f"{end:.4g}; each must reach as far as the one before it"
            )
    return readers
