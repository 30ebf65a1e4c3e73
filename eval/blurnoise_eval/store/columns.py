"""Columns: the parts that rows are made of, and what a value in a run's file may be.

A row is a record. Its fields are the columns of its table in SQLite, CSV and JSON, in their order. A field has a
type, the condition that each value in a run's file meets, in SQL with ``{0}`` for the column, and its meaning;
schema, headers and the guide's tables of columns are made of these. The axes are columns, too: a new axis is an
entry of ``AXES`` alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cache, lru_cache, partial
from itertools import groupby
from operator import attrgetter
from typing import Annotated, Any, ClassVar, NamedTuple, Self, get_args, get_origin, get_type_hints

from blurnoise_eval.plan.axes import AXES, CHOICES, INDEX, NAMES, VELOCITY, Axis, OnAxes

CONDITIONS = ("clean", *NAMES)
"""Columns that identify a condition; the original pictures have None on every axis."""


def number(low: float, high: float, kind: str = "real") -> str:
    """The condition on a number from ``low`` to ``high``.

    >>> number(0.0, 1.0)
    "typeof({0}) = 'real' AND {0} BETWEEN 0.0 AND 1.0"
    """
    ends = " AND ".join(
        "9e999" if end == math.inf else "-9e999" if end == -math.inf else repr(end) for end in (low, high)
    )
    return f"typeof({{0}}) = '{kind}' AND {{0}} BETWEEN {ends}"


def or_none(condition: str) -> str:
    """The condition, or no value.

    >>> or_none("{0} > 0").format("gain_db")
    'gain_db IS NULL OR gain_db > 0'
    """
    return f"{{0}} IS NULL OR {condition}"


_BYTES = "length(CAST({0} AS BLOB))"  # length alone ends at a zero
NAME = f"typeof({{0}}) = 'text' AND {_BYTES} BETWEEN 1 AND 4000"
ANY_TEXT = f"typeof({{0}}) = 'text' AND {_BYTES} <= 20000"
# Twenty hexadecimal digits: a hash of 80 bits, of which a million cells collide once in 1e12.
ID = "typeof({0}) = 'text' AND length({0}) = 20 AND {0} NOT GLOB '*[^0-9a-f]*'"
HASH = "typeof({0}) = 'text' AND length({0}) <= 32 AND {0} NOT GLOB '*[^0-9a-f]*'"
COUNT, SIZE, FLAG = (number(low, high, "integer") for low, high in ((0, 10**6), (1, 10**5), (0, 1)))
BIG = number(0, 2**63 - 1, "integer")
# A mean of shares may exceed 1 by a rounding.
SHARE, PX = number(0.0, 1.000001), number(-1e9, 1e9)
MEASURED = number(-math.inf, math.inf)


class TableColumn(NamedTuple):
    """A column: its name, SQLite's type, the condition on each value, and its meaning."""

    name: str
    kind: str
    holds: str
    meaning: str = ""


class AxisValues(OnAxes):
    """A number on every axis, by its name; None on an axis that a row has none on. Immutable and hashable.

    >>> at = AxisValues.of({"exposure_s": 0.01, "illuminance_lux": 50.0})
    >>> at.exposure_s, at["gain_db"], at.original
    (0.01, None, False)
    """

    __slots__ = ("original",)

    original: bool
    """Whether these are the original pictures, which have a number on no axis."""

    def __init__(self, numbers: Iterable[float | None]) -> None:
        super().__init__(numbers)
        self.original = all(number is None for number in self.numbers)

    @classmethod
    def of(cls, at: Mapping[str, Any]) -> AxisValues:
        """By name; None on axes that are not named."""
        return _shared(*(at.get(name) for name in NAMES))

    def __getitem__(
        self, name: str
    ) -> Any:  # whoever reads a simulated picture's row knows that there is a number
        return super().__getitem__(name)

    def __repr__(self) -> str:
        return f"AxisValues.of({ ({name: number for name, number in self.items() if number is not None})!r})"

    @property
    def exposure_s(self) -> float:
        """Exposure time. Raises ``ValueError`` where there is none."""
        return self._number("exposure_s")

    @property
    def illuminance_lux(self) -> float:
        """Light on the scene. Raises ``ValueError`` where there is none."""
        return self._number("illuminance_lux")

    @property
    def velocity_px_s(self) -> tuple[float, float]:
        """Motion to the right and down. Raises ``ValueError`` where there is none."""
        x, y = map(self._number, VELOCITY)
        return x, y

    def _number(self, name: str) -> float:
        number: float | None = self[name]
        if number is None:
            raise ValueError(f"{name}: is None under {self!r}")
        return number

    def but(self, **numbers: float | None) -> AxisValues:
        """These with other numbers on some axes."""
        return AxisValues.of({**self, **numbers})


