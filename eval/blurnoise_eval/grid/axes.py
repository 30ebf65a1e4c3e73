"""The axes of a sweep, one table: options, limits, columns, file names, captions and pages follow from it.

Domain: values in SI units and the units that stand in the names; an option's numbers times ``per_option``. What
is not stated stands where the camera has it (``own``). A new axis is an entry of ``AXES``. The command line's help
is made from the table, so nothing heavy is imported above.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from blurnoise_eval.grid.values import AUTOMATIC as AUTOMATIC
from blurnoise_eval.grid.values import number, numbers

if TYPE_CHECKING:
    from blurnoise.optics.camera import Camera


@dataclass(frozen=True)
class Axis:
    """One quantity that a sweep can vary.

    name: of the column, SI unit in it. into: the field of :class:`blurnoise.Exposure` it sets, or of its camera
    ("camera.f_number"). option: of the command line, in the unit of the option, ``per_option`` of the column's
    unit each. low, high: what is allowed, in the column's unit; positive: low itself is not. own: where it stands
    when nobody states it. default: what a sweep tests if not told; empty: its own.
    auto: what the camera does where it is left to it, as ``AUTOMATIC``; empty: it cannot be. text: for captions,
    unit included; slug: for file names. logarithmic: how it is drawn. fails: more of it is worse, so a curve over
    it has a point at which it fails for good. choices: of an axis of names; its values are their places, 0, 1, ...,
    and names in options and files. without: axes whose default gives way where this one is stated.
    """

    name: str
    into: str
    option: str
    about: str
    title: str
    unit: str
    per_option: float
    low: float
    high: float
    own: Callable[[Camera], float]
    text: Callable[[float], str]
    slug: Callable[[float], str]
    positive: bool = False
    logarithmic: bool = False
    fails: bool = False
    auto: str = ""
    default: tuple[float, ...] = ()
    choices: tuple[str, ...] = ()
    without: tuple[str, ...] = ()

    @property
    def automatic(self) -> bool:
        """Whether it may be left to the camera."""
        return bool(self.auto)

    def checked(self, values: Iterable[float | str]) -> tuple[float, ...]:
        """``values`` sorted, each once; "auto" is ``AUTOMATIC`` where that is allowed, a choice may be a name.

        Raises ``ValueError`` for none, or for one outside the limits.
        """
        kept = tuple(sorted({self._one(value) for value in values}))
        if not kept:
            raise ValueError(f"{self.name}: must hold at least one value")
        if self.positive and kept[0] == self.low:
            raise ValueError(f"{self.name} = {kept[0]!r}: must be > {self.low:g}")
        return kept

    def _one(self, value: float | str) -> float:
        from blurnoise._core.checks import in_range  # late: options of the command line are made from here

        if self.automatic and value in ("auto", AUTOMATIC):
            return AUTOMATIC
        if self.choices:
            return self.place_of(value)
        return in_range(self.name, value, self.low, self.high) + 0.0  # type: ignore[arg-type]  # text is refused

    def place_of(self, choice: float | str) -> float:
        """A choice's place, by its name or as it is. Raises ``ValueError`` that lists the choices."""
        for place, name in enumerate(self.choices):
            if choice in (name, place):
                return float(place)
        raise ValueError(f"{self.name} = {choice!r}: must be one of {', '.join(self.choices)}")

    @property
    def key(self) -> str:
        """Its name in files of settings: the option's."""
        return self.option.lstrip("-").replace("-", "_")

    @property
    def default_text(self) -> str:
        """What a sweep tests unless told otherwise, as it is typed."""
        return ",".join("auto" if value == AUTOMATIC else f"{self.shown(value):g}" for value in self.default)

    def values(self, stated: float | str | Iterable[float | str]) -> tuple[float, ...]:
        """What an option or a file states, in the option's unit, as values in the column's. Raises ``ValueError``."""
        if isinstance(stated, str) and self.choices:
            return tuple(self.place_of(part.strip()) for part in stated.split(","))
        if isinstance(stated, str):
            return tuple(map(self.of_option, numbers(stated, automatic=self.automatic)))
        if isinstance(stated, (int, float)):
            return (self.of_option(number(stated, automatic=self.automatic)),)
        return tuple(value for each in stated for value in self.values(each))

    def of_option(self, value: float) -> float:
        """The option's number in the column's unit; 45 ms is the number nearest to 0.045 s, by division."""
        return value * self.per_option if self.per_option >= 1 else value / round(1 / self.per_option, 9)

    def shown(self, value: float) -> float:
        """The value in the option's unit, as axes of figures and tables have it."""
        return value / self.per_option


