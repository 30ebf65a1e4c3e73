"""The state of the explorer, the query of a URL or a command that names it, and the controls that move it.

Controls follow from the tables of axes, light effects and sensor stages: a new entry of these is a new slider.

Domain: conditions in SI units, as on the axes; texts hold the numbers of the command line's options. A state is made
of such numbers alone, so that a URL, a command and a script give the same bits.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any
from urllib.parse import parse_qsl, urlencode

from blurnoise._core.checks import LIMITS, integer
from blurnoise._core.rng import LAST_SEED
from blurnoise.light import effects
from blurnoise.light.effect import LightEffect
from blurnoise.optics.camera import PRESETS, Camera
from blurnoise.sensor import stages
from blurnoise.sensor.stage import SensorStage
from blurnoise_eval.grid import axes
from blurnoise_eval.grid.axes import AUTOMATIC, EGO, MOVES, VELOCITY, Axis, number
from blurnoise_eval.grid.conditions import Conditions

BUILT_IN, NO_MODEL = "built-in", "none"
"""Models: the built-in detector, and none."""
GIVEN = "given"
"""The picture, camera or model whose file the command names."""
OF_RUN = "run"
"""The camera of the run that is explored; its pictures and models are run/NAME."""
_NAMES = ("picture", "camera", "model", "along", "cell")


def start() -> Conditions:
    """Where one begins: dusk, some motion, gain as the camera sets it."""
    return Conditions(exposure_s=0.02, illuminance_lux=2.0, velocity_x_px_s=1000.0, gain_db=AUTOMATIC)


@dataclass(frozen=True)
class State:
    """What is shown.

    picture, camera, model: by the names that the explorer has for them; sign-1, sign-2, ... are rendered stop signs.
    at: the conditions. figures: of the camera, in place of its own, by the field's name. seed: of the noise. along:
    the control along which the curve of scores runs. cell: the run's cell that this is. Raises ``ValueError`` that
    names the part.
    """

    picture: str = "sign-1"
    camera: str = "imx250"
    model: str = BUILT_IN
    at: Conditions = field(default_factory=start)
    figures: tuple[tuple[str, float], ...] = ()
    seed: int = 0
    along: str = "exposure_s"
    cell: str = ""

    def __post_init__(self) -> None:
        integer("seed", self.seed, 0, LAST_SEED)
        for each in axes.AXES:
            if (value := self.at[each.name]) is not None:
                each.checked((value,))

    def put(self, name: str, value: float | None) -> State:
        """With another value on an axis, None: its camera's; what excludes it is reset."""
        values = {**self.at, name: value}
        if name == EGO.name and value:
            values |= {**dict.fromkeys(VELOCITY, 0.0), MOVES.name: None}
        elif name in (*VELOCITY, MOVES.name) and value:
            values[EGO.name] = None
        if name == MOVES.name and not value:
            values[name] = None
        return replace(self, at=Conditions(**values), cell="")

    def put_figure(self, name: str, value: float) -> State:
        """With another figure of the camera."""
        figures = {**dict(self.figures), name: value}
        return replace(self, figures=tuple(sorted(figures.items())), cell="")

    def query(self, base: State) -> str:
        """Behind the question mark of a URL: every condition that is specified, and what else differs from
        ``base``; of a run's cell its id."""
        parts = [
            (key(each), "own" if value is None else option_text(each, value))
            for each in axes.AXES
            if (value := self.at[each.name]) is not None or base.at[each.name] is not None
        ]
        parts += [(name, f"{value!r}") for name, value in self.figures]
        parts += [("seed", str(self.seed))] if self.seed != base.seed else []
        names = [name for name in _NAMES if getattr(self, name) != getattr(base, name)]
        if self.cell:
            parts, names = [], [name for name in names if name not in ("picture", "camera")]
        return urlencode([*parts, *((name, getattr(self, name)) for name in names)])

    @classmethod
    def of_query(cls, text: str, base: State) -> tuple[State, tuple[str, ...]]:
        """The state of a :meth:`query`, and a line on each part that is not allowed, in place of which ``base``'s
        stands."""
        state, wrong, read = base, list[str](), set[str]()
        for name, value in parse_qsl(text, keep_blank_values=True):
            try:
                if name in read:
                    raise ValueError("is given twice; the first counts")
                state = state._with(name, value)
                read.add(name)
            except ValueError as error:
                wrong.append(f"{name} = {value[:60]!r}: {error}")
        if state.at[EGO.name] and not read & {key(axes.axis(name)) for name in VELOCITY}:
            state = replace(state, at=Conditions(**{**state.at, **dict.fromkeys(VELOCITY, 0.0)}))
        return state, tuple(wrong)

    def _with(self, name: str, text: str) -> State:
        """With one part of a query. Raises ``ValueError``."""
        axis = next((each for each in axes.AXES if key(each) == name), None)
        if axis is not None:
            own = text == "own" and axes.CORE.get(axis.name, 0.0) is not None
            value = None if own else of_text(axis, text)
            return replace(self, at=Conditions(**{**self.at, axis.name: value}))
        if name in _FIGURES:
            return self.put_figure(name, number(text))
        if name == "seed":
            return replace(self, seed=int(text))
        if name in _NAMES:
            return replace(self, **{name: text})  # type: ignore[arg-type]  # names are texts
        known = (*_NAMES, "seed", *map(key, axes.AXES), *_FIGURES)
        raise ValueError(f"must be one of {', '.join(known)}")


