"""The axes of a sweep in one table, from which options, limits, columns, file names, captions and pages follow.

Values are in SI units, with the unit in the name; options and files have the option's unit, ``per_option`` SI units
each. An axis that is not specified has the camera's value. A new axis is an entry of ``AXES``.

Nothing heavy is imported above, because the command line's help is made from the table. The defaults are those of
:mod:`blurnoise._core.usual`, from which trainings draw, too.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from blurnoise._core import usual
from blurnoise_eval.plan.typed import AUTOMATIC, number, numbers

if TYPE_CHECKING:
    from blurnoise.camera import Camera


@dataclass(frozen=True)
class Axis:
    """One quantity that a sweep can vary.

    name: the column's, with its SI unit. into: the field of :class:`blurnoise.Exposure` that it sets, or of its
    camera ("camera.f_number"). option: the option's name; its unit is ``per_option`` of the column's. about: a line
    for help, files and the guide. title, unit: for figures and tables, in the option's unit. low, high: the limits,
    in the column's unit; positive: low itself is not allowed. caption: with {} for the number, of at most so many
    digits; slugs: the same in names of files.

    own: the camera's value. default: the values of a sweep; none: the camera's. default_names: a name for each of
    these. automatic: the camera may set it itself, see ``AUTOMATIC``. without: axes that lose their default where
    this one is specified. choices: the names of an axis of names; its values are their indices, 0, 1, ..., but
    files and options have the names; captions: of the choices. prefix: of numbers that an axis of names also has,
    "planck:" for planck:2856; they are values themselves, from ``least_number`` on, above every index. fails: more of
    it is worse, so that from some value on a model fails for good. logarithmic: how it is drawn. span: the ends of a
    slider, in the option's unit; None: around the camera's value.

    >>> axis("exposure_s").values("1,10"), axis("exposure_s").text(0.0125)
    ((0.001, 0.01), '12.5 ms')
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
    caption: str
    slugs: str
    own: Callable[[Camera], float] = lambda camera: 0.0
    digits: int = 6
    positive: bool = False
    logarithmic: bool = False
    fails: bool = False
    automatic: bool = False
    default: tuple[float, ...] = ()
    default_names: tuple[str, ...] = ()
    choices: tuple[str, ...] = ()
    captions: tuple[str, ...] = ()
    prefix: str = ""
    least_number: float = math.inf
    without: tuple[str, ...] = ()
    span: tuple[float, float] | None = None

    def checked(self, values: Iterable[float | str]) -> tuple[float, ...]:
        """``values`` in the column's unit, sorted, each once; a choice may be a name.

        Raises ``ValueError`` for none, or for one outside the limits.
        """
        distinct = tuple(sorted({self._one(value) for value in values}))
        if not distinct:
            raise ValueError(f"{self.name}: must hold at least one value")
        return distinct

    def _one(self, value: float | str) -> float:
        from blurnoise._core.checks import in_range  # late: options of the command line are made from here

        if self.automatic and value in ("auto", AUTOMATIC):
            return AUTOMATIC
        if self.choices:
            return self.choice_index(value)
        # + 0.0 makes 0.0 of -0.0, whose repr would be another in the cells' ids
        return in_range(self.name, value, self.low, self.high, above=self.positive) + 0.0  # type: ignore[arg-type]

    def choice_index(self, choice: float | str) -> float:
        """The value of a choice, given by its name in any case or by its value. Raises ``ValueError`` that lists the
        choices."""
        word = choice.strip().lower() if isinstance(choice, str) else choice
        for index, name in enumerate(self.choices):
            if word in (name.lower(), index):
                return float(index)
        if self.prefix and isinstance(word, str) and word.startswith(self.prefix):
            from blurnoise._core.checks import in_range

            stated = number(word.removeprefix(self.prefix))
            return in_range(f"{self.name} = {self.prefix}", stated, self.least_number, self.high)
        if self.prefix and isinstance(word, float | int) and self.least_number <= word <= self.high:
            return float(word)
        numbered = f" or {self.prefix}NUMBER" if self.prefix else ""
        raise ValueError(f"{self.name} = {choice!r}: must be one of {', '.join(self.choices)}{numbered}")

    def choice(self, value: float) -> str:
        """The name of a value of an axis of names."""
        return self.choices[int(value)] if value < self.least_number else f"{self.prefix}{value:.15g}"

    @property
    def key(self) -> str:
        """Its name in files of settings: the option's."""
        return self.option.lstrip("-").replace("-", "_")

    @property
    def default_text(self) -> str:
        """The default as it is typed."""
        return ",".join(map(self.typed, self.default))

    def values(self, given: float | str | Iterable[float | str]) -> tuple[float, ...]:
        """Values of an option or a file, :meth:`checked` and in the column's unit.

        Raises ``ValueError``; for a value outside the limits, in the option's name and unit.
        """
        from blurnoise._core.checks import OutOfRange

        try:
            return self.checked(self._read(given))
        except OutOfRange as error:
            numbers: Any = error.value, error.low, error.high
            value, low, high = (float(f"{self.shown(number):.12g}") for number in numbers)
            raise OutOfRange(self.key, value, low, high, error.above) from None

    def _read(self, given: float | str | Iterable[float | str]) -> list[float]:
        if isinstance(given, str) and self.choices:
            return [self.choice_index(part.strip()) for part in given.split(",")]
        if isinstance(given, str):
            return [self.of_option(value) for value in numbers(given, automatic=self.automatic)]
        if isinstance(given, list | tuple):
            return [value for part in given for value in self._read(part)]
        return [self.of_option(number(given))]  # type: ignore[arg-type]  # anything else of a file is refused

    def of_option(self, value: float) -> float:
        """The option's number in the column's unit. By division, 45 ms is the float nearest to 0.045 s."""
        return value * self.per_option if self.per_option >= 1 else value / round(1 / self.per_option, 9)

    def shown(self, value: float) -> float:
        """The value in the option's unit, as axes of figures and tables have it."""
        return value / self.per_option

    def typed(self, value: float) -> str:
        """The value as it is typed."""
        if self.automatic and value == AUTOMATIC:
            return "auto"
        return self.choice(value) if self.choices else f"{self.shown(value):g}"

    def text(self, value: float) -> str:
        """The value for captions, unit included."""
        if self.automatic and value == AUTOMATIC:
            return f"automatic {self.title.lower()}"
        if self.choices:
            return (
                self.captions[int(value)]
                if value < self.least_number
                else self.caption.format(self.choice(value))
            )
        return self.caption.format(_positional(self.shown(value), self.digits))

    def slug(self, value: float) -> str:
        """The value for names of files."""
        typed = self.typed(value)
        return typed if typed == "auto" else self.slugs.format(typed)


