"""Label files as they come from anywhere: read strictly, every fault one line that names file and place; what of them
is used."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from typing import Annotated, Any, TypeVar

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    Field,
    PlainValidator,
    Strict,
    TypeAdapter,
    ValidationError,
)

from blurnoise._core.checks import Characters, shown
from blurnoise._core.files import LARGEST_TEXT_BYTES, json_of, read_bytes, text_of, yaml_of
from blurnoise_eval.datasets.records import Target, size_group
from blurnoise_eval.system.files import inside
from blurnoise_eval.system.urls import Location, local_file

T = TypeVar("T")
Form = TypeVar("Form", bound=BaseModel)
LARGEST_ID = 2**63  # COCO's tools hold ids in 64 bits
_PLAIN_ID = 2**53  # below it floats hold every integer
LARGEST_SET_BYTES = 2 << 30
"""Of a file with the labels of a whole set: COCO's of 118 000 pictures has 448 MB, BDD100K's of 70 000 1.3 GB."""
Number = Annotated[
    Annotated[float, Strict()] | Annotated[int, Strict(), AfterValidator(lambda _: math.inf)],
    Field(union_mode="left_to_right"),
]
"""A number, which may be NaN or infinite; an integer beyond the range of floats is infinite."""
_NUMBER: TypeAdapter[float] = TypeAdapter(Number)


def _whole(value: object) -> int:
    if type(value) is int and -_PLAIN_ID < value < _PLAIN_ID:  # nearly all, in a third of the time
        return value
    number = _NUMBER.validate_python(value)
    if not number.is_integer() or abs(number) >= LARGEST_ID:
        raise ValueError("must be a whole number of at most 64 bits")
    return int(value)  # type: ignore[call-overload, no-any-return]


Whole = Annotated[int, PlainValidator(_whole)]
"""A whole number of at most 64 bits; 7.0 is one."""


def of_length(least: int, most: float, must: str) -> BeforeValidator:
    """A check that a value is a list of that many entries, before they are read; ``must`` says what it should be."""

    def check(value: object) -> object:
        if not isinstance(value, list) or not least <= len(value) <= most:
            raise ValueError(must)
        return value

    return BeforeValidator(check)


FileName = Annotated[Characters, AfterValidator(inside)]
"""A name in the pictures' folder."""


class Size(BaseModel):
    """Of a picture, px."""

    width: Number
    height: Number

    @property
    def px(self) -> tuple[float, float]:
        """Width and height."""
        return self.width, self.height


_MUST = {
    "list_type": "must be a list",
    "model_type": "must be an object",
    "dict_type": "must be names, as a list or by their numbers",
    "too_short": "must not be empty",
    "float_type": "must be a number",
    "int_type": "must be a whole number",
    "greater_than_equal": "must be a whole number >= 0",
}


@contextmanager
def faults_of(kind: str, file: Location) -> Iterator[None]:
    """What is wrong inside becomes one ``ValueError`` that begins with the kind and the file."""
    try:
        yield
    except OSError as error:
        raise ValueError(f"{kind} = {str(file)!r}: {error.strerror or error}") from None
    except ValueError as error:
        raise ValueError(f"{kind} = {str(file)!r}: {' '.join(str(error).split())}") from None


def read_text(file: Location, largest: int = LARGEST_TEXT_BYTES, known: str | None = None) -> str:
    """The file as UTF-8, with or without a byte-order mark; line ends are ``\\n``. Raises ``OSError``, and
    ``ValueError``, also above ``largest`` bytes. known: an object's version, where it has been looked up."""
    return text_of(read_bytes(local_file(file, known=known), largest))


def read_json(file: Location, what: str) -> Any:
    """The file as JSON. Raises ``OSError``, and ``ValueError`` that it is not ``what``."""
    return as_json(read_text(file, LARGEST_SET_BYTES), what)


def as_json(content: str, what: str) -> Any:
    """``content`` as JSON. Raises ``ValueError`` that it is not ``what``."""
    try:
        return json_of(content)
    except ValueError as error:
        raise ValueError(f"not {what}: {error}") from None


def read_yaml(file: Location) -> dict[Any, Any]:
    """The file as a YAML mapping. Raises ``OSError``, and ``ValueError`` for anything else."""
    content = read_text(file)
    try:
        data = yaml_of(content)
    except ValueError as error:
        raise ValueError(f"not YAML: {error}") from None
    if not isinstance(data, dict):
        raise ValueError(f"{shown(data)}: must be a mapping")
    return data


