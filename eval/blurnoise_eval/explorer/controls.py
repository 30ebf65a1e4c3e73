"""The controls of the explorer: what can be moved, from where to where; they follow from the tables of axes, light
effects and sensor stages, so that a new entry of these is a new slider.

Unit: of the axis's option; positions run from 0 to ``STEPS``, evenly in the logarithm where the axis is logarithmic.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields

from blurnoise._core.checks import LIMITS
from blurnoise.light import effects
from blurnoise.light.effect import LightEffect
from blurnoise.optics.camera import Camera
from blurnoise.sensor import stages
from blurnoise.sensor.stage import SensorStage
from blurnoise_eval.explorer.state import State, of_number
from blurnoise_eval.grid import axes
from blurnoise_eval.grid.axes import AUTOMATIC, VELOCITY, Axis

STEPS = 200
_USUAL: Mapping[str, tuple[float, float]] = {
    "temperature_c": (-40.0, 105.0),
    "f_number": (1.0, 16.0),
    "defocus_radius_px": (0.0, 8.0),
    "ego_speed_m_s": (0.0, 200.0),
    "speed": (0.0, 3000.0),
    "row_time_s": (0.0, 100e-6),
    "diffraction_wavelength_um": (0.0, 1.0),
    "prnu": (0.0, 0.05),
    "dsnu_e": (0.0, 50.0),
    "read_noise_e": (0.0, 50.0),
    "dark_current_e_s": (0.0, 1000.0),
}
"""From where to where one looks, in the slider's unit; what is not here gets a span from its table's entry."""


@dataclass(frozen=True)
class Control:
    """Something to move. low, high: in its unit. read: where it stands, put: the state with another value; the
    camera is
    that of the state, own figures included. choices: of a control of names. automatic: it may be left to the camera.
    group: under which heading it stands."""

    name: str
    title: str
    unit: str
    low: float
    high: float
    read: Callable[[State, Camera], float]
    put: Callable[[State, float], State]
    logarithmic: bool = False
    choices: tuple[str, ...] = ()
    automatic: bool = False
    group: str = "Conditions"
    short: str = ""

    def value(self, position: float) -> float:
        """At a position, rounded to three digits, as nobody sets more by hand."""
        share = min(1.0, max(0.0, position / STEPS))
        if self.logarithmic:
            return _rounded(math.exp(math.log(self.low) + share * math.log(self.high / self.low)))
        whole = self.low + share * (self.high - self.low)
        step = (self.high - self.low) / STEPS
        digits = max(0, 1 - math.floor(math.log10(step)))
        return round(whole, digits)

    def position(self, value: float) -> float:
        """Of a value, at the nearest end if it lies beyond."""
        if self.logarithmic:
            span = math.log(self.high / self.low)
            return STEPS * min(1.0, max(0.0, math.log(max(value, self.low) / self.low) / span))
        return STEPS * min(1.0, max(0.0, (value - self.low) / (self.high - self.low)))

    def stops(self, count: int) -> list[float]:
        """So many values from end to end, or every choice."""
        if self.choices:
            return [float(place) for place in range(len(self.choices))]
        return list(dict.fromkeys(self.value(STEPS * place / (count - 1)) for place in range(count)))

    def text(self, value: float) -> str:
        """The value with its unit, as people read it."""
        if value == AUTOMATIC:
            return "auto"
        if self.choices:
            return self.choices[int(value)]
        return f"{value:.4g} {self.unit}".rstrip()


def controls(camera: Camera) -> tuple[Control, ...]:
    """Every control before this camera: one for each axis, but speed and direction for the two of motion; then the
    camera's figures that effects and stages depend on."""
    made: list[Control] = []
    for each in axes.AXES:
        if each.name == VELOCITY[0]:
            made += _motion()
        elif each.name not in VELOCITY:
            made.append(_of_axis(each, camera))
    of_axes = {each.into.partition(".")[2] for each in axes.AXES if each.into.startswith("camera.")}
    numbers = {each.name for each in fields(Camera) if isinstance(getattr(camera, each.name), float)}
    parts: tuple[LightEffect | SensorStage, ...] = (*effects.EFFECTS, *stages.STAGES)
    for entry in parts:
        for name in entry.figures:
            if name in numbers and name not in of_axes:
                of_axes.add(name)
                made.append(_of_figure(name, entry.name, camera))
    return tuple(made)


def control(name: str, camera: Camera) -> Control:
    """The control of this name. Raises ``ValueError`` that lists the names."""
    every = controls(camera)
    for each in every:
        if each.name == name:
            return each
    raise ValueError(f"along = {name!r}: must be one of {', '.join(each.name for each in every)}")


