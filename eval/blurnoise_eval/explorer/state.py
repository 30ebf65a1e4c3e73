"""The state of the explorer, its text in a URL or a command, and the controls that change it.

Controls follow from the tables of axes and of camera figures: a new entry there is a new slider.

Domain: a state has conditions in SI units, as the axes do; its text has the numbers of the command's options. A text
gives the same bits on the page and on the command line.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any
from urllib.parse import parse_qsl, urlencode

from blurnoise._core.checks import integer
from blurnoise._core.rng import LAST_SEED
from blurnoise.camera import Camera
from blurnoise.camera.camera_files import FIGURES as FIGURES_OF_CAMERAS
from blurnoise.camera.figures import CameraFigure
from blurnoise.light.lights import lights_of
from blurnoise_eval.plan.axes import AXES, CHOICES, EGO, GAIN, LIGHT, LIT, MOVES, OWN_SPECTRUM, VELOCITY, Axis
from blurnoise_eval.plan.conditions import Conditions
from blurnoise_eval.plan.typed import AUTOMATIC, number

BUILT_IN, NO_MODEL, GIVEN, OF_RUN = "built-in", "none", "given", "run"
"""Names of the built-in detector, of no detector, of a file that the command names, and of the camera of a run;
pictures and models of a run are run/NAME."""
OWN = "own"
"""The text of a quantity that is left to the camera, or of a seed that is left to the picture."""
_NAMES, _NUMBERS = ("picture", "camera", "model"), ("seed", "repeat")
_STEPS = 200  # of a slider


def start() -> Conditions:
    """Conditions at dusk with some motion, in which the usual detector works, and the gain set by the camera."""
    return Conditions(exposure_s=0.005, illuminance_lux=5.0, velocity_x_px_s=1000.0, gain_db=AUTOMATIC)


@dataclass(frozen=True)
class State:
    """What the page shows: an exposure of a picture, and the detector that looks at it.

    picture, camera, model: their names in the catalogue; sign-1, sign-2, ... are rendered stop signs. at: the
    conditions. figures: values that replace figures of the camera. seed: of the noise; None: the picture's own, which
    is that of the run's cells, or 0. repeat: of the run, which sets the phase of a pulsed lamp. Raises ``ValueError``
    naming the value.
    """

    picture: str = "sign-1"
    camera: str = "imx250"
    model: str = BUILT_IN
    at: Conditions = field(default_factory=start)
    figures: tuple[tuple[str, float], ...] = ()
    seed: int | None = None
    repeat: int = 0

    def __post_init__(self) -> None:
        for name in _NUMBERS:
            integer(name, getattr(self, name) or 0, 0, LAST_SEED)
        for axis in AXES:
            if (value := self.at[axis.name]) is not None:
                axis.checked((value,))

    def put(self, name: str, value: float | None) -> State:
        """The state with another value of an axis or figure; None leaves it to the camera.

        Ego-motion and a motion of the picture exclude each other: the new one resets the other.

        >>> State().put("ego_speed_m_s", 10.0).at["velocity_x_px_s"]
        0.0
        """
        if name not in self.at:
            figures = {**dict(self.figures), name: value}
            chosen = [(key, figure) for key, figure in sorted(figures.items()) if figure is not None]
            return replace(self, figures=tuple(chosen))
        values = {**self.at, name: value}
        if name == EGO.name and value:
            values |= {**dict.fromkeys(VELOCITY, 0.0), MOVES.name: None}
        elif name in (*VELOCITY, MOVES.name) and value:
            values[EGO.name] = None
        return replace(self, at=Conditions(**values))

    def query(self, base: State) -> str:
        """The text behind the question mark of a URL: all conditions, and whatever else differs from ``base``.

        >>> State(seed=3).query(State())
        'exposure-ms=5&lux=5&dx=1000&dy=0&gain=auto&seed=3'
        """
        parts = [
            (key(axis), _own(axis) if value is None else text_of(axis, value))
            for axis in AXES
            if (value := self.at[axis.name]) is not None or base.at[axis.name] is not None
        ]
        parts += [(name, repr(value)) for name, value in self.figures]
        differing = [name for name in (*_NUMBERS, *_NAMES) if getattr(self, name) != getattr(base, name)]
        values = ((name, getattr(self, name)) for name in differing)
        return urlencode([*parts, *((name, OWN if value is None else str(value)) for name, value in values)])

    @classmethod
    def of_query(cls, text: str, base: State) -> State:
        """The state of a :meth:`query`, whose parts change ``base`` one after the other; "light" names a light.

        Raises ``ValueError`` that names the part that is not allowed.
        """
        state = base
        for name, part in parse_qsl(text, keep_blank_values=True):
            try:
                if axis := QUANTITIES.get(name):
                    state = state.put(axis.name, None if part == OWN == _own(axis) else value_of(axis, part))
                elif name == "light":
                    (light,) = lights_of([part])
                    state = state.put(LIGHT.name, light.lux)
                    for of_light in LIT:
                        state = state.put(of_light, CHOICES[of_light].choice_index(getattr(light, of_light)))
                elif name == "seed":
                    state = replace(state, seed=None if part == OWN else int(part))
                elif name == "repeat":
                    state = replace(state, repeat=int(part))
                elif name in _NAMES:
                    state = replace(state, **{name: part})  # type: ignore[arg-type]  # names are texts
                else:
                    raise ValueError(
                        f"must be one of {', '.join((*_NAMES, 'light', *_NUMBERS, *QUANTITIES))}"
                    )
            except ValueError as error:
                given = f"{name} = "  # which the message may have already
                prefix = "" if str(error).startswith(given) else f"{given}{part[:60]!r}: "
                raise ValueError(f"{prefix}{error}") from None
        return state


def with_figures(camera: Camera, figures: Iterable[tuple[str, float]]) -> Camera:
    """``camera`` with these figures; a line time makes a global shutter roll."""
    values: dict[str, Any] = dict(figures)
    if "row_time_s" in values and (camera.sensor.shutter == "global") == bool(values["row_time_s"]):
        values["shutter"] = "rolling" if values["row_time_s"] else "global"
    return camera.with_figures(**values)


def key(axis: Axis) -> str:
    """The name of an axis in a query: that of its option."""
    return axis.option.lstrip("-")


def _own(axis: Axis) -> str:
    """The text of a quantity that is left to the camera. As a spectrum "own" is that of a file, and none is D55."""
    return "D55" if OWN_SPECTRUM in axis.choices else OWN


def text_of(axis: Axis, value: float) -> str:
    """A value as its option is typed: the shortest text that gives its bits, or the nearest where none does.

    >>> text_of(AXES[0], 0.0123), text_of(GAIN, AUTOMATIC)
    ('12.3', 'auto')
    """
    if value == AUTOMATIC:
        return "auto"
    if axis.choices:
        return axis.choice(value)
    shown = axis.shown(value)
    # The unit's division rounds, so the number that gives these bits may be a neighbour of the quotient.
    neighbours = (shown, *(math.nextafter(shown, end) for end in (-math.inf, math.inf)))
    texts = [f"{shown:.{digits}g}" for digits in (6, 12, 15)] + [repr(number) for number in neighbours]
    return next((text for text in texts if axis.of_option(float(text)) == value), repr(shown))


def value_of(axis: Axis, text: str) -> float:
    """The value that an option's text gives. Raises ``ValueError``."""
    if axis.choices:
        return axis.choice_index(text)
    return axis.of_option(number(text, automatic=axis.automatic)) + 0.0


