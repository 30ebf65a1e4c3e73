"""Training pictures exposed under conditions of their own, and where their boxes go.

Domain: pictures (B, C, H, W) in [0, 1], sRGB-coded or linear, of any float type; the result has the same shape,
type and range. Values down to -1 and up to 2, which earlier augmentations leave, are clamped. Boxes in px, x right, y
down; corners as Kornia has them, (B, N, 4, 2), or (N, 4, 2) of one picture. Without a gain, little light gives a dark
picture.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from blurnoise._core import rng
from blurnoise._core.checks import Numbers, image_batch, one_of
from blurnoise._core.limits import limited, limited_per_image
from blurnoise._core.uncompiled import uncompiled
from blurnoise.light import effects, motion
from blurnoise.motion.ego import USUAL_VEHICLE, Vehicle
from blurnoise.motion.trajectory import Trajectory, per_picture
from blurnoise.optics.camera import Amplified, Camera
from blurnoise.optics.colour import Encoding
from blurnoise.picture.develop import develop, in_channels
from blurnoise.scene.cutting import Cut, checked_masks, in_motion, matte_of
from blurnoise.scene.exposure import Exposure, places_of
from blurnoise.scene.metering import AutoExposure, mean_luma
from blurnoise.scene.scene import MOVES, scene_reflectance, simulate
from blurnoise.sensor.readout import Fidelity
from blurnoise.training.ranges import Cameras, Draws, Params, cameras_of, check_vehicle, shakes

Gains = Numbers | AutoExposure | Sequence[float | AutoExposure]
"""A number or one per picture; auto-exposure, or either for each picture."""


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
    if ego is not None and (bool(velocity.detach().any()) or "targets" in names):
        raise ValueError(
            "ego_kmh: a camera that drives moves each place in its own way; speed_px_s must be 0 and moves 'all' or "
            "'background'"
        )
    still = (velocity == 0).all(1) if ego is None else (ego == 0) & (not vehicle.turns)
    names = ["all" if rests else each for each, rests in zip(names, still.tolist(), strict=True)]
    own_masks = None if masks is None else checked_masks(masks, batch, (scene.shape[-2], scene.shape[-1]))
    cuts = _cuts(scene, encoding, own_masks, names, velocity, exposure)
    gains = _gains_db(
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


def velocity_px_s(speed_px_s: Tensor, direction_deg: Tensor) -> Tensor:
    """Velocities (B, 2), x right and y down, of speeds (B,) in directions (B,), counter-clockwise as displayed."""
    angle = torch.deg2rad(direction_deg)
    return torch.stack([angle.cos(), -angle.sin()], dim=-1) * speed_px_s[:, None]


def _gains_db(
    gain_db: Gains,
    scene: Tensor,
    cameras: Sequence[Camera],
    *,
    exposure_s: Tensor,
    illuminance_lux: Tensor,
    temperature_c: Tensor,
    encoding: Encoding,
) -> list[float]:
    """The gain of each picture of ``scene`` (B, C, H, W), before one of the ``cameras`` or each before its own.

    Raises ``TypeError`` or ``ValueError`` naming the gain.
    """
    batch = len(scene)
    of_each = [gain_db] if isinstance(gain_db, AutoExposure) else gain_db
    if not isinstance(of_each, Sequence) or not any(isinstance(each, AutoExposure) for each in of_each):
        stated: Numbers = of_each  # type: ignore[assignment]
        return limited_per_image("gain_db", stated, batch, scene).tolist()
    if len(of_each) not in (1, batch):
        raise ValueError(f"gain_db: got {len(of_each)}; must be one, or {batch}, one for each picture")
    with torch.no_grad():
        light = scene_reflectance(scene, encoding)
        by_camera = {each: mean_luma(light, each).tolist() for each in {*cameras}}
    found = []
    for item, (exposure, lux, celsius) in enumerate(
        zip(exposure_s.tolist(), illuminance_lux.tolist(), temperature_c.tolist(), strict=True)
    ):
        own, camera = of_each[item % len(of_each)], cameras[item % len(cameras)]
        if isinstance(own, AutoExposure):
            own = own.setting(
                camera,
                mean_light=by_camera[camera][item],
                illuminance_lux=lux,
                exposure_s=exposure,
                temperature_c=celsius,
            ).gain_db
        found.append(limited("gain_db", own))
    return found


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


def swept_px(params: Params, ranges: Draws, boxes_xyxy: Tensor, size: tuple[int, int]) -> Tensor:
    """What boxes (B, N, 4) sweep to the left and above, and to the right and below, of their place, px, >= 0.

    Returns (B, N, 2, 2). size: (H, W) of the picture, from whose corner boxes are counted.
    """
    half = motion.swept_half_px(_target_velocity_px_s(params, ranges) * params["exposure_s"][:, None])
    swept = torch.stack([half, half], 1)[:, None].repeat(1, boxes_xyxy.shape[1], 1, 1)
    for item, taken in enumerate(_taken(params, ranges) if {"shake_px", "ego_kmh"} & {*params} else ()):
        if taken.drives:
            boxes = boxes_xyxy[item].double()
            places = places_of(boxes)
            moved = motion.swept_half_px(taken.displacements_px(places.flatten(0, 1), size).view_as(places))
            low, high = (places - moved).amin(1), (places + moved).amax(1)
            swept[item] = torch.stack([boxes[:, :2] - low, high - boxes[:, 2:]], 1).to(swept)
        if taken.trajectory is not None:
            left, top, right, bottom = taken.trajectory.seen(taken.exposure_s, taken.velocity_px_s).box
            shaken = swept.new_tensor([[-left, -top], [right, bottom]]).clamp_min(0)
            swept[item] = swept[item] + shaken if taken.drives else shaken
    return swept


def moved_corners(corners: Tensor, params: Params, ranges: Draws, size: tuple[int, int]) -> Tensor:
    """Corners (B, N, 4, 2) or (N, 4, 2) of boxes, px, where the light effects have them at mid-exposure.

    Where no effect displaces the picture (H, W) = ``size``, ``corners`` itself.
    """
    if not any(map(effects.displace, ranges.cameras)):
        return corners
    every = _taken(params, ranges)
    batched = corners if len(every) > 1 or corners.ndim == 4 else corners[None]
    moved = batched.clone()
    for item, (boxes, taken) in enumerate(zip(batched.double(), every, strict=True)):
        low, high = boxes.amin(-2), boxes.amax(-2)
        new = taken.move_boxes(torch.cat([low, high], -1), size)
        share = (boxes - low[:, None]) / (high - low)[:, None].clamp_min(1e-12)
        moved[item] = (new[:, None, :2] + share * (new[:, None, 2:] - new[:, None, :2])).to(moved)
    return moved.view_as(corners)


def within_picture(corners: Tensor, by: Tensor, last: tuple[float, float]) -> Tensor:
    """``corners`` (..., 2) moved outward ``by``, not beyond 0 or ``last`` (x, y); what lies beyond stays there."""
    moved = torch.maximum(corners + by, corners.clamp(max=0))
    return torch.minimum(moved, torch.maximum(corners, corners.new_tensor(last)))


def _target_velocity_px_s(params: Params, ranges: Draws) -> Tensor:
    """Velocities (B, 2) of the targets: none where the camera follows them."""
    velocity = velocity_px_s(params["speed_px_s"], params["direction_deg"])
    followed = torch.tensor(_followed(params, ranges), device=velocity.device)
    return velocity.masked_fill(followed[:, None], 0.0)


def _followed(params: Params, ranges: Draws) -> list[bool]:
    """Whether the camera follows the targets of each picture."""
    return [
        moves == "background" and "masks" in params and matte_of(params["masks"][item]) is not None
        for item, moves in enumerate(ranges.moving(params))
    ]


def _taken(params: Params, ranges: Draws) -> list[Exposure]:
    """What the targets of each picture are exposed with, whatever its gain."""
    cameras = [ranges.cameras[index] for index in params["camera_index"].tolist()]
    numbers = [params[name].tolist() for name in ("exposure_s", "illuminance_lux", "temperature_c")]
    velocities = _target_velocity_px_s(params, ranges).tolist()
    ego = params["ego_kmh"].tolist() if "ego_kmh" in params else [None] * len(cameras)
    drives = [
        kmh is not None and not along for kmh, along in zip(ego, _followed(params, ranges), strict=True)
    ]
    rows = zip(cameras, *numbers, velocities, shakes(params, cameras, slice(None)), ego, drives, strict=True)
    return [
        Exposure(
            camera,
            exposure_s,
            lux,
            (x, y),
            temperature_c,
            trajectory=path,
            ego_speed_m_s=kmh / 3.6 if driven else 0.0,
            vehicle=ranges.vehicle if driven else USUAL_VEHICLE,
        )
        for camera, exposure_s, lux, temperature_c, (x, y), path, kmh, driven in rows
    ]
