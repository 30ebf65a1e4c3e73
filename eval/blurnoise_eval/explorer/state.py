"""The state of the explorer: all that says what is seen, and the URL that says it.

Domain: conditions in SI units, as on the axes; texts have the numbers of the command line's options. A state is made
of texts' numbers only, so that a URL, a command (``told``) and a script give the same bits.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, fields, replace
from typing import Any
from urllib.parse import parse_qsl, urlencode

from blurnoise._core.checks import integer
from blurnoise._core.rng import LAST_SEED
from blurnoise.optics.camera import Camera
from blurnoise_eval.grid import axes
from blurnoise_eval.grid.axes import AUTOMATIC, EGO, MOVES, VELOCITY, Axis
from blurnoise_eval.grid.conditions import Conditions

SIGN = "sign-1"
"""The picture that is looked at first: of the rendered stop signs, counted from 1."""
BUILT_IN = "built-in"
"""The model that is looked through first; ``NO_MODEL``: none."""
NO_MODEL = "none"
OF_RUN = "run"
"""The camera of the run that is explored; its pictures and models are OF_RUN/NAME."""
_START: Mapping[str, float] = {
    "exposure_s": 0.02,
    "illuminance_lux": 2.0,
    "velocity_x_px_s": 1000.0,
    "gain_db": AUTOMATIC,
}


def start() -> Conditions:
    """Where one begins: dusk, some motion, gain as the camera sets it."""
    return Conditions(**_START)


@dataclass(frozen=True)
class State:
    """What is looked at.

    picture, camera, model: by the names that the explorer knows them by. at: the conditions. figures: of the camera,
    in place of its own, by the field's name. seed: of the noise. along: the control that the strip of scores runs
    along. cell: that of a run which this is, picture, camera, conditions and seed. Raises ``ValueError`` naming what
    is not allowed.
    """

    picture: str = SIGN
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
        """With another value on an axis, or its camera's; what does not go with it gives way."""
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

    def camera_of(self, camera: Camera) -> Camera:
        """``camera`` with the figures in place of its own; a line time makes a global shutter roll."""
        return with_figures(camera, self.figures)

    def query(self) -> str:
        """After the question mark of a URL; what stands at its default is left out."""
        usual = State()
        told = [
            (name, str(getattr(self, name))) for name in _PLAIN if getattr(self, name) != getattr(usual, name)
        ]
        for each in axes.AXES:
            if self.at[each.name] != usual.at[each.name]:
                value = self.at[each.name]
                told.append((key(each), "own" if value is None else option_text(each, value)))
        told += [("figure", f"{name}={value!r}") for name, value in self.figures]
        return urlencode(told)

    @classmethod
    def of_query(cls, text: str) -> tuple[State, tuple[str, ...]]:
        """The state of :meth:`query`, and a line on each part that is not allowed: there the usual stands."""
        state = cls()
        wrong: list[str] = []
        plain: dict[str, Any] = {}
        values: dict[str, float | None] = dict(state.at)
        figures: dict[str, float] = {}
        by_key = {key(each): each for each in axes.AXES}
        for name, told in parse_qsl(text):
            try:
                if name in by_key:
                    own = told == "own" and by_key[name].name not in _STATED
                    values[by_key[name].name] = None if own else of_text(by_key[name], told)
                elif name == "figure":
                    figures |= dict([figure(told)])
                elif name in _PLAIN:
                    value = _plain(name, told)
                    replace(state, **{name: value})  # told where it is not allowed
                    plain[name] = value
                else:
                    raise ValueError(f"must be one of {', '.join((*_PLAIN, 'figure', *by_key))}")
            except ValueError as error:
                said = str(error)
                must = said.partition(": ")[2] if said.startswith(f"{name} = ") else said
                wrong.append(f"{name} = {told[:60]!r}: {must}")
        if values[EGO.name] and all(
            values[name] == state.at[name] for name in VELOCITY
        ):  # the usual, not told
            values |= dict.fromkeys(VELOCITY, 0.0)
        made = cls(**plain, at=Conditions(**values), figures=tuple(sorted(figures.items())))
        return made, tuple(wrong)


_STATED = {name for name, usual in axes.CORE.items() if usual is None}
"""Axes on which no camera has a value of its own."""
_PLAIN: Mapping[str, Any] = {
    each.name: {"str": str, "int": int, "float": float}[str(each.type)]
    for each in fields(State)
    if str(each.type) in ("str", "int", "float")
}


def _plain(name: str, text: str) -> Any:
    kind = _PLAIN[name]
    try:
        return kind(text)
    except ValueError:
        raise ValueError(f"must be {'an integer' if kind is int else 'a number'}") from None


def with_figures(camera: Camera, figures: Iterable[tuple[str, float]]) -> Camera:
    """``camera`` with these figures in place of its own; a line time makes a global shutter roll.

    Raises ``ValueError`` for a figure that the camera does not have, or that is not allowed.
    """
    stated: dict[str, Any] = dict(figures)
    numbers = {each.name for each in fields(Camera) if isinstance(getattr(camera, each.name), (int, float))}
    for name in stated:
        if name not in numbers:
            raise ValueError(f"figure = {name!r}: must be one of {', '.join(sorted(numbers))}")
        if isinstance(getattr(camera, name), int) and float(stated[name]).is_integer():
            stated[name] = int(stated[name])
    if "row_time_s" in stated and (camera.shutter == "global") == bool(stated["row_time_s"]):
        stated["shutter"] = "rolling" if stated["row_time_s"] else "global"
    return replace(camera, **stated) if stated else camera


def key(axis: Axis) -> str:
    """An axis's name in a URL: its option's."""
    return axis.option.lstrip("-")


def figure(text: str) -> tuple[str, float]:
    """Parse "prnu=0.02". Raises ``ValueError``."""
    name, _, told = text.partition("=")
    with suppress(ValueError):
        if math.isfinite(number := float(told)):
            return name.strip(), number
    raise ValueError(f"figure = {text!r}: must be NAME=NUMBER, such as read_noise_e=12")


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
    told = [f"{shown:.{digits}g}" for digits in (6, 12, 15)] + [repr(each) for each in beside]
    return next((text for text in told if axis.of_option(float(text)) == value), repr(shown))


def of_text(axis: Axis, text: str) -> float:
    """The value that an option's text says. Raises ``ValueError``."""
    if axis.automatic and text == "auto":
        return AUTOMATIC
    if axis.choices:
        return axis.place_of(text)
    try:
        return of_number(axis, float(text))
    except ValueError:
        raise ValueError(f"must be {allowed(axis)}") from None


def of_number(axis: Axis, number: float) -> float:
    """The value that an option's number says. Raises ``ValueError`` with the option's name and what is allowed."""
    value = axis.of_option(number)
    if not axis.low <= value <= axis.high or (axis.positive and value == axis.low):
        raise ValueError(f"{key(axis)} = {number:g}: must be {allowed(axis)}")
    return value + 0.0


def allowed(axis: Axis) -> str:
    """What an option may be, in its unit."""
    low, high = axis.shown(axis.low), axis.shown(axis.high)
    unit = f" {axis.unit}" if axis.unit else ""
    text = f"{'>' if axis.positive else '>='} {low:.12g} and <= {high:.12g}{unit}"
    return f"{text}, or auto" if axis.automatic else text