def _of_axis(axis: Axis, camera: Camera) -> Control:
    def read(state: State, camera: Camera) -> float:
        value = state.at[axis.name]
        if value is None:
            value = axis.own(camera)
        return value if value == AUTOMATIC or axis.choices else axis.shown(value)

    def put(state: State, value: float) -> State:
        whole = value == AUTOMATIC or axis.choices
        return state.put(axis.name, value if whole else of_number(axis, value))

    low, high = (0.0, len(axis.choices) - 1.0) if axis.choices else _span(axis, camera)
    return Control(
        axis.name,
        axis.title,
        axis.unit,
        low,
        high,
        read,
        put,
        axis.logarithmic and low > 0,
        axis.choices,
        axis.automatic,
        short=axis.option.lstrip("-"),
    )


def _span(axis: Axis, camera: Camera) -> tuple[float, float]:
    """From what a sweep tests by default, a decade to either side; else from where the camera stands."""
    least, most = axis.shown(axis.low), axis.shown(axis.high)
    tested = [axis.shown(value) for value in axis.default if value != AUTOMATIC]
    own = axis.shown(axis.own(camera))
    if axis.name == "gain_db":
        return 0.0, camera.gain_max_db
    if axis.name in _USUAL:
        low, high = _USUAL[axis.name]
    elif tested and axis.logarithmic:
        low, high = min(tested) / 10, max(tested) * 10
    elif tested and min(tested) < max(tested):
        low, high = min(tested), 2 * max(tested)
    elif math.isfinite(own) and own > 0:
        low, high = (own / 10, own * 10) if axis.logarithmic else (0.0, 4 * own)
    else:
        low, high = least, min(most, least + 100.0)
    return max(low, least), min(high, most)


def _motion() -> tuple[Control, Control]:
    """Speed and direction, in place of the two axes that they are of; to a tenth of a pixel per second."""

    def polar(state: State) -> tuple[float, float]:
        x, y = (state.at[name] or 0.0 for name in VELOCITY)
        return math.hypot(x, y), math.degrees(math.atan2(y, x)) % 360

    def moved(state: State, speed: float, direction_deg: float) -> State:
        x, y = (speed * turn(math.radians(direction_deg)) for turn in (math.cos, math.sin))
        put = state.put(VELOCITY[0], round(x, 1) + 0.0)
        return put.put(VELOCITY[1], round(y, 1) + 0.0)

    low, high = _USUAL["speed"]
    speed = Control(
        "speed",
        "Speed",
        "px/s",
        low,
        high,
        lambda state, camera: round(polar(state)[0], 1),
        lambda state, value: moved(state, value, polar(state)[1]),
        short="speed",
    )
    direction = Control(
        "direction",
        "Direction",
        "°",
        0.0,
        360.0,
        lambda state, camera: round(polar(state)[1], 1),
        lambda state, value: moved(state, polar(state)[0], value),
        short="direction",
    )
    return speed, direction


def _of_figure(name: str, of: str, camera: Camera) -> Control:
    own = float(getattr(camera, name))
    limit = LIMITS.get(name)
    low, high = _USUAL.get(name, (0.0, 4 * own if own else 1.0))
    high = max(high, 2 * own) if limit is None else min(limit.high, max(high, 2 * own))
    unit, scale = _unit(name)
    title = {"diffraction_wavelength_um": "Diffraction at", "row_time_s": "Line time"}.get(name, of)
    return Control(
        name,
        title[:1].upper() + title[1:],
        unit,
        low * scale,
        high * scale,
        lambda state, camera: float(getattr(camera, name)) * scale,
        lambda state, value: state.put_figure(name, value if scale == 1 else float(f"{value / scale:.12g}")),
        group="Camera",
        short=name,
    )


def _unit(name: str) -> tuple[str, float]:
    """The unit that a field's name ends in, and by what its numbers are shown."""
    if name.endswith("_e_s"):
        return "e-/s", 1.0
    if name.endswith("_time_s"):
        return "µs", 1e6
    for ending, unit in (
        ("_um", "µm"),
        ("_e", "e-"),
        ("_px", "px"),
        ("_s", "s"),
        ("_c", "°C"),
        ("_db", "dB"),
        ("_deg", "°"),
    ):
        if name.endswith(ending):
            return unit, 1.0
    return ("%", 100.0) if name == "prnu" else ("", 1.0)


def _rounded(value: float) -> float:
    return float(f"{value:.3g}")
