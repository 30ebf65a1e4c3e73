"""The terminal: all output of the commands goes through here, because names in files may come from anyone.

Text is printed literally: square brackets and colons are not markup, and a "?" replaces control characters.
"""

from __future__ import annotations

import io
import json
import os
import shutil
import sys
import textwrap
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

PROSE = 79
"""Columns of a paragraph."""
_PIPE_WIDTH = 10_000  # of tables in a pipe or a file: one line per row, for other programs


def plain(text: object) -> str:
    """The text in one line: spaces for line breaks, "?" for control and format characters and lone surrogates.

    >>> plain("red \\x1b[31m\\nsign")
    'red ?[31m sign'
    """
    return "".join(
        letter if letter.isprintable() else " " if letter.isspace() else "?" for letter in str(text)
    )


def shortened(text: str, most: int = 1000) -> str:
    """The text; if it has more than ``most`` characters, its begin and end.

    >>> shortened("abcdefgh", 4)
    'ab ... gh'
    """
    return text if len(text) <= most else f"{text[: most // 2]} ... {text[-most // 2 :]}"


def say(*lines: object, error: bool = False) -> None:
    """Print each argument as one plain line, on standard output or standard error."""
    for line in lines:
        print(plain(line), file=sys.stderr if error else sys.stdout)


def say_json(value: Any) -> None:
    """Print one line of JSON, in ASCII. Raises ``ValueError`` for infinity and NaN, which JSON does not have."""
    # ASCII: a pipe's encoding may not have all letters.
    print(json.dumps(value, allow_nan=False))


def width() -> int | None:
    """The columns of the terminal, or COLUMNS; None if standard output is a pipe or a file."""
    if "COLUMNS" not in os.environ and not sys.stdout.isatty():
        return None
    # Narrower than a word, tables have a letter in each line.
    return max(shutil.get_terminal_size().columns, 20)


def paragraph(
    text: str, width: int | None = None, indent: int = 0, hanging: int = 0, *, whole: bool = False
) -> list[str]:
    """The text in lines of at most ``width`` columns; without a terminal (None), of 79, and without broken words.

    indent, hanging: spaces before the first line and before the others. whole: break no words.

    >>> paragraph("four words of text", 10, hanging=2)
    ['four words', '  of text']
    """
    wrapper = textwrap.TextWrapper(width or PROSE, " " * indent, " " * hanging, break_on_hyphens=False)
    wrapper.break_long_words = width is not None and not whole
    return wrapper.wrap(text) or [""]


def say_wrapped(text: str, indent: int = 0, hanging: int = 0, *, error: bool = False) -> None:
    """Print a paragraph of at most 79 columns."""
    wide = width()
    say(*paragraph(plain(text), wide and min(wide, PROSE), indent, hanging), error=error)


def show(*tables: Table) -> None:
    """Print tables of rich with titles and captions, in the width of the terminal, else in 80 columns."""
    for table in tables:
        title, caption = table.title, table.caption
        table.title = table.caption = None
        if title:
            say_wrapped(str(title))
        say(*_lines_of(table, width() or PROSE + 1))
        if caption:
            say_wrapped(str(caption))
        say("")


def table_lines(
    heads: Sequence[str],
    rows: Sequence[Sequence[str]],
    right: Sequence[bool],
    width: int | None = None,
    *,
    rule: bool = True,
) -> list[str]:
    """A table in lines of at most ``width`` columns. right: the columns that hold numbers. rule: below the headings.

    >>> print(*table_lines(["name", "n"], [["sign", "12"]], [False, True]), sep="\\n")
    name   n
    --------
    sign  12
    """
    from rich.table import Table

    table = Table()
    for head, numbers in zip(heads, right, strict=True):
        table.add_column(head, justify="right" if numbers else "left")
    for row in rows:
        table.add_row(*row)
    return _lines_of(table, width, rule=rule)


def _lines_of(table: Table, width: int | None, *, rule: bool = True) -> list[str]:
    """The lines of a table with two spaces between columns. Words that are wider than their column are broken."""
    from rich.box import Box

    ruled = Box("\n".join(["    ", "    ", " -- ", *["    "] * 5, ""]), ascii=True)
    table.box, table.padding = (ruled, (0, 1, 0, 0)) if rule else (None, (0, 2, 0, 0))
    table.show_edge = table.pad_edge = False
    for column in table.columns:
        column.overflow = "fold"
    written = io.StringIO()
    text_console(file=written, width=width or _PIPE_WIDTH, color_system=None).print(table)
    return [line.rstrip() for line in written.getvalue().splitlines()]


def text_console(**options: Any) -> Console:
    """A console of rich without markup. options: those of rich."""
    from rich.console import Console

    return Console(markup=False, emoji=False, highlight=False, **options)


def accept_all_text() -> None:
    """Print "?" for letters that the encoding of standard output or error does not have; ignore closed ones."""
    # Python started without them, such as by pythonw, has None there, which has no isatty.
    sys.stdout, sys.stderr = sys.stdout or io.StringIO(), sys.stderr or io.StringIO()
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")


@contextmanager
def plain_warnings() -> Iterator[None]:
    """Print warnings as plain lines, but none about letters that a font does not have."""
    before = warnings.formatwarning
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", r"Glyph \d+ .*missing from", UserWarning)
        warnings.formatwarning = lambda message, *_, **__: f"blurnoise: warning: {plain(message)}\n"
        try:
            yield
        finally:
            warnings.formatwarning = before