@dataclass(frozen=True)
class Coordinate:
    """A quantity to draw against that follows from the axes; ``of`` computes it from a row of a table.

    >>> row = {"velocity_x_px_s": 400.0, "velocity_y_px_s": 300.0, "exposure_s": 0.01}
    >>> BLUR.of(row), BLUR.text(BLUR.of(row))  # 500 px/s for 10 ms
    (5.0, 'blur 5 px')
    """

    name: str
    title: str
    unit: str
    of: Callable[[Mapping[str, Any]], float]
    text: Callable[[float], str]
    logarithmic: bool = False


def milliseconds(exposure_s: float, digits: int = 3) -> str:
    """An exposure in ms, with at most so many digits: '2.5'.

    >>> milliseconds(0.0025), milliseconds(1 / 30)
    ('2.5', '33.3')
    """
    return _positional(1e3 * exposure_s, digits)


def _positional(value: float, digits: int) -> str:
    """A number without a power of ten."""
    import numpy as np

    return np.format_float_positional(value, digits, fractional=False, trim="-")


OWN_SPECTRUM = "own"
"""The choice of an illuminant that is the plan's own curve."""
ILLUMINANTS = (  # of blurnoise.camera.spectra; a test compares them. Cells' ids are made of the places: append only.
    "D50", "D55", "D65", "D75", "led-2700", "led-3000", "led-4000", "led-5000", "led-6500", "sodium", "metal-halide",
    "low-pressure-sodium", "halogen", OWN_SPECTRUM,
)  # fmt: skip
AXES: tuple[Axis, ...] = (
    Axis(
        "exposure_s", "exposure_s", "--exposure-ms",
        "exposure time, ms; auto: set by the camera for each picture", "Exposure", "ms",
        1e-3, 0.0, 3600.0, "{} ms", "{}ms", own=lambda camera: math.nan, digits=3, positive=True, logarithmic=True,
        fails=True, automatic=True, default=usual.EXPOSURE_S,
        span=(0.003, 900.0),
    ),
    Axis(
        "illuminance_lux", "illuminance_lux", "--lux", "illuminance of the scene, lux", "Light", "lux", 1.0, 0.0, 1e9,
        "{} lux", "{}lux", own=lambda camera: math.nan, logarithmic=True, default=usual.ILLUMINANCE_LUX,
        span=(0.1, 200_000.0),
    ),
    Axis(
        "illuminant", "illuminant", "--illuminant",
        f"spectrum of the light: {', '.join(ILLUMINANTS[:-1])}, planck:KELVIN, or a CSV file of nm and power "
        "(default: D55)",
        "Spectrum", "", 1.0, 0.0, 1e6, "{} light", "{}-light", own=lambda camera: float(ILLUMINANTS.index("D55")),
        choices=ILLUMINANTS, captions=tuple(f"{name} light" for name in ILLUMINANTS),
        prefix="planck:", least_number=300.0,
    ),
    Axis(
        "headlamp", "headlamp", "--headlamp",
        "headlamps of the camera's vehicle, which light the targets; signs return their light (default: off)",
        "Headlamp", "", 1.0, 0.0, 2.0, "{}", "{}-headlamp",
        choices=("off", "low", "high"),  # of blurnoise.scene.exposure; a test compares them
        captions=("headlamps off", "low beam", "high beam"),
    ),
    Axis(
        "velocity_x_px_s", "velocity_px_s.0", "--dx", "motion to the right, px/s", "Motion to the right", "px/s",
        1.0, -1e7, 1e7, "{} px/s", "{}", default=(*usual.SPEED_PX_S.values(),),
        default_names=(*usual.SPEED_PX_S,), span=(-2000.0, 2000.0),
    ),
    Axis(
        "velocity_y_px_s", "velocity_px_s.1", "--dy", "motion down, px/s", "Motion down", "px/s",
        1.0, -1e7, 1e7, "{} px/s down", "{}px_s", default=(0.0,),
        span=(-2000.0, 2000.0),
    ),
    Axis(
        "temperature_c", "temperature_c", "--temperature-c", "sensor temperature, °C", "Sensor temperature", "°C",
        1.0, -273.15, 300.0, "{} °C", "{}C", own=lambda camera: usual.TEMPERATURE_C, fails=True, span=(-40.0, 105.0),
    ),
    Axis(
        "f_number", "camera.f_number", "--f-number",
        "f-number of the lens, for its light and its diffraction at 0.55 µm (default: the camera's)", "f-number", "",
        1.0, 0.5, 256.0, "f/{}", "f{}", own=lambda camera: camera.lens.f_number, logarithmic=True, fails=True,
        span=(1.0, 16.0),
    ),
    Axis(
        "defocus_radius_px", "camera.defocus_radius_px", "--defocus-px",
        "radius of the blur disc of a defocused lens, px (default: the camera's)", "Defocus", "px", 1.0, 0.0, 1000.0,
        "defocus {} px", "defocus{}px", own=lambda camera: camera.lens.defocus_radius_px, fails=True,
        span=(0.0, 8.0),
    ),
    Axis(
        "gain_db", "gain_db", "--gain",
        "gain, dB, analogue up to the camera's limit, then digital; auto: brings the mean of each picture to 18 %",
        "Gain", "dB", 1.0, -120.0, 120.0, "gain {} dB", "{}dB", automatic=True,
        default=(number(usual.GAIN, automatic=True),),
    ),
    Axis(
        "moves", "moves", "--moves",
        "what dx and dy move: everything, only the targets, or only the background behind tracked targets",
        "Kind of motion", "", 1.0, 0.0, 2.0, "{}", "{}-moves",
        choices=("all", "targets", "background"),  # of blurnoise.scene.scene; a test compares them
        captions=("all moves", "targets move", "background moves"),
    ),
    Axis(
        "ego_speed_m_s", "ego_speed_m_s", "--ego-kmh",
        "speed of the camera on a flat road, km/h, instead of dx and dy",
        "Ego-motion", "km/h", 1 / 3.6, 0.0, 100.0, "{} km/h", "{}km_h", fails=True, without=("velocity_x_px_s",),
        span=(0.0, 200.0),
    ),
)  # fmt: skip
NAMES: tuple[str, ...] = tuple(axis.name for axis in AXES)
VELOCITY = ("velocity_x_px_s", "velocity_y_px_s")
CORE: Mapping[str, float | None] = {"exposure_s": None, "illuminance_lux": None} | dict.fromkeys(
    VELOCITY, 0.0
)
"""Axes on which every condition has a value: the default, or None where it must be specified."""
INDEX: Mapping[str, int] = {name: index for index, name in enumerate(NAMES)}
"""Where an axis stands in ``AXES``."""
FURTHER: tuple[str, ...] = tuple(name for name in NAMES if name not in CORE)
"""The other axes: where they are not specified, the camera's value holds."""
CHOICES: Mapping[str, Axis] = {axis.name: axis for axis in AXES if axis.choices}
"""The axes of names."""
SETTING: tuple[str, ...] = tuple(name for name in NAMES if name not in ("exposure_s", *VELOCITY))
"""Axes that stay the same over a surface of exposures and velocities."""


