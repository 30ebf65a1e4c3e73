"""The state of the explorer, the query of a URL or a command that names it, and the controls that move it.

Controls follow from the tables of axes and figures: a new entry of these is a new slider.

Domain: conditions in SI units, as on the axes; texts hold the numbers of the command line's options. A state is made
of such numbers alone, so that a URL, a command and a script give the same bits.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Any
from urllib.parse import parse_qsl, urlencode

from blurnoise._core.checks import LIMITS, integer
from blurnoise._core.rng import LAST_SEED
from blurnoise.camera import Camera
from blurnoise.camera import figures as camera_figures
from blurnoise_eval.grid import axes
from blurnoise_eval.grid.axes import AUTOMATIC, EGO, GAIN, MOVES, VELOCITY, Axis, number
from blurnoise_eval.grid.conditions import Conditions

BUILT_IN, NO_MODEL, GIVEN, OF_RUN = "built-in", "none", "given", "run"
"""Names: of the built-in detector, no detector, what the command names by its file, and the camera of the run that is
explored, whose pictures and models are run/NAME."""
_NAMES = ("picture", "camera", "model", "cell")


def start() -> Conditions:
    """Dusk, some motion, gain as the camera sets it."""
    return Conditions(exposure_s=0.02, illuminance_lux=2.0, velocity_x_px_s=1000.0, gain_db=AUTOMATIC)


@dataclass(frozen=True)
class State:
    """What is shown.

    picture, camera, model: by the names that the explorer has for them; sign-1, sign-2, ... are rendered stop signs.
    at: the conditions. figures: of the camera, in place of its own, by the field's name. seed: of the noise. cell:
    the run's cell that this is. Raises ``ValueError`` that names the part.
    """

    picture: str = "sign-1"
    camera: str = "imx250"
    model: str = BUILT_IN
    at: Conditions = field(default_factory=start)
    figures: tuple[tuple[str, float], ...] = ()
    seed: int = 0
    cell: str = ""

    def __post_init__(self) -> None:
        integer("seed", self.seed, 0, LAST_SEED)
        for each in axes.AXES:
            if (value := self.at[each.name]) is not None:
                each.checked((value,))

    def put(self, name: str, value: float | None) -> State:
        """With another value on an axis, None: its camera's, or another figure of the camera; what excludes it is
        reset."""
        if value is not None and name not in self.at:
            figures = {**dict(self.figures), name: value}
            return replace(self, figures=tuple(sorted(figures.items())), cell="")
        values = {**self.at, name: value}
        if name == EGO.name and value:
            values |= {**dict.fromkeys(VELOCITY, 0.0), MOVES.name: None}
        elif name in (*VELOCITY, MOVES.name) and value:
            values[EGO.name] = None
        return replace(self, at=Conditions(**values), cell="")

    def query(self, base: State) -> str:
        """Behind the question mark of a URL: every condition that is specified, and what else differs from
        ``base``; of a run's cell its id."""
        parts = [
            (key(each), "own" if value is None else option_text(each, value))
            for each in axes.AXES
            if (value := self.at[each.name]) is not None or base.at[each.name] is not None
        ]
        parts += [(name, repr(value)) for name, value in self.figures]
        parts += [("seed", str(self.seed))] if self.seed != base.seed else []
        names = [name for name in _NAMES if getattr(self, name) != getattr(base, name)]
        if self.cell:
            parts, names = [], [name for name in names if name not in ("picture", "camera")]
        return urlencode([*parts, *((name, getattr(self, name)) for name in names)])

    @classmethod
    def of_query(cls, text: str, base: State) -> State:
        """The state of a :meth:`query`. Raises ``ValueError`` that names the part that is not allowed."""
        state, parts = base, parse_qsl(text, keep_blank_values=True)
        conditions, figures = ({key(each): each for each in table} for table in (axes.AXES, FIGURES))
        for name, part in parts:
            try:
                if axis := conditions.get(name):
                    own = part == "own" and axes.CORE.get(axis.name, 0.0) is not None
                    value = None if own else of_text(axis, part)
                    state = replace(state, at=Conditions(**{**state.at, axis.name: value}))
                elif name in figures:
                    state = replace(state.put(name, of_text(figures[name], part)), cell=state.cell)
                elif name == "seed":
                    state = replace(state, seed=int(part))
                elif name in _NAMES:
                    state = replace(state, **{name: part})  # type: ignore[arg-type]  # names are texts
                else:
                    known = (*_NAMES, "seed", *conditions, *figures)
                    raise ValueError(f"must be one of {', '.join(known)}")
            except ValueError as error:
                raise ValueError(f"{name} = {part[:60]!r}: {error}") from None
        if state.cell and (others := dict(parts).keys() - {"cell", "model"}):
            raise ValueError(
                f"cell: has its own picture, camera and conditions; remove {', '.join(sorted(others))}"
            )
        if state.at[EGO.name] and not {"dx", "dy"} & dict(parts).keys():
            state = state.put(EGO.name, state.at[EGO.name])
        return state


