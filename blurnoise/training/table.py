"""Table of conditions to draw from: those of a deployment, as a sweep's folder or a grid has them.

Convention: speeds px/s, directions counter-clockwise as displayed. Rows are equally likely. Exposure, light and speed
are drawn between a row's value and the middles to its neighbours among all rows (in the logarithm for exposure and
light), none beyond a grid's ends; a row at rest stays at rest. All else is the row's; a gain of None is automatic.
Of a run the rows are those that its camera would use: at each light and motion the exposures that the run recommends,
or the best where none works, and none that saturates more than a tenth of the picture while another does not.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from os import PathLike
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
import torch
from torch import Tensor

from blurnoise._core.checks import LIMITS, integer, limited, one_of, shown
from blurnoise._core.files import json_of
from blurnoise.camera import Camera
from blurnoise.camera.colour import PictureTone, picture_tone
from blurnoise.scene.exposure import MOVES, Moves
from blurnoise.scene.metering import USUAL, AutoExposure
from blurnoise.training import ranges
from blurnoise.training.ranges import DRAWN, Cameras, Params, Range

FILE = "conditions.json"
"""In a sweep's folder: its cameras, and the conditions that it has met."""
_MOST_SATURATED = 0.1  # mean share of values at a limit of the sensor; beyond, a run's condition is left out
_SPREAD = ("exposure_s", "illuminance_lux", "speed_px_s")
_TINY = 1e-30
_NOT_DRAWN = ("trajectory", "ego", "speeds", "grey_anchor", "lamps", "hdr_white")


class Condition(NamedTuple):
    """One row: the conditions of a picture. camera: of the table's; gain_db: None where the camera sets it.

    most_lux_s: exposure times light of draws about it is at most this, as far as the row's neighbours leave it.
    """

    exposure_s: float
    illuminance_lux: float
    speed_px_s: float = 0.0
    direction_deg: float = 0.0
    temperature_c: float = 25.0
    gain_db: float | None = 0.0
    moves: str = "all"
    camera: int = 0
    most_lux_s: float = math.inf