class OnAxes(Mapping[str, float | None]):
    """A number, or None, on every axis, by the axes' names. Immutable and hashable.

    >>> at = OnAxes(range(len(NAMES)))
    >>> at["exposure_s"], len(at) == len(NAMES), at == OnAxes(at.values())
    (0, True, True)
    """

    __slots__ = ("numbers",)

    numbers: tuple[float | None, ...]
    """In the order of ``AXES``."""

    def __init__(self, numbers: Iterable[float | None]) -> None:
        self.numbers = tuple(numbers)

    def __getitem__(self, name: str) -> float | None:
        return self.numbers[INDEX[name]]

    def __iter__(self) -> Iterator[str]:
        return iter(NAMES)

    def __len__(self) -> int:
        return len(NAMES)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, OnAxes) and type(other) is type(self) and self.numbers == other.numbers

    def __hash__(self) -> int:
        return hash(self.numbers)


def axis(name: str) -> Axis:
    """The axis of this name. Raises ``ValueError`` that lists the names.

    >>> axis("exposure_s").values("2,10"), axis("exposure_s").text(0.01)
    ((0.002, 0.01), '10 ms')
    """
    for axis in AXES:
        if axis.name == name:
            return axis
    raise ValueError(f"axis = {name!r}: must be one of {', '.join(NAMES)}")


