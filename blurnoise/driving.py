"""A camera on a vehicle that drives over a flat road: how it is mounted and turns, and the flow in its pictures.

Domain: m, degrees, px of the picture. What a picture shows is taken for road up to the horizon and for sky above it,
or for a frontal plane before both: what stands on the road moves with it unless a plane says how far it is. Rays
beyond the lens are at rest.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import torch
from torch import Tensor

from blurnoise._core.limits import limited
from blurnoise.camera import Camera
from blurnoise.ego_motion import Floats, Mount, View, range_of_depth_m
from blurnoise.motion import Lens

_KEPT = 8  # flows, of a vehicle and a picture's size each


@dataclass(frozen=True)
class Vehicle:
    """height_m above the road, looking pitch_deg down and heading_deg to the right; plane_m: of a wall ahead.

    hfov_deg: of the picture; None: the camera's, of whose sensor the picture is the largest part of its shape. lens:
    "f-theta" or "rectilinear"; None: the camera's own where it has a distortion and hfov_deg is not given, else
    f-theta. yaw_deg_s, pitch_deg_s: it turns to the right, and up. Raises ``ValueError`` that names the field.
    """

    height_m: float = 1.5
    pitch_deg: float = 0.0
    heading_deg: float = 0.0
    hfov_deg: float | None = None
    lens: Lens | None = None
    plane_m: float | None = None
    yaw_deg_s: float = 0.0
    pitch_deg_s: float = 0.0

    def __post_init__(self) -> None:
        Mount(self.height_m, self.pitch_deg, self.heading_deg)
        View(1, 1, 60.0 if self.hfov_deg is None else self.hfov_deg, self.lens or "f-theta")
        for name in ("yaw_deg_s", "pitch_deg_s"):
            limited(name, getattr(self, name), "rotation_deg_s")
        if self.plane_m is not None:
            limited("plane_m", self.plane_m, "depth_m")

    @property
    def turns(self) -> bool:
        """Whether it does, whatever its speed."""
        return bool(self.yaw_deg_s or self.pitch_deg_s)

    def view(self, camera: Camera, size: tuple[int, int]) -> View:
        """What a picture (H, W) of the camera sees. Raises ``ValueError`` for a field of view beyond the lens's."""
        (height, width), lens = size, self.lens or "f-theta"
        if self.hfov_deg is not None:
            return View(width, height, self.hfov_deg, lens)
        if self.lens is None and camera.lens.displaces:
            return View(width, height, camera.hfov_deg, calibrated=camera.field)
        sensor = View(camera.width_px, camera.height_px, camera.hfov_deg, lens)
        half = width / 2 / (sensor.focal_px * camera.field.per_sensor_px(size))
        half_deg = math.degrees(half if lens == "f-theta" else math.atan(half))
        return View(width, height, 2 * half_deg, lens)

    def flow_at(self, pixels: Floats, camera: Camera, size: tuple[int, int], speed_m_s: float) -> Floats:
        """Velocities (2, ...), px/s, of what pixels (2, ...) of a picture (H, W) see at a speed ahead."""
        return _flow_at(pixels, self, self.view(camera, size), speed_m_s)

    def flow_px_s(self, camera: Camera, size: tuple[int, int], speed_m_s: float) -> Tensor:
        """That of every pixel, (2, H, W), float32, as :func:`blurnoise.simulate` takes it."""
        speed = torch.tensor([limited("speed_m_s", speed_m_s)], dtype=torch.float32)
        return self.flows_px_s(camera, size, speed)[0]

    def flows_px_s(self, camera: Camera, size: tuple[int, int], speed_m_s: Tensor) -> Tensor:
        """That at speeds (B,), (B, 2, H, W), in their type and on their device; differentiable in them."""
        ahead, turning = _flows(self, self.view(camera, size))
        flows = speed_m_s[:, None, None, None] * ahead.to(speed_m_s)
        return flows if turning is None else flows + turning.to(speed_m_s)


def _flow_at(pixels: Floats, vehicle: Vehicle, view: View, speed_m_s: float) -> Floats:
    mount = Mount(vehicle.height_m, vehicle.pitch_deg, vehicle.heading_deg)
    moving = mount.driving(speed_m_s, vehicle.yaw_deg_s)
    x, y, z = moving.rotation_deg_s
    moving = replace(moving, rotation_deg_s=(x + vehicle.pitch_deg_s, y, z))
    rays = view.rays(pixels)
    ranges = mount.road_m(rays)
    if vehicle.plane_m is not None:
        ranges = np.minimum(ranges, range_of_depth_m(rays, vehicle.plane_m))
    return np.nan_to_num(view.flow_px_s(pixels, ranges, moving))


@lru_cache(maxsize=_KEPT)
def _flows(vehicle: Vehicle, view: View) -> tuple[Tensor, Tensor | None]:
    """What 1 m/s ahead does, and what turning does, if it turns; their sum is the flow. Neither is to be changed."""
    pixels = view.pixels()
    straight = replace(vehicle, yaw_deg_s=0.0, pitch_deg_s=0.0)
    turning = _flow_at(pixels, vehicle, view, 0.0).astype(np.float32) if vehicle.turns else None
    ahead = _flow_at(pixels, straight, view, 1.0).astype(np.float32)
    return torch.from_numpy(ahead), None if turning is None else torch.from_numpy(turning)


USUAL_VEHICLE = Vehicle()
