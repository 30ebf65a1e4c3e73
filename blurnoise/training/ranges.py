"""Ranges of the conditions of training pictures, and the exposure that is drawn from them for each picture.

Convention: conditions follow from uniform values in [0, 1), so that each library draws these by its own generator;
directions run counter-clockwise as displayed, 0 to the right.
"""

from __future__ import annotations

import math
import warnings
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from numbers import Real
from typing import Any, Literal

import numpy as np
import torch
from torch import Tensor

from blurnoise._core import usual
from blurnoise._core.checks import DRAWN_FROM, LIMITS, an_instance, dense, limited, one_of, shown
from blurnoise.camera import Camera
from blurnoise.camera.captures import windows
from blurnoise.camera.radiometry import electrons_per_lux_s
from blurnoise.light.lamp import Pwm
from blurnoise.motion.ego import USUAL_VEHICLE, Vehicle
from blurnoise.motion.trajectory import LONGEST_SHAKE, Trajectory, path_duration_s, shake
from blurnoise.picture.fusion import amplified, readers
from blurnoise.scene.exposure import MOVES, Exposure, Moves
from blurnoise.scene.metering import AutoExposure

Range = float | Sequence[float]
"""A number, or the bounds (low, high) to draw between."""
Cameras = Camera | str | Sequence[Camera | str]
Params = dict[str, Tensor]
Gain = Range | Literal["auto"] | AutoExposure
"""dB, or what auto-exposure sets."""
Lights = Literal["all", "targets"]
_LONGEST_USUAL_S = 1.0  # a longer exposure was probably meant in milliseconds: there is a warning
DRAWN = ("exposure_s", "illuminance_lux", "speed_px_s", "direction_deg", "temperature_c")
"""Conditions that are drawn for every picture."""
LAMP = ("lamp_hz", "lamp_duty", "lamp_phase")
"""Conditions of pictures with a lamp."""
_OF_EACH = (
    *DRAWN, *LAMP, "camera_index", "gain_db", "gain_auto", "moves_index", "ego_kmh", "shake_px", "noise_seed",
)  # fmt: skip
_INSTEAD = {"white_e": "illuminance_lux", "blur_px": "speed_px_s", "ego_kmh": "speed_px_s"}
"""Ranges, and the one of these that each replaces."""