def _axis_of(name: str, figure: CameraFigure) -> Axis:
    """A figure of the camera as an axis."""
    low, high, _ = figure.limit
    return Axis(
        name, f"camera.{name}", name, "", figure.title, figure.unit, 1.0, low, high, f"{{}} {figure.unit}", "{}",
        own=lambda camera: float(camera.figure(name)), span=figure.span,
    )  # fmt: skip


_SWEPT = {axis.into for axis in AXES}
FIGURES: tuple[Axis, ...] = tuple(
    axis
    for name, figure in FIGURES_OF_CAMERAS.items()
    if figure.span and (axis := _axis_of(name, figure)).into not in _SWEPT
)
"""Figures of the camera that are no axes of sweeps."""
QUANTITIES: Mapping[str, Axis] = {key(axis): axis for axis in (*AXES, *FIGURES)}
"""Whatever has a control, by its name in a query."""


@dataclass(frozen=True)
class Control:
    """A slider with a field. values: at the positions of the slider, increasing, in the unit of the column."""

    axis: Axis
    values: tuple[float, ...]

    def read(self, state: State, camera: Camera) -> float:
        """The value in a state, of which this is the camera, figures included."""
        value = state.at.get(self.axis.name)
        return self.axis.own(camera) if value is None else value

    @property
    def texts(self) -> list[str]:
        """The text at each position."""
        return [text_of(self.axis, value) for value in self.values]

    def position(self, value: float) -> int:
        """The position nearest to a value; 0 of one that the camera sets."""
        if not math.isfinite(value) and value not in self.values:
            return 0
        away = [0.0 if value == each else abs(each - value) for each in self.values]
        return away.index(min(away))


def controls(camera: Camera, tested: Mapping[str, Sequence[float]] | None = None) -> dict[str, Control]:
    """The controls of a camera, by name of axis or figure.

    tested: values of a run by axis; where there are two or more, the slider has these and no others.

    >>> exposure = controls(Camera.preset("imx250"), {"exposure_s": [0.001, 0.01]})["exposure_s"]
    >>> exposure.texts, exposure.position(0.008)
    (['1', '10'], 1)
    """
    of_run = tested or {}
    several = {name: tuple(values) for name, values in of_run.items() if len(values) > 1}
    return {
        axis.name: Control(axis, several.get(axis.name) or _values(axis, camera))
        for axis in QUANTITIES.values()
    }


def _values(axis: Axis, camera: Camera) -> tuple[float, ...]:
    """The values of a slider: over the axis's span, or around the camera's own value, within the limits."""
    if axis.choices:
        return tuple(float(index) for index, name in enumerate(axis.choices) if name != OWN_SPECTRUM)
    least, most, own = map(axis.shown, (axis.low, axis.high, axis.own(camera)))
    low, high = 0.0, own * 4 if own > 0 else 1.0
    if axis.span is not None:
        low, high = axis.span
    elif axis is GAIN:
        high = camera.sensor.gain_max_db
    elif axis.logarithmic and own > 0:
        low, high = own / 10, own * 10
    low, high = max(low, least), min(max(high, 2 * own) if math.isfinite(own) else high, most)
    shares = [step / _STEPS for step in range(_STEPS + 1)]
    if axis.logarithmic and low > 0:  # three digits, as nobody sets more by hand
        numbers = [float(f"{low * (high / low) ** share:.3g}") for share in shares]
    else:
        digits = max(0, 1 - math.floor(math.log10((high - low) / _STEPS)))
        numbers = [round(low + share * (high - low), digits) for share in shares]
    return tuple(axis.of_option(value) for value in numbers)