_FIGURES = tuple(
    each.name for each in fields(Camera) if type(getattr(PRESETS["imx250"], each.name)) in (int, float)
)
"""A camera's numbers."""


def with_figures(camera: Camera, figures: Iterable[tuple[str, float]]) -> Camera:
    """``camera`` with these figures in place of its own; a line time makes a global shutter roll.

    Raises ``ValueError`` for a figure that is not allowed.
    """
    own: dict[str, Any] = dict(figures)
    for name, value in own.items():
        if isinstance(getattr(camera, name), int) and float(value).is_integer():
            own[name] = int(value)
    if "row_time_s" in own and (camera.shutter == "global") == bool(own["row_time_s"]):
        own["shutter"] = "rolling" if own["row_time_s"] else "global"
    return replace(camera, **own) if own else camera


def key(axis: Axis) -> str:
    """An axis's name in a query: its option's."""
    return axis.option.lstrip("-")


def option_text(axis: Axis, value: float) -> str:
    """A value as its option is typed: the shortest text that gives its bits.

    Of a value that no text gives, which no option has made, it is the nearest.
    """
    if value == AUTOMATIC:
        return "auto"
    if axis.choices:
        return axis.choices[int(value)]
    shown = axis.shown(value)
    beside = (shown, *(math.nextafter(shown, end) for end in (-math.inf, math.inf)))
    texts = [f"{shown:.{digits}g}" for digits in (6, 12, 15)] + [repr(each) for each in beside]
    return next((text for text in texts if axis.of_option(float(text)) == value), repr(shown))


def of_text(axis: Axis, text: str) -> float:
    """The value that an option's text gives. Raises ``ValueError``."""
    if axis.choices:
        return axis.place_of(text)
    return axis.of_option(number(text, automatic=axis.automatic)) + 0.0


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
_UNITS = {"_e_s": "e-/s", "_um": "µm", "_e": "e-", "_px": "px", "_s": "s"}
"""By the end of a figure's name."""


