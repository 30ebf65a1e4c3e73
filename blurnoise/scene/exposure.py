"""The exposure: camera, light, time and motion of one frame or of a batch, and where it takes boxes and points.

Convention: px, x right and y down, boxes (N, 4) as (x0, y0, x1, y1) from the picture's corner.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, Generic, Literal, get_args

import torch
from torch import Tensor
from typing_extensions import TypeVar

from blurnoise._core import rng
from blurnoise._core.beams import BEAMS
from blurnoise._core.checks import (
    an_instance,
    boxes,
    finite,
    integer,
    limited,
    one_of,
    picture_size,
    real_tensor,
    shown,
)
from blurnoise.blur.layer import Layer
from blurnoise.camera import Camera
from blurnoise.camera.camera import Amplified
from blurnoise.camera.lens import pixels
from blurnoise.camera.spectra import Curve, Floats, check_illuminant
from blurnoise.light import effects
from blurnoise.light.lamp import Pwm
from blurnoise.light.resolved import Resolved
from blurnoise.motion.ego import USUAL_VEHICLE, Vehicle
from blurnoise.motion.trajectory import Trajectory
from blurnoise.picture.fusion import amplified
from blurnoise.scene.metering import AutoExposure

Moves = Literal["all", "targets", "background"]
MOVES: tuple[Moves, ...] = get_args(Moves)
"""What moves: everything, the targets before a camera at rest, or the background behind targets that it tracks."""
Number = TypeVar("Number", float, Tensor, default=float)
HEADLAMP: tuple[str, ...] = ("off", *BEAMS)
"""The beam of the vehicle's headlamps."""
_LEAST_LUX = 1e-6  # beside headlamps, whose light is a multiple of the illuminance's
_NUMBERS = ("exposure_s", "illuminance_lux", "temperature_c")
_PER_FRAME = ("seed", "trajectory", "lamp", "ego_speed_m_s")
_THIRDS = ((1.0, 0.5, 0.0), (0.0, 0.5, 1.0))  # weights of a side's two ends, for its ends and its middle


