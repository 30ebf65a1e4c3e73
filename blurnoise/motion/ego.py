"""Ego-motion: where a camera on a vehicle sees the road, things ahead and the sky move in its picture, px/s.

Convention: camera axes X right, Y down, Z along the optical axis. Pixels x right, y down, (0, 0) the centre of the
first one. Range: m from the camera along a pixel's ray, inf for the sky; depth: its share along Z. Arrays are (2,
...) of pixels and flow, (3, ...) of rays, (...) of ranges; NaN beyond the lens, where flow is 0. Flow is that of
mid-exposure; times the exposure it is the blur, as long as what is seen goes straight and evenly.

A lens is "f-theta", a constant number of pixels per degree (Lin et al., Sensors 2024, 24, 5135, eq. 14);
"rectilinear", a pinhole; or a camera's own, distortion included. Roads reach up to the horizon, the sky is above,
or a wall ahead.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated, Literal, NamedTuple

import numpy as np
import torch
from torch import Tensor

from blurnoise._core.checks import LARGEST_PICTURE, limited, one_of
from blurnoise._core.fields import check_fields, within
from blurnoise.camera import Camera
from blurnoise.camera.lens import Field
from blurnoise.camera.spectra import Floats

Lens = Literal["f-theta", "rectilinear"]


def velocity_px_s(
    speed_m_s: float,
    distance_m: float,
    *,
    target_width_m: float,
    width_px: float,
    hfov_deg: float,
    lens: Lens = "f-theta",
) -> float:
    """Speed in the image, px/s, of a target that crosses the optical axis at ``speed_m_s`` >= 0.

    Its image is 2 atan(w / 2d) [deg] * width_px / hfov_deg px wide by an f-theta lens (Lin et al. 2024, eq. 14), f
    w / d with f = (width_px / 2) / tan(hfov / 2) by a rectilinear one, and moves that / w px per metre. Raises
    ``ValueError`` naming the argument (a rectilinear lens needs hfov_deg < 180).

    >>> round(velocity_px_s(10.0, 20.0, target_width_m=1.0, width_px=1920, hfov_deg=60.0), 1)
    916.5
    """
    speed, distance = limited("speed_m_s", speed_m_s), limited("distance_m", distance_m)
    target, width = limited("target_width_m", target_width_m), limited("width_px", width_px)
    hfov = limited("hfov_deg", hfov_deg)
    if one_of("lens", lens, ("f-theta", "rectilinear")) == "f-theta":
        size_px = math.degrees(2 * math.atan(target / (2 * distance))) * width / hfov
    else:
        size_px = _pinhole_px(width, hfov) * target / distance
    return size_px * speed / target


def blur_pixels(
    speed_m_s: float,
    distance_m: float,
    exposure_s: float,
    *,
    target_width_m: float,
    width_px: float,
    hfov_deg: float,
    lens: Lens = "f-theta",
) -> float:
    """Length of the motion blur in px: :func:`velocity_px_s` times the exposure in s (>= 0).

    >>> round(blur_pixels(10.0, 20.0, 0.01, target_width_m=1.0, width_px=1920, hfov_deg=60.0), 2)
    9.17
    """
    seen = {"target_width_m": target_width_m, "width_px": width_px, "hfov_deg": hfov_deg}
    return limited("exposure_s", exposure_s) * velocity_px_s(speed_m_s, distance_m, **seen, lens=lens)


def _pinhole_px(width_px: float, hfov_deg: float) -> float:
    """Focal length of a pinhole, px. Raises ``ValueError`` from 180 degrees on."""
    if hfov_deg >= 180:
        raise ValueError(f"hfov_deg = {hfov_deg!r}: must be < 180 for a rectilinear lens")
    return width_px / 2 / math.tan(math.radians(hfov_deg) / 2)


_STEP = 1e-6  # of a direction X/Z, over which a lens is taken for straight
_Turn = Annotated[float, within("rotation_deg_s")]


class EgoMotion(NamedTuple):
    """Velocity, m/s, and rotation, degrees/s and right-handed, of a camera along and about its own axes X, Y, Z.

    >>> straight = EgoMotion(velocity_m_s=(0.0, 0.0, 20.0))  # 72 km/h along the optical axis
    >>> wall = View(1920, 1080, 60.0).flow_px_s(np.array([959.5, 539.5]), np.array(10.0), straight)
    >>> wall.round(6).tolist()  # nothing moves where the camera drives to
    [0.0, 0.0]
    """

    velocity_m_s: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rotation_deg_s: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class View:
    """A picture's size, its horizontal field of view, and the lens: "f-theta" or "rectilinear", a pinhole.

    calibrated: a camera's own lens, distortion included, in place of hfov_deg and lens. Raises ``ValueError``.

    >>> view = View(1920, 1080, hfov_deg=60.0)  # f-theta: 1920 px over 60 degrees
    >>> round(view.focal_px * math.radians(1.0))  # px per degree
    32
    """

    width_px: Annotated[int, within("width_px")]
    height_px: Annotated[int, within("width_px")]
    hfov_deg: Annotated[float, within("hfov_deg")]
    lens: Lens = "f-theta"
    calibrated: Field | None = None

    def __post_init__(self) -> None:
        check_fields(self)
        if self.lens == "rectilinear":
            _pinhole_px(self.width_px, self.hfov_deg)

    @property
    def focal_px(self) -> float:
        """Pixels per radian on the axis."""
        if self.lens == "rectilinear":
            return _pinhole_px(self.width_px, self.hfov_deg)
        return self.width_px / math.radians(self.hfov_deg)

    def pixels(self, most: int | None = None) -> Floats:
        """The pixels' centres (2, H, W); with ``most``, at most so many along each side, the outermost among them.

        Raises ``ValueError`` for more than 2^28.
        """
        sizes = self.width_px, self.height_px
        width, height = (size if most is None else min(size, most) for size in sizes)
        if width * height > LARGEST_PICTURE:
            must = f"at most {LARGEST_PICTURE} are computed"
            raise ValueError(f"width_px, height_px: {width} x {height} pixels; {must}")
        x, y = np.linspace(0.0, sizes[0] - 1.0, width), np.linspace(0.0, sizes[1] - 1.0, height)
        return np.stack(np.meshgrid(x, y))

    def rays(self, pixels: Floats) -> Floats:
        """Unit vectors (3, ...) towards what pixels (2, ...) see."""
        if self._field:
            x, y = self._field.directions(pixels, (self.height_px, self.width_px))
            rays = np.stack([x, y, np.ones_like(x)])
            return np.asarray(rays / np.linalg.norm(rays, axis=0))
        x = (pixels[0] - (self.width_px - 1) / 2) / self.focal_px
        y = (pixels[1] - (self.height_px - 1) / 2) / self.focal_px
        theta = np.hypot(x, y)
        # A radius in an f-theta picture is an angle, whatever the direction: it becomes a point of the unit sphere.
        bent = np.sinc(theta / np.pi)  # sin(theta) / theta
        return np.asarray(np.where(theta <= np.pi, np.stack([x * bent, y * bent, np.cos(theta)]), np.nan))

    def flow_px_s(self, pixels: Floats, range_m: Floats, motion: EgoMotion) -> Floats:
        """Velocity (2, ...) of what pixels (2, ...) see at ranges (...), by the camera's motion, px/s.

        A pinhole: Longuet-Higgins & Prazdny, Proc. R. Soc. B 208 (1980), with x = X/Z, y = Y/Z, which a calibrated
        lens images. F-theta: a ray s at range R turns by s' = -(w x s) - (V - (s.V) s)/R; the picture shows its
        angle from the axis and around it. Raises ``ValueError`` for a range <= 0.
        """
        _ahead("range_m", range_m)
        velocity, turn = np.array(motion.velocity_m_s), np.radians(motion.rotation_deg_s)
        if self._field:
            size = self.height_px, self.width_px
            seen = x, y = self._field.directions(pixels, size)
            # One over the depth along the axis: of flow by translation alone distance matters.
            near = np.sqrt(1 + x * x + y * y) / range_m
            (vx, vy, vz), (wx, wy, wz) = velocity, turn
            u = (x * vz - vx) * near + wx * x * y - wy * (1 + x * x) + wz * y
            v = (y * vz - vy) * near + wx * (1 + y * y) - wy * x * y - wz * x
            moving = np.stack([u, v])
            if self.calibrated is None:
                return self.focal_px * moving
            fastest = np.hypot(u, v)
            # The calibrated lens has no closed-form slope: a central difference along the way that each pixel goes.
            step_s = _STEP / np.where(fastest > 0, fastest, 1.0)
            after, before = (self.calibrated.imaged(seen + moving * way, size) for way in (step_s, -step_s))
            return (after - before) / (2 * step_s)
        rays = self.rays(pixels)
        # Motion along a ray shows nothing: only the part across it turns the ray.
        sideways = velocity.reshape(3, *[1] * (rays.ndim - 1)) - np.tensordot(velocity, rays, 1) * rays
        turned = -np.cross(turn, rays, axisb=0, axisc=0) - sideways / range_m
        across = np.hypot(rays[0], rays[1])
        off = across > 0
        divisor = np.where(off, across, 1.0)
        radial = np.stack([np.where(off, rays[0] / divisor, 1.0), rays[1] / divisor])
        around = np.stack([-radial[1], radial[0]])
        angular = rays[2] * (radial * turned[:2]).sum(0) - across * turned[2]
        wider = np.where(off, np.arctan2(across, rays[2]) / divisor, 1.0)
        return np.asarray(self.focal_px * (angular * radial + wider * (around * turned[:2]).sum(0) * around))

    @property
    def _field(self) -> Field | None:
        """Of a lens that images directions X/Z and Y/Z: the calibrated one, or a pinhole."""
        if self.calibrated is None and self.lens == "rectilinear":
            return Field(self.width_px, self.height_px, self.hfov_deg)
        return self.calibrated


def range_of_depth_m(rays: Floats, depth_m: float | Floats) -> Floats:
    """Ranges (...) at which rays (3, ...) meet a depth > 0, m: of a plane ahead, or a map (...), inf for the sky.

    >>> rays = View(201, 201, 90.0, "rectilinear").rays(np.array([[100.0, 200.0], [100.0, 100.0]]))
    >>> range_of_depth_m(rays, 10.0).round(1).tolist()  # on the axis, and nearly 45 degrees off it
    [10.0, 14.1]
    """
    _ahead("depth_m", depth_m)
    return _ranges_m(depth_m, rays[2])


def _ranges_m(away_m: float | Floats, along: Floats) -> Floats:
    """Of planes at a distance, by the share of a ray along it; inf of rays that lead away."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.where(along > 0, away_m / along, np.where(np.isnan(along), np.nan, np.inf)))


