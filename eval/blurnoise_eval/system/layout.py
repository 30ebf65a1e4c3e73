"""Text laid out for a terminal: paragraphs, and tables that lose nothing at any width.

Domain: widths in cells, of which a Chinese letter takes two. A width of None is a pipe's or a file's: tables are as
wide as they are, paragraphs have 79 cells. A table that does not fit gets, in this order, wrapped prose, its first
column on lines of its own, or a record for each row; what stands between two spaces stays whole wherever it fits.
"""

from __future__ import annotations

from collections.abc import Sequence
from unicodedata import combining, east_asian_width

PROSE = 79
_LEAST = 20  # cells of a column that is wrapped
_GAP = "  "
_BOUND = "\u00a0"  # a space at which no line ends


def paragraph(text: str, width: int | None = None, indent: int = 0, hanging: int = 0) -> list[str]:
    """The text in lines; only a word that is wider than a line is broken, and none where there is no terminal."""
    most = width or PROSE
    lines, fresh = [" " * indent], True
    for word in text.split(" "):
        whole = width is None or cell_len(word) <= most - len(lines[-1] if fresh else " " * hanging)
        first, *others = [word] if whole else _chopped(word, max(most - hanging, 2))
        if not fresh and cell_len(f"{lines[-1]} {first}") > most:
            lines, fresh = [*lines, " " * hanging], True
        lines[-1] += first if fresh else f" {first}"
        lines += [" " * hanging + part for part in others]
        fresh = fresh and not word
    return [line.replace(_BOUND, " ").rstrip() for line in lines]


def table(
    heads: Sequence[str], rows: Sequence[Sequence[str]], right: Sequence[bool], width: int | None = None
) -> list[list[str]]:
    """The lines of the heading, then of each row. right: by column, whether it holds numbers, never wrapped.

    The heading has no lines where each record has it.
    """
    every = [list(heads), *map(list, rows)]
    widths = _widths(every, right, width)
    if widths or width is None:
        return [_beside(row, widths or [], right, low=row is every[0]) for row in every]
    widths = _widths([row[1:] for row in every], right[1:], width - len(_GAP))
    if widths:
        return [
            [
                *(paragraph(_one_line(first), width, hanging=4) if first else []),
                *(_GAP + line for line in _beside(rest, widths, right[1:], low=place == 0)),
            ]
            for place, (first, *rest) in enumerate(every)
        ]
    named = f"{heads[0]} " if right[0] else ""
    return [[], *(_record(heads, [named + row[0], *row[1:]], width) for row in rows)]


def table_lines(
    heads: Sequence[str], rows: Sequence[Sequence[str]], right: Sequence[bool], width: int | None = None
) -> list[str]:
    """The whole table of :func:`table`."""
    top, *bodies = table(heads, rows, right, width)
    return [*top, *([rule([top, *bodies])] if top else []), *(line for body in bodies for line in body)]


def rule(parts: Sequence[Sequence[str]]) -> str:
    """As wide as the widest of the lines."""
    return "-" * max(_widest(part, "\n") for part in parts)


def _widths(rows: Sequence[Sequence[str]], right: Sequence[bool], width: int | None) -> list[int] | None:
    """Of each column; None where the narrowest do not fit. Numbers stay in a line; their heading may be wrapped."""
    columns = list(zip(*rows, strict=True))
    full = [_widest(column, "\n") for column in columns]
    if width is None or sum(full) + len(_GAP) * (len(full) - 1) <= width:
        return full
    found = [
        max(_widest(column[1:], "\n"), _widest(column[:1]))
        if numbers
        else max(_widest(column), min(wide, _LEAST))
        for column, numbers, wide in zip(columns, right, full, strict=True)
    ]
    spare = width - sum(found) - len(_GAP) * (len(found) - 1)
    while spare > 0 and found != full:
        lacking = max(range(len(found)), key=lambda place: full[place] - found[place])
        found[lacking] += 1
        spare -= 1
    return found if spare >= 0 else None


def _widest(texts: Sequence[str], between: str | None = None) -> int:
    return max((cell_len(part) for text in texts for part in text.split(between)), default=0)


def _beside(row: Sequence[str], widths: Sequence[int], right: Sequence[bool], *, low: bool) -> list[str]:
    """low: cells of fewer lines stand at the bottom."""
    cells = [
        [line for part in text.split("\n") for line in paragraph(part, max(wide, 2))]
        for text, wide in zip(row, widths, strict=True)
    ]
    most = max(map(len, cells))
    for cell in cells:
        cell[0 if low else len(cell) :] = [""] * (most - len(cell)) + (cell if low else [])
    return [_GAP.join(map(_padded, line, widths, right)).rstrip() for line in zip(*cells, strict=True)]


def _padded(text: str, width: int, right: bool) -> str:
    space = " " * (width - cell_len(text))
    return space + text if right else text + space


def _record(heads: Sequence[str], row: Sequence[str], width: int) -> list[str]:
    """The row's first cell, and below it each of the others behind its heading."""
    indent = len(_GAP)
    said = [
        _bound(f"{_one_line(head)} {_bound(_one_line(text), width - indent)}", width - indent)
        for head, text in zip(heads[1:], row[1:], strict=True)
        if text
    ]
    rest = paragraph(_GAP.join(said), width, indent, indent) if said else []
    return [*paragraph(_one_line(row[0]), width, hanging=4), *rest]


def _bound(text: str, most: int) -> str:
    """The text so that no line ends in it, where it fits into one."""
    return text.replace(" ", _BOUND) if _widest([text], "\n") <= most else text


def _one_line(text: str) -> str:
    return " ".join(text.split("\n")).strip()


def cell_len(text: str) -> int:
    """Cells that the text takes: two for a wide letter, none for an accent that stands above the letter before."""
    if text.isascii():
        return len(text)
    return sum(0 if combining(each) else 2 if east_asian_width(each) in "WF" else 1 for each in text)


def _chopped(word: str, most: int) -> list[str]:
    parts = [""]
    for letter in word:
        if cell_len(parts[-1] + letter) > most:
            parts.append("")
        parts[-1] += letter
    return parts
