"""Files that are read: regular files of limited size.

Documents (JSON and YAML, from anywhere) and tables of samples (CSV): any fault is one line.
"""

from __future__ import annotations

import csv
import errno
import json
import os
import stat
from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml

from blurnoise._core.writing import note_inputs

LARGEST_TEXT_BYTES = 64 << 20
"""Of a table as CSV: a day of readings at 20 Hz, or an hour at 500 Hz."""
_MOST_ALIASES = 16  # each may hold two of another, and so on
_LARGEST_BYTES = 1 << 20  # of a document: YAML is read at 50 kB a second


def check_regular(path: Path) -> None:
    """Raise ``OSError`` for a missing file, and for a directory, device or pipe, which may never end.

    >>> check_regular(Path("."))
    Traceback (most recent call last):
    OSError: [Errno 22] is a folder, device or pipe; must be a file: '.'
    """
    if not stat.S_ISREG(path.stat().st_mode):
        raise OSError(errno.EINVAL, "is a folder, device or pipe; must be a file", str(path))


def read_bytes(path: Path, largest: int = LARGEST_TEXT_BYTES) -> bytes:
    """The content of a regular file. Raises ``OSError``, and ``ValueError`` above ``largest`` bytes.

    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "a.txt"
    >>> path.write_bytes(b"abc") and read_bytes(path)
    b'abc'
    """
    check_regular(path)
    with path.open("rb") as file:
        held = os.fstat(file.fileno()).st_size
        # One byte more than allowed tells a file that grew meanwhile; files of /proc state a size of 0.
        data = b"" if held > largest else file.read(min(largest, max(held, LARGEST_TEXT_BYTES)) + 1)
    if max(held, len(data)) > largest:
        raise ValueError(f"larger than {largest} bytes")
    return data


def read_text(path: Path) -> str:
    """:func:`text_of` a file. Raises ``OSError``, and ``ValueError`` that names it.

    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "a.txt"
    >>> path.write_bytes(b"1,2\\r\\n") and read_text(path)
    '1,2\\n'
    """
    try:
        return text_of(read_bytes(path))
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def text_of(data: bytes) -> str:
    """Text in UTF-8, with or without a byte-order mark; line ends become ``\\n``. Raises ``ValueError``.

    >>> text_of(b"a\\r\\nb")
    'a\\nb'
    """
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ValueError(f"not UTF-8 text (byte {error.start})") from None
    return text.replace("\r\n", "\n").replace("\r", "\n")


def read_document(path: Path) -> Any:
    """The content of a file of at most 1 MiB, JSON by its suffix .json, else YAML.

    Raises ``OSError``, and ``ValueError`` of one line.

    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "a.yaml"
    >>> path.write_text("{width: 3}") and read_document(path)
    {'width': 3}
    """
    text = read_bytes(path, _LARGEST_BYTES).decode("utf-8-sig")
    note_inputs([path])
    return json_of(text, _without_doubles) if path.suffix.lower() == ".json" else yaml_of(text)


def json_of(text: str, pairs: Callable[[list[tuple[str, Any]]], Any] | None = None) -> Any:
    """``text`` as JSON; pairs: makes each object from its keys and values. Raises ``ValueError`` of one line.

    >>> json_of('{"width": 3}')
    {'width': 3}
    """
    try:
        return json.loads(text, object_pairs_hook=pairs)
    except RecursionError:
        raise ValueError("nested too deeply") from None


def _without_doubles(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    values: dict[str, Any] = {}
    for key, value in pairs:
        if key in values:
            raise ValueError(f"{key}: is given twice")
        values[key] = value
    return values


def yaml_of(text: str) -> Any:
    """``text`` as YAML of plain values. Raises ``ValueError`` of one line.

    >>> yaml_of("{width: 3, at: 1:30}")
    {'width': 3, 'at': '1:30'}
    >>> yaml_of("{a: 1, a: 2}")
    Traceback (most recent call last):
    ValueError: a: is given twice, again in line 1
    """
    if len(text) > _LARGEST_BYTES:
        raise ValueError(f"longer than {_LARGEST_BYTES} characters")
    try:
        return yaml.load(text, _Loader)
    except RecursionError:
        raise ValueError("nested too deeply") from None
    except Exception as error:  # its constructors raise all sorts
        raise ValueError(" ".join(str(error).split())[:300]) from None


class _Loader(yaml.SafeLoader):
    """YAML without surprises: a key that is given twice is refused, because one value would be lost; so are a value
    that contains itself, and many aliases, by which a short text holds a billion values. 1:30 is text, not 90 as in
    YAML 1.1."""

    def __init__(self, text: str) -> None:
        super().__init__(text)
        self.aliases = 0
        self.around: list[str | None] = []  # anchors of the values that contain the next one

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        anchor = self.peek_event().anchor  # type: ignore[no-untyped-call]
        if self.check_event(yaml.AliasEvent):
            self.aliases += 1
            if self.aliases > _MOST_ALIASES:
                raise ValueError(f"more than {_MOST_ALIASES} aliases (*name)")
            if anchor in self.around:
                raise ValueError(f"*{anchor}: must not stand within &{anchor}")
        self.around.append(anchor)
        try:
            return super().compose_node(parent, index)
        finally:
            self.around.pop()

    def compose_mapping_node(self, anchor: Any) -> yaml.MappingNode:
        node = super().compose_mapping_node(anchor)
        seen: set[tuple[str, str]] = set()
        for key, _ in node.value:
            if isinstance(key, yaml.ScalarNode) and key.tag != "tag:yaml.org,2002:merge":
                if (key.tag, key.value) in seen:
                    raise ValueError(f"{key.value}: is given twice, again in line {key.start_mark.line + 1}")
                seen.add((key.tag, key.value))
        return node

    def construct_number(self, node: yaml.ScalarNode) -> Any:
        """As YAML has it, unless it has colons."""
        if ":" in node.value:
            return node.value
        whole = node.tag == "tag:yaml.org,2002:int"
        return self.construct_yaml_int(node) if whole else self.construct_yaml_float(node)


for _tag in ("int", "float"):
    _Loader.add_constructor(f"tag:yaml.org,2002:{_tag}", _Loader.construct_number)


def read_samples(path: str | Path, column: int, position: str) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Read positions (column 0) and values (``column``) from a CSV file, sorted; the first row may be a header.

    position: what column 0 holds, for messages.

    Raises ``ValueError`` that names the file and line when a row does not hold numbers, or for fewer than two.

    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "curve.csv"
    >>> path.write_text("nm,share\\n700,0.1\\n400,0.5\\n") and read_samples(path, 1, "a wavelength in nm")
    ((400.0, 700.0), (0.5, 0.1))
    """
    samples: list[tuple[float, float]] = []
    note_inputs([Path(path)])
    for number, row in enumerate(csv.reader(read_text(Path(path)).split("\n")), start=1):
        if not row or not row[0].strip():
            continue
        try:
            samples.append((float(row[0]), float(row[column])))
        except (ValueError, IndexError):
            if samples or number > 1:
                expected = f"{position} and a number in column {column}"
                raise ValueError(
                    f"{path}, line {number}: expected {expected}, got {','.join(row)!r}"
                ) from None
    if len(samples) < 2:
        raise ValueError(f"{path}: holds {len(samples)} samples; a curve needs at least 2")
    positions, values = zip(*sorted(samples), strict=True)
    return positions, values