def _ahead(name: str, away_m: float | Floats) -> None:
    """Raise ``ValueError`` unless all is before the camera, or unknown."""
    nearest = float(np.nanmin(away_m)) if not np.isnan(away_m).all() else math.inf
    if nearest <= 0:
        must = "must be > 0, inf for the sky, NaN where none is known"
        raise ValueError(f"{name}: the smallest is {nearest:g}; {must}")


@dataclass(frozen=True)
class Vehicle:
    """A vehicle on a flat road and its camera, height_m above the road.

    The camera looks pitch_deg down and heading_deg to the right. hfov_deg: of the picture; None: the camera's, of
    whose sensor the picture is the largest part of its shape. lens: None: the camera's own where it has a distortion
    and hfov_deg is not given, else f-theta. plane_m: depth of a wall ahead. yaw_deg_s, pitch_deg_s: the vehicle turns
    to the right, and up. Raises ``ValueError`` that names the field.

    >>> from blurnoise import Camera
    >>> flow = Vehicle(height_m=1.5, hfov_deg=60.0).flow_px_s(Camera.preset("imx250"), (480, 640), 20.0)
    >>> flow.shape, round(float(flow[1, 479, 320]))  # px/s, the road at the bottom of the picture at 72 km/h
    (torch.Size([2, 480, 640]), 1189)
    """

    height_m: Annotated[float, within("camera_height_m")] = 1.5
    pitch_deg: Annotated[float, within("pitch_deg")] = 0.0
    heading_deg: Annotated[float, within("heading_deg")] = 0.0
    hfov_deg: Annotated[float | None, within("hfov_deg")] = None
    lens: Lens | None = None
    plane_m: Annotated[float | None, within("depth_m")] = None
    yaw_deg_s: _Turn = 0.0
    pitch_deg_s: _Turn = 0.0

    def __post_init__(self) -> None:
        check_fields(self)
        if self.lens == "rectilinear" and self.hfov_deg is not None:
            _pinhole_px(1.0, self.hfov_deg)

    @property
    def down(self) -> Floats:
        """The direction towards the road, in the camera's axes."""
        pitch = math.radians(self.pitch_deg)
        return np.array([0.0, math.cos(pitch), math.sin(pitch)])

    @property
    def ahead(self) -> Floats:
        """The direction in which the vehicle drives, in the camera's axes."""
        pitch, heading = math.radians(self.pitch_deg), math.radians(self.heading_deg)
        level = math.cos(heading)
        return np.array([-math.sin(heading), -math.sin(pitch) * level, math.cos(pitch) * level])

    @property
    def turns(self) -> bool:
        """Whether the vehicle turns."""
        return bool(self.yaw_deg_s or self.pitch_deg_s)

    def driving(self, speed_m_s: float, yaw_deg_s: float = 0.0, pitch_deg_s: float = 0.0) -> EgoMotion:
        """The camera's motion where the vehicle drives at speed_m_s and turns to the right and up, degrees/s."""
        speed, yaw = limited("speed_m_s", speed_m_s), limited("yaw_deg_s", yaw_deg_s, "rotation_deg_s")
        x, y, z = (yaw * self.down).tolist()
        return EgoMotion(tuple((speed * self.ahead).tolist()), (x + pitch_deg_s, y, z))

    def road_m(self, rays: Floats) -> Floats:
        """Ranges (...) at which rays (3, ...) meet the road; inf above the horizon."""
        return _ranges_m(self.height_m, np.tensordot(self.down, rays, 1))

    def view(self, camera: Camera, size: tuple[int, int]) -> View:
        """The view of a picture (H, W). Raises ``ValueError`` for a field of view beyond the lens's."""
        (height, width), lens = size, self.lens or "f-theta"
        if self.hfov_deg is not None:
            return View(width, height, self.hfov_deg, lens)
        if self.lens is None and camera.lens.displaces:
            return View(width, height, camera.lens.hfov_deg, calibrated=camera.field)
        sensor = View(camera.sensor.width_px, camera.sensor.height_px, camera.lens.hfov_deg, lens)
        half = width / 2 / (sensor.focal_px * camera.field.per_sensor_px(size))
        half_deg = math.degrees(half if lens == "f-theta" else math.atan(half))
        return View(width, height, 2 * half_deg, lens)

    def flow_at(self, pixels: Floats, camera: Camera, size: tuple[int, int], speed_m_s: float) -> Floats:
        """Velocities (2, ...), px/s, of what pixels (2, ...) of a picture (H, W) see at a speed ahead."""
        motion = self.driving(speed_m_s, self.yaw_deg_s, self.pitch_deg_s)
        return self._flow(pixels, self.view(camera, size), motion)

    def flow_px_s(self, camera: Camera, size: tuple[int, int], speed_m_s: float | Tensor) -> Tensor:
        """Flow of every pixel, px/s, as :func:`blurnoise.simulate` takes it: (2, H, W), float32.

        Of speeds (B,): (B, 2, H, W), in their dtype and on their device; differentiable in them.
        """
        if not isinstance(speed_m_s, Tensor):
            speed_m_s = torch.tensor(limited("speed_m_s", speed_m_s), dtype=torch.float32)
        ahead, turning = _flows(self, self.view(camera, size))
        flow = speed_m_s[..., None, None, None] * ahead.to(speed_m_s)
        return flow if turning is None else flow + turning.to(speed_m_s)

    def _flow(self, pixels: Floats, view: View, motion: EgoMotion) -> Floats:
        rays = view.rays(pixels)
        ranges = self.road_m(rays)
        if self.plane_m is not None:
            ranges = np.minimum(ranges, range_of_depth_m(rays, self.plane_m))
        # Beyond the lens nothing is seen, so nothing moves there.
        return np.nan_to_num(view.flow_px_s(pixels, ranges, motion))


@lru_cache(maxsize=8)
def _flows(vehicle: Vehicle, view: View) -> tuple[Tensor, Tensor | None]:
    """Flow per 1 m/s ahead, and flow by turning or None; their sum is the flow. Cached; read only."""
    # Flow is linear in the speed: one flow for 1 m/s serves all speeds of a sweep, and gives their gradient.
    motions = [vehicle.driving(1.0), vehicle.driving(0.0, vehicle.yaw_deg_s, vehicle.pitch_deg_s)]
    flows = [vehicle._flow(view.pixels(), view, motion) for motion in motions[: 1 + vehicle.turns]]
    ahead, *turning = (torch.from_numpy(flow.astype(np.float32)) for flow in flows)
    return ahead, turning[0] if turning else None


USUAL_VEHICLE = Vehicle()
