"""Label files as they come from anywhere: read strictly, every fault one line that names file and place."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

from blurnoise._core.checks import shown
from blurnoise._core.files import LARGEST_TEXT_BYTES, json_of, read_bytes, text_of, yaml_of
from blurnoise_eval.system.storage import Location, Url

T = TypeVar("T")
LARGEST_ID = 2**63  # COCO's tools hold ids in 64 bits
LARGEST_SET_BYTES = 2 << 30
"""Of a file with the labels of a whole set: COCO's of 118 000 pictures has 448 MB, BDD100K's of 70 000 1.3 GB."""


@contextmanager
def faults_of(kind: str, file: Location) -> Iterator[None]:
    """What is wrong inside becomes one ``ValueError`` that begins with the kind and the file."""
    try:
        yield
    except OSError as error:
        raise ValueError(f"{kind} = {str(file)!r}: {error.strerror or error}") from None
    except ValueError as error:
        raise ValueError(f"{kind} = {str(file)!r}: {' '.join(str(error).split())}") from None


def read_text(file: Location, largest: int = LARGEST_TEXT_BYTES) -> str:
    """The file as UTF-8, with or without a byte-order mark; line ends are ``\\n``. Raises ``OSError``, and
    ``ValueError``, also above ``largest`` bytes."""
    return text_of(
        file.read_bytes(largest) if isinstance(file, Url) else read_bytes(Path(str(file)), largest)
    )


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


def each(entries: object, name: str, read: Callable[[dict[str, Any]], T]) -> Iterator[T]:
    """``read`` of every object in a list; its ``KeyError`` and ``ValueError`` come to name the place."""
    if not isinstance(entries, list):
        raise ValueError(f"{name} = {shown(entries)}: must be a list")
    for index, entry in enumerate(entries):
        if not isinstance(entry, dict):
            raise ValueError(f"{name}[{index}] = {shown(entry)}: must be an object")
        try:
            found = read(entry)
        except KeyError as error:
            raise ValueError(f"{name}[{index}]: has no {error}") from None
        except ValueError as error:
            raise ValueError(f"{name}[{index}]: {error}") from None
        yield found


def each_line(content: str, read: Callable[[str], T]) -> Iterator[T]:
    """``read`` of every line that is not blank; its ``ValueError`` comes to name the line."""
    for place, line in enumerate(content.split("\n"), start=1):
        if line.strip():
            try:
                found = read(line)
            except ValueError as error:
                raise ValueError(f"line {place}: {error}") from None
            yield found


def number(entry: dict[str, Any], key: str) -> float:
    """A number, which may be NaN or infinite. Raises ``KeyError``, ``ValueError``."""
    return as_number(entry[key], key)


def as_number(value: object, name: str) -> float:
    """``value`` as a float, one beyond its range as infinite. Raises ``ValueError`` for what is no number."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise ValueError(f"{name} = {shown(value)}: must be a number")
    try:
        return float(value)
    except OverflowError:
        return math.inf


def whole(entry: dict[str, Any], key: str) -> int:
    """A whole number of at most 64 bits. Raises ``KeyError``, ``ValueError``."""
    value = as_number(entry[key], key)
    if not value.is_integer() or abs(value) >= LARGEST_ID:
        raise ValueError(f"{key} = {shown(entry[key])}: must be a whole number of at most 64 bits")
    return int(entry[key])


def text(entry: dict[str, Any], key: str) -> str:
    """Text, markup and all. Raises ``KeyError``, ``ValueError``."""
    value = entry[key]
    if not isinstance(value, str) or not is_unicode(value):
        raise ValueError(f"{key} = {shown(value)}: must be text")
    return value


def is_unicode(characters: str) -> bool:
    """Whether they can be written to a file: JSON and YAML can hold halves of characters, which cannot."""
    try:
        characters.encode()
    except UnicodeEncodeError:
        return False
    return True