class ExposureSource(ABC):
    """A source of exposures for training pictures: :class:`ExposureRanges`, or a table of conditions.

    gain_db: of pictures for which none is drawn. vehicle: drives at the ``ego_kmh`` that are drawn. lamp_lights: what
    a pulsed lamp lights.
    """

    vehicle: Vehicle = USUAL_VEHICLE
    camera: Cameras
    gain_db: Gain
    moves: Moves | Sequence[Moves]
    lamp_lights: Lights = "all"

    @property
    def uses_masks(self) -> bool:
        """Whether masks change the pictures."""
        return self.moves != ("all",) or self.lamp_lights == "targets"

    @property
    def cameras(self) -> tuple[Camera, ...]:
        """The cameras to choose from."""
        return cameras_of(self.camera)

    @property
    @abstractmethod
    def draws(self) -> int:
        """Number of uniform values drawn for the conditions of one picture."""

    @abstractmethod
    def conditions(self, uniform: Tensor) -> Params:
        """The conditions at ``uniform`` (B, ``draws``), values in [0, 1): (B,) each.

        ``DRAWN``, and where they are drawn ``gain_db``, ``gain_auto``, ``shake_px``, ``ego_kmh``, ``lamp_hz``,
        ``lamp_duty`` and ``lamp_phase``; int64 indices of the cameras, ``camera_index``, and of moves,
        ``moves_index``.
        """

    def exposures(
        self,
        params: Params,
        items: Sequence[int] | None = None,
        seeds: Sequence[int] | None = None,
        dtype: torch.dtype = torch.float64,
    ) -> list[Exposure]:
        """The exposure of each picture, or of the pictures ``items``, under drawn conditions.

        params: those of :meth:`conditions`, and ``noise_seed`` where shakes are drawn. seeds: of the noise; 0 for
        labels, which do not depend on it. dtype: of the pictures, in which velocities are computed.
        """
        chosen = list(range(len(params["camera_index"])) if items is None else items)
        drawn = {name: value[chosen] for name, value in params.items() if name in _OF_EACH}
        drawn = {
            name: value.to(dtype) if value.is_floating_point() else value for name, value in drawn.items()
        }
        velocities = velocity_px_s(drawn["speed_px_s"], drawn["direction_deg"]).tolist()
        columns = {name: drawn[name].tolist() for name in ("exposure_s", "illuminance_lux", "temperature_c")}
        known = self.cameras
        cameras = [known[index] for index in drawn["camera_index"].tolist()]
        columns |= {
            "camera": cameras,
            "velocity_px_s": list(map(tuple, velocities)),
            "gain_db": self._gains(drawn, len(chosen)),
            "seed": list(seeds or [0] * len(chosen)),
            "trajectory": _shakes(drawn, cameras),
        }
        if "moves_index" in drawn:
            columns["moves"] = [self.moves[index] for index in drawn["moves_index"].tolist()]
        if "ego_kmh" in drawn:
            columns["ego_speed_m_s"] = (drawn["ego_kmh"] / 3.6).tolist()
            columns["vehicle"] = [self.vehicle] * len(chosen)
        if "lamp_hz" in drawn:
            columns["lamp"] = [
                Pwm(*row) for row in zip(*(drawn[name].tolist() for name in LAMP), strict=True)
            ]
        return [
            Exposure(**dict(zip(columns, values, strict=True)))
            for values in zip(*columns.values(), strict=True)
        ]

    def _gains(self, drawn: Params, count: int) -> list[float | AutoExposure]:
        """The gain of each picture: drawn, or else that of the source, a number or an auto-exposure."""
        fallback: Any = self.gain_db
        if "gain_db" not in drawn:
            return [fallback] * count
        gains = drawn["gain_db"].tolist()
        automatic = drawn["gain_auto"].tolist() if "gain_auto" in drawn else [False] * count
        return [fallback if auto else gain for auto, gain in zip(automatic, gains, strict=True)]


