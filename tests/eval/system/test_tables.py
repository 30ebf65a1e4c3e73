"""Tables as text: what is written reads back, line by line."""

from __future__ import annotations

import csv
import io
from typing import Any

from blurnoise_eval.system.tables import csv_lines

ROWS: list[dict[str, Any]] = [
    {"name": 'a "quoted", name', "value": 0.1, "none": None},
    {"name": "two\nlines", "value": 1e-300, "none": None},
]


def test_csv_reads_back() -> None:
    lines = list(csv_lines(["name", "value", "none"], ROWS))
    read = list(csv.DictReader(io.StringIO("".join(lines), newline="")))
    assert [(row["name"], float(row["value"]), row["none"]) for row in read] == [
        (row["name"], row["value"], "") for row in ROWS
    ]
