"""The terminal: all that commands print goes through here, because names in files are anybody's.

Text is shown as it stands: square brackets and colons are no markup, and what would steer a terminal is a "?".
"""

from __future__ import annotations

import io
import json
import os
import shutil
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import TYPE_CHECKING, Any

from blurnoise_eval.system.layout import PROSE, paragraph, rule
from blurnoise_eval.system.layout import table as laid_out

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

LEAST_WIDTH = 20


def plain(text: object) -> str:
    """The text in one line: spaces for line breaks, "?" for control and format characters and lone surrogates."""
    return "".join(
        letter if letter.isprintable() else " " if letter.isspace() else "?" for letter in str(text)
    )


def shortened(text: str, most: int = 1000) -> str:
    """The text, of more than ``most`` characters only begin and end."""
    return text if len(text) <= most else f"{text[: most // 2]} ... {text[-most // 2 :]}"


def say(*lines: object, error: bool = False) -> None:
    """Print each of these as one plain line, on standard output or standard error."""
    for line in lines:
        print(plain(line), file=sys.stderr if error else sys.stdout)


def say_json(value: Any) -> None:
    """Print one line of JSON, in ASCII. Raises ``ValueError`` for what JSON has no word for."""
    print(json.dumps(value, allow_nan=False))


def width() -> int | None:
    """Columns of the terminal, or as many as COLUMNS says; None where standard output is a pipe or a file."""
    if "COLUMNS" not in os.environ and not sys.stdout.isatty():
        return None
    return max(shutil.get_terminal_size().columns, LEAST_WIDTH)


def say_wrapped(text: str, indent: int = 0, hanging: int = 0, *, error: bool = False) -> None:
    """Print a paragraph, of 79 columns where there is room."""
    wide = width()
    say(*paragraph(plain(text), wide and min(wide, PROSE), indent, hanging), error=error)


def show(*tables: Table) -> None:
    """Print tables of rich as they fit into the terminal: their titles, headings, cells and captions, plain."""
    for table in tables:
        if table.title:
            say_wrapped(str(table.title))
        columns = [[_lines(cell) for cell in (column.header, *column.cells)] for column in table.columns]
        right = [column.justify == "right" for column in table.columns]
        heads, *rows = zip(*columns, strict=True)
        top, *bodies = laid_out(heads, rows, right, width())
        if top:
            say(*top, rule([top, *bodies]))
        for row, body in zip(table.rows, bodies, strict=True):
            say(*body, *([""] if row.end_section and body is not bodies[-1] else []))
        if table.caption:
            say_wrapped(str(table.caption))
        say("")


def _lines(text: object) -> str:
    return "\n".join(map(plain, str(text).split("\n")))


def plain_console(*, error: bool = False) -> Console:
    """A console of rich that takes every text in what it prints, table or line, as it stands."""
    return _plain_console_class()(stderr=error, markup=False, emoji=False)


@cache
def _plain_console_class() -> type[Console]:
    from rich.console import Console
    from rich.text import Text

    class PlainConsole(Console):
        """All that rich prints of text becomes a ``Text`` here."""

        def render_str(self, text: str, **options: Any) -> Text:
            return super().render_str("\n".join(map(plain, text.split("\n"))), **options)

    return PlainConsole


def accept_all_text() -> None:
    """Standard output and error show a letter that their encoding does not have as "?"; closed ones take all text."""
    sys.stdout, sys.stderr = sys.stdout or io.StringIO(), sys.stderr or io.StringIO()
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")


@contextmanager
def plain_warnings() -> Iterator[None]:
    """Warnings are a plain line each meanwhile; that a font lacks a letter of somebody's name is none."""
    before = warnings.formatwarning
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", r"Glyph \d+ .*missing from", UserWarning)
        warnings.formatwarning = lambda message, *_, **__: f"blurnoise: warning: {plain(message)}\n"
        try:
            yield
        finally:
            warnings.formatwarning = before