@dataclass(frozen=True)
class ExposureRanges(ExposureSource):
    """Ranges of conditions; each a number or (low, high). Defaults: those of sweeps, :mod:`blurnoise._core.usual`.

    camera: one or several, presets by name, equally likely. exposure_s and illuminance_lux, from 1e-9 s and 1e-6 lux
    on, are log-uniform: they multiply the light, so that each doubling is as likely as the next. speed_px_s >= 0,
    direction_deg and temperature_c (-273.15 to 300) are uniform, as is gain_db; "auto", or an
    :class:`blurnoise.AutoExposure`, sets it for each picture. The motion during an exposure is 1e5 px at most.
    shake_px, uniform: the extent of a hand's shake during the exposure, in addition to that motion. moves: the part
    of pictures with masks that moves, "all", "targets" or "background"; one or several, equally likely.

    white_e, log-uniform, in place of illuminance_lux: mean electrons of white. blur_px, uniform, in place of
    speed_px_s: length of the motion blur. ego_kmh, uniform, in place of speed_px_s: a camera that drives over a flat
    road on ``vehicle``. The flow follows from its focal length and the picture's size; the picture is the camera's
    whole field of view. Masks mark targets that drive along: moves must be "all" or "background".

    lamp_hz, lamp_duty, uniform: frequency and duty cycle of a pulsed LED lamp (:class:`blurnoise.light.lamp.Pwm`);
    each picture begins at a random phase. None: no lamp. lamp_lights: "all", or the "targets" of pictures with masks:
    then the targets are the lamps, and dark in exposures that fall between pulses.

    Raises ``ValueError`` or ``TypeError`` naming the range, its value and what is allowed; warns of exposures of more
    than a second.

    >>> ranges = ExposureRanges("imx250", exposure_s=0.01, illuminance_lux=50.0, speed_px_s=800.0, direction_deg=0.0)
    >>> (exposure,) = ranges.exposures(ranges.conditions(torch.rand(1, ranges.draws)))
    >>> exposure.velocity_px_s[0]
    800.0
    """

    camera: Cameras = usual.COLOUR
    exposure_s: Range = (min(usual.EXPOSURE_S), max(usual.EXPOSURE_S))
    illuminance_lux: Range = (min(usual.ILLUMINANCE_LUX.values()), max(usual.ILLUMINANCE_LUX.values()))
    speed_px_s: Range = (min(usual.SPEED_PX_S.values()), max(usual.SPEED_PX_S.values()))
    direction_deg: Range = (0.0, 360.0)
    temperature_c: Range = usual.TEMPERATURE_C
    gain_db: Gain = usual.GAIN
    shake_px: Range = 0.0
    moves: Moves | Sequence[Moves] = "all"
    white_e: Range | None = None
    blur_px: Range | None = None
    ego_kmh: Range | None = None
    vehicle: Vehicle = USUAL_VEHICLE
    lamp_hz: Range | None = None
    lamp_duty: Range = (0.1, 0.5)
    lamp_lights: Lights = "all"

    def __post_init__(self) -> None:
        moves = (self.moves,) if isinstance(self.moves, str) else tuple(self.moves) or ("",)
        checked: dict[str, Any] = {
            "camera": (cameras := cameras_of(self.camera)),
            "gain_db": _gain(self.gain_db, cameras),
            "moves": tuple(one_of("moves", each, MOVES) for each in moves),
        }
        for name in (*DRAWN, "shake_px", "lamp_duty", *_INSTEAD, "lamp_hz"):
            if getattr(self, name) is not None or name not in (*_INSTEAD, "lamp_hz"):
                checked[name] = bounds(name, getattr(self, name))
        vars(self).update(checked)
        check_vehicle(self.vehicle, drives=self.ego_kmh is not None)
        one_of("lamp_lights", self.lamp_lights, ("all", "targets"))
        for camera, exposure_s in product(cameras, checked["exposure_s"]):
            windows(camera.sensor.captures, exposure_s)
        warn_of_milliseconds(*checked["exposure_s"])
        if self.ego_kmh is not None and self.blur_px is not None:
            raise ValueError(f"blur_px = {self.blur_px!r}: must be None with ego_kmh, whose blur varies")
        if self.ego_kmh is not None and "targets" in self.moves:
            raise ValueError(f"moves = {self.moves!r}: must be 'all' or 'background' with ego_kmh")
        for reached in self._reached():
            limited(*reached)
        shortest, _ = checked["exposure_s"]
        for camera in cameras if "shake_px" in self._drawn else ():
            if path_duration_s(camera, shortest) > LONGEST_SHAKE * shortest:
                readout = f"a shake over the readout of {camera.name!r}"
                raise ValueError(f"exposure_s = {shortest:g}: too short for {readout}")

    def _reached(self) -> Iterator[tuple[str, float, str]]:
        """Quantities that follow from several ranges: description, largest value, and the name of its limit."""
        most = {name: vars(self)[name][1] for name in self._drawn[: len(DRAWN)]}
        shortest, longest = vars(self)["exposure_s"]
        moved, within = "the motion during the exposure in px", f"within {shortest:g} s asks for"
        if "white_e" in most:
            least_e = min(map(electrons_per_lux_s, self.cameras)) * shortest
            lux = most["white_e"] / least_e if least_e > 0 else math.inf
            yield f"white_e = {self.white_e}: {within} illuminance_lux", lux, "illuminance_lux"
        if "blur_px" in most:
            yield f"blur_px = {self.blur_px}: {within} speed_px_s", most["blur_px"] / shortest, "speed_px_s"
        elif "speed_px_s" in most:
            both = f"exposure_s, speed_px_s = {longest:g}, {most['speed_px_s']:g} at most"
            yield f"{both}: {moved}", longest * most["speed_px_s"], "displacement_px"
        else:
            both = f"ego_kmh, exposure_s = {most['ego_kmh']:g}, {longest:g} at most"
            for camera in self.cameras:
                height, width = camera.field.size
                edges = np.array([[0, (width - 1) / 2, width - 1] * 2, [0] * 3 + [height - 1] * 3])
                flow = self.vehicle.flow_at(edges, camera, (height, width), most["ego_kmh"] / 3.6)
                far = float(np.abs(flow).max()) * longest
                yield f"{both}: {moved}, before {camera.name!r},", far, "displacement_px"

    @cached_property
    def _drawn(self) -> tuple[str, ...]:
        """The quantities that are drawn for a picture: ``DRAWN``, or those in their place, and others that vary."""
        instead = {_INSTEAD[name]: name for name in _INSTEAD if vars(self)[name] is not None}
        further = {
            "camera_index": True,
            "gain_db": isinstance(self.gain_db, tuple),
            "shake_px": vars(self)["shake_px"][1] > 0,
            "moves_index": len(self.moves) > 1,
            **dict.fromkeys(LAMP, self.lamp_hz is not None),
        }
        varying = (name for name, varies in further.items() if varies)
        return (*(instead.get(name, name) for name in DRAWN), *varying)

    @property
    def draws(self) -> int:
        """As of all :class:`ExposureSource`."""
        return len(self._drawn)

    def conditions(self, uniform: Tensor) -> Params:
        """As of all :class:`ExposureSource`."""
        drawn = {}
        for name, share in zip(self._drawn, uniform.unbind(-1), strict=True):
            if name in ("camera_index", "moves_index"):
                drawn[name] = chosen(share, len(self.cameras if name == "camera_index" else self.moves))
                continue
            low, high = vars(self).get(name, (0.0, 1.0))  # the phase of a lamp has no range: it is random
            value = low * (high / low) ** share if name in DRAWN_FROM else low + (high - low) * share
            drawn[name] = value.clamp(low, high)
        exposure_s, index = drawn["exposure_s"], drawn["camera_index"]
        if "white_e" in drawn:
            per_lux_s = exposure_s.new_tensor([electrons_per_lux_s(camera) for camera in self.cameras])
            lux = drawn.pop("white_e") / (per_lux_s[index] * exposure_s)
            drawn["illuminance_lux"] = lux.clamp_max(LIMITS["illuminance_lux"].high)
        if "blur_px" in drawn:
            drawn["speed_px_s"] = (drawn.pop("blur_px") / exposure_s).clamp_max(LIMITS["speed_px_s"].high)
        if "ego_kmh" in drawn:
            drawn["speed_px_s"] = torch.zeros_like(exposure_s)
        if self.moves != ("all",):
            drawn.setdefault("moves_index", torch.zeros_like(index))
        return drawn

    def __str__(self) -> str:
        cameras = ", ".join(camera.name for camera in self.cameras)
        further = {
            "shake_px": "shake_px" in self._drawn,
            "moves": self.moves != ("all",),
            "vehicle": self.ego_kmh is not None,
            **dict.fromkeys(("lamp_hz", "lamp_duty", "lamp_lights"), self.lamp_hz is not None),
        }
        used = (name for name, uses in further.items() if uses)
        named = (*self._drawn[: len(DRAWN)], "gain_db", *used)
        return ", ".join([f"camera=({cameras})", *(f"{name}={getattr(self, name)}" for name in named)])