def checked(form: type[Form], value: Any, name: str = "") -> Form:
    """``value`` in that form. Raises ``ValueError`` of one line, the place first, beginning with ``name``."""
    try:
        return form.model_validate(value)
    except ValidationError as error:
        fault = error.errors(include_url=False)[0]
    place = fault["loc"]  # also holds names of types that were tried
    of_key = "[key]" in place
    for part in place[:-2] if of_key else place:
        if isinstance(value, dict) and part in value:
            name, value = f"{name}: {part}".removeprefix(": "), value[part]
        elif isinstance(value, list) and isinstance(part, int):
            name, value = f"{name}[{part}]", value[part]
    if of_key:
        name, value = f"{name}: key", fault["input"]
    if fault["type"] == "missing":
        raise ValueError(f"{name}: has no {place[-1]!r}".removeprefix(": "))
    must = str(fault.get("ctx", {}).get("error", _MUST.get(fault["type"], "must be text")))
    if must.startswith("must"):
        raise ValueError(f"{name} = {shown(value)}: {must}")
    raise ValueError(f"{name.rpartition(': ')[0]}: {must}")  # of a file name, which it shows


def each(entries: object, name: str, form: type[Form]) -> Iterator[Form]:
    """Every object in a list in that form. Raises as :func:`checked` does."""
    if not isinstance(entries, list):
        raise ValueError(f"{name} = {shown(entries)}: must be a list")
    for place, entry in enumerate(entries):
        yield checked(form, entry, f"{name}[{place}]")


def each_line(content: str, read: Callable[[str], T]) -> Iterator[T]:
    """``read`` of every line that is not blank; its ``ValueError`` comes to name the line."""
    for place, line in enumerate(content.split("\n"), start=1):
        if line.strip():
            try:
                found = read(line)
            except ValueError as error:
                raise ValueError(f"line {place}: {error}") from None
            yield found


class Selection:
    """What of a labelled set is used: boxes of the ``labels`` asked for (all, if none are), pictures with them.

    keep_empty: pictures without any of the labels, too: what is found there is wrong.
    """

    def __init__(self, labels: Sequence[str], keep_empty: bool) -> None:
        self._labels = tuple(labels)
        self._keep_empty = keep_empty
        self._counted: Counter[str] = Counter()
        self._alike: list[str] = []

    def target(
        self,
        label: str,
        box_xyxy: tuple[float, float, float, float],
        size_px: tuple[float, float] | None = None,
        *,
        group: str | None = None,
        **beside: Any,
    ) -> list[Target]:
        """The box as a target, or nothing. size_px: (width, height) of the picture, where that is known.

        group: by default its size class. ``beside``: the target's other fields. Boxes partly outside the
        picture stay as they are.
        """
        if self._labels and label not in self._labels:
            return []
        x0, y0, x1, y1 = box_xyxy
        width, height = x1 - x0, y1 - y0
        if not math.isfinite(width * height):
            return self.leave_out("with numbers that are not finite")
        if width <= 0 or height <= 0:
            return self.leave_out("of no area")
        if size_px and (x1 <= 0 or y1 <= 0 or x0 >= size_px[0] or y0 >= size_px[1]):
            return self.leave_out("outside the picture")
        group = group or size_group(width, height, label if self._labels else "objects")
        return [Target(label, group, box_xyxy, **beside)]

    def takes(self, targets: Sequence[Target]) -> bool:
        """Whether a picture with these targets counts; crowds alone are no reason to look at it."""
        return not self._labels or self._keep_empty or not all(target.crowd for target in targets)

    @property
    def chosen(self) -> str:
        """The choice in words; "" for all boxes."""
        return (
            ", ".join([*sorted(self._labels), *["pictures without them"] * self._keep_empty])
            if self._labels
            else ""
        )

    def check(self, known: Collection[str], pictures: Sequence[object]) -> None:
        """Raise ``ValueError`` for a label that the set does not know, or where no picture is left."""
        self._alike = sorted(name for name, count in Counter(known).items() if count > 1)
        if unknown := [label for label in self._labels if label not in known]:
            raise ValueError(f"target = {unknown}: not among the categories {sorted(known)}")
        if not pictures:
            raise ValueError(f"lists no pictures{f' with {list(self._labels)}' if self._labels else ''}")

    def leave_out(self, why: str) -> list[Target]:
        """Count a box that is left out, and be no target in its place."""
        self.count(f"{why} left out")
        return []

    def count(self, what: str) -> None:
        """Count a box of which the notes say ``what``."""
        self._counted[what] += 1

    def notes(self) -> tuple[str, ...]:
        """What was left out or is not as it should be, a sentence each."""
        alike = f"{len(self._alike)} names stand for several classes each, which count as one"
        if len(self._alike) == 1:
            alike = "1 name stands for several classes, which count as one"
        return (
            *(f"{count} {'box' if count == 1 else 'boxes'} {what}" for what, count in self._counted.items()),
            *([f"{alike} (first: {shown(self._alike[0])})"] if self._alike else []),
        )
