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
_SPANS: Mapping[str, tuple[float, float]] = {
    **dict.fromkeys(VELOCITY, (-2000.0, 2000.0)),
    "temperature_c": (-40.0, 105.0),
    "f_number": (1.0, 16.0),
    "defocus_radius_px": (0.0, 8.0),
    "ego_speed_m_s": (0.0, 200.0),
    "row_time_s": (0.0, 100e-6),
    "diffraction_wavelength_um": (0.0, 1.0),
    "prnu": (0.0, 0.05),
    "dsnu_e": (0.0, 50.0),
    "read_noise_e": (0.0, 50.0),
    "dark_current_e_s": (0.0, 1000.0),
}
"""From where to where a slider goes, in the option's or the figure's unit; others follow from the tables."""
_UNITS = {
    "_e_s": "e-/s",
    "_um": "µm",
    "_e": "e-",
    "_px": "px",
    "_s": "s",
    "_c": "°C",
    "_db": "dB",
    "_deg": "°",
}
"""By what the name of a figure ends in."""


@dataclass(frozen=True)
class Control:
    """Something to move. low, high: in its unit. read: where it stands with a camera, which is that of the state, own
    figures included; put: the state with another value. choices: of a control of names. automatic: it may be left to
    the camera. of_camera: a figure of the camera, not a condition."""

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
    of_camera: bool = False

    def value(self, position: float) -> float:
        """At a position, rounded to three digits, as nobody sets more by hand."""
        share = min(1.0, max(0.0, position / STEPS))
        if self.logarithmic:
            return float(f"{self.low * (self.high / self.low) ** share:.3g}")
        digits = max(0, 1 - math.floor(math.log10((self.high - self.low) / STEPS)))
        return round(self.low + share * (self.high - self.low), digits)

    def position(self, value: float) -> float:
        """Of a value, at the nearest end if it lies beyond."""
        if self.logarithmic:
            share = math.log(max(value, self.low) / self.low) / math.log(self.high / self.low)
        else:
            share = (value - self.low) / (self.high - self.low)
        return STEPS * min(1.0, max(0.0, share))

    def places(self, count: int) -> list[float]:
        """So many values from end to end, or every choice."""
        if self.choices:
            return [float(place) for place in range(len(self.choices))]
        return list(dict.fromkeys(self.value(STEPS * place / (count - 1)) for place in range(count)))

    def text(self, value: float) -> str:
        """The value with its unit, as people read it."""
        if value == AUTOMATIC:
            return "auto"
        return self.choices[int(value)] if self.choices else f"{value:.4g} {self.unit}".rstrip()


def controls(camera: Camera) -> dict[str, Control]:
    """Every control before this camera, by name: one for each axis, then the camera's figures that effects and stages
    depend on."""
    made = [_of_axis(each, camera) for each in axes.AXES]
    known = {each.into.partition(".")[2] for each in axes.AXES if each.into.startswith("camera.")}
    numbers = {each.name for each in fields(Camera) if isinstance(getattr(camera, each.name), float)}
    parts: tuple[LightEffect | SensorStage, ...] = (*effects.EFFECTS, *stages.STAGES)
    for part in parts:
        for name in part.figures:
            if name in numbers - known:
                known.add(name)
                made.append(_of_figure(name, part.name, camera))
    return {each.name: each for each in made}


def control(name: str, camera: Camera) -> Control:
    """The control of this name. Raises ``ValueError`` that lists the names."""
    every = controls(camera)
    if name not in every:
        raise ValueError(f"along = {name!r}: must be one of {', '.join(every)}")
    return every[name]


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
        logarithmic=axis.logarithmic and low > 0,
        choices=axis.choices,
        automatic=axis.automatic,
    )


def _span(axis: Axis, camera: Camera) -> tuple[float, float]:
    """From what a sweep tests by default, a decade to either side; else from where the camera stands."""
    least, most = axis.shown(axis.low), axis.shown(axis.high)
    tested = [axis.shown(value) for value in axis.default if value != AUTOMATIC]
    own = axis.shown(axis.own(camera))
    if axis.name == "gain_db":
        return 0.0, camera.gain_max_db
    if axis.name in _SPANS:
        low, high = _SPANS[axis.name]
    elif tested and axis.logarithmic:
        low, high = min(tested) / 10, max(tested) * 10
    elif math.isfinite(own) and own > 0:
        low, high = (own / 10, own * 10) if axis.logarithmic else (0.0, 4 * own)
    else:
        low, high = least, min(most, least + 100.0)
    return max(low, least), min(high, most)


def _of_figure(name: str, of: str, camera: Camera) -> Control:
    own, limit = float(getattr(camera, name)), LIMITS.get(name)
    low, high = _SPANS.get(name, (0.0, 4 * own if own else 1.0))
    high = max(high, 2 * own)
    unit, scale = next((unit for ending, unit in _UNITS.items() if name.endswith(ending)), ""), 1.0
    if name == "row_time_s":
        unit, scale = "µs", 1e6
    elif name == "prnu":
        unit, scale = "%", 100.0
    title = {"diffraction_wavelength_um": "diffraction at", "row_time_s": "line time"}.get(name, of)
    return Control(
        name,
        title[:1].upper() + title[1:],
        unit,
        low * scale,
        (high if limit is None else min(limit.high, high)) * scale,
        lambda state, camera: float(getattr(camera, name)) * scale,
        lambda state, value: state.put_figure(name, float(f"{value / scale:.12g}")),
        of_camera=True,
    )