@dataclass(frozen=True)
class Coordinate:
    """Something to draw against that follows from the axes; ``of`` takes a row of a table."""

    name: str
    title: str
    unit: str
    of: Callable[[Mapping[str, Any]], float]
    text: Callable[[float], str]
    logarithmic: bool = False


def milliseconds(exposure_s: float, digits: int = 3) -> str:
    """'2.5': so many digits of ms, never in powers of ten."""
    import numpy as np

    return np.format_float_positional(1e3 * exposure_s, digits, fractional=False, trim="-")


_MOVES = (
    "all",
    "targets",
    "background",
)  # of blurnoise.scene.scene, which would be heavy here; a test compares them
_MOVE = ("all moves", "targets move", "background moves")

AXES: tuple[Axis, ...] = (
    Axis(
        "exposure_s", "exposure_s", "--exposure-ms", "exposure times, ms", "Exposure", "ms",
        1e-3, 0.0, 3600.0, own=lambda camera: math.nan, positive=True, logarithmic=True, fails=True,
        auto="as the camera sets it for each picture",
        text=lambda value: "automatic exposure" if value == AUTOMATIC else f"{milliseconds(value)} ms",
        slug=lambda value: "auto" if value == AUTOMATIC else f"{1e3 * value:g}ms",
        default=tuple(ms / 1e3 for ms in (0.03, 0.1, 0.3, 1, 3, 10, 30, 90)),
    ),
    Axis(
        "illuminance_lux", "illuminance_lux", "--lux", "light on the scene, lux", "Light", "lux", 1.0, 0.0, 1e9,
        own=lambda camera: math.nan, logarithmic=True,
        text=lambda value: f"{value:g} lux", slug=lambda value: f"{value:g}lux",
        default=(1.0, 30.0, 1000.0, 20_000.0),
    ),
    Axis(
        "velocity_x_px_s", "velocity_px_s.0", "--dx", "motion to the right, px/s", "Motion to the right", "px/s",
        1.0, -1e7, 1e7, own=lambda camera: 0.0,
        text=lambda value: f"{value:g} px/s", slug=lambda value: f"{value:g}",
        default=(0.0, 300.0, 1000.0),
    ),
    Axis(
        "velocity_y_px_s", "velocity_px_s.1", "--dy", "motion down, px/s", "Motion down", "px/s",
        1.0, -1e7, 1e7, own=lambda camera: 0.0,
        text=lambda value: f"{value:g} px/s down", slug=lambda value: f"{value:g}px_s", default=(0.0,),
    ),
    Axis(
        "temperature_c", "temperature_c", "--temperature-c", "of the sensor, degC",
        "Sensor temperature", "°C", 1.0, -273.15, 300.0, own=lambda camera: 25.0,
        text=lambda value: f"{value:g} °C", slug=lambda value: f"{value:g}C", fails=True,
    ),
    Axis(
        "f_number", "camera.f_number", "--f-number",
        "of the lens, in place of the camera's: its light, and its diffraction at 0.55 µm", "f-number", "",
        1.0, 0.5, 256.0, own=lambda camera: camera.f_number, logarithmic=True, fails=True,
        text=lambda value: f"f/{value:g}", slug=lambda value: f"f{value:g}",
    ),
    Axis(
        "defocus_radius_px", "camera.defocus_radius_px", "--defocus-px",
        "radius of the lens's disc of confusion, px, in place of the camera's", "Defocus", "px", 1.0, 0.0, 1000.0,
        own=lambda camera: camera.defocus_radius_px, fails=True,
        text=lambda value: f"defocus {value:g} px", slug=lambda value: f"defocus{value:g}px",
    ),
    Axis(
        "gain_db", "gain_db", "--gain",
        "dB, analogue as far as the camera goes, then digital", "Gain", "dB", 1.0, -120.0, 120.0,
        own=lambda camera: 0.0, auto="for each picture what brings its mean to 18 %", default=(AUTOMATIC,),
        text=lambda value: "automatic gain" if value == AUTOMATIC else f"gain {value:g} dB",
        slug=lambda value: "auto" if value == AUTOMATIC else f"{value:g}dB",
    ),
    Axis(
        "moves", "moves", "--moves",
        "by --dx and --dy: all, the targets alone, or the background of targets that are tracked",
        "Kind of motion", "", 1.0, 0.0, 2.0, own=lambda camera: 0.0,
        text=lambda value: _MOVE[int(value)], slug=lambda value: f"{_MOVES[int(value)]}-moves", choices=_MOVES,
    ),
    Axis(
        "ego_speed_m_s", "ego_speed_m_s", "--ego-kmh",
        "the camera drives over a flat road, in place of --dx and --dy: each place moves in its own way",
        "Ego-motion", "km/h", 1 / 3.6, 0.0, 100.0, own=lambda camera: 0.0, fails=True, without=("velocity_x_px_s",),
        text=lambda value: f"{3.6 * value:g} km/h", slug=lambda value: f"{3.6 * value:g}km_h",
    ),
)  # fmt: skip
NAMES: tuple[str, ...] = tuple(axis.name for axis in AXES)
VELOCITY = ("velocity_x_px_s", "velocity_y_px_s")
CORE: Mapping[str, float | None] = {
    "exposure_s": None,
    "illuminance_lux": None,
    **dict.fromkeys(VELOCITY, 0.0),
}
"""Axes on which every condition has a value of its own: what it is if nobody states it (None: it must be stated)."""
FURTHER: tuple[str, ...] = tuple(name for name in NAMES if name not in CORE)
"""The other axes: where nobody states them, they stand where the camera has them."""
CHOICES: Mapping[str, tuple[str, ...]] = {axis.name: axis.choices for axis in AXES if axis.choices}
"""The axes of names."""
SETTING: tuple[str, ...] = tuple(name for name in NAMES if name not in ("exposure_s", *VELOCITY))
"""Axes that stay the same over a surface of exposures and velocities."""


