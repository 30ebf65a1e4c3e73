"""Pictures taken as cameras would: :func:`blurnoise.simulate`, then :func:`blurnoise.develop`, for training.

Domain: pictures (B, C, H, W) in [0, 1], sRGB-coded or linear, of any float type; the result has the same shape, type,
memory format and range. Values up to 2, which earlier augmentations leave, are white; others outside [0, 1] are
refused. Directions run counter-clockwise as displayed, 0 to the right, as Kornia's angles do. A blur keeps its
centroid: what moves is swept half the displacement to either side of its place. Without a gain, little light is dark.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor

from blurnoise._core import rng
from blurnoise._core.checks import (
    Numbers,
    an_instance,
    image_batch,
    limited,
    limited_per_image,
    one_of,
)
from blurnoise._core.threads import same_bits
from blurnoise.camera import Camera
from blurnoise.camera.colour import PictureTone
from blurnoise.light.lamp import Pwm
from blurnoise.motion.ego import USUAL_VEHICLE, Vehicle
from blurnoise.motion.trajectory import Trajectory, per_picture
from blurnoise.picture.develop import in_channels
from blurnoise.scene.cutting import Cut, checked_masks, in_motion, matte_of
from blurnoise.scene.exposure import MOVES, Exposure
from blurnoise.scene.metering import AutoExposure, mean_luma
from blurnoise.scene.scene import Scene, extremes, scene_reflectance
from blurnoise.scene.take import TakeOptions, take
from blurnoise.sensor.readout import Fidelity
from blurnoise.training.labels import for_each, velocity_px_s
from blurnoise.training.ranges import Cameras, Lights, cameras_of, check_vehicle

Gains = Numbers | AutoExposure | Sequence[float | AutoExposure]
"""A number or one per picture; auto-exposure, or either for each picture."""
_ROUNDING = 1 / 255  # as far as halves and 8 bits round below black
_OVERSHOOT = 0.25  # of an interpolation by splines
_BRIGHTEST = 2.0  # light above white, which earlier augmentations leave, is white


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

    The captures of an HDR camera are taken one after the other and fused (:mod:`blurnoise.picture.fusion`);
    exposure_s is that of the first. lamp: a pulsed lamp for all pictures, or a lamp or None for each. lamp_lights:
    the lamp lights "all", or the "targets" of pictures with masks.

    trajectory, generator, encoding, fidelity: see :func:`blurnoise.simulate`; picture i depends on its own conditions
    and seed alone. Returns pictures in [0, 1] of image's shape and dtype, coded by the camera's tone curve, or linear
    if image is linear.

    Gradients reach image and conditions. Raises ``TypeError`` or ``ValueError`` that names the argument.
    """
    scene = _clamped(image)
    batch, size = len(scene), (scene.shape[-2], scene.shape[-1])
    cameras = for_each("camera", cameras_of(camera), batch)
    speed = limited_per_image("speed_px_s", speed_px_s, batch, scene)
    direction = limited_per_image("direction_deg", direction_deg, batch, scene)
    names = for_each("moves", [moves] if isinstance(moves, str) else moves, batch)
    for each in names:
        one_of("moves", each, MOVES)
    ego = None if ego_kmh is None else limited_per_image("ego_kmh", ego_kmh, batch, scene)
    check_vehicle(vehicle, drives=ego is not None)
    if ego is not None and (bool(speed.detach().any()) or "targets" in names):
        raise ValueError("ego_kmh: needs speed_px_s = 0 and moves = 'all' or 'background'")
    still = speed == 0 if ego is None else (ego == 0) & (not vehicle.turns)
    exposure_s = limited_per_image("exposure_s", exposure_s, batch, scene)
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
                cuts[item] = in_motion(light, matte, own, float(exposure_s[item].detach()))

    lamps, lamp_mask = _lamps(lamp, lamp_lights, masks, batch)
    linear = isinstance(encoding, str) and encoding == "linear"
    options = TakeOptions(fidelity=fidelity, encoding="linear" if linear else "srgb")

    def pictures(camera: Camera, gain: float, items: list[int]) -> Tensor:  # all with objects, or none
        own = [cuts[item] for item in items if item in cuts]
        of: Any = slice(None) if len(items) == batch else items  # without a copy of all
        moved = velocity[of]
        if own:
            moved = moved * moved.new_tensor([[names[item] == "background"] for item in items])
        light = torch.cat([cut.background for cut in own]) if own else scene_reflectance(scene[of], encoding)
        exposed = Scene(
            light,
            layers=[cut.layers for cut in own],
            lamp_mask=None if lamp_mask is None else lamp_mask[of],
        )
        exposure = Exposure(
            camera,
            exposure_s[of],
            lux[of],
            velocity_px_s=(0.0, 0.0) if ego is not None else moved,
            temperature_c=temperature[of],
            gain_db=gain,
            seed=[seeds[item] for item in items],
            trajectory=[paths[item] for item in items] if paths else None,
            ego_speed_m_s=0.0 if ego is None else ego[of] / 3.6,
            vehicle=vehicle,
            lamp=[lamps[item] for item in items] if lamps else None,
        )
        picture = take(exposed, exposure, options).picture
        return in_channels(picture, scene.shape[1]).to(image.dtype)

    taken_by: dict[tuple[Camera, float, bool], list[int]] = {}
    for item, gain in enumerate(_gains_db(gain_db, scene, encoding, cameras, (exposure_s, lux, temperature))):
        taken_by.setdefault((cameras[item], gain, item in cuts), []).append(item)
    parts = [pictures(taker, gain, items) for (taker, gain, _), items in taken_by.items()]
    if len(parts) == 1:
        return parts[0].contiguous(memory_format=_memory_format(image))
    out = torch.empty_like(image, memory_format=_memory_format(image))
    for items, part in zip(taken_by.values(), parts, strict=True):
        out[items] = part
    return out


