"""Documents, JSON and YAML, from anywhere: read within limits; what is none is one line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import yaml

from blurnoise._core.files import read_bytes

_LARGEST_BYTES = 1 << 20  # of what a person writes: YAML is read at 50 kB a second
_MOST_ALIASES = 16  # each may hold two of another: more would be a bomb


def read_document(path: Path) -> Any:
    """What a file holds, JSON by its suffix .json, else YAML, of at most 1 MiB.

    Raises ``OSError``, and ``ValueError`` of one line.
    """
    text = read_bytes(path, _LARGEST_BYTES).decode("utf-8-sig")
    return json_of(text) if path.suffix.lower() == ".json" else yaml_of(text)


def json_of(text: str) -> Any:
    """``text`` as JSON. Raises ``ValueError`` of one line."""
    try:
        return json.loads(text)
    except RecursionError:
        raise ValueError("nested too deeply") from None


def yaml_of(text: str) -> Any:
    """``text`` as YAML of plain values. Raises ``ValueError`` of one line."""
    if len(text) > _LARGEST_BYTES:
        raise ValueError(f"longer than {_LARGEST_BYTES} characters")
    try:
        return yaml.load(text, _Loader)
    except RecursionError:
        raise ValueError("nested too deeply") from None
    except Exception as error:  # its constructors raise all sorts
        raise ValueError(" ".join(str(error).split())[:300]) from None


class _Loader(yaml.SafeLoader):
    """Refuses many aliases (*name) and merges (<<), with which a short text holds a billion values."""

    aliases = 0

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        if self.check_event(yaml.AliasEvent):
            self.aliases += 1
            if self.aliases > _MOST_ALIASES:
                raise ValueError(f"more than {_MOST_ALIASES} aliases (*name)")
        return super().compose_node(parent, index)
