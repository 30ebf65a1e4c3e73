"""Docstrings as Markdown: their roles (``:class:`Camera```) become code, their examples blocks of code."""

from __future__ import annotations

import re
from typing import Any

import griffe

_ROLE = re.compile(r":(?:class|func|data|mod|meth|attr):`~?([^`]+)`")
_EXAMPLE = re.compile(r"^>>> .*\n?(?:^[^\n]+\n?)*", re.MULTILINE)
"""From the first prompt to the next empty line, as doctest reads it."""


class Roles(griffe.Extension):
    """Rewrites docstrings as they are read."""

    def on_instance(self, *, obj: griffe.Object, **_: Any) -> None:
        """Any module, class, function or constant."""
        if obj.docstring:
            text = _ROLE.sub(r"`\1`", obj.docstring.value)
            obj.docstring.value = _EXAMPLE.sub(_fenced, text)


def _fenced(example: re.Match[str]) -> str:
    return f"\n```pycon\n{example[0].rstrip()}\n```\n"