ORIGINAL = AxisValues((None,) * len(NAMES))
"""Of the original pictures."""


@lru_cache(maxsize=4096)
def _shared(*numbers: float | None) -> AxisValues:
    """One object for all rows of a condition, which keeps a table of 100 000 rows small."""
    return AxisValues(numbers)


class WithInterval(NamedTuple):
    """A number and the ends of its 95 % interval: the columns NAME, NAME_low and NAME_high. None: unknown.

    >>> WithInterval(0.68, 0.61, 0.74).columns("score")
    {'score': 0.68, 'score_low': 0.61, 'score_high': 0.74}
    """

    value: float | None = None
    low: float | None = None
    high: float | None = None

    @property
    def known(self) -> float:
        """The number. Raises ``ValueError`` where it is unknown."""
        if self.value is None:
            raise ValueError("value: is unknown")
        return self.value

    def columns(self, name: str) -> dict[str, float | None]:
        """By column."""
        return {name: self.value, f"{name}_low": self.low, f"{name}_high": self.high}


UNKNOWN = WithInterval()


@dataclass(frozen=True, slots=True)
class Row:
    """A row of a table. A field that is several columns stands in their place: the values on the axes, a number with
    its interval, numbers by the names of scores, or a row, which is absent where it is None.

    >>> from blurnoise_eval.store.rows import SkippedRow
    >>> SkippedRow("a.png", "is no picture").columns()
    {'image': 'a.png', 'reason': 'is no picture'}
    """

    axes: ClassVar[tuple[str, ...]] = CONDITIONS
    """Those columns of ``CONDITIONS`` that the table has."""

    def columns(self) -> dict[str, Any]:
        """The values by column as public tables and files have them: choices by their names."""
        values = self.stored()
        for name, axis in CHOICES.items():
            if (number := values.get(name)) is not None:
                values[name] = axis.choice(number)
        return values

    def stored(self) -> dict[str, Any]:
        """The values by column as a run's file has them."""
        values: dict[str, Any] = {}
        kind: Any = type(self)
        for add in _writers(kind):
            add(self, values)
        return values

    @classmethod
    def read(cls, values: Sequence[Any]) -> Self:
        """The row of an SQL result with the columns of :func:`columns_of`, in their order. A part at its end may be
        missing."""
        arguments: list[Any] = []
        start = 0
        kind: Any = cls
        for count, make in _segments(kind):
            some = values[start : start + count]
            start += count
            if make is None:
                arguments += some
            elif some:
                arguments.append(make(*some))
        return cls(*arguments)


# Rows' classes are ``Any`` here, since mypy takes them for unhashable.


@cache
def _fields(row: Any) -> tuple[str, ...]:
    return tuple(each.name for each in fields(row))


@cache
def _hints(row: Any) -> dict[str, Any]:
    """The types of the fields alone, with their annotations."""
    every = get_type_hints(row, include_extras=True)
    return {name: every[name] for name in _fields(row)}


def _part(hint: Any) -> Any:
    """The row that a field holds, or may hold."""
    kinds = (hint, *get_args(hint))
    return next((kind for kind in kinds if isinstance(kind, type) and issubclass(kind, Row)), None)


@cache
def _parts(row: Any) -> dict[str, Any]:
    """The fields that are rows themselves, and their classes."""
    return {name: part for name, hint in _hints(row).items() if (part := _part(hint)) is not None}


def columns_of(row: Any, *, optional: bool = True) -> list[TableColumn]:
    """The columns of a row's table. optional: with those of parts that may be missing.

    >>> from blurnoise_eval.store.rows import SkippedRow
    >>> [(column.name, column.kind) for column in columns_of(SkippedRow)]
    [('image', 'TEXT'), ('reason', 'TEXT')]
    """
    columns: list[TableColumn] = []
    for name, hint in _hints(row).items():
        if hint is AxisValues:
            columns += [_of_axis(each) for each in row.axes]
        elif part := _parts(row).get(name):
            columns += columns_of(part) if optional or hint is part else []
        elif get_origin(hint) is Annotated:  # numbers by score are columns of the table of scores
            kind, *about = get_args(hint)
            columns.append(_column(name, kind, *about))
    return columns