def chosen(share: Tensor, count: int) -> Tensor:
    """Indices (int64) below ``count``, all equally likely, from shares in [0, 1)."""
    return (share * count).long().clamp_max(count - 1)


def warn_of_milliseconds(*exposure_s: float) -> None:
    """Warn of an exposure of more than a second."""
    if max(exposure_s, default=0.0) > _LONGEST_USUAL_S:
        different = dict.fromkeys(exposure_s)
        given, meant = (", ".join(f"{seconds * factor:g}" for seconds in different) for factor in (1, 1e-3))
        text = f"exposure_s = ({given}): is in seconds; must be ({meant}) if milliseconds are meant"
        warnings.warn(text, stacklevel=4)


def velocity_px_s(speed_px_s: Tensor, direction_deg: Tensor) -> Tensor:
    """Velocities (B, 2), x right and y down, from speeds (B,) and directions (B,), counter-clockwise as displayed.

    >>> velocity_px_s(torch.tensor([100.0]), torch.tensor([90.0])).round().tolist()
    [[-0.0, -100.0]]
    """
    angle = torch.deg2rad(direction_deg)
    return torch.stack([angle.cos(), -angle.sin()], dim=-1) * speed_px_s[:, None]


def _shakes(drawn: Params, cameras: Sequence[Camera]) -> list[Trajectory | None]:
    """The shake of each picture, by its noise seed; None without shake."""
    if "shake_px" not in drawn:
        return [None] * len(cameras)
    columns = (drawn[name].tolist() for name in ("noise_seed", "shake_px", "exposure_s"))
    return [
        shake(seed, extent_px, exposure_s, duration_s=path_duration_s(camera, exposure_s))
        if extent_px
        else None
        for seed, extent_px, exposure_s, camera in zip(*columns, cameras, strict=True)
    ]


