"""Ranges of conditions: what training pictures are taken under, and a draw from it for each.

Convention: draws are values in [0, 1), so that whoever draws them decides how; directions run counter-clockwise as
displayed, 0 to the right.
"""

from __future__ import annotations

import math
import warnings
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from numbers import Real
from typing import Any, Literal, TypedDict

import numpy as np
import torch
from torch import Tensor

from blurnoise._core.checks import an_instance, one_of, shown
from blurnoise._core.limits import DRAWN_FROM, LIMITS, limited
from blurnoise.motion.causes import LONGEST_SHAKE, path_duration_s, shake
from blurnoise.motion.ego import USUAL_VEHICLE, Vehicle
from blurnoise.motion.trajectory import Trajectory
from blurnoise.optics.camera import Camera
from blurnoise.optics.radiometry import electrons_per_lux_s
from blurnoise.scene.cutting import Moves
from blurnoise.scene.metering import AutoExposure
from blurnoise.scene.scene import MOVES

Range = float | Sequence[float]
"""A number that stays, or the bounds (low, high) to draw between."""
Cameras = Camera | str | Sequence[Camera | str]
Params = dict[str, Tensor]
Gain = Range | Literal["auto"] | AutoExposure
"""dB, or what auto-exposure sets for the exposure at hand."""
LONGEST_USUAL_S = 1.0
"""Beyond it an exposure is taken for one in milliseconds, and warned about."""
DRAWN = ("exposure_s", "illuminance_lux", "speed_px_s", "direction_deg", "temperature_c")
"""What every picture has a value of."""
_INSTEAD = {"white_e": "illuminance_lux", "blur_px": "speed_px_s", "ego_kmh": "speed_px_s"}
"""Ranges to the condition that follows from them, or that they are in place of."""


class Ranges(TypedDict, total=False):
    """Fields of :class:`ExposureRanges` but for the camera, as options."""

    exposure_s: Range
    illuminance_lux: Range
    speed_px_s: Range
    direction_deg: Range
    temperature_c: Range
    gain_db: Gain
    shake_px: Range
    moves: Moves | Sequence[Moves]
    white_e: Range | None
    blur_px: Range | None
    ego_kmh: Range | None
    vehicle: Vehicle


class Draws(ABC):
    """What conditions of training pictures are drawn from: :class:`ExposureRanges`, or a table of conditions.

    gain_db: what holds for all pictures whose ``Params`` have none. moves: what ``moves_index`` counts in. cameras:
    what ``camera_index`` counts in. vehicle: which drives at ``ego_kmh`` of the conditions. draws: how many uniform
    values the conditions of one picture take.
    """

    vehicle: Vehicle = USUAL_VEHICLE
    camera: Cameras
    gain_db: Gain
    moves: Moves | Sequence[Moves]

    @property
    def cameras(self) -> tuple[Camera, ...]:
        """The cameras to choose from; ``camera_index`` of the conditions counts in them."""
        return cameras_of(self.camera)

    @property
    @abstractmethod
    def draws(self) -> int:
        """How many uniform values the conditions of one picture take."""

    @abstractmethod
    def conditions(self, uniform: Tensor) -> Params:
        """The conditions at ``uniform`` (B, ``draws``), values in [0, 1): (B,) each."""

    def gain(
        self, params: Params, of: slice | list[int] = slice(None)
    ) -> Tensor | float | AutoExposure | list[float | AutoExposure]:
        """What was drawn for these pictures, or what holds for all; one of either for each picture in a list."""
        return params["gain_db"][of] if "gain_db" in params else self.gain_db  # type: ignore[return-value]

    def moving(self, params: Params, of: slice | list[int] = slice(None)) -> list[str]:
        """What the motion of these pictures is of, as drawn."""
        if "moves_index" not in params:
            return ["all"] * len(params["exposure_s"][of])
        return [self.moves[index] for index in params["moves_index"][of].tolist()]

    def arguments(self, params: Params, of: slice | list[int] = slice(None)) -> dict[str, Any]:
        """What :func:`.expose.expose_pictures` takes of these pictures' conditions."""
        cameras = [self.cameras[index] for index in params["camera_index"][of].tolist()]
        return {
            **{name: params[name][of] for name in DRAWN},
            "ego_kmh": params["ego_kmh"][of] if "ego_kmh" in params else None,
            "camera": cameras,
            "gain_db": self.gain(params, of),
            "moves": self.moving(params, of),
            "trajectory": shakes(params, cameras, of),
            "vehicle": self.vehicle,
        }


