"""Table of conditions to draw from: those of a deployment, as a sweep's folder or a grid has them.

Convention: speeds px/s, directions counter-clockwise as displayed. Rows are equally likely. Exposure, light and speed
are drawn between the middles to the next values in the table, in the logarithm for exposure and light, and never
beyond its first and last; a row at rest stays at rest. Everything else is the row's; a gain of None is automatic.
A run has the rows that its camera would use: at each light and motion the exposures that the run recommends, or the
best if none works, without those that saturate more than a tenth of the picture while another does not.
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
from blurnoise.camera.spectra import check_illuminant
from blurnoise.scene.exposure import MOVES, Moves
from blurnoise.scene.metering import USUAL, AutoExposure, GreyAnchor
from blurnoise.training.ranges import bounds, chosen, warn_of_milliseconds
from blurnoise.training.source import (
    BEAMS_OF,
    DRAWN,
    Cameras,
    ExposureSource,
    Gain,
    Params,
    Range,
    cameras_of,
)

FILE = "conditions.json"
"""The file of a sweep's folder with its cameras and the conditions that it tested."""
_MOST_SATURATED = 0.1  # mean share of values at a limit of the sensor with which a condition is used
_SPREAD = ("exposure_s", "illuminance_lux", "speed_px_s")
# A divisor in place of 0.
_TINY = 1e-30
_NOT_DRAWN = ("trajectory", "ego", "speeds", "lamps", "hdr_white")
"""Settings of a sweep that training does not have."""