def bounds(name: str, value: Range) -> tuple[float, float]:
    """The two ends of a range. Raises ``TypeError`` or ``ValueError`` outside the limits of its name."""
    value = _plain(name, value)
    ends = (value, value) if isinstance(value, Real) else value
    if not isinstance(ends, Sequence) or isinstance(ends, str) or len(ends) != 2:
        raise TypeError(f"{name} = {shown(value)}: must be a number or (low, high)")
    # blur_px may be 0, which the limit of roads excludes
    entry = "displacement_px" if name == "blur_px" else name
    first, last = (limited(name, _plain(name, each), entry) for each in ends)
    if first < 0 and name == "blur_px":
        raise ValueError(f"blur_px = {shown(value)}: must be >= 0")
    if first > last:
        raise ValueError(f"{name} = {shown(value)}: must be (low, high), low <= high")
    least = DRAWN_FROM.get(name, first)
    if first < least:
        above = "> 0" if first == 0 else f">= {least:g}"
        raise ValueError(f"{name} = {shown(value)}: must be {above}, as it is drawn log-uniformly")
    return first, last


def _plain(name: str, value: Any) -> Any:
    """A tensor or array of one number as a number. Raises ``TypeError`` for a sparse tensor and one without data."""
    if isinstance(value, Tensor):
        dense(name, value)
    return value.item() if isinstance(value, (Tensor, np.ndarray)) and value.ndim == 0 else value


def _gain(gain_db: Gain, cameras: Sequence[Camera]) -> float | tuple[float, float] | AutoExposure:
    if isinstance(gain_db, AutoExposure) or (isinstance(gain_db, str) and gain_db == "auto"):
        for camera in cameras:
            check_captures(camera, 0.0)
        return gain_db if isinstance(gain_db, AutoExposure) else AutoExposure()
    gain_db = _plain("gain_db", gain_db)
    if not isinstance(gain_db, (Real, Sequence)) or isinstance(gain_db, str):
        must = "must be a number, (low, high), 'auto' or an AutoExposure"
        raise TypeError(f"gain_db = {shown(gain_db)}: {must}")
    low, high = bounds("gain_db", gain_db)
    for camera, each in product(cameras, (low, high)):
        check_captures(camera, each)
    return low if low == high else (low, high)


def check_captures(camera: Camera, gain_db: float) -> None:
    """Raise ``ValueError`` for a gain that the camera lacks, or at which a capture reaches less far than the last."""
    readers(amplified(camera, gain_db).camera)


def check_vehicle(vehicle: Vehicle, *, drives: bool) -> None:
    """Raise ``TypeError`` for what is no vehicle, ``ValueError`` for one that does not drive."""
    an_instance("vehicle", vehicle, Vehicle)
    if not drives and vehicle != USUAL_VEHICLE:
        raise ValueError("vehicle: needs ego_kmh, its speed")


def cameras_of(camera: Cameras) -> tuple[Camera, ...]:
    """The cameras, presets opened. Raises ``TypeError`` or ``ValueError``."""
    given = camera if isinstance(camera, Sequence) and not isinstance(camera, str) else [camera]
    for each in given:
        if not isinstance(each, (Camera, str)):
            raise TypeError(f"camera: must be cameras or names of presets, got {type(each).__name__}")
    if not given:
        raise ValueError("camera = []: must be at least one camera")
    return tuple(Camera.preset(each) if isinstance(each, str) else each for each in given)