@dataclass(frozen=True)
class ExposureRanges(Draws):
    """What conditions are drawn from; each range a number or (low, high).

    camera: one or several, presets by name, each as likely as the others; kept as a tuple. exposure_s and
    illuminance_lux, from 1e-9 s and 1e-6 lux on, are log-uniform: they multiply the light, so that each doubling
    is as likely as the next, where a uniform draw would hardly ever be dark. speed_px_s >= 0, direction_deg and
    temperature_c (-273.15 to 300) are uniform, as is gain_db; "auto", or an :class:`blurnoise.AutoExposure`, sets it
    for each picture. The longest exposure at the highest speed moves 1e5 px at most. shake_px, uniform: the extent of
    a hand's shake during the exposure, beside that motion; 0: none. moves: what that motion is of in pictures with
    masks, "all", the "targets" or the "background" behind them; one or several, each as likely as the others.
    ego_kmh, uniform, in place of speed_px_s: a camera that drives over a flat road, on ``vehicle``, whose flow moves
    each place of a picture otherwise, by the focal length of its camera and its size; the picture is all that the
    camera sees. Masks tell what drives along: "all" or "background".

    Raises ``ValueError`` or ``TypeError`` naming the range, its value and what is allowed; warns of exposures of more
    than a second.
    """

    camera: Cameras = "imx250"
    exposure_s: Range = (0.001, 0.060)
    illuminance_lux: Range = (5.0, 500.0)
    speed_px_s: Range = (0.0, 1000.0)
    direction_deg: Range = (0.0, 360.0)
    temperature_c: Range = 25.0
    gain_db: Gain = 0.0
    shake_px: Range = 0.0
    moves: Moves | Sequence[Moves] = "all"
    white_e: Range | None = None
    blur_px: Range | None = None
    ego_kmh: Range | None = None
    vehicle: Vehicle = USUAL_VEHICLE

    def __post_init__(self) -> None:
        object.__setattr__(self, "camera", cameras_of(self.camera))
        object.__setattr__(self, "gain_db", _gain(self.gain_db, self.cameras))
        moves = (self.moves,) if isinstance(self.moves, str) else tuple(self.moves)
        object.__setattr__(self, "moves", tuple(one_of("moves", each, MOVES) for each in moves or ("",)))
        for name in (*DRAWN, "shake_px", *_INSTEAD):
            if name not in _INSTEAD or getattr(self, name) is not None:
                object.__setattr__(self, name, _bounds(name, getattr(self, name)))
        shortest, longest = _bounds("exposure_s", self.exposure_s)
        warn_of_milliseconds(shortest, longest)
        _, fastest = _bounds("speed_px_s", self.speed_px_s)
        for name, most in (("white_e", self._most_lux(shortest)), ("blur_px", self._most_px_s(shortest))):
            if most > LIMITS[_INSTEAD[name]].high:
                raise ValueError(
                    f"{name} = {shown(getattr(self, name))}: within {shortest:g} s they ask for {_INSTEAD[name]} = "
                    f"{most:g}; must be <= {LIMITS[_INSTEAD[name]].high:g}"
                )
        self._check_ego(longest)
        if (
            self.blur_px is None
            and self.ego_kmh is None
            and longest * fastest > LIMITS["displacement_px"].high
        ):
            raise ValueError(
                f"exposure_s, speed_px_s = {longest:g}, {fastest:g} at most: their product, the motion during the "
                f"exposure, must be <= {LIMITS['displacement_px'].high:g} px"
            )

        if self.shaken:
            for camera in self.cameras:
                if path_duration_s(camera, shortest) > LONGEST_SHAKE * shortest:
                    raise ValueError(
                        f"exposure_s = {shortest:g}: too short for a shake over the readout of {camera.name!r}"
                    )

    def _check_ego(self, longest_s: float) -> None:
        """Raise ``TypeError`` or ``ValueError`` for a vehicle that does not drive, or what goes with none."""
        check_vehicle(self.vehicle, drives=self.ego_kmh is not None)
        if self.ego_kmh is None:
            return
        _, fastest = _bounds("ego_kmh", self.ego_kmh)
        refused = {
            "blur_px": (self.blur_px is not None, "each place has a blur of its own; must be None"),
            "moves": (
                "targets" in self.moves,
                "what moves for itself drives along; must be 'all' or 'background'",
            ),
        }
        for name, (stated, why) in refused.items():
            if stated:
                raise ValueError(f"{name} = {getattr(self, name)!r}: with ego_kmh {why}")
        for camera in self.cameras:
            height, width = camera.field.size
            edges = np.array([[0, (width - 1) / 2, width - 1] * 2, [0] * 3 + [height - 1] * 3])
            flow = self.vehicle.flow_at(edges, camera, (height, width), fastest / 3.6)
            moved_px, most = float(np.abs(flow).max()) * longest_s, LIMITS["displacement_px"].high
            if not moved_px <= most:
                raise ValueError(
                    f"ego_kmh, exposure_s = {fastest:g}, {longest_s:g} at most: the motion during exposure before "
                    f"{camera.name!r}, {moved_px:.6g} px, must be <= {most:g} px"
                )

    def _most_lux(self, shortest_s: float) -> float:
        if self.white_e is None:
            return 0.0
        least_e = min(map(electrons_per_lux_s, self.cameras))
        return _bounds("white_e", self.white_e)[1] / (least_e * shortest_s) if least_e > 0 else math.inf

    def _most_px_s(self, shortest_s: float) -> float:
        return 0.0 if self.blur_px is None else _bounds("blur_px", self.blur_px)[1] / shortest_s

    @property
    def shaken(self) -> bool:
        """Whether any picture is shaken."""
        return _bounds("shake_px", self.shake_px)[1] > 0

    @property
    def draws(self) -> int:
        """How many uniform values the conditions of one picture take."""
        return len(DRAWN) + 1 + isinstance(self.gain_db, tuple) + self.shaken + (len(self.moves) > 1)

    def conditions(self, uniform: Tensor) -> Params:
        """The conditions at ``uniform`` (B, ``draws``), values in [0, 1): (B,) each, and ``camera_index``, int64.

        ``gain_db``, ``shake_px`` and ``ego_kmh`` are among them where they are drawn, and ``moves_index``, int64,
        which counts in ``moves``, unless everything moves.
        """
        shares = iter(uniform.unbind(-1))
        drawn = {name: self._drawn(self._stated(name), next(shares)) for name in DRAWN}
        index = (next(shares) * len(self.cameras)).long().clamp_max(len(self.cameras) - 1)
        exposure_s = drawn["exposure_s"]
        if self.white_e is not None:
            each_e = exposure_s.new_tensor([electrons_per_lux_s(camera) for camera in self.cameras])
            lux = drawn["illuminance_lux"] / (each_e[index] * exposure_s)
            drawn["illuminance_lux"] = lux.clamp_max(LIMITS["illuminance_lux"].high)
        if self.ego_kmh is not None:
            drawn["ego_kmh"], drawn["speed_px_s"] = drawn["speed_px_s"], torch.zeros_like(exposure_s)
        if self.blur_px is not None:
            drawn["speed_px_s"] = (drawn["speed_px_s"] / exposure_s).clamp_max(LIMITS["speed_px_s"].high)
        for name, asked in (("gain_db", isinstance(self.gain_db, tuple)), ("shake_px", self.shaken)):
            if asked:
                low, high = getattr(self, name)
                drawn[name] = (low + (high - low) * next(shares)).clamp(low, high)
        if len(self.moves) > 1:
            drawn["moves_index"] = (next(shares) * len(self.moves)).long().clamp_max(len(self.moves) - 1)
        elif self.moves != ("all",):
            drawn["moves_index"] = torch.zeros_like(index)
        return {**drawn, "camera_index": index}

    def _stated(self, condition: str) -> str:
        """The range that a condition is drawn from: its own, or what it follows from."""
        follows = (
            name for name, of in _INSTEAD.items() if of == condition and getattr(self, name) is not None
        )
        return next(follows, condition)

    def _drawn(self, name: str, share: Tensor) -> Tensor:
        low, high = _bounds(name, getattr(self, name))
        value = low * (high / low) ** share if name in DRAWN_FROM else low + (high - low) * share
        return value.clamp(low, high)

    def __str__(self) -> str:
        cameras = ", ".join(camera.name for camera in self.cameras)
        named = [
            *map(self._stated, DRAWN),
            "gain_db",
            *["shake_px"] * self.shaken,
            *["moves"] * (self.moves != ("all",)),
            *["vehicle"] * (self.ego_kmh is not None),
        ]
        return ", ".join([f"camera=({cameras})", *(f"{name}={getattr(self, name)}" for name in named)])


