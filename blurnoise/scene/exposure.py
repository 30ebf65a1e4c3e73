"""The exposure of one frame: camera, light, time and motion, and the boxes under that motion.

Convention: px, x right and y down, boxes (N, 4) as (x0, y0, x1, y1) from the picture's corner.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal, get_args

import torch
from torch import Tensor

from blurnoise._core import rng
from blurnoise._core.checks import an_instance, boxes, finite, integer, limited, one_of, picture_size, shown
from blurnoise.camera.camera import Amplified, Camera
from blurnoise.camera.lens import pixels
from blurnoise.camera.spectra import Floats
from blurnoise.light import effects
from blurnoise.light.conditions import Conditions
from blurnoise.light.flicker import Pwm
from blurnoise.motion.ego import USUAL_VEHICLE, Vehicle
from blurnoise.motion.trajectory import Trajectory

Moves = Literal["all", "targets", "background"]
MOVES: tuple[Moves, ...] = get_args(Moves)
"""What moves: everything, the targets before a camera at rest, or the background behind targets that it tracks."""
_THIRDS = ((1.0, 0.5, 0.0), (0.0, 0.5, 1.0))  # of a side's ends, its ends and its middle


@dataclass(frozen=True)
class Exposure:
    """Settings of one frame: camera, exposure time, light, motion, temperature, gain and the seed of the noise.

    exposure_s: of the first capture, to which the boxes refer. illuminance_lux: on the scene. velocity_px_s: x right,
    y down. gain_db: analogue up to the camera's ``analogue_gain_max_db``, then digital. seed: of the noise, see
    :mod:`blurnoise._core.rng`. trajectory: motion of the picture in addition to the velocity. moves: an entry of
    ``MOVES``, which part of the picture moves, see :mod:`.cutting`. ego_speed_m_s: speed of the camera's vehicle, in
    place of velocity_px_s and moves. lamp: the pulsed lamp that lights the scene.
    :func:`blurnoise.scene.hdr.frames` takes exposures with several captures or under a lamp. Raises ``TypeError`` or
    ``ValueError`` naming the field and what is allowed.
    """

    camera: Camera
    exposure_s: float
    illuminance_lux: float
    velocity_px_s: tuple[float, float] = (0.0, 0.0)
    temperature_c: float = 25.0
    gain_db: float = 0.0
    seed: int = 0
    trajectory: Trajectory | None = None
    moves: str = "all"
    ego_speed_m_s: float = 0.0
    vehicle: Vehicle = USUAL_VEHICLE
    lamp: Pwm | None = None

    def __post_init__(self) -> None:
        an_instance("camera", self.camera, Camera)
        for name in ("exposure_s", "illuminance_lux", "temperature_c", "gain_db"):
            limited(name, getattr(self, name))
        _ = self.amplified  # whose gain has limits of its own
        if not isinstance(self.velocity_px_s, tuple) or len(self.velocity_px_s) != 2:
            raise ValueError(f"velocity_px_s = {shown(self.velocity_px_s)}: must be two numbers (x, y)")
        for speed in self.velocity_px_s:
            moved = limited("velocity_px_s", speed) * self.exposure_s
            limited("displacement_px: velocity times exposure", moved, "displacement_px")
        integer("seed", self.seed, 0, rng.LAST_SEED)
        if self.trajectory is not None:
            an_instance("trajectory", self.trajectory, Trajectory)
        if self.lamp is not None:
            an_instance("lamp", self.lamp, Pwm)
        one_of("moves", self.moves, MOVES)
        limited("ego_speed_m_s", self.ego_speed_m_s, "speed_m_s")
        an_instance("vehicle", self.vehicle, Vehicle)
        if self.drives and (any(self.velocity_px_s) or self.moves != "all"):
            given = f"ego_speed_m_s = {self.ego_speed_m_s!r}, or a vehicle that turns"
            raise ValueError(f"{given}: velocity_px_s must be (0, 0) and moves 'all'")

    @property
    def drives(self) -> bool:
        """Whether the camera's vehicle drives or turns."""
        return bool(self.ego_speed_m_s) or self.vehicle.turns

    @property
    def amplified(self) -> Amplified:
        """The camera at the analogue gain, and the remaining digital gain."""
        return self.camera.at_gain(self.gain_db)

    def move_boxes(self, boxes_xyxy: Tensor, size: tuple[int, int] | None = None) -> Tensor:
        """Boxes (N, 4) of the scene, px, at mid-exposure in a picture (H, W), by default the sensor's."""
        return self._boxes(boxes_xyxy, size, swept=False)

    def sweep_boxes(self, boxes_xyxy: Tensor, size: tuple[int, int] | None = None) -> Tensor:
        """Swept boxes (N, 4), px, of boxes (N, 4) of the scene; they may extend beyond the picture."""
        return self._boxes(boxes_xyxy, size, swept=True)

    def move_points(self, points: Tensor, size: tuple[int, int] | None = None) -> Tensor:
        """Points (N, 2) of the scene, px from the picture's corner, at mid-exposure, as :meth:`move_boxes` does."""
        points = finite("points", points)
        if points.ndim != 2 or points.shape[1] != 2:
            raise ValueError(f"points: shape must be (N, 2), got {tuple(points.shape)}")
        return self._boxes(points.repeat(1, 2), size, swept=False)[:, :2]

    def origins(self, size: tuple[int, int] | None = None) -> Floats:
        """Points (2, H, W) of the scene that a picture's pixels show, x and y in px from the centre of the first one.

        The inverse of :meth:`move_points`, at mid-exposure; beyond the scene where the lens sees further.
        """
        size = picture_size("size", size or self.camera.field.size)
        at = self._at(size)
        if self.drives:
            flow = self.vehicle.flow_px_s(self.camera, size, self.ego_speed_m_s).double() * self.exposure_s
            at = replace(at, flow_px=flow[None])
        return effects.origins(pixels(size), at)

    def displacements_px(self, places: Tensor, size: tuple[int, int] | None = None) -> Tensor:
        """Motion (N, 2) during the exposure, px, at places (N, 2) of a picture (H, W), by default the sensor's.

        Places are measured from the picture's corner, as boxes are.
        """
        moved = places.double().new_tensor(self.velocity_px_s).expand(len(places), 2)
        if self.drives:
            points = places.detach().cpu().double().numpy().T - 0.5
            of = size or self.camera.field.size
            if self.camera.lens.displaces:  # which is known in the picture only
                points = points.clip(-0.5, [[of[1] - 0.5], [of[0] - 0.5]])
            flow = self.vehicle.flow_at(points, self.camera, of, self.ego_speed_m_s)
            moved = torch.from_numpy(flow.T).to(moved)
        return (moved * self.exposure_s).to(places)

    def of_targets(self, speed: float = 1.0) -> Exposure:
        """The exposure for a target that moves at ``speed`` times the velocity."""
        if self.moves == "all":
            return self
        share = {"targets": speed, "background": 1.0 - speed}[self.moves]
        x, y = (share * along + 0.0 for along in self.velocity_px_s)
        return replace(self, velocity_px_s=(x, y), moves="all")

    def _boxes(self, boxes_xyxy: Tensor, size: tuple[int, int] | None, *, swept: bool) -> Tensor:
        """Boxes (N, 4) after the effects; if the motion differs over the picture, the hull of corners and middles."""
        boxes_xyxy = boxes("boxes_xyxy", boxes_xyxy)
        size = None if size is None else picture_size("size", size)
        at = self._at(size)
        if not self.drives or not len(boxes_xyxy):
            return effects.moved_boxes(boxes_xyxy, at, swept=swept)
        thirds = boxes_xyxy.new_tensor(_THIRDS)
        across, down = boxes_xyxy[:, 0::2] @ thirds, boxes_xyxy[:, 1::2] @ thirds
        nine = across[:, :, None].expand(-1, -1, 3), down[:, None].expand(-1, 3, -1)
        places = torch.stack(nine, -1).view(-1, 2)
        moved = self.displacements_px(places, size)
        if (
            self.trajectory is None and not self.camera.sensor.row_time_s
        ):  # all at once, behind the distortion
            half = moved.abs() / 2 * swept
            each = effects.moved_boxes(places.repeat(1, 2), at, swept=swept) + torch.cat([-half, half], 1)
        else:
            own = zip(places.repeat(1, 2)[:, None], moved.tolist(), strict=True)
            ats = ((place, replace(at, displacement_px=(dx, dy))) for place, (dx, dy) in own)
            each = torch.cat([effects.moved_boxes(place, one, swept=swept) for place, one in ats])
        each = each.view(-1, 9, 4)
        return torch.cat([each[..., :2].amin(1), each[..., 2:].amax(1)], 1)

    def _at(self, size: tuple[int, int] | None) -> Conditions[float]:
        """The conditions of the targets, whatever the light and the flow."""
        x, y = (speed * self.exposure_s for speed in self.of_targets().velocity_px_s)
        paths = (self.trajectory,) if self.trajectory else ()
        numbers = self.exposure_s, self.temperature_c, math.nan, (x, y)
        return Conditions(self.camera, *numbers, size=size, trajectories=paths)
