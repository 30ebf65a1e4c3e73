"""Tables as lines of CSV, one at a time, for :func:`blurnoise_eval.system.files.write_whole`."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

_FORMULA = re.compile(r"'*[=+\-@\t\r\n\0]")


def plain(value: Any) -> Any:
    """A value for a file: "auto" for infinity, the value of an axis that the camera sets. JSON has no infinity.

    >>> plain(math.inf), plain(0.5)
    ('auto', 0.5)
    """
    return "auto" if value == math.inf else value


def finite(value: float | None) -> float | None:
    """The value; None if it is None, infinite or NaN.

    >>> finite(0.5), finite(math.nan)
    (0.5, None)
    """
    return float(value) if value is not None and math.isfinite(value) else None


def csv_lines(columns: Sequence[str], rows: Iterable[Mapping[str, Any]]) -> Iterator[str]:
    """A table as lines of CSV, with a header.

    >>> list(csv_lines(["image", "gain_db"], [{"image": "=1+1", "gain_db": math.inf}]))
    ['image,gain_db\\r\\n', "'=1+1,auto\\r\\n"]
    """
    yield csv_text([columns])
    for row in rows:
        yield csv_text([[plain(row.get(name)) for name in columns]])


def csv_text(rows: Iterable[Sequence[Any]]) -> str:
    """Rows as lines of CSV, texts :func:`guarded`.

    >>> csv_text([["image", 0.5]])
    'image,0.5\\r\\n'
    """
    text = io.StringIO()
    csv.writer(text).writerows([guarded(value) for value in row] for row in rows)
    return text.getvalue()


def guarded(value: Any) -> Any:
    """Put an apostrophe in front of a text that a spreadsheet would compute; numbers are returned unchanged.

    Names of classes, models and pictures may come from anyone. Source: CWE-1236; OWASP ASVS 5.0, requirement 1.2.10.

    >>> guarded("=HYPERLINK(1)"), guarded("car"), guarded(-1)
    ("'=HYPERLINK(1)", 'car', -1)
    """
    return f"'{value}" if isinstance(value, str) and _FORMULA.match(value) else value
