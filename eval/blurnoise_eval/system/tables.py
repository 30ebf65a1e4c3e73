"""Tables as text, a line at a time, for :func:`blurnoise_eval.system.files.write_whole` to write as they come."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

_FORMULA = re.compile(r"'*[=+\-@\t\r\n\0]")


def plain(value: Any) -> Any:
    """A value for a file: infinity is an axis's that the camera sets itself, "auto"; JSON has none."""
    return "auto" if value == math.inf else value


def finite(value: float | None) -> float | None:
    """The value, or None for what is none, infinite or not a number."""
    return float(value) if value is not None and math.isfinite(value) else None


def csv_lines(columns: Sequence[str], rows: Iterable[Mapping[str, Any]]) -> Iterator[str]:
    """A table as lines of CSV, its header first."""
    yield csv_text([columns])
    for row in rows:
        yield csv_text([[plain(row.get(name)) for name in columns]])


def csv_text(rows: Iterable[Sequence[Any]]) -> str:
    """Rows as lines of CSV, texts :func:`guarded`."""
    text = io.StringIO()
    csv.writer(text).writerows([guarded(value) for value in row] for row in rows)
    return text.getvalue()


def guarded(value: Any) -> Any:
    """A text that a spreadsheet would compute begins with an apostrophe more; numbers are as they are.

    Names of classes, models and pictures may be anybody's. Source: CWE-1236; OWASP ASVS 5.0, requirement 1.2.10.
    """
    return f"'{value}" if isinstance(value, str) and _FORMULA.match(value) else value