@dataclass(frozen=True)
class ExposureTable(ranges.Draws):
    """A table of equally likely conditions, and the cameras to which they refer by number.

    gain_db: the auto-exposure for rows without a gain. direction_deg: range to draw the direction from; None: the
    direction of each row. encoding: the tone curve of the pictures. Raises ``ValueError`` for an empty table and for
    a row outside the limits.
    """

    camera: Cameras
    rows: tuple[Condition, ...]
    gain_db: ranges.Gain = USUAL
    direction_deg: Range | None = None
    encoding: PictureTone = "srgb"

    def __post_init__(self) -> None:
        vars(self).update(camera=ranges.cameras_of(self.camera), rows=tuple(self.rows))
        if not self.rows:
            raise ValueError("conditions = []: must be at least one")
        for row in self.rows:
            for name in DRAWN:
                limited(name, getattr(row, name))
            limited("displacement_px", row.exposure_s * row.speed_px_s)
            one_of("moves", row.moves, MOVES)
            integer("camera", row.camera, 0, len(self.cameras) - 1)
            if row.gain_db is not None:
                self.cameras[row.camera].at_gain(row.gain_db)
        if self.direction_deg is not None:
            vars(self).update(direction_deg=ranges.bounds("direction_deg", self.direction_deg))

    @classmethod
    def of_run(cls, run: Any, *, direction_deg: Range | None = None) -> ExposureTable:
        """The table of a finished sweep, from the file ``conditions.json`` in its folder.

        run: the path of the folder, or ``blurnoise_eval.system.urls.location(URL)``.
        Raises ``ValueError`` for a folder without the file, and for conditions that training does not support:
        trajectories, driving cameras, grey anchors and automatic exposure times.
        """
        path = (Path(run) if isinstance(run, (str, PathLike)) else run) / FILE
        if not path.is_file():
            must = "must be a finished sweep's folder, or location(URL) of blurnoise_eval.system.urls"
            raise ValueError(f"run = {str(run)!r}: holds no {FILE}; {must}")
        try:
            held = json_of(path.read_text(encoding="utf-8"))
            refused = [name for name in _NOT_DRAWN if held.get(name)]
            if any(row["exposure_s"] == "auto" for row in held["conditions"]):
                refused.append("exposures that its camera sets")
            if not refused:
                cameras = tuple(Camera.from_dict(each) for each in held["cameras"])
                auto = AutoExposure(**held["auto_exposure"]) if held.get("auto_exposure") else USUAL
                tone = picture_tone(held.get("picture_tone") or "srgb", "picture_tone")
                return cls(cameras, tuple(_used(held["conditions"])), auto, direction_deg, tone)
        except (KeyError, TypeError, AttributeError, OverflowError, ValueError) as error:
            raise ValueError(f"run = {str(path)!r}: is no table of conditions ({error})") from None
        raise ValueError(f"run = {str(run)!r}: has {refused[0]}; not supported in training")

    @classmethod
    def of_grid(
        cls,
        camera: Cameras,
        *,
        exposure_s: Sequence[float],
        illuminance_lux: Sequence[float],
        speed_px_s: Sequence[float] = (0.0,),
        direction_deg: Range | None = (0.0, 360.0),
        temperature_c: Sequence[float] = (25.0,),
        gain_db: Sequence[float | Literal["auto"]] | Literal["auto"] | AutoExposure = (0.0,),
        moves: Sequence[Moves] = ("all",),
    ) -> ExposureTable:
        """Every combination of these values. Raises as the class does, ``TypeError`` for a non-sequence."""
        auto = gain_db if isinstance(gain_db, AutoExposure) else USUAL
        gains: Any = ("auto",) if gain_db == "auto" or gain_db is auto else gain_db
        values = {"exposure_s": exposure_s, "illuminance_lux": illuminance_lux, "speed_px_s": speed_px_s}
        lists = {**values, "temperature_c": temperature_c, "gain_db": gains, "moves": moves}
        for name, given in lists.items():
            if isinstance(given, str) or not isinstance(given, Iterable):
                must = f"must be a sequence of values, such as [{shown(given)}]"
                raise TypeError(f"{name} = {shown(given)}: {must}")
        ranges.warn_of_milliseconds(*exposure_s)
        lists["gain_db"] = [None if gain == "auto" else gain for gain in gains]
        lists["camera"] = range(len(ranges.cameras_of(camera)))
        rows = (Condition(**dict(zip(lists, each, strict=True))) for each in product(*lists.values()))
        return cls(camera, tuple(rows), auto, direction_deg)

    @cached_property
    def moves(self) -> tuple[str, ...]:  # type: ignore[override]
        """The entries of ``MOVES`` that occur in the rows, each once."""
        return tuple(dict.fromkeys(row.moves for row in self.rows))

    @property
    def draws(self) -> int:
        """As of all :class:`Draws`."""
        return 1 + len(_SPREAD) + (self.direction_deg is not None)

    def conditions(self, uniform: Tensor) -> Params:
        """As of all :class:`Draws`."""
        shares = iter(uniform.unbind(-1))
        # in double precision: a thousand rows leave single precision few places
        row = ranges.chosen(next(shares).double(), len(self.rows)).cpu()
        taken = {
            name: column[row].to(uniform if column.is_floating_point() else uniform.device)
            for name, column in self._columns.items()
        }
        most, least = taken.pop("most_lux_s"), {}
        for name in _SPREAD:
            low, high = taken.pop(f"least {name}"), taken.pop(f"most {name}")
            share = next(shares)
            ratio = (high / low.clamp_min(_TINY)) ** share
            in_logarithm = (low > 0) & (name != "speed_px_s")
            value = torch.where(in_logarithm, low * ratio, low + (high - low) * share)
            taken[name], least[name] = value.clamp(low, high), low
        exposure, light = taken["exposure_s"], taken["illuminance_lux"]
        exposure = torch.minimum(exposure, most / light.clamp_min(_TINY)).clamp_min(least["exposure_s"])
        light = torch.minimum(light, most / exposure.clamp_min(_TINY)).clamp_min(least["illuminance_lux"])
        fastest = LIMITS["displacement_px"].high / exposure.clamp_min(_TINY)  # a row's own is within it
        taken |= {"exposure_s": exposure, "illuminance_lux": light}
        taken["speed_px_s"] = torch.minimum(taken["speed_px_s"], fastest * (1 - 1e-6))
        if self.direction_deg is not None:
            first, last = self.direction_deg  # type: ignore[misc]
            taken["direction_deg"] = first + (last - first) * next(shares)
        return taken

    @cached_property
    def _columns(self) -> dict[str, Tensor]:
        """Quantities by row, (rows,) each: numbers in float64, indices, and whether the gain is the camera's."""
        held = dict(zip(Condition._fields, map(np.array, zip(*self.rows, strict=True)), strict=True))
        found = {name: held[name] for name in ("direction_deg", "temperature_c", "most_lux_s")}
        for name in _SPREAD:
            known, index = np.unique(held[name], return_inverse=True)
            low, high = known[:-1], known[1:]
            in_logarithm = (low > 0) & (name != "speed_px_s")
            middles = np.where(in_logarithm, np.sqrt(low * high), (low + high) / 2)
            highs = np.append(middles, known[-1])
            if name == "speed_px_s":
                highs[known == 0] = 0.0
            found |= {f"least {name}": np.append(known[0], middles)[index], f"most {name}": highs[index]}
        auto = np.array([row.gain_db is None for row in self.rows])
        if not auto.all():
            found["gain_db"] = np.where(auto, 0.0, held["gain_db"])
        columns = {name: torch.from_numpy(values.astype(np.float64)) for name, values in found.items()}
        columns["camera_index"] = torch.from_numpy(held["camera"])
        if auto.any() and not auto.all():
            columns["gain_auto"] = torch.from_numpy(auto)
        if self.moves != ("all",):
            columns["moves_index"] = torch.tensor([self.moves.index(each) for each in held["moves"]])
        return columns

    def __str__(self) -> str:
        cameras = ", ".join(camera.name for camera in self.cameras)
        columns = {name: [getattr(row, name) for row in self.rows] for name in _SPREAD}
        spans = (f"{name}=({min(values):g}, {max(values):g})" for name, values in columns.items())
        return f"{len(self.rows)} conditions, camera=({cameras}), {', '.join(spans)}"