def with_figures(camera: Camera, figures: Iterable[tuple[str, float]]) -> Camera:
    """``camera`` with these figures in place of its own; a line time makes a global shutter roll."""
    own: dict[str, Any] = dict(figures)
    if "row_time_s" in own and (camera.sensor.shutter == "global") == bool(own["row_time_s"]):
        own["shutter"] = "rolling" if own["row_time_s"] else "global"
    return camera.with_figures(**own)


def key(axis: Axis) -> str:
    """An axis's name in a query: its option's."""
    return axis.option.lstrip("-")


def option_text(axis: Axis, value: float) -> str:
    """A value as its option is typed: the shortest text that gives its bits, or the nearest where none does."""
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


def _axis_of(figure: camera_figures.CameraFigure) -> Axis:
    """A figure of the camera, as if it were an axis."""
    name, title, unit, span = figure
    low, high, _ = LIMITS[name]
    return Axis(
        name, f"camera.{name}", name, "", title, unit, 1.0, low, high, f"{{}} {unit}", "{}",
        own=lambda camera: float(camera.figure(name)), span=span,
    )  # fmt: skip


FIGURES: tuple[Axis, ...] = tuple(map(_axis_of, camera_figures.FIGURES))
STEPS = 200


@dataclass(frozen=True)
class Control:
    """A slider from low to high, in the unit of its axis, which is one of a sweep or a figure of the camera.
    logarithmic: how positions run from 0 to ``steps``."""

    axis: Axis
    low: float
    high: float
    logarithmic: bool
    steps: int

    def read(self, state: State, camera: Camera) -> float:
        """The value with a camera, which is that of the state, own figures included."""
        value = state.at.get(self.axis.name)
        value = self.axis.own(camera) if value is None else value
        return value if value == AUTOMATIC else self.axis.shown(value)

    def put(self, state: State, text: str) -> State:
        """The state with the value that is typed. Raises ``ValueError``."""
        try:
            return state.put(self.axis.name, of_text(self.axis, text))
        except ValueError as error:
            raise ValueError(f"{self.axis.title} = {text!r}: {error}") from None

    def text(self, value: float) -> str:
        """The value as people type it."""
        if self.axis.choices:
            return self.axis.choices[int(value)]
        return "auto" if value == AUTOMATIC else f"{value:.6g}"

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


def controls(camera: Camera) -> dict[str, Control]:
    """Every control of this camera, by name: one for each axis and figure."""
    known = {each.into for each in axes.AXES}
    others = [each for each in FIGURES if each.into not in known]
    return {each.name: _control(each, camera) for each in (*axes.AXES, *others)}


def _control(axis: Axis, camera: Camera) -> Control:
    least, most, own = map(axis.shown, (axis.low, axis.high, axis.own(camera)))
    if axis.choices:
        return Control(axis, least, most, False, len(axis.choices) - 1)
    low, high = 0.0, own * 4 if own > 0 else 1.0
    if axis.span is not None:
        low, high = axis.span
    elif axis is GAIN:
        high = camera.sensor.gain_max_db
    elif axis.logarithmic and own > 0:
        low, high = own / 10, own * 10
    low, high = max(low, least), min(max(high, 2 * own) if math.isfinite(own) else high, most)
    return Control(axis, low, high, axis.logarithmic and low > 0, STEPS)
