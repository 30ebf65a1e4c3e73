"""Boxes of training pictures: where exposures with drawn conditions leave them, and what motion sweeps.

Convention: px, x right, y down; corners as Kornia has them, (B, N, 4, 2), or (N, 4, 2) of one picture.
"""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from blurnoise.exposure_ranges import Draws, Params, shakes
from blurnoise.light import effects, motion
from blurnoise.moving_masks import matte_of
from blurnoise.operating_point import OperatingPoint
from blurnoise.radiometry import photoelectrons


def velocity_px_s(speed_px_s: Tensor, direction_deg: Tensor) -> Tensor:
    """Velocities (B, 2), x right and y down, of speeds (B,) in directions (B,), counter-clockwise as displayed."""
    angle = torch.deg2rad(direction_deg)
    return torch.stack([angle.cos(), -angle.sin()], dim=-1) * speed_px_s[:, None]


def swept_px(params: Params, ranges: Draws) -> Tensor:
    """What targets sweep to the left and above, and to the right and below, of their place, (B, 2, 2), px, >= 0."""
    half = motion.swept_half_px(_target_velocity_px_s(params, ranges) * params["exposure_s"][:, None])
    swept = torch.stack([half, half], 1)
    for item, at in enumerate(_points(params, ranges) if "shake_px" in params else ()):
        if at.trajectory is not None:
            x, y = (float(along) / at.exposure_s for along in at.displacement_px)
            left, top, right, bottom = at.trajectory.seen(at.exposure_s, (x, y)).box
            swept[item] = swept.new_tensor([[-left, -top], [right, bottom]]).clamp_min(0)
    return swept


def moved_corners(corners: Tensor, params: Params, ranges: Draws, size: tuple[int, int]) -> Tensor:
    """Corners (B, N, 4, 2) or (N, 4, 2) of boxes, px, where the light effects have them at mid-exposure.

    Where no effect displaces the picture (H, W) = ``size``, ``corners`` itself.
    """
    if not any(map(effects.displace, ranges.cameras)):
        return corners
    points = [replace(at, size=size) for at in _points(params, ranges)]
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


def _target_velocity_px_s(params: Params, ranges: Draws) -> Tensor:
    """Velocities (B, 2) of the targets: none where the camera follows them."""
    velocity = velocity_px_s(params["speed_px_s"], params["direction_deg"])
    followed = [
        moves == "background" and "masks" in params and matte_of(params["masks"][item]) is not None
        for item, moves in enumerate(ranges.moving(params))
    ]
    return velocity.masked_fill(torch.tensor(followed, device=velocity.device)[:, None], 0.0)


def _points(params: Params, ranges: Draws) -> list[OperatingPoint[float]]:
    """What the targets of each picture meet."""
    cameras = [ranges.cameras[index] for index in params["camera_index"].tolist()]
    numbers = [params[name].tolist() for name in ("exposure_s", "illuminance_lux", "temperature_c")]
    moved_px = _target_velocity_px_s(params, ranges) * params["exposure_s"][:, None]
    rows = zip(cameras, *numbers, moved_px.tolist(), shakes(params, cameras, slice(None)), strict=True)
    return [
        OperatingPoint(
            camera,
            exposure_s,
            temperature_c,
            photoelectrons(camera, lux, exposure_s),
            (x, y),
            trajectories=(path,) if path else (),
        )
        for camera, exposure_s, lux, temperature_c, (x, y), path in rows
    ]
