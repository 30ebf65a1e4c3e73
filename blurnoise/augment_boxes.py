"""Boxes of training pictures: where exposures with drawn conditions leave them, and what motion sweeps.

Convention: px, x right, y down; corners as Kornia has them, (B, N, 4, 2), or (N, 4, 2) of one picture.
"""

from __future__ import annotations

import torch
from torch import Tensor

from blurnoise.exposure_ranges import Draws, Params, shakes
from blurnoise.light import effects, motion
from blurnoise.motion.ego import USUAL_VEHICLE
from blurnoise.moving_masks import matte_of
from blurnoise.scene.exposure import Exposure, places_of


def velocity_px_s(speed_px_s: Tensor, direction_deg: Tensor) -> Tensor:
    """Velocities (B, 2), x right and y down, of speeds (B,) in directions (B,), counter-clockwise as displayed."""
    angle = torch.deg2rad(direction_deg)
    return torch.stack([angle.cos(), -angle.sin()], dim=-1) * speed_px_s[:, None]


def swept_px(params: Params, ranges: Draws, boxes_xyxy: Tensor, size: tuple[int, int]) -> Tensor:
    """What boxes (B, N, 4) sweep to the left and above, and to the right and below, of their place, px, >= 0.

    Returns (B, N, 2, 2). size: (H, W) of the picture, from whose corner boxes are counted.
    """
    half = motion.swept_half_px(_target_velocity_px_s(params, ranges) * params["exposure_s"][:, None])
    swept = torch.stack([half, half], 1)[:, None].repeat(1, boxes_xyxy.shape[1], 1, 1)
    for item, taken in enumerate(_taken(params, ranges) if {"shake_px", "ego_kmh"} & {*params} else ()):
        if taken.trajectory is not None:
            left, top, right, bottom = taken.trajectory.seen(taken.exposure_s, taken.velocity_px_s).box
            swept[item] = swept.new_tensor([[-left, -top], [right, bottom]]).clamp_min(0)
        if taken.drives:
            boxes = boxes_xyxy[item].double()
            places = places_of(boxes)
            moved = motion.swept_half_px(taken.displacements_px(places.flatten(0, 1), size).view_as(places))
            low, high = (places - moved).amin(1), (places + moved).amax(1)
            swept[item] = torch.stack([boxes[:, :2] - low, high - boxes[:, 2:]], 1).to(swept)
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
