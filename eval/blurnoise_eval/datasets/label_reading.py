"""Fields of label files: text, JSON, XML, numbers, names and flags, read strictly.

Labels come from anywhere: what is wrong is one line that names file, place and value.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Annotated, Any, TypeVar

from annotated_types import Gt, Lt
from pydantic import BaseModel, BeforeValidator, Strict, ValidationError

from blurnoise._core.checks import shown
from blurnoise._core.files import LARGEST_TEXT_BYTES, json_of, read_bytes, text_of
from blurnoise_eval.system.urls import Location, local_file

T = TypeVar("T")
Form = TypeVar("Form", bound=BaseModel)
LARGEST_SET_BYTES = 2 << 30
"""Of a file with the labels of a whole set: COCO's of 118 000 pictures has 448 MB, BDD100K's of 70 000 1.3 GB."""
LARGEST_ID = 2**63
"""COCO's tools hold ids in 64 bits."""

Number = Annotated[float, Strict()]
"""A number, which may be NaN or infinite."""
Whole = Annotated[
    int,
    BeforeValidator(lambda value: int(value) if type(value) is float and value.is_integer() else value),
    Strict(),
    Gt(-LARGEST_ID),
    Lt(LARGEST_ID),
]
"""A whole number of at most 64 bits; 7.0 is one."""


def _flag(value: object) -> object:
    """pydantic reads the rest; for Python the texts "0" and "false" are true."""
    if value is None:
        return False
    return value.strip().removesuffix(".0") if isinstance(value, str) else value


Flag = Annotated[bool, BeforeValidator(_flag)]
"""Yes or no: true, 1, 1.0, their texts, "yes", and the opposites in any case; null is no. Else it is an error."""


@contextmanager
def faults_of(name: str, file: Location) -> Iterator[None]:
    """Turn errors inside into one ``ValueError`` that begins with "name = file"."""
    try:
        yield
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or " ".join(str(error).split())
        other = getattr(error, "filename", None) or str(file)
        named = "" if str(other) == str(file) else f"{other}: "
        raise ValueError(f"{name} = {str(file)!r}: {named}{why}") from None


def read_text(file: Location, largest: int = LARGEST_TEXT_BYTES) -> str:
    """The file as UTF-8, with or without a byte-order mark; line ends are ``\\n``. Raises ``OSError``, and
    ``ValueError``, also above ``largest`` bytes."""
    return text_of(read_bytes(local_file(file), largest))


def as_json(content: str, what: str) -> Any:
    """``content`` as JSON. Raises ``ValueError`` that it is not ``what``."""
    try:
        return json_of(content)
    except ValueError as error:
        raise ValueError(f"is not {what}: {error}") from None


def checked(form: type[Form], value: object, name: str = "") -> Form:
    """``value`` in that form. Raises ``ValueError`` of one line: ``name``, the place in it, and what stands there."""
    try:
        return form.model_validate(value)
    except ValidationError as error:
        fault = error.errors(include_url=False)[0]
    location, must = list(fault["loc"]), re.sub(r"^\w+ should", "must", fault["msg"])
    must = must.partition(" or instance")[0].replace(" after validation", "")
    if fault["type"] == "missing":
        must = f"has no {location.pop()!r}"
    for part in location:
        name += f"[{part}]" if isinstance(part, int) else f": {part}"
    value_text = f" = {shown(fault['input'])}" if must.startswith("must") else ""
    raise ValueError(f"{name}{value_text}: {must.removeprefix('Value error, ')}".lstrip(" :="))


def each(entries: object, name: str, form: type[Form]) -> Iterator[Form]:
    """Every object of a list in that form. Raises as :func:`checked` does."""
    if not isinstance(entries, list):
        raise ValueError(f"{name} = {shown(entries)}: must be a list")
    for index, entry in enumerate(entries):
        yield checked(form, entry, f"{name}[{index}]")


def each_line(content: str, read: Callable[[str], T]) -> Iterator[T]:
    """Apply ``read`` to every line that is not blank. A ``ValueError`` gets the number of the line."""
    for number, line in enumerate(content.split("\n"), start=1):
        if line.strip():
            try:
                value = read(line)
            except ValueError as error:
                raise ValueError(f"line {number}: {error}") from None
            yield value


def xml_of(content: str) -> ElementTree.Element:
    """``content`` as XML without a document type, whose entities can grow without bounds or name other files. Raises
    ``ValueError``."""
    if "<!DOCTYPE" in content or "<!ENTITY" in content:
        raise ValueError("has a document type (<!DOCTYPE ...>); must be plain XML without one")
    try:
        return ElementTree.fromstring(content)
    except (ElementTree.ParseError, ValueError) as error:
        raise ValueError(f"is not XML: {error}") from None


class Sized(BaseModel):
    """Size of a picture, px, where both sides are known."""

    width: Number | None = None
    height: Number | None = None

    @property
    def size_px(self) -> tuple[float, float] | None:
        """Width and height; None where one is missing or 0."""
        return (self.width, self.height) if self.width and self.height else None