def _column(name: str, kind: Any, *about: str) -> TableColumn:
    """about: the condition on values, which tables that are no part of a run's file lack, and the meaning."""
    holds = about[0] if len(about) > 1 else ""
    plain = [each for each in (get_args(kind) or (kind,)) if each is not type(None)]
    if kind is WithInterval:
        return TableColumn(
            name, "REAL", holds, f"{about[-1]}; with `_low` and `_high` the ends of its 95 % interval"
        )
    optional = type(None) in get_args(kind)
    return TableColumn(name, _KINDS.get(plain[0], ""), or_none(holds) if optional else holds, about[-1])


_KINDS: Mapping[Any, str] = {float: "REAL", int: "INTEGER", bool: "INTEGER", str: "TEXT"}


def _of_axis(name: str) -> TableColumn:
    if name == "clean":
        return TableColumn(
            name, "INTEGER", FLAG, "whether this is the original picture; it has no value on any axis"
        )
    axis = AXES[INDEX[name]]
    return TableColumn(name, "REAL", _on(axis), axis.title)


def _on(axis: Axis) -> str:
    """None of original pictures, a number on the axis of others."""
    allowed = number(axis.low, axis.high)
    if axis.choices:
        numbered = f" OR {{0}} >= {axis.least_number!r}" if axis.prefix else ""
        allowed += f" AND ({{0}} = round({{0}}) AND {{0}} < {len(axis.choices)}{numbered})"
    if axis.positive:
        allowed += f" AND {{0}} > {axis.low!r}"
    if axis.automatic:
        allowed = f"({allowed} OR typeof({{0}}) = 'real' AND {{0}} = 9e999)"
    return f"CASE WHEN clean THEN {{0}} IS NULL ELSE {allowed} END"


@cache
def _writers(row: Any) -> tuple[Callable[[Row, dict[str, Any]], None], ...]:
    """Functions that add a row's values to a dictionary by column: one for each run of plain fields, and one for each
    field that is several columns."""
    writers: list[Callable[[Row, dict[str, Any]], None]] = []
    hints = _hints(row)
    for is_plain, group in groupby(_fields(row), key=lambda name: _is_plain(hints[name])):
        names = tuple(group)
        writers += [_plain(names)] if is_plain else [partial(_add_part, name) for name in names]
    return tuple(writers)


def _is_plain(hint: Any) -> bool:
    """Whether a field is one column."""
    return get_origin(hint) is Annotated and get_args(hint)[0] is not WithInterval


def _plain(names: tuple[str, ...]) -> Callable[[Row, dict[str, Any]], None]:
    values = attrgetter(*names) if len(names) > 1 else lambda row: (getattr(row, names[0]),)
    return lambda row, found: found.update(zip(names, values(row)))  # noqa: B905  # some 100 000 times


def _add_part(name: str, row: Row, values: dict[str, Any]) -> None:
    value = getattr(row, name)
    if isinstance(value, AxisValues):
        if row.axes is CONDITIONS:
            values["clean"] = value.original
            values.update(zip(NAMES, value.numbers, strict=True))
        else:
            values.update((axis, value[axis]) for axis in row.axes)
    elif isinstance(value, WithInterval):
        values.update(value.columns(name))
    elif isinstance(value, Row):
        values.update(value.stored())
    elif value is not None:
        for score, estimate in value.items():
            values.update(estimate.columns(score))


@cache
def _segments(row: Any) -> tuple[tuple[int, Any], ...]:
    """Runs of columns: how many, and what one field is made of them by; None: fields of their own."""
    segments: list[tuple[int, Any]] = []
    for name, hint in _hints(row).items():
        part = _parts(row).get(name)
        if hint is AxisValues:
            segments.append((len(CONDITIONS), lambda clean, *numbers: _shared(*numbers)))
        elif part is not None:
            segments.append((len(columns_of(part)), part))
        elif segments and segments[-1][1] is None:
            segments[-1] = segments[-1][0] + 1, None
        else:
            segments.append((1, None))
    return tuple(segments)