def _used(held: Sequence[Mapping[str, Any]]) -> list[Condition]:
    """The rows of a run that its camera would use; all rows if the run has neither shares nor answers."""
    met = [(_row(each), each.get("saturated") or 0.0, bool(each.get("recommended"))) for each in held]
    least: dict[Condition, float] = {}  # saturated, of a setting at any exposure
    most_lux_s: dict[tuple[int, float | None], float] = {}  # of a camera and gain, without saturation
    for row, saturated, _ in met:
        setting, reader = row._replace(exposure_s=0.0), (row.camera, row.gain_db)
        least[setting] = min(least.get(setting, 1.0), saturated)
        light = row.exposure_s * row.illuminance_lux * (saturated <= _MOST_SATURATED)
        most_lux_s[reader] = max(most_lux_s.get(reader, 0.0), light)
    fit = [
        (row, recommended)
        for row, saturated, recommended in met
        if saturated <= max(_MOST_SATURATED, least[row._replace(exposure_s=0.0)])
    ]
    answered = {row._replace(exposure_s=0.0) for row, recommended in fit if recommended}
    return [
        row._replace(
            most_lux_s=max(most_lux_s[row.camera, row.gain_db], row.exposure_s * row.illuminance_lux)
        )
        for row, recommended in fit
        if recommended or row._replace(exposure_s=0.0) not in answered
    ]


def _row(held: Mapping[str, Any]) -> Condition:
    """A condition of a run's file: velocities x right and y down."""
    x, y = float(held.get("velocity_x_px_s", 0.0)), float(held.get("velocity_y_px_s", 0.0))
    gain = held.get("gain_db", 0.0)
    return Condition(
        exposure_s=float(held["exposure_s"]),
        illuminance_lux=float(held["illuminance_lux"]),
        speed_px_s=math.hypot(x, y),
        direction_deg=math.degrees(math.atan2(-y, x)) + 0.0,
        temperature_c=float(held.get("temperature_c", 25.0)),
        gain_db=None if gain == "auto" else float(gain),
        moves=str(held.get("moves", "all")),
        camera=int(held.get("camera", 0)),
    )