class ConditionRow(NamedTuple):
    """One row: the conditions of a picture. camera: its number in the table; gain_db: None where the camera sets it.

    most_lux_s: upper limit of exposure times light of the draws from this row, beyond which pictures saturate.

    >>> ConditionRow(exposure_s=0.01, illuminance_lux=50.0).gain_db
    0.0
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
    illuminant: str = "D55"
    headlamp: str = "off"


@dataclass(frozen=True)
class ExposureTable(ExposureSource):
    """A table of equally likely conditions, and the cameras that its rows name by number.

    gain_db: the auto-exposure for rows without a gain. direction_deg: range to draw the direction from; None: the
    direction of each row. encoding, grey_anchor: of the pictures. Raises ``ValueError`` for an empty table and for a
    row outside the limits.

    >>> table = ExposureTable.of_grid("imx250c", exposure_s=[0.002, 0.01], illuminance_lux=[5.0, 50.0])
    >>> len(table.rows), table.draws
    (4, 5)
    """

    camera: Cameras
    rows: tuple[ConditionRow, ...]
    gain_db: Gain = USUAL
    direction_deg: Range | None = None
    encoding: PictureTone = "srgb"
    grey_anchor: str | None = None

    def __post_init__(self) -> None:
        vars(self).update(camera=cameras_of(self.camera), rows=tuple(self.rows))
        if not self.rows:
            raise ValueError("conditions = []: must be at least one")
        for row in self.rows:
            for name in DRAWN:
                limited(name, getattr(row, name))
            limited("displacement_px", row.exposure_s * row.speed_px_s)
            one_of("moves", row.moves, MOVES)
            check_illuminant(row.illuminant)
            one_of("headlamp", row.headlamp, BEAMS_OF)
            integer("camera", row.camera, 0, len(self.cameras) - 1)
            if row.gain_db is not None:
                self.cameras[row.camera].at_gain(row.gain_db)
        if self.grey_anchor is not None:
            GreyAnchor.parse(self.grey_anchor)
        if self.direction_deg is not None:
            vars(self).update(direction_deg=bounds("direction_deg", self.direction_deg))

    @classmethod
    def of_run(cls, run: Any, *, direction_deg: Range | None = None) -> ExposureTable:
        """The table of a finished sweep, from the file ``conditions.json`` in its folder.

        run: the path of the folder, or ``blurnoise_eval.system.urls.location(URL)``.
        Raises ``ValueError`` for a folder without the file, and for conditions that training does not support:
        trajectories, driving cameras, grey anchors, automatic exposure times and spectra from files. Headlamps of the
        run light the pictures that are given with ``headlamp_lux``, see :class:`blurnoise.RandomExposure`.
        """
        path = (Path(run) if isinstance(run, (str, PathLike)) else run) / FILE
        if not path.is_file():
            must = "must be a finished sweep's folder, or location(URL) of blurnoise_eval.system.urls"
            raise ValueError(f"run = {str(run)!r}: holds no {FILE}; {must}")
        try:
            document = json_of(path.read_text(encoding="utf-8"))
            refused = [name for name in _NOT_DRAWN if document.get(name)]
            if any(row["exposure_s"] == "auto" for row in document["conditions"]):
                refused.append("exposures that its camera sets")
            if any(row.get("illuminant") == "own" for row in document["conditions"]):
                refused.append("a spectrum from a file")
            if not refused:
                cameras = tuple(Camera.from_dict(camera) for camera in document["cameras"])
                auto = AutoExposure(**document["auto_exposure"]) if document.get("auto_exposure") else USUAL
                tone = picture_tone(document.get("picture_tone") or "srgb", "picture_tone")
                rows, anchor = tuple(_used(document["conditions"])), document.get("grey_anchor")
                return cls(cameras, rows, auto, direction_deg, tone, anchor)
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
        warn_of_milliseconds(*exposure_s)
        lists["gain_db"] = [None if gain == "auto" else gain for gain in gains]
        lists["camera"] = range(len(cameras_of(camera)))
        rows = (ConditionRow(**dict(zip(lists, each, strict=True))) for each in product(*lists.values()))
        return cls(camera, tuple(rows), auto, direction_deg)

    @cached_property
    def moves(self) -> tuple[str, ...]:  # type: ignore[override]
        """The entries of ``MOVES`` that occur in the rows, each once."""
        return tuple(dict.fromkeys(row.moves for row in self.rows))

    @cached_property
    def illuminants(self) -> tuple[str, ...]:  # type: ignore[override]
        """The spectra that occur in the rows, each once."""
        return tuple(dict.fromkeys(row.illuminant for row in self.rows))

    @property
    def draws(self) -> int:
        """As of all :class:`ExposureSource`."""
        return 1 + len(_SPREAD) + (self.direction_deg is not None)

    def conditions(self, uniform: Tensor) -> Params:
        """As of all :class:`ExposureSource`."""
        shares = iter(uniform.unbind(-1))
        row = chosen(next(shares).double(), len(self.rows)).cpu()  # double: tables may have many rows
        drawn = {
            name: column[row].to(uniform if column.is_floating_point() else uniform.device)
            for name, column in self._columns.items()
        }
        most, least = drawn.pop("most_lux_s"), {}
        for name in _SPREAD:
            low, high = drawn.pop(f"least {name}"), drawn.pop(f"most {name}")
            share = next(shares)
            ratio = (high / low.clamp_min(_TINY)) ** share
            in_logarithm = (low > 0) & (name != "speed_px_s")
            value = torch.where(in_logarithm, low * ratio, low + (high - low) * share)
            drawn[name], least[name] = value.clamp(low, high), low
        # The limit of a row holds for its product: what exceeds it is taken off the exposure, the rest off the light.
        exposure, light = drawn["exposure_s"], drawn["illuminance_lux"]
        exposure = torch.minimum(exposure, most / light.clamp_min(_TINY)).clamp_min(least["exposure_s"])
        light = torch.minimum(light, most / exposure.clamp_min(_TINY)).clamp_min(least["illuminance_lux"])
        # Every row is within the limit of motion; an exposure above the row's with a speed above it may not be.
        fastest = LIMITS["displacement_px"].high / exposure.clamp_min(_TINY)
        drawn |= {"exposure_s": exposure, "illuminance_lux": light}
        drawn["speed_px_s"] = torch.minimum(drawn["speed_px_s"], fastest * (1 - 1e-6))
        if self.direction_deg is not None:
            first, last = self.direction_deg  # type: ignore[misc]
            drawn["direction_deg"] = first + (last - first) * next(shares)
        return drawn

    @cached_property
    def _columns(self) -> dict[str, Tensor]:
        """Columns of the table, (rows,) each: numbers in float64, with the bounds to draw between, and indices."""
        of_rows = dict(zip(ConditionRow._fields, map(np.array, zip(*self.rows, strict=True)), strict=True))
        numbers = {name: of_rows[name] for name in ("direction_deg", "temperature_c", "most_lux_s")}
        for name in _SPREAD:
            values, index = np.unique(of_rows[name], return_inverse=True)
            low, high = values[:-1], values[1:]
            in_logarithm = (low > 0) & (name != "speed_px_s")
            middles = np.where(in_logarithm, np.sqrt(low * high), (low + high) / 2)
            highest = np.append(middles, values[-1])
            if name == "speed_px_s":
                highest[values == 0] = 0.0  # at rest, not nearly
            numbers |= {f"least {name}": np.append(values[0], middles)[index], f"most {name}": highest[index]}
        auto = np.array([row.gain_db is None for row in self.rows])
        if not auto.all():
            numbers["gain_db"] = np.where(auto, 0.0, of_rows["gain_db"])
        columns = {name: torch.from_numpy(values.astype(np.float64)) for name, values in numbers.items()}
        columns["camera_index"] = torch.from_numpy(of_rows["camera"])
        if auto.any() and not auto.all():
            columns["gain_auto"] = torch.from_numpy(auto)
        if self.moves != ("all",):
            columns["moves_index"] = torch.tensor([self.moves.index(moves) for moves in of_rows["moves"]])
        if len(self.illuminants) > 1:
            places = [self.illuminants.index(name) for name in of_rows["illuminant"]]
            columns["illuminant_index"] = torch.tensor(places)
        if any(row.headlamp != "off" for row in self.rows):
            columns["beam_index"] = torch.tensor([BEAMS_OF.index(beam) for beam in of_rows["headlamp"]])
        return columns

    def __str__(self) -> str:
        cameras = ", ".join(camera.name for camera in self.cameras)
        columns = {name: [getattr(row, name) for row in self.rows] for name in _SPREAD}
        spans = (f"{name}=({min(values):g}, {max(values):g})" for name, values in columns.items())
        return f"{len(self.rows)} conditions, camera=({cameras}), {', '.join(spans)}"


def _used(conditions: Sequence[Mapping[str, Any]]) -> list[ConditionRow]:
    """The rows of a run that its camera would use; all rows if the run has neither shares nor answers."""
    tested = [(_row(row), row.get("saturated") or 0.0, bool(row.get("recommended"))) for row in conditions]
    least: dict[ConditionRow, float] = {}  # the least saturated share at any exposure, by the rest of the row
    most_lux_s: dict[tuple[int, float | None], float] = {}  # the most without saturation, by camera and gain
    for row, saturated, _ in tested:
        setting, reader = row._replace(exposure_s=0.0), (row.camera, row.gain_db)
        least[setting] = min(least.get(setting, 1.0), saturated)
        light = row.exposure_s * row.illuminance_lux * (saturated <= _MOST_SATURATED)
        most_lux_s[reader] = max(most_lux_s.get(reader, 0.0), light)
    unsaturated = [
        (row, recommended)
        for row, saturated, recommended in tested
        if saturated <= max(_MOST_SATURATED, least[row._replace(exposure_s=0.0)])
    ]
    answered = {row._replace(exposure_s=0.0) for row, recommended in unsaturated if recommended}
    return [
        row._replace(
            most_lux_s=max(most_lux_s[row.camera, row.gain_db], row.exposure_s * row.illuminance_lux)
        )
        for row, recommended in unsaturated
        if recommended or row._replace(exposure_s=0.0) not in answered
    ]


def _row(written: Mapping[str, Any]) -> ConditionRow:
    """A condition as a run's file has it, with velocities x right and y down."""
    x, y = float(written.get("velocity_x_px_s", 0.0)), float(written.get("velocity_y_px_s", 0.0))
    gain = written.get("gain_db", 0.0)
    return ConditionRow(
        exposure_s=float(written["exposure_s"]),
        illuminance_lux=float(written["illuminance_lux"]),
        speed_px_s=math.hypot(x, y),
        direction_deg=math.degrees(math.atan2(-y, x)) + 0.0,
        temperature_c=float(written.get("temperature_c", 25.0)),
        gain_db=None if gain == "auto" else float(gain),
        moves=str(written.get("moves", "all")),
        camera=int(written.get("camera", 0)),
        illuminant=str(written.get("illuminant", "D55")),
        headlamp=str(written.get("headlamp", "off")),
    )