@dataclass(frozen=True)
class Exposure(Generic[Number]):
    """How a picture is taken: camera, exposure time, light, motion, temperature, gain and the seed of the noise.

    Numbers describe one frame; tensors (B,) a batch, whose picture i is taken under the i-th values. exposure_s: of
    the first capture, to which the boxes refer; NaN: set by the auto-exposure. illuminance_lux: on the scene.
    velocity_px_s: (x, y), x right, y down; for a batch also (B, 2), or of each pixel (2, H, W) or (B, 2, H, W).
    gain_db: analogue up to the camera's ``analogue_gain_max_db``, then digital; or a :class:`blurnoise.AutoExposure`,
    which sets it by the light. seed: of the noise, see :mod:`blurnoise._core.rng`; for a batch one for each picture.
    trajectory: motion in addition to the velocity; for a batch also one or None for each picture. moves: an entry of
    ``MOVES``: which part of a picture with cut-out targets moves. ego_speed_m_s: speed of the camera's vehicle, in
    place of velocity_px_s; with moves = "background" the targets drive along. lamp: the pulsed lamp that lights the
    scene; for a batch also one or None for each picture. illuminant: the light's spectrum, a name or a curve (see
    :func:`blurnoise.camera.spectra.illuminant`), one for a batch. headlamp: "off", "low" or "high", the beam that
    lights the scene in addition, one for a batch; see :attr:`blurnoise.Scene.headlamp_lux`. Raises ``TypeError`` or
    ``ValueError`` naming the field and what is allowed.

    >>> from blurnoise import Camera
    >>> exposure = Exposure(Camera.preset("imx250"), 0.01, 50.0, velocity_px_s=(1000.0, 0.0))
    >>> exposure.sweep_boxes(torch.tensor([[100.0, 50.0, 120.0, 70.0]])).tolist()
    [[95.0, 50.0, 125.0, 70.0]]
    """

    camera: Camera
    exposure_s: Number
    illuminance_lux: Number
    velocity_px_s: Any = (0.0, 0.0)  # of one frame tuple[float, float]
    temperature_c: Number | float = 25.0
    gain_db: Any = 0.0  # float | AutoExposure
    seed: Any = 0  # int, of a batch Sequence[int]
    trajectory: Any = None  # Trajectory | None, of a batch also Sequence[Trajectory | None]
    moves: str = "all"
    ego_speed_m_s: Number | float = 0.0
    vehicle: Vehicle = USUAL_VEHICLE
    lamp: Any = None  # Pwm | None, of a batch also Sequence[Pwm | None]
    illuminant: str | Curve = "D55"
    headlamp: str = "off"

    def __post_init__(self) -> None:
        an_instance("camera", self.camera, Camera)
        one_of("moves", self.moves, MOVES)
        an_instance("vehicle", self.vehicle, Vehicle)
        check_illuminant(self.illuminant)
        one_of("headlamp", self.headlamp, HEADLAMP)
        if not isinstance(self.gain_db, AutoExposure):
            _ = self.amplified  # whose gain has limits of its own
        batched = self.batched
        for seed in self.seed if batched else [self.seed]:
            integer("seed", seed, 0, rng.LAST_SEED)
        if not batched:
            self._check_one()  # type: ignore[misc]
        if self.drives and (self.moves == "targets" or bool(self._velocity.any())):
            given = f"ego_speed_m_s = {shown(self.ego_speed_m_s)}, or a vehicle that turns"
            raise ValueError(f"{given}: velocity_px_s must be (0, 0) and moves not 'targets'")

    def __eq__(self, other: object) -> bool:
        """Whether all values are equal. Tensors of a batch are as a whole, where ``==`` compares their elements."""
        if not isinstance(other, Exposure):
            return NotImplemented
        names = [entry.name for entry in fields(self)]
        return all(_same(getattr(self, name), getattr(other, name)) for name in names)

    def _check_one(self: Exposure[float]) -> None:
        """Check the values of one frame. Those of a batch are checked against its pictures."""
        exposure_s = 0.0 if self.automatic_time else limited("exposure_s", self.exposure_s)
        self.check_beside_headlamps(limited("illuminance_lux", self.illuminance_lux))
        limited("temperature_c", self.temperature_c)
        if not isinstance(self.velocity_px_s, tuple) or len(self.velocity_px_s) != 2:
            raise ValueError(f"velocity_px_s = {shown(self.velocity_px_s)}: must be two numbers (x, y)")
        for speed in self.velocity_px_s:
            moved = limited("velocity_px_s", speed) * exposure_s
            limited("displacement_px: velocity times exposure", moved, "displacement_px")
        if self.trajectory is not None:
            an_instance("trajectory", self.trajectory, Trajectory)
        if self.lamp is not None:
            an_instance("lamp", self.lamp, Pwm)
        limited("ego_speed_m_s", self.ego_speed_m_s, "speed_m_s")

    def check_beside_headlamps(self, least_lux: float) -> None:
        """Raise ``ValueError`` where there is too little light to multiply by headlamps."""
        if self.headlamp != "off" and least_lux < _LEAST_LUX:
            must = f"needs illuminance_lux >= {_LEAST_LUX:g}; moonlight is 0.3"
            raise ValueError(f"headlamp = {self.headlamp!r}: {must}")

    @property
    def _velocity(self) -> Tensor:
        return real_tensor("velocity_px_s", self.velocity_px_s).detach()

    @property
    def batched(self) -> bool:
        """Whether the values describe a batch: each picture has a seed of its own."""
        return isinstance(self.seed, list | tuple)

    @property
    def automatic_time(self) -> bool:
        """Whether the auto-exposure sets the exposure time."""
        automatic = isinstance(self.gain_db, AutoExposure)
        return automatic and isinstance(self.exposure_s, float) and math.isnan(self.exposure_s)

    @property
    def drives(self) -> bool:
        """Whether the camera's vehicle drives or turns."""
        return isinstance(self.ego_speed_m_s, Tensor) or bool(self.ego_speed_m_s) or self.vehicle.turns

    @cached_property
    def amplified(self) -> Amplified:
        """The camera at the analogue gain, that of its captures included, and the remaining digital gain."""
        if isinstance(self.gain_db, AutoExposure):
            raise ValueError("gain_db: is automatic; 'metered' sets it for the light of a picture")
        return amplified(self.camera, self.gain_db)

    def metered(self: Exposure[float], mean_light: float) -> Exposure[float]:
        """The exposure with the gain, and the time, that its auto-exposure sets for a picture of this mean light."""
        if not isinstance(self.gain_db, AutoExposure):
            return self
        setting = self.gain_db.setting(
            self.camera,
            mean_light=mean_light,
            illuminance_lux=self.illuminance_lux,
            exposure_s=None if self.automatic_time else self.exposure_s,
            temperature_c=float(self.temperature_c),
            illuminant=self.illuminant,
        )
        return replace(self, exposure_s=setting.exposure_s, gain_db=setting.gain_db)

    @staticmethod
    def stack(exposures: Sequence[Exposure[float]]) -> Exposure[Tensor]:
        """Exposures of one camera, spectrum, gain, ego speed and part that moves as a batch, in double precision."""
        first = exposures[0]
        numbers: dict[str, Any] = {
            name: torch.tensor([getattr(one, name) for one in exposures], dtype=torch.float64)
            for name in _NUMBERS
        }
        return replace(  # type: ignore[return-value]
            first,
            **numbers,
            velocity_px_s=torch.tensor([one.velocity_px_s for one in exposures], dtype=torch.float64),
            seed=[one.seed for one in exposures],
            trajectory=[one.trajectory for one in exposures],
            lamp=[one.lamp for one in exposures],
        )

    def each(self, batch: int) -> Iterator[Exposure[float]]:
        """The exposure of every frame of a batch. Raises ``ValueError`` for values of another number of frames."""
        columns = {name: _column(name, getattr(self, name), batch) for name in (*_NUMBERS, *_PER_FRAME)}
        velocity = self._velocity.double()
        if velocity.shape not in ((2,), (batch, 2)):  # no frame has the velocities of pixels as numbers
            must = f"must be (2,) or ({batch}, 2), without a velocity for each pixel"
            raise ValueError(f"velocity_px_s: shape is {tuple(velocity.shape)}; {must}")
        columns["velocity_px_s"] = list(map(tuple, velocity.expand(batch, 2).tolist()))
        for item in range(batch):
            yield replace(self, **{name: values[item] for name, values in columns.items()})  # type: ignore[misc]

    def velocity_of(self: Exposure[float], layer: Layer) -> tuple[float, float] | Tensor:
        """Velocity of a layer of the scene, px/s: its own, or of a target at a speed as ``of_targets`` has it."""
        if layer.speed is None:
            return torch.as_tensor(layer.velocity_px_s)
        velocity: tuple[float, float] = self.of_targets(layer.speed).velocity_px_s
        return velocity

    def move_boxes(self: Exposure[float], boxes_xyxy: Tensor, size: tuple[int, int] | None = None) -> Tensor:
        """Boxes (N, 4) of the scene, px, at mid-exposure in a picture (H, W), by default the sensor's."""
        return self._boxes(boxes_xyxy, size, swept=False)

    def sweep_boxes(self: Exposure[float], boxes_xyxy: Tensor, size: tuple[int, int] | None = None) -> Tensor:
        """Swept boxes (N, 4), px, of boxes (N, 4) of the scene; they may extend beyond the picture."""
        return self._boxes(boxes_xyxy, size, swept=True)

    def move_points(self: Exposure[float], points: Tensor, size: tuple[int, int] | None = None) -> Tensor:
        """Points (N, 2) of the scene, px from the picture's corner, at mid-exposure, as :meth:`move_boxes` does."""
        points = finite("points", points)
        if points.ndim != 2 or points.shape[1] != 2:
            raise ValueError(f"points: shape must be (N, 2), got {tuple(points.shape)}")
        return self._boxes(points.repeat(1, 2), size, swept=False)[:, :2]

    def origins(self: Exposure[float], size: tuple[int, int] | None = None) -> Floats:
        """Points (2, H, W) of the scene that a picture's pixels show, x and y in px from the centre of the first one.

        The inverse of :meth:`move_points`, at mid-exposure; beyond the scene where the lens sees further.
        """
        size = picture_size("size", size or self.camera.field.size)
        at = self._at(size)
        if self.drives:
            flow = self.vehicle.flow_px_s(self.camera, size, self.ego_speed_m_s).double() * self.exposure_s
            at = replace(at, flow_px=flow[None])
        return effects.origins(pixels(size), at)

    def displacements_px(
        self: Exposure[float], points: Tensor, size: tuple[int, int] | None = None
    ) -> Tensor:
        """Motion (N, 2) during the exposure, px, at points (N, 2) of a picture (H, W), by default the sensor's.

        Points are measured from the picture's corner, as boxes are.
        """
        moved = points.double().new_tensor(self.velocity_px_s).expand(len(points), 2)
        if self.drives:
            centres = points.detach().cpu().double().numpy().T - 0.5
            of = size or self.camera.field.size
            if self.camera.lens.displaces:  # its flow is known within the picture only
                centres = centres.clip(-0.5, [[of[1] - 0.5], [of[0] - 0.5]])
            flow = self.vehicle.flow_at(centres, self.camera, of, float(self.ego_speed_m_s))
            moved = torch.from_numpy(flow.T).to(moved)
        return (moved * self.exposure_s).to(points)

    def of_targets(self: Exposure[float], speed: float = 1.0) -> Exposure[float]:
        """The exposure for a target that moves at ``speed`` times the velocity."""
        if self.moves == "all":
            return self
        if self.drives:  # the targets drive along
            return replace(self, ego_speed_m_s=0.0, vehicle=USUAL_VEHICLE, moves="all")
        share = {"targets": speed, "background": 1.0 - speed}[self.moves]
        x, y = (share * along + 0.0 for along in self.velocity_px_s)
        return replace(self, velocity_px_s=(x, y), moves="all")

    def _boxes(
        self: Exposure[float], boxes_xyxy: Tensor, size: tuple[int, int] | None, *, swept: bool
    ) -> Tensor:
        """Boxes (N, 4) after the effects; if the motion differs over the picture, the hull of corners and middles."""
        boxes_xyxy = boxes("boxes_xyxy", boxes_xyxy)
        size = None if size is None else picture_size("size", size)
        at = self._at(size)
        if not self.drives or not len(boxes_xyxy):
            return effects.moved_boxes(boxes_xyxy, at, swept=swept)
        thirds = boxes_xyxy.new_tensor(_THIRDS)
        across, down = boxes_xyxy[:, 0::2] @ thirds, boxes_xyxy[:, 1::2] @ thirds
        nine = across[:, :, None].expand(-1, -1, 3), down[:, None].expand(-1, 3, -1)
        points = torch.stack(nine, -1).view(-1, 2)
        moved = self.displacements_px(points, size)
        if (
            self.trajectory is None and not self.camera.sensor.row_time_s
        ):  # all at once, behind the distortion
            half = moved.abs() / 2 * swept
            hulls = effects.moved_boxes(points.repeat(1, 2), at, swept=swept) + torch.cat([-half, half], 1)
        else:  # each point by its own motion, in the rows that show it
            pairs = zip(points.repeat(1, 2)[:, None], moved.tolist(), strict=True)
            ats = ((point, replace(at, displacement_px=(dx, dy))) for point, (dx, dy) in pairs)
            hulls = torch.cat([effects.moved_boxes(point, one, swept=swept) for point, one in ats])
        hulls = hulls.view(-1, 9, 4)
        return torch.cat([hulls[..., :2].amin(1), hulls[..., 2:].amax(1)], 1)

    def _at(self: Exposure[float], size: tuple[int, int] | None) -> Resolved[float]:
        """The conditions of the targets, whatever the light and the flow."""
        x, y = (speed * self.exposure_s for speed in self.of_targets().velocity_px_s)
        paths: Any = (self.trajectory,) if self.trajectory else ()
        numbers = self.exposure_s, float(self.temperature_c), math.nan, (x, y)
        return Resolved(self.camera, *numbers, size=size, trajectories=paths)


def _same(one: Any, other: Any) -> bool:
    """Whether two values of a field are equal, tensors in it included."""
    if one is other:  # also where it is NaN
        return True
    if isinstance(one, Tensor) or isinstance(other, Tensor):
        tensors = isinstance(one, Tensor) and isinstance(other, Tensor) and one.device == other.device
        return tensors and torch.equal(one, other)
    if isinstance(one, list | tuple) and type(one) is type(other):
        return len(one) == len(other) and all(map(_same, one, other))
    return bool(one == other)


def _column(name: str, value: Any, batch: int) -> list[Any]:
    """A field's value for each frame of a batch."""
    values = value.detach().flatten().tolist() if isinstance(value, Tensor) else value
    if isinstance(value, Tensor) and len(values) == 1:
        return values * batch
    if not isinstance(values, list | tuple):
        return [values] * batch
    if len(values) != batch:
        raise ValueError(f"{name}: got {len(values)} for a batch of {batch}; must be one per picture")
    return list(values)