def with_defaults(axes: Sequence[Axis], **defaults: Iterable[float]) -> tuple[Axis, ...]:
    """Axes with these defaults, by name, and no others."""
    return tuple(replace(each, default=tuple(defaults.get(each.name, ())), default_names=()) for each in axes)


def named(row: Mapping[str, Any]) -> dict[str, Any]:
    """A row as files have it: choices by their names.

    >>> named({"exposure_s": 0.01, "moves": 1.0})
    {'exposure_s': 0.01, 'moves': 'targets'}
    """
    return {**row, **{name: CHOICES[name].choice(row[name]) for name in CHOICES if row.get(name) is not None}}


def setting_of(row: Mapping[str, Any]) -> tuple[float, ...]:
    """A row's values on the axes of ``SETTING``, in their order."""
    return tuple(row[name] for name in SETTING)


def velocity_of(row: Mapping[str, Any]) -> tuple[float, float]:
    """(x, y) px/s of a row.

    >>> velocity_of({"velocity_x_px_s": 400.0, "velocity_y_px_s": 0.0})
    (400.0, 0.0)
    """
    return row["velocity_x_px_s"], row["velocity_y_px_s"]


def blur_px(row: Mapping[str, Any]) -> float:
    """Length of a row's motion blur, px. 0 with ego-motion, where each part of the picture has its own.

    >>> blur_px({"velocity_x_px_s": 300.0, "velocity_y_px_s": 400.0, "exposure_s": 0.01})
    5.0
    """
    import numpy as np

    return float(np.hypot(row["velocity_x_px_s"], row["velocity_y_px_s"]) * row["exposure_s"])


BLUR = Coordinate("blur_px", "Motion blur", "px", blur_px, lambda value: f"blur {value:.3g} px", True)
SPEED = Coordinate(
    "speed_px_s", "Speed", "px/s", lambda row: math.hypot(*velocity_of(row)), lambda value: f"{value:g} px/s"
)


def velocity_text(velocity_px_s: tuple[float, float]) -> str:
    """'400 px/s' for motion to the right, '(300, -400) px/s' for any other direction.

    >>> velocity_text((400.0, 0.0)), velocity_text((300.0, -400.0))
    ('400 px/s', '(300, -400) px/s')
    """
    x, y = velocity_px_s
    return f"{x:g} px/s" if y == 0 and x >= 0 else f"({x:g}, {y:g}) px/s"


EXPOSURE, LIGHT, SPECTRUM, GAIN, MOVES, EGO = map(
    axis, ("exposure_s", "illuminance_lux", "illuminant", "gain_db", "moves", "ego_speed_m_s")
)
HEADLAMP = axis("headlamp")
EGO_SPEED = Coordinate(
    EGO.name, "Speed", EGO.unit, lambda row: EGO.shown(row[EGO.name]), lambda value: f"{value:g} km/h"
)
LIT = tuple(name for name in ("illuminant", "headlamp") if name in NAMES)
"""Axes on which a named light has values."""
SETTING_AXES: tuple[Axis, ...] = tuple(map(axis, SETTING))
