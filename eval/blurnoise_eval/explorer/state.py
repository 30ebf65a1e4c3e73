"""The state of the explorer: all that says what is shown, and the query of a URL or a command that says it.

Domain: conditions in SI units, as on the axes; texts hold the numbers of the command line's options. A state is made
of such numbers alone, so that a URL, a command and a script give the same bits.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, field, fields, replace
from typing import Any
from urllib.parse import parse_qsl, urlencode

from blurnoise._core.checks import integer
from blurnoise._core.rng import LAST_SEED
from blurnoise.optics.camera import PRESETS, Camera
from blurnoise_eval.grid import axes
from blurnoise_eval.grid.axes import AUTOMATIC, EGO, MOVES, VELOCITY, Axis
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
        values = {
            key(each): "own" if value is None else option_text(each, value)
            for each in axes.AXES
            if (value := self.at[each.name]) is not None or base.at[each.name] is not None
        }
        parts = [] if self.cell else list(values.items())
        parts += [(name, f"{value!r}") for name, value in self.figures if not self.cell]
        parts += [("seed", str(self.seed))] if self.seed != base.seed and not self.cell else []
        of_cell = {"picture", "camera"} if self.cell else set()
        differing = {name for name in _NAMES if getattr(self, name) != getattr(base, name)} - of_cell
        return urlencode([*parts, *((name, getattr(self, name)) for name in _NAMES if name in differing)])

    @classmethod
    def of_query(cls, text: str, base: State) -> tuple[State, tuple[str, ...]]:
        """The state of a :meth:`query`, and a line on each part that is not allowed, in place of which ``base``'s
        stands."""
        state, wrong, told, read = base, list[str](), set[str](), set[str]()
        by_key = {key(each): each for each in axes.AXES}
        for name, value in parse_qsl(text, keep_blank_values=True):
            try:
                if name in read:
                    raise ValueError("stands twice; the first counts")
                read.add(name)
                if name in by_key:
                    own = value == "own" and by_key[name].name not in _STATED
                    number = None if own else of_text(by_key[name], value)
                    state = replace(state, at=Conditions(**{**state.at, by_key[name].name: number}))
                    told.add(by_key[name].name)
                elif name in _FIGURES:
                    state = state.put_figure(name, _number(value))
                elif name == "seed":
                    state = replace(state, seed=_integer(value))
                elif name in _NAMES:
                    state = replace(state, **{name: value})  # type: ignore[arg-type]  # names are texts
                else:
                    raise ValueError(f"must be one of {', '.join((*_NAMES, 'seed', *by_key, *_FIGURES))}")
            except ValueError as error:
                message = str(error)
                allowed_text = message.partition(": ")[2] if message.startswith(f"{name} = ") else message
                wrong.append(f"{name} = {value[:60]!r}: {allowed_text}")
        if state.at[EGO.name] and not told & set(VELOCITY):  # the base's, which it excludes
            state = replace(state, at=Conditions(**{**state.at, **dict.fromkeys(VELOCITY, 0.0)}))
        return state, tuple(wrong)


_STATED = {name for name, usual in axes.CORE.items() if usual is None}
"""Axes on which no camera has a value of its own."""
_FIGURES = tuple(
    each.name
    for each in fields(Camera)
    if isinstance(value := getattr(PRESETS["imx250"], each.name), (int, float))
    and not isinstance(value, bool)
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
    """The value that an option's text says. Raises ``ValueError``."""
    if axis.automatic and text == "auto":
        return AUTOMATIC
    if axis.choices:
        return axis.place_of(text)
    try:
        return of_number(axis, float(text))
    except ValueError:
        raise ValueError(f"must be {_allowed(axis)}") from None


def of_number(axis: Axis, number: float) -> float:
    """The value that an option's number says. Raises ``ValueError`` with the option's name and what is allowed."""
    value = axis.of_option(number)
    if not axis.low <= value <= axis.high or (axis.positive and value == axis.low):
        raise ValueError(f"{key(axis)} = {number:g}: must be {_allowed(axis)}")
    return value + 0.0


def _allowed(axis: Axis) -> str:
    """What an option may be, in its unit."""
    low, high = axis.shown(axis.low), axis.shown(axis.high)
    unit = f" {axis.unit}" if axis.unit else ""
    text = f"{'>' if axis.positive else '>='} {low:.12g} and <= {high:.12g}{unit}"
    return f"{text}, or auto" if axis.automatic else text


def _number(text: str) -> float:
    with suppress(ValueError):
        if math.isfinite(number := float(text)):
            return number
    raise ValueError("must be a number")


def _integer(text: str) -> int:
    try:
        return int(text)
    except ValueError:
        raise ValueError("must be an integer") from None