def warn_of_milliseconds(*exposure_s: float) -> None:
    """Warn of an exposure of more than ``LONGEST_USUAL_S``, which is likely to be in milliseconds."""
    if max(exposure_s, default=0.0) > LONGEST_USUAL_S:
        stated, meant = (
            ", ".join(f"{each * factor:g}" for each in dict.fromkeys(exposure_s)) for factor in (1, 1e-3)
        )
        warnings.warn(
            f"exposure_s = ({stated}): is in seconds; must be ({meant}) if milliseconds are meant",
            stacklevel=4,
        )


def shakes(params: Params, cameras: Sequence[Camera], of: list[int] | slice) -> list[Trajectory | None]:
    """The shakes of these pictures, each of its own noise seed; None where there is none. cameras: of each."""
    if "shake_px" not in params:
        return [None] * len(cameras)
    rows = zip(
        *(params[name][of].tolist() for name in ("noise_seed", "shake_px", "exposure_s")),
        cameras,
        strict=True,
    )
    return [
        shake(seed, extent_px, exposure_s, duration_s=path_duration_s(camera, exposure_s))
        if extent_px > 0
        else None
        for seed, extent_px, exposure_s, camera in rows
    ]


_LIMIT_OF = {"blur_px": "displacement_px"}  # 0 is no blur: roads, which have the limit of its name, need some