def axis(name: str) -> Axis:
    """The axis of this name. Raises ``ValueError`` that lists the names."""
    for each in AXES:
        if each.name == name:
            return each
    raise ValueError(f"axis = {name!r}: must be one of {', '.join(each.name for each in AXES)}")


def named(row: Mapping[str, Any]) -> dict[str, Any]:
    """A row as files have it: choices by their names."""
    return {**row, **{name: CHOICES[name][int(row[name])] for name in CHOICES if row.get(name) is not None}}


def setting_of(row: Mapping[str, Any]) -> tuple[float, ...]:
    """A row's values on the axes of ``SETTING``, in their order."""
    return tuple(row[name] for name in SETTING)


def velocity_of(row: Mapping[str, Any]) -> tuple[float, float]:
    """(x, y) px/s of a row."""
    return row["velocity_x_px_s"], row["velocity_y_px_s"]


def speed_px_s(row: Mapping[str, Any]) -> float:
    """Length of a row's velocity, px/s."""
    return math.hypot(row["velocity_x_px_s"], row["velocity_y_px_s"])


def blur_px(row: Mapping[str, Any]) -> float:
    """Length of a row's motion during the exposure, px; 0 of a camera that drives, before which places differ."""
    import numpy as np

    return float(np.hypot(row["velocity_x_px_s"], row["velocity_y_px_s"]) * row["exposure_s"])


BLUR = Coordinate("blur_px", "Motion blur", "px", blur_px, lambda value: f"blur {value:.3g} px", True)
SPEED = Coordinate("speed_px_s", "Speed", "px/s", speed_px_s, lambda value: f"{value:g} px/s")


def velocity_text(velocity_px_s: tuple[float, float]) -> str:
    """'400 px/s' for motion to the right, '(300, -400) px/s' for any other direction."""
    x, y = velocity_px_s
    return f"{x:g} px/s" if y == 0 and x >= 0 else f"({x:g}, {y:g}) px/s"


EXPOSURE, LIGHT, GAIN, MOVES, EGO = map(
    axis, ("exposure_s", "illuminance_lux", "gain_db", "moves", "ego_speed_m_s")
)
EGO_SPEED = Coordinate(
    EGO.name, "Speed", EGO.unit, lambda row: EGO.shown(row[EGO.name]), lambda value: f"{value:g} km/h"
)
SETTING_AXES: tuple[Axis, ...] = tuple(map(axis, SETTING))
