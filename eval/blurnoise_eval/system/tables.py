"""Tables as text, a line at a time, for :func:`blurnoise_eval.system.files.write_whole` to write as they come."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable, Iterator, Sequence
from typing import Any


def csv_lines(columns: Sequence[str], rows: Iterable[dict[str, Any]]) -> Iterator[str]:
    """A table as lines of CSV, its header first."""
    line = io.StringIO()
    writer = csv.DictWriter(line, fieldnames=columns)
    writer.writeheader()
    for row in rows:
        writer.writerow(row)
        yield line.getvalue()
        line.seek(0)
        line.truncate()
    yield line.getvalue()


def json_lines(rows: Iterable[dict[str, Any]]) -> Iterator[str]:
    """A list of rows as JSON, a line each."""
    before = "["
    for row in rows:
        yield f"{before}\n {json.dumps(row)}"
        before = ","
    yield "[]\n" if before == "[" else "\n]\n"