@dataclass(frozen=True)
class Control:
    """Something to move: a condition, ``axis``, or, with none, a figure of the camera. low, high: in its unit.
    logarithmic: how positions run from 0 to ``STEPS``."""

    name: str
    title: str
    unit: str
    low: float
    high: float
    logarithmic: bool = False
    axis: Axis | None = None

    @property
    def choices(self) -> tuple[str, ...]:
        """Of a control of names."""
        return self.axis.choices if self.axis else ()

    def read(self, state: State, camera: Camera) -> float:
        """The value with a camera, which is that of the state, own figures included."""
        if self.axis is None:
            return float(getattr(camera, self.name))
        value = state.at[self.name]
        value = self.axis.own(camera) if value is None else value
        return value if value == AUTOMATIC or self.choices else self.axis.shown(value)

    def put(self, state: State, value: float | str) -> State:
        """The state with another value, a number or as it is typed. Raises ``ValueError``."""
        try:
            if self.axis is None:
                return state.put_figure(self.name, number(value))
            if isinstance(value, str):
                return state.put(self.name, of_text(self.axis, value))
        except ValueError as error:
            raise ValueError(f"{self.title} = {value!r}: {error}") from None
        whole = value == AUTOMATIC or self.axis.choices
        return state.put(self.name, value if whole else self.axis.of_option(value) + 0.0)

    @property
    def steps(self) -> int:
        """The position of the high end."""
        return len(self.choices) - 1 if self.choices else STEPS

    def value(self, position: float) -> float:
        """At a position, rounded to three digits, as nobody sets more by hand."""
        share = min(1.0, max(0.0, position / self.steps))
        if self.logarithmic:
            return float(f"{self.low * (self.high / self.low) ** share:.3g}")
        digits = max(0, 1 - math.floor(math.log10((self.high - self.low) / self.steps)))
        return round(self.low + share * (self.high - self.low), digits)

    def position(self, value: float) -> float:
        """Of a value, at the nearest end if it lies beyond."""
        value = min(self.high, max(self.low, value))
        if self.logarithmic:
            return self.steps * math.log(value / self.low) / math.log(self.high / self.low)
        return self.steps * (value - self.low) / (self.high - self.low)

    def places(self, count: int) -> list[float]:
        """So many values from end to end, or every choice."""
        count = len(self.choices) or count
        return list(dict.fromkeys(self.value(self.steps * place / (count - 1)) for place in range(count)))

    def text(self, value: float) -> str:
        """The value as people type it."""
        return "auto" if value == AUTOMATIC else self.choices[int(value)] if self.choices else f"{value:.4g}"


def controls(camera: Camera) -> dict[str, Control]:
    """Every control of this camera, by name: one for each axis, then the camera's figures that effects and stages
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
    """What a sweep tests by default, a decade to either side; else around the camera's own value."""
    least, most = axis.shown(axis.low), axis.shown(axis.high)
    tested = [axis.shown(value) for value in axis.default if value != AUTOMATIC]
    own = axis.shown(axis.own(camera))
    if axis.name == "gain_db":
        low, high = 0.0, camera.gain_max_db
    elif axis.name in _SPANS:
        low, high = _SPANS[axis.name]
    elif tested and axis.logarithmic:
        low, high = min(tested) / 10, max(tested) * 10
    elif math.isfinite(own) and own > 0:
        low, high = (own / 10, own * 10) if axis.logarithmic else (0.0, 4 * own)
    else:
        low, high = least, least + 100.0
    low, high = max(low, least), min(high, most)
    return Control(axis.name, axis.title, axis.unit, low, high, axis.logarithmic and low > 0, axis)


def _of_figure(name: str, of: str, camera: Camera) -> Control:
    own, limit = float(getattr(camera, name)), LIMITS.get(name)
    low, high = _SPANS.get(name, (0.0, 4 * own if own else 1.0))
    high = max(high, 2 * own)
    unit = next((unit for ending, unit in _UNITS.items() if name.endswith(ending)), "")
    title = "diffraction at" if name == "diffraction_wavelength_um" else of
    return Control(
        name, title[:1].upper() + title[1:], unit, low, high if limit is None else min(limit.high, high)
    )