def _bounds(name: str, value: Range) -> tuple[float, float]:
    value = _plain(value)
    ends = (value, value) if isinstance(value, Real) else value
    if not isinstance(ends, Sequence) or isinstance(ends, str) or len(ends) != 2:
        raise TypeError(f"{name} = {shown(value)}: must be a number or (low, high)")
    first, last = (limited(name, _plain(each), _LIMIT_OF.get(name)) for each in ends)
    if first < 0 and name == "blur_px":
        raise ValueError(f"blur_px = {shown(value)}: must be >= 0")
    if first > last:
        raise ValueError(f"{name} = {shown(value)}: must be (low, high), low <= high")
    least = DRAWN_FROM.get(name, first)
    if first < least:
        above = "> 0" if first == 0 else f">= {least:g}"
        raise ValueError(f"{name} = {shown(value)}: must be {above}, as it is drawn log-uniformly")
    return first, last


def _plain(value: Any) -> Any:
    """A tensor or array of one number as that number: then a bool is one."""
    return value.item() if isinstance(value, (Tensor, np.ndarray)) and value.ndim == 0 else value


def _gain(gain_db: Gain, cameras: Sequence[Camera]) -> float | tuple[float, float] | AutoExposure:
    if isinstance(gain_db, AutoExposure):
        return gain_db
    if isinstance(gain_db, str) and gain_db == "auto":
        return AutoExposure()
    gain_db = _plain(gain_db)
    if not isinstance(gain_db, (Real, Sequence)) or isinstance(gain_db, str):
        raise TypeError(
            f"gain_db = {shown(gain_db)}: must be a number, (low, high), 'auto' or an AutoExposure"
        )
    low, high = _bounds("gain_db", gain_db)
    for camera in cameras:
        camera.at_gain(low), camera.at_gain(high)
    return low if low == high else (low, high)


def check_vehicle(vehicle: Vehicle, *, drives: bool) -> None:
    """Raise ``TypeError`` for what is no vehicle, ``ValueError`` for one that is stated and does not drive."""
    an_instance("vehicle", vehicle, Vehicle)
    if not drives and vehicle != USUAL_VEHICLE:
        raise ValueError("vehicle: goes with ego_kmh, at which it drives")


def cameras_of(camera: Cameras) -> tuple[Camera, ...]:
    """The cameras, presets opened. Raises ``TypeError`` or ``ValueError``."""
    if not isinstance(camera, (Camera, str, Sequence)):
        raise TypeError(f"camera: must be cameras or names of presets, got {type(camera).__name__}")
    given = [camera] if isinstance(camera, (Camera, str)) else list(camera)
    if not given:
        raise ValueError("camera = []: must be at least one camera")
    for each in given:
        if not isinstance(each, (Camera, str)):
            raise TypeError(f"camera: must be cameras or names of presets, got {type(each).__name__}")
    return tuple(Camera.preset(each) if isinstance(each, str) else each for each in given)