def _memory_format(image: Tensor) -> torch.memory_format:
    last = torch.channels_last
    only = image.is_contiguous(memory_format=last) and not image.is_contiguous()
    return last if only else torch.contiguous_format


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
    for item, own in enumerate(for_each("gain_db", each, len(scene))):
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


def _lamps(
    lamp: Pwm | Sequence[Pwm | None] | None, lights: Lights, masks: Tensor | None, batch: int
) -> tuple[list[Pwm | None], Tensor | None]:
    """Each picture's lamp, [] without, and the pixels that it lights; no lamp of targets where there are none."""
    one_of("lamp_lights", lights, ("all", "targets"))
    lamps = [] if lamp is None else for_each("lamp", [lamp] if isinstance(lamp, Pwm) else lamp, batch)
    for own in lamps:
        if own is not None:
            an_instance("lamp", own, Pwm)
    if lights == "all":
        return lamps, None
    if masks is None or not masks.shape[1]:
        return [], None
    return lamps, masks.amax(1).float() if lamps else None


def _clamped(image: Tensor) -> Tensor:
    """``image``, at least float32, within [0, 1]. Raises ``ValueError`` that says what other values look like."""
    halves = (torch.float16, torch.bfloat16)  # which cannot hold a full well's electrons
    image = image.float() if isinstance(image, Tensor) and image.dtype in halves else image
    image_batch("image", image)
    low, high = extremes(image)
    if low < -_ROUNDING or high > _BRIGHTEST:
        raise ValueError(
            f"image: values span [{low:g}, {high:g}]; must lie within [0, 1]: {_cause(low, high)}"
        )
    return image.clamp(0.0, 1.0) if low < 0.0 or high > 1.0 else image


def _cause(low: float, high: float) -> str:
    """What values outside [0, 1] look like, and what to do."""
    if low < -_ROUNDING:
        if low > -_OVERSHOOT and high < 1 + _OVERSHOOT:
            return "an interpolation overshoots (clamp its result), or they are in [-1, 1] (give (image + 1) / 2)"
        if max(-low, high) <= 1 + _ROUNDING:
            return "they look like [-1, 1]: give (image + 1) / 2, and normalise after this augmentation"
        return "they look normalised by mean and standard deviation: normalise after this augmentation"
    bits = next((bits for bits in (8, 10, 12, 14, 16) if high < 2**bits), None)
    return f"they look like 0 to {2**bits - 1}: divide by {2**bits - 1}" if bits else "divide by their white"
