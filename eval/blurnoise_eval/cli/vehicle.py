"""The camera on a vehicle, as ``motion --map`` and ``simulate --ego`` are told of it: its options, and the flow."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from typer import Option

if TYPE_CHECKING:
    from torch import Tensor

    from blurnoise.camera import Camera

LensKind = Literal["f-theta", "rectilinear"]


def height_m(panel: str) -> Any:
    """--height-m."""
    return Option(metavar="M", help="of the camera above the road, default: 1.5", rich_help_panel=panel)


def pitch_deg(panel: str) -> Any:
    """--pitch-deg."""
    return Option(metavar="DEG", help="the camera looks down by, default: 0", rich_help_panel=panel)


def heading_deg(panel: str) -> Any:
    """--heading-deg."""
    return Option(metavar="DEG", help="... and to the right of the way by, default: 0", rich_help_panel=panel)


def hfov_deg(panel: str | None = None) -> Any:
    """--hfov-deg."""
    return Option(metavar="DEG", help="horizontal field of view", rich_help_panel=panel)


def lens(panel: str | None = None) -> Any:
    """--lens."""
    return Option(
        help="f-theta: the same px per degree everywhere, as in Lin et al. 2024; rectilinear: pinhole"
        + ("; default: f-theta" if panel else ""),
        rich_help_panel=panel,
    )


class Drive(NamedTuple):
    """Speed ahead, m/s, and rotation of the camera, degrees/s: to the right, and up."""

    speed_m_s: float
    yaw_deg_s: float = 0.0
    pitch_deg_s: float = 0.0

    @classmethod
    def parse(cls, text: str) -> Drive:
        """Of "KMH[,YAW_DEG_S[,PITCH_DEG_S]]". Raises ``ValueError``."""
        try:
            speed_kmh, *turns = (float(part) for part in text.split(","))
        except ValueError:
            turns = [math.nan] * 3
        if len(turns) > 2:
            raise ValueError(f"ego = {text!r}: must be KMH[,YAW_DEG_S[,PITCH_DEG_S]], such as 50 or 50,10")
        return cls(speed_kmh / 3.6, *turns)


def flow_px_s(
    drive: Drive,
    camera: Camera,
    light: Tensor,
    *,
    hfov_deg: float | None = None,
    lens: LensKind = "f-theta",
    height_m: float = 1.5,
    pitch_deg: float = 0.0,
    heading_deg: float = 0.0,
    plane_m: float | None = None,
) -> Tensor:
    """The velocity (2, H, W), px/s, of what a light (B, C, H, W) shows: road and sky, or a plane before them.

    hfov_deg: of the picture; None: the camera's, of whose sensor the picture is the largest part of its shape. Raises
    ``ValueError`` naming the argument.
    """
    from dataclasses import replace

    import numpy as np
    import torch

    from blurnoise._core.limits import limited
    from blurnoise.ego_motion import Mount, View, range_of_depth_m

    height, width = light.shape[-2:]
    if hfov_deg is None:
        sensor = View(camera.width_px, camera.height_px, camera.hfov_deg, lens)
        half = width / 2 / (sensor.focal_px * camera.field.per_sensor_px((height, width)))
        hfov_deg = math.degrees(2 * (half if lens == "f-theta" else math.atan(half)))
    view, mount = View(width, height, hfov_deg, lens), Mount(height_m, pitch_deg, heading_deg)
    moving = mount.driving(drive.speed_m_s, drive.yaw_deg_s)
    x, y, z = moving.rotation_deg_s
    moving = replace(moving, rotation_deg_s=(x + drive.pitch_deg_s, y, z))
    pixels = view.pixels()
    rays = view.rays(pixels)
    ranges = mount.road_m(rays)
    if plane_m is not None:
        ranges = np.minimum(ranges, range_of_depth_m(rays, limited("plane_m", plane_m, "depth_m")))
    return torch.from_numpy(np.nan_to_num(view.flow_px_s(pixels, ranges, moving)))  # none beyond the lens
